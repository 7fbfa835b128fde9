"""JSON messages to columns: a chunk's messages are parsed at once by polars, in the types that the wanted fields have.

polars is strict about the types it is given: a number that does not fit them is an error, upon which the types are
found anew; messages that have no common types are read one by one.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from mmap import mmap
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.ingest.ordinary import PART, Indices, Numbers, Values, batches, numbers_at

ERRORS = (pl.exceptions.PolarsError, pl.exceptions.PanicException, RecursionError, ValueError)
EXACT = 2.0**53  # below it every integer is a float64
NUMBERS = (pl.Int64, pl.Float64, pl.Boolean)

Step = str | int
Types = dict[str, pl.DataType]


class NoTypesError(ValueError):
    """The messages have no types in common."""


@dataclass
class ByText:
    """Reads JSON messages; `types` are those of the wanted fields that were seen so far."""

    paths: Sequence[str]
    types: Types = field(default_factory=dict)
    read_alone: int = 0
    misfits: int = 0
    misfit: str = ""

    def read(self, buffer: bytes | mmap, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """Which of the messages, and the fields that they have; misfits are left out, and counted."""
        stops = (starts + lengths).tolist()
        texts = [buffer[start:stop] for start, stop in zip(starts.tolist(), stops, strict=True)]
        try:
            yield from alike(self.at_once(texts), len(texts))
        except ERRORS:
            yield from self.one_by_one(texts)

    def at_once(self, texts: Sequence[bytes]) -> dict[str, pl.Series]:
        """The wanted fields that there are, null where a message lacks one."""
        steps = {path: steps_of(path) for path in self.paths}
        joined = in_lines(texts)
        json.loads(texts[0], object_pairs_hook=unrepeated)
        columns = self.of_known_types(texts, joined, steps)
        if columns is None:
            inferred = pl.read_ndjson(BytesIO(joined), infer_schema_length=None)
            self.types = wanted_types(inferred.schema, list(steps.values()))
            frame = inferred.select(pl.col(name).cast(kind) for name, kind in self.types.items())
            if inferred.height != len(texts):
                raise NoTypesError("a message is empty")
            columns = fields_in(frame, self.types, steps)
        return columns

    def of_known_types(
        self, texts: Sequence[bytes], joined: bytes, steps: Mapping[str, list[Step]]
    ) -> dict[str, pl.Series] | None:
        """The same, in the types that are known; None if they are not enough, or do not hold any more."""
        unknown = {last_name(at) for at in steps.values() if not resolves(self.types, at)}
        if not self.types or any(name in joined for name in unknown):
            return None
        with suppress(*ERRORS):
            has_arrays = any(isinstance(step, int) for at in steps.values() for step in at)
            frame = strictly(joined, self.types) if has_arrays else as_floats(texts, self.types)
            if frame.height == len(texts):
                return whole_numbers(fields_in(frame, self.types, steps), self.types, steps)
        return None

    def one_by_one(self, texts: Sequence[bytes]) -> Iterator[tuple[Indices, Values]]:
        which, found = [], []
        for row, text in enumerate(texts):
            try:
                found.append(numbers_of(text, self.paths))
                which.append(row)
            except (ValueError, RecursionError) as error:
                self.misfits += 1
                self.misfit = self.misfit or f"a message of {len(text)} bytes is no JSON: {error}"
        self.read_alone += len(found)
        yield from batches(which, found)


def strictly(joined: bytes, types: Types) -> pl.DataFrame:
    """The fields of messages, one a line; a value of another type is an error."""
    return pl.read_ndjson(BytesIO(joined), schema=types)


def as_floats(texts: Sequence[bytes], types: Types) -> pl.DataFrame:
    """The fields of messages without arrays, all numbers as float64: twice as fast, and into that nothing is cut."""
    decoded = pl.Series(texts).cast(pl.String).str.json_decode(pl.Struct(floats(types)))
    return decoded.struct.unnest()


def floats(types: Types) -> Types:
    """The types with float64 for integers."""
    return {
        name: pl.Struct(floats({one.name: one.dtype for one in kind.fields}))  # type: ignore[misc]
        if isinstance(kind, pl.Struct)
        else pl.Float64()
        if kind == pl.Int64
        else kind
        for name, kind in types.items()
    }


def whole_numbers(
    columns: Mapping[str, pl.Series], types: Types, steps: Mapping[str, list[Step]]
) -> dict[str, pl.Series] | None:
    """Integers that were read as float64 as such again; None if one may have been rounded."""
    found = dict(columns)
    for path, column in columns.items():
        if column.dtype == pl.Float64 and kind_at(types, steps[path]) == pl.Int64:
            numbers = column.drop_nulls().to_numpy()
            if (np.abs(numbers) >= EXACT).any():
                return None
            if (numbers == np.rint(numbers)).all():
                found[path] = column.cast(pl.Int64)
    return found


def fields_in(frame: pl.DataFrame, types: Types, steps: Mapping[str, list[Step]]) -> dict[str, pl.Series]:
    """The fields to which the steps lead."""
    found = {path: at for path, at in steps.items() if resolves(types, at)}
    fields = frame.select(expression(at).alias(path) for path, at in found.items())
    return {path: fields[path] for path in found}


def numbers_of(text: bytes, paths: Sequence[str]) -> Numbers:
    """The fields of one message."""
    return numbers_at(json.loads(text), paths)


def in_lines(texts: Sequence[bytes]) -> bytes:
    """The messages, one a line; a line's end within a message can only be a blank."""
    joined = b"\n".join(texts)
    if joined.count(b"\n") == len(texts) - 1:
        return joined
    return b"\n".join(text.replace(b"\n", b" ") for text in texts)


def alike(columns: Mapping[str, pl.Series], count: int) -> Iterator[tuple[Indices, Values]]:
    """Columns with nulls in batches of messages that have the same fields."""
    if not any(column.null_count() for column in columns.values()):
        yield np.arange(count), {path: column.to_numpy() for path, column in columns.items()}
        return
    there = np.stack([column.is_not_null().to_numpy() for column in columns.values()], axis=1)
    kinds, kind_of = np.unique(there, axis=0, return_inverse=True)
    for number, kind in enumerate(kinds):
        rows = np.flatnonzero(kind_of.ravel() == number)
        paths = [path for path, present in zip(columns, kind, strict=True) if present]
        yield rows, {path: columns[path].gather(rows).to_numpy() for path in paths}


def steps_of(path: str) -> list[Step]:
    """Names and indices on the way to a field."""
    parts = [part for part in PART.finditer(path) if part[0] != "."]
    if any(part["names"] for part in parts):
        raise NoTypesError("an element chosen by name has to be looked for in each message")
    return [part["name"] if part["name"] is not None else int(part["index"]) for part in parts]


def last_name(steps: Sequence[Step]) -> bytes:
    """The last name on the way, as JSON writes it."""
    return json.dumps([step for step in steps if isinstance(step, str)][-1], ensure_ascii=False).encode()


def unrepeated(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """An object; of a field that is written twice polars takes the first and Python the last: leave it to Python."""
    if len(dict(pairs)) < len(pairs):
        raise NoTypesError("a field is written twice")
    return dict(pairs)


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
    if [] not in [list(at) for at in steps] or kind == pl.Null:
        return None
    if kind not in NUMBERS:
        raise NoTypesError(f"{kind} is no number, or not in every message")
    return kind


def resolves(types: Mapping[str, pl.DataType], steps: Sequence[Step]) -> bool:
    """Whether the steps lead to a number of the types."""
    return kind_at(types, steps) in NUMBERS


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


def expression(steps: Sequence[Step]) -> pl.Expr:
    """The field that the steps lead to."""
    at = pl.col(str(steps[0]))
    for step in steps[1:]:
        at = at.struct.field(step) if isinstance(step, str) else at.list.get(step, null_on_oob=True)
    return at


def fields(text: bytes) -> list[str]:
    """Every path of a message that holds a number, for messages to the user."""
    return list(number_paths(json.loads(text), ""))


def number_paths(value: Any, path: str) -> Iterator[str]:
    """Paths of the numbers in a decoded message."""
    if isinstance(value, dict):
        for name, one in value.items():
            yield from number_paths(one, f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for i, one in enumerate(value):
            yield from number_paths(one, f"{path}[{i}]")
    elif isinstance(value, int | float):
        yield path
