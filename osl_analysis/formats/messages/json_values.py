"""The wanted numbers of one JSON message, and why it has none where something else stands in their place.

A key that is absent, `null`, and an array that is too short are no value: the field is null in that message. Anything
else than a number is a fault of the message: a text or an object must not become null, and nobody knows what it means.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from osl_analysis.formats.messages.field_path import PART, name_in
from osl_analysis.formats.messages.one_by_one import Numbers, child, element, numbers_at

MOST_SHOWN = 40  # characters of a value in a message to the user


class NoNumberError(ValueError):
    """Something else than a number stands in a wanted field."""


def numbers_of(text: bytes, paths: Sequence[str]) -> Numbers:
    """The fields of one message.

    Raises
    ------
    NoNumberError
        Something else than a number stands in a field, or on the way to it.
    ValueError
        The text is not JSON.
    """
    message = json.loads(text)
    numbers = numbers_at(message, paths)
    for path in paths:
        if path not in numbers:
            check_absent(message, path)
    return numbers


def check_absent(message: Any, path: str) -> None:
    """Refuse a value at a path, or on the way to it, that is there and leads to no number."""
    value, parent, way = message, None, ""
    for part in PART.finditer(path):
        if value is None:
            return
        if (name := name_in(part)) is not None:
            expect(value, Mapping, way, "an object with fields")
            parent, value = value, child(value, name)
        elif part["index"] is not None or part["names"] is not None:
            expect(value, list, way, "an array")
            value = chosen(value, parent, part)
        way = path[: part.end()].rstrip(".")
    if isinstance(value, list):
        raise NoNumberError(f"field '{path}' is an array of {len(value)}, not one number,")
    if value is not None:
        expect(value, (), way, "a number")


def chosen(values: Any, parent: Any, part: Any) -> Any:
    """The element of an array that one part of a path names; None where there is none."""
    if part["index"] is not None:
        return element(values, int(part["index"]))
    names = child(parent, part["names"])
    if names is None or isinstance(names, list):
        return element(values, names.index(part["one"]) if names and part["one"] in names else -1)
    return expect(names, list, part["names"], "an array of names")


def expect(value: Any, kind: Any, way: str, expected: str) -> None:
    """Refuse a value that is not of a kind."""
    if not isinstance(value, kind):
        shown = json.dumps(value, ensure_ascii=False)
        shown = shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}..."
        what = f"field '{way}'" if way else "the whole"
        raise NoNumberError(f"{what} is {shown}, not {expected},")
