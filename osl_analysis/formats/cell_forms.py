# SPDX-License-Identifier: Apache-2.0
"""Find the numbers in cells that have text around them, always the same.

Examples: `np.float64(0.1)`, `0.1 Nm`, `angle:0.1`, and `09:04:50.200 -> 0.1,2` of Arduino's serial
monitor. A pattern counts only where every cell of a column has the same text before and behind its
number.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mode

from osl_analysis.base.units import is_unit
from osl_analysis.formats.text_cells import (
    FIRST_LINES,
    NUMBER,
    TextRow,
    delimiter_of,
    is_value,
    numbered,
)

FORM = re.compile(
    rf"(?P<before>(?:.*[^\d.+\-eE])?)(?P<number>{NUMBER.pattern})(?P<behind>[^\d]*)", re.ASCII
)
# a digit in the text before a number, unless a bracket or an equals sign stands between: `1_` of
# `1_000.5` is part of the number, `np.float64(` is not
SEPARATES_THOUSANDS = re.compile(r"\d[^(\[{:=]*$")
SERIAL_MONITOR = re.compile(rb"(?m)^(\d{2}:\d{2}:\d{2}\.\d{3}) -> ")
"""What the serial monitor of Arduino's IDE writes before each line where time stamps are shown."""


@dataclass(frozen=True)
class Form:
    """The text around the numbers of a column."""

    place: int  # of the column, from 0
    before: str
    behind: str
    example: str  # a cell as it stands in the file

    @property
    def name(self) -> str:
        """The name that stands before each number, as `angle` of `angle:0.1`; empty without one."""
        match = re.fullmatch(r"\s*(\w[^:=]*?)\s*[:=]\s*", self.before)
        return match[1] if match else ""

    @property
    def unit(self) -> str:
        """The unit that stands behind each number; empty without one."""
        behind = self.behind.strip(" ,;)]}'\"")
        return behind if is_unit(behind) else ""

    def number_in(self, cell: str) -> str:
        """The number of a cell that has this form; else the cell itself."""
        match = FORM.fullmatch(cell)
        if match and (match["before"], match["behind"]) == (self.before, self.behind):
            return match["number"]
        return cell

    @property
    def remark(self) -> str:
        """What is read of the column, in words."""
        return (
            f"column {self.place + 1}: of each cell the number alone is read, as"
            f" {self.number_in(self.example)} of '{self.example}'"
        )


def forms_of(rows: Sequence[TextRow]) -> list[Form]:
    """Find the columns whose cells have one form in most rows, and are no numbers or times."""
    sample = [row.cells for row in rows[:FIRST_LINES]]
    if len(sample) < 2:
        return []
    width = mode(map(len, sample))
    typical = [cells for cells in sample if len(cells) == width]
    typical = typical[len(typical) // 2 :]  # the first rows may be a header
    forms = []
    for place in range(width):
        cells = [row[place] for row in typical if row[place]]
        matches = [FORM.fullmatch(cell) for cell in cells]
        texts = {(match["before"], match["behind"]) for match in matches if match}
        numbers = {match["number"] for match in matches if match}
        is_of_numbers = any(map(is_value, cells))
        if all(matches) and len(texts) == 1 and len(numbers) > 1 and not is_of_numbers:
            ((before, behind),) = texts
            if SEPARATES_THOUSANDS.search(before):
                continue
            forms.append(Form(place, before, behind, cells[0]))
    return forms


def plain_rows(rows: Sequence[TextRow], forms: Sequence[Form]) -> list[TextRow]:
    """The rows with the number alone in each cell that has its column's form."""
    plain = []
    for number, cells in rows:
        numbers = list(cells)
        for form in forms:
            if form.place < len(numbers):
                numbers[form.place] = form.number_in(numbers[form.place])
        plain.append(TextRow(number, numbers))
    return plain


def without_arrows(data: bytes) -> bytes:
    """The text of a serial monitor with the sign between its cells in place of the arrow behind the
    time; other text as it is."""
    if not SERIAL_MONITOR.match(data):
        return data
    first_lines = b"\n".join(data.split(b"\n", FIRST_LINES)[:FIRST_LINES])
    sign = delimiter_of(numbered(SERIAL_MONITOR.sub(b"", first_lines))).encode()
    return SERIAL_MONITOR.sub(rb"\1" + sign, data)
