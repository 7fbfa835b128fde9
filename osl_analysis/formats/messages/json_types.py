"""Types of the fields of JSON messages, as polars names them, and the ways that lead to fields through these types."""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import polars as pl

from osl_analysis.formats.messages.field_path import PART, name_in

NUMBERS = (pl.Int64, pl.Float64, pl.Boolean)

Step = str | int
Types = dict[str, pl.DataType]


class NoTypesError(ValueError):
    """The messages have no types in common."""


@cache
def steps_of(path: str) -> tuple[Step, ...]:
    """Names and indices on the way to a field."""
    parts = [part for part in PART.finditer(path) if part[0] != "."]
    if any(part["names"] for part in parts):
        raise NoTypesError("an element that is chosen by name must be searched in each message")
    named = [(part, name_in(part)) for part in parts]
    return tuple(int(part["index"]) if name is None else name for part, name in named)


def names_of(steps: Sequence[Step]) -> list[bytes]:
    """The names on the way, as JSON writes them."""
    return [json.dumps(step, ensure_ascii=False).encode() for step in steps if isinstance(step, str)]


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
    """The part of a type that the steps lead to; None if no message has it.

    Raises
    ------
    NoTypesError
        The steps lead to something that is no number, or not in every message.
    """
    if kind == pl.Null:
        return None
    if isinstance(kind, pl.Struct) and all(at and isinstance(at[0], str) for at in steps):
        fields = wanted_types({one.name: one.dtype for one in kind.fields}, steps)  # type: ignore[misc]
        return pl.Struct(fields) if fields else None
    if isinstance(kind, pl.List) and all(at and isinstance(at[0], int) for at in steps):
        inner = wanted_type(kind.inner, [at[1:] for at in steps])  # type: ignore[arg-type]
        return pl.List(inner) if inner is not None else None
    if any(steps) or kind not in NUMBERS:
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
