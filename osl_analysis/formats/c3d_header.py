"""The header and the parameters of a C3D file, checked against each other and against the file's size."""

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

BLOCK = 512
KEY = 0x50
MOST_FRAMES = 0xFFFF
PROCESSORS = {84: "Intel", 85: "DEC", 86: "MIPS"}
ENDIAN = {"Intel": "<", "DEC": "<", "MIPS": ">"}
SIZES = (-1, 1, 2, 4)  # type of a parameter: text, byte, integer, real
CONTINUATIONS = ("", *map(str, range(2, 10)))  # a parameter holds 255 values; more follow in NAME2, NAME3, ...

Parameters = dict[str, "Array | list[str]"]


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


def parse_file(path: Path, data: bytes) -> C3DHeader:
    """Header and parameters of a file's content.

    Raises
    ------
    InputError
        The file is not C3D, its processor type is unknown, its parameters are damaged, its counts contradict each
        other, or it holds fewer frames than it declares.
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
        check_counts(header)
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"{path}: damaged C3D file: {error}; export the trial again") from error
    check_size(path, header, len(data))
    return header


def parse_header(data: bytes, start: int, processor: str) -> C3DHeader:
    """Header block and parameter section; rate and long frame counts are taken from parameters where they exist."""
    words = np.frombuffer(data[:24], f"{ENDIAN[processor]}u2").astype(int)
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
        data_start=(int(words[8]) - 1) * BLOCK,
        scale=scale,
        parameters=parse_parameters(data, start + 4, processor),
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


def check_counts(header: C3DHeader) -> None:
    """Refuse counts that the parameters contradict: every frame would be read from a wrong place."""
    for group, count in (("POINT", header.points), ("ANALOG", header.channels)):
        used = header.numbers(f"{group}:USED")
        if used.size and used[0] % 65536 != count:
            raise InputError(f"the header counts {count}, {group}:USED is {used[0]:g}")
    if header.scale == 0 or not math.isfinite(header.scale):
        raise InputError(f"the scale of the points is {header.scale}")
    if header.data_start < BLOCK:
        raise InputError(f"the data begin at byte {header.data_start}, within the header")


def check_size(path: Path, header: C3DHeader, size: int) -> None:
    """Refuse a file that holds no frames, or more or fewer frames than it declares."""
    frame = header.frame_bytes
    if header.frames < 1 or frame == 0 or not 0 < header.rate < math.inf:
        raise InputError(
            f"{path}: declares {header.frames} frames of {frame} bytes at {header.rate} Hz: nothing to read"
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


def parse_parameters(data: bytes, position: int, processor: str) -> Parameters:
    """The parameter section from its first record on; groups may follow their parameters."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Array | list[str]]] = []
    while data[position] != 0:
        length, group = struct.unpack_from("bb", data, position)
        end = position + 2 + abs(length)
        name = data[position + 2 : end].decode("latin-1").strip().upper()
        (step,) = struct.unpack_from(f"{ENDIAN[processor]}h", data, end)
        if group < 0:
            groups[-group] = name
        else:
            found.append((group, name, parameter_value(data, end + 2, processor, name)))
        if step < 0:
            raise InputError(f"the parameter section is damaged after {name!r}")
        if step == 0:
            break
        position = end + step
    return {f"{groups.get(group, group)}:{name}": value for group, name, value in found}


def parameter_value(data: bytes, position: int, processor: str, name: str) -> Array | list[str]:
    """One parameter from its type byte on."""
    kind, dimensions = struct.unpack_from("bB", data, position)
    if kind not in SIZES or dimensions > 7:
        raise InputError(f"the parameter '{name}' has type {kind} and {dimensions} dimensions: the section is damaged")
    shape = tuple(data[position + 2 : position + 2 + dimensions])
    begin = position + 2 + dimensions
    content = data[begin : begin + abs(kind) * math.prod(shape)]
    if len(content) != abs(kind) * math.prod(shape):
        raise InputError(f"the parameter '{name}' reaches beyond the end of the file")
    if kind == -1:
        return text_values(content, shape[0] if shape else 1)
    whole = "u1" if kind == 1 else f"{ENDIAN[processor]}i2"
    values = reals(content, processor) if kind == 4 else np.frombuffer(content, whole)
    with np.errstate(invalid="ignore"):  # a damaged real may be no number
        return values.astype(np.float64).reshape(shape, order="F")


def text_values(content: bytes, length: int) -> list[str]:
    """Strings of equal length, stripped; in UTF-8, or else in Latin-1."""
    parts = [content[i : i + length] for i in range(0, len(content), length or 1)]
    return [text_of(part).strip(" \0") for part in parts]


def text_of(text: bytes) -> str:
    """Text in UTF-8, or else in Latin-1."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def reals(content: bytes, processor: str) -> NDArray[np.float32]:
    """32-bit reals; DEC stores the two halves swapped, and an exponent that is larger by two."""
    if processor != "DEC":
        return np.frombuffer(content, f"{ENDIAN[processor]}f4").astype(np.float32)
    halves = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
    with np.errstate(invalid="ignore"):
        return np.ascontiguousarray(halves).view("<f4")[:, 0] * np.float32(0.25)
