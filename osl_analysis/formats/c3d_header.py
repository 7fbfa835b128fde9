"""The header and the parameters of a C3D file, checked against each other and against the file's size."""

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.c3d_parameters import ENDIAN, Parameters, parse_parameters, reals
from osl_analysis.trial import Array

BLOCK = 512
KEY = 0x50
MOST_FRAMES = 0xFFFF
PROCESSORS = {84: "Intel", 85: "DEC", 86: "MIPS"}
CONTINUATIONS = ("", *map(str, range(2, 10)))  # a parameter holds 255 values; more follow in NAME2, NAME3, ...
ESSENTIAL = {
    "POINT": ("USED", "LABELS"),
    "ANALOG": ("USED", "LABELS", "SCALE", "OFFSET", "GEN_SCALE"),
}
"""Parameters without which points or analog samples would be read wrongly."""

Counts = Literal["refuse", "header", "parameters"]
"""Which counts of points and analog channels hold where header and parameters contradict each other."""


class CountsError(InputError):
    """Header and parameters count points or channels differently. `fitting`: which of them fit the file's size."""

    def __init__(self, message: str, fitting: tuple[Counts, ...]) -> None:
        super().__init__(message)
        self.fitting = fitting


@dataclass(frozen=True)
class C3DHeader:
    """What a file declares."""

    processor: str
    """Number format of the file: Intel, DEC or MIPS."""
    points: int
    """Points per frame, model outputs included."""
    first_frame: int
    """Number of the first frame, as the laboratory counts."""
    frames: int
    """Number of frames."""
    rate: float
    """Frames per second [Hz]."""
    samples_per_frame: int
    """Samples of each analog channel per frame."""
    channels: int
    """Number of analog channels."""
    data_start: int
    """Where the data section begins [bytes]."""
    scale: float
    """Units of length per count where positions are stored as 16-bit integers; negative where they are reals."""
    parameters: Parameters
    """By `GROUP:NAME` an array of float64 in the file's dimensions (first index fastest) or a list of texts."""
    remark: str = ""
    """Oddity of the parameter section; empty if there is none."""

    @property
    def integers(self) -> bool:
        """Whether samples are stored as 16-bit integers."""
        return self.scale > 0

    @property
    def frame_bytes(self) -> int:
        """Size of one frame in the data section [bytes]."""
        return (2 if self.integers else 4) * (4 * self.points + self.channels * self.samples_per_frame)

    def table(self, name: str) -> Array:
        """A numeric parameter in its own dimensions; empty where the file has none."""
        value = self.parameters.get(name, [])
        return np.zeros(0) if isinstance(value, list) else value

    def numbers(self, name: str) -> Array:
        """A numeric parameter, flat, with its continuations (SCALE, SCALE2, ...); empty where the file has none."""
        return np.concatenate([self.table(name + suffix).ravel(order="F") for suffix in CONTINUATIONS])

    def texts(self, name: str) -> list[str]:
        """A text parameter with its continuations (LABELS, LABELS2, ...); empty where the file has none."""
        values = [self.parameters.get(name + suffix, []) for suffix in CONTINUATIONS]
        return [text for value in values if isinstance(value, list) for text in value]


def is_c3d(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is a C3D file."""
    return begin[1:2] == bytes([KEY]) and b"\0" in begin


def parse_file(path: Path, data: bytes, counts: Counts = "refuse") -> C3DHeader:
    """Header and parameters of a file's content.

    Raises
    ------
    CountsError
        Header and parameters count points or channels differently, and `counts` does not say which holds.
    InputError
        The file is not C3D, its processor type is unknown, its parameters are damaged, `counts` contradicts its size,
        or it holds fewer frames than it declares.
    """
    if len(data) < 2 * BLOCK or data[1] != KEY:
        raise InputError(
            f"{path}: not a C3D file (it begins with {data[:4]!r}); check the path and the source's format"
        )
    start = (data[0] - 1) * BLOCK
    processor = PROCESSORS.get(data[start + 3]) if 0 < start < len(data) - 3 else None
    if processor is None:
        raise InputError(
            f"{path}: written for a processor of an unknown type; {', '.join(ENDIAN)} are read: export the trial again"
        )
    try:
        header = parse_header(data, start, processor)
        check_section(header)
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"{path}: damaged C3D file: {error}; export the trial again") from error
    header = with_counts(path, header, len(data), counts)
    check_size(path, header, len(data))
    return header


def parse_header(data: bytes, start: int, processor: str) -> C3DHeader:
    """Header block and parameter section; rate and long frame counts are taken from parameters where they exist."""
    words = np.frombuffer(data[:24], f"{ENDIAN[processor]}u2").astype(int)
    data_start = (int(words[8]) - 1) * BLOCK
    section_end = data_start if data_start > start else start + max(data[start + 2], 1) * BLOCK
    parameters, remark = parse_parameters(data, start + 4, min(section_end, len(data)), processor)
    scale, rate = (float(reals(data[begin : begin + 4], processor)[0]) for begin in (12, 20))
    samples_per_frame = max(int(words[9]), 1)
    header = C3DHeader(
        processor=processor,
        points=int(words[1]),
        first_frame=int(words[3]),
        frames=int(words[4] - words[3] + 1),
        rate=rate,
        samples_per_frame=samples_per_frame,
        channels=int(words[2]) // samples_per_frame,
        data_start=data_start,
        scale=scale,
        parameters=parameters,
        remark=remark,
    )
    stated = header.numbers("POINT:RATE")
    rated = replace(header, rate=float(stated[0])) if stated.size and stated[0] > 0 else header
    return replace(rated, frames=long_frames(rated) or rated.frames) if words[4] == MOST_FRAMES else rated


def long_frames(header: C3DHeader) -> int:
    """The number of frames where the 16 bits of the header cannot hold it; 0 where no parameter gives it.

    Vicon and Qualisys write the first and last frame as two 16-bit words, low word first, others POINT:LONG_FRAMES.
    """
    first, last = (header.numbers(f"TRIAL:ACTUAL_{end}_FIELD") % 65536 for end in ("START", "END"))
    if first.size == last.size == 2:
        return int((last - first) @ [1, 65536]) + 1
    stated = header.numbers("POINT:LONG_FRAMES")
    return int(stated[0]) if stated.size and np.isfinite(stated[0]) else 0


def check_section(header: C3DHeader) -> None:
    """Refuse a header without a scale or a place for the data, and a parameter section that ends early."""
    if header.scale == 0 or not math.isfinite(header.scale):
        raise InputError(f"the scale of the points is {header.scale}")
    if header.data_start < BLOCK:
        raise InputError(f"the data begin at byte {header.data_start}, within the header")
    for group, count in (("POINT", header.points), ("ANALOG", header.channels)):
        lost = [name for name in ESSENTIAL[group] if count and f"{group}:{name}" not in header.parameters]
        if header.remark and lost:
            raise InputError(f"{header.remark}, before {group}:{lost[0]}")


def with_counts(path: Path, header: C3DHeader, size: int, counts: Counts) -> C3DHeader:
    """The header with the counts of points and channels that hold; raises as `parse_file`."""
    used = {group: header.numbers(f"{group}:USED") for group in ESSENTIAL}
    stated = {"POINT": header.points, "ANALOG": header.channels}
    other = {
        group: int(one[0] % 65536) if one.size and math.isfinite(one[0]) else stated[group]
        for group, one in used.items()
    }
    if other == stated:
        return header
    choices: dict[Counts, C3DHeader] = {
        "header": header,
        "parameters": replace(header, points=other["POINT"], channels=other["ANALOG"]),
    }
    fitting = tuple(name for name, one in choices.items() if fits(one, size))
    group = next(group for group in stated if stated[group] != other[group])
    contradiction = f"{path}: the header counts {stated[group]}, {group}:USED is {other[group]}"
    says = f"the file's size fits {' and '.join(fitting) or 'neither'}"
    if counts == "refuse":
        raise CountsError(
            f"{contradiction}; {says}: write `counts: header` or `counts: parameters` in the source file", fitting
        )
    if fitting and counts not in fitting:
        raise InputError(f"{contradiction}; {says}: write `counts: {fitting[0]}` in the source file")
    return choices[counts]


def fits(header: C3DHeader, size: int) -> bool:
    """Whether a file of this size [bytes] holds the frames that the header declares, and at most two blocks more."""
    more = size - header.data_start - header.frames * header.frame_bytes
    return 0 <= more < 2 * BLOCK


def check_size(path: Path, header: C3DHeader, size: int) -> None:
    """Refuse a file that holds no frames, or more or fewer frames than it declares."""
    frame = header.frame_bytes
    if header.frames < 1 or frame == 0 or not 0 < header.rate < math.inf:
        raise InputError(
            f"{path}: declares {header.frames} frames of {frame} bytes at {header.rate} Hz: nothing to read; export "
            "the trial again"
        )
    there = max(size - header.data_start, 0) // frame
    if there < header.frames:
        raise InputError(
            f"{path}: truncated: it declares {header.frames} frames and holds {there}; copy or export it again"
        )
    if header.first_frame + header.frames > MOST_FRAMES and there > header.frames + BLOCK // frame:
        raise InputError(
            f"{path}: holds {there} frames, more than the {MOST_FRAMES} that a C3D header can count; export it in parts"
        )
