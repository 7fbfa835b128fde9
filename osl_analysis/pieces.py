"""A long record in pieces: what is computed of some rows at a time stays in a processor's cache, and small."""

from collections.abc import Iterator

AT_ONCE = 1 << 14
"""Rows that are computed at a time."""


def pieces(rows: int, size: int = AT_ONCE) -> Iterator[slice]:
    """All rows of a record, `size` at a time, in their order."""
    return (slice(first, min(first + size, rows)) for first in range(0, rows, size))
