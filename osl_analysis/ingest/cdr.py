"""ROS 2 messages in CDR to columns: one message is walked, all of the same shape are read at once by numpy.

A message's *shape* is its length together with the lengths of the strings and sequences in it (the guards):
messages that share these share every field's offset.
"""

import re
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.ros2_schema import PRIMITIVES, Definitions, MessageField

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]

HEADER = 4  # encapsulation header; alignment counts from the byte after it
INDEXED = re.compile(r"(?P<array>.+)\[(?P<index>\d+)\]")
NAMED = re.compile(r"(?P<parent>.*\.)?(?P<array>\w+)\[(?P<names>\w+)=(?P<name>[^\]]+)\]")


@dataclass(frozen=True)
class Leaf:
    """Where a number, or an array of `count` numbers, stands in a message; `dtype` carries the byte order."""

    offset: int
    dtype: str
    count: int | None = None


@dataclass
class Layout:
    """The walk through one message: position and byte order, and what was found so far.

    `texts` are the extents of the strings in arrays of strings, `guards` the offsets of the bytes that another
    message must share to be read by this layout.
    """

    payload: bytes
    definitions: Definitions
    order: str
    position: int = HEADER
    leaves: dict[str, Leaf] = field(default_factory=dict)
    texts: dict[str, range] = field(default_factory=dict)
    guards: list[int] = field(default_factory=lambda: [0, 1])

    def align(self, size: int) -> None:
        self.position += (HEADER - self.position) % size

    def length(self) -> int:
        """Read the length of a string or a sequence, and guard it."""
        self.align(4)
        try:
            (value,) = struct.unpack_from(f"{self.order}I", self.payload, self.position)
        except struct.error:
            raise misfit(self.payload) from None
        self.guards += range(self.position, self.position + 4)
        self.position += 4
        return int(value)

    def message(self, name: str, prefix: str) -> None:
        """Walk the fields of the message type `name`; IDL gives a message without fields one byte."""
        fields = self.definitions[name]
        self.position += not fields
        for item in fields:
            path = f"{prefix}{item.name}"
            if item.type == "string":
                self.strings(item, path)
            elif item.type in PRIMITIVES:
                self.numbers(item, path)
            else:
                self.messages(item, path)

    def count(self, item: MessageField) -> int:
        if item.array == "sequence":
            return self.length()
        return 1 if item.array is None else item.array

    def strings(self, item: MessageField, path: str) -> None:
        for index in self.plausible(self.count(item), 4):
            length = self.length()
            if item.array is not None:
                self.texts[f"{path}[{index}]"] = range(self.position, self.position + length)
            self.position += length

    def numbers(self, item: MessageField, path: str) -> None:
        count, kind = self.count(item), PRIMITIVES[item.type]
        size = np.dtype(kind).itemsize
        if count:
            self.align(size)
        self.leaves[path] = Leaf(self.position, self.order + kind, None if item.array is None else count)
        self.position += count * size
        if self.position > len(self.payload):
            raise misfit(self.payload)

    def messages(self, item: MessageField, path: str) -> None:
        if item.type == "wstring":
            raise InputError(f"field '{path}' is a wstring, which has no portable encoding; record it as string")
        for index in self.plausible(self.count(item), 1):
            self.message(item.type, f"{path}." if item.array is None else f"{path}[{index}].")

    def plausible(self, count: int, smallest: int) -> range:
        """Indices of a sequence; a damaged length would otherwise be a loop without end."""
        if count * smallest > len(self.payload) - self.position + HEADER:
            raise misfit(self.payload)
        return range(count)


def layout_of(definitions: Definitions, name: str, payload: bytes) -> Layout:
    """Leaves and guards of one message of type `name` (`package/Name`).

    Raises
    ------
    InputError
        The encapsulation is not plain CDR, or the message is shorter than its schema asks for.
    """
    if len(payload) < HEADER or payload[0] != 0 or payload[1] > 1:
        raise InputError(f"encapsulation {payload[:HEADER].hex()} is not plain CDR; record with the default encoding")
    layout = Layout(payload, definitions, "<" if payload[1] else ">")
    layout.message(name, "")
    if layout.position > len(payload):
        raise misfit(payload)
    return layout


def misfit(payload: bytes) -> InputError:
    return InputError(f"a message of {len(payload)} bytes is too short for its schema; the schema is not its own")


def leaf_at(layout: Layout, path: str) -> Leaf | None:
    """The single number at `path`; None where this message's arrays do not reach so far, or lack the field.

    An element is chosen by its index, `position[0]`, or by the name that stands at the same index of a sibling
    array, `position[name=ankle]`; the names then join the layout's guards.

    Raises
    ------
    InputError
        The path names a whole array.
    """
    path = index_of_name(layout, path)
    direct = layout.leaves.get(path)
    if direct is not None and direct.count is not None:
        raise InputError(f"field '{path}' is an array of {direct.count}; name one element, like '{path}[0]'")
    match = INDEXED.fullmatch(path)
    array = layout.leaves.get(match["array"]) if match else None
    if not match or array is None or array.count is None or int(match["index"]) >= array.count:
        return direct
    return Leaf(array.offset + int(match["index"]) * np.dtype(array.dtype).itemsize, array.dtype)


def index_of_name(layout: Layout, path: str) -> str:
    """The path with `[names=name]` replaced by the index of that name; guards the names up to and with it."""
    match = NAMED.fullmatch(path)
    if not match:
        return path
    parent = match["parent"] or ""
    names = f"{parent}{match['names']}["
    for text, extent in layout.texts.items():
        if text.startswith(names):
            layout.guards += extent
            if layout.payload[extent.start : extent.stop].rstrip(b"\0") == match["name"].encode():
                return f"{parent}{match['array']}[{text.removeprefix(names)}"
    return path


def read_leaves(rows: Bytes, leaves: dict[str, Leaf]) -> dict[str, NDArray[Any]]:
    """The leaves' values in messages of one shape, `rows` of shape (messages, length)."""
    record = np.dtype(
        {
            "names": list(leaves),
            "formats": [leaf.dtype.replace("?", "u1") for leaf in leaves.values()],
            "offsets": [leaf.offset for leaf in leaves.values()],
            "itemsize": rows.shape[1],
        }
    )
    table = np.ascontiguousarray(rows).view(record)[:, 0]
    return {
        path: (table[path] != 0) if "?" in leaf.dtype else table[path].astype(table.dtype[path].newbyteorder("="))
        for path, leaf in leaves.items()
    }


def field_names(layout: Layout) -> list[str]:
    """Every path that holds a number, arrays as `name[0..n-1]`, for messages to the user."""
    return [
        path if leaf.count is None else f"{path}[0..{leaf.count - 1}]"
        for path, leaf in layout.leaves.items()
        if leaf.count != 0
    ]
