# SPDX-License-Identifier: Apache-2.0
"""Join findings to the rows of result tables.

Typed columns decide: means, figures and claims read them. Text columns are for people, and no code
reads them.

A row has the findings on its fit, by trial or group of crossings and by amplitude. A row of a
single amplitude also has the doubts about the fit to its whole trial: a clipped or late torque
concerns all that comes from the same samples.

Example: `joined(impedance, "impedance", findings)["doubts"]`.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.base.table import read_table
from osl_analysis.config.experiments import DOUBTS_OF, JUDGED_TABLES
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.findings import WIDE_INTERVAL, Finding, fit_of
from osl_analysis.judge.known_findings import FINDINGS
from osl_analysis.judge.rules import Grade
from osl_analysis.judge.wording import cell_text, verdict_texts
from osl_analysis.stats.budget import QUANTITIES
from osl_analysis.stats.doubts import DOUBT_TYPE, DOUBTS

RowFindings = list[list[Finding]]  # for each row of a table
GROUP_DOUBTS = "group_doubts"
"""Column of `walking_summary.csv`: the doubts about a row's group. Unlike `DOUBTS` they take no row
out of a mean: a group's estimate is that of all its crossings."""
WIDE_ESTIMATES = "wide_estimates"  # column: estimates whose intervals are wider than needed
RESULTS = "results"  # column: sources that are properties of the device, as friction
JOINED_COLUMNS = {
    DOUBTS: pl.List(DOUBT_TYPE),
    WIDE_ESTIMATES: pl.List(pl.String),
    RESULTS: pl.List(pl.String),
}
SUMMARISED_GROUPS = "walking_summary"
JUDGED_AS: Mapping[str, str] = {**DOUBTS_OF, SUMMARISED_GROUPS: "walking_groups"}
"""By table whose rows have no findings of their own, the table whose findings they have."""
WHY_NO_FIT = "reason"  # column: why a row has no fit; null in rows with a fit


def judged_as(table: str) -> str:
    """The name of the table whose findings the rows of a table have."""
    return JUDGED_AS.get(table, table)


def findings_of_rows(
    table: pl.DataFrame, findings: Iterable[Finding], name: str = ""
) -> RowFindings:
    """The findings about each row of a table.

    Parameters
    ----------
    table : polars.DataFrame
        With `trial` or `group`, and `amplitude_deg` where its fits have one.
    findings : Iterable of Finding
    name : str
        The table's name; empty: findings on any table count.
    """
    by_fit: dict[tuple[str, float | None], list[Finding]] = {}
    for finding in findings:
        if not name or finding.table == judged_as(name):
            by_fit.setdefault((finding.subject, finding.amplitude_deg), []).append(finding)
    findings_by_row = []
    for row in table.select(pl.col("^(trial|group|amplitude_deg)$")).to_dicts():
        trial, amplitude_deg = fit_of(row)
        row_findings = list(by_fit.get((trial, amplitude_deg), ()))
        if amplitude_deg is not None:
            trial_findings = by_fit.get((trial, None), ())
            row_findings += [finding for finding in trial_findings if finding.grade is Grade.DOUBTS]
        findings_by_row.append(row_findings)
    return findings_by_row


# Typed columns


def with_findings(table: pl.DataFrame, findings: RowFindings) -> pl.DataFrame:
    """A table with the columns of `JOINED_COLUMNS`, from the findings on each of its rows."""
    columns: dict[str, list[Any]] = {
        DOUBTS: [doubt_cells(row_findings) for row_findings in findings],
        WIDE_ESTIMATES: [wide_estimates(row_findings) for row_findings in findings],
        RESULTS: [results_in(row_findings) for row_findings in findings],
    }
    return table.with_columns(
        pl.Series(name, cells, dtype=JOINED_COLUMNS[name]) for name, cells in columns.items()
    )


def doubt_cells(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """The distinct doubts among some findings, as a cell of `DOUBTS`."""
    doubts: list[dict[str, Any]] = []
    for finding in findings:
        if finding.grade is Grade.DOUBTS:
            doubt = {"source": finding.source, "estimates": list(finding.estimates)}
            if doubt not in doubts:
                doubts.append(doubt)
    return doubts


def wide_estimates(findings: Iterable[Finding]) -> list[str]:
    """The estimates whose intervals are wider than is needed."""
    for finding in findings:
        if finding.source == WIDE_INTERVAL and finding.grade is Grade.NOTES:
            return list(finding.estimates)
    return []


def results_in(findings: Iterable[Finding]) -> list[str]:
    """The sources that are properties of the device, in the order of `words.yaml`."""
    sources = {finding.source for finding in findings if finding.is_result}
    return [source for source in FINDINGS if source in sources]


def joined(table: pl.DataFrame, name: str, findings: Sequence[Finding]) -> pl.DataFrame:
    """The result table `name` with the columns of `JOINED_COLUMNS`, from the findings of the
    campaign; a table without rows of fits or groups as it is."""
    if judged_as(name) not in JUDGED_TABLES:
        return table
    findings_by_row = with_findings(table, findings_of_rows(table, findings, name))
    return (
        findings_by_row.rename({DOUBTS: GROUP_DOUBTS})
        if name == SUMMARISED_GROUPS
        else findings_by_row
    )


def read_joined(tables: Mapping[str, Path], findings: Sequence[Finding]) -> dict[str, pl.DataFrame]:
    """Read result tables by name, with the findings on their rows (`joined`)."""
    return {name: joined(read_table(path), name, findings) for name, path in tables.items()}


# Text columns


def with_texts(table: pl.DataFrame, findings: RowFindings, name: str) -> pl.DataFrame:
    """The table `name` with the text columns that the dictionary describes.

    `doubtful` has the doubts about a row, `remarks` the other findings, and `K_verdict` and the
    like the verdicts. A cell is null without a finding, and in a row without a fit.
    """
    described = described_tables_by_name()[name].columns
    texts: list[dict[str, str | None]] = []
    for row, row_findings in zip(table.to_dicts(), findings, strict=True):
        if row.get(WHY_NO_FIT) is not None:
            texts.append({})
            continue
        doubts = [finding for finding in row_findings if finding.grade is Grade.DOUBTS]
        further = [finding for finding in row_findings if finding.grade is not Grade.DOUBTS]
        verdicts = {
            f"{symbol}_verdict": text for symbol, text in verdict_texts(row_findings).items()
        }
        texts.append({"doubtful": cell_text(doubts), **verdicts, "remarks": cell_text(further)})
    names = ["doubtful", *(f"{symbol}_verdict" for symbol in QUANTITIES), "remarks"]
    schema = {column: pl.String for column in names if column in described or column == "doubtful"}
    return table.with_columns(pl.DataFrame(texts, schema=schema).get_columns())
