"""Numbers in the bytes of many messages, read at once: one row of bytes per message, one leaf per number."""

from dataclasses import dataclass
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]


def byte_rows(buffer: bytes | mmap, starts: Indices, length: int) -> Bytes:
    """The `length` bytes from each start, shape (starts, length), through one overlapping view of the buffer."""
    if length == 0 or starts.size == 0:
        return np.empty((starts.size, length), np.uint8)
    windows = np.ndarray((len(buffer) - length + 1,), f"V{length}", buffer, 0, (1,))
    return windows[starts].view(np.uint8).reshape(starts.size, length)


def value_at(rows: Bytes, offset: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """What stands at `offset` in each of the messages, a view."""
    return np.ndarray((len(rows),), kind, rows, offset, (rows.shape[1],)) if len(rows) else np.empty(0, kind)


def distinct(values: NDArray[Any]) -> list[int]:
    """The different ones of whole numbers, most often a single one."""
    if values.size and (values == values[0]).all():
        return [int(values[0])]
    return [int(value) for value in np.unique(values)]


@dataclass(frozen=True)
class Leaf:
    """Where a number, or an array of `count` numbers, stands in a message; `dtype` carries the byte order."""

    offset: int
    dtype: str
    count: int | None = None

    def read(self, rows: Bytes) -> NDArray[Any]:
        """Its values in messages of one shape, `rows` of shape (messages, length)."""
        kind = np.dtype(self.dtype.replace("?", "u1"))
        native: NDArray[Any] = value_at(rows, self.offset, kind).astype(kind.newbyteorder("="))
        return native != 0 if "?" in self.dtype else native


@dataclass(frozen=True)
class Varint:
    """A number in as many bytes as it takes, seven bits in each, the least first; `kind` names what they mean."""

    offset: int
    size: int
    kind: str
    count: None = None

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
    """A number that is not written because it is its type's zero."""

    dtype: str
    count: None = None

    def read(self, rows: Bytes) -> NDArray[Any]:
        """Zeros."""
        return np.zeros(len(rows), self.dtype)


AnyLeaf = Leaf | Varint | Constant
