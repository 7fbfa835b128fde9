"""JSON messages to columns: polars parses all messages of a chunk at once, with the types of the wanted fields.

polars refuses a number that does not fit its type. The types are then inferred again; messages that have no types in
common are read one by one.
"""

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from mmap import mmap
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.formats.messages.json_keys import names_on_the_way, repeating
from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.formats.messages.one_by_one import PART, Numbers, Values, batches, numbers_at

ERRORS = (pl.exceptions.PolarsError, pl.exceptions.PanicException, RecursionError, ValueError)
EXACT = 2.0**53  # below it every integer is a float64
NAME = re.compile(rb'"((?:[^"\\]|\\.)*)"\s*:')
MOST_NAMES = 2000  # of fields in a chunk; each is a column of the table that polars makes of the messages
NUMBERS = (pl.Int64, pl.Float64, pl.Boolean)

Step = str | int
Types = dict[str, pl.DataType]


class NoTypesError(ValueError):
    """The messages have no types in common."""


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
    """Messages that are not JSON, or write a field twice."""
    misfit: str = ""
    """What is wrong with the first of these."""

    def read(self, buffer: bytes | mmap, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """Batches of messages: their places among `starts`, and their numbers by path; misfits are only counted."""
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
            for rows, values in self.one_by_one(texts):
                yield sound[rows], values

    def unambiguous(self, texts: Sequence[bytes]) -> Indices:
        """Places of the messages that write no field twice; the others are counted as misfits."""
        faults = repeating(texts, names_on_the_way(self.paths))
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
        """Whether the messages may have a wanted field that was not seen so far."""
        unseen = set(self.paths) - set(self.kinds)
        if not unseen.issuperset(self.either):
            unseen.difference_update(self.either)
        names = {last_name(steps_of(path)) for path in unseen}
        joined = b"".join(texts) if names else b""
        return any(name in joined for name in names)

    def is_exact(self, frame: pl.DataFrame) -> bool:
        """Whether no integer that was read as float64 may have been rounded."""
        whole = [column for path, column in self.fields_in(frame).items() if self.kinds[path] == pl.Int64]
        return not any((np.abs(column.drop_nulls().to_numpy()) >= EXACT).any() for column in whole)

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

    def one_by_one(self, texts: Sequence[bytes]) -> Iterator[tuple[Indices, Values]]:
        """Reads messages that have no types in common."""
        places, messages = [], []
        for row, text in enumerate(texts):
            try:
                messages.append(numbers_of(text, self.paths))
                places.append(row)
            except (ValueError, RecursionError) as error:
                self.misfits += 1
                self.misfit = self.misfit or f"a message of {len(text)} bytes is not JSON: {error}"
        self.read_alone += len(messages)
        yield from batches(places, messages)


def as_typed(texts: Sequence[bytes], types: Types) -> pl.DataFrame:
    """The fields of messages; a value of another type raises an error."""
    return pl.read_ndjson(BytesIO(in_lines(texts)), schema=types)


def as_floats(texts: Sequence[bytes], types: Types) -> pl.DataFrame:
    """The fields of messages without arrays, all numbers as float64: twice as fast, and no number is cut off."""
    decoded = pl.Series(texts).cast(pl.String).str.json_decode(pl.Struct(as_float_types(types)))
    return decoded.struct.unnest()


def as_float_types(types: Types) -> Types:
    """The types with float64 for integers."""
    return {
        name: pl.Struct(as_float_types({one.name: one.dtype for one in kind.fields}))  # type: ignore[misc]
        if isinstance(kind, pl.Struct)
        else pl.Float64()
        if kind == pl.Int64
        else kind
        for name, kind in types.items()
    }


def field_in(frame: pl.DataFrame, steps: Sequence[Step]) -> pl.Series:
    """The field to which the steps lead."""
    field = frame[str(steps[0])]
    for step in steps[1:]:
        field = field.struct.unnest()[step] if isinstance(step, str) else field.list.get(step, null_on_oob=True)
    return field


def numbers_of(text: bytes, paths: Sequence[str]) -> Numbers:
    """The fields of one message."""
    return numbers_at(json.loads(text), paths)


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


@cache
def steps_of(path: str) -> tuple[Step, ...]:
    """Names and indices on the way to a field."""
    parts = [part for part in PART.finditer(path) if part[0] != "."]
    if any(part["names"] for part in parts):
        raise NoTypesError("an element that is chosen by name must be searched in each message")
    return tuple(part["name"] if part["name"] is not None else int(part["index"]) for part in parts)


def last_name(steps: Sequence[Step]) -> bytes:
    """The last name on the way, as JSON writes it."""
    return json.dumps([step for step in steps if isinstance(step, str)][-1], ensure_ascii=False).encode()


def wanted_types(types: Mapping[str, pl.DataType], steps: Sequence[Sequence[Step]]) -> Types:
    """Of the types of messages, those of the wanted fields."""
    wanted = {}
    for name in dict.fromkeys(at[0] for at in steps if at):
        if isinstance(name, str) and name in types:
            kind = wanted_type(types[name], [at[1:] for at in steps if at and at[0] == name])
            if kind is not None:
                wanted[name] = kind
    return wanted


def wanted_type(kind: pl.DataType, steps: Sequence[Sequence[Step]]) -> pl.DataType | None:
    """The part of a type that the steps lead to; None if they lead nowhere."""
    if isinstance(kind, pl.Struct):
        fields = wanted_types({one.name: one.dtype for one in kind.fields}, steps)  # type: ignore[misc]
        return pl.Struct(fields) if fields else None
    if isinstance(kind, pl.List):
        inner = wanted_type(kind.inner, [at[1:] for at in steps if at and isinstance(at[0], int)])  # type: ignore[arg-type]
        return pl.List(inner) if inner is not None else None
    if all(steps) or kind == pl.Null:
        return None
    if kind not in NUMBERS:
        raise NoTypesError(f"{kind} is no number, or not in every message")
    return kind


def kind_at(types: Mapping[str, pl.DataType], steps: Sequence[Step]) -> Any:
    """The type to which the steps lead, None if they do not."""
    kind: Any = types.get(steps[0]) if steps and isinstance(steps[0], str) else None
    for step in steps[1:]:
        if isinstance(kind, pl.Struct) and isinstance(step, str):
            kind = {one.name: one.dtype for one in kind.fields}.get(step)
        elif isinstance(kind, pl.List) and isinstance(step, int):
            kind = kind.inner
        else:
            return None
    return kind
