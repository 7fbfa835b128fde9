"""Numbers in the bytes of many messages, read at once: one row of bytes per message, one leaf per number."""

from dataclasses import dataclass
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]


def byte_rows(buffer: bytes | mmap, starts: Indices, length: int) -> Bytes:
    """The `length` bytes from each start on, shape (starts, length), copied through one overlapping view."""
    if length == 0 or starts.size == 0:
        return np.empty((starts.size, length), np.uint8)
    windows = np.ndarray((len(buffer) - length + 1,), f"V{length}", buffer, 0, (1,))
    return windows[starts].view(np.uint8).reshape(starts.size, length)


def value_at(rows: Bytes, offset: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """The numbers at `offset` in each of the messages, (messages,), as a view."""
    return np.ndarray((len(rows),), kind, rows, offset, (rows.shape[1],)) if len(rows) else np.empty(0, kind)


def distinct(values: NDArray[Any]) -> list[int]:
    """The different values among whole numbers; fast where all are equal, as they mostly are."""
    if values.size and (values == values[0]).all():
        return [int(values[0])]
    return [int(value) for value in np.unique(values)]


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
        total = np.zeros(len(rows), np.uint64)
        for i in range(self.size):
            total |= (rows[:, self.offset + i].astype(np.uint64) & np.uint64(0x7F)) << np.uint64(7 * i)
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
