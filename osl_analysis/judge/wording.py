# SPDX-License-Identifier: Apache-2.0
"""The words of findings, for people.

The sentences stand in `words.yaml`, with names in braces for numbers of the row. A sentence
whose numbers the row does not have is left out. Nothing here decides, and nothing that decides
reads what is written here.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from string import Formatter
from typing import Any

from osl_analysis.judge.findings import Finding
from osl_analysis.judge.known_findings import Texts, known_finding
from osl_analysis.judge.rules import AnyRow, Beyond, Grade
from osl_analysis.stats.rounding import significant


def worded(finding: Finding, row: AnyRow) -> Finding:
    """A finding with its words, as far as it has none of its own.

    Parameters
    ----------
    finding : Finding
    row : AnyRow
        The row of its table that it is about, or other numbers that its sentences show.
    """
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
    """How large a cause is in this row, by its numbers."""
    details = [
        filled(number.rule.says, cells_of(row, number))
        for number in finding.evidence
        if number.rule and number.finding == finding.source
    ]
    first, *others = [*dict.fromkeys(filter(None, details)), ""]
    return ". ".join(filter(None, [first, *map(capital, others)]))


def sentence_of(says: Texts, size: str, remedy: Texts, cause: str = "") -> str:
    """`cause: what is wrong: how large. What to do`, without the parts that are empty."""
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
        cells["column"] = number.column
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
