"""Tables of OpenSim (.mot, .sto): a header down to `endheader`, then names and rows."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic import Field, PositiveInt, model_validator

from osl_analysis.errors import InputError
from osl_analysis.formats._captured_text import exported_plate
from osl_analysis.formats._table import LISTING, SheetSource, recording_of_table
from osl_analysis.formats._text import Text, decoded, is_text, read_text
from osl_analysis.formats.csv_table import table_of_text
from osl_analysis.recording import End, Format, Plate, Recording
from osl_analysis.source_file import (
    Axes,
    ColumnChannel,
    ColumnName,
    ColumnTime,
    ExportedPlate,
    InAxes,
)
from osl_analysis.trial import AXES, unit_of
from osl_analysis.units import TimeUnit, si_factor
from osl_analysis.yaml_settings import misplaced

# what columns measure, by their names
LIKELY_UNITS = {
    r"^time$": "s",
    r"force.*_v[xyz]$": "N",
    r"force.*_p[xyz]$": "m",
    r"(torque|moment).*_[xyz]$|_moment$": "N*m",
    r"_t[xyz]$": "m",
}
# units of angles and speeds, by what the header says of `inDegrees`
ANGLES = {"yes": {"rad": "deg", "rad/s": "deg/s"}, "no": {"rad": "rad", "rad/s": "rad/s"}}
END_OF_HEADER = re.compile(rb"(?im)^[ \t]*endheader[ \t]*\n")


class OpenSimChannel(ColumnChannel):
    """A column of a table of OpenSim."""

    unit: str  # Unit of the numbers, as laboratories spell it.


class OpenSimTime(ColumnTime):
    """The column of time."""

    column: ColumnName | None = "time"  # Name of the column that holds time.
    unit: TimeUnit | None = "s"  # Unit of the numbers that are time.


class OpenSimPlate(ExportedPlate):
    """A force plate, or the ground reaction of a foot."""

    force: str  # Beginning of the names of the force's columns [N]: `R_ground_force_v`.
    # Beginning of the names of the columns of the point of application [m]: `R_ground_force_p`.
    point: str
    # Beginning of the names of the columns of the moment about this point [N*m]:
    # `R_ground_torque_`.
    moment: str
    # Whose force it is, where the file has one per foot, not per plate.
    foot: Literal["left", "right"] | None = None


class OpenSimSource(SheetSource, InAxes):
    """The source file of tables of OpenSim."""

    clock: Literal["master", "sync", "shared", "common"] = "master"  # type: ignore[assignment]
    """How the log's clock is aligned to motion capture's. `common`: its times are those of the TRC
    beside it."""
    channels: Mapping[str, OpenSimChannel] = Field(default={})
    time: OpenSimTime = Field(default_factory=OpenSimTime)
    # Force plates by number, from 1.
    plates: Mapping[PositiveInt, OpenSimPlate] = Field(default={})
    axes: Axes = ("x", "-z", "y")

    @model_validator(mode="after")
    def _something(self) -> "OpenSimSource":
        if not self.channels and not self.plates:
            raise misplaced(
                "name the columns to read under `channels`, or plates under `plates`", "channels"
            )
        if str(self.clock) == "common" and (not self.time.name or self.time.unit != "s"):
            raise misplaced(
                "`clock: common` needs the column of time in s, as {column: time, unit: s}", "time"
            )
        return self


def header_of(lines: Sequence[str]) -> dict[str, str]:
    """What a header says, by key in small letters: `nRows=12`, or as older versions write it
    `datarows 12`."""
    header: dict[str, str] = {}
    for text in lines:
        key, _, value = text.partition("=" if "=" in text else " ")
        header[key.strip().casefold()] = value.strip()
    return header


def read(path: Path, source: OpenSimSource | None) -> Recording:
    """Read a table; refused if its header has no end, or contradicts the rows."""
    text = read_text(path)
    end = END_OF_HEADER.search(text.data)
    if end is None:
        raise InputError("no line `endheader`: no table of OpenSim; check the source's format")
    above = text.data[: end.start()].decode(errors="replace").split("\n")
    notes = [line.strip() for line in above if line.strip()]
    header = header_of(notes)
    layout = source or LISTING
    blank = b"\n" * text.data.count(b"\n", 0, end.end())  # the lines keep their numbers
    below = Text(blank + text.data[end.end() :], text.is_ended)
    table = table_of_text(below, layout)
    are_rows_stated = _are_rows_stated(header, len(table.lines))
    table = replace(
        table,
        notes=[*notes, *table.notes],
        end=End.WHOLE if are_rows_stated and table.end == End.UNKNOWN else table.end,
    )
    angle = ANGLES.get(header.get("indegrees", "").casefold(), {})
    likely = {name: _likely_unit(name) or angle.get("rad", "") for name in table.names}
    like_plates = ", ".join(plates_in(table.names))
    question = "these columns are force plates, if you state their corners: plates:"
    recording = replace(
        recording_of_table("opensim", table, layout, facts=header, likely_units=likely),
        settings={"time": {"column": "time", "unit": "s"}} if "time" in table.names else {},
        questions=[f"{question} {{{like_plates}}}"] if like_plates else [],
    )
    if source is None:
        return recording
    _check_angles(source, angle)
    plates = [_plate_of(recording, number, plate) for number, plate in source.plates.items()]
    return replace(recording, plates=plates)


def _likely_unit(name: str) -> str:
    for pattern, unit in LIKELY_UNITS.items():
        if re.search(pattern, name, re.IGNORECASE):
            return unit
    return ""


def _plate_of(recording: Recording, number: int, settings: OpenSimPlate) -> Plate:
    """Describe a plate by the columns of its force, its point of application, and the moment about
    this point."""
    quantities = ((settings.force, "N"), (settings.moment, "N*m"), (settings.point, "m"))
    channels = [
        replace(recording.find({"column": f"{begin}{axis}"}), unit=unit)
        for begin, unit in quantities
        for axis in AXES
    ]
    return exported_plate(number, settings, channels, "m", foot=settings.foot)


def _are_rows_stated(header: Mapping[str, str], rows: int) -> bool:
    """Tell whether a header states the number of rows; refuse a table that has another one."""
    stated_rows = header.get("nrows") or header.get("datarows") or ""
    if stated_rows not in ("", str(rows)):
        raise InputError(
            f"its header states {stated_rows[:20]} rows, the file holds {rows} whole ones: its end"
            " is missing, or some are damaged; export it again, or correct the header"
        )
    return bool(stated_rows)


def _check_angles(source: OpenSimSource, units: Mapping[str, str]) -> None:
    """Refuse the unit of an angle that contradicts that of the header."""
    for column, channel in source.channels.items():
        unit_of_file = units.get(unit_of(column), "")
        if not unit_of_file:
            continue
        factors = [si_factor(unit, unit_of(column)) for unit in (channel.unit, unit_of_file)]
        if not math.isclose(*factors):
            raise InputError(
                f"column '{channel.column}' is read in {channel.unit}, and by `inDegrees` of its"
                f" header it is in {unit_of_file}; write {unit_of_file}, as"
                f" {source.place('channels', column, 'unit')}"
            )


def plates_in(names: Sequence[str]) -> list[str]:
    """The plates that the names of columns tell, as a source file has them but for their corners.

    Of `R_ground_force_vx` the point is `R_ground_force_px`, and the moment `R_ground_torque_x`.
    """
    plates: list[str] = []
    for stem in [name[:-2] for name in names if re.search("force.*vx$", name)]:
        for word in ("torque", "moment"):
            keys = {"force": f"{stem}v", "point": f"{stem}p", "moment": stem.replace("force", word)}
            if {f"{begin}{axis}" for begin in keys.values() for axis in AXES} <= {*names}:
                text = ", ".join(f"{key}: {json.dumps(begin)}" for key, begin in keys.items())
                plates.append(f"{len(plates) + 1}: {{{text}, corners: UNKNOWN}}")
    return plates


def _begins(begin: bytes) -> bool:
    if not is_text(begin):
        return False
    return re.search(r"(?im)^[ \t]*endheader[ \t\r]*$", decoded(begin)) is not None


FORMAT = Format(
    name="opensim",
    suffixes=(".mot", ".sto"),
    begins=_begins,
    source=OpenSimSource,
    read=read,
    priority=1,
)
