"""Large CSV files whose lines are all alike: their columns are read one at a time, never all cells as objects.

A list of rows takes a thousand bytes per line. Here a column is the text of its cells as polars holds it, which takes
sixteen. What is read is the same: a file with a quote, a comment, a space, or a line of another length below its first
lines is none of these files.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import overload

import numpy as np
import polars as pl

LARGE = 1 << 24
"""Size [bytes] from which a file may be read so."""
HEAD_LINES = 200
"""Lines at its beginning that are read as in any file: they tell delimiter, names and width."""
BLOCK = 1 << 23
"""Bytes that are looked at at a time."""
LONGEST_LINE = 100_000
"""A longer line [bytes] is for the ordinary reader, which says what is wrong with it."""
DELIMITERS = b",;|\t"
REFUSED = np.zeros(256, dtype=bool)
"""Bytes that are not in such a file: control signs, spaces, quotes, and what is not ASCII."""
REFUSED[[*range(33), ord('"'), *range(127, 256)]] = True
REFUSED[ord("\n")] = False


@dataclass(frozen=True)
class PlainBody(Sequence[tuple[int, list[str]]]):
    """The rows of a table, the first of which are known, and the others lines of a file that are all alike.

    path: the file.
    first: the known rows, the number of the line in the file and its cells each.
    start: byte at which the others begin.
    line: number of the line, counted from 1, that begins there.
    others: their number.
    delimiter: sign between cells.
    """

    path: Path
    first: list[tuple[int, list[str]]]
    start: int
    line: int
    others: int
    delimiter: str

    def __len__(self) -> int:
        return len(self.first) + self.others

    @overload
    def __getitem__(self, place: int) -> tuple[int, list[str]]: ...
    @overload
    def __getitem__(self, place: slice) -> list[tuple[int, list[str]]]: ...
    def __getitem__(self, place: int | slice) -> tuple[int, list[str]] | list[tuple[int, list[str]]]:
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        if place < 0:
            place += len(self)
        if place < len(self.first):
            return self.first[place]
        wanted = place - len(self.first)
        if wanted >= self.others:
            raise IndexError(place)
        before = 0
        for block in blocks(self.path, self.start):
            lines = block.count(b"\n")
            if wanted < before + lines:
                text = block.split(b"\n", wanted - before + 1)[wanted - before].decode("ascii")
                return self.line + wanted, text.split(self.delimiter)
            before += lines
        raise IndexError(place)

    def cells(self, column: int) -> pl.Series:
        """The cells of a column, as text."""
        parts = [pl.Series([cells[column] for _, cells in self.first], dtype=pl.String)]
        for block in blocks(self.path, self.start):
            table = pl.read_csv(
                block,
                has_header=False,
                separator=self.delimiter,
                quote_char=None,
                infer_schema=False,
                columns=[column],
            )
            parts.append(table.to_series().fill_null(""))
        return pl.concat([part.alias("cells") for part in parts], rechunk=False)


@dataclass(frozen=True)
class Head:
    """The first lines of a large file: their bytes, and the place and number of the line behind them."""

    data: bytes

    @cached_property
    def lines(self) -> int:
        """How many lines these are."""
        return self.data.count(b"\n")


def head_of(path: Path) -> Head | None:
    """The first lines of a large file; None of another one."""
    if path.stat().st_size < LARGE:
        return None
    with path.open("rb") as file:
        lines = [file.readline(LONGEST_LINE) for _ in range(HEAD_LINES)]
    return Head(b"".join(lines)) if all(line.endswith(b"\n") for line in lines) else None


def blocks(path: Path, start: int) -> Iterator[bytes]:
    """A file from a byte on in blocks of whole lines, each of which ends with `\\n`; `\\r\\n` counts as that."""
    with path.open("rb") as file:
        file.seek(start)
        rest = b""
        while data := file.read(BLOCK):
            whole, end, rest = (rest + data).rpartition(b"\n")
            if end:
                yield (whole + end).replace(b"\r\n", b"\n")
        if rest:
            yield rest + b"\n"


def plain_lines(path: Path, start: int, delimiter: str, width: int, comment: str) -> int | None:
    """How many lines a file has from byte `start` on, if all have `width` cells and nothing but them; else None."""
    sign = delimiter.encode()
    if sign not in {DELIMITERS[k : k + 1] for k in range(len(DELIMITERS))}:
        return None
    refused, count = REFUSED.copy(), 0
    refused[sign[0]] = False
    for block in blocks(path, start):
        signs = np.frombuffer(block, dtype=np.uint8)
        if refused[signs].any() or (comment and comment.encode() in block):
            return None
        ends = np.flatnonzero(signs == ord("\n"))
        between = np.flatnonzero(signs == sign[0])
        cells = np.diff(np.searchsorted(between, ends), prepend=0) + 1
        lengths = np.diff(ends, prepend=-1) - 1
        # a line of empty cells alone is left out by the ordinary reader
        if (cells != width).any() or (lengths <= width - 1).any() or (lengths >= LONGEST_LINE).any():
            return None
        count += ends.size
    return count
