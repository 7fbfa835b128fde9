# SPDX-License-Identifier: Apache-2.0
"""A judgement on a trial or a fit as a value. Tables, summary, page and tests are views of it."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from string import Formatter
from typing import Any

import polars as pl

from osl_analysis.base.table import not_analysed, read_table
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.judge.known_findings import FINDINGS, Texts, known_finding
from osl_analysis.judge.rules import AnyRow, Beyond, Grade, cell_number
from osl_analysis.stats.rounding import significant


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
    estimates
        Those that it is about; none: all of the fit.
    says, size, remedy
        What is wrong and what it does to the results; how large it is in this row, empty if not
        known; and what to do, empty for nothing. `worded` fills in what is empty.

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
    estimates: tuple[str, ...] = ()
    says: Texts = ""
    size: str = ""
    remedy: Texts = ""

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
        return self.grade is not Grade.UNCHECKED and known_finding(self.name).is_result

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
                name=row["name"],
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


# The words of findings. Nothing here decides whether something is a doubt. The sentences
# stand in `findings.yaml`, with names in braces for numbers. A sentence whose numbers the
# row does not have is left out.


def worded(finding: Finding, row: AnyRow) -> Finding:
    """A finding with its words, as far as it has none of its own.

    Parameters
    ----------
    finding : Finding
    row : AnyRow
        The row of its table that it is about, or other numbers that its sentences show.
    """
    if finding.name not in FINDINGS:  # a limit on a column without a rule
        return replace(finding, says=evidence_text(finding))
    kind = known_finding(finding.name)
    says, remedy = kind.says, kind.remedy
    if finding.grade is Grade.UNCHECKED:
        says, remedy = kind.unseen or says, kind.unseen_remedy or remedy
    cells = cells_of(row)
    return replace(
        finding,
        says=filled(finding.says or says, cells),
        size=finding.size or size_text(finding, row),
        remedy=capital(filled(finding.remedy or remedy, cells)),
    )


def size_text(finding: Finding, row: AnyRow) -> str:
    """How large a cause is in this row, by its numbers."""
    details = [
        filled(number.rule.says, cells_of(row, number))
        for number in finding.evidence
        if number.finding == finding.name
    ]
    first, *others = [*dict.fromkeys(filter(None, details)), ""]
    return ". ".join(filter(None, [first, *map(capital, others)]))


def sentence_of(says: Texts, size: str, remedy: Texts, cause: str = "") -> str:
    """`cause: what is wrong: how large. What to do`, without the parts that are empty."""
    problem = ": ".join(filter(None, [cause, str(says), size]))
    return ". ".join(filter(None, [problem, str(remedy)]))


def finding_text(finding: Finding) -> str:
    """A finding in one sentence or two, with the numbers that decided."""
    if finding.name not in FINDINGS:
        return str(finding.says)
    sentence = sentence_of(finding.says, finding.size, finding.remedy, finding.cause)
    return f"{sentence} [{evidence_text(finding)}]" if finding.evidence else sentence


def evidence_text(finding: Finding) -> str:
    """The numbers that decided, each with its limit."""
    texts = []
    for number in finding.evidence:
        text = f"{number.column} {number.value:.3g} is {number.side} {number.limit:g}"
        if number.side == "near":
            text = f"{number.column} {number.value:.3g} is close to it"
        texts.append(text if number.side != "nan" else f"{number.column} is not a number")
    return ", ".join(texts)


def capital(text: str) -> str:
    """A text that begins with a capital letter; a symbol, as `f_C`, keeps its case."""
    return text if re.match(r"\w_", text) else text[:1].upper() + text[1:]


class RoundedNumber(float):
    """A number shown with some significant digits, times a factor: `~2*1e3`, `~+2` with its
    sign."""

    def __format__(self, spec: str) -> str:
        if not spec.startswith("~"):
            return super().__format__(spec)
        digits, _, factor = spec.removeprefix("~").partition("*")
        value = self * float(factor or 1)
        text = significant(value, abs(int(digits)))
        return f"+{text}" if digits.startswith("+") and value > 0 else text


def cells_of(row: AnyRow, number: Beyond | None = None) -> dict[str, Any]:
    """What names in braces stand for: the cells of a row that are filled, by column, and what is
    said of the number that a finding is about."""
    cells: dict[str, Any] = {
        column: RoundedNumber(cell) if isinstance(cell, int | float) else cell
        for column, cell in row.items()
        if cell is not None
    }
    if number is not None:
        cells["value"] = significant(number.value, 3)
        cells["percent"] = f"{significant(100 * abs(number.value))} %"
        cells["unit"] = number.unit
    return cells


def filled(texts: Texts, cells: Mapping[str, Any]) -> str:
    """The first of some texts of which all numbers are known, with them; empty without one."""
    for text in [texts] if isinstance(texts, str) else texts:
        names = {name for _, name, _, _ in Formatter().parse(text) if name}
        if names <= cells.keys():
            return text.format(**cells)
    return ""
