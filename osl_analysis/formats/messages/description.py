"""The fields of one message: paths, types and lengths, for a user who writes a source file."""

import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from osl_analysis.formats.messages.effort import check_text
from osl_analysis.formats.messages.field_path import path_to
from osl_analysis.formats.messages.leaves import AnyLeaf, Varint
from osl_analysis.formats.messages.templates import INDEXED, MessageWalk

LATER_ELEMENT = re.compile(r"\[(?!0\])\d+\]")
ARRAY_NAME = re.compile(r"\w+")


@dataclass(frozen=True)
class FieldDescription:
    """A number in a message, or an array of numbers."""

    path: str
    """Dotted path; of an array of messages it passes element 0."""
    type: str
    """Type of the number, such as float64 or bool."""
    length: int | None = None
    """Number of elements in the inspected message; None for a single number."""
    labels: tuple[str, ...] = ()
    """The array's elements by label, such as `name=ankle`; empty where no array of text beside it names them."""

    def addresses(self) -> list[str]:
        """The paths by which single numbers are asked for: every labelled element, or else element 0."""
        if self.length is None:
            return [self.path]
        return [f"{self.path}[{label}]" for label in self.labels] or [f"{self.path}[0]"]

    def in_words(self) -> str:
        """The path with the range of its indices, for a message to the user."""
        return self.path if self.length is None else f"{self.path}[0..{self.length - 1}]"


def describe_walk(walk: MessageWalk) -> list[FieldDescription]:
    """The fields that the walk through a binary message came across."""
    texts: dict[str, list[str]] = defaultdict(list)
    for path, extent in walk.texts.items():
        text = walk.payload[extent.start : extent.stop].rstrip(b"\0").decode(errors="replace")
        texts[path.rpartition("[")[0]].append(text)
    found: dict[str, FieldDescription] = {}
    for path, leaf in walk.leaves.items():
        element = INDEXED.fullmatch(path)  # protobuf writes arrays of varints element by element
        array = element["array"] if element else path
        length = int(element["index"]) + 1 if element else leaf.count
        if not LATER_ELEMENT.search(array):
            found[array] = FieldDescription(array, type_of(leaf), length, array_labels(array, length, texts))
    return list(found.values())


def type_of(leaf: AnyLeaf) -> str:
    """Type of a leaf's numbers in words."""
    kind = leaf.kind.removeprefix("zigzag") if isinstance(leaf, Varint) else leaf.dtype
    return np.dtype(kind).name


def array_labels(path: str, length: int | None, texts: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Labels of an array's elements, from an array of as many different texts beside it in the message."""
    parent = path.rpartition(".")[0]
    for array, names in texts.items():
        beside, _, name = array.rpartition(".")
        is_beside = beside == parent and ARRAY_NAME.fullmatch(name)
        if is_beside and len(names) == length == len(set(names)) and all(one and "]" not in one for one in names):
            return tuple(f"{name}={one}" for one in names)
    return ()


def describe_json(text: bytes) -> list[FieldDescription]:
    """The fields of a JSON message.

    Raises
    ------
    ValueError
        The text is not JSON, or too long to be parsed.
    """
    check_text(len(text))
    return list(described_value(json.loads(text), "", {}))


def described_value(value: Any, path: str, texts: Mapping[str, Sequence[str]]) -> Iterator[FieldDescription]:
    """The fields of one JSON value; `texts` are the arrays of text beside it."""
    if isinstance(value, dict):
        inner = {path_to(path, name): one for name, one in value.items()}
        beside = {name: one for name, one in inner.items() if is_array_of(one, str)}
        for name, one in inner.items():
            yield from described_value(one, name, beside)
    elif is_array_of(value, int | float):
        yield FieldDescription(path, np.dtype(type(value[0])).name, len(value), array_labels(path, len(value), texts))
    elif isinstance(value, list):
        yield from described_value(value[0], f"{path}[0]", {}) if value else ()
    elif isinstance(value, int | float):
        yield FieldDescription(path, np.dtype(type(value)).name)


def is_array_of(value: Any, kind: Any) -> bool:
    """Whether a JSON value is an array, not empty, of values of one kind."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, kind) for one in value)
