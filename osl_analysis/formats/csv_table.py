"""A CSV log as a table of text cells: names, units, and rows whose cells are assigned to columns."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.csv_text import (
    Lines,
    Rows,
    UnreadableCellError,
    delimiter_of,
    name_and_unit,
    number,
    read_lines,
    split_rows,
)


@dataclass(frozen=True)
class CsvLayout:
    """How a logger writes its table."""

    delimiter: str = "auto"
    """Sign between cells: `,`, `;`, `|`, `tab`, `space`, or `auto`, the first that all lines have."""
    decimal: Literal[".", ","] = "."
    """Decimal sign of the numbers."""
    comment: str = "#"
    """Sign at the beginning of comment lines; empty if there are none."""
    header: Literal["row", "comment", "none"] = "row"
    """Place of the columns' names: the first row, the last comment line, or none."""
    units_row: bool = False
    """Whether a row of units follows the header."""
    missing: tuple[str, ...] = ("", "nan", "NaN")
    """Cells that mean a failed reading."""
    most_missing: float = 0.01
    """Largest share of rows that may be skipped, and of a column's cells that may be missing."""
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"
    """Treatment of rows whose length differs from the header's.

    `refuse`: the file is refused. `skip`: they are skipped and counted. `dropped_variable`: the logger omits a variable
    after it failed. From such a row on, the columns that were missing in the row before are missing.
    """


@dataclass(frozen=True)
class RowColumns:
    """From row `first` on, cell i of a row belongs to column `columns[i]`."""

    first: int
    columns: list[int]


@dataclass(frozen=True)
class CsvTable:
    """The rows of a log in CSV, as text."""

    path: Path
    names: list[str]
    """Names of the columns, as in the header."""
    units: list[str]
    """Units of the columns, from a row of units or from brackets behind the name; empty where none is given."""
    rows: Rows
    """Number of the line in the file, and its cells."""
    columns_from: list[RowColumns]
    """Which column each cell of a row belongs to."""
    comments: list[str]
    """The comment lines without their sign."""
    notes: list[str]
    """Repairs, a sentence each."""

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
            problem = f"occurs {len(places)} times" if places else "is missing"
            raise InputError(f"{self.path}: column '{name}' {problem}; the file has {listing(self.names)}")
        return places[0]

    def cells(self, column: int) -> list[str | None]:
        """A column's cells; None in rows in which the logger omitted the column."""
        cells: list[str | None] = []
        ends = [part.first for part in self.columns_from[1:]] + [len(self.rows)]
        for part, end in zip(self.columns_from, ends, strict=True):
            if column in part.columns:
                place = part.columns.index(column)
                cells += [row[place] for _, row in self.rows[part.first : end]]
            else:
                cells += [None] * (end - part.first)
        return cells


def read_csv_table(path: Path, layout: CsvLayout) -> CsvTable:
    """The rows of a log in CSV.

    Raises
    ------
    InputError
        The file has no rows or no header, or rows of another length than the header that the layout does not allow.
    """
    lines = read_lines(path)
    sign = layout.comment
    comments: Lines = [(n, t.strip()[len(sign) :].strip()) for n, t in lines if sign and t.lstrip().startswith(sign)]
    content = [(n, text) for n, text in lines if not (sign and text.lstrip().startswith(sign))]
    delimiter = delimiter_of(content, layout.delimiter)
    rows = split_rows(path, content, delimiter)
    names = header_of(path, rows, comments, delimiter, layout)
    units = [name_and_unit(name)[1] for name in names]
    rows = rows[1:] if layout.header == "row" else rows
    if layout.units_row and rows:
        units, rows = ([*rows[0][1], *units[len(rows[0][1]) :]], rows[1:])
    if not rows:
        raise InputError(f"{path}: no rows of data; record it again, or exclude the trial")
    rows = [(line, unpadded(cells, len(names))) for line, cells in rows]
    rows, columns_from, notes = fitting_rows(path, rows, len(names), layout)
    if not rows:
        raise InputError(
            f"{path}: none of its rows fits the header's {len(names)} names; state `delimiter` or `header`"
        )
    return CsvTable(path, names, units, rows, columns_from, [text for _, text in comments], notes)


def header_of(path: Path, rows: Rows, comments: Lines, delimiter: str, layout: CsvLayout) -> list[str]:
    """Names of the columns; their numbers, counted from 1, where the file has no header."""
    if layout.header == "comment":
        named = split_rows(path, comments[-1:], delimiter)
        if not named:
            raise InputError(f"{path}: no line begins with '{layout.comment}'; write header: row or none")
        return named[0][1]
    if not rows:
        raise InputError(f"{path}: holds no rows; record it again, or exclude the trial")
    line, first = rows[0]
    if layout.header == "none":
        return [str(i + 1) for i in range(len(first))]
    if all(is_number_cell(cell.replace(",", ".")) for cell in first if cell):
        raise InputError(f"{path}: line {line} holds numbers, not the columns' names; write header: none")
    return unpadded(first, 0)


def is_number_cell(cell: str) -> bool:
    """Whether a cell holds a number."""
    try:
        number(cell, 0)
    except UnreadableCellError:
        return False
    return True


def unpadded(cells: list[str], width: int) -> list[str]:
    """Cells without the empty ones beyond `width`, with which some writers pad lines."""
    end = len(cells)
    while end > width and not cells[end - 1]:
        end -= 1
    return cells[:end]


def fitting_rows(path: Path, rows: Rows, width: int, layout: CsvLayout) -> tuple[Rows, list[RowColumns], list[str]]:
    """The rows that fit, the column of each of their cells, and what was repaired."""
    notes = []
    if len(rows) > 1 and len(rows[-1][1]) < min(width, len(rows[-2][1])):
        notes.append(f"{path.name}: the last line, {rows[-1][0]}, is cut off and was skipped")
        rows = rows[:-1]
    if layout.ragged == "dropped_variable":
        columns_from, dropped = dropped_variables(path, rows, width, layout)
        return rows, columns_from, notes + dropped
    odd = [(line, len(cells)) for line, cells in rows if len(cells) != width]
    if odd and (layout.ragged == "refuse" or len(odd) > layout.most_missing * len(rows)):
        raise InputError(
            f"{path}: line {odd[0][0]} has {odd[0][1]} cells under {width} names, and {len(odd)} of {len(rows)} rows "
            "do not fit; repair the file, or state `ragged` and `most_missing`"
        )
    if odd:
        notes.append(f"{path.name}: {len(odd)} of {len(rows)} rows do not fit the header and were skipped")
    return [row for row in rows if len(row[1]) == width], [RowColumns(0, list(range(width)))], notes


def dropped_variables(path: Path, rows: Rows, width: int, layout: CsvLayout) -> tuple[list[RowColumns], list[str]]:
    """The columns of each row of a logger that omits failed variables: those that were missing in the row before.

    Raises
    ------
    InputError
        A row is longer than the row before it, or the number of omitted cells differs from the number of cells missing
        before. The columns of its cells are then unknown.
    """
    columns_from, notes, columns = [RowColumns(0, list(range(width)))], [], list(range(width))
    for place, (line, cells) in enumerate(rows):
        if len(cells) == len(columns):
            continue
        before = rows[place - 1][1] if place else []
        failed = [column for column, cell in zip(columns, before, strict=False) if cell in layout.missing]
        if len(cells) > len(columns) or len(columns) - len(cells) != len(failed):
            raise InputError(
                f"{path}: line {line} has {len(cells)} cells where {len(columns)} were, and {len(failed)} were missing "
                "in the line before: it is unknown which column was omitted; cut the file off there"
            )
        columns = [column for column in columns if column not in failed]
        columns_from.append(RowColumns(place, columns))
        notes.append(f"{path.name}: from line {line} on, columns {', '.join(str(c + 1) for c in failed)} are missing")
    return columns_from, notes
