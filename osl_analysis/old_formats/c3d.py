"""C3D: header, parameters, points and analog samples of a motion capture recording.

`ezc3d` is not used: it misplaces frames where ANALOG:RATE and the header disagree, drops those
beyond 65535 and those of a truncated file, takes the absolute value of a negative OFFSET, and
crashes on damaged headers. Tests compare."""

import math
import struct
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, quoted
from osl_analysis.old_formats.table import Ledger
from osl_analysis.trial import Array

ENDIAN = {"Intel": "<", "DEC": "<", "MIPS": ">"}

Parameters = dict[str, "Array | list[str]"]


def parse_parameters(data: bytes, position: int, end: int, processor: str) -> Parameters:
    """The parameters by `GROUP:NAME`. Groups may follow their parameters."""
    groups, found = dict[int, str](), list[tuple[int, str, Array | list[str]]]()
    while position < end and data[position] != 0:
        length, group = struct.unpack_from("bb", data, position)
        name_end = position + 2 + abs(length)
        name = data[position + 2 : name_end].decode("latin-1").strip().upper()
        # to the next record; 0 after the last
        (step,) = struct.unpack_from(f"{ENDIAN[processor]}h", data, name_end)
        if step < 0 or group == 0:
            raise InputError(f"the parameter section is damaged after {name!r}")
        value_end = name_end + 2
        if group < 0:
            groups[-group] = name
        else:
            value, value_end = parameter_value(data, name_end + 2, processor, name)
            found.append((group, name, value))
        position = name_end + step
        if step == 0:
            break
        if not value_end <= position <= end:
            raise InputError(f"the parameter section is damaged after {name!r}")
    return {f"{groups.get(group, group)}:{name}": value for group, name, value in found}


def parameter_value(
    data: bytes, position: int, processor: str, name: str
) -> tuple[Array | list[str], int]:
    """One parameter from its type byte on, and the first byte behind it."""
    kind, dimensions = struct.unpack_from("bB", data, position)
    if kind not in (-1, 1, 2, 4) or dimensions > 7:  # text, byte, integer, real
        raise InputError(
            f"the parameter '{name}' has type {kind} and {dimensions} dimensions: the section is"
            " damaged"
        )
    shape = tuple(data[position + 2 : position + 2 + dimensions])
    begin = position + 2 + dimensions
    content = data[begin : begin + abs(kind) * math.prod(shape)]
    if len(content) != abs(kind) * math.prod(shape):
        raise InputError(f"the parameter '{name}' reaches beyond the end of the file")
    if kind == -1:
        length, texts = (shape[0] if shape else 1) or 1, list[str]()  # of each text
        for one in (content[i : i + length] for i in range(0, len(content), length)):
            try:
                texts.append(one.decode("utf-8").strip(" \0"))
            except UnicodeDecodeError:
                texts.append(one.decode("latin-1").strip(" \0"))
        return texts, begin + len(content)
    whole = "u1" if kind == 1 else f"{ENDIAN[processor]}i2"
    values = reals(content, processor) if kind == 4 else np.frombuffer(content, whole)
    with np.errstate(invalid="ignore"):  # a damaged real may be no number
        return values.astype(np.float64).reshape(shape, order="F"), begin + len(content)


def reals(content: bytes, processor: str) -> NDArray[np.float32]:
    """32-bit reals; DEC stores the two halves swapped, and an exponent that is larger by two."""
    if processor != "DEC":
        return np.frombuffer(content, f"{ENDIAN[processor]}f4").astype(np.float32)
    halves = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
    with np.errstate(invalid="ignore"):
        return np.ascontiguousarray(halves).view("<f4")[:, 0] * np.float32(0.25)


BLOCK, ONE_NUMBER = 512, 4  # bytes
# a parameter holds 255 values; more follow in NAME2, NAME3, ...
CONTINUATIONS = ("", *map(str, range(2, 10)))


@dataclass(frozen=True)
class C3DHeader:
    processor: str  # number format of the file: Intel, DEC or MIPS
    points: int  # points per frame, model outputs included
    first_frame: int  # number of the first frame, as the laboratory counts
    frames: int
    rate: float  # frames per second [Hz]
    samples_per_frame: int  # samples of each analog channel per frame
    channels: int
    data_start: int  # where the data section begins [bytes]
    scale: float  # of positions stored as 16-bit integers; negative where they are reals
    # by `GROUP:NAME`, numbers in the file's dimensions (first index fastest) or texts
    parameters: Parameters

    def table(self, name: str) -> Array:
        """A numeric parameter in its own dimensions; empty where the file has none."""
        value = self.parameters.get(name, [])
        return np.zeros(0) if isinstance(value, list) else value

    def numbers(self, name: str) -> Array:
        """A numeric parameter, flat, with its continuations (SCALE, SCALE2, ...); empty where the
        file has none."""
        return np.concatenate(
            [self.table(name + suffix).ravel(order="F") for suffix in CONTINUATIONS]
        )

    def texts(self, name: str) -> list[str]:
        """A text parameter with its continuations (LABELS, LABELS2, ...); empty where the file has
        none."""
        values = [self.parameters.get(name + suffix, []) for suffix in CONTINUATIONS]
        return [text for value in values if isinstance(value, list) for text in value]


def is_c3d(begin: bytes) -> bool:
    return begin[1:2] == b"P" and begin[:1] < b" " and b"\0" in begin


def parse_header(data: bytes) -> C3DHeader:
    """Header block and parameter section; rate and long frame counts are taken from parameters
    where they exist."""
    if len(data) < 2 * BLOCK or data[1:2] != b"P":
        raise InputError(
            f"not a C3D file (it begins with {quoted(data[:4])}); check the path and the source's"
            " format"
        )
    start = (data[0] - 1) * BLOCK
    processor = (
        {84: "Intel", 85: "DEC", 86: "MIPS"}.get(data[start + 3])
        if 0 < start < len(data) - 3
        else None
    )
    if processor is None:
        known = ", ".join(ENDIAN)
        raise InputError(
            f"written for a processor of an unknown type; {known} are read: export the trial again"
        )
    words = np.frombuffer(data[:24], f"{ENDIAN[processor]}u2").astype(int)
    points, channels, first, last, per_frame, data_block = (
        int(words[place]) for place in (1, 2, 3, 4, 9, 8)
    )
    scale, rate = (float(reals(data[begin : begin + 4], processor)[0]) for begin in (12, 20))
    per_frame, data_start = max(per_frame, 1), (data_block - 1) * BLOCK
    section_end = data_start if data_start > start else start + max(data[start + 2], 1) * BLOCK
    try:
        parameters = parse_parameters(data, start + 4, min(section_end, len(data)), processor)
        counts = (points, first, last - first + 1, rate, per_frame, channels // per_frame)
        header = C3DHeader(processor, *counts, data_start, scale, parameters)
        stated, long = header.numbers("POINT:RATE"), header.numbers("POINT:LONG_FRAMES")
        header = replace(header, rate=float(stated[0])) if stated.size and stated[0] > 0 else header
        if last == 0xFFFF:  # the largest number of the header
            # Vicon and Qualisys write first and last frame as two 16-bit words, low word first,
            # others LONG_FRAMES
            ends = [header.numbers(f"TRIAL:ACTUAL_{end}_FIELD") % 65536 for end in ("START", "END")]
            count = int(long[0]) if long.size and np.isfinite(long[0]) else 0
            if ends[0].size == ends[1].size == 2:
                count = int((ends[1] - ends[0]) @ [1, 65536]) + 1
            header = replace(header, frames=count or header.frames)
        if scale == 0 or not math.isfinite(scale):
            raise InputError(f"the scale of the points is {scale}")
        if data_start < BLOCK:
            raise InputError(f"the data begin at byte {data_start}, within the header")
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"damaged C3D file: {error}; export the trial again") from error
    return header


@dataclass(frozen=True)
class C3DRecording:
    """Content of a C3D file, in the file's units. Frame 0 and analog sample 0 are at 0 s."""

    header: C3DHeader  # counts and parameters
    # positions and model outputs, (frames, points, 3); NaN where a point was not seen
    points: Array
    # analog channels, (samples, channels), with `header.samples_per_frame` samples per frame
    analogs: Array
    damage: Ledger = field(default_factory=Ledger)

    def without_end(self, plate_channels: list[int]) -> "C3DRecording":
        """The frames before the last ones, in which channels, from 0, are no numbers: forces
        stopped before cameras."""
        ratio, finite = (
            self.header.samples_per_frame,
            np.isfinite(self.analogs[:, plate_channels]).all(axis=1),
        )
        frames = int(np.argmin(finite)) // ratio
        if not frames or finite.reshape(-1, ratio)[frames:].all(axis=1).any():
            return self
        lost = self.header.frames - frames
        self.damage.read[0] = frames
        said = f"the plates' samples are no numbers in the last {lost} frames, which are left out"
        self.damage.lose(said, 0, Counter({0: lost}), 0)
        header = replace(self.header, frames=frames)
        return replace(
            self, header=header, points=self.points[:frames], analogs=self.analogs[: frames * ratio]
        )

    @property
    def point_labels(self) -> list[str]:
        return self.header.texts("POINT:LABELS")[: self.header.points]

    @property
    def analog_labels(self) -> list[str]:
        return self.header.texts("ANALOG:LABELS")[: self.header.channels]

    @property
    def model_outputs(self) -> set[str]:
        """Labels of the points that hold angles, forces, moments, powers or scalars instead of
        positions."""
        groups = self.header.texts("POINT:TYPE_GROUPS")[::2]
        return {label for group in groups for label in self.header.texts(f"POINT:{group.upper()}")}

    def analog_unit(self, channel: int) -> str:
        """Unit of a channel counted from 0, as the file spells it, as that of positions; empty
        where it gives none."""
        units = self.header.texts("ANALOG:UNITS")
        return units[channel] if channel < len(units) else ""

    def point_unit(self) -> str:
        return (self.header.texts("POINT:UNITS") or [""])[0]


def check_end(data: bytes, start: int, frames: int, frame: int, damage: Ledger) -> None:
    """Note frames that may be shifted by bytes that were lost or doubled, which padding to whole
    blocks hides: the last frame that holds anything then ends in padding, as no other does, or its
    end stands in the padding. A joint at rest may have more zeros than a block has padding."""
    end = start + frames * frame
    every = (data[at : at + frame] for at in range(start, end, frame))
    # not of a frame of zeros
    ends = [frame - len(held) for one in every if (held := one.rstrip(b"\0"))]
    last, before = ends[-1] if ends else 0, max(ends[:-1], default=0)
    zeros = end - start - len(data[start:end].rstrip(b"\0"))
    if len(ends) > 1 and last > max(before, 3) and zeros < 2 * BLOCK:  # a lost block, and padding
        said = (
            f"the last frame ends in {last} zero bytes, others in {before} at most: bytes were lost"
            " before it"
        )
        if last > ONE_NUMBER:
            raise InputError(f"{said}, and frames behind them are shifted; copy or export it again")
        damage.lose(f"{said}, or its last channel is at 0", 0, None, 0)
    if data[end:].strip(b"\0"):
        damage.lose(
            "bytes that are not zero stand behind the last frame: frames may be shifted", 0, None, 0
        )


def read_c3d(path: Path) -> C3DRecording:
    """Decode a C3D file; InputError if it is no C3D, damaged or truncated, or contradicts itself.
    Analog values are (raw - OFFSET) * SCALE * GEN_SCALE, raw without these; NaN where SCALE is of
    other channels, or GEN_SCALE 0."""
    data = path.read_bytes()
    header = parse_header(data)
    for group, count in (("POINT", header.points), ("ANALOG", header.channels)):
        used = header.numbers(f"{group}:USED")[:1] % 65536
        if np.isfinite(used).all() and (used.astype(int) != count).any():
            raise InputError(
                f"the header counts {count}, {group}:USED is {used[0]:g}; export the trial again"
            )
    frames, integers = header.frames, header.scale > 0
    # [bytes]
    frame = (2 if integers else 4) * (
        4 * header.points + header.channels * header.samples_per_frame
    )
    # or a processor of another byte order wrote it
    if frames < 1 or frame == 0 or not 1e-6 < header.rate < 1e9:
        said = (
            f"declares {frames} frames of {frame} bytes at {header.rate} Hz, in the byte order of"
            f" {header.processor}"
        )
        raise InputError(f"{said}: nothing to read; export the trial again")
    there = max(len(data) - header.data_start, 0) // frame
    if there < frames:
        raise InputError(
            f"truncated: it declares {frames} frames and holds {there}; copy or export it again"
        )
    if header.first_frame + frames > 0xFFFF and there > frames + BLOCK // frame:
        raise InputError(
            f"holds {there} frames, more than the {0xFFFF} that a C3D header counts; export it in"
            " parts"
        )
    end, damage = header.data_start + frames * frame, Ledger(read=Counter({0: frames}))
    # some writers add a block
    if len(data) != end and (len(data) % BLOCK or len(data) - end >= 2 * BLOCK):
        if (stated := header.numbers("POINT:SCALE")[:1]).size and (stated[0] > 0) != integers:
            said = (
                f"the scale is {header.scale:g} in the header, {stated[0]:g} in POINT:SCALE (above"
                " 0: integers)"
            )
            raise InputError(
                f"{said}, and its frames end at byte {end} of {len(data)} by the header; export it"
                " again"
            )
        if len(data) % BLOCK:
            said = (
                f"it has {len(data)} bytes, and its frames end at byte {end}: bytes were lost or"
                " doubled on the way"
            )
            raise InputError(f"{said}, and frames behind them are shifted; copy or export it again")
        damage.lose(f"it has {len(data)} bytes, and its frames end at byte {end}", 0, None, 0)
    check_end(data, header.data_start, frames, frame, damage)
    content = data[header.data_start : end]
    raw = (
        np.frombuffer(content, f"{ENDIAN[header.processor]}i2")
        if integers
        else reals(content, header.processor)
    )
    rows = raw.reshape(frames, -1)  # x, y, z, residual per point, then analog samples
    points, samples = np.split(rows, [4 * header.points], axis=1)
    points = points.reshape(frames, header.points, 4)
    offset, scale, general = (
        header.numbers(f"ANALOG:{name}") for name in ("OFFSET", "SCALE", "GEN_SCALE")
    )
    # a sample that is not finite is refused where it is used
    with np.errstate(invalid="ignore", over="ignore"):
        analogs = samples.reshape(frames * header.samples_per_frame, header.channels).astype(
            np.float64
        )
        values = points[:, :, :3].astype(np.float64) * (header.scale if integers else 1.0)
        # not seen: a negative residual, exactly the origin, or a value that is not finite
        unseen = (
            (points[:, :, 3] < 0) | (values == 0).all(axis=2) | ~np.isfinite(values).all(axis=2)
        )
        values[unseen] = np.nan
        if "UNSIGNED" in [text.upper() for text in header.texts("ANALOG:FORMAT")]:
            offset, analogs = offset % 65536, analogs % 65536 if integers else analogs
        known, scaled = min(header.channels, offset.size), min(header.channels, scale.size)
        analogs[:, :known] -= offset[:known]
        analogs[:, :scaled] *= scale[:scaled]
        analogs[:, scaled:] *= np.nan if scaled else 1.0
        analogs *= (general[0] or np.nan) if general.size else 1.0
    return C3DRecording(header, values, analogs, damage)
