"""A log in CSV to canonical columns, by a source file."""

import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError
from osl_analysis.formats.csv_rows import share_above
from osl_analysis.formats.csv_table import CsvTable, read_csv_table
from osl_analysis.formats.csv_text import UnreadableCellError, name_and_unit, numbers, without_brackets
from osl_analysis.ingest.csv_source import CsvSource
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.row_time import RowStamps, since_first
from osl_analysis.ingest.units import base_units, normalised, si_factor
from osl_analysis.trial import Array

DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}")  # such as 2024-05-01T12:00:00 and 12:00:00.5
LEVEL = "V"
"""Unit of the columns that may be read from truth values: levels of `sync` and `trigger`."""
TRUTHS = {"true": "1", "false": "0"}
COMMENTS = 100  # lines of a file's own header that the provenance keeps


def read_csv_log(path: Path, source: CsvSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first row.

    A cell with one of the words for a failed reading becomes NaN. Such cells are counted in the facts and warnings.

    Raises
    ------
    InputError
        A column is missing, a cell is not a number, too many cells are missing, a unit is unknown, or time goes
        back.
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
        return np.arange(len(table.rows)) / source.time.rate, 0.0
    place = table.column(str(source.time.column))
    unit = source.time.unit if source.time.unit is not None else table.units[place]
    try:
        factor = si_factor(unit, "s")
    except InputError as error:
        where = f"{table.path}: column '{table.names[place]}'"
        raise InputError(f"{where}: {error}, as {source.place('time', 'unit')}") from error
    raw, absent = whole_numbers(table.cells(place)) or column_of(table, place, source)
    if absent.any():
        line = table.rows[int(np.argmax(absent))][0]
        raise InputError(f"{table.path}: line {line}: no time in column '{source.time.column}'; remove the line")
    what = f"{table.path}, column '{table.names[place]}'"
    advice = "rows; take another column, or state the rate of the rows: `time: {rate: 1000}`"
    return since_first(raw, factor, what, advice), float(raw[0])


def whole_numbers(cells: Sequence[str | None] | pl.Series) -> tuple[NDArray[np.int64], NDArray[np.bool_]] | None:
    """Stamps (rows,) as whole numbers, such as nanoseconds since 1970, which floats would round; None if any is not."""
    whole = pl.Series(cells, dtype=pl.String).cast(pl.Int64, strict=False)
    return None if whole.null_count() else (whole.to_numpy(), np.zeros(len(cells), dtype=bool))


def column_of(
    table: CsvTable, place: int, source: CsvSource, *, level: bool = False
) -> tuple[Array, NDArray[np.bool_]]:
    """Numbers of one column, (rows,), NaN where they are missing; and which are missing, (rows,).

    In a `level` the words `True` and `False`, in any capitals, are 1 and 0, as Python's loggers write them.

    Raises
    ------
    InputError
        A cell is not a number.
    """
    cells = table.cells(place)
    if level:
        cells = [TRUTHS.get(cell.casefold(), cell) if cell is not None else None for cell in cells]
    try:
        values, absent = numbers(cells, source.missing, source.decimal)
    except UnreadableCellError as error:
        text = str(cells[error.place])
        raise InputError(
            f"{table.path}: line {table.rows[error.place][0]}, column '{table.names[place]}': '{text[:40]}' is not "
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
    if first and si_like(text):
        return "write `units_row: true` in the source file if this line holds units"
    if is_time:
        return "correct the cell, or delete the line"
    return f"correct the cell, or add {json.dumps(text[:40], ensure_ascii=False)} to `missing` in the source file"


def si_like(text: str) -> bool:
    """Whether a text is a unit of any column."""
    return base_units(normalised(without_brackets(text))) is not None


def counter_of(table: CsvTable, name: str, source: CsvSource) -> pl.Series:
    """The device's count of its samples, (rows,); refused where it is missing or not whole."""
    place = table.column(name)
    raw, _ = column_of(table, place, source)
    wrong = raw != np.rint(raw)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{table.path}: line {table.rows[row][0]}, column '{name}': {raw[row]} is no count of samples; remove "
            "`counter` from the source file, or the line from the log"
        )
    return pl.Series(raw.astype(np.int64))


def missing_in(table: CsvTable, place: int, absent: NDArray[np.bool_], source: CsvSource) -> int:
    """Number of missing cells of a column. A column with too many is refused."""
    count = int(absent.sum())
    if count > source.most_missing * absent.size:
        first = table.rows[int(np.argmax(absent))][0]
        raise InputError(
            f"{table.path}: column '{table.names[place]}' is missing in {count} of {absent.size} rows, first in line "
            f"{first}; at most {source.most_missing:.1%} may be: repair the log, or write "
            f"`most_missing: {share_above(count, absent.size):g}` in the source file"
        )
    return count


def csv_warnings(table: CsvTable, source: CsvSource, missing: dict[str, int]) -> list[str]:
    """What was repaired, what is missing, and where the unit of the file differs from that of the source file."""
    name, found = table.path.name, list(table.notes)
    found += [f"{name}: {column} is missing in {n} of {len(table.rows)} rows" for column, n in missing.items() if n]
    for column, channel in source.channels.items():
        theirs = table.units[table.column(channel.column)]
        if channel.unit and theirs and theirs != channel.unit:
            found.append(f"{name}: {column} is read in {channel.unit}; the file says {theirs}")
    return found
