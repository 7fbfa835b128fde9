"""The header and the parameters of a C3D file, read before any decoder sees it.

Decoders trust these bytes: one returns fewer frames for a truncated file without a word, another crashes on a
damaged parameter section. Some damage passes all the same, so the decoder runs isolated (`isolation.py`).
"""

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
READ = ("Intel", "DEC")
KINDS = {-1: "S1", 1: "u1", 2: "<i2", 4: "<f4"}  # type of a parameter: text, byte, integer, real
CONTINUATIONS = ("", *map(str, range(2, 10)))  # a parameter holds 255 values; the next ones follow in NAME2, ...

Parameters = dict[str, "Array | list[str]"]


@dataclass(frozen=True)
class C3DHeader:
    """What the file declares: counts and places, and the parameters by `GROUP:NAME`.

    Arrays are float64 with the file's dimensions, first index fastest in the file (Fortran order); text is a
    list of stripped strings. `integers` says that samples are stored as 16-bit integers.
    """

    points: int
    first_frame: int
    frames: int
    rate: float
    samples_per_frame: int
    channels: int
    data_start: int
    integers: bool
    parameters: Parameters

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


def read_header(path: Path) -> C3DHeader:
    """Header and parameters, checked against each other and against the size of the file.

    Raises
    ------
    InputError
        No C3D file, a processor type that is not read, damaged parameters, or fewer frames than declared.
    """
    data = path.read_bytes()
    if len(data) < 2 * BLOCK or data[1] != KEY:
        raise InputError(
            f"{path}: not a C3D file (it begins with {data[:4]!r}); check the path and the source's format"
        )
    processor = PROCESSORS.get((data[(data[0] - 1) * BLOCK :][:4] or b"?")[-1], "of an unknown type")
    if processor not in READ:
        raise InputError(
            f"{path}: written for a processor {processor}; only {' and '.join(READ)} are read: save it as Intel "
            "in the laboratory's software, or in Mokka"
        )
    try:
        header = parse_header(data, processor == "DEC")
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"{path}: damaged C3D file: {error}; export the trial again") from error
    check_size(path, header, len(data))
    return header


def parse_header(data: bytes, dec: bool) -> C3DHeader:
    """Header block and parameter section, of an Intel or a DEC file."""
    words = np.frombuffer(data[:24], "<u2").astype(int)
    scale, rate = (float(reals(data[begin : begin + 4], dec)[0]) for begin in (12, 20))
    samples_per_frame = max(int(words[9]), 1)
    header = C3DHeader(
        points=int(words[1]),
        first_frame=int(words[3]),
        frames=int(words[4] - words[3] + 1),
        rate=rate,
        samples_per_frame=samples_per_frame,
        channels=int(words[2]) // samples_per_frame,
        data_start=(int(words[8]) - 1) * BLOCK,
        integers=scale > 0,
        parameters=parse_parameters(data, (data[0] - 1) * BLOCK + 4, dec),
    )
    stated = header.numbers("POINT:RATE")
    return replace(header, rate=float(stated[0])) if stated.size and stated[0] > 0 else header


def check_size(path: Path, header: C3DHeader, size: int) -> None:
    """Refuse what holds no frames, or more or fewer than it declares."""
    width = 2 if header.integers else 4
    frame = width * (4 * header.points + header.channels * header.samples_per_frame)
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


def parse_parameters(data: bytes, position: int, dec: bool) -> Parameters:
    """The parameter section from its first record on; groups may follow their parameters."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Array | list[str]]] = []
    while data[position] != 0:
        length, group = struct.unpack_from("bb", data, position)
        end = position + 2 + abs(length)
        name = data[position + 2 : end].decode("latin-1").strip().upper()
        (step,) = struct.unpack_from("<h", data, end)
        if group < 0:
            groups[-group] = name
        else:
            found.append((group, name, parameter_value(data, end + 2, dec, name)))
        if step < 0:
            raise InputError(f"the parameter section is damaged after {name!r}")
        if step == 0:
            break
        position = end + step
    return {f"{groups.get(group, group)}:{name}": value for group, name, value in found}


def parameter_value(data: bytes, position: int, dec: bool, name: str) -> Array | list[str]:
    """One parameter from its type byte on."""
    kind, dimensions = struct.unpack_from("bB", data, position)
    if kind not in KINDS or dimensions > 7:
        raise InputError(f"the parameter '{name}' has type {kind} and {dimensions} dimensions: the section is damaged")
    shape = tuple(data[position + 2 : position + 2 + dimensions])
    begin = position + 2 + dimensions
    content = data[begin : begin + abs(kind) * math.prod(shape)]
    if len(content) != abs(kind) * math.prod(shape):
        raise InputError(f"the parameter '{name}' reaches beyond the end of the file")
    if kind == -1:
        return text_values(content, shape[0] if shape else 1)
    values = reals(content, dec) if kind == 4 else np.frombuffer(content, KINDS[kind])
    return values.astype(np.float64).reshape(shape, order="F")


def text_values(content: bytes, length: int) -> list[str]:
    """Strings of equal length, stripped; in UTF-8, or in Latin-1 where they are not."""
    parts = [content[i : i + length] for i in range(0, len(content), length or 1)]
    return [decode(part).strip(" \0") for part in parts]


def decode(text: bytes) -> str:
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def reals(content: bytes, dec: bool) -> NDArray[np.float32]:
    """32-bit reals; DEC stores the halves swapped and an exponent that is two larger."""
    if not dec:
        return np.frombuffer(content, "<f4")
    halves = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
    return np.ascontiguousarray(halves).view("<f4")[:, 0] * np.float32(0.25)
