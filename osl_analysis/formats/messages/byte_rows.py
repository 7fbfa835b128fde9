"""Bytes of many messages at once, a row each."""

from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]


def gather(buffer: bytes | mmap, starts: Indices, length: int) -> Bytes:
    """The `length` bytes from each start, shape (starts, length), through one overlapping view of the buffer."""
    if length == 0 or starts.size == 0:
        return np.empty((starts.size, length), np.uint8)
    windows = np.ndarray((len(buffer) - length + 1,), f"V{length}", buffer, 0, (1,))
    return windows[starts].view(np.uint8).reshape(starts.size, length)


def column(rows: Bytes, offset: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """What stands at `offset` in each of the messages, a view."""
    return np.ndarray((len(rows),), kind, rows, offset, (rows.shape[1],)) if len(rows) else np.empty(0, kind)


def distinct(values: NDArray[Any]) -> list[int]:
    """The different ones of whole numbers, most often a single one."""
    if values.size and (values == values[0]).all():
        return [int(values[0])]
    return [int(value) for value in np.unique(values)]
