# SPDX-License-Identifier: Apache-2.0
"""Find a table of numbers in rows of cells, of text or of a sheet: header, units, rows, footer.

Nothing is stated by the user: what most rows are like tells the columns, and the rows above them
are searched for names and units. Example: below `Time (s),Angle (deg),Torque (Nm)` a row `0.001,
1.5,12.25` gives three channels with their units.

Hand-written, since programs of measurement put text above, between and below the rows: of 54 text
files of laboratories this reads 53, a call of `polars.read_csv` with its options 42.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from statistics import mode
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.base.errors import InputError, listing, quoted, shortened
from osl_analysis.base.recording import SECOND_NS, Channel, End, Kind, Loss, Recording, Rows
from osl_analysis.base.source_file import ColumnChannel, ColumnTime, TableSource
from osl_analysis.base.units import is_clock, is_unit
from osl_analysis.formats.cell_forms import forms_of, plain_rows
from osl_analysis.formats.text_cells import (
    FIRST_LINES,
    LAST_LINES,
    MISSING,
    TIME_OF_CELL,
    WHOLE,
    Line,
    TextRow,
    are_times,
    cell_stamps,
    cell_values,
    decimal_of,
    is_number_cell,
    is_value,
    may_be_cut,
    name_and_unit,
    unpadded,
)

BRACKETS = "[](){}- "  # around a unit, or in its place
MOST_HEADERS = 4  # rows of names and units above the numbers
LEAST_VALUES = 0.5  # share of the cells of a column of numbers that are numbers
COMMENT_SIGNS = ("#", "%", "//")  # at the beginning of a line
STATED_ROWS = re.compile(
    r"(?i)\W*(?:total |(?:number|no\.?) of )?(?:samples|rows|frames|length|data"
    r" points)[\s:=,;]+(\d+)\b(?![.,]\d)"
)
"""Text above a table that states its number of rows."""


class SheetSource(TableSource):
    """The source file of a table of cells with a header, from any program."""

    channels: Mapping[str, ColumnChannel] = Field(min_length=1)
    time: ColumnTime
    # Cells that become NaN: what a logger writes if a reading failed.
    missing: tuple[str, ...] = MISSING


# to list what a file holds: rows that do not fit are left out, words are NaN, and both are told
LISTING = SheetSource.model_construct(channels={}, damaged="skip", most_missing=1.0)


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
        A column each of text, or of numbers where the format has them.
    notes
        Comments, and what stands above the header and below the rows.
    """

    names: list[str]
    units: list[str]
    lines: NDArray[np.int64]
    body: pl.DataFrame
    remarks: list[str]
    end: End
    notes: list[str] = field(default_factory=list)
    skipped: int = 0  # rows that do not fit the header
    has_forms: bool = False  # whether numbers stand within text of the cells
    header: Sequence[str] = ()  # the cells of the line above the rows
    delimiter: str = ""
    decimal: str = "."


class Shape(NamedTuple):
    """What most rows are like."""

    width: int
    first_value: int  # place of the first column that mostly has numbers, times or missing
    is_blank_before: bool
    value_places: frozenset[int]  # of the columns that mostly have values

    def is_header(self, cells: Sequence[str]) -> bool:
        """Tell whether a row holds names: different words over most columns of numbers."""
        over_values = [cells[place] for place in self.value_places if place < len(cells)]
        words = [
            cell for cell in over_values if re.search("[^\\W\\d_]{2}", cell) and not is_value(cell)
        ]
        return len(words) > len(over_values) / 2 and len({*words}) == len(words) > 1

    def begins(self, cells: Sequence[str]) -> bool:
        """Tell whether a row begins as data do, or may be cut off before its first number."""
        if self.is_blank_before and any(cells[: self.first_value]):
            return False
        return all(map(is_value, cells[self.first_value : self.first_value + 1]))


def table_of_rows(
    rows: Sequence[TextRow],
    comments: Sequence[Line],
    layout: SheetSource,
    delimiter: str,
    is_ended: bool,
) -> Table:
    """Find the table in rows of cells.

    Parameters
    ----------
    comments
        Lines of comments, with their signs.
    is_ended
        Whether the last line has a break, so that its last number is whole.

    Raises
    ------
    InputError
        There is no table of numbers, or rows do not fit the header.
    """
    forms = forms_of(rows)
    if forms:
        rows = plain_rows(rows, forms)
    remarks = [form.remark for form in forms]
    shape = _shape_of(rows)
    first = _first_row_of_data(rows, shape)
    last = len(rows) - 1  # it may be text, as of a footer
    while last > max(first, len(rows) - LAST_LINES) and not shape.begins(rows[last].cells):
        last -= 1
    above, footer = rows[:first], rows[last + 1 :]
    footnotes = [" ".join(row.cells) for row in footer]
    comment_texts = [line.text.strip(" \t#%/") for line in comments]
    head = _read_head(above, comment_texts, delimiter, shape)
    names = [*head.names]
    units = [*head.units]
    if len(names) == shape.width - 1 and _counts_rows([row.cells[0] for row in rows[first:]]):
        names.insert(0, "")  # as R writes the names of rows
        units.insert(0, "")
    for form in forms:
        if form.place < len(names):
            is_unnamed = names[form.place] in ("", str(form.place + 1))
            names[form.place] = form.name if is_unnamed and form.name else names[form.place]
            units[form.place] = units[form.place] or form.unit
    width = len(names)
    data = [TextRow(row.number, unpadded(row.cells, width)) for row in rows[first : last + 1]]
    if not data:
        raise InputError("no rows of data", "record it again, or exclude the trial")
    if footer:
        remarks.append(
            f"{len(footer)} lines below the table, from {footer[0].number} on, are no rows:"
            f" '{shortened(footnotes[0])}'"
        )
    cut = _cut_row(data, width, is_whole=is_ended or bool(footer))
    if cut:
        data = data[:-1]
        remarks.append(cut)
    header = above[-1].cells if above else []
    again = [row for row in data if row.cells == header]  # where a logger was reset
    if again and len(header) == width:
        remarks.append(
            f"the header stands again in line {listing([str(row.number) for row in again])}"
        )
        data = [row for row in data if row.cells != header]
    fitting = [row for row in data if len(row.cells) == width]
    skipped = len(data) - len(fitting)
    if skipped:
        remarks.append(_remark_on_widths(above, data, width, layout))
    cells_of_rows = [row.cells for row in fitting]
    columns = {str(place): pl.String for place in range(width)}
    return Table(
        names=[name or str(place) for place, name in enumerate(names, start=1)],
        units=units,
        lines=np.array([row.number for row in fitting], np.int64),
        body=pl.DataFrame(cells_of_rows, columns, orient="row"),
        notes=[*head.notes, *comment_texts, *footnotes],
        remarks=remarks,
        skipped=skipped,
        has_forms=bool(forms),
        header=header,
        end=End.MISSING if cut else End.UNKNOWN,
        delimiter=delimiter,
        decimal=decimal_of(cells_of_rows),
    )


def _shape_of(rows: Sequence[TextRow]) -> Shape:
    """Tell what most rows are like; refuse them if they hold no numbers."""
    if not rows:
        raise InputError("holds no rows", "record it again, or exclude the trial")
    middle = rows[len(rows) // 2]
    sample = [row.cells for row in rows[:FIRST_LINES]]
    width = mode(map(len, sample))
    typical = [cells for cells in sample if len(cells) == width]
    typical = typical[len(typical) // 2 :]  # the first rows may be a header
    value_places = []
    for place in range(width):
        cells = [row[place] for row in typical if row[place]]
        if len(rows) > 1 and cells and sum(map(is_value, cells)) >= LEAST_VALUES * len(cells):
            value_places.append(place)
    if value_places:
        first = value_places[0]
        is_blank_before = not any(middle.cells[:first])
        return Shape(width, first, is_blank_before, frozenset(value_places))
    raise InputError(
        f"no table of numbers: most of its {len(rows)} rows hold none, such as line"
        f" {middle.number}, '{shortened(' '.join(middle.cells))}'",
        "name a recording, or write a header and a row per sample",
    )


def _first_row_of_data(rows: Sequence[TextRow], shape: Shape) -> int:
    """Place of the first row that is as wide as most and begins as data do. Rows above it of which
    more than half of the cells are numbers are data that lack cells or have a word."""
    first = 0
    for row in rows:
        is_typical = len(row.cells) == shape.width and shape.begins(row.cells)
        if is_typical and not _counts(row.cells) and not shape.is_header(row.cells):
            break
        first += 1
    while first:
        cells = rows[first - 1].cells
        filled = [cell for cell in cells if cell]
        are_numbers = sum(map(is_number_cell, filled)) > len(filled) / 2
        is_keyed = shape.is_blank_before and any(cells[: shape.first_value])
        is_short = len(cells) <= max(1, shape.width / 2)
        if is_short or is_keyed or not are_numbers or _counts(cells):
            break
        first -= 1
    return first


def _counts_rows(cells: Sequence[str]) -> bool:
    """Tell whether cells are the numbers of their rows, from any number on."""
    if not all(cell.isdecimal() for cell in cells):
        return False
    numbers = [int(cell) for cell in cells]
    return all(later - earlier == 1 for earlier, later in pairwise(numbers))


def _counts(cells: Sequence[str]) -> bool:
    """Tell whether a row states the number of rows, or has no value at all."""
    filled = [cell for cell in cells if cell]
    return not any(map(is_value, filled)) or STATED_ROWS.match(" ".join(filled)) is not None


class _Head(NamedTuple):
    """What stands above the rows of a table."""

    names: list[str]  # of the columns
    units: list[str]  # of the columns; empty where none is stated
    notes: list[str]  # other text


# a number with decimals among names, as in `Delta_X,0.004`, tells that a row holds no names
DECIMAL_NUMBER = re.compile(r"[+-]?\d+[.,]\d\S*")


def _read_head(
    above: Sequence[TextRow], comments: Sequence[str], delimiter: str, shape: Shape
) -> _Head:
    """Find names and units of the columns, and other text, in the rows above the data.

    Names are sought in four places, in this order: in the rows right above the data; in a row that
    a word such as `TraceName` begins, among rows of a name and values; in a comment; in the last
    row above, by another delimiter. Units are in a row of names and units, in a row that `unit`
    begins, or in brackets behind the names.
    """
    width = shape.width
    texts = [" ".join(filter(None, row.cells)) for row in above]
    candidates = [
        row
        for row, text in zip(above, texts, strict=True)
        if shape.is_header(row.cells)
        or not (STATED_ROWS.match(text) or any(map(DECIMAL_NUMBER.fullmatch, row.cells)))
    ]
    candidate_cells = [row.cells for row in candidates]
    line_of_data = above[-1].number + 1 if above else 0

    header = _header_rows(candidates, line_of_data, width)
    keyed_names = _names_behind_key(candidate_cells, width)
    if _are_values_by_column(header) and (keyed_names or _repeats_values(header)):
        header = keyed_names[-1:]
    if not header:
        last_row = [delimiter.join(cells) for cells in candidate_cells[-1:]]
        split_texts = [_split_names(text, width, delimiter) for text in [*comments, *last_row]]
        header = [names for names in split_texts if names]
    header, units = _part_units(header)
    if not units:
        units = _units_behind_key(candidate_cells, width)
    if delimiter == " " and len(units) < width:
        units = []  # it is unknown which column has none

    names = _names_in(header, bool(units), width)
    if len(names) > width:
        names = _split_names(delimiter.join(names), width, delimiter) or names
    units += [""] * (len(names) - len(units))
    units = [unit or name_and_unit(name)[1] for name, unit in zip(names, units, strict=False)]
    notes = [text for row, text in zip(above, texts, strict=True) if row.cells not in header[-1:]]
    return _Head(names, units, notes)


def _header_rows(rows: Sequence[TextRow], line_of_data: int, width: int) -> list[list[str]]:
    """Cells of the rows of names and units that stand together above the data, the upper first."""
    header: list[list[str]] = []
    line_below = line_of_data
    for number, cells in reversed(rows[-MOST_HEADERS:]):
        has_blank_line_below = number + 1 < line_below
        if header and has_blank_line_below and not _are_units(header[0]):
            break
        line_below = number
        filled = sum(map(bool, cells))
        is_wide = filled >= width / 2 and len(unpadded(cells)) <= width + 1
        is_aligned = bool(header) and len(unpadded(cells)) == width
        is_title = filled == 1 < width
        is_second_of_one_column = width == 1 and bool(header)
        if not (is_wide or is_aligned) or is_title or is_second_of_one_column:
            break
        header.insert(0, cells)
    return header


def _names_behind_key(rows: Sequence[list[str]], width: int) -> list[list[str]]:
    """Names in rows such as `TraceName,ANGLE,TORQUE`, as oscilloscopes write them among rows of a
    name and values."""
    return [
        ["", *cells[1:]][-width:]
        for cells in rows
        if re.search("(?i)name|label", cells[0]) and len(unpadded(cells)) in (width, width + 1)
    ]


def _are_values_by_column(header: Sequence[list[str]]) -> bool:
    """Whether the row right above the data has a value of each column, as `Period,2,2`; also where
    there is no such row."""
    return not header or all(map(is_value, header[-1][1:]))


def _repeats_values(header: Sequence[list[str]]) -> bool:
    """Whether a value stands twice in the row right above the data, as no name does."""
    values = header[-1][1:] if header else []
    return len({*values}) < len(values)


def _part_units(header: list[list[str]]) -> tuple[list[list[str]], list[str]]:
    """The rows of names, and the units of the lowest row of units; empty if there is none."""
    # from below; remarks may stand below the units, or the names themselves
    for place in reversed(range(len(header))):
        if len(header) > 1 and _are_units(header[place]):
            units = [cell.strip(BRACKETS) for cell in header[place]]
            return header[:place] or header[1:], units
    return header, []


def _units_behind_key(rows: Sequence[list[str]], width: int) -> list[str]:
    """The units of a row such as `Y_Unit_Label,deg,Nm` of LabVIEW; empty if there is none."""
    for cells in rows:
        if re.search(r"(?i)unit", cells[0]) and _are_units(cells[1:]):
            return ["", *cells[1:width]]
    return []


def _names_in(header: Sequence[list[str]], have_units: bool, width: int) -> list[str]:
    """Names of the columns in rows of names; their numbers where there are none. `have_units`
    tells that a row of units stood there too."""
    if not header:
        return [str(place + 1) for place in range(width)]
    names = [
        "" if is_number_cell(name) or TIME_OF_CELL.match(name) else name for name in header[-1]
    ]
    names = unpadded(names)
    above_units = [cells for cells in header if have_units and len({*cells}) == len(cells) == width]
    # else of devices, or their ranges, as `20deg`
    above_units.sort(
        key=lambda cells: (not any(map(is_clock, cells)), any(cell[:1].isdigit() for cell in cells))
    )
    if above_units and not any(map(is_value, above_units[0])):
        names = above_units[0]  # those below them are remarks
    elif len(header) > 1 and not all(names):  # the rest of the names is above
        words = [
            [text for text in over if not is_value(text)] for over in zip(*header, strict=False)
        ]
        names = [" ".join(over) for over in words]
    if len(names) == width + 1 and names[-1].casefold() == "comment":
        names = names[:width]  # LabVIEW's last column is empty
    return names


def _are_units(cells: Sequence[str]) -> bool:
    """Tell whether most cells are units."""
    filled = [*filter(None, (cell.strip(BRACKETS) for cell in cells))]
    units = sum(is_unit(cell) and cell != "1" for cell in filled)
    return units > len(filled) / 2


def _split_names(text: str, width: int, delimiter: str) -> list[str]:
    """Names of the columns in a comment, or a line with another delimiter than the rows; empty if
    there are none. `POS (ANAT)` may be one name."""
    delimiters = (
        re.escape(delimiter or ","),
        r"\t",
        ";",
        ",",
        r"\|",
        r"\s{2,}",
        r"(?<=[\])}])\s+",
        r"\s+",
        r"\s+(?![\[({])",
    )
    for pattern in delimiters:
        cells = [cell.strip(' "') for cell in re.split(pattern, text.strip())]
        if len(cells) == width and not any(map(is_value, cells)):
            return cells
    return []


def _cut_row(rows: Sequence[TextRow], width: int, is_whole: bool) -> str:
    """Say whether the last row is, or may be, cut off by an interrupted recorder; else empty."""
    if len(rows) < 2:
        return ""
    number, cells = rows[-1]
    is_short = len(cells) < min(width, len(rows[-2].cells))
    if is_short or (not is_whole and may_be_cut(rows)):
        return f"the last line, {number}, is cut off, or may be within a number, and was skipped"
    return ""


def _remark_on_widths(
    above: Sequence[TextRow], rows: Sequence[TextRow], width: int, layout: SheetSource
) -> str:
    """Tell of rows that do not have a cell for each name; refuse them if they are not to be
    skipped, or if all are such. Where lines `above` the table stand again, a recorder began anew.
    """
    odd = [row for row in rows if len(row.cells) != width]
    number, cells = odd[0]
    what = (
        f"line {number} has {len(cells)} cells under {width} names, '{shortened(' '.join(cells))}',"
        f" and {len(odd)} of {len(rows)} rows do not fit"
    )
    if layout.damaged == "skip" and len(odd) < len(rows):
        return what
    if [row.cells for row in odd if row.cells in [head.cells for head in above]]:
        raise InputError(
            f"{what}: lines from above the table stand there again, where another recording or"
            " segment begins",
            f"cut the file before line {number}, and give each part a row of the sheet",
        )
    raise InputError(
        what, "repair these lines: a cell for each name, and one sign between all cells"
    )


def lasting_names(titles: Sequence[str]) -> list[str]:
    """Name columns so that a source file finds them in the next recording too.

    That is the name without its unit where only one has it, or else the number. Of an object
    without a name Python prints its number, which changes from run to run: a pattern fits.
    """
    names = [name_and_unit(title)[0] for title in titles]
    patterns = [re.sub(r"<[^<>]* object at 0x[0-9a-fA-F]+>", "*", name) for name in names]
    lasting = [str(place + 1) for place in range(len(titles))]
    for candidates in (titles, names, patterns):
        counts = Counter(candidates)
        for place, name in enumerate(candidates):
            if counts[name] == 1:
                lasting[place] = name
    return lasting


def recording_of_table(
    format_name: str,
    table: Table,
    layout: SheetSource,
    noun: str = "line",
    *,
    facts: Mapping[str, Any],
    likely_units: Mapping[str, str] = MappingProxyType({}),
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
    channels = []
    for lasting, title, unit, cells in zip(
        lasting_names(table.names), table.names, table.units, table.body, strict=True
    ):
        name = name_and_unit(title)[0]
        channel = Channel(
            address={"column": lasting},
            rows=rows,
            read=partial(_values_of, cells, title, rows, layout, table.decimal),
            name=name,
            title=title,
            unit=unit,
            likely_unit=likely_units.get(name, ""),
        )
        if are_times(cells):
            read = partial(cell_stamps, cells)
            channel = replace(channel, read=read, unit="ns", kind=Kind.CLOCK)
        channels.append(channel)
    channels += stamps_in_two_columns(channels, table.body)
    loss = Loss(rows.count, rows.count + table.skipped, table.end, remarks=table.remarks)
    return Recording(format_name, channels, loss, notes=table.notes, facts=facts)


PARTS_OF_SECOND = (10**3, 10**6, 10**9)  # ticks of the second column in a second
REST_OF_STAMP = re.compile(r"(?i)(n(ano)?_?s(ec(ond)?s?)?|u(sec)?s?|micro\w*|nanos|milli\w*|ms)$")


def stamps_in_two_columns(channels: Sequence[Channel], body: pl.DataFrame) -> list[Channel]:
    """A clock of each two neighbouring columns that are seconds and the rest of a second, as
    `ros2 topic echo --csv` writes a stamp: the rest begins anew where the seconds rise."""
    clocks = []
    whole = [_whole_numbers(cells) for cells in body]
    for place, (seconds, subseconds) in enumerate(pairwise(whole)):
        if seconds is None or subseconds is None or subseconds.size < 2 or subseconds.min() < 0:
            continue
        ticks = next((ticks for ticks in PARTS_OF_SECOND if ticks > subseconds.max()), 0)
        rises = np.diff(seconds)
        falls = np.diff(subseconds) < 0
        goes_on = bool(ticks) and bool((np.diff(seconds * ticks + subseconds) >= 0).all())
        is_named = bool(REST_OF_STAMP.search(channels[place + 1].name))
        if not goes_on or not ((rises > 0) == falls).all() or not (falls.any() or is_named):
            continue
        name = f"{channels[place].key} + {channels[place + 1].key}"
        stamps_ns = seconds * SECOND_NS + subseconds * (SECOND_NS // ticks)
        clocks.append(
            replace(
                channels[place],
                address={"column": name},
                name=name,
                title=name,
                unit="ns",
                kind=Kind.CLOCK,
                read=partial(np.asarray, stamps_ns),
            )
        )
    return clocks


def _whole_numbers(cells: pl.Series) -> NDArray[np.int64] | None:
    """The whole numbers of a column, (n,); None of another column."""
    if cells.dtype == pl.String:
        if not cells[:FIRST_LINES].str.contains(WHOLE).all():
            return None
        cells = cells.cast(pl.Int64, strict=False)
    if not cells.dtype.is_integer() or cells.null_count():
        return None
    return cells.cast(pl.Int64).to_numpy()


def _values_of(
    cells: pl.Series, title: str, rows: Rows, layout: SheetSource, decimal: str
) -> NDArray[Any]:
    """Read the numbers or truth values of a column; another cell is refused, NaN in a listing, or
    infinite where it may be left out."""
    values, unread = cell_values(cells, layout.missing, decimal)
    numbers = [float(word) for word in layout.missing if is_number_cell(word)]
    is_missing = np.isin(values, numbers)
    if is_missing.any():
        values = np.where(is_missing, np.nan, values)
    if not unread.size or layout is LISTING:
        return values
    if layout.damaged == "skip":
        values[unread] = np.inf  # as an overload: another damage than an empty cell
        return values
    place = int(unread[0])
    cell = shortened(str(cells[place]))
    if unread.size == len(cells):
        raise InputError(
            f"column '{title}' holds no number: its first cell is '{cell}'",
            "name another column, or write one number a cell",
        )
    raise InputError(
        f"{rows.place(place)}, column '{title}': '{cell}' is not a number",
        "name another column, write numbers as 1234.5e-3, none between thousands, and times as"
        f" 12:00:00.500 in every row, or add {quoted(cell)} to `missing`"
        " in the source file",
    )
