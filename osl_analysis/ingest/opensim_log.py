"""A log in a table of OpenSim (.mot, .sto): its source file, its force plates, its reader, and what it holds.

OpenSim's files of ground reactions have, per plate, the force on the foot, the point at which it acts, and the moment
about this point. Columns differ by their last letter: `ground_force_vx`, `ground_force_vy`, `ground_force_vz`.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import polars as pl
from pydantic import Field, PositiveInt, model_validator

from osl_analysis.columns import AXES, plate_columns, unit_of
from osl_analysis.errors import InputError, printable
from osl_analysis.formats.opensim_table import OpenSimTable, read_opensim
from osl_analysis.ingest.capture import PlateLoad, geometry
from osl_analysis.ingest.overview import (
    NAME_OF_TIME,
    UNKNOWN,
    Overview,
    RecordedChannel,
    clocks_among,
    gaps_text,
    likely_clock,
    likely_unit,
    rate_of,
)
from osl_analysis.ingest.plates import channel_facts
from osl_analysis.ingest.recording import Recording, check_finite
from osl_analysis.ingest.source_fields import Axes, misplaced, rotation_of
from osl_analysis.ingest.table_log import Table, TableChannel, TableColumn, TableSource, TableTime, read_table_log
from osl_analysis.ingest.units import TimeUnit, Unit, si_factor
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

ANGLES = {"rad": {"deg": "deg", "rad": "rad"}, "rad/s": {"deg": "deg/s", "rad": "rad/s"}}
"""By canonical unit, the unit that the header's `inDegrees` means."""
ENDINGS = {r"force.*_v[xyz]": "N", r"force.*_p[xyz]": "m", r"(torque|moment).*_[xyz]|_moment": "N*m", r"_t[xyz]": "m"}
"""Unit that OpenSim gives to columns of these names."""

Point = tuple[float, float, float]


class OpenSimPlate(Settings):
    """One plate. The file states neither units, which are N, m and N*m in OpenSim, nor where the plate lies."""

    force: str
    """Beginning of the names of the force's columns [N]: `R_ground_force_v`."""
    point: str
    """Beginning of the names of the columns of the point of application [m]: `R_ground_force_p`."""
    moment: str
    """Beginning of the names of the columns of the moment about this point [N*m]: `R_ground_torque_`."""
    corners: tuple[Point, Point, Point, Point]
    """Corners of the surface in the file's axes [m]."""
    sign: Literal[1, -1] = 1
    """-1 if the file has the force on the plate instead of the force on the foot."""


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
    axes: Axes = ("x", "-z", "y")
    """The file's axes that point forward, to the left and up, for its plates. OpenSim's own are x forward, y up."""

    @model_validator(mode="after")
    def _not_empty(self) -> "OpenSimSource":
        if not self.channels and not self.plates:
            raise misplaced("name the columns to read under `channels`, or plates under `plates`", "channels")
        if self.clock == "common" and (self.time.column is None or self.time.unit != "s"):
            raise misplaced("`clock: common` needs the column of time in s, as {column: time, unit: s}", "time")
        return self


def read_opensim_log(path: Path, source: OpenSimSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first row."""
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


def plate_load(table: OpenSimTable, number: int, plate: OpenSimPlate, time: Array) -> PlateLoad:
    """Force and moment about the centre of the plate, on the foot, in the file's axes.

    time: (rows,) [s], for messages and the rate.
    """
    names = [f"{begin}{axis}" for begin in (plate.force, plate.point, plate.moment) for axis in AXES]
    columns = np.column_stack([table.column(name) for name in names])
    for name, values in zip(names, columns.T, strict=True):
        check_finite(f"{table.path}: column '{name}'", values, time)
    force, point, moment = plate.sign * columns[:, :3], columns[:, 3:6], plate.sign * columns[:, 6:]
    centre = np.mean(plate.corners, axis=0)
    about = moment + np.cross(point - centre, force)
    origin = plate.model_dump(include={"force", "point", "moment", "sign"})
    rate = float(1 / np.median(np.diff(time))) if time.size > 1 else 1.0
    raw = channel_facts([*names[:3], *names[6:]], columns[:, [0, 1, 2, 6, 7, 8]], force, rate)
    return PlateLoad(number, 2, np.array(plate.corners), force, about, origin, raw)


def plate_signals(loads: list[PlateLoad], rotation: Array) -> tuple[dict[str, Array], dict[str, Any], list[Any]]:
    """Columns in our axes, their origins, and the plates' geometry for the trial's provenance.

    rotation: from the file's axes to ours, (3, 3).
    """
    columns: dict[str, Array] = {}
    origins: dict[str, Any] = {}
    for load in loads:
        for quantity, values in (("force", load.force), ("moment", load.moment)):
            for column, turned in zip(plate_columns(load.number, quantity), (values @ rotation.T).T, strict=True):
                columns[column] = turned
                origins[column] = {"plate": load.number, **load.origin, "si_unit": unit_of(column)}
    return columns, origins, [geometry(load, rotation) for load in loads]


def plates_text(names: Sequence[str]) -> str:
    """The plates that the names of columns tell, as a source file has them but for their corners; empty if none."""
    plates = [
        f"{number}: {{{', '.join(f'{key}: {json.dumps(begin)}' for key, begin in found.items())}, corners: {UNKNOWN}}}"
        for number, found in enumerate(named_plates(names), start=1)
    ]
    text = f"these columns are force plates, if you state their corners: plates: {{{', '.join(plates)}}}"
    return printable(text) if plates else ""


def named_plates(names: Sequence[str]) -> Iterator[dict[str, str]]:
    """Beginnings of the names of force, point and moment of each plate: `ground_force_v`, `ground_force_p` ..."""
    triples = {name[:-1] for name in names if name[-1:] == "x" and {f"{name[:-1]}y", f"{name[:-1]}z"} <= {*names}}
    for name in names:
        force = name[:-1]
        if name.endswith("vx") and force in triples and f"{force[:-1]}p" in triples:
            stem = force[:-1]  # `R_ground_force_`: its moment is `R_ground_torque_` or `R_ground_moment_`
            moments = [re.sub("force", word, stem) for word in ("torque", "moment")]
            moment = next((one for one in moments if one != stem and one in triples), None)
            if moment is not None:
                yield {"force": force, "point": f"{stem}p", "moment": moment}
