# SPDX-License-Identifier: Apache-2.0
"""C3D (https://www.c3d.org/HTML): points, analog samples and force plates of motion capture.

Written by hand: `ezc3d` misplaces frames where ANALOG:RATE and the header disagree, ignores
UNSIGNED, and is silent about a cut file. Tests compare.
"""

import math
import re
import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PositiveInt, model_validator

from osl_analysis.base.errors import InputError, listing, naming
from osl_analysis.base.recording import (
    CALIBRATED_CHANNELS,
    EXPORTED,
    MEASURED_BY_TYPE,
    Channel,
    Format,
    Kind,
    Loss,
    Plate,
    Recording,
    Rows,
)
from osl_analysis.base.source_file import (
    Channel as ChannelSettings,
)
from osl_analysis.base.source_file import (
    ColumnName,
    Corner,
    LaboratorySource,
    Name,
    PlateUnits,
)
from osl_analysis.base.trial import Array
from osl_analysis.base.units import LengthUnit
from osl_analysis.base.yaml_settings import Settings, check_distinct, misplaced
from osl_analysis.formats.text_cells import decoded, padded_to

BLOCK_BYTES = 512  # bytes
HEADER_WORDS = 65536  # numbers of 16 bits, in which the header counts
INTEL = 84
DEC = 85
MIPS = 86
BYTE_ORDERS = {INTEL: "<", DEC: "<", MIPS: ">"}  # by the code of the processor
TEXT = -1
PARAMETER_TYPES = {1: "u1", 2: "i2", 4: "f4"}  # of numbers, by their size [bytes]
# a parameter holds 255 values; more follow in NAME2, NAME3, ...
CONTINUATIONS = ("", *"23456789")
STATE_PLATE = (
    "state it in the source file, as `plate_geometry: {{1: {{type: 2, channels: {numbers}, origin:"
    " [0, 0, 0], corners: [[x, y, z], ...]}}}}`, with the numbers from 1 of its channels Fx, Fy,"
    " Fz, Mx, My, Mz, their origin in its axes, as [0, 0, -40] mm if below the surface, and its"
    " corners in the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y) of these"
)
CHANNELS_BY_TYPE = {
    kind: CALIBRATED_CHANNELS.get(kind, len(measured))
    for kind, measured in MEASURED_BY_TYPE.items()
}
PLATE_LABEL = re.compile(r"(?i)(?:^|[^a-z])([FM][xyz])\d*$")  # `Force.Fx1`

Parameters = Mapping[str, "Array | list[str]"]


class C3dChannel(ChannelSettings):
    """An analog channel."""

    ADDRESS = "channel"
    channel: Name  # Its label.


class PlateGeometry(Settings):
    """A force plate that the file does not describe."""

    type: Literal[1, 2, 3, 4, 5] = 2
    """Type of the C3D manual: 1 force, centre of pressure and free moment, 2 force and moment about
    the plate's origin, 3 the eight forces of Kistler, 4 six and 5 eight channels that `calibration`
    turns into force and moment."""
    # Labels of its channels, or their numbers from 1, in the order of the type.
    channels: tuple[ColumnName, ...]
    # Of the surface, in the file's axes and unit of length, in the order of FORCE_PLATFORM:CORNERS.
    corners: tuple[Corner, Corner, Corner, Corner]
    # FORCE_PLATFORM:ORIGIN, in the file's unit of length.
    origin: Corner = (0.0, 0.0, 0.0)
    calibration: tuple[tuple[float, ...], ...] = ()
    """Rows Fx, Fy, Fz [N per unit of a channel], Mx, My, Mz [N times the file's unit of length per
    unit of a channel] of a plate of type 4 or 5, with a number for each channel."""

    @model_validator(mode="after")
    def _calibration_of_its_type(self) -> "PlateGeometry":
        channels = CALIBRATED_CHANNELS.get(self.type, 0)
        columns = [len(row) for row in self.calibration]
        if columns != [channels] * (6 if channels else 0):
            raise misplaced(
                f"type {self.type} has a calibration of 6 rows of {channels} numbers"
                if channels
                else f"type {self.type} has no calibration: types 4 and 5 have one",
                "calibration",
            )
        return self


class C3dSource(LaboratorySource):
    """The source file of C3D captures."""

    analogs: Mapping[str, C3dChannel] = Field(default={})
    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.
    plates: Literal["all"] | Annotated[tuple[PositiveInt, ...], AfterValidator(check_distinct)] = (
        "all"
    )
    """Force plates by number, from 1: all, or a list, which may be empty."""
    plate_geometry: Mapping[PositiveInt, PlateGeometry] = Field(default={})
    """Force plates by number that the file does not describe, as it has no FORCE_PLATFORM, or that
    it describes wrongly."""
    # Units of the plates' channels, where the file's are absent or wrong.
    plate_units: PlateUnits | None = None
    plate_zero: Literal["none"] | tuple[PositiveInt, PositiveInt] = "none"
    """Baseline of the plates: none, or two frames, from 1, between which they are empty. `inspect`
    tells those that the file names, FORCE_PLATFORM:ZERO."""


@dataclass(frozen=True)
class Header:
    """Counts and parameters of a file."""

    points: int  # per frame, model outputs included
    channels: int  # analog
    samples_per_frame: int  # of each analog channel
    first_frame: int  # as the laboratory counts
    frames: int
    rate_hz: float  # frames per second
    processor: int  # code of the format of its numbers
    data_start: int  # where the frames begin [bytes]
    scale: float  # of positions stored as 16-bit integers; negative where they are reals
    parameters: Parameters  # by `GROUP:NAME`

    @property
    def are_integers(self) -> bool:
        """Whether points and samples are 16-bit integers."""
        return self.scale > 0

    @property
    def frame_bytes(self) -> int:
        """Size of one frame: four numbers of each point, and its analog samples."""
        numbers = 4 * self.points + self.channels * self.samples_per_frame
        return numbers * (2 if self.are_integers else 4)

    def texts(self, name: str) -> list[str]:
        """The values of a parameter with its continuations, as text; empty where there is none."""
        parts = [self.parameters.get(name + suffix, []) for suffix in CONTINUATIONS]
        return [str(value) for part in parts for value in np.ravel(part, order="F")]

    def numbers(self, name: str) -> Array:
        """The values of a numeric parameter."""
        return np.array(self.texts(name), float)

    def number(self, name: str) -> float:
        """The first number of a parameter; 0 where the file has none that is finite."""
        return float(np.nan_to_num(self.numbers(name)[:1], posinf=0.0, neginf=0.0).sum())

    def numbers_of_plates(self, name: str) -> Array:
        """A parameter of FORCE_PLATFORM in its dimensions; empty where there is none."""
        return np.asarray(self.parameters.get(f"FORCE_PLATFORM:{name}", ()), float)

    @property
    def length_unit(self) -> str:
        """Unit of positions; empty where the file has none."""
        return "".join(self.texts("POINT:UNITS")[:1])


def parse_numbers(data: bytes, kind: str, processor: int) -> NDArray[Any]:
    """Read numbers of one type as a processor stores them.

    A real of DEC has its two 16-bit words exchanged, and an exponent that is larger by 2 than that
    of IEEE 754: the same bits are four times the number.
    """
    if processor == DEC and kind == "f4":
        words = np.frombuffer(data, "<u2").reshape(-1, 2)
        exchanged = np.ascontiguousarray(words[:, ::-1])
        return exchanged.view("<f4").ravel() / np.float32(4)
    return np.frombuffer(data, BYTE_ORDERS[processor] + kind)


def processor_of(data: bytes) -> int:
    """Read the code of the processor whose number format a file has, from its parameter section.

    Raises
    ------
    InputError
        There is no such section, or its numbers are of a processor that is not known.
    """
    if len(data) < BLOCK_BYTES:
        raise InputError(
            f"holds {len(data)} bytes, and its header alone has {BLOCK_BYTES}: it is cut off",
            "copy the file again, or export the trial anew",
        )
    start = (data[0] - 1) * BLOCK_BYTES
    if not BLOCK_BYTES <= start < len(data) - 3:
        raise InputError(
            f"its header places the parameters at byte {start} of {len(data)}: it is damaged",
            "copy the file again, or export the trial anew",
        )
    processor = data[start + 3]
    if processor not in BYTE_ORDERS:
        raise InputError(
            f"its numbers are of processor type {processor}, and {INTEL} (Intel), {DEC} (DEC) and"
            f" {MIPS} (MIPS) are read: it is damaged, or no C3D file",
            "copy the file again, or export the trial anew",
        )
    return processor


def parse_header(data: bytes) -> Header:
    """Read the header block and the parameter section.

    Rate and long frame counts are taken from parameters where they exist.

    Raises
    ------
    InputError
        Its numbers are of another processor, or header or parameters are damaged.
    """
    processor = processor_of(data)
    start = (data[0] - 1) * BLOCK_BYTES
    counts = parse_numbers(data[:24], "u2", processor)
    _, points, analogs, first_frame, last_frame, *_ = counts.tolist()
    data_block, samples = counts[8:10].tolist()
    scale, rate_hz = parse_numbers(data[12:16] + data[20:24], "f4", processor).tolist()
    samples_per_frame = max(samples, 1)
    data_start = (data_block - 1) * BLOCK_BYTES
    if scale == 0 or not math.isfinite(scale) or data_start < BLOCK_BYTES:
        raise InputError(
            f"the scale of the points is {scale}, and the data begin at byte {data_start}: the"
            " header is damaged",
            "export the trial again",
        )
    parameters_end = data_start if data_start > start else len(data)
    parameters_end = min(parameters_end, len(data))
    parameters = parse_parameters(data, start + 4, parameters_end, processor)
    header = Header(
        points=points,
        channels=analogs // samples_per_frame,
        samples_per_frame=samples_per_frame,
        first_frame=first_frame,
        frames=last_frame - first_frame + 1,
        rate_hz=rate_hz,
        processor=processor,
        data_start=data_start,
        scale=scale,
        parameters=parameters,
    )
    if header.number("POINT:RATE") > 0:
        header = replace(header, rate_hz=header.number("POINT:RATE"))
    if last_frame == HEADER_WORDS - 1:
        header = replace(header, frames=_long_frames(header) or header.frames)
    return header


def _long_frames(header: Header) -> int:
    """Frames of a file with more than the header can count, which Vicon and Qualisys write as the
    first and the last one in two 16-bit words each, low word first (C3D manual)."""
    first = header.numbers("TRIAL:ACTUAL_START_FIELD") % HEADER_WORDS
    last = header.numbers("TRIAL:ACTUAL_END_FIELD") % HEADER_WORDS
    if first.size == last.size == 2:
        return int((last - first) @ [1, HEADER_WORDS]) + 1
    return int(max(header.number("POINT:LONG_FRAMES"), header.number("POINT:FRAMES")))


def parse_parameters(data: bytes, position: int, end: int, processor: int) -> Parameters:
    """Read the parameters by `GROUP:NAME`. Groups may follow their parameters."""
    groups = {}
    values = []
    while position < end and data[position] != 0:
        length, group = struct.unpack_from("bb", data, position)
        name_end = position + 2 + abs(length)
        name = data[position + 2 : name_end].decode("latin-1").strip().upper()
        value_end = name_end + 2
        # to the next record; 0 after the last
        (step,) = parse_numbers(data[name_end:value_end], "i2", processor).tolist()
        if group < 0:
            groups[-group] = name
        elif group > 0:
            value, value_end = _parameter_value(data, value_end, name, processor)
            values.append((group, name, value))
        position = name_end + step if step else end
        # else a damaged section is read as another one
        if group == 0 or not value_end <= position <= end:
            raise InputError(f"the parameter section is damaged after {name!r}", "export it again")
    return {f"{groups.get(group, group)}:{name}": value for group, name, value in values}


def _parameter_value(
    data: bytes, position: int, name: str, processor: int
) -> tuple[Array | list[str], int]:
    """Read one parameter from its type byte on; gives also the first byte behind it."""
    kind, dimensions = struct.unpack_from("bB", data, position)
    begin = position + 2 + dimensions
    shape = tuple(data[position + 2 : begin])
    end = begin + abs(kind) * math.prod(shape)
    content = data[begin:end]
    if kind not in (TEXT, *PARAMETER_TYPES) or len(data) < end:
        raise InputError(
            f"the parameter '{name}' has type {kind} and sizes {shape}, or reaches beyond the"
            " end of the file: it is damaged",
            "export the trial again",
        )
    if kind == TEXT:
        length = max(*shape[:1], 1)  # of each text
        texts = [content[at : at + length] for at in range(0, len(content), length)]
        return [decoded(text).strip(" \0") for text in texts], end
    values = parse_numbers(content, PARAMETER_TYPES[kind], processor)
    return values.astype(float).reshape(shape, order="F"), end


def check_file_size(data: bytes, header: Header) -> None:
    """Refuse a file that holds nothing, or other frames than its header declares."""
    if header.frame_bytes == 0 and header.number("ROTATION:USED") > 0:
        raise InputError(
            f"the file holds {header.number('ROTATION:USED'):g} rotations of segments at"
            f" {header.rate_hz:g} Hz and no marker: rotations are not read",
            "export positions of joints or virtual markers too",
        )
    frames, size = header.frames, header.frame_bytes
    whole = max(len(data) - header.data_start, 0) // max(size, 1)
    if size == 0 or not 1 <= frames <= whole or not 0 < header.rate_hz < math.inf:
        raise InputError(
            f"truncated or damaged: it declares {frames} frames of {size} bytes at"
            f" {header.rate_hz} Hz, and holds {whole}",
            "copy or export it again",
        )
    for group, count in (("POINT", header.points), ("ANALOG", header.channels)):
        used = header.numbers(f"{group}:USED")[:1] % HEADER_WORDS
        if (used != count).any():
            raise InputError(
                f"the header counts {count}, {group}:USED is {used[0]:g}", "export the trial again"
            )


def frames_of(data: bytes, header: Header) -> tuple[Array, Array]:
    """Read the frames.

    Analog values are (raw - OFFSET) * SCALE * GEN_SCALE, raw without these.

    Returns
    -------
    points
        Shape (frames, points, 3), in the file's unit of length; NaN where a point was not seen.
    analogs
        Shape (samples, channels); NaN where SCALE is of other channels, or GEN_SCALE is 0.
    """
    end = header.data_start + header.frames * header.frame_bytes
    content = data[header.data_start : end]
    raw = parse_numbers(content, "i2" if header.are_integers else "f4", header.processor)
    # x, y, z, residual of each point, then the analog samples
    rows = raw.reshape(header.frames, -1)
    points, samples = np.split(rows, [4 * header.points], axis=1)
    points = points.reshape(header.frames, header.points, 4)
    positions = points[:, :, :3].astype(float)
    if header.are_integers:
        positions *= header.scale
    is_origin = (positions == 0).all(axis=2)
    is_finite = np.isfinite(positions).all(axis=2)
    has_negative_residual = points[:, :, 3] < 0
    positions[has_negative_residual | is_origin | ~is_finite] = np.nan
    analogs = samples.reshape(header.frames * header.samples_per_frame, header.channels)
    return positions, _scaled(analogs.astype(float), header)


def _scaled(analogs: Array, header: Header) -> Array:
    scales = header.numbers("ANALOG:SCALE")
    scale = np.array(padded_to(header.channels, scales, math.nan if scales.size else 1.0))
    offset = np.array(padded_to(header.channels, header.numbers("ANALOG:OFFSET"), 0.0))
    if "UNSIGNED" in [text.upper() for text in header.texts("ANALOG:FORMAT")]:
        offset %= HEADER_WORDS
        if header.are_integers:
            analogs %= HEADER_WORDS
    analogs -= offset
    analogs *= scale
    general = header.numbers("ANALOG:GEN_SCALE")
    if general.size:
        analogs *= general[0] or np.nan
    return analogs


def _calibration_of_plate(header: Header, number: int) -> Array:
    """Read a plate's matrix (6, channels) from readings to force and moment.

    Those of a file with plates of 6 and of 8 channels have 8 columns each.
    """
    columns = header.numbers_of_plates("CAL_MATRIX").shape[1:2]
    matrix = _plate_parameter(header, "CAL_MATRIX", number, (6, *columns))
    if header.texts("FORCE_PLATFORM:MATRIX_STORE") == ["BYROW"]:
        return matrix.ravel(order="F").reshape(6, -1)
    return matrix


def _plate_parameter(header: Header, name: str, number: int, shape: Sequence[int] = ()) -> Array:
    """Read one plate's part, of a shape, of a FORCE_PLATFORM parameter.

    The last dimension counts plates. Some writers omit it if there is a single plate.
    """
    table = header.numbers_of_plates(name)
    parts = np.zeros(0)
    if table.shape[: len(shape)] == tuple(shape):
        parts = table.reshape(*shape, -1, order="F")
    if parts.shape[-1] < number or not np.isfinite(table).all():
        raise InputError(
            f"FORCE_PLATFORM:{name} has dimensions {table.shape}, or values that are not finite",
            "correct or remove it",
        )
    return parts[..., number - 1]


def plate_of(
    header: Header, channels: Sequence[Channel], number: int, geometry: PlateGeometry | None
) -> Plate:
    """Describe one plate by the source file or else FORCE_PLATFORM.

    Raises
    ------
    InputError
        What describes it contradicts itself.
    """
    calibration = None
    if geometry is not None:
        kind: int = geometry.type
        corners, origin = np.array(geometry.corners), np.array(geometry.origin)
        if geometry.calibration:
            calibration = np.array(geometry.calibration)
        recording = Recording("c3d", channels)
        plate_channels = [recording.find({"channel": label}) for label in geometry.channels]
        analogs = [channels.index(channel) + 1 for channel in plate_channels]
    else:
        kind = int(_plate_parameter(header, "TYPE", number))
        if kind == EXPORTED or kind not in MEASURED_BY_TYPE:
            raise InputError(
                f"it is of type {kind}, and types 1 to 5 are read",
                "if the file has its forces and moments as six channels, state it as type 2"
                " under `plate_geometry` in the source file, or else export it so",
            )
        corners = _plate_parameter(header, "CORNERS", number, (3, 4)).T
        origin = _plate_parameter(header, "ORIGIN", number, (3,))
        most = header.numbers_of_plates("CHANNEL").shape[:1]  # some list more than they use
        listed = _plate_parameter(header, "CHANNEL", number, most)
        analogs = listed[: CHANNELS_BY_TYPE[kind]].astype(int).tolist()
        if kind in CALIBRATED_CHANNELS:
            calibration = _calibration_of_plate(header, number)[:, : CALIBRATED_CHANNELS[kind]]
    if kind == 3 and not origin[:2].all():
        raise InputError(
            f"it is of type 3, and has ORIGIN {origin.tolist()}",
            "without its sensors' distances there is no moment: correct it",
        )
    needed = CHANNELS_BY_TYPE[kind]
    if len(analogs) != needed or not {*analogs} <= {*range(1, header.channels + 1)}:
        raise InputError(
            f"type {kind} has {needed} channels, and what describes it gives"
            f" {analogs} of the file's {header.channels}",
            "correct it",
        )
    return Plate(
        number=number,
        type=kind,
        corners=corners,
        origin=origin,
        channels=[channels[analog - 1] for analog in analogs],
        length_unit=header.length_unit,
        calibration=calibration,
        facts={"analogs": analogs},
    )


def plates_of(
    header: Header, channels: Sequence[Channel], source: C3dSource | None
) -> tuple[list[Plate], list[str]]:
    """Describe the plates that a source file asks for, or all, of the analog channels.

    Returns
    -------
    plates
    questions
        What is wrong with plates that are not asked for by a source file.
    """
    count = min(int(header.number("FORCE_PLATFORM:USED")), header.channels)
    geometries = source.plate_geometry if source is not None else {}
    numbers = sorted({*range(1, count + 1), *geometries})
    wanted = numbers if source is None or source.plates == "all" else source.plates
    plates = []
    questions = []
    numbered = enumerate(channels, 1)
    alike = [place for place, channel in numbered if PLATE_LABEL.search(channel.name)]
    plate_numbers = alike[: len(MEASURED_BY_TYPE[2])]
    state_plate = STATE_PLATE.format(numbers=plate_numbers)
    if not count and len(plate_numbers) == len(MEASURED_BY_TYPE[2]):
        names = [channels[place - 1].name for place in plate_numbers]
        questions.append(
            f"channels such as {listing(names)} look like those of a force plate, but the file has"
            f" no FORCE_PLATFORM and where it lies is not known; {state_plate}"
        )
    for number in wanted:
        if number not in numbers:
            raise InputError(
                f"no force plate {number}",
                f"the file describes {count}, counted from 1; {state_plate}",
            )
        try:
            with naming(f"plate {number}", " (or name the plates to read, as `plates: []`)"):
                plates.append(plate_of(header, channels, number, geometries.get(number)))
        except InputError as error:
            if source is not None:
                raise
            questions.append(str(error))
    return plates, questions


def _whole_frames(header: Header, analogs: Array) -> int:
    """Frames before the last ones in which samples are no numbers, as where forces stopped before
    cameras, or the last of which no sample was recorded; all if there are none."""
    lacks = np.asarray(~np.isfinite(analogs).all(axis=1))
    if len(analogs) > 1 and not analogs[-1].any() and analogs[-2].any():
        lacks[-1] = True
    by_frame = np.asarray(lacks.reshape(header.frames, -1).any(axis=1))
    return header.frames - int(np.argmin(by_frame[::-1]))


def _names_of(labels: Sequence[str]) -> list[str]:
    """Names of points: what stands behind the subject, or rigid body, in `P07:RANK`.

    Those that several have, as `P07:RANK` and `P08:RANK`, stay as they are. So a marker has one
    name in all recordings, whoever else is seen in them.
    """
    behind = {label: label.rpartition(":")[2] for label in labels}
    uses = Counter(behind.values())  # each label once
    return [behind[label] if uses[behind[label]] == 1 else label for label in labels]


BESIDE = ("_forces", "_force", "_plates", "_fp", "_grf", "_analogs", "_analog")
"""What laboratories add to the name of a capture for a file of its force plates alone."""


def files_of_trial(path: Path) -> list[Path]:
    """A capture, and the file beside it that has its force plates."""
    named = [path.with_name(f"{path.stem}{ending}{path.suffix}") for ending in BESIDE]
    return [path, *(file for file in named if file.is_file())]


def read(path: Path, source: C3dSource | None) -> Recording:
    """Read a C3D file with those beside it. Frame 0 and analog sample 0 are at 0 s."""
    _, *other_files = files_of_trial(path)
    if not other_files:
        return read_file(path, source)
    without_plates = source.model_copy(update={"plates": ()}) if source is not None else None
    recording = read_file(path, without_plates)
    for file in other_files:
        with naming(file):
            recording = with_plates_of(recording, read_file(file, source))
    return recording


def with_plates_of(markers: Recording, forces: Recording) -> Recording:
    """The markers of one file with the plates and analog channels of another.

    Raises
    ------
    InputError
        They are of other frames, or the first has plates of its own.
    """
    same = ("frames", "first_frame", "frame_rate_hz")
    force_frames = {name: forces.facts[name] for name in same}
    marker_frames = {name: markers.facts[name] for name in same}
    if force_frames != marker_frames or markers.plates:
        raise InputError(
            f"has frames {force_frames['first_frame']:g} on, {force_frames['frames']} at"
            f" {force_frames['frame_rate_hz']:g} Hz, the markers beside it"
            f" {marker_frames['first_frame']:g} on, {marker_frames['frames']} at"
            f" {marker_frames['frame_rate_hz']:g} Hz, and {len(markers.plates)} plates",
            "export both of the same frames, or rename one if they are of two trials",
        )
    analogs = [channel for channel in forces.channels if channel.kind == Kind.SIGNAL]
    facts = {
        name: forces.facts[name] for name in ("samples_per_frame", "plates", "plate_zero_frames")
    }
    remarks = [*markers.loss.remarks, *forces.loss.remarks]
    return replace(
        markers,
        channels=[*markers.channels, *analogs],
        plates=forces.plates,
        questions=[*markers.questions, *forces.questions],
        facts={**markers.facts, **facts},
        loss=replace(markers.loss, remarks=remarks),
    )


def read_file(path: Path, source: C3dSource | None) -> Recording:
    """Read one C3D file."""
    data = path.read_bytes()
    header = parse_header(data)
    check_file_size(data, header)
    points, analogs = frames_of(data, header)
    labels = header.texts("POINT:LABELS")[: header.points]
    analog_labels = padded_to(header.channels, header.texts("ANALOG:LABELS"), "")
    analog_labels = [label or f"analog {place}" for place, label in enumerate(analog_labels, 1)]
    remarks = []
    fast_rate_hz = header.rate_hz * header.samples_per_frame
    frames = _whole_frames(header, analogs)
    if frames < header.frames:
        remarks.append(
            f"the last {header.frames - frames} frames, in which samples are no numbers or were not"
            " recorded, are left out"
        )
    groups = header.texts("POINT:TYPE_GROUPS")[::2]
    outputs = {label for group in groups for label in header.texts(f"POINT:{group.upper()}")}
    slow = Rows(frames, "points", header.rate_hz, noun="frame")
    fast = Rows(frames * header.samples_per_frame, "analogs", fast_rate_hz, noun="sample")
    channels = []
    for place, (label, name) in enumerate(zip(labels, _names_of(labels), strict=True)):
        read_points = partial(np.asanyarray, points[:frames, place])
        is_output = label in outputs
        kind = Kind.MODEL_OUTPUT if is_output else Kind.MARKER
        unit = "" if is_output else header.length_unit
        channels.append(Channel({"label": label}, slow, read_points, name, unit=unit, kind=kind))
    units = padded_to(header.channels, header.texts("ANALOG:UNITS"), "")
    analog_channels = []
    for label, unit, samples in zip(analog_labels, units, analogs[: fast.count].T, strict=True):
        read_samples = partial(np.asanyarray, samples)
        analog_channels.append(Channel({"channel": label}, fast, read_samples, label, unit=unit))
    plates, questions = plates_of(header, analog_channels, source)
    facts = {
        "frames": frames,
        "first_frame": header.first_frame,
        "frame_rate_hz": header.rate_hz,
        "samples_per_frame": header.samples_per_frame,
        "length_unit": header.length_unit,
        "vertical_on_screen": "".join(header.texts("POINT:Y_SCREEN")[:1]),
        "plates": int(header.number("FORCE_PLATFORM:USED")),
        "plate_zero_frames": header.numbers("FORCE_PLATFORM:ZERO").tolist(),
        "body_mass_kg": header.number("PROCESSING:BODYMASS") or None,
    }
    return Recording(
        format="c3d",
        channels=channels + analog_channels,
        loss=Loss(frames, header.frames, remarks=remarks),
        questions=questions,
        plates=plates,
        facts=facts,
    )


FORMAT = Format(
    name="c3d",
    suffixes=(".c3d",),
    begins=re.compile(rb"[\0-\x1f]P").match,
    source=C3dSource,
    read=read,
    files_in=files_of_trial,
)
