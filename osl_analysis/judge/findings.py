# SPDX-License-Identifier: Apache-2.0
"""A judgement on a trial or a fit as a value. Tables, summary, page and tests are views of it."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from osl_analysis.base.table import not_analysed, read_table
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.judge.known_findings import Texts, known_finding
from osl_analysis.judge.rules import AnyRow, Beyond, Grade, cell_number


@dataclass(frozen=True)
class Finding:
    """One thing that was found in a row of a table: a cause of doubt, something that could not be
    checked, or a remark.

    Attributes
    ----------
    source
        What was found, the value of a `Source`: a source of the budget, or what a check of the
        recording or a rule finds.
    table
        The name of the table.
    subject
        The trial or the group.
    grade
        Its verdict: what it does to the trial or fit.
    evidence
        Numbers beyond their limits; none for what could not be checked.
    amplitude_deg
        That of the row; None: all.
    estimates
        Those that it is about; none: all of the fit.
    says, size, remedy
        What is wrong and what it does to the results; how large it is in this row, empty if not
        known; and what to do, empty for nothing. `worded` fills in what is empty.

    Examples
    --------
    >>> fit = osl.fit(trial)
    >>> [finding.source for finding in fit.findings[-1] if finding.grade == "doubts"]
    []
    """

    source: str
    table: str = ""
    subject: str = ""
    grade: Grade = Grade.DOUBTS
    evidence: tuple[Beyond, ...] = ()
    amplitude_deg: float | None = None
    estimates: tuple[str, ...] = ()
    says: Texts = ""
    size: str = ""
    remedy: Texts = ""

    @property
    def cause(self) -> str:
        """What users call it in every table and on the page."""
        return known_finding(self.source).title

    @property
    def excess(self) -> float:
        """By how much its first number is beyond its limit; 0 without any."""
        return self.evidence[0].excess if self.evidence else 0.0

    @property
    def is_result(self) -> bool:
        """Whether it is a property of the device, which is then not of second order."""
        return self.grade is not Grade.UNCHECKED and known_finding(self.source).is_result

    @property
    def is_of_part(self) -> bool:
        """Whether it concerns a single amplitude: a doubt then makes the trial doubtful in part."""
        return self.amplitude_deg is not None


def findings_frame(findings: Iterable[Finding]) -> pl.DataFrame:
    """`findings.csv`: a row per number of evidence; rows of one finding share the number
    `finding`."""
    rows = []
    columns = described_tables_by_name()["findings"].columns
    for number, finding in enumerate(findings, start=1):
        shared = {
            **vars(finding),
            "trial": finding.subject,
            "name": finding.source,
            "cause": finding.cause,
            "evidence": None,
        }
        numbers = [{**vars(beyond), "evidence": beyond.column} for beyond in finding.evidence]
        for of_number in numbers or [{}]:
            row = {**shared, **of_number, "finding": number}
            rows.append({name: row.get(name) for name in columns})
    table = table_of(rows, "findings").drop("joint", "side", "data", strict=False)
    return table.with_columns(pl.col("says", "size", "remedy").replace("", None))


def read_findings(path: Path) -> list[Finding]:
    """The findings of `findings.csv`; none where it was refused or is not there."""
    if not path.is_file() or not_analysed(path):
        return []
    findings = []
    for rows in read_table(path, ["finding"]).partition_by("finding"):
        numbers = rows.drop_nulls("evidence").select("evidence", "value", "limit")
        row = rows.row(0, named=True)
        findings.append(
            Finding(
                source=row["name"],
                table=row["table"],
                subject=row["trial"],
                grade=Grade(row["grade"]),
                evidence=tuple(Beyond(*cells) for cells in numbers.rows()),
                amplitude_deg=row["amplitude_deg"],
                says=row["says"] or "",
                size=row["size"] or "",
                remedy=row["remedy"] or "",
            )
        )
    return findings


def fit_of(row: AnyRow) -> tuple[str, float | None]:
    """What tells the fit of a row: trial, or group of crossings, and amplitude [deg]."""
    subjects = [row[key] for key in ("trial", "group") if row.get(key) is not None]
    return str(subjects[0]) if subjects else "", cell_number(row, "amplitude_deg")
