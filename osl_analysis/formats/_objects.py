"""Numbers in objects of JSON or protobuf, by path.

A path is dotted: `position[0]`, `position[name=ankle]` (the element at the place of `ankle` in the
array `name` beside it). A name with a dot or a bracket stands in brackets, written as JSON writes a
text: `functions["loadcell.mz"]`.
"""

import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError

PLAIN_NAME = re.compile(r"[^.\[\]]+")
LAST_NAME = re.compile(r"(?:^|\.)([^.\[\]]+)(?:\[\w+(?:=[^\]]*)?\])*$")
QUOTED_NAME = re.compile(r"\[(\"(?:[^\"\\]|\\.)*\")\](?:\[\d+\])*$")
MOST_ELEMENTS = 64  # of an array that are read: longer ones are images, and no signals
SECOND_NS = 1_000_000_000
# seconds and nanoseconds of a stamp: ROS 2, protobuf, Foxglove's JSON, ROS 1
STAMP_PARTS = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
LARGEST_STAMP_S = 2**63 // SECOND_NS - 1  # whose nanoseconds 64 bits hold


def numbers_in(value: Any) -> dict[str, float | bool]:
    """The numbers of an object, by path; of a long array the first `MOST_ELEMENTS`."""
    numbers: dict[str, float | bool] = {}
    _take_numbers(value, "", numbers, ())
    return numbers


def _take_numbers(
    value: Any, path: str, numbers: dict[str, float | bool], labels: Sequence[str]
) -> None:
    """Add the numbers of a value; `labels` name the elements of an array, if it is one of as
    many."""
    kind = value.__class__
    if kind is float or kind is int or kind is bool:
        numbers[path] = value
    elif kind is dict:
        lists = {name: member for name, member in value.items() if member.__class__ is list}
        own_labels = _labels_in(lists) if lists else ()
        for name, member in value.items():
            _take_numbers(member, joined_path(path, name), numbers, own_labels)
    elif kind is list:
        are_numbers = all(member is None or isinstance(member, int | float) for member in value)
        has_labels = are_numbers and len(labels) == len(value)
        for index, member in enumerate(value[:MOST_ELEMENTS]):
            element = labels[index] if has_labels else index
            _take_numbers(member, f"{path}[{element}]", numbers, ())
    elif hasattr(value, "DESCRIPTOR"):
        _take_numbers(_members_of(value), path, numbers, ())


def _members_of(message: Any) -> dict[str, Any]:
    """The fields of a message of protobuf that are set, or always have a value."""
    members: dict[str, Any] = {}
    for item in message.DESCRIPTOR.fields:
        if not item.has_presence or message.HasField(item.name):
            value = getattr(message, item.name)
            is_array = isinstance(value, Sequence) and not isinstance(value, str | bytes)
            members[item.name] = list(value) if is_array else value
    return members


def _labels_in(lists: Mapping[str, list[Any]]) -> list[str]:
    """What names the elements of the arrays of an object: its first array of different texts."""
    for name, texts in lists.items():
        are_texts = all(isinstance(text, str) and text and "]" not in text for text in texts)
        if texts and are_texts and name.isidentifier() and len(set(texts)) == len(texts):
            return [f"{name}={text}" for text in texts]
    return []


@cache
def joined_path(path: str, name: str) -> str:
    """The path of a field of an object."""
    if not PLAIN_NAME.fullmatch(name):
        return f"{path}[{json.dumps(name, ensure_ascii=False)}]"
    return f"{path}.{name}" if path else name


def last_name(path: str) -> str:
    """The name at the end of a path, also where an index or a choice follows it."""
    quoted = QUOTED_NAME.search(path)
    if quoted:
        return str(json.loads(quoted[1]))
    found = LAST_NAME.search(path)
    return found[1] if found else path


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
    # truth values, or none: a masked truth value takes the type of what it is joined to
    values = np.array(filled, np.bool_ if kinds <= {bool} else np.float64)
    if kinds == {int}:
        for kind in (np.uint64, np.int64):
            with suppress(OverflowError):
                values = np.array(filled, kind)
    return np.ma.array(values, mask=mask) if any(mask) else values


def whole_stamps(
    seconds: NDArray[Any], nanoseconds: NDArray[Any], names: tuple[str, str], noun: str
) -> NDArray[Any]:
    """Join the seconds and nanoseconds of stamps to whole nanoseconds, masked where one is.

    Raises
    ------
    InputError
        A part is no whole number, or too large; `noun` is what a row is called.
    """
    whole: list[NDArray[Any]] = []
    for name, values, most in (
        (names[0], seconds, LARGEST_STAMP_S),
        (names[1], nanoseconds, SECOND_NS),
    ):
        filled = np.ma.filled(values, 0)
        is_wrong = (filled < 0) | (filled > most)
        if filled.dtype.kind == "f":
            is_wrong |= filled != np.rint(filled)
        if is_wrong.any() or filled.dtype == bool:
            row = int(np.argmax(is_wrong))
            raise InputError(
                f"field '{name}' is {filled[row]} in {noun} {row + 1}, which is no whole number"
                f" from 0 to {most}; name another time"
            )
        whole.append(filled.astype(np.int64))
    stamps = whole[0] * SECOND_NS + whole[1]
    mask = np.ma.getmaskarray(seconds) | np.ma.getmaskarray(nanoseconds)
    return np.ma.array(stamps, mask=mask) if mask.any() else stamps
