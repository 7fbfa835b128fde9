# SPDX-License-Identifier: Apache-2.0
"""Text of motion capture: a header of keys, names of columns, and a row of numbers a frame.

Here are the markers that Qualisys Track Manager exports as TSV, and those in TRC; `nexus.py` has
the exports of Vicon.

Qualisys: lines of keys stand above the frames: NO_OF_FRAMES, FREQUENCY, MARKER_NAMES. Then a header
may name the columns, and each line holds one frame: maybe its number and time, then x, y, z of each
marker [mm] (QTM user manual, "TSV file formats").

TRC, as Motion Analysis defined it: a header of five lines, then a row per frame. No maintained
library reads it alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats._text import (
    Row,
    Text,
    check_last_line,
    column_of,
    decoded,
    is_number_cell,
    is_text,
    numbered,
    read_text,
    split_rows,
    unpadded,
)
from osl_analysis.recording import EXPORTED, Channel, Format, Kind, Loss, Plate, Recording, Rows
from osl_analysis.source_file import Corner, ExportedPlate, MarkerSource
from osl_analysis.trial import AXES
from osl_analysis.units import LengthUnit

UNSEEN = ("", "nan", "NaN", "NAN", "null")  # cells of a marker that was not seen
MOST_OFF = 0.5  # frames by which a time may be off: rates and times are rounded
CORRECT = "export it again, or correct the header"
TRAJECTORIES = "Trajectories"
MODEL_OUTPUTS = "Model Outputs"
KINDS = {TRAJECTORIES: Kind.MARKER, MODEL_OUTPUTS: Kind.MODEL_OUTPUT}  # of points, by title
QUALISYS = "NO_OF_FRAMES"
TRC = "PathFileType"
HEADER_LINES = 5


@dataclass(frozen=True)
class Section:
    """Rows of numbers under names."""

    title: str
    rate_hz: float  # of its rows
    rows: Sequence[Row]  # the number of the frame may stand first
    names: Sequence[str]  # of every column: `Anna:LTOE`, `EMG2000 - Voltage`
    components: Sequence[str]  # of every column: X, Y, Z, Fx ..
    units: Sequence[str]  # of every column
    decimal: str = "."
    start_s: float = 0.0

    def values(self, place: int) -> NDArray[np.float64]:
        """Read one column, (rows,); NaN where a cell is empty."""
        title = f"{self.names[place]} {self.components[place]}".strip()
        return column_of(self.rows, place, UNSEEN, title, self.decimal)

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
                " before; export the trial again with all its frames"
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


def begins_with_key(begin: bytes, key: str) -> bool:
    """Tell whether a file is text whose first word begins with a key, in any case."""
    return is_text(begin) and decoded(begin[:200]).lstrip().casefold().startswith(key.casefold())


def rows_of(text: Text) -> list[Row]:
    """Split the lines of a text into stripped cells at tabs, or at blanks where it has none."""
    return split_rows(numbered(text.data), "\t" if b"\t" in text.data else " ")


def recording_of_markers(
    format_name: str,
    labels: Sequence[str],
    rows: Sequence[Row],
    first: int,
    header: Mapping[str, str],
    keys: tuple[str, str],
    unit: str,
) -> Recording:
    """Make a channel of each marker.

    Parameters
    ----------
    rows
        The number of the frame where `first` is 1, its time too where it is 2; x, y and z of each
        marker.
    keys
        Those of the number of frames and of the rate in the header.

    Raises
    ------
    InputError
        Rows contradict the header or one another, or a cell is no number.
    """
    frames, rate = (header.get(key.casefold(), "") for key in keys)
    are_numbers = is_number_cell(frames) and is_number_cell(rate)
    if not are_numbers or float(frames) != len(rows) or float(rate) <= 0:
        raise InputError(
            f"its header says {keys[0]} {frames[:40]!r} and {keys[1]} {rate[:40]!r}, and the file"
            f" holds {len(rows)} rows: its end is missing, or the header is wrong; {CORRECT}"
        )
    for row in rows:
        count = len(unpadded(row.cells)) - first
        if first not in (0, 1, 2) or count > 3 * len(labels) or count % 3:
            raise InputError(
                f"line {row.number} has {count} coordinates, its header names {len(labels)}"
                f" markers; {CORRECT}"
            )
    section = Section(
        title=TRAJECTORIES,
        rate_hz=float(rate),
        rows=rows,
        names=[""] * first + [label for label in labels for _ in AXES],
        components=["frame", "time"][:first] + [*"XYZ"] * len(labels),
        units=[unit] * (first + 3 * len(labels)),
    )
    if first == 2:
        section = replace(section, start_s=_start(section))
    facts = {
        "frames": len(rows),
        "first_frame": section.first_frame() if first else 1,
        "frame_rate_hz": section.rate_hz,
        "samples_per_frame": 1,
        "length_unit": unit,
        "start_s": section.start_s,
    }
    return Recording(format_name, section.channels(), Loss(len(rows), len(rows)), facts=facts)


def _start(section: Section) -> float:
    """Time of the first frame [s]; refused if times do not fit the rate."""
    time = section.values(1)
    frames = (time - time[0]) * section.rate_hz
    is_off = np.abs(frames - np.arange(time.size)) > MOST_OFF
    if is_off.any():
        row = int(np.argmax(is_off))
        raise InputError(
            f"line {section.rows[row].number}: time {time[row]:g} s does not fit the rate of"
            f" {section.rate_hz:g} Hz from {time[0]:g} s on; correct the header or the times"
        )
    return float(time[0])


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


def read_qualisys(path: Path, source: MarkerSource | None) -> Recording:
    """Read the markers; refused if the keys contradict the frames."""
    text = read_text(path)
    rows = rows_of(text)
    keys = {row.cells[0].casefold(): row.cells[1:] for row in rows}
    header = {key: "".join(values[:1]) for key, values in keys.items()}
    frames = [row for row in rows if is_number_cell(row.cells[0])]
    labels = unpadded(keys.get("marker_names", []))
    if not labels or not frames:
        raise InputError(
            f"it has {len(labels)} names under MARKER_NAMES and {len(frames)} frames; export the"
            " trial again"
        )
    check_last_line(text.is_ended, frames)
    return recording_of_markers(
        "qualisys",
        labels,
        frames,
        # a frame may begin with its number, or number and time
        first=max(len(unpadded(row.cells)) for row in frames) - 3 * len(labels),
        header=header,
        keys=(QUALISYS, "FREQUENCY"),
        unit="mm",  # the export has no other one
    )


QUALISYS_FORMAT = Format(
    name="qualisys",
    suffixes=(),
    begins=partial(begins_with_key, key=QUALISYS),
    source=MarkerSource,
    read=read_qualisys,
)


class TrcSource(MarkerSource):
    """The source file of markers in TRC."""

    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.


def read_trc(path: Path, source: TrcSource | None) -> Recording:
    """Read the markers; refused if the header is not that of TRC, or contradicts the rows."""
    text = read_text(path)
    rows = rows_of(text)
    if len(rows) <= HEADER_LINES:
        raise InputError(f"holds no frames, only {len(rows)} lines of a header; export it again")
    keys, values, names = ([cell for cell in row.cells if cell] for row in rows[1:4])
    header = dict(zip([key.casefold() for key in keys], values, strict=False))
    body = rows[HEADER_LINES:]
    check_last_line(text.is_ended, body)
    markers = header.get("nummarkers", "")
    # Cortex names its virtual markers behind the others, and leaves them out
    labels = names[2:][: int(markers) if markers.isdecimal() else None]
    return recording_of_markers(
        "trc",
        labels,
        body,
        first=2,
        header=header,
        keys=("NumFrames", "DataRate"),
        unit=header.get("units", ""),
    )


TRC_FORMAT = Format(
    name="trc",
    suffixes=(".trc",),
    begins=partial(begins_with_key, key=TRC),
    source=TrcSource,
    read=read_trc,
)
