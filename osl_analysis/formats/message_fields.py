"""Fields of messages as columns of numbers, by the messages' shapes, in every encoding: CDR, ROS 1, JSON, protobuf.

A walk through one ROS message finds where its numbers stand: in the same places in all messages of its *shape*, of the
same length and the same bytes where strings and sequences tell their lengths (its *guards*). JSON and protobuf become
objects one by one; those with numbers in the same fields are of one shape.

A path is dotted: `position[0]`, `position[name=ankle]` (the element at the place of `ankle` in the array `name` beside
it). A name with a dot or a bracket stands in brackets, written as JSON writes a text: `functions["loadcell.mz"]`.
"""

import json
import re
import struct
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError

Indices = NDArray[np.int64]
Values = dict[str, NDArray[Any]]


class NoNumberError(ValueError):
    """Something else than a number stands in a wanted field."""


@dataclass(frozen=True)
class Columns:
    """The wanted fields of those messages, or lines, that can be used."""

    rows: Indices  # their places among all, (n,)
    values: Values  # numbers (n,) by path, in the type of the message
    present: dict[str, NDArray[np.bool_]]  # whether the message has the field, (n,) by path
    misfits: int = 0  # how many cannot be used
    misfit: str = ""  # what is wrong with the first of these


PATH_PART = re.compile(
    r"(?P<name>[^.\[\]]+)|\[(?P<quoted>\"(?:[^\"\\]|\\.)*\")\]|\[(?P<index>\d+)\]|\[(?P<names>\w+)=(?P<one>[^\]]+)\]|\."
)


@cache
def steps_of(path: str) -> tuple[tuple[str | int | tuple[str, str], str], ...]:
    """The steps to a field (a name, an index, or an array of names with the wanted one), each with the way to it."""
    steps: list[tuple[str | int | tuple[str, str], str]] = []
    for part in PATH_PART.finditer(path):
        way = path[: part.start()].rstrip(".")
        if part["names"] is not None:
            steps.append(((part["names"], part["one"]), way))
        elif part["index"] is not None:
            steps.append((int(part["index"]), way))
        elif part["quoted"] is not None:
            try:
                steps.append((str(json.loads(part["quoted"])), way))
            except ValueError:  # an escape that JSON does not know stays as it was written
                steps.append((part["quoted"][1:-1], way))
        elif part["name"] is not None:
            steps.append((part["name"], way))
    return tuple(steps)


def path_to(above: str, name: str) -> str:
    """The path of the field `name` of the object at the path `above`; empty for the message itself."""
    if not re.fullmatch(r"[^.\[\]]+", name):
        return f"{above}[{json.dumps(name, ensure_ascii=False)}]"
    return f"{above}.{name}" if above else name


def last_name(path: str) -> str:
    """The name at the end of a path, also where an index or a choice follows it."""
    return next((key for key, _ in reversed(steps_of(path)) if isinstance(key, str)), path)


def array_labels(path: str, length: int | None, texts: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Labels of an array's elements, from an array of as many different texts beside it in the message."""
    parent = path.rpartition(".")[0]
    for array, names in texts.items():
        beside, _, name = array.rpartition(".")
        is_beside = beside == parent and re.fullmatch(r"\w+", name)
        if is_beside and len(names) == length == len(set(names)) and all(one and "]" not in one for one in names):
            return tuple(f"{name}={one}" for one in names)
    return ()


@dataclass(frozen=True)
class FieldDescription:
    """A number in a message, or an array of numbers, for a user who writes a source file."""

    path: str  # dotted path; of an array of messages it passes element 0
    type: str  # type of the number, such as float64 or bool
    length: int | None = None  # number of elements in the inspected message; None for a single number
    labels: tuple[str, ...] = ()  # the array's elements, such as `name=ankle`, where an array of text beside it tells

    def addresses(self) -> list[str]:
        """The paths of single numbers: every labelled element, or else element 0."""
        if self.length is None:
            return [self.path]
        return [f"{self.path}[{label}]" for label in self.labels] or [f"{self.path}[0]"]


@dataclass
class Reader:
    """Reads the wanted fields of a channel's messages, block by block."""

    paths: Sequence[str]  # each once
    kind: Any  # a MessageType, or a function that makes objects of messages and raises ValueError if one does not fit
    lines: Indices | None = None  # number of the line in which each message stands, in a file of lines
    count: int = 0  # messages so far
    misfit: str = ""  # what is wrong with the first message that is not what its type says
    no_numbers: int = 0  # messages that are lost since they have something else than a number
    one_by_one: int = 0  # messages that were read one by one
    parts: list[tuple[Indices, Values]] = field(default_factory=list)  # places and numbers of messages of one shape
    shapes: dict[int, list["Shape"]] = field(default_factory=lambda: defaultdict(list))  # of ROS, by length

    def place(self, row: int) -> str:
        """A message, for the user."""
        return f"message {row + 1}" if self.lines is None else f"line {self.lines[row]}"

    def read(self, buffer: bytes, starts: Indices, lengths: Indices) -> None:
        """Take in messages that begin at `starts` [bytes]; NoNumberError if a wanted field of ROS is no number."""
        if not isinstance(self.kind, MessageType):
            ends = (starts + lengths).tolist()
            return self.take(buffer[start:end] for start, end in zip(starts.tolist(), ends, strict=True))
        alike = not lengths.size or bool((lengths == lengths[0]).all())
        for length in lengths[:1].tolist() if alike else np.unique(lengths).tolist():
            mine = np.flatnonzero(lengths == length)
            rest, known, tried = messages_at(buffer, starts[mine], length), self.shapes[length], 0
            while mine.size:
                if tried == len(known):  # the first message of a shape tells it
                    try:
                        known.append(shape_of(self.kind, rest[0].tobytes(), self.paths))
                    except (InputError, RecursionError) as error:
                        self.misfit = self.misfit or str(error)
                        mine, rest = mine[1:], rest[1:]
                        continue
                same = known[tried].fits(rest)
                if same.all():
                    self.parts.append((self.count + mine, known[tried].read(rest)))
                    break
                if same.any():
                    self.parts.append((self.count + mine[same], known[tried].read(rest[same])))
                    mine, rest = mine[~same], rest[~same]
                tried += 1
        self.count += starts.size
        return None

    def take(self, payloads: Iterable[bytes]) -> None:
        """Take in messages that become objects; those with numbers, or truth values, in the same fields are alike."""
        by_shape: dict[tuple[bool | None, ...], tuple[list[int], list[list[Any]]]] = defaultdict(lambda: ([], []))
        for payload in payloads:
            self.count += 1
            try:
                message = self.kind(payload)
                found = [number_at(message, path) for path in self.paths]
            except NoNumberError as error:
                self.no_numbers += 1
                self.misfit = self.misfit or f"{error}, in {self.place(self.count - 1)}"
            except (ValueError, RecursionError) as error:
                self.misfit = self.misfit or str(error)
            else:
                rows, numbers = by_shape[tuple(None if one is None else one.__class__ is bool for one in found)]
                self.one_by_one += 1
                rows.append(self.count - 1)
                numbers.append(found)
        for shape, (rows, numbers) in by_shape.items():
            values = {}
            for path, is_bool, column in zip(self.paths, shape, zip(*numbers, strict=True), strict=False):
                if is_bool is not None:
                    unsigned = all(one.__class__ is int for one in column) and min(column) >= 0 and max(column) < 2**64
                    large = unsigned and max(column) >= 2**63  # numpy would make floats of these beside small ones
                    array = np.array(column, np.uint64 if large else None)
                    values[path] = array.astype(np.float64) if array.dtype == object else array
            self.parts.append((np.array(rows, np.int64), values))

    def columns(self, rank: Indices | None = None) -> Columns:
        """What was read, in the order of `rank`, which all messages have, (count,); without it as it was read.

        A message with a truth value where others have a number is a misfit: joined, `True` would become 1.
        """
        kinds = {
            path: {values[path].dtype == bool for _, values in self.parts if path in values} for path in self.paths
        }
        sound, lost = list[tuple[Indices, Values]](), list[tuple[int, str, bool]]()
        for rows, values in self.parts:
            wrong = [path for path in values if len(kinds[path]) > 1 and values[path].dtype == bool]
            if wrong:
                lost.append((int(rows[0]), min(wrong), bool(values[min(wrong)][0])))
            else:
                sound.append((rows, values))
        if lost and not self.misfit:
            row, path, value = min(lost)
            self.misfit = f"field '{path}' is {str(value).lower()}, not a number as elsewhere, in {self.place(row)}"
        rows = np.concatenate([np.empty(0, np.int64), *(rows for rows, _ in sound)])
        order = np.argsort(rows if rank is None else rank[rows], kind="stable")
        in_order = slice(None) if (np.diff(order) == 1).all() else order
        columns = Columns(rows[in_order], {}, {}, self.count - rows.size, self.misfit)
        none = np.empty(0, bool)
        for path in self.paths:
            found = [values.get(path, np.zeros(rows.size, bool)) for rows, values in sound]
            there = [np.full(rows.size, path in values) for rows, values in sound]
            columns.values[path] = joined_numbers([none, *found])[in_order]
            columns.present[path] = np.concatenate([none, *there])[in_order]
        return columns


def joined_numbers(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Numbers one after the other, in one type that holds them all; numpy would make floats of signed and unsigned."""
    if {one.dtype.kind for one in pieces} - {"b"} == {"i", "u"} and all((one >= 0).all() for one in pieces):
        return np.concatenate([one.astype(np.uint64) for one in pieces])
    return np.concatenate(pieces)


def reader_of(channel: Channel, schema: Schema | None, paths: Sequence[str]) -> Reader:
    """A reader of the fields at `paths`; InputError if the channel's encoding or schema cannot be read."""
    check_encoding(channel, schema)
    if channel.message_encoding == "json" or schema is None:
        return Reader(paths, json_object)
    try:
        if channel.message_encoding == "protobuf":
            return Reader(paths, protobuf_decoder(schema))
        return Reader(paths, message_type(schema, ros1=channel.message_encoding == "ros1"))
    except InputError as error:
        raise InputError(
            f"topic '{channel.topic}': {str(error).replace('; ', ', ')}; record again with the definitions that its "
            "publisher was built with, or map another topic"
        ) from error


NOT_DEFINED = "not defined"  # key in a channel's metadata: why the channel has no schema, and what to do


def check_encoding(channel: Channel, schema: Schema | None) -> None:
    encoding = (channel.message_encoding, schema.encoding if schema else "no schema")
    if NOT_DEFINED in channel.metadata:
        raise InputError(f"topic '{channel.topic}': {channel.metadata[NOT_DEFINED]}")
    known = (("cdr", "ros2msg"), ("ros1", "ros1msg"), ("protobuf", "protobuf"))
    if encoding not in known and channel.message_encoding != "json":
        raise InputError(
            f"topic '{channel.topic}' is encoded as {encoding[0]} ({encoding[1]}); read are cdr (ros2msg), ros1 "
            "(ros1msg), protobuf (protobuf) and json: convert the log"
        )


def describe_message(channel: Channel, schema: Schema | None, payload: bytes | None) -> list[FieldDescription]:
    """The fields of a channel's message; without a message, the fields of its schema. ValueError as `reader_of`."""
    check_encoding(channel, schema)
    if channel.message_encoding == "json" or schema is None:
        return [] if payload is None else list(described(json.loads(payload)))
    if channel.message_encoding == "protobuf":
        return list(described(protobuf_decoder(schema)(payload or b"")))
    shape = shape_of(message_type(schema, ros1=channel.message_encoding == "ros1"), payload)
    texts: dict[str, list[str]] = defaultdict(list)
    for path, (_, text) in shape.texts.items():
        texts[path.rpartition("[")[0]].append(text)
    return [
        FieldDescription(path, np.dtype(leaf.dtype).name, leaf.length, array_labels(path, leaf.length, texts))
        for path, leaf in shape.leaves.items()
        if not re.search(r"\[(?!0\])\d+\]", path)  # of an array of messages the first one tells
    ]


PRIMITIVES = {
    "bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types in numpy's spelling. rosidl maps `char` to uint8: design.ros2.org/articles/legacy_interface_definition.html."""
FIELD = re.compile(r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<array>\[(?P<bound><=)?(?P<size>\d*)\])?\s+(?P<name>\w+)")
ROS1_AS_ROS2 = {"time": "ros1/Time", "duration": "ros1/Duration", "Header": "std_msgs/Header", "byte": "int8"}
"""What the types that ROS 2 does not have, or means otherwise, are (wiki.ros.org/msg)."""


class MessageField(NamedTuple):
    """One field of a message type."""

    name: str
    type: str  # a primitive, a string or `package/Name`
    array: int | None = None  # length of an array, -1 where it is in the message; None for no array


class MessageType(NamedTuple):
    """The type of a channel's messages."""

    name: str  # `package/Name`
    definitions: dict[str, list[MessageField]]  # fields of it and of all types in it
    ros1: bool  # little-endian, not aligned, no zero at the end of strings (wiki.ros.org/msg)


def short_name(name: str) -> str:
    """`package/msg/Name` as `package/Name`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def message_type(schema: Schema, *, ros1: bool) -> MessageType:
    """The type that a schema in ros2msg or ros1msg defines; InputError if it cannot be read."""
    text = schema.data.decode(errors="replace")
    stamp = [MessageField("sec", "int32"), MessageField("nanosec", "uint32")]
    definitions = {"builtin_interfaces/Time": stamp, "builtin_interfaces/Duration": stamp}
    if ros1:
        for name, seconds in (("ros1/Time", "uint32"), ("ros1/Duration", "int32")):
            definitions[name] = [MessageField("secs", seconds), MessageField("nsecs", seconds)]
    for number, part in enumerate(re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)):
        head = re.match(r"\s*MSG:\s*(\S+)[ \t]*$", part, re.MULTILINE) if number else None
        if number and not head:
            raise InputError(f"schema {schema.name}: a line 'MSG: package/Name' is missing after a separator")
        owner = short_name(head[1] if head else schema.name)
        fields = definitions[owner] = list[MessageField]()
        for raw in part[head.end() if head else 0 :].splitlines():
            line = raw.split("#")[0].strip()
            match = FIELD.match(line)
            if line and not match:
                raise InputError(f"schema {owner}: cannot read the line '{line[:60]}'; expected a type and a name")
            if not match or line[match.end() :].lstrip().startswith("="):  # a constant
                continue
            kind, array = ROS1_AS_ROS2.get(match["type"], match["type"]) if ros1 else match["type"], None
            if kind not in (*PRIMITIVES, "string", "wstring"):  # a bare name belongs to the package that uses it
                kind = short_name(kind) if "/" in kind else f"{owner.split('/')[0]}/{kind}"
            if match["array"] is not None:
                array = int(match["size"]) if match["size"] and not match["bound"] else -1
            if match["name"] in [one.name for one in fields]:
                raise InputError(f"schema {owner}: field '{match['name']}' is defined twice")
            fields.append(MessageField(match["name"], kind, array))
    for owner, fields in definitions.items():
        for one in fields:
            if one.type not in definitions and one.type not in (*PRIMITIVES, "string", "wstring"):
                raise InputError(f"schema {owner}: type '{one.type}' of field '{one.name}' is not defined")
    return MessageType(short_name(schema.name), definitions, ros1)


Messages = np.ndarray[tuple[int], np.dtype[np.void]]  # messages of one length, one after the other


class Leaf(NamedTuple):
    """A number, or an array of numbers, in the messages of one shape."""

    offset: int  # first byte in the message
    dtype: str  # type of the number in numpy's spelling, with its byte order; `?` for a bool
    length: int | None = None  # length of the array; None for a single number


@dataclass
class Shape:
    """Where the numbers of a message are, and how to read those of its likes."""

    payload: bytes  # the message
    leaves: dict[str, Leaf] = field(default_factory=dict)  # its numbers by path
    texts: dict[str, tuple[slice, str]] = field(default_factory=dict)  # strings in arrays: extent and text, by path
    guards: list[slice] = field(default_factory=list)  # extents of the bytes that another message must share
    wanted: dict[str, Leaf] = field(default_factory=dict)  # the numbers to read, by path

    def leaf_at(self, path: str) -> Leaf | None:
        """The single number at `path`; None where the message lacks the field or its array is too short."""
        leaf = self.leaves.get(path)
        if leaf is not None and leaf.length is not None:
            raise NoNumberError(f"field '{path}' is an array of {leaf.length}, not one number")
        if leaf is not None or not steps_of(path):
            return leaf
        key, way = steps_of(path)[-1]
        if isinstance(key, tuple):
            names = f"{way.rpartition('.')[0]}.{key[0]}[".removeprefix(".")
            for text in [one for one in self.texts if one.startswith(names)]:
                self.guards.append(self.texts[text][0])  # in another message this element may have another name
                if self.texts[text][1] == key[1]:
                    return self.leaf_at(f"{way}[{text.removeprefix(names)}")
        array = self.leaves.get(way)
        if not isinstance(key, int) or array is None or array.length is None or key >= array.length:
            return None
        return Leaf(array.offset + key * np.dtype(array.dtype).itemsize, array.dtype)

    def fits(self, messages: Messages) -> NDArray[np.bool_]:
        """Which messages of this length have this shape, (messages,)."""
        same = np.ones(messages.size, bool)
        for guard in self.guards:
            length = guard.stop - guard.start
            kind = np.dtype({2: "u2", 4: "u4"}.get(length, f"S{length}"))
            if length:
                same &= members_at(messages, guard.start, kind) == np.frombuffer(self.payload, kind, 1, guard.start)
        return same

    def read(self, messages: Messages) -> Values:
        """The wanted numbers of messages of this shape, by path."""
        values = {}
        for path, leaf in self.wanted.items():
            kind = np.dtype(leaf.dtype.replace("?", "u1"))
            native = members_at(messages, leaf.offset, kind).astype(kind.newbyteorder("="))
            values[path] = native != 0 if "?" in leaf.dtype else native
        return values


def shape_of(kind: MessageType, payload: bytes | None, paths: Sequence[str] = ()) -> Shape:
    """The shape of one message, to read the fields at `paths`, as far as it has them; without a message that of zeros.

    InputError if the message is not what its type says, NoNumberError if a field is no single number.
    """
    begin = 0 if kind.ros1 else 4
    data = bytes((0, not kind.ros1)) + bytes(1 << 16) if payload is None else payload
    if not kind.ros1 and (len(data) < 4 or data[0] != 0 or data[1] > 1):
        raise InputError(f"encapsulation {data[:4].hex()} is not plain CDR; record with the default encoding")
    order, position, shape = "<" if kind.ros1 or data[1] else ">", begin, Shape(data, guards=[slice(0, begin // 2)])
    too_short = InputError(f"a message of {len(data)} bytes is too short for its schema; the schema is not its own")

    def align(size: int) -> None:
        nonlocal position
        if not kind.ros1:
            position += (begin - position) % size

    def length() -> int:
        """Read the length of a string or a sequence; its bytes become guards."""
        nonlocal position
        align(4)
        if position + 4 > len(data):
            raise too_short
        position += 4
        shape.guards.append(slice(position - 4, position))
        return int(struct.unpack_from(f"{order}I", data, position - 4)[0])

    def walk(name: str, prefix: str) -> None:
        nonlocal position
        fields = kind.definitions[name]
        position += not fields and not kind.ros1  # one without fields has a byte in CDR
        for item in fields:
            path = f"{prefix}{item.name}"
            if item.type == "wstring":
                raise InputError(f"field '{path}' is a wstring, which has no portable encoding; record it as string")
            number = PRIMITIVES.get(item.type)
            size = np.dtype(number).itemsize if number else 4 if item.type == "string" else 1  # at least
            count = 1 if item.array is None else length() if item.array < 0 else item.array
            if item.array is not None and count * size > len(data) - position:
                raise too_short  # a damaged length would make a loop without end
            if number:
                if count:
                    align(size)
                shape.leaves[path] = Leaf(position, order + number, None if item.array is None else count)
                position += count * size
                continue
            for index in range(count):
                own = path if item.array is None else f"{path}[{index}]"
                if item.type != "string":
                    walk(item.type, f"{own}.")
                    continue
                size = length()
                if item.array is not None:
                    text = data[position : position + size].rstrip(b"\0").decode(errors="replace")
                    shape.texts[own] = slice(position, position + size), text
                position += size

    walk(kind.name, "")
    if payload is None:
        return shape
    if kind.ros1 and position != len(data):
        raise InputError(
            f"a message of {len(data)} bytes has {position} by its definition, which is not its own; "
            "record the bag again with the definitions that its publisher was built with"
        )
    if position > len(data):
        raise too_short
    left = data[position:]
    if len(left) > (7 if not left.strip(b"\0") else 3):  # DDS pads to four bytes of any content (RTPS 2.5, 9.4.1)
        raise InputError(
            f"a message of {len(data)} bytes has {len(left)} more than its schema describes; the schema is not its "
            "own: record the log again with the definitions that its publisher was built with"
        )
    if len(left) > 3:  # to eight bytes, of zeros
        shape.guards.append(slice(position, len(data)))
    shape.wanted = {path: leaf for path in paths if (leaf := shape.leaf_at(path))}
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
    record = np.dtype({"names": ["it"], "formats": [kind], "offsets": [offset], "itemsize": messages.itemsize})
    return messages.view(record)["it"]


def number_at(message: Any, path: str) -> float | bool | None:
    """The number at a path of an object, None where there is none; NoNumberError where something else stands."""
    value, parent = message, None
    for key, way in steps_of(path):
        if value is None:
            return None
        if isinstance(key, str):
            parent, value = value, member(value, key, way)
            continue
        if not is_array(value):
            raise no_number(value, way, "an array")
        if isinstance(key, tuple):
            names = None if parent is None else member(parent, key[0])
            if names is not None and not is_array(names):
                raise no_number(names, key[0], "an array of names")
            key = names.index(key[1]) if names and key[1] in names else len(value)
        value = value[key] if key < len(value) else None
    if value is None or value.__class__ in (int, float, bool):
        return value
    if not is_array(value):
        raise no_number(value, path, "a number")
    if len(value):
        raise NoNumberError(f"field '{path}' is an array of {len(value)}, not one number")
    return None


def no_number(value: Any, way: str, expected: str) -> NoNumberError:
    shown = json.dumps(value, ensure_ascii=False, default=lambda one: " ".join(str(one).split()))
    shown = shown if len(shown) <= 40 else f"{shown[:40]}..."
    what = f"field '{way}'" if way else "the whole"
    return NoNumberError(f"{what} is {shown}, not {expected}")


def is_array(value: Any, of: Any = None) -> bool:
    """Whether a value is an array; if `of` types are named, one that has elements, all of these types."""
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        return False
    return of is None or (len(value) > 0 and all(isinstance(one, of) for one in value))


def member(record: Any, name: str, way: str = "") -> Any:
    """A field of an object at the path `way`, None where it is not written; NoNumberError where there is no object."""
    if record.__class__ is dict:
        return record.get(name)
    descriptor = getattr(record, "DESCRIPTOR", None)
    if descriptor is None:
        raise no_number(record, way, "an object with fields")
    item = descriptor.fields_by_name.get(name)
    if item is None or (item.has_presence and not record.HasField(name)):
        return None
    return getattr(record, name)


def described(
    value: Any, path: str = "", kind: str = "", texts: Mapping[str, Any] | None = None
) -> Iterator[FieldDescription]:
    """The numbers of one value, of the type `kind` if its schema names one; `texts` are arrays of text beside it."""
    types = dict.fromkeys(value, "") if isinstance(value, dict) else {}
    if hasattr(value, "DESCRIPTOR"):
        # types of numbers by `FieldDescriptor.cpp_type`; the last one is an enumeration, and others are no numbers
        by_number = ("", "int32", "int64", "uint32", "uint64", "float64", "float32", "bool", "int32", "", "")
        for one in value.DESCRIPTOR.fields:
            if not (one.message_type and one.message_type.GetOptions().map_entry):  # maps are no fields
                types[one.name] = by_number[one.cpp_type]
    inner = {path_to(path, name): (member(value, name), of) for name, of in types.items()}
    beside = {name: list(one) for name, (one, _) in inner.items() if is_array(one, str)}
    for name, (one, of) in inner.items():
        yield from described(one, name, of, beside)
    if is_array(value, int | float):
        labels = array_labels(path, len(value), texts or {})
        yield FieldDescription(path, kind or np.dtype(type(value[0])).name, len(value), labels)
    elif is_array(value) and value:
        yield from described(value[0], f"{path}[0]")
    elif isinstance(value, int | float):
        yield FieldDescription(path, kind or np.dtype(type(value)).name)


def json_object(text: bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a message of {len(text)} bytes is not JSON: {error}") from error


def protobuf_decoder(schema: Schema) -> Callable[[bytes], Any]:
    """Makes a message of google.protobuf; InputError where the schema cannot be used, or a message does not fit it."""
    from google.protobuf.message import DecodeError  # these cost time to import, and few logs need them
    from mcap.exceptions import McapError
    from mcap_protobuf.decoder import DecoderFactory

    try:
        decode: Any = DecoderFactory().decoder_for("protobuf", schema)
        decode(b"")
    except (McapError, DecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise InputError(f"schema {schema.name}: cannot be read: {' '.join(str(error).split())}") from error

    def checked(payload: bytes) -> Any:
        try:
            return decode(payload)
        except DecodeError:
            text = f"a message of {len(payload)} bytes is not what its schema says, or is damaged"
            raise InputError(text) from None

    return checked
