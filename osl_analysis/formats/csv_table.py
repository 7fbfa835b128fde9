"""A CSV log as a table of text cells: names, units, and rows whose cells are assigned to columns."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats.csv_plain import PlainBody, head_of, plain_lines
from osl_analysis.formats.csv_rows import (
    CsvLayout,
    RowColumns,
    check_header_place,
    fitting_rows,
    unpadded,
    without_cut_line,
    without_extra_cells,
)
from osl_analysis.formats.csv_text import (
    SNIFFED,
    Lines,
    Rows,
    delimiter_of,
    is_number_cell,
    lines_of,
    name_and_unit,
    read_lines,
    split_rows,
    without_brackets,
)


@dataclass(frozen=True)
class CsvTable:
    """The rows of a log in CSV, as text."""

    path: Path
    names: list[str]
    """Names of the columns, as in the header."""
    units: list[str]
    """Units of the columns, from a row of units or from brackets behind the name; empty where none is given."""
    rows: Rows | PlainBody
    """Number of the line in the file, and its cells."""
    columns_from: list[RowColumns]
    """Which column each cell of a row belongs to."""
    comments: list[str]
    """The comment lines without their sign."""
    notes: list[str]
    """Repairs, a sentence each."""
    delimiter: str = ""
    """Sign between its cells."""
    complete: bool = True
    """Whether its last line is whole."""

    def column(self, name: str) -> int:
        """Place of a column by its name, with or without its unit, by a pattern with `*`, or by its number from 1.

        A name goes before a pattern, a pattern before a number.

        Raises
        ------
        InputError
            There is none, or more than one.
        """
        places = places_of(name, self.names)
        if len(places) == 1:
            return places[0]
        where = f"{self.path}: column '{name[:80]}'"
        if places:
            which = listing([f"{place + 1} ('{self.names[place]}')" for place in places])
            advice = "write a pattern or a name that only one has, or its number"
            raise InputError(f"{where} occurs {len(places)} times, as columns {which}; {advice}")
        if len(self.names) > 1:
            advice = nearest(name, self.names) or "; correct the name in the source file"
        else:
            advice = "; state `delimiter` if these are several columns"
        raise InputError(f"{where} is missing; the file has {listing(self.names)}{advice}")

    def cells(self, column: int) -> list[str | None] | pl.Series:
        """A column's cells; None in rows in which the logger omitted the column."""
        if isinstance(self.rows, PlainBody):
            return self.rows.cells(column)
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
    return large_table(path, layout) or table_of(path, read_lines(path), layout)


def large_table(path: Path, layout: CsvLayout) -> CsvTable | None:
    """The same for a large file whose lines are all alike below the first ones; None for another one."""
    head = head_of(path)
    if head is None:
        return None
    try:
        table = table_of(path, lines_of(path, head.data), layout)
    except InputError:
        return None  # the whole file tells what is wrong
    width = len(table.names)
    if isinstance(table.rows, PlainBody) or len(table.rows) < SNIFFED or table.notes:
        return None
    if table.columns_from != [RowColumns(0, list(range(width)))] or not table.delimiter:
        return None
    count = plain_lines(path, len(head.data), table.delimiter, width, layout.comment)
    if count is None:
        return None
    return replace(table, rows=PlainBody(path, table.rows, len(head.data), head.lines + 1, count, table.delimiter))


def table_of(path: Path, lines: Lines, layout: CsvLayout) -> CsvTable:
    """The rows among the lines of a log in CSV; raises as `read_csv_table`."""
    sign = layout.comment
    comments: Lines = [(n, t.strip()[len(sign) :].strip()) for n, t in lines if sign and t.lstrip().startswith(sign)]
    content = [(n, text) for n, text in lines if not (sign and text.lstrip().startswith(sign))]
    delimiter = delimiter_of(content, layout.delimiter)
    rows = split_rows(path, content, delimiter)
    names = header_of(path, rows, comments, delimiter, layout)
    units = [name_and_unit(name)[1] for name in names]
    if layout.header == "row":
        check_header_place(path, rows[0], rows[1:])
        rows = rows[1:]
    rows = [(line, unpadded(cells, len(names))) for line, cells in rows]
    rows, left_out = without_extra_cells(path, rows, len(names), layout) if rows else (rows, [])
    if layout.units_row and rows:
        units, rows = ([*map(without_brackets, rows[0][1]), *units[len(rows[0][1]) :]], rows[1:])
    if not rows:
        raise InputError(f"{path}: no rows of data; record it again, or exclude the trial")
    last = rows[-1][0]
    rows = without_cut_line(rows, len(names))
    cut = f"{path.name}: the last line, {last}, is cut off and was skipped" if rows[-1][0] != last else ""
    rows, columns_from, notes = fitting_rows(path, rows, len(names), layout)
    if not rows:
        raise InputError(
            f"{path}: none of its rows fits the header's {len(names)} names; state `delimiter` or `header`"
        )
    said = [text for _, text in comments]
    repairs = [*left_out, *filter(None, [cut]), *notes]
    return CsvTable(path, names, units, rows, columns_from, said, repairs, delimiter, complete=not cut)


def header_of(path: Path, rows: Rows, comments: Lines, delimiter: str, layout: CsvLayout) -> list[str]:
    """Names of the columns; their numbers, counted from 1, where the file has no header."""
    if layout.header == "comment":
        named = split_rows(path, comments[-1:], delimiter)
        if not named:
            raise InputError(f"{path}: no line begins with '{layout.comment}'; write `header: row` or `header: none`")
        return named[0][1]
    if not rows:
        raise InputError(f"{path}: holds no rows; record it again, or exclude the trial")
    line, first = rows[0]
    if layout.header == "none":
        return [str(i + 1) for i in range(len(first))]
    if all(is_number_cell(cell.replace(",", ".")) for cell in first if cell):
        raise InputError(
            f"{path}: line {line} holds numbers, not the columns' names; write `header: none` and the columns' numbers"
        )
    return unpadded(first, 0)


def places_of(name: str, names: Sequence[str]) -> list[int]:
    """Places of the columns that a name, a pattern with `*` for any text, or a number from 1 means."""
    plain = [name_and_unit(title)[0] for title in names]
    exact = [i for i, title in enumerate(names) if title == name] or [
        i for i, title in enumerate(plain) if title == name
    ]
    if exact:
        return exact
    if "*" in name:
        pattern = re.compile(re.escape(name).replace(r"\*", ".*"), re.DOTALL)
        return [i for i in range(len(names)) if pattern.fullmatch(names[i]) or pattern.fullmatch(plain[i])]
    number_given = re.fullmatch(r"[1-9]\d{0,4}", name, re.ASCII) and int(name) <= len(names)
    return [int(name) - 1] if number_given else []
