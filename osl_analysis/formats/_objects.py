"""Numbers in objects of JSON or protobuf, by path.

A path is dotted: `position[0]`; in messages of ROS also `position[name=ankle]`, the element at the
place of `ankle` in the array `name` beside it. A name with a dot or a bracket stands in brackets,
written as JSON writes a text: `functions["loadcell.mz"]`.
"""

import json
import re
from collections.abc import Sequence
from functools import cache
from typing import Any

from osl_analysis.formats._cells import is_number_cell

PLAIN_NAME = re.compile(r"[^.\[\]]+")
CHOICES = re.compile(r"(\[[^\]\"]*\])+$")  # an index, or the name of an element
QUOTED_NAME = re.compile(r"\[(\"(?:[^\"\\]|\\.)*\")\]$")
NUMBER = int | float  # built once: a log has a million of them
DIGITS = frozenset("0123456789.")
MOST_ELEMENTS = 64  # of an array that are read: longer ones are images, and no signals


def values_in(value: Any) -> dict[str, Any]:
    """The numbers and texts of an object, by path; of a long array the first `MOST_ELEMENTS`."""
    values: dict[str, Any] = {}
    _take_values(value, "", values)
    return values


def _take_values(value: Any, path: str, values: dict[str, Any]) -> None:
    if isinstance(value, NUMBER):
        values[path] = value
    elif isinstance(value, dict):
        for name, member in value.items():
            _take_values(member, joined_path(path, name), values)
    elif isinstance(value, list):
        for index, member in enumerate(value[:MOST_ELEMENTS]):
            _take_values(member, f"{path}[{index}]", values)
    elif isinstance(value, str):
        values[path] = value
        if value[-1:] in DIGITS and is_number_cell(value):
            values[path] = int(value) if value.isdecimal() else float(value)
    elif hasattr(value, "DESCRIPTOR"):
        _take_values(_members_of(value), path, values)


def _members_of(message: Any) -> dict[str, Any]:
    """The fields of a message of protobuf that are set, or always have a value."""
    members: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        if not field.has_presence or message.HasField(field.name):
            value = getattr(message, field.name)
            is_array = isinstance(value, Sequence) and not isinstance(value, str | bytes)
            members[field.name] = list(value) if is_array else value
    return members


def are_names(texts: Sequence[Any]) -> bool:
    """Whether an array tells the names of the elements of those beside it."""
    are_texts = all(isinstance(text, str) and text and "]" not in text for text in texts)
    return are_texts and len(set(texts)) == len(texts) > 0


@cache
def joined_path(path: str, name: str) -> str:
    """The path of a field of an object."""
    if not PLAIN_NAME.fullmatch(name):
        return f"{path}[{json.dumps(name, ensure_ascii=False)}]"
    return f"{path}.{name}" if path else name


def last_name(path: str) -> str:
    """The name at the end of a path, also where an index or a choice follows it."""
    plain = CHOICES.sub("", path)
    quoted = QUOTED_NAME.search(plain)
    return str(json.loads(quoted[1])) if quoted else plain.rpartition(".")[2]
