"""A log that is one table of numbers, to canonical columns: the steps that JSON lines, TDMS and OpenSim share."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError
from osl_analysis.ingest.csv_log import LEVEL
from osl_analysis.ingest.recording import Recording, check_values
from osl_analysis.ingest.row_time import RowStamps, since_first
from osl_analysis.ingest.table_source import TableChannel, TableSource
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array


@dataclass(frozen=True)
class TableColumn:
    """One column of a file."""

    values: NDArray[Any]
    """Its numbers (rows,), in the type of the file; NaN where a reading failed."""
    present: NDArray[np.bool_] | None = None
    """Where it has a value, (rows,); None if everywhere."""
    unit: str = ""
    """Its unit, as the file spells it; empty where the file gives none."""


@dataclass(frozen=True)
class Table:
    """A file as one table."""

    path: Path
    """Where it is."""
    rows: int
    """Number of its rows."""
    column: Callable[[str], TableColumn]
    """The column of a name; raises InputError if there is none, or it holds no numbers."""
    notes: Sequence[str] = ()
    """What was repaired, a sentence each."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Further facts for the trial's provenance."""


def read_table_log(table: Table, source: TableSource, own_time: Array | None = None) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first row.

    own_time: time (rows,) [s] of each row, where the format itself tells it and the source file names nothing else.

    Raises
    ------
    InputError
        A column is missing, holds no numbers, infinity or too many NaN, a unit is unknown, or time goes back.
    """
    path = table.path
    time, start = time_of(table, source, own_time)
    check_own_columns(path, source)
    columns, origins, missing, absent = [pl.Series("time", time)], {}, {}, []
    for column, channel in source.channels.items():
        found = column_of(table, column, channel)
        with np.errstate(invalid="ignore"):  # a signalling NaN is one, too
            raw = found.values.astype(np.float64)
        present = np.ones(raw.size, bool) if found.present is None else found.present
        what = f"{path}: {channel.ADDRESS} '{channel.name}'"
        check_values(what, np.where(present, raw, 0.0), time, source.most_missing)
        missing[column] = int(np.isnan(raw[present]).sum())
        converted = pl.Series(column, in_si(channel, raw, column, found.unit, what, source))
        columns.append(converted if present.all() else converted.set(pl.Series(~present), None))
        absent += absent_text(channel, present)
        if channel.counter is not None:
            columns.append(counter_of(table, channel, time).alias(counter_column(column)))
        origins[column] = channel.origin(column, found.unit)
    stamps = RowStamps(time, source.time)
    facts = {**stamps.facts(path.name, start), "missing": missing, **table.facts}
    said = [*absent, *(f"{column} is NaN in {n} of {time.size} rows" for column, n in missing.items() if n)]
    repeats = f"{path.name}: {stamps.repeats} of {time.size} rows repeat the stamp of the row before"
    warnings = [*table.notes, *(f"{path.name}: {text}" for text in said)]
    warnings += stamps.repeats_text(repeats, source.place("time"))
    return Recording(pl.DataFrame(columns).filter(pl.Series(stamps.kept)), origins, facts, warnings)


def absent_text(channel: TableChannel, present: NDArray[np.bool_]) -> list[str]:
    """A warning about a column without a value in some rows, (rows,)."""
    if present.all():
        return []
    count, first = int((~present).sum()), int(np.argmin(present)) + 1
    return [f"{channel.ADDRESS} '{channel.name}' has no value in {count} of {present.size} rows, first row {first}"]


def in_si(channel: TableChannel, raw: Array, column: str, unit: str, what: str, source: TableSource) -> Array:
    """A column's numbers in SI units; a refusal names the column and the place of its unit."""
    try:
        return channel.to_si(raw, unit_of(column), unit)
    except InputError as error:
        raise InputError(f"{what}: {error}, as {source.place('channels', column, 'unit')}") from error


def column_of(table: Table, column: str, channel: TableChannel) -> TableColumn:
    """The column of the file for a canonical column; truth values only for a level."""
    found = named_column(table, channel.name)
    if found.values.dtype == bool and unit_of(column) != LEVEL:
        raise InputError(
            f"{table.path}: {channel.ADDRESS} '{channel.name}' holds truth values and no numbers in "
            f"{unit_of(column)}; name another one in the source file"
        )
    return found


def named_column(table: Table, name: str) -> TableColumn:
    """A column of the file; every refusal names the file."""
    try:
        return table.column(name)
    except InputError as error:
        raise InputError(str(error) if str(table.path) in str(error) else f"{table.path}: {error}") from error


def time_of(table: Table, source: TableSource, own_time: Array | None) -> tuple[Array, float]:
    """Time [s] of every row since the first one, and the reading of the clock in the first row."""
    path, stated = table.path, source.time
    if stated.name is None:
        own = np.arange(table.rows) / stated.rate if stated.rate is not None else own_time
        assert own is not None  # the model of the source file asks for a rate or a name where the file has no time
        return own - own[0], float(own[0])
    what = f"{path}: {stated.ADDRESS} '{stated.name}'"
    found = named_column(table, stated.name)
    raw = found.values
    lacking = np.isnan(raw.astype(np.float64)) | (False if found.present is None else ~found.present)
    if raw.dtype == bool or lacking.any():
        where = f"in row {int(np.argmax(lacking)) + 1} of {raw.size}" if raw.dtype != bool else "but truth values"
        raise InputError(f"{what}: no time {where}; take another one, or state the rate: `time: {{rate: 1000}}`")
    unit = stated.unit if stated.unit is not None else found.unit
    try:
        factor = si_factor(unit, "s")
    except InputError as error:
        raise InputError(f"{what}: {error}, as {source.place('time', 'unit')}") from error
    advice = "rows; take another one, or state the rate of the rows: `time: {rate: 1000}`"
    return since_first(raw, factor, what, advice), float(raw[0])


def check_own_columns(path: Path, source: TableSource) -> None:
    """Refuse two signals of different units, such as angle and torque, from one column of the file."""
    by_name: dict[str, str] = {}
    for column, channel in source.channels.items():
        other = by_name.setdefault(channel.name, column)
        if unit_of(other) != unit_of(column):
            raise InputError(
                f"{path}: {channel.ADDRESS} '{channel.name}' is {other} and {column} in the source file; correct "
                f"{source.place('channels', column, channel.ADDRESS)}"
            )


def counter_of(table: Table, channel: TableChannel, time: Array) -> pl.Series:
    """The device's count of its samples, (rows,); refused where it is missing or not whole."""
    found = named_column(table, str(channel.counter))
    raw = found.values.astype(np.float64)
    wrong = (raw != np.rint(raw)) | (False if found.present is None else ~found.present)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{table.path}: {channel.ADDRESS} '{channel.counter}': {raw[row]} in row {row + 1}, at {time[row]:.3f} s, "
            "is no count of samples; remove `counter` from the source file, or the row from the log"
        )
    return pl.Series(found.values.astype(np.int64))
