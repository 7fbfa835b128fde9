"""Numbers in objects of JSON or protobuf, by path.

A path is dotted: `position[0]`, `position[name=ankle]` (the element at the place of `ankle` in the
array `name` beside it). A name with a dot or a bracket stands in brackets, written as JSON writes a
text: `functions["loadcell.mz"]`.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats._ros_shapes import NoNumberError

PATH_PART = re.compile(
    r"(?P<name>[^.\[\]]+)|\[(?P<quoted>\"(?:[^\"\\]|\\.)*\")\]|\[(?P<index>\d+)\]"
    r"|\[(?P<names>\w+)=(?P<wanted>[^\]]+)\]|\."
)
PLAIN_NAME = re.compile(r"[^.\[\]]+")
MOST_LABELS = 4096  # longer arrays of text are no names of signals


@dataclass(frozen=True)
class Choice:
    """The element of an array that has a name in the array of names beside it."""

    names: str
    wanted: str


@dataclass(frozen=True)
class Step:
    """One step on the way to a number: a name, an index, or a choice by name."""

    key: str | int | Choice
    way: str  # the path up to this step, for messages


@cache
def steps_of(path: str) -> tuple[Step, ...]:
    """Split a path into its steps."""
    steps: list[Step] = []
    for part in PATH_PART.finditer(path):
        way = path[: part.start()].rstrip(".")
        if part["name"]:
            steps.append(Step(part["name"], way))
        elif part["quoted"]:
            key = part["quoted"][1:-1]
            with suppress(ValueError):  # an escape that JSON does not know stays as it is
                key = str(json.loads(part["quoted"]))
            steps.append(Step(key, way))
        elif part["index"]:
            steps.append(Step(int(part["index"]), way))
        elif part["names"]:
            steps.append(Step(Choice(part["names"], part["wanted"]), way))
    return tuple(steps)


def last_name(path: str) -> str:
    """Give the name at the end of a path, also where an index or a choice follows it."""
    names = [step.key for step in steps_of(path) if isinstance(step.key, str)]
    return names[-1] if names else path


def number_at(message: Any, path: str) -> float | bool | None:
    """Read the number at a path of an object; None where there is none.

    Raises
    ------
    NoNumberError
        Something else than a number stands there.
    """
    value = message
    parent = None
    for step in steps_of(path):
        if value is None:
            return None
        if isinstance(step.key, str):
            parent = value
            value = _member(value, step.key, step.way)
            continue
        if not _is_array(value):
            raise _no_number(value, step.way, "an array")
        index = step.key
        if isinstance(index, Choice):
            index = _index_of(index, parent, len(value))
        value = value[index] if index < len(value) else None
    if value is None or value.__class__ in (int, float, bool):
        return value
    if not _is_array(value):
        raise _no_number(value, path, "a number")
    if len(value):
        raise NoNumberError(f"field '{path}' is an array of {len(value)}, not one number")
    return None


def _index_of(choice: Choice, parent: Any, none: int) -> int:
    """Find the place of a name in the array of names; `none` where it is not there."""
    names = None if parent is None else _member(parent, choice.names)
    if names is None:
        return none
    if not _is_array(names):
        raise _no_number(names, choice.names, "an array of names")
    count = list(names).count(choice.wanted)
    if count > 1:
        raise NoNumberError(
            f"{count} elements are named '{choice.wanted}' in '{choice.names}': write an index in"
            " its place"
        )
    return list(names).index(choice.wanted) if count else none


def _member(record: Any, name: str, way: str = "") -> Any:
    """Read a field of an object; None where it is not written."""
    if record.__class__ is dict:
        return record.get(name)
    descriptor = getattr(record, "DESCRIPTOR", None)
    if descriptor is None:
        raise _no_number(record, way, "an object with fields")
    item = descriptor.fields_by_name.get(name)
    if item is None or (item.has_presence and not record.HasField(name)):
        return None
    return getattr(record, name)


def _is_array(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _no_number(value: Any, way: str, expected: str) -> NoNumberError:
    shown = json.dumps(
        value, ensure_ascii=False, default=lambda member: " ".join(str(member).split())
    )
    if len(shown) > 40:
        shown = f"{shown[:40]}..."
    what = f"field '{way}'" if way else "the whole"
    return NoNumberError(f"{what} is {shown}, not {expected}")


@dataclass(frozen=True)
class FieldDescription:
    """A number in a message, for a user who writes a source file."""

    path: str
    type: str  # of the number and of the array that it stands in, as `float64[4]`


def fields_in(value: Any, most_elements: int, path: str = "") -> Iterator[FieldDescription]:
    """List the numbers of an object, or of a value in it.

    Of an array without names beside it, the first `most_elements` are listed: longer ones are
    images or whole recordings, and no signals.
    """
    yield from _fields_in(value, most_elements, path, {})


def _fields_in(
    value: Any, most_elements: int, path: str, texts: Mapping[str, Sequence[str]]
) -> Iterator[FieldDescription]:
    if isinstance(value, int | float):
        yield FieldDescription(path, np.dtype(type(value)).name)
    elif _is_array(value):
        yield from _elements_of(value, most_elements, path, texts)
    elif isinstance(value, dict) or hasattr(value, "DESCRIPTOR"):
        names = (
            value if isinstance(value, dict) else [item.name for item in value.DESCRIPTOR.fields]
        )
        members = {name: _member(value, name) for name in names}
        texts = {
            name: list(member)
            for name, member in members.items()
            if _is_array(member) and 0 < len(member) <= MOST_LABELS and _are_texts(member)
        }
        for name, member in members.items():
            if PLAIN_NAME.fullmatch(name):
                own_path = f"{path}.{name}".removeprefix(".")
            else:
                own_path = f"{path}[{json.dumps(name, ensure_ascii=False)}]"
            yield from _fields_in(member, most_elements, own_path, texts)


def _elements_of(
    value: Sequence[Any], most_elements: int, path: str, texts: Mapping[str, Sequence[str]]
) -> Iterator[FieldDescription]:
    filled = [element for element in value if element is not None]
    are_numbers = bool(filled) and all(isinstance(element, int | float) for element in filled)
    if not are_numbers:
        for index, element in enumerate(value[:most_elements]):
            yield from _fields_in(element, most_elements, f"{path}[{index}]", {})
        return
    kind = f"{np.dtype(type(filled[0])).name}[{len(value)}]"
    labels = _labels_for(len(value), texts) or [str(k) for k in range(most_elements)]
    for label, element in zip(labels, value, strict=False):
        if element is not None:
            yield FieldDescription(f"{path}[{label}]", kind)


def _labels_for(count: int, texts: Mapping[str, Sequence[str]]) -> list[str]:
    for name, labels in texts.items():
        are_names = len(set(labels)) == len(labels) and all(x and "]" not in x for x in labels)
        if len(labels) == count and are_names and re.fullmatch(r"\w+", name):
            return [f"{name}={label}" for label in labels]
    return []


def _are_texts(values: Sequence[Any]) -> bool:
    return all(isinstance(element, str) for element in values)


def masked_numbers(path: str, numbers: Sequence[float | bool | None]) -> NDArray[Any]:
    """Put numbers in an array, masked where there is none.

    Whole numbers have the type that holds them exactly, if one does.

    Raises
    ------
    InputError
        Truth values and numbers are mixed: joined, `True` would become 1.
    """
    mask = [number is None for number in numbers]
    filled = [0 if number is None else number for number in numbers]
    kinds = {number.__class__ for number in numbers if number is not None}
    if bool in kinds and len(kinds) > 1:
        raise InputError(
            f"field '{path}' is a truth value in some places and a number in others; name"
            " another one"
        )
    if kinds == {bool}:
        return _masked(np.array(filled, np.bool_), mask)
    if kinds == {int}:
        for kind in (np.int64, np.uint64):
            with suppress(OverflowError):
                return _masked(np.array(filled, kind), mask)
    return _masked(np.array(filled, np.float64), mask)


def _masked(values: NDArray[Any], mask: Sequence[bool]) -> NDArray[Any]:
    return np.ma.array(values, mask=mask) if any(mask) else values


def json_object(text: bytes) -> Any:
    """Decode an object of JSON."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a message of {len(text)} bytes is not JSON: {error}") from error
