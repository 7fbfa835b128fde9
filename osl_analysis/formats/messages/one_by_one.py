"""Numbers of messages that a library decodes one by one, for messages that cannot be read all at once."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import OslAnalysisError
from osl_analysis.formats.messages.field_path import PART, name_in
from osl_analysis.formats.messages.leaves import Indices

Numbers = dict[str, Any]
Values = dict[str, NDArray[Any]]


class WholeArrayError(OslAnalysisError):
    """A path names a whole array. It does so in every message, so that no message is to blame."""


def numbers_at(message: Any, paths: Sequence[str]) -> Numbers:
    """The numbers at those of the paths that the message has."""
    found = {path: number_at(message, path) for path in paths}
    return {path: value for path, value in found.items() if value is not None}


def batches(which: Sequence[int], messages: Sequence[Numbers]) -> Iterator[tuple[Indices, Values]]:
    """Messages that were read one by one, in batches with the same fields; `which` are their places.

    Truth values and numbers stand in batches of their own: joined, `True` would become 1.
    """
    alike: dict[tuple[tuple[str, bool], ...], list[int]] = defaultdict(list)
    for row, message in enumerate(messages):
        alike[tuple((path, isinstance(value, bool)) for path, value in message.items())].append(row)
    for kind, rows in alike.items():
        values = {path: as_array([messages[row][path] for row in rows]) for path, _ in kind}
        yield np.array([which[row] for row in rows], np.int64), values


def as_array(numbers: Sequence[float | bool]) -> NDArray[Any]:
    """Numbers in one type that holds them all; integers beyond 64 bits become floats."""
    values = np.array(numbers)
    return values.astype(np.float64) if values.dtype == object else values


def number_at(message: Any, path: str) -> float | bool | None:
    """The number at a path; None where there is none."""
    value, parent = message, None
    for part in PART.finditer(path):
        if (name := name_in(part)) is not None:
            parent, value = value, child(value, name)
        elif part["names"] is not None:
            names = child(parent, part["names"])
            value = element(value, list(names).index(part["one"]) if part["one"] in (names or ()) else -1)
        elif part["index"] is not None:
            value = element(value, int(part["index"]))
    return value if isinstance(value, int | float) else None


def element(values: Any, index: int) -> Any:
    """One element of an array; None where the array is too short."""
    is_array = hasattr(values, "__getitem__") and not isinstance(values, str | bytes | Mapping)
    return values[index] if is_array and 0 <= index < len(values) else None


def child(message: Any, name: str) -> Any:
    """One field of a JSON object or a protobuf message; None where it is absent."""
    if isinstance(message, Mapping):
        return message.get(name)
    descriptor = getattr(message, "DESCRIPTOR", None)
    item = descriptor.fields_by_name.get(name) if descriptor is not None else None
    if item is None or (item.has_presence and not message.HasField(name)):
        return None
    return getattr(message, name)
