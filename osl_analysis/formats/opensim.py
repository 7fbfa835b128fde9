# SPDX-License-Identifier: Apache-2.0
"""Tables of OpenSim (.mot, .sto): a header down to `endheader`, then names and rows."""

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

from pydantic import Field, PositiveInt, model_validator

from osl_analysis.base.errors import InputError, shortened
from osl_analysis.base.recording import End, Format, Recording
from osl_analysis.base.source_file import (
    Axes,
    ColumnChannel,
    ColumnName,
    ColumnTime,
    ExportedPlate,
    InAxes,
)
from osl_analysis.base.trial import unit_of
from osl_analysis.base.units import TimeUnit, si_factor
from osl_analysis.base.yaml_settings import misplaced
from osl_analysis.formats.cell_table import LISTING, SheetSource, recording_of_table
from osl_analysis.formats.csv_table import table_of_text
from osl_analysis.formats.marker_text import exported_plate
from osl_analysis.formats.text_cells import begins_with_text, read_text

# what columns measure, by their names
LIKELY_UNITS = {
    r"^time$": "s",
    r"force.*_v[xyz]$": "N",
    r"force.*_p[xyz]$": "m",
    r"(torque|moment).*_[xyz]$|_moment$": "N*m",
    r"_t[xyz]$": "m",
}
UNIT_OF_ANGLES = {"yes": "deg", "no": "rad"}  # their unit, by what the header says of `inDegrees`


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
        if self.clock == "common" and (not self.time.name or self.time.unit != "s"):
            raise misplaced(
                "`clock: common` needs the column of time in s, as {column: time, unit: s}", "time"
            )
        return self


def read(path: Path, source: OpenSimSource | None) -> Recording:
    """Read a table; refused if its header has no end, or contradicts the rows."""
    layout = source or LISTING
    table = table_of_text(read_text(path), layout)
    # `nRows=12`, or as older versions write it `datarows 12`
    parts = [re.split(r"\s*=\s*|\s+", text, maxsplit=1) for text in table.notes]
    header = {part[0].casefold(): part[-1] for part in parts}
    stated_rows = header.get("nrows") or header.get("datarows") or ""
    count = len(table.lines)
    if stated_rows not in ("", str(count)):
        raise InputError(
            f"its header states {shortened(stated_rows)} rows, the file holds {count} whole"
            " ones: its end is missing, or some are damaged",
            "export it again, or correct the header",
        )
    if stated_rows:
        table = replace(table, end=End.WHOLE)
    angle = UNIT_OF_ANGLES.get(header.get("indegrees", "").casefold(), "")
    likely = {}
    for name in table.names:
        units = (unit for form, unit in LIKELY_UNITS.items() if re.search(form, name, re.I))
        likely[name] = next(units, angle)
    stems = [name[:-2] for name in table.names if re.search("force.*_vx$", name)]
    moments = [name[:-1] for name in table.names if re.search("(torque|moment).*x$", name)]
    like_plates = [
        f"{number}: {{force: {stem}v, point: {stem}p, moment: {moment}, corners: UNKNOWN}}"
        for number, (stem, moment) in enumerate(zip(stems, moments, strict=False), start=1)
    ]
    question = "these columns are force plates, if you state their corners: plates:"
    recording = replace(
        recording_of_table("opensim", table, layout, facts=header, likely_units=likely),
        settings={"time": {"column": "time", "unit": "s"}} if "time" in table.names else {},
        questions=[f"{question} {{{', '.join(like_plates)}}}"] if like_plates else [],
    )
    if source is None:
        return recording
    _check_angles(source, angle)
    plates = []
    for number, plate in source.plates.items():
        columns = [
            ({"column": begin}, unit)
            for begin, unit in ((plate.force, "N"), (plate.moment, "N*m"), (plate.point, "m"))
        ]
        plates.append(exported_plate(recording, number, plate, columns, "m"))
    return replace(recording, plates=plates)


def _check_angles(source: OpenSimSource, angle: str) -> None:
    """Refuse the unit of an angle, or of its rate, that contradicts that of the header."""
    for column, channel in source.channels.items():
        si_unit = unit_of(column)
        unit_of_file = si_unit.replace("rad", angle)
        is_angle = angle and si_unit in ("rad", "rad/s")
        if is_angle and si_factor(channel.unit, si_unit) != si_factor(unit_of_file, si_unit):
            raise InputError(
                f"column '{channel.column}' is read in {channel.unit}, and by `inDegrees` of its"
                f" header it is in {unit_of_file}",
                f"write {unit_of_file}, as {source.place('channels', column, 'unit')}",
            )


FORMAT = Format(
    name="opensim",
    suffixes=(".mot", ".sto"),
    begins=partial(begins_with_text, r"(?im)^[ \t]*endheader[ \t\r]*$"),
    source=OpenSimSource,
    read=read,
)
