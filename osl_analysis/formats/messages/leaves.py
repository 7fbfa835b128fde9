"""Numbers in the bytes of many messages, read at once: one row of bytes per message, one leaf per number."""

from dataclasses import dataclass
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]
SMALL = 1 << 16
"""Whole numbers below it are counted, which takes less time than to sort them."""


def byte_rows(buffer: bytes | mmap, starts: Indices, length: int) -> Bytes:
    """The `length` bytes from each start on, shape (starts, length), each row in one piece.

    Where the starts rise by the same step, as in a log of one kind of message, they are a view; else they are copied
    through one overlapping view.
    """
    if length == 0 or starts.size == 0:
        return np.empty((starts.size, length), np.uint8)
    first, last = int(starts[0]), int(starts[-1])
    step = (last - first) // max(starts.size - 1, 1)
    if 0 <= first and last + length <= len(buffer) and (starts[1:] - starts[:-1] == step).all():
        return np.ndarray((starts.size, length), np.uint8, buffer, first, (step, 1))
    windows = np.ndarray((len(buffer) - length + 1,), f"V{length}", buffer, 0, (1,))
    return windows[starts].view(np.uint8).reshape(starts.size, length)


def value_at(rows: Bytes, offset: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """The numbers at `offset` in each of the messages, (messages,), as a view."""
    return rows[:, offset : offset + kind.itemsize].view(kind)[:, 0]


def distinct(values: NDArray[Any]) -> list[int]:
    """The different values among whole numbers that are not negative, in order; fast where all are equal or small."""
    if values.size and (values == values[0]).all():
        return [int(values[0])]
    is_small = values.size and values.max() < SMALL
    return [int(value) for value in (np.flatnonzero(np.bincount(values)) if is_small else np.unique(values))]


@dataclass(frozen=True)
class Leaf:
    """A number, or an array of numbers, of fixed size."""

    offset: int
    """First byte in the message."""
    dtype: str
    """Type of the number in numpy's spelling, with its byte order; `?` for a bool."""
    count: int | None = None
    """Length of the array; None for a single number."""

    def read(self, rows: Bytes) -> NDArray[Any]:
        """Its values in messages of one shape, `rows` of shape (messages, length)."""
        kind = np.dtype(self.dtype.replace("?", "u1"))
        native: NDArray[Any] = value_at(rows, self.offset, kind).astype(kind.newbyteorder("="))
        return native != 0 if "?" in self.dtype else native


@dataclass(frozen=True)
class Varint:
    """A protobuf number of variable size: seven bits in each byte, the least significant first."""

    offset: int
    """First byte in the message."""
    size: int
    """Number of bytes."""
    kind: str
    """Type of the number in numpy's spelling; `zigzag` before it where the sign is in the lowest bit."""
    count: None = None
    """It is a single number."""

    def read(self, rows: Bytes) -> NDArray[Any]:
        """Its values in messages of one shape."""
        kind = np.dtype("u4" if self.size <= 4 else "u8")  # four bytes hold 28 bits
        parts = np.zeros(len(rows), kind)
        for i in range(self.size):
            parts |= (rows[:, self.offset + i] & np.uint8(0x7F)).astype(kind) << kind.type(7 * i)
        total = parts.astype(np.uint64)
        if self.kind == "?":
            return np.asarray(total != 0)
        if self.kind.startswith("zigzag"):
            total = (total >> np.uint64(1)) ^ (~(total & np.uint64(1)) + np.uint64(1))
        return total.astype(self.kind.removeprefix("zigzag"))


@dataclass(frozen=True)
class Constant:
    """A protobuf number that is not written because it is zero."""

    dtype: str
    """Type of the number in numpy's spelling."""
    count: None = None
    """It is a single number."""

    def read(self, rows: Bytes) -> NDArray[Any]:
        """Zeros."""
        return np.zeros(len(rows), self.dtype)


AnyLeaf = Leaf | Varint | Constant
