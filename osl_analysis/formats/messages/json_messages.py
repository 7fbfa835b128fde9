"""JSON messages to columns: polars parses all messages of a chunk at once, with the types of the wanted fields.

polars refuses a number that does not fit its type. The types are then inferred again; messages that have no types in
common are read one by one.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from mmap import mmap
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.formats.messages.effort import TextEffort
from osl_analysis.formats.messages.json_keys import names_on_the_way, repeating
from osl_analysis.formats.messages.json_types import (
    NUMBERS,
    NoTypesError,
    Types,
    as_float_types,
    field_in,
    kind_at,
    names_of,
    steps_of,
    wanted_types,
)
from osl_analysis.formats.messages.json_values import NoNumberError, numbers_of
from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.formats.messages.one_by_one import Values, batches

ERRORS = (pl.exceptions.PolarsError, pl.exceptions.PanicException, RecursionError, ValueError)
EXACT = 2.0**53  # below it every integer is a float64
NAME = re.compile(
    rb'"((?:[^"\\]++|\\.)*+)"\s*:'
)  # possessive: a long text would need a hundred bytes for each of its own
MOST_NAMES = 2000  # of fields in a chunk; each is a column of the table that polars makes of the messages


@dataclass
class ByText:
    """Reads JSON messages."""

    paths: Sequence[str]
    """Paths of the fields to read."""
    either: Collection[str] = ()
    """Different spellings of the same field. After one was seen, the others are not searched."""
    types: Types = field(default_factory=dict)
    """Types of the top-level fields that lead to the wanted ones, as far as they were seen."""
    kinds: dict[str, Any] = field(default_factory=dict)
    """Type of each wanted field that was seen, by path."""
    read_alone: int = 0
    """Messages that were read one by one."""
    misfits: int = 0
    """Messages that are not JSON, write a field twice, or have something else than a number in a field."""
    misfit: str = ""
    """What is wrong with the first of these."""
    no_numbers: int = 0
    """Those of the misfits that have something else than a number."""
    before: int = 0
    """Messages before those that are read now."""
    effort: TextEffort = field(default_factory=TextEffort)
    """How much text may still be parsed."""

    def read(self, buffer: bytes | mmap, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """Batches of messages: their places among `starts`, and their numbers by path; misfits are only counted.

        Raises
        ------
        EffortError
            A message, or all messages together, are too long.
        """
        for part in self.effort.portions(lengths):
            for rows, values in self.read_portion(buffer, starts[part], lengths[part]):
                yield part.start + rows, values
            self.before += part.stop - part.start

    def read_portion(self, buffer: bytes | mmap, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """The same for as many messages as are parsed at once."""
        stops = (starts + lengths).tolist()
        texts = [buffer[start:stop] for start, stop in zip(starts.tolist(), stops, strict=True)]
        sound = self.unambiguous(texts)
        if sound.size < len(texts):
            texts = [texts[row] for row in sound]
        if not texts:
            return
        try:
            columns = self.at_once(texts)
            for rows, values in batches_alike(columns, len(texts)):
                yield sound[rows], {path: self.in_kind(path, numbers) for path, numbers in values.items()}
        except ERRORS:
            yield from self.one_by_one(texts, sound)

    def unambiguous(self, texts: Sequence[bytes]) -> Indices:
        """Places of the messages that write no field twice; the others are counted as misfits."""
        faults = repeating(texts, names_on_the_way(self.paths))
        if not faults:
            return np.arange(len(texts))
        self.misfits += len(faults)
        self.misfit = self.misfit or next(iter(faults.values()), "")
        return np.delete(np.arange(len(texts)), list(faults))

    def at_once(self, texts: Sequence[bytes]) -> dict[str, pl.Series]:
        """The wanted fields that exist, null where a message lacks one."""
        frame = self.of_known_types(texts)
        return self.of_new_types(texts) if frame is None else self.fields_in(frame)

    def of_new_types(self, texts: Sequence[bytes]) -> dict[str, pl.Series]:
        """The fields, in the types that these messages have in common; these become the known types."""
        if len(set(NAME.findall(b"\n".join(texts)))) > MOST_NAMES:
            raise NoTypesError("the messages have too many names for a table")
        inferred = pl.read_ndjson(BytesIO(in_lines(texts)), infer_schema_length=None)
        if inferred.height != len(texts):
            raise NoTypesError("a message is empty")
        steps = {path: steps_of(path) for path in self.paths}
        self.types = wanted_types(inferred.schema, list(steps.values()))
        kinds = {path: kind_at(self.types, at) for path, at in steps.items()}
        self.kinds = {path: kind for path, kind in kinds.items() if kind in NUMBERS}
        return self.fields_in(inferred.select(pl.col(name).cast(kind) for name, kind in self.types.items()))

    def of_known_types(self, texts: Sequence[bytes]) -> pl.DataFrame | None:
        """The messages parsed with the known types; None if fields are missing in these, or a number does not fit."""
        if not self.types or self.may_know_more(texts):
            return None
        has_arrays = any("[" in path for path in self.paths)
        with suppress(*ERRORS):
            frame = as_typed(texts, self.types) if has_arrays else as_floats(texts, self.types)
            if frame.height == len(texts) and (has_arrays or self.is_exact(frame)):
                return frame
        return None

    def may_know_more(self, texts: Sequence[bytes]) -> bool:
        """Whether the messages may have a wanted field that was not seen so far, or something else in its place."""
        unseen = set(self.paths) - set(self.kinds)
        if not unseen.issuperset(self.either):
            unseen.difference_update(self.either)
        names = {name for path in unseen for name in names_of(steps_of(path))}
        joined = b"".join(texts) if names else b""
        return any(name in joined for name in names)

    def is_exact(self, frame: pl.DataFrame) -> bool:
        """Whether no integer that was read as float64 may have been rounded."""
        whole = [field_in(frame, steps_of(path)) for path, kind in self.kinds.items() if kind == pl.Int64]
        return not any((np.abs(column.to_numpy()) >= EXACT).any() for column in whole)  # null becomes NaN

    def in_kind(self, path: str, numbers: NDArray[Any]) -> NDArray[Any]:
        """Integers that were read as float64, converted back. Otherwise they would be rounded when joined with larger
        ones."""
        if self.kinds[path] != pl.Int64 or numbers.dtype == np.int64:
            return numbers
        whole = numbers.astype(np.int64)
        return whole if (whole == numbers).all() else numbers

    def fields_in(self, frame: pl.DataFrame) -> dict[str, pl.Series]:
        """The wanted fields that were seen so far, from a parsed chunk."""
        return {path: field_in(frame, steps_of(path)) for path in self.kinds}

    def one_by_one(self, texts: Sequence[bytes], where: Indices) -> Iterator[tuple[Indices, Values]]:
        """Reads messages that have no types in common; `where` are their places in the portion."""
        places, messages = [], []
        for row, text in zip(where.tolist(), texts, strict=True):
            try:
                messages.append(numbers_of(text, self.paths))
                places.append(row)
            except NoNumberError as error:
                self.misfits += 1
                self.no_numbers += 1
                self.misfit = self.misfit or f"{error} in message {self.before + row + 1}"
            except (ValueError, RecursionError) as error:
                self.misfits += 1
                self.misfit = self.misfit or f"a message of {len(text)} bytes is not JSON: {error}"
        self.read_alone += len(messages)
        yield from batches(places, messages)


def as_typed(texts: Sequence[bytes], types: Types) -> pl.DataFrame:
    """The fields of messages; a value of another type raises an error."""
    return pl.read_ndjson(BytesIO(in_lines(texts)), schema=types)


def as_floats(texts: Sequence[bytes], types: Types) -> pl.DataFrame:
    """The fields of messages without arrays, all numbers as float64: twice as fast, and no number is cut off.

    The faster parser would take `true` for 1.0, so that messages with such a word are left to the slower one.
    """
    messages = pl.Series(texts).cast(pl.String)
    if messages.str.contains("true|false").any():
        return as_typed(texts, as_float_types(types))
    decoded = messages.str.json_decode(pl.Struct(as_float_types(types)))
    return decoded.struct.unnest()


def in_lines(texts: Sequence[bytes]) -> bytes:
    """The messages, one per line; a line break within a message can be replaced by a blank."""
    joined = b"\n".join(texts)
    if joined.count(b"\n") == len(texts) - 1:
        return joined
    return b"\n".join(text.replace(b"\n", b" ") for text in texts)


def batches_alike(columns: Mapping[str, pl.Series], count: int) -> Iterator[tuple[Indices, Values]]:
    """Batches of messages that have the same fields, from columns with nulls."""
    if not any(column.null_count() for column in columns.values()):
        yield np.arange(count), {path: column.to_numpy() for path, column in columns.items()}
        return
    there = np.stack([column.is_not_null().to_numpy() for column in columns.values()], axis=1)
    kinds, kind_of = np.unique(there, axis=0, return_inverse=True)
    for number, kind in enumerate(kinds):
        rows = np.flatnonzero(kind_of.ravel() == number)
        paths = [path for path, present in zip(columns, kind, strict=True) if present]
        yield rows, {path: columns[path].gather(rows).to_numpy() for path in paths}
