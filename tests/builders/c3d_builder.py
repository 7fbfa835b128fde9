# SPDX-License-Identifier: Apache-2.0
"""C3D files byte by byte, independent of every reader: floats or integers, any
parameters."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

INTEL, DEC, MIPS = 84, 85, 86  # codes of processors
UNITS_OF_PLATE = ["N"] * 3 + ["Nmm"] * 3
FACE = np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]])
"""Corners of a plate [m], in its axes."""


def write_c3d(
    path: Path,
    points: np.ndarray,
    analogs: np.ndarray | None = None,
    rate: float = 100.0,
    integers: bool = False,
    processor: int = INTEL,
    **parameters: object,
) -> Path:
    """Write raw points (frames, points, xyz and residual) and analogs (samples, channels);
    parameters `GROUP__NAME`."""
    analogs = np.zeros((len(points), 0)) if analogs is None else analogs
    ratio = len(analogs) // len(points)
    known = {
        "POINT__USED": points.shape[1],
        "POINT__FRAMES": len(points),
        "POINT__SCALE": 0.1 if integers else -0.1,
        "POINT__RATE": rate,
        "POINT__UNITS": ["mm"],
        "POINT__LABELS": [f"M{i + 1}" for i in range(points.shape[1])],
        "ANALOG__USED": analogs.shape[1],
        "ANALOG__RATE": rate * ratio,
        "ANALOG__SCALE": np.ones(analogs.shape[1]),
        "ANALOG__GEN_SCALE": 1.0,
        "ANALOG__OFFSET": np.zeros(analogs.shape[1], int),
        "ANALOG__LABELS": [f"A{i + 1}" for i in range(analogs.shape[1])],
        "ANALOG__UNITS": ["V"] * analogs.shape[1],
        "FORCE_PLATFORM__USED": 0,
    }
    known["POINT__DATA_START"] = 0
    data_start = 2 + len(parameter_section({**known, **parameters}, processor)) // 512
    known["POINT__DATA_START"] = data_start
    section = parameter_section({**known, **parameters}, processor)
    counts = [points.shape[1], analogs.shape[1] * ratio, 1, min(len(points), 65535), 0]
    header = bytes([2, 0x50]) + integers_of(counts, processor)
    header += reals_of(known["POINT__SCALE"], processor)
    header += integers_of([data_start, ratio], processor) + reals_of(rate, processor)
    frames = np.hstack([points.reshape(len(points), -1), analogs.reshape(len(points), -1)])
    data = integers_of(frames, processor) if integers else reals_of(frames, processor)
    content = header.ljust(512, b"\0") + section + data
    path.write_bytes(content.ljust(-(-len(content) // 512) * 512, b"\0"))
    return path


def level_plates(*corners: np.ndarray) -> dict[str, Any]:
    """Parameters of plates of type 2 with these corners (4, 3) [mm], all of the first six
    channels."""
    count = len(corners)
    facts = {
        "USED": count,
        "TYPE": np.full(count, 2),
        "ORIGIN": np.zeros((3, count)),
        "CORNERS": np.dstack([one.T for one in corners]),
        "CHANNEL": np.arange(1, 7)[:, None] + np.zeros(count, int),
    }
    return {f"FORCE_PLATFORM__{name}": fact for name, fact in facts.items()}


def parameter_section(parameters: dict[str, object], processor: int = INTEL) -> bytes:
    """Groups first, then their parameters, padded to blocks of 512 bytes."""
    groups = list(dict.fromkeys(name.split("__")[0] for name in parameters))
    records = [
        record(-number, group, b"\0", processor) for number, group in enumerate(groups, start=1)
    ]
    for name, value in parameters.items():
        group, own = name.split("__")
        rest = content(value, processor) + b"\0"
        records.append(record(groups.index(group) + 1, own, rest, processor))
    body = b"".join(records) + b"\0\0"
    blocks = -(-(len(body) + 4) // 512)
    return (bytes([1, 0x50, blocks, processor]) + body).ljust(blocks * 512, b"\0")


def integers_of(values: ArrayLike, processor: int = INTEL) -> bytes:
    """16-bit integers, signed or not."""
    kind = ">u2" if processor == MIPS else "<u2"
    whole = np.atleast_1d(values).astype(np.int64) % 65536
    return whole.astype(kind).tobytes()


def reals_of(values: ArrayLike, processor: int = INTEL) -> bytes:
    """Reals of IEEE 754, or of DEC's F_floating, bit by bit: a sign, 8 bits of an exponent from
    128 on, and 23 bits behind the first one of a fraction from 0.5 to 1, in two words of which
    the upper one comes first."""
    if processor != DEC:
        return np.atleast_1d(values).astype(">f4" if processor == MIPS else "<f4").tobytes()
    numbers = np.ravel(np.asarray(values, float).astype("f4").astype(float), order="C")
    fraction, exponent = np.frexp(np.abs(numbers))
    hidden = np.round(fraction * 2**24).astype(np.int64) - 2**23
    bits = (np.signbit(numbers) * 2**31) + (exponent + 128) * 2**23 + hidden
    bits = np.where(numbers == 0, 0, bits)
    return np.column_stack([bits >> 16, bits & 0xFFFF]).astype("<u2").tobytes()


def record(group: int, name: str, rest: bytes, processor: int = INTEL) -> bytes:
    step = integers_of(2 + len(rest), processor)
    return struct.pack("bb", len(name), group) + name.encode() + step + rest


def content(value: object, processor: int = INTEL) -> bytes:
    if isinstance(value, list):
        length = max([len(text) for text in value], default=1) or 1
        joined = b"".join(text.encode("latin-1").ljust(length) for text in value)
        return struct.pack("bBBB", -1, 2, length, len(value)) + joined
    if isinstance(value, bytes):
        return struct.pack("bBB", 1, 1, len(value)) + value
    array = np.atleast_1d(value)
    whole = array.dtype.kind == "i"
    flat = array.ravel(order="F")
    stored = (integers_of if whole else reals_of)(flat, processor)
    return struct.pack("bB", 2 if whole else 4, array.ndim) + bytes(array.shape) + stored
