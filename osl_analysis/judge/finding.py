# SPDX-License-Identifier: Apache-2.0
"""A judgement on a trial or a fit as a value. Tables, summary, page and tests are views of it."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

import polars as pl

from osl_analysis.base.table import not_analysed, read_table
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.judge.known_findings import Rule, known_finding

AnyRow = Mapping[str, object]  # a row of a result table


class Grade(StrEnum):
    """What a finding does to its trial or fit."""

    EXCLUDES = "excludes"  # it is in no other table and in no figure
    DOUBTS = "doubts"
    UNCHECKED = "not checked"
    NOTES = "notes"  # checked, and worth knowing


@dataclass(frozen=True)
class Beyond:
    """A number beyond its limit, as evidence."""

    column: str
    value: float  # in the unit of the column
    limit: float
    # above or below the limit, near a factor between units, or nan; not in `findings.csv`
    side: str = ""
    finding: str = ""  # what it is evidence of
    unit: str = ""  # the factor between units that it may be, in words
    rule: Rule = field(default=Rule(""), compare=False)  # with the words for it

    @property
    def excess(self) -> float:
        """Factor by which the number exceeds its limit: infinite beyond 0, and of NaN."""
        small, large = sorted([abs(self.value), abs(self.limit)])
        return large / small if small > 0 else math.inf


@dataclass(frozen=True)
class Finding:
    """One thing that was found in a row of a table: a cause of doubt, something that could not be
    checked, or a remark.

    Attributes
    ----------
    name
        Its short name, a key of `findings.yaml`; a column that has none there is its own.
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
    rule
        That of what is missing, which may have words of its own; None: its evidence decides.
    size
        How large it is, in words, where a budget tells it.

    Examples
    --------
    >>> fit = osl.fit(trial)
    >>> [finding.name for finding in fit.findings[-1] if finding.grade == "doubts"]
    []
    """

    name: str
    table: str = ""
    subject: str = ""
    grade: Grade = Grade.DOUBTS
    evidence: tuple[Beyond, ...] = ()
    amplitude_deg: float | None = None
    rule: Rule | None = None
    size: str = ""

    @property
    def cause(self) -> str:
        """What users call it in every table and on the page."""
        return known_finding(self.name).title

    @property
    def excess(self) -> float:
        """By how much its first number is beyond its limit; 0 without any."""
        return self.evidence[0].excess if self.evidence else 0.0

    @property
    def is_result(self) -> bool:
        """Whether it is a property of the device, which is then not of second order."""
        return known_finding(self.name).is_result

    @property
    def is_of_part(self) -> bool:
        """Whether it concerns a single amplitude: a doubt then makes the trial doubtful in part."""
        return self.amplitude_deg is not None


class Words(NamedTuple):
    """What a finding says to a reader."""

    says: str  # what is wrong, and what it does to the results
    size: str  # how large it is in this row; empty if not known
    remedy: str  # what to do; empty for nothing


@dataclass(frozen=True)
class WordedFinding:
    """A finding with its words, as `findings.csv` has it."""

    finding: Finding
    words: Words


def findings_frame(findings: Iterable[WordedFinding]) -> pl.DataFrame:
    """`findings.csv` from findings with their words: a row per number of evidence; rows of one
    finding share the number `finding`."""
    rows = []
    columns = described_tables_by_name()["findings"].columns
    for number, worded in enumerate(findings, start=1):
        finding = worded.finding
        shared = {
            **vars(finding),
            **worded.words._asdict(),
            "trial": finding.subject,
            "cause": finding.cause,
            "evidence": None,
        }
        numbers = [{**vars(beyond), "evidence": beyond.column} for beyond in finding.evidence]
        for of_number in numbers or [{}]:
            row = {**shared, **of_number, "finding": number}
            rows.append({name: row.get(name) for name in columns})
    table = table_of(rows, "findings").drop("joint", "side", "data", strict=False)
    return table.with_columns(pl.col("says", "size", "remedy").replace("", None))


def read_findings(path: Path) -> list[WordedFinding]:
    """The findings of `findings.csv`; none where it was refused or is not there."""
    if not path.is_file() or not_analysed(path):
        return []
    return findings_of_frame(read_table(path, ["finding"]))


def findings_of_frame(frame: pl.DataFrame) -> list[WordedFinding]:
    """The findings of a table as `findings_frame` makes it."""
    findings = []
    for rows in frame.partition_by("finding"):
        numbers = rows.drop_nulls("evidence").select("evidence", "value", "limit")
        row = rows.row(0, named=True)
        finding = Finding(
            name=row["name"],
            table=row["table"],
            subject=row["trial"],
            grade=Grade(row["grade"]),
            evidence=tuple(Beyond(*cells) for cells in numbers.rows()),
            amplitude_deg=row["amplitude_deg"],
        )
        words = Words(*(row[part] or "" for part in Words._fields))
        findings.append(WordedFinding(finding, words))
    return findings


def cell_number(row: AnyRow, name: str) -> float | None:
    """The number in a column of a row; None for a text, a null, or a column that is not there."""
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else None


def subject_of(row: AnyRow) -> str:
    """The trial, or the group, of a row."""
    for key in ("trial", "group"):
        if row.get(key) is not None:
            return str(row[key])
    return ""
