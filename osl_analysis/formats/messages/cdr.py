"""ROS 2 messages in CDR: the walk through one message, which finds where its numbers are.

The guards are the lengths of its strings and sequences.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from mcap.records import Schema

from osl_analysis.errors import InputError
from osl_analysis.formats.messages.description import FieldDescription, describe_walk
from osl_analysis.formats.messages.effort import Effort
from osl_analysis.formats.messages.leaves import Leaf
from osl_analysis.formats.messages.one_by_one import Numbers
from osl_analysis.formats.messages.ros2_schema import PRIMITIVES, Definitions, MessageField, parse_schema, short_name
from osl_analysis.formats.messages.templates import ByShape, MessageWalk, Template, template_of

HEADER = 4  # encapsulation header; alignment counts from the byte after it
LARGEST_SCHEMA = 1 << 20  # bytes; the definitions of a message and all that it holds are some kB
PADDING = 3  # bytes of any content after the last field: DDS pads a message to four bytes (RTPS 2.5, 9.4.1)
ZERO_PADDING = 7  # bytes after the last field if they are zero: to eight
EMPTY = b"\0\1\0\0" + bytes(1 << 16)  # every number 0, every string and sequence empty


@dataclass
class CdrWalk(MessageWalk):
    """The walk through one message in CDR."""

    definitions: Definitions = field(default_factory=dict)
    """Fields of every message type."""
    order: str = "<"
    """Byte order, as `struct` spells it."""
    effort: Effort = field(default_factory=Effort)
    """How many elements may still be walked; arrays of messages without a byte could go on for ever."""
    empty_size: int = 1
    """Bytes of a message without fields."""

    def align(self, size: int) -> None:
        """Go on to the next multiple of `size` bytes."""
        self.position += (HEADER - self.position) % size

    def length(self) -> int:
        """Read the length of a string or a sequence; its bytes become guards."""
        self.align(4)
        try:
            (value,) = struct.unpack_from(f"{self.order}I", self.payload, self.position)
        except struct.error:
            raise cdr_misfit(self.payload) from None
        self.guards += range(self.position, self.position + 4)
        self.position += 4
        return int(value)

    def message(self, name: str, prefix: str) -> None:
        """Walk the fields of the message type `name`."""
        fields = self.definitions[name]
        self.position += 0 if fields else self.empty_size
        self.effort.take()
        for item in fields:
            path = f"{prefix}{item.name}"
            if item.type == "string":
                self.strings(item, path)
            elif item.type in PRIMITIVES:
                self.numbers(item, path)
            else:
                self.messages(item, path)

    def count(self, item: MessageField) -> int:
        """Number of elements of a field; 1 if it is not an array."""
        if item.array == "sequence":
            return self.length()
        return 1 if item.array is None else item.array

    def strings(self, item: MessageField, path: str) -> None:
        """Walk over a string or an array of strings."""
        for index in self.plausible(self.count(item), 4):
            self.effort.take()
            length = self.length()
            if item.array is not None:
                self.texts[f"{path}[{index}]"] = range(self.position, self.position + length)
            self.position += length

    def numbers(self, item: MessageField, path: str) -> None:
        """Note a number or an array of numbers."""
        count, kind = self.count(item), PRIMITIVES[item.type]
        size = np.dtype(kind).itemsize
        if count:
            self.align(size)
        self.leaves[path] = Leaf(self.position, self.order + kind, None if item.array is None else count)
        self.position += count * size
        if self.position > len(self.payload):
            raise cdr_misfit(self.payload)

    def messages(self, item: MessageField, path: str) -> None:
        """Walk through a message or an array of messages."""
        if item.type == "wstring":
            raise InputError(f"field '{path}' is a wstring, which has no portable encoding; record it as string")
        for index in self.plausible(self.count(item), 1):
            self.message(item.type, f"{path}." if item.array is None else f"{path}[{index}].")

    def plausible(self, count: int, smallest: int) -> range:
        """Indices of a sequence; refuse a damaged length, which would make a loop without end."""
        if count * smallest > len(self.payload) - self.position + HEADER:
            raise cdr_misfit(self.payload)
        return range(count)


def layout_of(definitions: Definitions, name: str, payload: bytes, effort: Effort | None = None) -> CdrWalk:
    """Leaves and guards of one message of type `name` (`package/Name`); `effort` limits the walk.

    Raises
    ------
    InputError
        The encapsulation is not plain CDR, or the message is shorter or longer than its schema asks for.
    """
    if len(payload) < HEADER or payload[0] != 0 or payload[1] > 1:
        raise InputError(f"encapsulation {payload[:HEADER].hex()} is not plain CDR; record with the default encoding")
    order = "<" if payload[1] else ">"
    layout = CdrWalk(payload, position=HEADER, guards=[0, 1], definitions=definitions, order=order)
    layout.effort = effort or layout.effort
    layout.message(name, "")
    if layout.position > len(payload):
        raise cdr_misfit(payload)
    left = b"" if payload is EMPTY else payload[layout.position :]
    if len(left) > (PADDING if left.strip(b"\0") else ZERO_PADDING):
        raise InputError(
            f"a message of {len(payload)} bytes has {len(left)} more than its schema describes; the schema is not its "
            "own: record the log again with the definitions that its publisher was built with"
        )
    layout.guards += range(layout.position, len(payload)) if PADDING < len(left) <= ZERO_PADDING else ()
    return layout


def cdr_misfit(payload: bytes) -> InputError:
    """The error for a message that ends too early."""
    return InputError(f"a message of {len(payload)} bytes is too short for its schema; the schema is not its own")


def cdr_reader(schema: Schema, paths: Sequence[str], effort: Effort) -> ByShape:
    """A reader of the fields at `paths`, for messages of a schema in ros2msg; `effort` limits all its walks.

    Raises
    ------
    InputError
        The schema cannot be read.
    """
    name, definitions = message_type(schema)
    return reader_by_walk(lambda payload: layout_of(definitions, name, payload, effort), paths)


def reader_by_walk(walk: Callable[[bytes], MessageWalk], paths: Sequence[str]) -> ByShape:
    """A reader of the fields at `paths` of messages whose leaves and guards `walk` finds."""

    def learn(payload: bytes) -> Template:
        """The template of all messages that are laid out as this one."""
        return template_of(walk(payload), paths)

    def alone(payload: bytes) -> Numbers:
        """The wanted numbers of one message."""
        row = np.frombuffer(payload, np.uint8)[None]
        return {path: values[0] for path, values in learn(payload).read(row).items()}

    return ByShape(learn, alone)


def describe_cdr(schema: Schema, payload: bytes | None) -> list[FieldDescription]:
    """The fields of one message; without a message, those of one whose strings and arrays are empty.

    Raises
    ------
    InputError
        The schema cannot be read, or does not describe the message.
    """
    name, definitions = message_type(schema)
    return describe_walk(layout_of(definitions, name, EMPTY if payload is None else payload))


def message_type(schema: Schema) -> tuple[str, Definitions]:
    """Name and definitions of a schema's message."""
    if len(schema.data) > LARGEST_SCHEMA:
        raise InputError(f"schema {schema.name[:60]} has {len(schema.data)} bytes, at most {LARGEST_SCHEMA} are read")
    return short_name(schema.name), parse_schema(schema.name, schema.data.decode(errors="replace"))
