# SPDX-License-Identifier: Apache-2.0
"""C3D files byte by byte, independent of every reader: floats or integers, any
parameters."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

INTEL = 84  # its code
UNITS_OF_PLATE = ["N"] * 3 + ["Nmm"] * 3
FACE = np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]])
"""Corners of a plate [m], in its axes."""


def write_c3d(
    path: Path, points: np.ndarray, analogs: np.ndarray | None = None, rate: float = 100.0,
    integers: bool = False, **parameters: object,
) -> Path:  # fmt: skip
    """Write raw points (frames, points, xyz and residual) and analogs (samples, channels);
    parameters `GROUP__NAME`."""
    analogs = np.zeros((len(points), 0)) if analogs is None else analogs
    ratio = len(analogs) // len(points)
    known = {
        "POINT__USED": points.shape[1], "POINT__FRAMES": len(points),
        "POINT__SCALE": 0.1 if integers else -0.1, "POINT__RATE": rate,
        "POINT__UNITS": ["mm"],
        "POINT__LABELS": [f"M{i + 1}" for i in range(points.shape[1])],
        "ANALOG__USED": analogs.shape[1],
        "ANALOG__RATE": rate * ratio, "ANALOG__SCALE": np.ones(analogs.shape[1]),
        "ANALOG__GEN_SCALE": 1.0, "ANALOG__OFFSET": np.zeros(analogs.shape[1], int),
        "ANALOG__LABELS": [f"A{i + 1}" for i in range(analogs.shape[1])],
        "ANALOG__UNITS": ["V"] * analogs.shape[1],
        "FORCE_PLATFORM__USED": 0,
    }  # fmt: skip
    known["POINT__DATA_START"] = 0
    data_start = 2 + len(parameter_section({**known, **parameters})) // 512
    known["POINT__DATA_START"] = data_start
    section = parameter_section({**known, **parameters})
    counts = [points.shape[1], analogs.shape[1] * ratio, 1, min(len(points), 65535), 0]
    header = bytes([2, 0x50]) + integers_of(counts) + reals_of(known["POINT__SCALE"])
    header += integers_of([data_start, ratio]) + reals_of(rate)
    frames = np.hstack([points.reshape(len(points), -1), analogs.reshape(len(points), -1)])
    data = integers_of(frames) if integers else reals_of(frames)
    content = header.ljust(512, b"\0") + section + data
    path.write_bytes(content.ljust(-(-len(content) // 512) * 512, b"\0"))
    return path


def level_plates(*corners: np.ndarray) -> dict[str, Any]:
    """Parameters of plates of type 2 with these corners (4, 3) [mm], all of the first six
    channels."""
    count = len(corners)
    facts = {
        "USED": count, "TYPE": np.full(count, 2), "ORIGIN": np.zeros((3, count)),
        "CORNERS": np.dstack([one.T for one in corners]),
        "CHANNEL": np.arange(1, 7)[:, None] + np.zeros(count, int),
    }  # fmt: skip
    return {f"FORCE_PLATFORM__{name}": fact for name, fact in facts.items()}


def parameter_section(parameters: dict[str, object]) -> bytes:
    """Groups first, then their parameters, padded to blocks of 512 bytes."""
    groups = list(dict.fromkeys(name.split("__")[0] for name in parameters))
    records = [record(-number, group, b"\0") for number, group in enumerate(groups, start=1)]
    for name, value in parameters.items():
        group, own = name.split("__")
        records.append(record(groups.index(group) + 1, own, content(value) + b"\0"))
    body = b"".join(records) + b"\0\0"
    blocks = -(-(len(body) + 4) // 512)
    return (bytes([1, 0x50, blocks, INTEL]) + body).ljust(blocks * 512, b"\0")


def integers_of(values: ArrayLike) -> bytes:
    """16-bit integers, signed or not."""
    return (np.asarray(values).astype(np.int64) % 65536).astype("<u2").tobytes()


def reals_of(values: ArrayLike) -> bytes:
    return np.asarray(values).astype("<f4").tobytes()


def record(group: int, name: str, rest: bytes) -> bytes:
    step = integers_of(2 + len(rest))
    return struct.pack("bb", len(name), group) + name.encode() + step + rest


def content(value: object) -> bytes:
    if isinstance(value, list):
        length = max([len(text) for text in value], default=1) or 1
        joined = b"".join(text.encode("latin-1").ljust(length) for text in value)
        return struct.pack("bBBB", -1, 2, length, len(value)) + joined
    if isinstance(value, bytes):
        return struct.pack("bBB", 1, 1, len(value)) + value
    array = np.atleast_1d(value)
    whole = array.dtype.kind == "i"
    flat = array.ravel(order="F")
    stored = integers_of(flat) if whole else reals_of(flat.astype(float))
    return struct.pack("bB", 2 if whole else 4, array.ndim) + bytes(array.shape) + stored
