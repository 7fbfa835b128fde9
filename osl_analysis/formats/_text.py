"""Files of text: encoding, lines, and the sign between cells."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats._cells import (
    cell_numbers,
    is_last_whole,
    is_value,
    most_common_width,
)

# bytes that no text has; byte 26 is allowed, it ends files of DOS
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x19]")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # its marks
MINUS = "\u2212"  # a minus sign that is no hyphen
SAMPLE_LINES = 300  # lines by which the sign between cells is found
FEWEST_ROWS = 8  # lines of numbers that make a text without an ending a table
LEAST_SCORE = 0.8  # share of them that are rows of numbers


class Line(NamedTuple):
    """A line of a file."""

    number: int  # counted from 1
    text: str


class Row(NamedTuple):
    """The cells of a line."""

    number: int  # of the line
    cells: list[str]


class Text(NamedTuple):
    """The text of a file, in UTF-8 with Unix line breaks."""

    data: bytes
    is_ended: bool  # whether its last line has a break


def is_text(begin: bytes) -> bool:
    """Tell whether a file that begins so is text, by its first line: later zero bytes may come
    from a loss of power."""
    if begin.startswith(UTF_16):
        return True
    return CONTROL.search(begin.partition(b"\n")[0]) is None


def decoded(data: bytes) -> str:
    """Decode text in UTF-8, UTF-16 with its mark, or else the western code page of Windows."""
    try:
        return in_utf8(data).decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def in_utf8(data: bytes) -> bytes:
    """Give text without a byte order mark; UTF-16 becomes UTF-8."""
    if data.startswith(UTF_16):
        data = data.decode("utf-16", errors="replace").encode()
    return data.removeprefix(b"\xef\xbb\xbf")


def read_text(path: Path) -> Text:
    """Read the text of a file.

    Raises
    ------
    InputError
        It holds zero bytes.
    """
    data = path.read_bytes()
    if not data.isascii():
        data = decoded(data).encode().replace(MINUS.encode(), b"-")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = data.rstrip(b"\x1a")
    zero = data.find(b"\0")
    if zero >= 0:
        line = data.count(b"\n", 0, zero) + 1
        raise InputError(
            f"line {line} holds zero bytes, as a loss of power leaves them; delete the file from"
            " there on, or name a text file"
        )
    return Text(data, data.rstrip(b" \t").endswith(b"\n"))


def numbered(data: bytes, first: int = 1) -> list[Line]:
    """The lines that are not blank. `first` is the number of the first line."""
    lines = data.decode(errors="replace").split("\n")
    return [Line(number, text) for number, text in enumerate(lines, start=first) if text.strip()]


def delimiter_of(lines: Sequence[Line]) -> str:
    """Find the sign between cells.

    It is the one of tab, `;`, `|`, `,` and blank with which most cells are numbers, times or
    missing, and most lines have as many. Without numbers it is the first of tab, `;` and `|` that
    every line has, or a blank if no line has a comma.
    """
    sample = [line.text.strip() for line in lines[:SAMPLE_LINES]]
    scores = {sign: _score(sample, sign) for sign in "\t;|, "}
    scores[" "] *= 0.98  # a blank also splits at tabs
    best = max(scores, key=lambda sign: scores[sign])
    if scores[best] > 0:
        return best
    for sign in "\t;|":
        if all(sign in text for text in sample):
            return sign
    are_spaced = all(" " in text and "," not in text for text in sample)
    return " " if are_spaced else ","


def _score(sample: Sequence[str], sign: str) -> float:
    """Share of lines with the most frequent number of cells, times that of values among these."""
    rows = [text.split(None if sign == " " else sign) for text in sample]
    width = most_common_width(rows)
    if width < 2:
        return 0.0
    typical = [row for row in rows if len(row) == width]
    filled = [cell.strip(' "') for row in typical for cell in row if cell.strip(' "')]
    return len(typical) / len(rows) * sum(map(is_value, filled)) / max(1, len(filled))


def begins_with_rows(begin: bytes) -> bool:
    """Tell whether most of the last lines in the beginning of a text are rows of two or more
    numbers or times."""
    if not is_text(begin):
        return False
    lines = numbered(decoded(begin).encode().rpartition(b"\n")[0])[-20:]
    score = _score([line.text for line in lines], delimiter_of(lines))
    return len(lines) > FEWEST_ROWS and score > LEAST_SCORE


def split_rows(lines: Sequence[Line], delimiter: str) -> list[Row]:
    """Split lines into stripped cells; lines of empty cells are left out.

    Raises
    ------
    InputError
        A quote is not closed on its line, or a cell is too long.
    """
    rows: list[Row] = []
    for number, text in lines:
        if delimiter == " ":
            text = re.sub(r"\s+", " ", text.strip())
        try:
            (cells,) = csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True)
        except csv.Error as error:
            raise InputError(f"line {number}: {error}; repair its quotes or its cells") from error
        stripped = [cell.strip() for cell in cells]
        if any(stripped):
            rows.append(Row(number, stripped))
    return rows


def unpadded(cells: Sequence[str], width: int = 0) -> list[str]:
    """Leave out empty cells at the end, beyond a width: some programs pad lines with them."""
    last = len(cells)
    while last > width and not cells[last - 1]:
        last -= 1
    return list(cells[:last])


def check_last_line(is_ended: bool, rows: Sequence[Row]) -> None:
    """Refuse a file of which nothing tells that its last number is whole."""
    last_cells = [row.cells[-1] for row in rows]
    # where all are empty, a tab ends every line
    if any(last_cells) and not is_ended and not is_last_whole(last_cells):
        raise InputError(
            f"line {rows[-1].number}, the last one, has no line break and may be cut off within its"
            " last number; export it again, or end the line where it is whole"
        )


def column_of(
    rows: Sequence[Row], place: int, missing: Sequence[str], title: str, decimal: str = "."
) -> NDArray[np.float64]:
    """Read one column of rows as numbers, (rows,), NaN where a cell is one of the missing words or
    a row is too short.

    Raises
    ------
    InputError
        A cell is no number.
    """
    cells = [row.cells[place] if place < len(row.cells) else "" for row in rows]
    values, unread = cell_numbers(pl.Series(cells, dtype=pl.String), missing, decimal)
    if unread.size:
        first = unread[0]
        raise InputError(
            f"line {rows[first].number}, {title}: '{cells[first][:40]}' is not a number; export it"
            " again as plain numbers"
        )
    return values
