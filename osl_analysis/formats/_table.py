"""Tables of numbers in rows of cells, from text or from a sheet: header, units, rows, footer.

All is found from the content, unless a source file states it.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import Field, model_validator

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats import _cells
from osl_analysis.formats._cells import (
    MISSING,
    UnreadableCellError,
    is_number_cell,
    is_value,
    most_common_width,
    name_and_unit,
    without_brackets,
)
from osl_analysis.formats._text import Line, Row, split_rows, unpadded
from osl_analysis.recording import Channel, End, Kind, Loss, Recording, Rows
from osl_analysis.source_file import ColumnChannel, ColumnTime, TableSource
from osl_analysis.units import is_clock, is_unit, name_and_ending

MOST_COLUMNS = 10_000  # a table with more columns is transposed, or no recording
SAMPLE_ROWS = 600  # rows by which the width of a table and its first numbers are found
LONGEST_FOOTER = 60  # rows
MOST_HEADERS = 3  # rows of names and units above the numbers
LEAST_VALUES = 0.5  # share of the cells of a column of numbers that are numbers
STATED_ROWS = re.compile(
    r"(?i)\W*(?:total |(?:number|no\.?) of )?(?:samples|rows|frames|length|data"
    r" points)[\s:=,;]+(\d+)\b(?![.,]\d)"
)
"""Text above a table that states its number of rows."""


class SheetSource(TableSource):
    """The source file of a table of cells with a header, from any program."""

    OF = " of format table"
    channels: Mapping[str, ColumnChannel] = Field(min_length=1)
    time: ColumnTime
    # Sign at the beginning of comment lines, of `auto` #, % or //; empty if there are none.
    comment: str = "auto"
    header: Literal["auto", "row", "comment", "none"] = "auto"
    """Place of the names: the row above the numbers, the last comment line, or none; `auto` takes
    what is there."""
    # Whether a row of units follows the header; `auto` looks.
    units_row: bool | Literal["auto"] = "auto"
    # Cells that become NaN: what a logger writes if a reading failed.
    missing: tuple[str, ...] = MISSING
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"
    """Rows whose length differs from the header's: the file is refused, or `skip` skips and counts
    them. `dropped_variable`, for a logger that omits a variable after it failed: from there on, the
    columns that were missing in the last complete row are NaN; a row that this does not explain is
    refused."""

    @model_validator(mode="after")
    def _below_a_header(self) -> "SheetSource":
        if self.units_row is True and self.header not in ("auto", "row"):
            raise ValueError("a row of units needs a header row above it")
        return self


@dataclass(frozen=True)
class Layout:
    """How a table is written, with the fields of a source file; see `SheetSource`."""

    delimiter: str = "auto"
    decimal: str = "auto"
    comment: str = "auto"
    header: str = "auto"
    units_row: bool | str = "auto"
    missing: tuple[str, ...] = MISSING
    most_missing: float = 0.01
    ragged: str = "refuse"

    @property
    def comment_signs(self) -> tuple[str, ...]:
        """Beginnings of comment lines."""
        if self.comment == "auto":
            return ("#", "%", "//")
        return (self.comment,) if self.comment else ()


# to list what a file holds: rows that do not fit are left out, and told
LENIENT = Layout(ragged="skip", most_missing=1.0)


def layout_of(source: Any) -> Layout:
    """Take the layout from a source file; without one a file is listed as far as it can be read."""
    if source is None:
        return LENIENT
    names = Layout.__dataclass_fields__.keys() & type(source).model_fields.keys()
    return Layout(**{name: getattr(source, name) for name in names})


@dataclass(frozen=True)
class Table:
    """Names, units and cells of a table.

    Attributes
    ----------
    names
        As in the header; a column without a name has its number.
    units
        From a row of units, or from brackets behind the name; else empty.
    lines
        Number of each row in the file, shape (rows,).
    body
        A column each of text, or of numbers where the format has them; null where the logger
        omitted the column.
    notes
        Comments, and what stands above the header and below the rows.
    """

    names: list[str]
    units: list[str]
    lines: NDArray[np.int64]
    body: pl.DataFrame
    notes: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    skipped: int = 0  # rows that do not fit the header
    end: End = End.UNKNOWN
    delimiter: str = ""
    decimal: str = "."


@dataclass(frozen=True)
class Head:
    """What stands above the rows of numbers."""

    names: list[str]
    units: list[str]
    first: int  # place of the first row of data
    notes: list[str] = field(default_factory=list)  # other text


def table_of_rows(
    rows: Sequence[Row],
    comments: Sequence[Line],
    layout: Layout,
    delimiter: str = "",
    is_ended: bool = True,
) -> Table:
    """Find the table in rows of cells.

    Parameters
    ----------
    comments
        Lines of comments, without their signs.
    is_ended
        Whether the last line has a break, so that its last number is whole.

    Raises
    ------
    InputError
        There is no table of numbers, or rows do not fit the header.
    """
    if layout.header != "comment" and not rows:
        raise InputError("holds no rows; record it again, or exclude the trial")
    first_value = _first_column_of_values(rows)
    head = _head_of(rows, comments, layout, delimiter, first_value)
    width = len(head.names)
    if width > MOST_COLUMNS:
        raise InputError(
            f"has {width} columns, at most {MOST_COLUMNS} are read; write a row per sample"
        )
    remarks: list[str] = []
    data, footer = _without_footer(rows[head.first :], first_value or 0, layout)
    if footer:
        text = " ".join(footer[0].cells)[:60]
        remarks.append(
            f"{len(footer)} lines below the table, from {footer[0].number} on, are no rows:"
            f" '{text}'"
        )
    data = [Row(row.number, unpadded(row.cells, width)) for row in data]
    if not data:
        raise InputError("no rows of data; record it again, or exclude the trial")
    end = End.UNKNOWN
    cut = _cut_row(data, width, is_whole=is_ended or bool(footer))
    if cut:
        data = data[:-1]
        end = End.MISSING
        remarks.append(cut)
    if layout.ragged == "dropped_variable":
        filled, repairs = _with_dropped_variables(data, width, layout.missing)
        remarks += repairs
        skipped = 0
    else:
        filled = _fitting_rows(data, width, layout)
        skipped = len(data) - len(filled)
        if skipped:
            remarks.append(f"{skipped} of {len(data)} rows do not fit the header and were skipped")
    if not filled:
        raise InputError(
            f"none of its rows fits the header's {width} names; state `delimiter` or `header`"
        )
    columns = [
        pl.Series(str(place), [cells[place] for _, cells in filled], dtype=pl.String)
        for place in range(width)
    ]
    notes = [*head.notes, *(line.text for line in comments)]
    notes += [" ".join(row.cells) for row in footer]
    decimal = layout.decimal
    if decimal == "auto":
        decimal = _cells.decimal_of([cells for _, cells in filled])
    return Table(
        names=[name or str(place) for place, name in enumerate(head.names, start=1)],
        units=head.units,
        lines=np.array([number for number, _ in filled], np.int64),
        body=pl.DataFrame(columns),
        notes=notes,
        remarks=remarks,
        skipped=skipped,
        end=end,
        delimiter=delimiter,
        decimal=decimal,
    )


def _first_column_of_values(rows: Sequence[Row]) -> int | None:
    """Place of the first column in which at least half of the cells are numbers, times or missing;
    None if there is none."""
    sample = [row.cells for row in rows[:SAMPLE_ROWS]]
    width = most_common_width(sample)
    typical = [cells for cells in sample if len(cells) == width]
    typical = typical[len(typical) // 2 :]  # the first rows may be a header
    for place in range(width):
        cells = [row[place] for row in typical if row[place]]
        if cells and sum(map(is_value, cells)) >= LEAST_VALUES * len(cells):
            return place
    return None


def _head_of(
    rows: Sequence[Row],
    comments: Sequence[Line],
    layout: Layout,
    delimiter: str,
    first_value: int | None,
) -> Head:
    """Find names and units of the columns, and the first row of data."""
    if layout.header == "comment":
        named = split_rows(comments[-1:], delimiter)
        if not named:
            sign = "#" if layout.comment == "auto" else layout.comment
            raise InputError(f"no line begins with '{sign}'; write `header: row` or `header: none`")
        names = named[0].cells
        return Head(names, [name_and_unit(name)[1] for name in names], first=0)
    width = most_common_width([row.cells for row in rows[:SAMPLE_ROWS]])
    if layout.header == "none":
        return Head([str(place + 1) for place in range(width)], [""] * width, first=0)
    if first_value is None:
        raise _no_numbers(rows)
    first = _first_row_of_data(rows, layout, width, first_value)
    above = [row for row in rows[:first] if not STATED_ROWS.match(" ".join(row.cells))]
    above = _joined_heads(above)
    heads = above[len(above) - _count_headers(above, width) :]
    units: list[str] = []
    has_units = layout.units_row is True
    if layout.units_row == "auto":
        has_units = _are_units([row.cells for row in heads])
    if has_units and len(heads) > 1:
        units = [without_brackets(cell) for cell in heads[-1].cells]
        heads = heads[:-1]
    if delimiter == " " and len(units) < width:
        units = []  # it is unknown which column has none
    names = _names_in(heads, above, comments, width, delimiter)
    if not (heads or above):  # names and units may be the last two comments
        upper = _names_in([], [], comments[:-1], width, delimiter)
        if upper and _are_units([upper, names]):
            units = [without_brackets(cell) for cell in names]
            names = upper
    if not names and layout.header == "row":
        raise InputError(
            f"line {rows[0].number} holds numbers, not the columns' names; write `header: none` and"
            " the columns' numbers"
        )
    if not units:
        units = _labview_units(rows[:first], names)
    units += [""] * (max(width, len(names)) - len(units))
    in_brackets = [name_and_unit(name)[1] for name in names] or [""] * width
    units = [
        unit or unit_in_brackets for unit, unit_in_brackets in zip(units, in_brackets, strict=False)
    ]
    line_of_names = heads[-1].number if heads else 0
    notes = [
        " ".join(cell for cell in row.cells if cell)
        for row in rows[:first]
        if row.number != line_of_names
    ]
    return Head(names or [str(place + 1) for place in range(width)], units, first, notes)


def _no_numbers(rows: Sequence[Row]) -> InputError:
    if len(rows) < 2:
        return InputError("no rows of data; record it again, or exclude the trial")
    middle = rows[len(rows) // 2]
    return InputError(
        f"no table of numbers: most of its {len(rows)} rows hold none, such as line"
        f" {middle.number}, '{' '.join(middle.cells)[:40]}'; name a recording, or write a header"
        " and a row per sample"
    )


def _first_row_of_data(rows: Sequence[Row], layout: Layout, width: int, first_value: int) -> int:
    """Place of the first row of data; rows above it that lack cells or have a word are data too."""
    if layout.ragged == "dropped_variable":
        first = 1  # such a logger writes its header first
    else:
        begins_blank = not any(rows[len(rows) // 2].cells[:first_value])
        are_data = (_is_data(row.cells, width, first_value, begins_blank) for row in rows)
        first = next((place for place, is_data in enumerate(are_data) if is_data), len(rows))
    while first and _is_odd_data(rows[first - 1].cells, width):
        first -= 1
    return first


def _is_data(cells: Sequence[str], width: int, first_value: int, begins_blank: bool) -> bool:
    """Tell whether a row may be data: as wide as most, with a number or time in the first column
    that has them, and, if data begin blank, nothing before it."""
    if len(cells) != width or not is_value(cells[first_value]):
        return False
    if begins_blank and any(cells[:first_value]):
        return False
    named = [cell for cell in cells if cell]
    if not any(map(is_value, named)) or STATED_ROWS.match(" ".join(named)):
        return False
    # pandas numbers columns without a name: `,0,1,2`
    from_zero = [str(place) for place in range(len(named))]
    from_one = [str(place + 1) for place in range(len(named))]
    return bool(cells[0]) or named not in (from_zero, from_one)


def _is_odd_data(cells: Sequence[str], width: int) -> bool:
    """Tell whether a row above the data is data that lacks cells or has a word: more than half of
    its cells are numbers."""
    named = [cell for cell in cells if cell]
    counts_columns = not cells[0] and named[:1] in (["0"], ["1"])
    if counts_columns or STATED_ROWS.match(" ".join(cells)):
        return False
    numbers = sum(map(is_number_cell, named))
    return len(cells) > max(1, width / 2) and numbers > len(named) / 2


def _joined_heads(above: Sequence[Row]) -> list[Row]:
    """Join the last two rows above the data if they fill different columns, as pandas writes an
    index."""
    if len(above) < 2:
        return list(above)
    upper = above[-2].cells
    last = above[-1].cells
    overlap = any(
        upper_cell and last_cell for upper_cell, last_cell in zip(upper, last, strict=False)
    )
    ends_header = upper[0].startswith("***")  # LabVIEW's mark is no name
    if len(upper) != len(last) or overlap or not any(last) or ends_header:
        return list(above)
    cells = [upper_cell or last_cell for upper_cell, last_cell in zip(upper, last, strict=True)]
    return [*above[:-2], Row(above[-2].number, cells)]


def _count_headers(above: Sequence[Row], width: int) -> int:
    """Number of header rows right above the data, which have cells for at least half of the
    columns."""
    count = 0
    for row in reversed(above[-MOST_HEADERS:]):
        filled = sum(map(bool, row.cells))
        is_wide = filled >= width / 2 and len(unpadded(row.cells)) <= width + 1
        if not is_wide or (width > 1 and filled == 1):
            break
        count += 1
    return min(count, 1) if width == 1 else count


def _are_units(heads: Sequence[Sequence[str]]) -> bool:
    """Tell whether the last of several header rows holds units."""
    if len(heads) < 2:
        return False
    cells = [without_brackets(cell) for cell in heads[-1] if cell not in ("", "-", "[]", "()")]
    units = sum(is_unit(cell) and cell != "1" for cell in cells)
    return bool(cells) and units > len(cells) / 2


def _names_in(
    heads: Sequence[Row],
    above: Sequence[Row],
    comments: Sequence[Line],
    width: int,
    delimiter: str,
) -> list[str]:
    """Names of the columns; empty if there are none.

    They are those of the header row nearest to the data, if names repeat there joined with the row
    above. Without a header they stand in a line with another delimiter, or in a comment.
    """
    if heads:
        return _names_of_header([row.cells for row in heads], width, delimiter)
    texts = [delimiter.join(row.cells) for row in above[-1:]]
    texts += [line.text for line in reversed(comments)]
    delimiters = (
        re.escape(delimiter or ","), r"\t", ";", ",", r"\|", r"\s{2,}", r"(?<=[\])}])\s+", r"\s+",
    )  # fmt: skip
    for text in texts:
        for pattern in delimiters:
            cells = [cell.strip(' "') for cell in re.split(pattern, text.strip())]
            if len(cells) == width and not any(map(is_value, cells)):
                return cells
    return []


def _names_of_header(heads: Sequence[Sequence[str]], width: int, delimiter: str) -> list[str]:
    names = unpadded(heads[-1])
    if delimiter == " " and len(names) > width:  # `POS (ANAT)` is one name
        names = re.findall(r"\S+(?: [(\[]\S+)*", " ".join(names))
    # LabVIEW's last column is empty
    if len(names) == width + 1 and names[-1].casefold() == "comment":
        names = names[:width]
    filled = [name for name in names if name]
    if len(heads) < 2 or len(set(filled)) == len(filled):
        return names
    group = ""
    joined: list[str] = []
    groups = list(heads[-2])[:width]
    groups += [""] * (width - len(groups))
    for above, name in zip(groups, names, strict=False):
        group = above or group  # a name stands above the first of its columns
        joined.append(" ".join(part for part in (group, name) if part))
    return joined


def _labview_units(rows: Sequence[Row], names: Sequence[str]) -> list[str]:
    """Units in LabVIEW's line `Y_Unit_Label`, which has one for each signal, and none for time."""
    labels = next((row.cells[1:] for row in rows if row.cells[0] == "Y_Unit_Label"), [])
    # a column without a name is that of time where LabVIEW wrote none (`X_Columns No`)
    are_signals = [
        name not in ("", "Comment") and not is_clock(name_and_unit(name)[0]) for name in names
    ]
    filled = [label for label in labels if label]
    # if each signal has a time of its own, every second cell is empty
    remaining = iter(filled if len(filled) == sum(are_signals) else labels)
    return [next(remaining, "") if is_signal else "" for is_signal in are_signals]


def _without_footer(
    rows: Sequence[Row], first_value: int, layout: Layout
) -> tuple[list[Row], list[Row]]:
    """Part the data from the last rows that have a word in or before the first column of
    numbers."""
    end = len(rows)
    while end and layout.header in ("auto", "row") and len(rows) - end < LONGEST_FOOTER:
        cells = rows[end - 1].cells
        blank_above = [not cell for cell in rows[0].cells[:first_value]]
        before = [cell for cell, is_blank in zip(cells, blank_above, strict=False) if is_blank]
        if len(cells) <= first_value:
            break
        if all(_begins_with_value(cell) for cell in [*before, cells[first_value]]):
            break
        end -= 1
    if not end:
        return list(rows), []
    return list(rows[:end]), list(rows[end:])


def _begins_with_value(cell: str) -> bool:
    return is_value(cell) or is_value(cell.split(" ")[0])


def _cut_row(rows: Sequence[Row], width: int, is_whole: bool) -> str:
    """Say whether the last row is, or may be, cut off by an interrupted recorder; else empty."""
    if len(rows) < 2:
        return ""
    number, cells = rows[-1]
    if len(cells) < min(width, len(rows[-2].cells)):
        return f"the last line, {number}, is cut off and was skipped"
    if not is_whole and not _cells.is_last_whole([row.cells[-1] for row in rows]):
        return f"the last line, {number}, has no line break, may be cut in a number and was skipped"
    return ""


def share_above(count: int, total: int) -> float:
    """Round count / total up to three decimals, for the user to write."""
    return math.ceil(1000 * count / total) / 1000


FilledRow = tuple[int, Sequence[str | None]]


def _fitting_rows(rows: Sequence[Row], width: int, layout: Layout) -> list[FilledRow]:
    """The rows that have a cell for each name."""
    odd = [row for row in rows if len(row.cells) != width]
    if odd and (layout.ragged == "refuse" or len(odd) > layout.most_missing * len(rows)):
        share = share_above(len(odd), len(rows))
        more = f" and `most_missing: {share:g}`" if share > layout.most_missing else ""
        remedy = (
            f"repair these lines, or write `ragged: skip`{more} in the source file to leave"
            " them out"
        )
        widths = {len(row.cells) for row in odd}
        if len(widths) == 1 and len(odd) == len(rows):
            remedy = "write a name for each, and the same sign between names as between cells"
        raise InputError(
            f"line {odd[0].number} has {len(odd[0].cells)} cells under {width} names, and"
            f" {len(odd)} of {len(rows)} rows do not fit; {remedy}"
        )
    return [(row.number, row.cells) for row in rows if len(row.cells) == width]


def _with_dropped_variables(
    rows: Sequence[Row], width: int, missing: Collection[str]
) -> tuple[list[FilledRow], list[str]]:
    """Fill the rows of a logger that omits failed variables; None from there on.

    The omitted columns are those missing in the row before. The logger of `opensourceleg` writes
    its header late, with the first thousand rows: variables that failed before have no name in it.
    Their cells, those missing in the last row that has them, are left out.
    """
    remarks: list[str] = []
    rows, remark = _without_unnamed(rows, width, missing)
    if remark:
        remarks.append(remark)
    columns = list(range(width))
    filled: list[FilledRow] = []
    before: Sequence[str] = []
    for row in rows:
        if len(row.cells) != len(columns):
            failed = [
                column for column, cell in zip(columns, before, strict=False) if cell in missing
            ]
            if len(columns) - len(row.cells) != len(failed):
                raise InputError(
                    f"line {row.number} has {len(row.cells)} cells where {len(columns)} were, and"
                    f" {len(failed)} were missing in the line before: it is unknown which column"
                    " was omitted; cut the file off there"
                )
            columns = [column for column in columns if column not in failed]
            which = ", ".join(str(column + 1) for column in failed)
            remarks.append(f"from line {row.number} on, columns {which} are missing")
        by_column = dict(zip(columns, row.cells, strict=True))
        filled.append((row.number, [by_column.get(column) for column in range(width)]))
        before = row.cells
    return filled, remarks


def _without_unnamed(
    rows: Sequence[Row], width: int, missing: Collection[str]
) -> tuple[list[Row], str]:
    """Leave out cells of variables that failed before the header was written, and say so."""
    first = next((place for place, row in enumerate(rows) if len(row.cells) == width), 0)
    if not first:
        return list(rows), ""
    last_cells = rows[first - 1].cells
    unnamed = [place for place, cell in enumerate(last_cells) if cell in missing]
    widths = {len(row.cells) for row in rows[:first]}
    if not unnamed or widths != {width + len(unnamed)}:
        return list(rows), ""
    named = [
        Row(row.number, [cell for place, cell in enumerate(row.cells) if place not in unnamed])
        for row in rows[:first]
    ]
    which = ", ".join(str(place + 1) for place in unnamed)
    return (
        [*named, *rows[first:]],
        f"up to line {rows[first - 1].number}, cells {which} of every row have no name and were"
        " left out",
    )


def places_of(name: str, titles: Sequence[str]) -> list[int]:
    """Places of the columns with a name (with or without unit), pattern (`*`: any text) or number
    (from 1)."""
    plain = [name_and_unit(title)[0] for title in titles]
    for names in (titles, plain):
        if name in names:
            return [place for place, title in enumerate(names) if title == name]
    if "*" in name:
        pattern = re.compile(re.escape(name).replace(r"\*", ".*"), re.DOTALL)
        return [
            place
            for place, (title, plain_name) in enumerate(zip(titles, plain, strict=True))
            if pattern.fullmatch(title) or pattern.fullmatch(plain_name)
        ]
    if re.fullmatch(r"[1-9]\d{0,4}", name, re.ASCII) and int(name) <= len(titles):
        return [int(name) - 1]
    return []


def lasting_name(place: int, titles: Sequence[str]) -> str:
    """Name a column so that a source file finds it in the next recording too.

    That is its name without its unit where only one has it, or else its number. Of an object
    without a name Python prints its number, which changes from run to run: a pattern fits.
    """
    title = titles[place]
    name = name_and_unit(title)[0]
    pattern = re.sub(r"<[^<>]* object at 0x[0-9a-fA-F]+>", "*", name)
    for candidate in (pattern, name, title):
        if places_of(candidate, titles) == [place]:
            return candidate
    return str(place + 1)


def recording_of_table(
    format_name: str,
    table: Table,
    layout: Layout,
    noun: str = "line",
    *,
    facts: Mapping[str, Any],
    likely_units: Mapping[str, str] | None = None,
) -> Recording:
    """Make a channel of each column.

    Parameters
    ----------
    noun
        What a row is called: `line` of text, or `row` of a sheet, with its number in the file.
    likely_units
        Units by convention, by name.
    """
    rows = Rows(count=len(table.lines), lines=table.lines, noun=noun)
    channels: list[Channel] = []
    for place, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        cells = table.body.to_series(place)
        name = name_and_unit(title)[0]
        are_times = _cells.are_times(cells)
        likely = (likely_units or {}).get(name, "")
        if are_times:
            unit = "ns"
        channels.append(
            Channel(
                address={"column": lasting_name(place, table.names)},
                rows=rows,
                read=partial(_values_of, table, place, layout, noun, are_times),
                name=name,
                unit=unit,
                likely_unit="" if unit else name_and_ending(name)[1] or likely,
                kind=Kind.CLOCK if are_times else Kind.SIGNAL,
                count_words=partial(_words_of, table, place) if layout is LENIENT else None,
            )
        )

    count = rows.count + table.skipped
    loss = Loss(rows.count, count, table.end, remarks=table.remarks)
    delimiter = {"delimiter": table.delimiter} if table.delimiter else {}
    return Recording(
        format_name,
        channels,
        loss,
        notes=table.notes,
        facts={**facts, **delimiter},
        find_unlisted=column_finder(table.names, channels),
    )


def column_finder(
    titles: Sequence[str], channels: Sequence[Channel]
) -> Callable[[Mapping[str, str]], Channel | None]:
    """Give a function that finds the channel of a column by its title, as in the header, in any
    way that `places_of` knows."""

    def find_unlisted(address: Mapping[str, str]) -> Channel | None:
        wanted = address.get("column", "")
        places = places_of(wanted, titles)
        if len(places) > 1:
            which = listing([f"{place + 1} ('{titles[place]}')" for place in places])
            raise InputError(
                f"column '{wanted[:80]}' occurs {len(places)} times, as columns {which}; write a"
                " pattern or a name that only one has, or its number"
            )
        if places:
            return channels[places[0]]
        advice = nearest(wanted, titles) or "; correct the name in the source file"
        if len(titles) == 1:
            advice = "; state `delimiter` if these are several columns"
        raise InputError(
            f"column '{wanted[:80]}' is missing; the file has {listing(titles)}{advice}"
        )

    return find_unlisted


def _values_of(
    table: Table, place: int, layout: Layout, noun: str, are_times: bool
) -> NDArray[Any]:
    cells = table.body.to_series(place)
    if are_times:
        return _cells.cell_stamps(cells)
    try:
        return _cells.cell_values(cells, layout.missing, table.decimal)
    except UnreadableCellError as error:
        if layout is LENIENT:
            return _cells.readable_numbers(cells, table.decimal)
        cell = str(cells[error.place])
        title = table.names[place]
        raise InputError(
            f"{noun} {table.lines[error.place]}, column '{title}': '{cell[:40]}' is not a number;"
            f" {_remedy_for(cell, title, table.decimal)}"
        ) from error


def _words_of(table: Table, place: int) -> Mapping[str, int]:
    """Count the cells of a column that are no numbers, by what stands there."""
    cells = table.body.to_series(place)
    if cells.dtype != pl.String or _cells.are_times(cells):
        return {}
    is_word = np.isnan(_cells.readable_numbers(cells, table.decimal))
    return Counter(cells.filter(pl.Series(is_word)).drop_nulls().to_list())


def _remedy_for(cell: str, title: str, decimal: str) -> str:
    """Say what to do about a cell that is not a number."""
    if cell.casefold() in _cells.TRUTHS:
        return "name a column of numbers; a truth value can only be `sync` or `trigger`"
    is_time = re.search(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}", cell)
    if is_time:  # 2024-05-01T12:00:00, 12:00:00.5
        return "write time as seconds, or as `12:00:00.500` in every row"
    if cell == title:
        return (
            "the header stands here again, as where a recorder begins anew: cut the file in two, a"
            " log each"
        )
    if decimal == "," and "." in cell:
        return 'write `decimal: "."` in the source file if the full stop is the decimal sign'
    if re.fullmatch(r"[+-]?\d+,\d+", cell):
        return 'write `decimal: ","` in the source file if the comma is the decimal sign'
    word = json.dumps(cell[:40], ensure_ascii=False)
    return f"correct the cell, or add {word} to `missing` in the source file"
