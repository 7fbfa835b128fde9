"""A log in a table of OpenSim (.mot, .sto): its source file, its reader, and what it holds."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import polars as pl
from pydantic import Field, PositiveInt, field_validator, model_validator

from osl_analysis.columns import unit_of
from osl_analysis.errors import InputError
from osl_analysis.formats.opensim_table import OpenSimTable, read_opensim
from osl_analysis.ingest.column_names import clocks_among, likely_unit
from osl_analysis.ingest.draft_places import NAME_OF_TIME, UNKNOWN
from osl_analysis.ingest.likely_clock import likely_clock
from osl_analysis.ingest.opensim_plates import OpenSimPlate, plate_load, plate_signals, plates_text
from osl_analysis.ingest.overview import Overview, RecordedChannel, gaps_text, rate_of
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import Axis, misplaced, right_handed, rotation_of
from osl_analysis.ingest.table_log import Table, TableColumn, read_table_log
from osl_analysis.ingest.table_source import TableChannel, TableSource, TableTime
from osl_analysis.ingest.unit_names import TimeUnit, Unit
from osl_analysis.ingest.units import si_factor

ANGLES = {"rad": {"deg": "deg", "rad": "rad"}, "rad/s": {"deg": "deg/s", "rad": "rad/s"}}
"""By canonical unit, the unit that the header's `inDegrees` means."""
ENDINGS = {r"force.*_v[xyz]": "N", r"force.*_p[xyz]": "m", r"(torque|moment).*_[xyz]|_moment": "N*m", r"_t[xyz]": "m"}
"""Unit that OpenSim gives to columns of these names."""


class OpenSimChannel(TableChannel):
    """One column."""

    ADDRESS: ClassVar[str] = "column"

    column: str
    """Name of the column."""
    unit: Unit
    """Unit of the column. The file states only whether its angles are in degrees, which is checked."""


class OpenSimTime(TableTime):
    """Where the time of a row comes from: the column `time`, in seconds, unless something else is stated."""

    ADDRESS: ClassVar[str] = "column"

    column: str | None = "time"
    """Name of the column that holds time."""
    unit: TimeUnit | None = "s"
    """Unit of the column."""


class OpenSimSource(TableSource):
    """A log in a table of OpenSim."""

    format: Literal["opensim"]
    """Format of the file."""
    time: OpenSimTime = OpenSimTime()
    """Where the time of a row comes from."""
    clock: Literal["master", "sync", "shared", "common"] = "master"  # type: ignore[assignment]
    """As in every log, and `common`: its times are those of the capture in TRC, which was exported with it."""
    channels: dict[str, OpenSimChannel] = Field(default={})
    """The column of each canonical column."""
    plates: dict[PositiveInt, OpenSimPlate] = Field(default={})
    """Force plates by number, counted from 1."""
    axes: tuple[Axis, Axis, Axis] = ("x", "-z", "y")
    """The file's axes that point forward, to the left and up, for its plates. OpenSim's own are x forward, y up."""

    @field_validator("axes")
    @classmethod
    def _right_handed(cls, axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
        return right_handed(axes)

    @model_validator(mode="after")
    def _not_empty(self) -> "OpenSimSource":
        if not self.channels and not self.plates:
            raise misplaced("name the columns to read under `channels`, or plates under `plates`", "channels")
        if self.clock == "common" and (self.time.column is None or self.time.unit != "s"):
            raise misplaced("`clock: common` needs the column of time in s, as {column: time, unit: s}", "time")
        return self


def read_opensim_log(path: Path, source: OpenSimSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first row.

    Raises
    ------
    InputError
        The header contradicts the rows or the source file's unit of an angle, a column is missing or holds no numbers,
        or the source file is refused by `read_table_log`.
    """
    table = read_opensim(path)
    check_angles(table, source)
    facts = {"header": table.header, "clock": source.clock}
    rows = Table(path, len(table.rows), lambda name: TableColumn(table.column(name)), facts=facts)
    recording = read_table_log(rows, source)
    return with_plates(table, recording, source) if source.plates else recording


def with_plates(table: OpenSimTable, recording: Recording, source: OpenSimSource) -> Recording:
    """A recording with the plates that the source file names."""
    time = recording.samples["time"].to_numpy()
    if time.size != len(table.rows):
        raise InputError(
            f"{table.path}: rows that repeat a stamp were left out, but the plates need all; remove `repeated: drop`, "
            f"as {source.place('time', 'repeated')}"
        )
    loads = [plate_load(table, number, plate, time) for number, plate in source.plates.items()]
    columns, origins, plates = plate_signals(loads, rotation_of(source.axes))
    samples = recording.samples.with_columns(**{name: pl.Series(values) for name, values in columns.items()})
    facts = {**recording.facts, "plates": plates}
    return replace(recording, samples=samples, columns={**recording.columns, **origins}, facts=facts)


def check_angles(table: OpenSimTable, source: OpenSimSource) -> None:
    """Refuse a unit of an angle that is not the one which the header's `inDegrees` means."""
    for column, channel in source.channels.items():
        canonical = unit_of(column)
        own = ANGLES.get(canonical, {}).get(table.angles)
        if own is not None and not np.isclose(si_factor(channel.unit, canonical), si_factor(own, canonical)):
            raise InputError(
                f"{table.path}: its header says inDegrees={table.header['indegrees']}, and column '{channel.column}' "
                f"is read in {channel.unit}; write {own}, as {source.place('channels', column, 'unit')}"
            )


def inspect_opensim(path: Path) -> Overview:
    """Columns with range and likely unit; raises InputError as `read_opensim`."""
    table = read_opensim(path)
    remarks: list[str] = []
    clock, left_open = likely_clock({name: table.column(name) for name in clocks_among(table.names)})
    facts = {"rows": str(len(table.rows))} | {key: value for key, value in table.header.items() if value}
    channels = list(columns_of(table, clock, remarks))
    guessed = [f"{one.address['column']} [{one.likely_unit}]" for one in channels if one.likely_unit]
    remarks += [f"units guessed from the names, to be checked: {', '.join(guessed)}"] * bool(guessed)
    time = {"column": clock or NAME_OF_TIME, "unit": "s" if clock else UNKNOWN}
    note, settings = plates_text(table.names), {"clock": "master", "time": time}
    return Overview("opensim", facts, channels, remarks, settings, open=left_open, draft_note=note)


def columns_of(table: OpenSimTable, clock: str | None, remarks: list[str]) -> Iterator[RecordedChannel]:
    """Every column for the list; what holds no numbers is remarked."""
    for name in dict.fromkeys(table.names):
        try:
            values = table.column(name)
        except InputError as error:
            remarks.append(str(error).removeprefix(f"{table.path}: "))
            continue
        known = values[np.isfinite(values)]
        note = f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
        if name == clock:
            note = f"a clock, {rate_of(known) or 0:g} per unit{', ' * bool(gaps_text(known))}{gaps_text(known)}"
        guess = "" if name == clock else opensim_unit(name, table.angles)
        yield RecordedChannel("column", {"column": name}, "", int(known.size), None, note, likely_unit=guess)


def opensim_unit(name: str, angles: str) -> str:
    """The unit that a column's name tells: of a force, a position, a moment; of a coordinate by `inDegrees`."""
    known = [unit for pattern, unit in ENDINGS.items() if re.search(f"({pattern})$", name, re.IGNORECASE)]
    return likely_unit(name) or (known[0] if known else angles)
