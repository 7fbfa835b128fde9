"""The cells of a sample sheet as text: one encoding, blanks stripped once, nothing taken for something else."""

import csv
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats.other_formats import refuse_others

INVISIBLE = {"Cf", "Zl", "Zp", "Cc"}
"""Unicode categories of characters that nobody sees: zero width, text direction, line separators, control."""
FREE_TEXT = ("exclude",)
"""Columns of sentences, in which any blank may stand."""


@dataclass(frozen=True)
class SheetLine:
    """One row of a sheet. number: its line in the file, counted from 1; cells: by column, without outer blanks."""

    number: int
    cells: dict[str, str]


def read_lines(path: Path) -> tuple[list[str], list[SheetLine]]:
    """Columns and rows of a CSV sheet in UTF-8, with or without byte order mark.

    Empty lines and lines that begin with `#` are skipped; elsewhere `#` is text. `NA` is text, too. An empty cell says
    nothing.

    Raises
    ------
    InputError
        The file cannot be read, is not UTF-8 or not CSV, names a column twice, a row has more cells than the header, or
        a cell has a character that looks like a blank or like nothing.
    """
    rows = list(numbered_rows(path))
    if not rows:
        raise InputError(f"{path}: not a CSV table, it is empty; write a header and a row per trial")
    first, header = rows[0]
    columns = [outer_blanks_off(cell) for cell in header]
    for column in columns:
        if columns.count(column) > 1:
            raise InputError(f"{path}: line {first}: column '{column}' stands twice; remove one")
    lines = []
    for number, row in rows[1:]:
        cells = [outer_blanks_off(cell) for cell in row]
        if any(cells[len(columns) :]):
            raise InputError(
                f"{path}: line {number}: {len(row)} cells, the header has {len(columns)}; quote a cell that contains a "
                "comma"
            )
        if any(cells):
            lines.append(SheetLine(number, dict(zip(columns, cells + [""] * len(columns), strict=False))))
    for line in lines:
        check_characters(path, line)
    return columns, lines


def numbered_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows of a CSV file with the number of their line, without empty lines and comments."""
    try:
        content = path.read_bytes()
        check_text(path, content)
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}: line {line}: byte {error.object[error.start]:#04x} is not UTF-8; save the sheet as 'CSV UTF-8'"
        ) from error
    reader = csv.reader(text.splitlines(keepends=True), strict=True)
    number = 1
    try:
        for row in reader:
            if row and not row[0].lstrip().startswith("#"):
                yield number, row
            number = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{path}: line {number}: not CSV ({error}); check the quotes") from error


def check_text(path: Path, content: bytes) -> None:
    """Refuse a sheet that is a file of another kind, such as a workbook of Excel, or has zero bytes in its header."""
    refuse_others(path, content)
    if b"\0" in content.partition(b"\n")[0]:
        raise InputError(f"{path}: its header holds zero bytes, it is not UTF-8; save the sheet as 'CSV UTF-8'")


def outer_blanks_off(cell: str) -> str:
    """A cell without blanks and invisible characters at its ends."""
    while cell and (cell[0].isspace() or unicodedata.category(cell[0]) in INVISIBLE):
        cell = cell[1:]
    while cell and (cell[-1].isspace() or unicodedata.category(cell[-1]) in INVISIBLE):
        cell = cell[:-1]
    return cell


def check_characters(path: Path, line: SheetLine) -> None:
    """Refuse characters within a cell that look like a blank or like nothing: two equal names would differ."""
    for column, cell in line.cells.items():
        for sign in cell if column not in FREE_TEXT else "":
            if (sign.isspace() and sign != " ") or unicodedata.category(sign) in INVISIBLE:
                name = f"U+{ord(sign):04X} ({unicodedata.name(sign, 'a control character')})"
                raise InputError(
                    f"{path}: line {line.number}: column '{column}': {cell!r} contains {name}; type the cell again"
                )
