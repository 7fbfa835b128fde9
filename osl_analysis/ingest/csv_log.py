"""A log in CSV: its source file, its reader, and what it holds."""

import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import (
    DELIMITERS,
    CsvLayout,
    CsvTable,
    Rows,
    UnreadableCellError,
    check_header_place,
    delimiter_of,
    is_number_cell,
    name_and_unit,
    numbers,
    read_csv_table,
    read_lines,
    share_above,
    split_rows,
    unpadded,
    without_brackets,
)
from osl_analysis.ingest.overview import (
    NAME_OF_TIME,
    UNKNOWN,
    Overview,
    RecordedChannel,
    guessed_units,
    is_clock,
    lasting_name,
    likely_clock,
    likely_unit,
    range_text,
    unit_of_clock,
)
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import Conversion, LogSource
from osl_analysis.ingest.table_log import LEVEL, RowStamps, RowTime, Share, since_first
from osl_analysis.ingest.units import TimeUnit, base_units, normalised, si_factor
from osl_analysis.trial import Array

Delimiter = Literal["auto", ",", ";", "tab", "space", "|"]


def text_of_number(value: Any) -> Any:
    """A column's number as text; anything else as it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


ColumnName = Annotated[str, BeforeValidator(text_of_number)]


class CsvChannel(Conversion):
    """One column. Without `unit`, the file's unit is used: in brackets after the column's name, or in a row of
    units."""

    column: ColumnName
    """Name in the header, with or without its unit (`torque` finds `torque [Nm]`); a pattern in which `*` stands for
    any text, which must fit one column (`"*.output_position"`); or the column's number, counted from 1."""
    counter: ColumnName | None = None
    """Name of the column in which the device counts its samples. It tells which samples are missing."""


class CsvTime(RowTime):
    """Where the time of a row comes from: a column, or the rate at which rows were written."""

    column: ColumnName | None = None
    """Name of the column that holds time."""
    unit: TimeUnit | None = None
    """Unit of the column. Without it, the file's unit is used."""

    @model_validator(mode="after")
    def _one(self) -> "CsvTime":
        if (self.column is None) == (self.rate is None):
            raise ValueError("state either the column that holds time or the rate of the rows [Hz]")
        return self


class CsvSource(LogSource):
    """A log in CSV. An incomplete last row is always skipped, with a warning."""

    format: Literal["csv"]
    """Format of the file."""
    delimiter: Delimiter = "auto"
    """Sign between cells; `auto` takes the first of tab, `;`, `|` and `,` that all lines have."""
    decimal: Literal[".", ","] = "."
    """Decimal sign."""
    comment: str = "#"
    """Sign at the beginning of comment lines; empty if there are none."""
    header: Literal["row", "comment", "none"] = "row"
    """Place of the columns' names: the first row, the last comment line, or none."""
    units_row: bool = False
    """Whether a row of units follows the header."""
    missing: tuple[str, ...] = ("", "nan", "NaN")
    """Cells that become NaN: what the logger writes where a reading failed."""
    most_missing: Share = 0.01
    """Largest share of a column's cells that may be missing, and of the rows that may be skipped. More where a column
    has a lower rate than the rows."""
    extra_cells: Literal["refuse", "first", "last"] = "refuse"
    """Cells without a name: what every row has more than the header. `first` or `last`, as they stand there, leaves
    them out (R writes the rows' names first). A log whose rows fit its header is read as it is."""
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"
    """Treatment of rows whose length differs from the header's.

    `refuse`: the file is refused. `skip`: they are skipped and counted. `dropped_variable`, for a logger that omits a
    variable after it failed: from there on, the columns that were missing in the last complete row are NaN. A row that
    this does not explain is refused.
    """
    time: CsvTime
    """Where the time of a row comes from."""
    channels: dict[str, CsvChannel] = Field(min_length=1)
    """The column of each canonical column."""

    @model_validator(mode="after")
    def _units_below_header(self) -> "CsvSource":
        if self.units_row and self.header != "row":
            raise ValueError("a row of units needs a header row above it")
        return self

    @property
    def layout(self) -> CsvLayout:
        return CsvLayout(**{one.name: getattr(self, one.name) for one in fields(CsvLayout)})


DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}")  # such as 2024-05-01T12:00:00 and 12:00:00.5
TRUTHS = {"true": "1", "false": "0"}
COMMENTS = 100  # lines of a file's own header that the provenance keeps


def read_csv_log(path: Path, source: CsvSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first row.

    A cell with one of the words for a failed reading becomes NaN. Such cells are counted in the facts and warnings.
    """
    table = read_csv_table(path, source.layout)
    time, start = time_of(table, source)
    columns, origins, missing = [pl.Series("time", time)], {}, {}
    for column, channel in source.channels.items():
        place = table.column(channel.column)
        raw, absent = column_of(table, place, source, level=unit_of(column) == LEVEL)
        missing[column] = missing_in(table, place, absent, source)
        try:
            columns.append(pl.Series(column, channel.to_si(raw, unit_of(column), table.units[place])))
        except InputError as error:
            where = f"{path}: column '{table.names[place]}'"
            raise InputError(f"{where}: {error}, as {source.place('channels', column, 'unit')}") from error
        if channel.counter is not None:
            columns.append(counter_of(table, channel.counter, source).alias(counter_column(column)))
        origins[column] = {**channel.origin(column, table.units[place]), **matched(table, channel.column, place)}
    check_own_columns(table, source)
    stamps = RowStamps(time, source.time)
    facts = {**stamps.facts(path.name, start), "missing": missing, "comments": table.comments[:COMMENTS]}
    if not table.complete:
        facts["damage"] = {"complete": False}
    repeats = f"{path.name}: {stamps.repeats} of {time.size} rows repeat the stamp of the row before"
    warnings = [*csv_warnings(table, source, missing), *stamps.repeats_text(repeats, source.place("time"))]
    return Recording(pl.DataFrame(columns).filter(pl.Series(stamps.kept)), origins, facts, warnings)


def check_own_columns(table: CsvTable, source: CsvSource) -> None:
    """Refuse two signals of different units, such as angle and torque, from one column of the file."""
    by_place: dict[int, str] = {}
    for column, channel in source.channels.items():
        place = table.column(channel.column)
        other = by_place.setdefault(place, column)
        if unit_of(other) != unit_of(column):
            raise InputError(
                f"{table.path}: column '{table.names[place]}' is {other} and {column} in the source file; correct "
                f"{source.place('channels', column, 'column')}"
            )


def matched(table: CsvTable, given: str, place: int) -> dict[str, str]:
    """The column's name in the file, where the source file gives a pattern or a number."""
    return {} if name_and_unit(table.names[place])[0] == name_and_unit(given)[0] else {"found": table.names[place]}


def time_of(table: CsvTable, source: CsvSource) -> tuple[Array, float]:
    """Time [s] of every row since the first one, and the reading of the clock in the first row."""
    if source.time.rate is not None:
        return np.arange(len(table.lines)) / source.time.rate, 0.0
    place = table.column(str(source.time.column))
    unit = source.time.unit if source.time.unit is not None else table.units[place]
    try:
        factor = si_factor(unit, "s")
    except InputError as error:
        where = f"{table.path}: column '{table.names[place]}'"
        raise InputError(f"{where}: {error}, as {source.place('time', 'unit')}") from error
    whole = table.cells(place).cast(pl.Int64, strict=False)
    if not whole.null_count():  # nanoseconds since 1970, which floats would round
        raw: NDArray[Any] = whole.to_numpy()
    else:
        raw, absent = column_of(table, place, source)
        if absent.any():
            line = table.lines[int(np.argmax(absent))]
            raise InputError(f"{table.path}: line {line}: no time in column '{source.time.column}'; remove the line")
    what = f"{table.path}, column '{table.names[place]}'"
    advice = "rows; take another column, or state the rate of the rows: `time: {rate: 1000}`"
    return since_first(raw, factor, what, advice), float(raw[0])


def column_of(
    table: CsvTable, place: int, source: CsvSource, *, level: bool = False
) -> tuple[Array, NDArray[np.bool_]]:
    """Numbers of one column, (rows,), NaN where they are missing; and which are missing, (rows,).

    In a `level` the words `True` and `False`, in any capitals, are 1 and 0, as Python's loggers write them.
    """
    cells: Any = table.cells(place)
    if level:
        cells = [TRUTHS.get(cell.casefold(), cell) if cell is not None else None for cell in cells]
    try:
        values, absent = numbers(cells, source.missing, source.decimal)
    except UnreadableCellError as error:
        text = str(cells[error.place])
        raise InputError(
            f"{table.path}: line {table.lines[error.place]}, column '{table.names[place]}': '{text[:40]}' is not "
            f"a number; {remedy_for(text, table, place, source, first=error.place == 0)}"
        ) from error
    return values, absent


def remedy_for(text: str, table: CsvTable, place: int, source: CsvSource, first: bool) -> str:
    """What to do about a cell that is not a number; `first`: it stands in the first row of data."""
    is_time = source.time.column is not None and place == table.column(source.time.column)
    if text.casefold() in TRUTHS:
        return "name a column of numbers; a truth value can only be `sync` or `trigger`"
    if DATE.search(text):
        return "write time as seconds, or state the rate of the rows in place of the column: `time: {rate: 1000}`"
    if text == table.names[place]:
        return "the header stands here again: cut the file in two, a log each"
    if source.decimal == "," and "." in text:
        return 'write `decimal: "."` in the source file if the full stop is the decimal sign'
    if re.fullmatch(r"[+-]?\d+,\d+", text):
        return 'write `decimal: ","` in the source file if the comma is the decimal sign'
    if first and source.header == "none":
        return "write `header: row` in the source file if this line holds the columns' names"
    if first and base_units(normalised(without_brackets(text))) is not None:
        return "write `units_row: true` in the source file if this line holds units"
    if is_time:
        return "correct the cell, or delete the line"
    return f"correct the cell, or add {json.dumps(text[:40], ensure_ascii=False)} to `missing` in the source file"


def counter_of(table: CsvTable, name: str, source: CsvSource) -> pl.Series:
    """The device's count of its samples, (rows,); refused where it is missing or not whole."""
    place = table.column(name)
    raw, _ = column_of(table, place, source)
    wrong = raw != np.rint(raw)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{table.path}: line {table.lines[row]}, column '{name}': {raw[row]} is no count of samples; remove "
            "`counter` from the source file, or the line from the log"
        )
    return pl.Series(raw.astype(np.int64))


def missing_in(table: CsvTable, place: int, absent: NDArray[np.bool_], source: CsvSource) -> int:
    """Number of missing cells of a column. A column with too many is refused."""
    count = int(absent.sum())
    if count > source.most_missing * absent.size:
        first = table.lines[int(np.argmax(absent))]
        raise InputError(
            f"{table.path}: column '{table.names[place]}' is missing in {count} of {absent.size} rows, first in line "
            f"{first}; at most {source.most_missing:.1%} may be: repair the log, or write "
            f"`most_missing: {share_above(count, absent.size):g}` in the source file"
        )
    return count


def csv_warnings(table: CsvTable, source: CsvSource, missing: dict[str, int]) -> list[str]:
    """What was repaired, what is missing, and where the unit of the file differs from that of the source file."""
    name, found = table.path.name, list(table.notes)
    found += [f"{name}: {column} is missing in {n} of {len(table.lines)} rows" for column, n in missing.items() if n]
    for column, channel in source.channels.items():
        theirs = table.units[table.column(channel.column)]
        if channel.unit and theirs and theirs != channel.unit:
            found.append(f"{name}: {column} is read in {channel.unit}; the file says {theirs}")
    return found


COMMENT = "#"
MOST_WORDS = 5
MOST_COMMENTS = 20
LEAST_NUMBERS = 0.5  # share of the rows in which one column at least must hold a number: what has less is prose
SAMPLE = 5  # rows in which a decimal comma is sought


def inspect_csv(path: Path) -> Overview:
    lines = read_lines(path)
    comments = [text for _, text in lines if text.lstrip().startswith(COMMENT)]
    content = [(line, text) for line, text in lines if not text.lstrip().startswith(COMMENT)]
    delimiter = delimiter_of(content, "auto")
    rows = split_rows(path, content, delimiter)
    if not rows:
        raise InputError(f"{path}: holds no rows; check that it is a recording")
    headed = not all(is_number_cell(cell.replace(",", ".")) for cell in rows[0][1] if cell)
    first = unpadded(rows[0][1], 0)
    names = first if headed else [str(place + 1) for place in range(len(first))]
    body = [(line, unpadded(cells, len(names))) for line, cells in (rows[1:] if headed else rows)]
    if headed:
        check_header_place(path, rows[0], body)
    has_units = headed and bool(body) and is_units_row(body[0][1])
    units, body = (body[0][1], body[1:]) if has_units else ([], body)
    if not body:
        raise InputError(f"{path}: no rows of data below the header; check that it is a recording")
    check_numbers(path, body)
    named = {name: numbers_of(cells_of(body, place)).to_numpy() for place, name in enumerate(names) if is_clock(name)}
    clock, left_open = likely_clock(named)
    channels = list(column_channels(names, units, body, clock))
    facts = {"rows": str(len(body)), "delimiter": repr(delimiter), "header": "yes" if headed else "none"}
    facts |= {f"comment {i + 1}": text.strip() for i, text in enumerate(comments[:MOST_COMMENTS])}
    remarks = [*odd_rows(body, len(names)), *guessed_units(channels, "column")]
    time = None if clock is None else channels[names.index(clock)]
    settings = settings_of(time, len(names), body, delimiter, headed, has_units)
    return Overview("csv", facts, channels, remarks, settings, open=left_open)


def is_units_row(cells: list[str]) -> bool:
    """Whether a row below the header holds units: no number, and a unit in most of its cells."""
    known = [
        bool(cell) and base_units(normalised(without_brackets(cell))) is not None and cell != "1" for cell in cells
    ]
    return not any(is_number_cell(cell.replace(",", ".")) for cell in cells) and sum(known) > len(cells) / 2


def check_numbers(path: Path, rows: Rows) -> None:
    """Refuse text that is no table: most of its rows hold no number."""
    numeric = sum(any(is_number_cell(cell.replace(",", ".")) for cell in cells) for _, cells in rows)
    if rows and numeric < LEAST_NUMBERS * len(rows):
        line, cells = next(row for row in rows if not any(is_number_cell(cell.replace(",", ".")) for cell in row[1]))
        raise InputError(
            f"{path}: no table of numbers: {len(rows) - numeric} of {len(rows)} rows hold none, such as line {line}, "
            f"'{' '.join(cells)[:40]}'; name a recording, or write a header and a row per sample"
        )


def settings_of(
    clock: RecordedChannel | None, width: int, rows: Rows, delimiter: str, headed: bool, has_units: bool
) -> dict[str, object]:
    settings: dict[str, object] = {"clock": "master"}
    settings["delimiter"] = {sign: name for name, sign in DELIMITERS.items()}.get(delimiter, delimiter)
    settings |= {} if headed else {"header": "none"}
    settings |= {"units_row": True} if has_units else {}
    decimal_comma = delimiter != "," and any("," in cell for _, cells in rows[:SAMPLE] for cell in cells)
    settings |= {"decimal": ","} if decimal_comma else {}
    if rows and all(len(cells) == len(rows[0][1]) > width for _, cells in rows):
        settings["extra_cells"] = UNKNOWN
    if clock is None:
        settings["time"] = {"column": NAME_OF_TIME, "unit": UNKNOWN}
    else:
        settings["time"] = {"column": clock.address["column"], "unit": clock.unit or clock.likely_unit or UNKNOWN}
    return settings


def cells_of(rows: Rows, place: int) -> pl.Series:
    """The cells of a column; empty where a row is too short."""
    return pl.Series([cells[place] if place < len(cells) else "" for _, cells in rows], dtype=pl.String)


def numbers_of(cells: pl.Series) -> pl.Series:
    """Cells as numbers; null for any other text."""
    return cells.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)


def column_channels(names: list[str], units: list[str], rows: Rows, clock: str | None) -> Iterator[RecordedChannel]:
    """Every column with its range, and the words in it that are not numbers."""
    for place, title in enumerate(names):
        name, unit = name_and_unit(title)
        unit = unit or (without_brackets(units[place]) if place < len(units) else "")
        cells = cells_of(rows, place)
        values = numbers_of(cells)
        words = Counter(cells.filter(values.is_null()).to_list()).most_common(MOST_WORDS)
        known = values.drop_nulls().to_numpy()
        note = range_text(known, title == clock) + "".join(f", {count} x '{word}'" for word, count in words)
        address = {"column": lasting_name(name, names)}
        guess = "" if unit else likely_unit(name) or (unit_of_clock(known) if title == clock else "")
        yield RecordedChannel("column", address, unit, int(known.size), None, note, likely_unit=guess)


def odd_rows(rows: Rows, width: int) -> Iterator[str]:
    for length, count in Counter(len(cells) for _, cells in rows).items():
        if length != width:
            first = next(line for line, cells in rows if len(cells) == length)
            yield f"{count} rows have {length} cells under {width} names, the first in line {first}"
