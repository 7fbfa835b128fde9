"""Text files to rows of cells, and cells to numbers, for any encoding, delimiter and decimal sign."""

import csv
import re
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

DELIMITERS = {"tab": "\t", "space": " "}
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a]")  # bytes that no text has
UTF_16_MARKS = (b"\xff\xfe", b"\xfe\xff")
SNIFFED = 50  # lines from which the delimiter is inferred
MOST_CELLS = 16384
"""Most cells of a line, the most columns of a spreadsheet. A file with more has lost its line breaks."""
UNIT = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))", re.DOTALL)

Lines = list[tuple[int, str]]  # number in the file, counted from 1, and text
Rows = list[tuple[int, list[str]]]


def read_lines(path: Path) -> Lines:
    """The lines of a file in UTF-8, UTF-16 with its mark, or else Windows' western code page, without blank ones.

    Raises
    ------
    InputError
        The file holds zero bytes and is therefore not text.
    """
    return lines_of(path, path.read_bytes())


def lines_of(path: Path, data: bytes) -> Lines:
    """The lines of a file's bytes; as `read_lines`."""
    text = decoded_text(data)
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise InputError(
            f"{path}: line {line} holds zero bytes, as a loss of power leaves them; delete the file from there on, or "
            "name a text file"
        )
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return [(number, line) for number, line in enumerate(lines, start=1) if line and not line.isspace()]


def decoded_text(data: bytes) -> str:
    """Text in UTF-8, UTF-16 with its mark, or else Windows' western code page."""
    if data[:2] in UTF_16_MARKS:
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def is_text(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is text, by its first line: a loss of power leaves zeros behind."""
    return begin[:2] in UTF_16_MARKS or CONTROL.search(begin.partition(b"\n")[0]) is None


def delimiter_of(lines: Lines, given: str) -> str:
    """The delimiter that is given, or for `auto` the first of tab, `;`, `|`, `,` and blank that every line has.

    The comma comes late because it may be the decimal sign, the blank last because it may stand in names; it is taken
    only where no line has a comma.
    """
    if given != "auto":
        return DELIMITERS.get(given, given)
    sample = [text for _, text in lines if text.strip()][:SNIFFED]
    everywhere = [sign for sign in "\t;|" if sample and all(sign in text for text in sample)]
    spaced = sample and not any("," in text for text in sample) and all(" " in text.strip() for text in sample)
    return everywhere[0] if everywhere else " " if spaced else ","


def split_rows(path: Path, lines: Lines, delimiter: str) -> Rows:
    """Cells of every line, stripped; blank lines are omitted.

    Raises
    ------
    InputError
        A quote is not closed on its line, a line has more than `MOST_CELLS` cells, or a cell is longer than any
        number or name.
    """
    reader = csv.reader((text for _, text in lines), delimiter=delimiter, skipinitialspace=True)
    rows: Rows = []
    try:
        for count, cells in enumerate(reader, start=1):
            if reader.line_num != count:
                raise InputError(f"{path}: line {lines[count - 1][0]}: a quote is not closed; remove it")
            if len(cells) > MOST_CELLS:
                raise InputError(
                    f"{path}: line {lines[count - 1][0]} has {len(cells)} cells, at most {MOST_CELLS} are read; write "
                    "a row per sample, each on its own line"
                )
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                rows.append((lines[count - 1][0], stripped))
    except csv.Error as error:
        raise InputError(f"{path}: line {lines[reader.line_num - 1][0]}: {error}; repair it") from error
    return rows


def name_and_unit(title: str) -> tuple[str, str]:
    """`torque [Nm]` or `torque (Nm)` as name and unit; the unit is empty where the title has none."""
    match = UNIT.fullmatch(title)
    return (match[1], match[2] or match[3] or "") if match else (title, "")


def without_brackets(unit: str) -> str:
    """A unit below a header without the brackets around it: `[deg]` and `(deg)` are `deg`."""
    return unit[1:-1].strip() if unit[:1] + unit[-1:] in ("[]", "()") else unit


def numbers(
    cells: Sequence[str | None] | pl.Series, missing: Collection[str], decimal: str
) -> tuple[Array, NDArray[np.bool_]]:
    """Values (n,), and which are missing, (n,): NaN where a cell is None or one of the words in `missing`.

    Raises
    ------
    UnreadableCellError
        Another cell is not a finite number.
    """
    text = pl.Series(cells, dtype=pl.String)
    absent = (text.is_null() | text.is_in(list(missing))).to_numpy()
    if decimal == ",":  # a full stop then separates thousands, or the decimal sign is stated wrongly
        stops = (text.str.contains(".", literal=True).fill_null(False).to_numpy()) & ~absent
        if stops.any():
            raise UnreadableCellError(int(np.argmax(stops)))
    plain = text.str.replace(",", ".", literal=True) if decimal == "," else text
    values = plain.cast(pl.Float64, strict=False).to_numpy().copy()
    values[absent] = np.nan
    for place in np.flatnonzero(~np.isfinite(values) & ~absent):
        values[place] = number(str(plain[int(place)]), int(place))
    return values, absent


def number(text: str, place: int) -> float:
    """The number in a cell that polars does not read, such as `+1.5`; `place` is for the error."""
    if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", text, re.ASCII) and np.isfinite(float(text)):
        return float(text)
    raise UnreadableCellError(place)


class UnreadableCellError(Exception):
    """A cell, by its place in the column, that is not a number."""

    def __init__(self, place: int) -> None:
        super().__init__(place)
        self.place = place


def is_number_cell(cell: str) -> bool:
    """Whether a cell holds a number."""
    try:
        number(cell, 0)
    except UnreadableCellError:
        return False
    return True
