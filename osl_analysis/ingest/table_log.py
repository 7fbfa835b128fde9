"""A log that is one table of rows: time of the rows, its source file, and the steps to canonical columns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, model_validator

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError
from osl_analysis.ingest.recording import Recording, check_values
from osl_analysis.ingest.source_fields import Conversion, LogSource, Stamps
from osl_analysis.ingest.units import TimeUnit, si_factor
from osl_analysis.trial import Array, check_time
from osl_analysis.yaml_settings import Settings

Share = Annotated[float, Field(ge=0, le=1)]

LEVEL = "V"  # unit of the columns that may be read from truth values: levels of `sync` and `trigger`


class RowTime(Settings):
    """What a source file may state of the time of rows, besides where it stands."""

    unit: TimeUnit | None = None
    """Unit of the numbers that are time."""
    rate: PositiveFloat | None = None
    """Rows per second [Hz], for a file without time."""
    repeated: Literal["keep", "drop"] = "keep"
    """Rows whose stamp is that of the row before. `keep`: they are samples whose stamps were rounded. `drop`: the
    recorder read a device faster than it sampled; only the first row of each stamp is used."""
    stamps: Stamps = "auto"
    """How the stamps are taken."""


@dataclass(frozen=True)
class RowStamps:
    """The stamps of the rows of a file."""

    time: Array  # time (rows,) [s] since the first row
    stated: RowTime  # what the source file states of it

    @cached_property
    def fresh(self) -> NDArray[np.bool_]:
        """Rows whose stamp is not that of the row before, (rows,)."""
        return np.concatenate([[True], np.diff(self.time) != 0])

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Rows that are used, (rows,)."""
        return self.fresh if self.stated.repeated == "drop" else np.ones_like(self.fresh)

    @property
    def repeats(self) -> int:
        return int((~self.fresh).sum())

    def facts(self, file: str, start: float) -> dict[str, Any]:
        """What is known of the time of a file, for the trial's provenance; `start` is the clock's first reading."""
        return {
            "time": {**self.stated.model_dump(exclude_none=True), "start": start},
            "rates_hz": {file: median_rate(self.time[self.kept])},
            "repeated_stamps": self.repeats,
        }

    def repeats_text(self, repeats: str, place: str) -> list[str]:
        """A warning of what was done with rows that repeat a stamp, if there are any.

        `repeats` is a sentence that counts them, `place` is where the source file states the time.
        """
        if not self.repeats:
            return []
        if self.stated.repeated == "drop":
            return [f"{repeats} and were left out"]
        return [
            f"{repeats} and are taken for samples whose stamps were rounded; if the device was read faster than it "
            f"sampled, write `repeated: drop` under {place}"
        ]


def median_rate(time: Array) -> float | None:
    """Median sampling rate [Hz] of stamps (n,) [s]; None for a single row, or if most rows repeat a stamp."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    return 1 / step if step > 0 else None


def since_first(raw: NDArray[Any], factor: float, what: str, advice: str) -> Array:
    """Time (n,) [s] since the first reading of a clock, from its readings (n,) and their unit [s]."""
    time = np.asarray((raw - raw[0]) * factor, dtype=np.float64)
    check_time(what, time)
    if time.size > 1 and time[0] == time[-1]:
        raise InputError(f"{what}: time stands still at {raw[0]:g} in all {time.size} {advice}")
    return time


class TableChannel(Conversion):
    """One column of numbers."""

    ADDRESS: ClassVar[str]
    """The field that names the column: `column`, `field` or `channel`."""

    counter: str | None = None
    """Name of the column in which the device counts its samples. It tells which samples are missing."""

    @property
    def name(self) -> str:
        return str(getattr(self, self.ADDRESS))

    @property
    def title(self) -> str:
        return f"{self.ADDRESS} '{self.name}'"


class TableTime(RowTime):
    """Where the time of a row comes from: a column, or the rate at which rows were written."""

    ADDRESS: ClassVar[str]
    """The field that names the column, as in `TableChannel`."""
    IN_FILE: ClassVar[bool] = False
    """Whether the format itself tells when a sample was taken."""

    @property
    def name(self) -> str | None:
        given: str | None = getattr(self, self.ADDRESS)
        return given

    @property
    def title(self) -> str:
        return f"{self.ADDRESS} '{self.name}'"

    @model_validator(mode="after")
    def _one(self) -> "TableTime":
        given = [value for value in (self.name, self.rate) if value is not None]
        if len(given) > 1 or not (given or self.IN_FILE):
            raise ValueError(f"state either the {self.ADDRESS} that holds time, or the rate of the rows [Hz]")
        if self.unit is not None and self.name is None:
            raise ValueError(f"`unit` is that of the {self.ADDRESS} of time; name the {self.ADDRESS}, or remove it")
        return self


class TableSource(LogSource):
    """A log that is one table of numbers."""

    most_missing: Share = 0.01
    """Largest share of a column's numbers that may be NaN, and of the rows that may be skipped."""
    time: Any
    """Where the time of a row comes from."""
    channels: dict[str, Any] = Field(min_length=1)
    """The column of each canonical column."""


@dataclass(frozen=True)
class TableColumn:
    """One column of a file."""

    values: NDArray[Any]  # its numbers (rows,), in the type of the file; NaN where a reading failed
    present: NDArray[np.bool_] | None = None  # where it has a value, (rows,); None if everywhere
    unit: str = ""  # its unit, as the file spells it; empty where the file gives none


@dataclass(frozen=True)
class Table:
    """A file as one table."""

    path: Path
    rows: int
    column: Callable[[str], TableColumn]
    """The column of a name; raises InputError if there is none, or it holds no numbers."""
    notes: Sequence[str] = ()  # what was repaired, a sentence each
    facts: Mapping[str, Any] = field(default_factory=dict)  # further facts for the trial's provenance
    noun: str = "row"  # what messages call a row


def read_table_log(table: Table, source: TableSource, own_time: Array | None = None) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first row.

    own_time: time (rows,) [s] of each row, where the format itself tells it and the source file names nothing else.
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
        what = f"{path}: {channel.title}"
        check_values(what, np.where(present, raw, 0.0), time, source.most_missing)
        missing[column] = int(np.isnan(raw[present]).sum())
        try:
            converted = pl.Series(column, channel.to_si(raw, unit_of(column), found.unit))
        except InputError as error:
            raise InputError(f"{what}: {error}, as {source.place('channels', column, 'unit')}") from error
        if not present.all():
            converted = converted.set(pl.Series(~present), None)
            count = f"{int((~present).sum())} of {present.size} rows, first row {int(np.argmin(present)) + 1}"
            absent.append(f"{channel.title} has no value in {count}")
        columns.append(converted)
        if channel.counter is not None:
            columns.append(counter_of(table, channel, time).alias(counter_column(column)))
        origins[column] = channel.origin(column, found.unit)
    stamps = RowStamps(time, source.time)
    facts = {**stamps.facts(path.name, start), "missing": missing, **table.facts}
    said = [*absent, *(f"{column} is NaN in {n} of {time.size} {table.noun}s" for column, n in missing.items() if n)]
    many = f"{path.name}: {stamps.repeats} of {time.size} {table.noun}s"
    repeats = f"{many} repeat the stamp of the {table.noun} before"
    warnings = [*table.notes, *(f"{path.name}: {text}" for text in said)]
    warnings += stamps.repeats_text(repeats, source.place("time"))
    return Recording(pl.DataFrame(columns).filter(pl.Series(stamps.kept)), origins, facts, warnings)


def column_of(table: Table, column: str, channel: TableChannel) -> TableColumn:
    """The column of the file for a canonical column; truth values only for a level."""
    found = named_column(table, channel.name)
    if found.values.dtype == bool and unit_of(column) != LEVEL:
        raise InputError(
            f"{table.path}: {channel.title} holds truth values and no numbers in "
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
    what = f"{path}: {stated.title}"
    found = named_column(table, stated.name)
    raw = found.values
    lacking = np.isnan(raw.astype(np.float64)) | (False if found.present is None else ~found.present)
    if raw.dtype == bool or lacking.any():
        where = (
            f"in {table.noun} {int(np.argmax(lacking)) + 1} of {raw.size}" if raw.dtype != bool else "but truth values"
        )
        raise InputError(f"{what}: no time {where}; take another one, or state the rate: `time: {{rate: 1000}}`")
    unit = stated.unit if stated.unit is not None else found.unit
    try:
        factor = si_factor(unit, "s")
    except InputError as error:
        raise InputError(f"{what}: {error}, as {source.place('time', 'unit')}") from error
    advice = f"{table.noun}s; take another one, or state the rate of the {table.noun}s: `time: {{rate: 1000}}`"
    return since_first(raw, factor, what, advice), float(raw[0])


def check_own_columns(path: Path, source: TableSource) -> None:
    """Refuse two signals of different units, such as angle and torque, from one column of the file."""
    by_name: dict[str, str] = {}
    for column, channel in source.channels.items():
        other = by_name.setdefault(channel.name, column)
        if unit_of(other) != unit_of(column):
            raise InputError(
                f"{path}: {channel.title} is {other} and {column} in the source file; correct "
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
            f"{table.path}: {channel.ADDRESS} '{channel.counter}': {raw[row]} in {table.noun} {row + 1}, at "
            f"{time[row]:.3f} s, is no count of samples; remove `counter` from the source file, or the {table.noun} "
            "from the log"
        )
    return pl.Series(found.values.astype(np.int64))
