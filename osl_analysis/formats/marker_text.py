# SPDX-License-Identifier: Apache-2.0
"""Text of motion capture: a header of keys, names of columns, and a row of numbers a frame.

Here are the markers in TRC, as Motion Analysis defined it: a header of five lines, then a row per
frame. No maintained library reads it alone. `nexus.py` has the exports of Vicon.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, shortened
from osl_analysis.base.recording import (
    EXPORTED,
    Channel,
    Format,
    Kind,
    Loss,
    Plate,
    Recording,
    Rows,
)
from osl_analysis.base.source_file import Corner, ExportedPlate, MarkerSource
from osl_analysis.base.trial import AXES
from osl_analysis.base.units import LengthUnit
from osl_analysis.formats.text_cells import (
    TextRow,
    begins_with_text,
    cell_numbers,
    check_last_line,
    is_number_cell,
    numbered,
    read_text,
    split_rows,
    unpadded,
)

UNSEEN = ("", "nan", "NaN", "NAN", "null")  # cells of a marker that was not seen
MOST_OFF = 0.5  # frames by which a time may be off: rates and times are rounded
CORRECT = "export it again, or correct the header"
TRAJECTORIES = "Trajectories"
MODEL_OUTPUTS = "Model Outputs"
KINDS = {TRAJECTORIES: Kind.MARKER, MODEL_OUTPUTS: Kind.MODEL_OUTPUT}  # of points, by title
HEADER_LINES = 5


@dataclass(frozen=True)
class Section:
    """Rows of numbers under names."""

    title: str
    rate_hz: float  # of its rows
    rows: Sequence[TextRow]  # the number of the frame may stand first
    names: Sequence[str]  # of every column: `Anna:LTOE`, `EMG2000 - Voltage`
    components: Sequence[str]  # of every column: X, Y, Z, Fx ..
    units: Sequence[str]  # of every column
    decimal: str = "."
    start_s: float = 0.0

    def values(self, place: int) -> NDArray[np.float64]:
        """Read one column, (rows,); NaN where a cell is empty, or lacks at the end of a row."""
        cells = [row.cells[place] if place < len(row.cells) else "" for row in self.rows]
        values, unread = cell_numbers(pl.Series(cells, dtype=pl.String), UNSEEN, self.decimal)
        if unread.size:
            first = unread[0]
            title = f"{self.names[place]} {self.components[place]}".strip()
            raise InputError(
                f"line {self.rows[first].number}, {title}: '{shortened(cells[first])}' is not a"
                " number",
                "export it again as plain numbers",
            )
        return values

    def positions(self, place: int) -> NDArray[np.float64]:
        """Read three columns, (rows, 3); NaN where a marker was not seen: where cells are empty, or
        at the exact origin."""
        positions = np.column_stack([self.values(place + axis) for axis in range(3)])
        positions[(positions == 0).all(axis=1)] = np.nan
        return positions

    def first_frame(self, sub_frame: NDArray[np.float64] | float = 0.0) -> int:
        """Number of the first frame; refused if frames do not follow one another."""
        frame = self.values(0)
        samples = np.nanmax(sub_frame) + 1
        follows = (frame - frame[0]) * samples + sub_frame == np.arange(frame.size)
        if not follows.all():
            row = int(np.argmin(follows))
            raise InputError(
                f"line {self.rows[row].number}: frame {frame[row]:g} does not follow the line"
                " before",
                "export the trial again with all its frames",
            )
        return int(frame[0])

    def channels(self) -> list[Channel]:
        """The columns of devices, or the points of three columns each."""
        rows = Rows(len(self.rows), self.title, self.rate_hz, start_s=self.start_s)
        kind = KINDS.get(self.title, Kind.SIGNAL)
        channels = []
        for place, (name, component) in enumerate(zip(self.names, self.components, strict=True)):
            unit = self.units[place]
            short_name = name.rpartition(":")[2]  # without the subject
            if name and kind == Kind.SIGNAL:
                address = {"device": short_name, "component": component}
                read = partial(self.values, place)
                channels.append(Channel(address, rows, read, component, unit=unit))
            elif name and component.upper() == "X":
                # the unit of an output is that of the source file: files misstate it
                unit = "" if kind == Kind.MODEL_OUTPUT else unit
                read = partial(self.positions, place)
                channel = Channel({"label": name}, rows, read, short_name, unit=unit, kind=kind)
                channels.append(channel)
        return channels


def exported_plate(
    recording: Recording,
    number: int,
    settings: ExportedPlate,
    columns: Sequence[tuple[Mapping[str, str], str]],
    length_unit: str,
    about: Corner | None = None,
) -> Plate:
    """Describe a plate whose force and moment were exported, the moment about a point or else the
    centre of the corners.

    Parameters
    ----------
    columns
        Address of each column without its axis, which is added to the last key, and its unit; empty
        for that of the file.
    """
    channels = []
    for address, unit in columns:
        for axis in AXES:
            key = [*address][-1]
            channel = recording.find({**address, key: f"{address[key]}{axis}"})
            channels.append(replace(channel, unit=unit or channel.unit))
    corners = np.array(settings.corners)
    return Plate(
        number=number,
        type=EXPORTED,
        corners=corners,
        origin=corners.mean(axis=0) if about is None else np.array(about),
        channels=channels,
        length_unit=length_unit,
        sign=settings.sign,
        facts=settings.model_dump(include={"device", "force", "point", "moment", "sign", "foot"}),
    )


class TrcSource(MarkerSource):
    """The source file of markers in TRC."""

    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.


def read(path: Path, source: TrcSource | None) -> Recording:
    """Read the markers of TRC; refused if its header contradicts the rows."""
    text = read_text(path)
    rows = split_rows(numbered(text.data), "\t" if b"\t" in text.data else " ")
    if len(rows) <= HEADER_LINES:
        raise InputError(f"holds no frames, only {len(rows)} lines of a header", "export it again")
    keys, values, names = ([cell for cell in row.cells if cell] for row in rows[1:4])
    header = dict(zip([key.casefold() for key in keys], values, strict=False))
    frames = rows[HEADER_LINES:]
    check_last_line(text.is_ended, frames)
    stated_frames = header.get("numframes", "")
    rate = header.get("datarate", "")
    are_numbers = is_number_cell(stated_frames) and is_number_cell(rate)
    if not are_numbers or float(stated_frames) != len(frames) or float(rate) <= 0:
        raise InputError(
            f"its header says NumFrames {shortened(stated_frames)!r} and DataRate"
            f" {shortened(rate)!r},"
            f" and the file holds {len(frames)} rows: its end is missing, or the header is wrong",
            CORRECT,
        )
    markers = header.get("nummarkers", "")
    # Cortex names its virtual markers behind the others, and leaves them out
    labels = names[2:][: int(markers) if markers.isdecimal() else None]
    for row in frames:
        count = len(unpadded(row.cells)) - 2  # behind the number of the frame and its time
        if count > 3 * len(labels) or count % 3:
            raise InputError(
                f"line {row.number} has {count} coordinates, its header names {len(labels)}"
                " markers",
                CORRECT,
            )
    unit = header.get("units", "")
    section = Section(
        title=TRAJECTORIES,
        rate_hz=float(rate),
        rows=frames,
        names=["", "", *(label for label in labels for _ in AXES)],
        components=["frame", "time", *(axis for _ in labels for axis in "XYZ")],
        units=[unit] * (2 + 3 * len(labels)),
    )
    section = replace(section, start_s=_start(section))
    facts = {
        "frames": len(frames),
        "first_frame": section.first_frame(),
        "frame_rate_hz": section.rate_hz,
        "samples_per_frame": 1,
        "length_unit": unit,
        "start_s": section.start_s,
    }
    return Recording("trc", section.channels(), Loss(len(frames), len(frames)), facts=facts)


def _start(section: Section) -> float:
    """Time of the first frame [s]; refused if times do not fit the rate."""
    time = section.values(1)
    frames = (time - time[0]) * section.rate_hz
    is_off = np.abs(frames - np.arange(time.size)) > MOST_OFF
    if is_off.any():
        row = int(np.argmax(is_off))
        raise InputError(
            f"line {section.rows[row].number}: time {time[row]:g} s does not fit the rate of"
            f" {section.rate_hz:g} Hz from {time[0]:g} s on",
            "correct the header or the times",
        )
    return float(time[0])


FORMAT = Format(
    name="trc",
    suffixes=(".trc",),
    begins=partial(begins_with_text, r"(?i)\A\s*pathfiletype"),
    source=TrcSource,
    read=read,
)
