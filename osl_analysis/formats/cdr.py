"""Messages of ROS: CDR (ROS 2) and ROS 1's own encoding. Messages of one shape are decoded all at once.

A walk through one message finds where its numbers stand. They stand in the same places in all messages of its *shape*:
of the same length and with the same bytes where it says how long its strings and sequences are (its *guards*).
"""

import re
import struct
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats.object_messages import FieldDescription, Indices, Values, WholeArrayError, array_labels

PRIMITIVES = {
    "bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types in numpy's spelling. rosidl maps `char` to uint8: design.ros2.org/articles/legacy_interface_definition.html."""
STRINGS = ("string", "wstring")
FIELD = re.compile(r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<array>\[(?P<bound><=)?(?P<size>\d*)\])?\s+(?P<name>\w+)")
SEPARATOR = re.compile(r"^={3,}\s*$", re.MULTILINE)
HEAD = re.compile(r"\s*MSG:\s*(\S+)[ \t]*$", re.MULTILINE)
ROS1_TYPE = re.compile(r"^([ \t]*)(time|duration|Header|byte)(?=(?:\[\d*\])?[ \t]+\w)", re.MULTILINE)
ROS1_AS_ROS2 = {"time": "ros1/Time", "duration": "ros1/Duration", "Header": "std_msgs/Header", "byte": "int8"}
"""What the types that ROS 2 does not have, or means otherwise, are (wiki.ros.org/msg)."""
ROS1_STAMPS = "\n===\nMSG: ros1/Time\nuint32 secs\nuint32 nsecs\n===\nMSG: ros1/Duration\nint32 secs\nint32 nsecs\n"
PADDING = 3  # bytes of any content after the last field: DDS pads a message to four bytes (RTPS 2.5, 9.4.1)
ZERO_PADDING = 7  # bytes after the last field if they are zero: to eight
MOST_SHAPES = 200  # of one channel and message length; what varies more is read message by message
INDEXED = re.compile(r"(?P<array>.+)\[(?P<index>\d+)\]")
NAMED = re.compile(r"(?P<parent>.*\.)?(?P<array>\w+)\[(?P<names>\w+)=(?P<name>[^\]]+)\]")
LATER_ELEMENT = re.compile(r"\[(?!0\])\d+\]")

Messages = np.ndarray[tuple[int], np.dtype[np.void]]
"""Messages of one length, one after the other."""


class MessageField(NamedTuple):
    """One field of a message type."""

    name: str
    type: str  # a primitive, a string or `package/Name`
    array: int | Literal["sequence"] | None = None
    """Length of an array of fixed size, "sequence" where the length is in the message, None for no array."""


Definitions = dict[str, list[MessageField]]


def parse_schema(name: str, text: str) -> Definitions:
    """Definitions of the message `name` (`package/msg/Name`) and of all that it holds, by `package/Name`."""
    stamp = [MessageField("sec", "int32"), MessageField("nanosec", "uint32")]
    definitions: Definitions = {"builtin_interfaces/Time": stamp, "builtin_interfaces/Duration": stamp}
    for number, part in enumerate(SEPARATOR.split(text)):
        head = HEAD.match(part) if number else None
        if number and not head:
            raise InputError(f"schema {name}: a line 'MSG: package/Name' is missing after a separator")
        full_name = short_name(head[1] if head else name)
        definitions[full_name] = list(parse_fields(full_name, part[head.end() :] if head else part))
    for full_name, fields in definitions.items():
        for number, one in enumerate(fields):
            if one.name in [other.name for other in fields[:number]]:
                raise InputError(f"schema {full_name}: field '{one.name}' is defined twice")
            if one.type not in definitions and one.type not in PRIMITIVES and one.type not in STRINGS:
                raise InputError(f"schema {full_name}: type '{one.type}' of field '{one.name}' is not defined")
    return definitions


def parse_fields(full_name: str, body: str) -> Iterator[MessageField]:
    """The fields of one definition, without comments, constants and default values."""
    for raw in body.splitlines():
        line = raw.split("#")[0].strip()
        match = FIELD.match(line)
        if line and not match:
            raise InputError(f"schema {full_name}: cannot read the line '{line[:60]}'; expected a type and a name")
        if not match or line[match.end() :].lstrip().startswith("="):
            continue
        kind, array = match["type"], None
        if kind not in PRIMITIVES and kind not in STRINGS:  # a bare name belongs to the package that uses it
            kind = short_name(kind) if "/" in kind else f"{full_name.split('/')[0]}/{kind}"
        if match["array"] is not None:
            array = int(match["size"]) if match["size"] and not match["bound"] else "sequence"
        yield MessageField(match["name"], kind, array)  # type: ignore[arg-type]


def short_name(name: str) -> str:
    """`package/msg/Name` as `package/Name`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


class MessageType(NamedTuple):
    """The type of a channel's messages."""

    name: str  # `package/Name`
    definitions: Definitions  # fields of it and of all types in it
    ros1: bool  # little-endian, not aligned, no zero at the end of strings (wiki.ros.org/msg)


def message_type(schema: Schema, *, ros1: bool) -> MessageType:
    """The type that a schema in ros2msg or ros1msg defines; raises InputError as `parse_schema`."""
    text = schema.data.decode(errors="replace")
    if ros1:
        text = ROS1_TYPE.sub(lambda match: match[1] + ROS1_AS_ROS2[match[2]], text) + ROS1_STAMPS
    return MessageType(short_name(schema.name), parse_schema(schema.name, text), ros1)


@dataclass(frozen=True)
class Leaf:
    """A number, or an array of numbers, in the messages of one shape."""

    offset: int  # first byte in the message
    dtype: str  # type of the number in numpy's spelling, with its byte order; `?` for a bool
    count: int | None = None  # length of the array; None for a single number


@dataclass
class Shape:
    """Where the numbers of a message are, which a walk through one finds, and how to read those of its likes."""

    payload: bytes
    kind: MessageType
    order: str = "<"  # byte order, as `struct` spells it
    position: int = 0
    leaves: dict[str, Leaf] = field(default_factory=dict)  # the numbers by path
    texts: dict[str, range] = field(default_factory=dict)  # extents of the strings in arrays of strings, by path
    guards: list[range] = field(default_factory=list)
    """Extents of the bytes that another message must share to have the same shape."""
    wanted: dict[str, Leaf] = field(default_factory=dict)  # the numbers to read, by path
    words: list[tuple[int, Any, Any]] = field(default_factory=list)
    """The guards in words of eight bytes, to compare fewer: offset, mask and what a message must have there."""

    # --- the walk

    def align(self, size: int) -> None:
        """Go on to the next multiple of `size` bytes, counted from the encapsulation header's end."""
        if not self.kind.ros1:
            self.position += (4 - self.position) % size

    def length(self) -> int:
        """Read the length of a string or a sequence; its bytes become guards."""
        self.align(4)
        if self.position + 4 > len(self.payload):
            raise self.too_short()
        (value,) = struct.unpack_from(f"{self.order}I", self.payload, self.position)
        self.guards.append(range(self.position, self.position + 4))
        self.position += 4
        return int(value)

    def message(self, name: str, prefix: str) -> None:
        """Walk the fields of the message type `name`; one without fields has a byte in CDR."""
        fields = self.kind.definitions[name]
        self.position += not fields and not self.kind.ros1
        for item in fields:
            path = f"{prefix}{item.name}"
            if item.type == "wstring":
                raise InputError(f"field '{path}' is a wstring, which has no portable encoding; record it as string")
            number = PRIMITIVES.get(item.type)
            size = np.dtype(number).itemsize if number else 4 if item.type == "string" else 1  # at least
            count = self.length() if item.array == "sequence" else 1 if item.array is None else item.array
            if item.array is not None and count * size > len(self.payload) - self.position:
                raise self.too_short()  # a damaged length would make a loop without end
            if number:
                if count:
                    self.align(size)
                self.leaves[path] = Leaf(self.position, self.order + number, None if item.array is None else count)
                self.position += count * size
                continue
            for index in range(count):
                own = path if item.array is None else f"{path}[{index}]"
                if item.type != "string":
                    self.message(item.type, f"{own}.")
                    continue
                length = self.length()
                if item.array is not None:
                    self.texts[own] = range(self.position, self.position + length)
                self.position += length

    def too_short(self) -> InputError:
        return InputError(
            f"a message of {len(self.payload)} bytes is too short for its schema; the schema is not its own"
        )

    # --- what is wanted, and messages of this shape

    def want(self, paths: Sequence[str]) -> "Shape":
        """Read the fields at `paths`, as far as the message has them."""
        self.wanted = {path: leaf for path in paths if (leaf := self.leaf_at(path))}
        mask, payload = np.zeros(len(self.payload), np.uint8), np.frombuffer(self.payload, np.uint8)
        for guard in self.guards:
            mask[guard.start : guard.stop] = 0xFF
        word = np.dtype("u8" if mask.size >= 8 else "u1")
        while mask.any():
            offset = min(int(np.argmax(mask)), mask.size - word.itemsize)
            part = slice(offset, offset + word.itemsize)
            self.words.append((offset, mask[part].view(word)[0], (payload[part] & mask[part]).view(word)[0]))
            mask = np.where(np.arange(mask.size) < part.stop, 0, mask).astype(np.uint8)
        return self

    def leaf_at(self, path: str) -> Leaf | None:
        """The single number at `path`; None where the message lacks the field or its array is too short."""
        path = self.index_of_name(path)
        direct = self.leaves.get(path)
        if direct is not None and direct.count is not None:
            raise WholeArrayError(f"field '{path}' is an array of {direct.count}, not one number")
        match = INDEXED.fullmatch(path)
        array = self.leaves.get(match["array"]) if match else None
        if not match or array is None or array.count is None or int(match["index"]) >= array.count:
            return direct
        return Leaf(array.offset + int(match["index"]) * np.dtype(array.dtype).itemsize, array.dtype)

    def index_of_name(self, path: str) -> str:
        """The path with `[names=name]` replaced by the index of that name; the names up to it become guards."""
        match = NAMED.fullmatch(path)
        if not match:
            return path
        parent = match["parent"] or ""
        names = f"{parent}{match['names']}["
        for text, extent in self.texts.items():
            if text.startswith(names):
                self.guards.append(extent)
                if self.payload[extent.start : extent.stop].rstrip(b"\0") == match["name"].encode():
                    return f"{parent}{match['array']}[{text.removeprefix(names)}"
        return path

    def fits(self, messages: Messages) -> NDArray[np.bool_]:
        """Which messages of this length have this shape, (messages,)."""
        same = np.ones(messages.size, bool)
        for offset, mask, expected in self.words:
            same &= members_at(messages, offset, mask.dtype) & mask == expected
        return same

    def read(self, messages: Messages) -> Values:
        """The wanted numbers of messages of this shape, by path."""
        values = {}
        for path, leaf in self.wanted.items():
            kind = np.dtype(leaf.dtype.replace("?", "u1"))
            native = members_at(messages, leaf.offset, kind).astype(kind.newbyteorder("="))
            values[path] = native != 0 if "?" in leaf.dtype else native
        return values


def shape_of(kind: MessageType, payload: bytes | None) -> Shape:
    """The shape of one message; without one, that of zeros, whose strings and sequences are empty."""
    if payload is None:
        empty = Shape(bytes((0, not kind.ros1, 0, 0)) + bytes(1 << 16), kind, position=0 if kind.ros1 else 4)
        empty.message(kind.name, "")
        return empty
    if kind.ros1:
        shape = Shape(payload, kind)
        shape.message(kind.name, "")
        if shape.position != len(payload):
            raise InputError(
                f"a message of {len(payload)} bytes has {shape.position} by its definition, which is not its own; "
                "record the bag again with the definitions that its publisher was built with"
            )
        return shape
    if len(payload) < 4 or payload[0] != 0 or payload[1] > 1:
        raise InputError(f"encapsulation {payload[:4].hex()} is not plain CDR; record with the default encoding")
    shape = Shape(payload, kind, "<" if payload[1] else ">", 4, guards=[range(2)])
    shape.message(kind.name, "")
    if shape.position > len(payload):
        raise shape.too_short()
    left = payload[shape.position :]
    if len(left) > (PADDING if left.strip(b"\0") else ZERO_PADDING):
        raise InputError(
            f"a message of {len(payload)} bytes has {len(left)} more than its schema describes; the schema is not its "
            "own: record the log again with the definitions that its publisher was built with"
        )
    if len(left) > PADDING:
        shape.guards.append(range(shape.position, len(payload)))
    return shape


def numbers_at(buffer: bytes, places: Indices, kind: np.dtype[Any]) -> NDArray[Any]:
    """The numbers of one type at places in a buffer [bytes], which need not be aligned, (places,)."""
    everywhere = np.ndarray((len(buffer) - kind.itemsize + 1,), kind, buffer, 0, (1,))
    return everywhere[places]


def messages_at(buffer: bytes, starts: Indices, length: int) -> Messages:
    """Messages of one length that begin at places in a buffer [bytes], (starts,): a view where these are even."""
    steps = np.diff(starts)
    if not length or not steps.size or (steps != steps[0]).any():
        return numbers_at(buffer, starts, np.dtype(f"V{length}"))
    return np.ndarray(starts.shape, f"V{length}", buffer, int(starts[0]), (int(steps[0]),))


def members_at(messages: Messages, offset: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """A view of the numbers of one type at a place [bytes] in each message, (messages,)."""
    itemsize = messages.itemsize
    return messages.view(np.dtype({"names": ["it"], "formats": [kind], "offsets": [offset], "itemsize": itemsize}))[
        "it"
    ]


@dataclass
class ShapeReader:
    """Reads the messages of a channel by their shapes; it learns one from the first message of each."""

    kind: MessageType
    paths: Sequence[str]  # paths of the fields to read
    shapes: dict[int, list[Shape]] = field(default_factory=lambda: defaultdict(list))
    """The shapes so far, by length of the message."""
    read_alone: int = 0  # messages that were read one by one
    misfits: int = 0  # messages that do not fit their schema
    misfit: str = ""  # what is wrong with the first of the misfits
    no_numbers: int = 0  # a schema says that a number is one

    def read(self, buffer: bytes, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """Batches of messages: their places among `starts`, and their numbers by path; misfits are only counted."""
        alike = not lengths.size or bool((lengths == lengths[0]).all())
        for length in lengths[:1].tolist() if alike else np.unique(lengths).tolist():
            mine = np.flatnonzero(lengths == length)
            rest = messages_at(buffer, starts[mine], length)
            known, tried = self.shapes[length], 0
            while mine.size:
                is_new = tried == len(known)
                shape = self.learned(rest[0].tobytes()) if is_new else known[tried]
                if shape is not None and tried < MOST_SHAPES:
                    known += [shape] * is_new
                    tried += 1
                    same = shape.fits(rest)
                else:
                    self.read_alone += shape is not None
                    same = np.arange(mine.size) == 0
                if shape is not None and same.all():
                    yield mine, shape.read(rest)
                    break
                if shape is not None and same.any():
                    yield mine[same], shape.read(rest[same])
                mine, rest = mine[~same], rest[~same]

    def learned(self, payload: bytes) -> Shape | None:
        """The shape of this message; None if it does not fit its schema."""
        try:
            return shape_of(self.kind, payload).want(self.paths)
        except (InputError, RecursionError) as error:
            self.misfits += 1
            self.misfit = self.misfit or str(error)
            return None


def describe_ros(schema: Schema, payload: bytes | None, *, ros1: bool) -> list[FieldDescription]:
    """The fields of one message; without a message, those of one whose strings and sequences are empty."""
    shape = shape_of(message_type(schema, ros1=ros1), payload)
    texts: dict[str, list[str]] = defaultdict(list)
    for path, extent in shape.texts.items():
        text = shape.payload[extent.start : extent.stop].rstrip(b"\0").decode(errors="replace")
        texts[path.rpartition("[")[0]].append(text)
    return [
        FieldDescription(path, np.dtype(leaf.dtype).name, leaf.count, array_labels(path, leaf.count, texts))
        for path, leaf in shape.leaves.items()
        if not LATER_ELEMENT.search(path)
    ]
