"""The rows of a CSV log under its header: cells without a name, rows of another length, omitted variables."""

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_text import Rows, is_number_cell


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
    extra_cells: Literal["refuse", "first", "last"] = "refuse"
    """Cells that every row has more than the header, without a name: whether they stand first or last. They are left
    out."""
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


def check_header_place(path: Path, header: tuple[int, list[str]], rows: Rows) -> None:
    """Refuse a table below lines of other text, whose first line is taken for the names of its columns.

    It is so where most rows have more cells than the header, and the first such row below it holds no number. One cell
    more in the next row may be a row of units below a header that lacks a name.

    Raises
    ------
    InputError
        The names seem to stand further down.
    """
    names = unpadded(header[1], 0)
    (width, count), *_ = Counter(len(cells) for _, cells in rows).most_common(1) or [(0, 0)]
    wide = next(((line, cells) for line, cells in rows if len(cells) == width), None)
    if wide is None or count <= len(rows) / 2 or width <= len(names) or width < 2:
        return
    line, cells = wide
    sign = next((sign for sign in ";|\t," if len(names) == 1 and len(names[0].split(sign)) == width), "")
    if sign:
        raise InputError(
            f"{path}: line {header[0]} separates the names by '{sign}', the rows below it do not; write the same sign "
            "in all"
        )
    far = rows[0][0] != line or width > len(names) + 1
    if far and not any(is_number_cell(cell.replace(",", ".")) for cell in cells):
        raise InputError(
            f"{path}: line {header[0]} has {len(names)} cells and most rows have {width}: the names of the columns "
            f"seem to stand in line {line}; delete the lines above it, or begin each with `#`"
        )


def share_above(count: int, total: int) -> float:
    """A share of three decimals that is at least count / total, for the user to write."""
    return math.ceil(1000 * count / total) / 1000


def without_extra_cells(path: Path, rows: Rows, width: int, layout: CsvLayout) -> tuple[Rows, list[str]]:
    """Rows without the cells that every row has more than the header, and what was left out.

    A log whose rows fit the header is left as it is, so that one source file serves logs with and without such cells.

    Raises
    ------
    InputError
        Every row has the same number of cells more than the header has names, and the layout does not say which.
    """
    extra = {len(cells) - width for _, cells in rows}
    count = extra.pop()
    if extra or count < 1:
        return rows, []
    line, cells = rows[0]
    if layout.extra_cells == "refuse":
        raise InputError(
            f"{path}: every row has {count} more cells than the header has names: line {line} begins with "
            f"'{cells[0][:40]}' and ends with '{cells[-1][:40]}'; write `extra_cells: first` or `extra_cells: last` in "
            "the source file to leave out those without a name"
        )
    first = layout.extra_cells == "first"
    kept = [(line, cells[count:] if first else cells[:width]) for line, cells in rows]
    return kept, [f"{path.name}: the {layout.extra_cells} {count} cells of every row have no name and were left out"]


def unpadded(cells: list[str], width: int) -> list[str]:
    """Cells without the empty ones beyond `width`, with which some writers pad lines."""
    end = len(cells)
    while end > width and not cells[end - 1]:
        end -= 1
    return cells[:end]


def without_cut_line(rows: Rows, width: int) -> Rows:
    """The rows without the last one if it has too few cells, as where the recorder was interrupted."""
    cut = len(rows) > 1 and len(rows[-1][1]) < min(width, len(rows[-2][1]))
    return rows[:-1] if cut else rows


def fitting_rows(path: Path, rows: Rows, width: int, layout: CsvLayout) -> tuple[Rows, list[RowColumns], list[str]]:
    """The rows that fit, the column of each of their cells, and what was repaired."""
    notes: list[str] = []
    if layout.ragged == "dropped_variable":
        rows, unnamed = without_unnamed(path, rows, width, layout)
        columns_from, dropped = dropped_variables(path, rows, width, layout)
        return rows, columns_from, notes + unnamed + dropped
    odd = [(line, len(cells)) for line, cells in rows if len(cells) != width]
    if odd and (layout.ragged == "refuse" or len(odd) > layout.most_missing * len(rows)):
        share = share_above(len(odd), len(rows))
        more = f" and `most_missing: {share:g}`" if share > layout.most_missing else ""
        raise InputError(
            f"{path}: line {odd[0][0]} has {odd[0][1]} cells under {width} names, and {len(odd)} of {len(rows)} rows "
            f"do not fit; repair these lines, or write `ragged: skip`{more} in the source file to leave them out"
        )
    if odd:
        notes.append(f"{path.name}: {len(odd)} of {len(rows)} rows do not fit the header and were skipped")
    return [row for row in rows if len(row[1]) == width], [RowColumns(0, list(range(width)))], notes


def without_unnamed(path: Path, rows: Rows, width: int, layout: CsvLayout) -> tuple[Rows, list[str]]:
    """Rows without the cells of variables that failed before the logger wrote its header, which lacks their names.

    The logger of `opensourceleg` writes the header with the first thousand rows, after these variables were omitted.
    They are the ones that were missing in the last row that has them. Rows that this does not explain stay as they are.
    """
    first = next((place for place, (_, cells) in enumerate(rows) if len(cells) == width), 0)
    lengths = {len(cells) for _, cells in rows[:first]}
    extra = lengths.pop() - width if len(lengths) == 1 else 0
    if extra < 1:
        return rows, []
    unnamed = [place for place, cell in enumerate(rows[first - 1][1]) if cell in layout.missing]
    if len(unnamed) != extra:
        return rows, []
    kept = [(line, [cell for place, cell in enumerate(cells) if place not in unnamed]) for line, cells in rows[:first]]
    which = ", ".join(str(place + 1) for place in unnamed)
    note = f"{path.name}: up to line {rows[first - 1][0]}, cells {which} of every row have no name and were left out"
    return [*kept, *rows[first:]], [note]


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
