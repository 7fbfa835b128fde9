# SPDX-License-Identifier: Apache-2.0
"""Write findings in words, for people.

`words.yaml` has the sentences; a name in braces stands for a number of the row. A sentence is left
out where the row lacks one of its numbers. Words decide nothing, and no code reads them.

Example: `finding_text(worded(finding, row))`.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from string import Formatter
from typing import Any

from osl_analysis.judge.findings import WIDE_INTERVAL, Finding
from osl_analysis.judge.known_findings import Texts, known_finding
from osl_analysis.judge.rules import AnyRow, Beyond, Grade
from osl_analysis.stats.budget import CLEAR, QUANTITIES, WIDE
from osl_analysis.stats.doubts import Doubt
from osl_analysis.stats.rounding import significant


def worded(finding: Finding, row: AnyRow) -> Finding:
    """The finding with the words of `words.yaml` in fields that are empty; `row` has its
    numbers."""
    kind = known_finding(finding.source)
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
    """The size of a finding in words, by the numbers of the row."""
    details = [
        filled(number.rule.says, cells_of(row, number))
        for number in finding.evidence
        if number.rule and number.source == finding.source
    ]
    first, *further = [*dict.fromkeys(filter(None, details)), ""]
    return ". ".join(filter(None, [first, *map(capital, further)]))


def sentence_of(says: Texts, size: str, remedy: Texts, cause: str = "") -> str:
    """`cause: what is wrong: how large. What to do`; parts that are empty are left out."""
    problem = ": ".join(filter(None, [cause, str(says), size]))
    return ". ".join(filter(None, [problem, str(remedy)]))


def finding_text(finding: Finding) -> str:
    """A finding in one sentence or two, with the numbers that decided."""
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
    """A number for sentences. `{x:~2}` shows two significant digits, `{x:~+2}` the sign as well,
    and `{x:~2*1e3}` multiplies by 1000 first."""

    def __format__(self, spec: str) -> str:
        if not spec.startswith("~"):
            return super().__format__(spec)
        digits, _, factor = spec.removeprefix("~").partition("*")
        value = self * float(factor or 1)
        text = significant(value, abs(int(digits)))
        return f"+{text}" if digits.startswith("+") and value > 0 else text


def cells_of(row: AnyRow, number: Beyond | None = None) -> dict[str, Any]:
    """The values of names in braces: the filled cells of a row, and the number of a finding."""
    cells: dict[str, Any] = {
        column: RoundedNumber(cell) if isinstance(cell, int | float) else cell
        for column, cell in row.items()
        if cell is not None
    }
    if number is not None:
        cells["column"] = number.column
        cells["value"] = significant(number.value, 3)
        cells["percent"] = f"{significant(100 * abs(number.value))} %"
        cells["unit"] = number.unit
    return cells


def filled(texts: Texts, cells: Mapping[str, Any]) -> str:
    """The first of some texts whose numbers are all known, with them; empty without one."""
    for text in [texts] if isinstance(texts, str) else texts:
        names = {name for _, name, _, _ in Formatter().parse(text) if name}
        if names <= cells.keys():
            return text.format(**cells)
    return ""


# Cells of tables

BETWEEN = "; "  # findings in a cell


def cell_text(findings: Iterable[Finding]) -> str | None:
    """Findings in one cell, as `K, B: torque path; not checked: fixture`; None without any."""
    texts = []
    for finding in findings:
        about = ""
        if finding.grade is Grade.DOUBTS or finding.source == WIDE_INTERVAL:
            about = ", ".join(finding.estimates)
        elif finding.grade is Grade.UNCHECKED:
            about = finding.grade
        texts.append(": ".join(filter(None, [about, finding.cause])))
    return BETWEEN.join(dict.fromkeys(texts)) or None


def verdict_texts(findings: Sequence[Finding]) -> dict[str, str]:
    """The verdicts on K, B and I in words: clear, wide, or the cause of the first doubt."""
    verdicts: dict[str, str] = dict.fromkeys(QUANTITIES, CLEAR)
    for symbol in QUANTITIES:
        about = [
            finding for finding in findings if not finding.estimates or symbol in finding.estimates
        ]
        doubts = [finding for finding in about if finding.grade is Grade.DOUBTS]
        if doubts:
            verdicts[symbol] = doubts[0].cause
        elif any(finding.source == WIDE_INTERVAL for finding in about):
            verdicts[symbol] = WIDE
    return verdicts


def doubts_text(doubts: Iterable[Doubt]) -> str:
    """The doubts that were joined to a row, as one text; empty without any."""
    findings = [Finding(doubt["source"], estimates=tuple(doubt["estimates"])) for doubt in doubts]
    return cell_text(findings) or ""
