"""A CSV log as a table of text cells: names, units, and rows of which each cell's column is known."""

from dataclasses import dataclass
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_text import (
    Lines,
    Rows,
    UnreadableCellError,
    delimiter_of,
    name_and_unit,
    number,
    read_lines,
    split,
)
from osl_analysis.ingest.csv_source import CsvSource
from osl_analysis.ingest.recording import listing


@dataclass(frozen=True)
class Shape:
    """From row `first` on, cell i of a row belongs to column `columns[i]`."""

    first: int
    columns: list[int]


@dataclass(frozen=True)
class CsvTable:
    """Rows of a log with their line numbers; `names` as in the header, `units` beside them, empty where none is given.

    `notes` are what was repaired, `comments` the lines behind the comment sign.
    """

    path: Path
    names: list[str]
    units: list[str]
    rows: Rows
    shapes: list[Shape]
    comments: list[str]
    notes: list[str]

    def column(self, name: str) -> int:
        """Place of a column by its name, with or without its unit.

        Raises
        ------
        InputError
            There is none, or more than one.
        """
        places = [i for i, title in enumerate(self.names) if title == name]
        places = places or [i for i, title in enumerate(self.names) if name_and_unit(title)[0] == name]
        if len(places) != 1:
            found = f"stands {len(places)} times" if places else "is not there"
            raise InputError(f"{self.path}: column '{name}' {found}; the file has {listing(self.names)}")
        return places[0]

    def cells(self, column: int) -> list[str | None]:
        """A column's cells; None where the logger had left the column out."""
        cells: list[str | None] = []
        ends = [shape.first for shape in self.shapes[1:]] + [len(self.rows)]
        for shape, end in zip(self.shapes, ends, strict=True):
            if column in shape.columns:
                place = shape.columns.index(column)
                cells += [row[place] for _, row in self.rows[shape.first : end]]
            else:
                cells += [None] * (end - shape.first)
        return cells


def read_table(path: Path, source: CsvSource) -> CsvTable:
    """A CSV log by its source file.

    Raises
    ------
    InputError
        No rows, a header that is none, or rows of another length than it where the source file does not allow them.
    """
    lines = read_lines(path)
    sign = source.comment
    comments: Lines = [(n, t.strip()[len(sign) :].strip()) for n, t in lines if sign and t.lstrip().startswith(sign)]
    content = [(n, text) for n, text in lines if not (sign and text.lstrip().startswith(sign))]
    delimiter = delimiter_of(content, source.delimiter)
    rows = split(path, content, delimiter)
    names = header_of(path, rows, comments, delimiter, source)
    units = [name_and_unit(name)[1] for name in names]
    rows = rows[1:] if source.header == "row" else rows
    if source.units_row and rows:
        units, rows = ([*rows[0][1], *units[len(rows[0][1]) :]], rows[1:])
    if not rows:
        raise InputError(f"{path}: no rows of data; record it again or exclude the trial in the sheet")
    rows = [(line, trimmed(cells, len(names))) for line, cells in rows]
    rows, shapes, notes = fitted(path, rows, len(names), source)
    if not rows:
        raise InputError(
            f"{path}: none of its rows fits the header's {len(names)} names; state `delimiter` or `header`"
        )
    return CsvTable(path, names, units, rows, shapes, [text for _, text in comments], notes)


def header_of(path: Path, rows: Rows, comments: Lines, delimiter: str, source: CsvSource) -> list[str]:
    """Names of the columns; their numbers, counted from 1, where the file has no header."""
    if source.header == "comment":
        named = split(path, comments[-1:], delimiter)
        if not named:
            raise InputError(f"{path}: no line begins with '{source.comment}'; write header: row or none")
        return named[0][1]
    if not rows:
        raise InputError(f"{path}: holds no rows; record it again or exclude the trial in the sheet")
    line, first = rows[0]
    if source.header == "none":
        return [str(i + 1) for i in range(len(first))]
    if all(is_number(cell.replace(",", ".")) for cell in first if cell):
        raise InputError(f"{path}: line {line} holds numbers, not the columns' names; write header: none")
    return trimmed(first, 0)


def is_number(cell: str) -> bool:
    try:
        number(cell, 0)
    except UnreadableCellError:
        return False
    return True


def trimmed(cells: list[str], width: int) -> list[str]:
    """Cells without the empty ones beyond `width`: writers pad lines."""
    end = len(cells)
    while end > width and not cells[end - 1]:
        end -= 1
    return cells[:end]


def fitted(path: Path, rows: Rows, width: int, source: CsvSource) -> tuple[Rows, list[Shape], list[str]]:
    """Rows of which each cell's column is known, the shapes that say so, and what was repaired."""
    notes = []
    if len(rows) > 1 and len(rows[-1][1]) < min(width, len(rows[-2][1])):
        notes.append(f"{path.name}: the last line, {rows[-1][0]}, is cut off and left out")
        rows = rows[:-1]
    if source.ragged == "dropped_variable":
        shapes, found = dropped_variables(path, rows, width, source)
        return rows, shapes, notes + found
    odd = [(line, len(cells)) for line, cells in rows if len(cells) != width]
    if odd and (source.ragged == "refuse" or len(odd) > source.most_missing * len(rows)):
        raise InputError(
            f"{path}: line {odd[0][0]} has {odd[0][1]} cells under {width} names, and {len(odd)} of {len(rows)} rows "
            "do not fit; repair the file, or state `ragged` and `most_missing` in the source file"
        )
    if odd:
        notes.append(f"{path.name}: {len(odd)} of {len(rows)} rows do not fit the header and are left out")
    return [row for row in rows if len(row[1]) == width], [Shape(0, list(range(width)))], notes


def dropped_variables(path: Path, rows: Rows, width: int, source: CsvSource) -> tuple[list[Shape], list[str]]:
    """Which columns the rows hold where a logger drops those that fail: the ones missing in the row before.

    Raises
    ------
    InputError
        A row is longer than the one before it, or shorter by another count than were missing: nothing tells then
        which column its cells belong to.
    """
    shapes, notes, columns = [Shape(0, list(range(width)))], [], list(range(width))
    for place, (line, cells) in enumerate(rows):
        if len(cells) == len(columns):
            continue
        before = rows[place - 1][1] if place else []
        failed = [column for column, cell in zip(columns, before, strict=False) if cell in source.missing]
        if len(cells) > len(columns) or len(columns) - len(cells) != len(failed):
            raise InputError(
                f"{path}: line {line} has {len(cells)} cells where {len(columns)} were, and {len(failed)} were missing "
                "in the line before: nothing tells which column was dropped; cut the file there"
            )
        columns = [column for column in columns if column not in failed]
        shapes.append(Shape(place, columns))
        notes.append(f"{path.name}: from line {line} on, columns {', '.join(str(c + 1) for c in failed)} are left out")
    return shapes, notes
