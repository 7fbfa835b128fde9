# SPDX-License-Identifier: Apache-2.0
"""Findings joined to the rows of result tables: as typed columns, by which anything later decides,
and as text columns, which people read and no code.

A row has the findings about its fit: those on its trial, or group of crossings, and its amplitude.
A row of a single amplitude has the doubts about the fit to all of its trial, too: a clipped or late
torque concerns everything from the same samples.
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
"""Column of `walking_summary.csv`: the doubts about a row's group. Unlike `DOUBTS` they leave no
row out of a mean: a group's estimate is one of all its crossings."""
WIDE_ESTIMATES = "wide_estimates"  # column: estimates whose intervals are wider than needed
RESULTS = "results"  # column: sources that are properties of the device, as friction
JOINED_COLUMNS = {
    DOUBTS: pl.List(DOUBT_TYPE),
    WIDE_ESTIMATES: pl.List(pl.String),
    RESULTS: pl.List(pl.String),
}
SUMMARISED_GROUPS = "walking_summary"
JUDGED_AS: Mapping[str, str] = {**DOUBTS_OF, SUMMARISED_GROUPS: "walking_groups"}
"""By table whose rows are not judged for themselves, the table with the findings about them."""
WHY_NO_FIT = "reason"  # column: why a row has no fit; null in rows with a fit


def judged_as(table: str) -> str:
    """The table with the findings about the rows of a table."""
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
        The table's name, whose findings count; empty: all count.
    """
    of_fits: dict[tuple[str, float | None], list[Finding]] = {}
    for finding in findings:
        if not name or finding.table == judged_as(name):
            of_fits.setdefault((finding.subject, finding.amplitude_deg), []).append(finding)
    of_rows = []
    for row in table.select(pl.col("^(trial|group|amplitude_deg)$")).to_dicts():
        trial, amplitude_deg = fit_of(row)
        of_row = list(of_fits.get((trial, amplitude_deg), ()))
        if amplitude_deg is not None:
            of_whole = of_fits.get((trial, None), ())
            of_row += [finding for finding in of_whole if finding.grade is Grade.DOUBTS]
        of_rows.append(of_row)
    return of_rows


# Typed columns


def with_findings(table: pl.DataFrame, findings: RowFindings) -> pl.DataFrame:
    """A table with the columns of `JOINED_COLUMNS`, from the findings about each of its rows."""
    columns: dict[str, list[Any]] = {
        DOUBTS: [doubt_cells(of_row) for of_row in findings],
        WIDE_ESTIMATES: [wide_estimates(of_row) for of_row in findings],
        RESULTS: [results_in(of_row) for of_row in findings],
    }
    return table.with_columns(
        pl.Series(name, cells, dtype=JOINED_COLUMNS[name]) for name, cells in columns.items()
    )


def doubt_cells(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """The doubts among some findings, each once, as cells of `DOUBTS`."""
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
    of_rows = with_findings(table, findings_of_rows(table, findings, name))
    return of_rows.rename({DOUBTS: GROUP_DOUBTS}) if name == SUMMARISED_GROUPS else of_rows


def read_joined(tables: Mapping[str, Path], findings: Sequence[Finding]) -> dict[str, pl.DataFrame]:
    """Read result tables by name, with the findings on their rows (`joined`)."""
    return {name: joined(read_table(path), name, findings) for name, path in tables.items()}


# Text columns


def with_texts(table: pl.DataFrame, findings: RowFindings, name: str) -> pl.DataFrame:
    """The table `name` with the texts about each row that the dictionary describes: `doubtful`, the
    doubts; `remarks`, what else was found and what could not be checked; and `K_verdict` and the
    like. Null: nothing was found, and in a row without a fit."""
    described = described_tables_by_name()[name].columns
    texts: list[dict[str, str | None]] = []
    for row, of_row in zip(table.to_dicts(), findings, strict=True):
        if row.get(WHY_NO_FIT) is not None:
            texts.append({})
            continue
        doubts = [finding for finding in of_row if finding.grade is Grade.DOUBTS]
        others = [finding for finding in of_row if finding.grade is not Grade.DOUBTS]
        verdicts = {f"{symbol}_verdict": text for symbol, text in verdict_texts(of_row).items()}
        texts.append({"doubtful": cell_text(doubts), **verdicts, "remarks": cell_text(others)})
    names = ["doubtful", *(f"{symbol}_verdict" for symbol in QUANTITIES), "remarks"]
    schema = {column: pl.String for column in names if column in described or column == "doubtful"}
    return table.with_columns(pl.DataFrame(texts, schema=schema).get_columns())
