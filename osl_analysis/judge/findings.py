# SPDX-License-Identifier: Apache-2.0
"""Findings on trials and fits as values, and the table of findings.

Each finding is made once (`judge/judging.py`, `judge/agreement.py`) and stored as Parquet. All code
that needs to know whether an estimate is doubtful joins this table by its columns
(`judge/joining.py`). `findings.csv` and all texts are views for people.

Example: `findings_in(findings_table([Finding(Source.FRICTION, "impedance", "a")]))`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.base.table import not_analysed
from osl_analysis.judge.known_findings import Texts, known_finding
from osl_analysis.judge.rules import AnyRow, Beyond, Grade, cell_number
from osl_analysis.stats.sources import Source

WIDE_INTERVAL = Source.WIDE_INTERVAL  # source of a remark: an interval is wider than is needed


@dataclass(frozen=True)
class Finding:
    """A finding on a row of a table: a cause of doubt, a check that was not possible, or a remark.

    Attributes
    ----------
    source
        The cause: a source of the budget, or what a check of the recording or a rule finds.
    table
        The name of the table.
    subject
        The trial or the group.
    grade
        The consequence for the trial or fit.
    evidence
        Numbers beyond their limits; none for what could not be checked.
    amplitude_deg
        The amplitude of the row [deg]; None: all amplitudes.
    estimates
        The estimates that it concerns; none: the whole fit.
    joint, side
        Joint and side of the trial, as the sheet states them.
    says
        What is wrong, and what it does to the results.
    size
        How large it is in this row; empty if not known.
    remedy
        What to do; empty for nothing. `worded` fills in what is empty.

    Examples
    --------
    >>> fit = osl.fit(trial)
    >>> [finding.source for finding in fit.findings[-1] if finding.grade == "doubts"]
    []
    """

    source: Source
    table: str = ""
    subject: str = ""
    grade: Grade = Grade.DOUBTS
    evidence: tuple[Beyond, ...] = ()
    amplitude_deg: float | None = None
    estimates: tuple[str, ...] = ()
    joint: str | None = None
    side: str | None = None
    says: Texts = ""
    size: str = ""
    remedy: Texts = ""

    @property
    def cause(self) -> str:
        """Its name in every table and on the page."""
        return known_finding(self.source).title

    @property
    def excess(self) -> float:
        """How far its first number is beyond its limit; 0 without a number."""
        return self.evidence[0].excess if self.evidence else 0.0

    @property
    def is_result(self) -> bool:
        """Whether it is a property of a device that is not of second order."""
        return self.grade is not Grade.UNCHECKED and known_finding(self.source).is_result

    @property
    def is_of_part(self) -> bool:
        """Whether it concerns a single amplitude: a doubt then makes the trial doubtful in part."""
        return self.amplitude_deg is not None


# The table of findings

GRADES = pl.Enum([grade.value for grade in Grade])
SOURCES = pl.Enum([source.value for source in Source])  # an unknown name is refused
COLUMNS: Mapping[str, Any] = {
    "finding": pl.Int64,  # its number; a finding has a row for each of its numbers, or one
    "table": pl.String,
    "trial": pl.String,  # or group of crossings
    "joint": pl.String,
    "side": pl.String,
    "amplitude_deg": pl.Float64,  # null: all of the trial
    "source": SOURCES,
    "grade": GRADES,
    "estimates": pl.List(pl.String),  # that it concerns; empty: all of the fit
    "evidence": pl.String,  # the column, or the check, whose number is beyond its limit
    "value": pl.Float64,
    "limit": pl.Float64,
    "probability": pl.Float64,  # of a weighed fault
    "cause": pl.String,  # the title of its source, and three sentences, for people
    "says": pl.String,
    "size": pl.String,
    "remedy": pl.String,
}
"""The columns of `findings.parquet` with their types. `dictionary/campaign.yaml` explains them."""


def findings_table(findings: Iterable[Finding]) -> pl.DataFrame:
    """Findings as a table of `COLUMNS`, with a row for each number of evidence."""
    rows: list[dict[str, Any]] = []
    for number, finding in enumerate(findings, start=1):
        shared = {
            "finding": number,
            "table": finding.table,
            "trial": finding.subject,
            "joint": finding.joint,
            "side": finding.side,
            "amplitude_deg": finding.amplitude_deg,
            "source": Source(finding.source).value,
            "grade": finding.grade.value,
            "estimates": list(finding.estimates),
            "cause": finding.cause,
            "says": str(finding.says) or None,
            "size": finding.size or None,
            "remedy": str(finding.remedy) or None,
        }
        for beyond in finding.evidence:
            number_cells = {
                "evidence": beyond.column,
                "value": beyond.value,
                "limit": beyond.limit,
                "probability": beyond.probability,
            }
            rows.append({**shared, **number_cells})
        if not finding.evidence:
            rows.append(shared)
    return pl.DataFrame(rows, schema=COLUMNS)


def findings_in(table: pl.DataFrame) -> list[Finding]:
    """The findings of a table of `COLUMNS`."""
    findings = []
    for rows in table.partition_by("finding", maintain_order=True):
        row = rows.row(0, named=True)
        source = Source(row["source"])
        evidence = rows.drop_nulls("evidence")
        numbers = evidence.select("evidence", "value", "limit", "probability").rows()
        findings.append(
            Finding(
                source=source,
                table=row["table"],
                subject=row["trial"],
                joint=row["joint"],
                side=row["side"],
                grade=Grade(row["grade"]),
                evidence=tuple(
                    Beyond(column, value, limit, source, probability=probability)
                    for column, value, limit, probability in numbers
                ),
                amplitude_deg=row["amplitude_deg"],
                estimates=tuple(row["estimates"]),
                says=row["says"] or "",
                size=row["size"] or "",
                remedy=row["remedy"] or "",
            )
        )
    return findings


def read_findings(paths: Iterable[Path]) -> list[Finding]:
    """The findings in some Parquet files, in their order. A refused file has none."""
    findings = []
    for path in paths:
        if not not_analysed(path):
            # a folder of results may have signs in its name that a pattern would have
            findings += findings_in(pl.read_parquet(path, glob=False))
    return findings


def view_of(table: pl.DataFrame) -> pl.DataFrame:
    """A table of findings as CSV can hold it: the estimates of a finding are one text."""
    estimates = pl.col("estimates").list.join(", ").replace("", None)
    return table.with_columns(estimates, pl.col("grade", "source").cast(pl.String))


def fit_of(row: AnyRow) -> tuple[str, float | None]:
    """The key of a row's fit: its trial or group of crossings, and its amplitude [deg]."""
    subjects = [row[key] for key in ("trial", "group") if row.get(key) is not None]
    return str(subjects[0]) if subjects else "", cell_number(row, "amplitude_deg")
