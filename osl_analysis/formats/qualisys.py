# SPDX-License-Identifier: Apache-2.0
"""Exports of Qualisys Track Manager: markers in TSV with the plates and analog channels in the
files beside it, and all of them in MATLAB's format (QTM user manual, "Data export").

In TSV `walk.tsv` has the markers, `walk_f_1.tsv` the first force plate, `walk_a_1.tsv` the analog
channels of the first board. Together they are one recording.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from operator import methodcaller
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt

from osl_analysis.base.errors import InputError, listing, naming, shortened
from osl_analysis.base.recording import (
    EXPORTED,
    Channel,
    End,
    Format,
    Kind,
    Loss,
    Plate,
    Recording,
    Rows,
)
from osl_analysis.base.source_file import Channel as ChannelSettings
from osl_analysis.base.source_file import LaboratorySource, MarkerSource, Name
from osl_analysis.base.trial import AXES, Array
from osl_analysis.base.units import LengthUnit
from osl_analysis.base.yaml_settings import check_distinct
from osl_analysis.formats.marker_text import TRAJECTORIES, Section
from osl_analysis.formats.text_cells import (
    TextRow,
    begins_with_text,
    check_last_line,
    is_number_cell,
    is_text,
    numbered,
    read_text,
    split_rows,
    unpadded,
)

MILLIMETRE = "mm"  # of positions in TSV and MAT, which have no other unit
UNITS_OF_PLATE = ("N", "N", "N", "N*m", "N*m", "N*m")
WRENCH = [f"{what}_{axis}" for what in ("Force", "Moment") for axis in "XYZ"]
CORNERS = ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY")  # in the plate's axes
OWN_AXES = 2  # type of a plate whose force and moment are in its own axes


class QualisysChannel(ChannelSettings):
    """An analog channel."""

    ADDRESS = "channel"
    channel: Name  # Its name.


class QualisysSource(LaboratorySource):
    """The source file of exports of Qualisys Track Manager."""

    analogs: Mapping[str, QualisysChannel] = Field(default={})
    plates: Literal["all"] | Annotated[tuple[PositiveInt, ...], AfterValidator(check_distinct)] = (
        "all"
    )
    """Force plates by number, from 1: all, or a list, which may be empty."""
    plate_axes: Literal["plate", "laboratory"] | None = None
    """Axes of the plates' forces and moments, where the file does not say."""
    plate_sign: Literal[1, -1] = 1
    """-1 if the file has the force on the plate instead of the force on the foot."""


class MarkerColumnsSource(MarkerSource):
    """The source file of positions without a header: three columns a marker."""

    markers: Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(check_distinct)]
    """Names of all markers, in the order of the columns."""
    rate: PositiveFloat  # Frames per second [Hz].
    point_unit: LengthUnit  # Unit of length.


# --- TSV -------------------------------------------------------------------------------------


def keys_and_rows(path: Path) -> tuple[dict[str, list[str]], list[TextRow]]:
    """The lines of keys of a file, and its rows of numbers; refused if the last may be cut."""
    text = read_text(path)
    rows = split_rows(numbered(text.data), "\t")
    samples = [row for row in rows if is_number_cell(row.cells[0])]
    keys = {row.cells[0].upper(): unpadded(row.cells[1:]) for row in rows if row not in samples}
    if not samples:
        raise InputError("holds no frames", "export the trial again")
    check_last_line(text.is_ended, samples)
    return keys, samples


def number_of(keys: Mapping[str, Sequence[str]], name: str) -> float:
    """The number behind a key. Raises InputError: there is none."""
    cell = "".join(keys.get(name, [])[:1])
    if not is_number_cell(cell) or float(cell) <= 0:
        raise InputError(
            f"{name} is '{shortened(cell)}'", "export the trial again, with its header"
        )
    return float(cell)


def files_of_trial(path: Path) -> list[Path]:
    """An export of markers, and those beside it of its force plates and analog boards."""
    files = [path]
    for kind in ("a", "f"):
        for number in count(1):
            file = path.with_name(f"{path.stem}_{kind}_{number}{path.suffix}")
            if not file.is_file():
                break
            files.append(file)
    return files


def read_tsv(path: Path, source: QualisysSource | None) -> Recording:
    """Read an export in TSV with the files beside it. Its first frame is at 0 s."""
    keys, frames = keys_and_rows(path)
    labels = keys.get("MARKER_NAMES", [])
    stated_frames = number_of(keys, "NO_OF_FRAMES")
    if not labels or stated_frames != len(frames):
        raise InputError(
            f"has {len(labels)} names under MARKER_NAMES and {len(frames)} frames, and states"
            f" {stated_frames:g}",
            "export the trial again, in 3D",
        )
    width = max(len(unpadded(row.cells)) for row in frames)
    before = max(width - 3 * len(labels), 0)  # the number of the frame and its time, or none
    section = marker_section(labels, frames, before, number_of(keys, "FREQUENCY"), MILLIMETRE)
    recording = Recording(
        format="qualisys_tsv",
        channels=section.channels(),
        loss=Loss(len(frames), len(frames)),
        facts=facts_of_frames(len(frames), section.rate_hz),
    )
    for file in files_of_trial(path)[1:]:
        with naming(file):
            recording = with_file_beside(recording, file, source)
    return with_wanted_plates(recording, source)


def marker_section(
    labels: Sequence[str], frames: Sequence[TextRow], before: int, rate_hz: float, unit: str
) -> Section:
    """The markers of rows, `before` whose coordinates stand other columns."""
    for row in frames:
        count = len(row.cells) - before
        if count > 3 * len(labels) and any(row.cells[before + 3 * len(labels) :]):
            raise InputError(
                f"line {row.number} has {count} coordinates under {len(labels)} markers",
                "name all of them",
            )
    return Section(
        title=TRAJECTORIES,
        rate_hz=rate_hz,
        rows=frames,
        names=[""] * before + [label for label in labels for _ in AXES],
        components=[""] * before + [axis for _ in labels for axis in "XYZ"],
        units=[unit] * (before + 3 * len(labels)),
    )


def facts_of_frames(frames: int, rate_hz: float, samples_per_frame: int = 1) -> dict[str, Any]:
    return {
        "frames": frames,
        "first_frame": 1,
        "frame_rate_hz": rate_hz,
        "samples_per_frame": samples_per_frame,
        "length_unit": MILLIMETRE,
    }


def with_file_beside(recording: Recording, path: Path, source: QualisysSource | None) -> Recording:
    """The recording with the force plate or the analog channels of one more file."""
    keys, samples = keys_and_rows(path)
    columns = keys.get("CHANNEL_NAMES") or keys.get("SAMPLE", [])
    before = max(len(unpadded(row.cells)) for row in samples[:10]) - len(columns)
    rows = rows_of_samples(recording, len(samples), number_of(keys, "FREQUENCY"), path.stem)
    section = Section(
        title=path.stem,
        rate_hz=rows.rate_hz or 0.0,
        rows=samples,
        names=[""] * before + list(columns),
        components=[""] * (before + len(columns)),
        units=[""] * (before + len(columns)),
    )
    facts = facts_of_frames(
        recording.facts["frames"],
        recording.facts["frame_rate_hz"],
        rows.count // recording.facts["frames"],
    )
    channels = [
        Channel({"channel": name}, rows, partial(section.values, before + place), name)
        for place, name in enumerate(columns)
        if name.upper() != "TIME"
    ]
    if "FORCE_PLATE_NAME" not in keys:
        return replace(recording, channels=[*recording.channels, *channels], facts=facts)
    by_name = {channel.name.upper(): channel for channel in channels}
    missing = [name for name in WRENCH if name.upper() not in by_name]
    if missing:
        raise InputError(f"has no column {listing(missing)}", "export force and moment")
    corners = np.array(
        [[number_of_corner(keys, corner, axis) for axis in "XYZ"] for corner in CORNERS]
    )
    description = " ".join(keys.get("DESCRIPTION", [])).casefold()
    axes = source.plate_axes if source is not None and source.plate_axes else ""
    plate = plate_of(
        number=len(recording.plates) + 1,
        name=" ".join(keys["FORCE_PLATE_NAME"]),
        corners=corners,
        channels=[
            replace(by_name[name.upper()], unit=unit)
            for name, unit in zip(WRENCH, UNITS_OF_PLATE, strict=True)
        ],
        axes=axes or axes_in(description),
        sign=1 if source is None else source.plate_sign,
    )
    return replace(recording, plates=[*recording.plates, plate], facts=facts)


def rows_of_samples(recording: Recording, count: int, rate_hz: float, name: str) -> Rows:
    """The instants of samples beside frames; refused if they are of another span or rate."""
    frames = recording.facts["frames"]
    per_frame = rate_hz / recording.facts["frame_rate_hz"]
    before = recording.facts["samples_per_frame"]
    is_other = before not in (1, round(per_frame))
    if abs(per_frame - round(per_frame)) > 1e-6 or round(per_frame) * frames != count or is_other:
        raise InputError(
            f"holds {count} samples at {rate_hz:g} Hz beside {frames} frames at"
            f" {recording.facts['frame_rate_hz']:g} Hz",
            "export markers, forces and analog channels of the same frames, at one analog rate",
        )
    return Rows(count, name, rate_hz, noun="sample")


def number_of_corner(keys: Mapping[str, Sequence[str]], corner: str, axis: str) -> float:
    cell = "".join(keys.get(f"FORCE_PLATE_CORNER_{corner}_{axis}", [])[:1])
    if not is_number_cell(cell):
        raise InputError(
            f"does not tell the corner {corner}_{axis} of its plate", "export it with its header"
        )
    return float(cell)


def axes_in(description: str) -> str:
    """The axes of a plate's force by the description in its file; empty where it does not say."""
    if "local" in description or "force plate" in description:
        return "plate"
    return "laboratory" if re.search("world|lab|global", description) else ""


def plate_of(
    number: int,
    name: str,
    corners: Array,
    channels: Sequence[Channel],
    axes: str,
    sign: Literal[1, -1],
) -> Plate:
    """Describe a plate whose moment is about the centre of its surface."""
    if not axes:
        raise InputError(
            f"plate {number} ('{name}') does not say whether its force is in its own axes",
            "state `plate_axes: laboratory`, or `plate`, in the source file",
        )
    is_own = axes == "plate"
    return Plate(
        number=number,
        type=OWN_AXES if is_own else EXPORTED,
        corners=corners,
        origin=np.zeros(3) if is_own else corners.mean(axis=0),
        channels=channels,
        length_unit=MILLIMETRE,
        facts={"device": name},
        sign=sign,
    )


def with_wanted_plates(recording: Recording, source: QualisysSource | None) -> Recording:
    """The recording with the plates that a source file asks for; a question on those that seem to
    have the force on the plate."""
    if source is None:
        pushed_down = [
            str(plate.number)
            for plate in recording.plates
            if plate.type == EXPORTED and is_mostly_negative(plate.channels[2])
        ]
        if pushed_down:
            question = (
                f"the vertical force of plate {listing(pushed_down)} is negative, as of the force"
                " on the plate: state `plate_sign: -1` in the source file"
            )
            return replace(recording, questions=[*recording.questions, question])
    if source is None or source.plates == "all":
        return recording
    known = {plate.number: plate for plate in recording.plates}
    absent = [str(number) for number in source.plates if number not in known]
    if absent:
        raise InputError(
            f"has no force plate {listing(absent)}, and {len(known)} in all", "correct `plates`"
        )
    return replace(recording, plates=[known[number] for number in source.plates])


def is_mostly_negative(channel: Channel) -> bool:
    """Whether the largest reading of a channel is negative."""
    values = channel.values
    return bool(-np.nanmin(values) > np.nanmax(values))


def read_columns(path: Path, source: MarkerColumnsSource | None) -> Recording:
    """Read positions without a header by the names that a source file states."""
    text = read_text(path)
    frames = split_rows(numbered(text.data), "\t")
    if source is None:
        raise InputError("has no header", "state `markers` and `rate` in a source file")
    check_last_line(text.is_ended, frames)
    width = max(len(unpadded(row.cells)) for row in frames)
    before = width - 3 * len(source.markers)
    if before not in (0, 1, 2):
        raise InputError(
            f"has {width} columns, and {len(source.markers)} markers of three are stated",
            "name all markers, in the order of the columns",
        )
    section = marker_section(source.markers, frames, before, source.rate, source.point_unit)
    facts = facts_of_frames(len(frames), source.rate)
    loss = Loss(len(frames), None, End.UNKNOWN)
    return Recording("marker_columns", section.channels(), loss, facts=facts)


# --- MATLAB ----------------------------------------------------------------------------------


def is_export(variables: Mapping[str, Any]) -> bool:
    """Whether the variables of a MATLAB file are an export of Qualisys Track Manager."""
    return any(has_fields(value, "FrameRate", "Trajectories") for value in variables.values())


def has_fields(value: Any, *names: str) -> bool:
    fields = getattr(getattr(value, "dtype", None), "names", None) or ()
    return set(names) <= set(fields)


def member(struct: Any, name: str) -> Any:
    """The member of a struct, of which there is one."""
    return np.ravel(struct)[0][name]


def recording_of_export(variables: Mapping[str, Any], source: QualisysSource | None) -> Recording:
    """Read markers, plates and analog channels of an export in MATLAB's format."""
    export = next(
        value for value in variables.values() if has_fields(value, "FrameRate", "Trajectories")
    )
    rate_hz = float(np.ravel(member(export, "FrameRate"))[0])
    labelled = member(member(export, "Trajectories"), "Labeled")
    labels = texts_of(member(labelled, "Labels"))
    positions = np.asarray(member(labelled, "Data"), float)[:, :3]  # (markers, xyz, frames)
    if len(labels) != len(positions):
        raise InputError(
            f"has {len(labels)} labels and {len(positions)} trajectories", "export it again"
        )
    frames = positions.shape[2]
    rows = Rows(frames, TRAJECTORIES, rate_hz, noun="frame")
    channels = []
    for label, position in zip(labels, positions, strict=True):
        seen = np.where((position == 0).all(axis=0), np.nan, position).T
        read = partial(np.asanyarray, seen)
        channels.append(
            Channel({"label": label}, rows, read, label, unit=MILLIMETRE, kind=Kind.MARKER)
        )
    recording = Recording(
        format="qualisys_mat",
        channels=channels,
        loss=Loss(frames, frames),
        facts=facts_of_frames(frames, rate_hz),
    )
    if has_fields(export, "Analog"):
        for board in np.ravel(member(export, "Analog")):
            recording = with_board(recording, board)
    if has_fields(export, "Force"):
        for struct in np.ravel(member(export, "Force")):
            recording = with_plate(recording, struct, source)
    return with_wanted_plates(recording, source)


def texts_of(cells: Any) -> list[str]:
    """The texts in a cell array."""
    return [str(np.ravel(cell)[0]) if np.size(cell) else "" for cell in np.ravel(cells)]


def with_board(recording: Recording, board: Any) -> Recording:
    """The recording with the channels of one more analog board."""
    samples = np.atleast_2d(np.asarray(board["Data"], float))
    rate_hz = float(np.ravel(board["Frequency"])[0])
    rows = rows_of_samples(recording, samples.shape[1], rate_hz, "analogs")
    channels = [
        Channel({"channel": name}, rows, partial(np.asanyarray, values), name)
        for name, values in zip(texts_of(board["Labels"]), samples, strict=True)
    ]
    per_frame = rows.count // recording.facts["frames"]
    return replace(
        recording,
        channels=[*recording.channels, *channels],
        facts={**recording.facts, "samples_per_frame": per_frame},
    )


def with_plate(recording: Recording, struct: Any, source: QualisysSource | None) -> Recording:
    """The recording with one more force plate."""
    wrench = np.vstack([np.asarray(struct[name], float) for name in ("Force", "Moment")])
    rate_hz = float(np.ravel(struct["Frequency"])[0])
    rows = rows_of_samples(recording, wrench.shape[1], rate_hz, "forces")
    number = len(recording.plates) + 1
    orientation = np.ravel(struct["ForcePlateOrientation"])
    axes = source.plate_axes if source is not None and source.plate_axes else ""
    if not axes and orientation.size:
        axes = "laboratory" if orientation[0] == 1 else "plate"
    channels = [
        Channel(
            {"channel": f"plate {number} {name}"},
            rows,
            partial(np.asanyarray, values),
            name,
            unit=unit,
        )
        for name, values, unit in zip(WRENCH, wrench, UNITS_OF_PLATE, strict=True)
    ]
    plate = plate_of(
        number=number,
        name="".join(texts_of(struct["ForcePlateName"])[:1]),
        corners=np.asarray(struct["ForcePlateLocation"], float),
        channels=channels,
        axes=axes,
        sign=1 if source is None else source.plate_sign,
    )
    per_frame = rows.count // recording.facts["frames"]
    return replace(
        recording,
        plates=[*recording.plates, plate],
        facts={**recording.facts, "samples_per_frame": per_frame},
    )


def read_mat(path: Path, source: QualisysSource | None) -> Recording:
    """Read an export in MATLAB's format."""
    from osl_analysis.formats.mat import load_variables

    variables = load_variables(path)
    if not is_export(variables):
        raise InputError(
            "holds no struct with FrameRate and Trajectories", "write `format: mat` for other files"
        )
    return recording_of_export(variables, source)


TSV = Format(
    name="qualisys_tsv",
    suffixes=(".tsv",),
    begins=partial(begins_with_text, r"\ANO_OF_FRAMES\t"),
    source=QualisysSource,
    read=read_tsv,
    files_in=files_of_trial,
)
MAT = Format(
    name="qualisys_mat",
    suffixes=(),
    begins=methodcaller("startswith", (b"MATLAB 5.0 MAT", b"MATLAB 7.")),
    source=QualisysSource,
    read=read_mat,
)
COLUMNS = Format(
    name="marker_columns",
    suffixes=(),
    begins=is_text,
    source=MarkerColumnsSource,
    read=read_columns,
    is_any_text=True,
)
