"""A log in CSV to canonical columns, by a source file."""

from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import CsvTable, read_csv_table
from osl_analysis.formats.csv_text import UnreadableCellError, numbers
from osl_analysis.ingest.csv_source import CsvSource
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array, check_time

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
        raw, absent = column_of(table, place, source)
        missing[column] = missing_in(table, place, absent, source)
        try:
            columns.append(pl.Series(column, channel.to_si(raw, unit_of(column), table.units[place])))
        except InputError as error:
            where = f"{path}: column '{channel.column}'"
            raise InputError(f"{where}: {error}, as `unit` of {column} in the source file") from error
        if channel.counter is not None:
            columns.append(counter_of(table, channel.counter, source).alias(counter_column(column)))
        origins[column] = channel.origin(column, table.units[place])
    facts = {
        "time": {**source.time.model_dump(exclude_none=True), "start": start},
        "rates_hz": {path.name: median_rate(time)},
        "missing": missing,
        "comments": table.comments[:COMMENTS],
    }
    return Recording(pl.DataFrame(columns), origins, facts, csv_warnings(table, source, missing))


def median_rate(time: Array) -> float | None:
    """Median sampling rate [Hz] of stamps (n,) [s]; None for a single row, or if most rows repeat a stamp."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    return 1 / step if step > 0 else None


def time_of(table: CsvTable, source: CsvSource) -> tuple[Array, float]:
    """Time [s] of every row since the first one, and the reading of the clock in the first row."""
    if source.time.rate is not None:
        return np.arange(len(table.rows)) / source.time.rate, 0.0
    place = table.column(str(source.time.column))
    unit = source.time.unit if source.time.unit is not None else table.units[place]
    try:
        factor = si_factor(unit, "s")
    except InputError as error:
        raise InputError(f"{table.path}: column '{source.time.column}': {error}, under `time`") from error
    raw, absent = column_of(table, place, source)
    if absent.any():
        line = table.rows[int(np.argmax(absent))][0]
        raise InputError(f"{table.path}: line {line}: no time in column '{source.time.column}'; remove the line")
    time = (raw - raw[0]) * factor
    check_time(f"{table.path}, column '{source.time.column}'", time)
    return time, float(raw[0])


def column_of(table: CsvTable, place: int, source: CsvSource) -> tuple[Array, NDArray[np.bool_]]:
    """Numbers of one column, (rows,), NaN where they are missing; and which are missing, (rows,).

    Raises
    ------
    InputError
        A cell is not a number.
    """
    cells = table.cells(place)
    try:
        values, absent = numbers(cells, source.missing, source.decimal)
    except UnreadableCellError as error:
        text = str(cells[error.place])
        raise InputError(
            f"{table.path}: line {table.rows[error.place][0]}, column '{table.names[place]}': '{text[:40]}' is not "
            f"a number; add the word to `missing`, or state `decimal`, `header` or `units_row`"
        ) from error
    return values, absent


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
            f"{first}; at most {source.most_missing:.1%} may be: repair the log, or raise `most_missing`"
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
