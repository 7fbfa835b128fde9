"""Fields of messages as columns of numbers, by the messages' shapes, in every encoding: CDR, ROS 1,
JSON, protobuf.

A walk through one ROS message finds where its numbers stand: in the same places in all messages of
its *shape*, of the same length and the same bytes where strings and sequences tell their lengths
(its *guards*). JSON and protobuf become objects one by one.

A path is dotted: `position[0]`, `position[name=ankle]` (the element at the place of `ankle` in the
array `name` beside it). A name with a dot or a bracket stands in brackets, written as JSON writes a
text: `functions["loadcell.mz"]`."""

import json
import re
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError

Indices = NDArray[np.int64]
# numbers (n,) by path, in the type of the message, masked where a message lacks the field
Values = Mapping[str, NDArray[Any]]


class NoNumberError(ValueError):
    """Something else than a number stands in a wanted field."""


PATH_PART = re.compile(
    r"(?P<name>[^.\[\]]+)|\[(?P<quoted>\"(?:[^\"\\]|\\.)*\")\]|\[(?P<index>\d+)\]|\[(?P<names>\w+)=(?P<one>[^\]]+)\]|\."
)
PathKey = str | int | tuple[str, str]  # a name, an index, or an array of names with the wanted one


@cache
def steps_of(path: str) -> tuple[tuple[PathKey, str], ...]:
    """The steps to a field, each with the way to it."""
    steps = list[tuple[PathKey, str]]()
    for part in PATH_PART.finditer(path):
        key: PathKey | None = part["name"]
        if part["names"]:
            key = part["names"], part["one"]
        elif part["index"]:
            key = int(part["index"])
        elif part["quoted"]:
            key = part["quoted"][1:-1]
            with suppress(ValueError):  # an escape that JSON does not know stays as it was written
                key = str(json.loads(part["quoted"]))
        if key is not None:
            steps.append((key, path[: part.start()].rstrip(".")))
    return tuple(steps)


def last_name(path: str) -> str:
    """The name at the end of a path, also where an index or a choice follows it."""
    return next((key for key, _ in reversed(steps_of(path)) if isinstance(key, str)), path)


class FieldDescription(NamedTuple):
    """A number in a message, or an array of numbers, for a user who writes a source file."""

    path: str
    type: str  # type of the number, such as float64 or bool
    # number of elements in the inspected message; None for a single number
    length: int | None = None
    # of an array: all as `name=ankle` where an array of text beside it tells, else `0`
    elements: Sequence[str] = ()

    def addresses(self) -> list[str]:
        return (
            [self.path]
            if self.length is None
            else [f"{self.path}[{element}]" for element in self.elements]
        )


def labels_of(path: str, length: int | None, texts: Mapping[str, Sequence[str]]) -> list[str]:
    """Labels of an array's elements, from an array of as many different texts beside it in the
    message."""
    for array, names in texts.items():
        (parent, _, name), is_sound = (
            array.rpartition("."),
            all(one and "]" not in one for one in names),
        )
        beside = parent == path.rpartition(".")[0] and re.fullmatch(r"\w+", name)
        if beside and len(names) == length == len(set(names)) and is_sound:
            return [f"{name}={one}" for one in names]
    return []


def fields_in(
    value: Any,
    most: int,
    cut: dict[str, int],
    path: str = "",
    texts: Mapping[str, Any] | None = None,
) -> Iterator[FieldDescription]:
    """The numbers of an object, or of a value in it. `most` elements of an array without labels are
    described; `cut` takes the lengths of longer ones. `texts` are the arrays of text beside the
    value."""
    if isinstance(value, int | float):
        yield FieldDescription(path, np.dtype(type(value)).name)
    elif is_array(value):
        numbers = [one for one in value if one is not None]
        labels = labels_of(path, len(value), texts or {}) if all_are(int | float, numbers) else []
        if len(value) > most and not labels:
            cut[path] = len(value)
        if all_are(int | float, numbers):
            kept = [
                name
                for name, one in zip(labels or map(str, range(most)), value, strict=False)
                if one is not None
            ]
            if kept:
                yield FieldDescription(path, np.dtype(type(numbers[0])).name, len(value), kept)
        else:
            for index, one in enumerate(value[:most]):
                yield from fields_in(one, most, cut, f"{path}[{index}]")
    else:
        own_names = (
            [one.name for one in value.DESCRIPTOR.fields] if hasattr(value, "DESCRIPTOR") else []
        )
        inner = {}
        for name in value if isinstance(value, dict) else own_names:
            is_plain = re.fullmatch(r"[^.\[\]]+", name)
            own = (
                f"{path}.{name}".removeprefix(".")
                if is_plain
                else f"{path}[{json.dumps(name, ensure_ascii=False)}]"
            )
            inner[own] = member(value, name)
        beside = {
            own: list(one) for own, one in inner.items() if is_array(one) and all_are(str, one)
        }
        for own, one in inner.items():
            yield from fields_in(one, most, cut, own, beside)


ROWS_AT_ONCE = 1 << 16  # messages of one shape that are copied to rows at a time


def joined_masked(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Pieces of a column behind one another; those of numpy take ten times as long where nothing is
    masked."""
    # numpy before 2.5 gives it no types
    of: Any = np.ma if any(map(np.ma.isMaskedArray, pieces)) else np
    return np.ma.array(of.concatenate(pieces))


@dataclass(frozen=True)
class Columns:
    """The wanted fields of those messages, or lines, that can be used."""

    rows: Indices  # their places among all, (n,)
    values: Values
    misfits: int = 0  # how many cannot be used
    misfit: str = ""  # what is wrong with the first of these


@dataclass
class Reader:
    """Reads the wanted fields of a channel's messages, block by block."""

    paths: Sequence[str]  # each once
    # a MessageType, or a function that makes objects of messages and raises ValueError if one does
    # not fit
    kind: Any
    # number of the line in which each message stands, in a file of lines
    lines: Indices | None = None
    count: int = 0  # messages so far
    misfit: str = ""  # what is wrong with the first message that is not what its type says
    no_numbers: int = 0  # messages that are lost since they have something else than a number
    found: list[int] = field(default_factory=list)  # places of those that became objects
    numbers: list[list[Any]] = field(default_factory=list)  # of each path what these have there
    # the same of messages of one shape
    parts: list[tuple[Indices, Values]] = field(default_factory=list)
    # of ROS, by length
    shapes: dict[int, list["Shape"]] = field(default_factory=lambda: defaultdict(list))

    def place(self, row: int) -> str:
        """A message, for the user."""
        return f"message {row + 1}" if self.lines is None else f"line {self.lines[row]}"

    def read(self, buffer: bytes, starts: Indices, lengths: Indices) -> None:
        """Take in messages that begin at `starts` [bytes]; NoNumberError if a wanted field of ROS
        is no number."""
        if not isinstance(self.kind, MessageType):
            ends = (starts + lengths).tolist()
            return self.take(
                [buffer[start:end] for start, end in zip(starts.tolist(), ends, strict=True)]
            )
        left = np.arange(starts.size)
        while left.size:  # messages of one length at a time
            length = int(lengths[left[0]])
            alike = lengths[left] == length
            of_length, left = left[alike], left[~alike]
            for mine in np.array_split(of_length, 1 + of_length.size // ROWS_AT_ONCE):
                self.read_rows(mine, numbers_at(buffer, starts[mine], np.dtype(f"V{length}")))
        self.count += starts.size
        return None

    def read_rows(self, mine: Indices, rows: NDArray[np.void]) -> None:
        """Take in messages of one length, (n,), that are `mine` of those that are read, shape by
        shape."""
        known, tried = self.shapes[rows.itemsize], 0
        while mine.size:
            if tried == len(known):  # the first message of a shape tells it
                try:
                    known.append(shape_of(self.kind, rows[0].tobytes(), self.paths))
                except (InputError, RecursionError) as error:
                    self.misfit = self.misfit or str(error)
                    mine, rows = mine[1:], rows[1:]
                    continue
            if (same := known[tried].fits(rows)).all():
                self.parts.append((self.count + mine, known[tried].read(rows)))
                return
            if same.any():
                self.parts.append((self.count + mine[same], known[tried].read(rows[same])))
            mine, rows, tried = mine[~same], rows[~same], tried + 1

    def take(self, payloads: Sequence[bytes]) -> None:
        """Take in messages that become objects."""
        self.numbers = self.numbers or [[] for _ in self.paths]
        for place, payload in enumerate(payloads, start=self.count):
            try:
                message = self.kind(payload)
                own = [number_at(message, path) for path in self.paths]
            except NoNumberError as error:
                self.no_numbers += 1
                self.misfit = self.misfit or f"{error}, in {self.place(place)}"
            except (ValueError, RecursionError) as error:
                self.misfit = self.misfit or str(error)
            else:
                self.found.append(place)
                for column, number in zip(self.numbers, own, strict=True):
                    column.append(number)
        self.count += len(payloads)

    def columns(self, rank: Indices | None = None) -> Columns:
        """What was read, in the order of `rank`, which all messages have, (count,); without it as
        it was read."""
        parts = self.parts
        if self.found:
            columns = map(masked_numbers, self.paths, self.numbers)
            parts = [(np.array(self.found), dict(zip(self.paths, columns, strict=True)))]
        rows = np.concatenate([np.empty(0, np.int64), *(rows for rows, _ in parts)])
        order = np.argsort(rows if rank is None else rank[rows], kind="stable")
        values, none, in_order = {}, np.empty(0, bool), (np.diff(order) == 1).all()
        absent = np.ma.array(np.zeros(rows.size, bool), mask=True)
        for path in self.paths:
            is_there = any(path in one for _, one in parts)
            pieces = [
                one[path] if path in one else absent[: rows.size] for rows, one in parts if is_there
            ]
            whole = joined_masked([none, *pieces]) if is_there else absent
            # of an hour at 1 kHz a copy is 30 MB
            values[path] = whole if in_order else whole[order]
        return Columns(rows[order], values, self.count - rows.size, self.misfit)


def masked_numbers(path: str, column: Sequence[float | bool | None]) -> NDArray[Any]:
    """Numbers, masked where there is none; whole ones in the type that holds them exactly, if one
    does."""
    known, mask = [0 if one is None else one for one in column], [one is None for one in column]
    kinds = {one.__class__ for one in column if one is not None}
    if bool in kinds and len(kinds) > 1:  # joined, `True` would become 1
        raise InputError(
            f"field '{path}' is a truth value in some places and a number in others; name"
            " another one"
        )
    for kind in (np.int64, np.uint64) if kinds == {int} else ():
        with suppress(OverflowError):
            return np.ma.array(np.array(known, kind), mask=mask)
    return np.ma.array(np.array(known, np.float64 if kinds - {bool} else bool), mask=mask)


# key in a channel's metadata: why the channel has no schema, and what to do
NOT_DEFINED = "not defined"


def type_of(channel: Channel, schema: Schema | None) -> "MessageType | Callable[[bytes], Any]":
    """The type of a channel's messages of ROS, or what makes objects of others; InputError if they
    cannot be read."""
    encoding = (channel.message_encoding, schema.encoding if schema else "no schema")
    if NOT_DEFINED in channel.metadata:
        raise InputError(f"topic '{channel.topic}': {channel.metadata[NOT_DEFINED]}")
    if encoding[0] == "json":
        return json_object
    if schema is None or encoding not in (
        ("cdr", "ros2msg"),
        ("ros1", "ros1msg"),
        ("protobuf", "protobuf"),
    ):
        said = f"topic '{channel.topic}' is encoded as {encoding[0]} ({encoding[1]})"
        raise InputError(
            f"{said}; read are cdr (ros2msg), ros1 (ros1msg), protobuf (protobuf) and json: convert"
            " the log"
        )
    try:
        is_ros = encoding[0] != "protobuf"
        return (
            message_type(schema, ros1=encoding[0] == "ros1") if is_ros else protobuf_decoder(schema)
        )
    except InputError as error:
        said = f"topic '{channel.topic}': {str(error).replace('; ', ', ')}"
        remedy = (
            "record again with the definitions that its publisher was built with, or map another"
            " topic"
        )
        raise InputError(f"{said}; {remedy}") from error


def describe_message(
    channel: Channel, schema: Schema | None, payload: bytes | None
) -> list[FieldDescription]:
    """The fields of a channel's message, or without one of its schema; ValueError if they cannot be
    told."""
    kind = type_of(channel, schema)
    if not isinstance(kind, MessageType):
        no_schema = payload is None and kind is json_object
        return [] if no_schema else list(fields_in(kind(payload or b""), 1, {}))
    shape = shape_of(kind, payload)
    texts: dict[str, list[str]] = defaultdict(list)
    for path, (_, text) in shape.texts.items():
        texts[path.rpartition("[")[0]].append(text.rstrip(b"\0").decode(errors="replace"))
    return [
        FieldDescription(
            path, np.dtype(spelled).name, length, labels_of(path, length, texts) or ["0"]
        )
        for path, (_, spelled, length) in shape.leaves.items()
        if not re.search(r"\[(?!0\])\d+\]", path)  # of an array of messages the first one tells
    ]


PRIMITIVES = {
    "bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2",
    "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types in numpy's spelling. rosidl maps `char` to uint8:
design.ros2.org/articles/legacy_interface_definition.html."""
FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<array>\[(?P<bound><=)?(?P<size>\d*)\])?\s+(?P<name>\w+)"
)
ROS1_AS_ROS2 = {
    "time": "ros1/Time",
    "duration": "ros1/Duration",
    "Header": "std_msgs/Header",
    "byte": "int8",
}
"""What the types that ROS 2 does not have, or means otherwise, are (wiki.ros.org/msg)."""


# name, type (a primitive, a string or `package/Name`), and the length of an array: -1 where the
# message tells it
MessageField = tuple[str, str, int | None]


class MessageType(NamedTuple):
    name: str  # `package/Name`
    definitions: dict[str, list[MessageField]]  # fields of it and of all types in it
    ros1: bool  # little-endian, not aligned, no zero at the end of strings (wiki.ros.org/msg)


def short_name(name: str) -> str:
    """`package/msg/Name` as `package/Name`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def message_type(schema: Schema, *, ros1: bool) -> MessageType:
    """The type that a schema in ros2msg or ros1msg defines; InputError if it cannot be read."""
    known = (*PRIMITIVES, "string")  # a wstring has no portable encoding
    stamp: list[MessageField] = [("sec", "int32", None), ("nanosec", "uint32", None)]
    definitions = {"builtin_interfaces/Time": stamp, "builtin_interfaces/Duration": stamp}
    for name, seconds in (("ros1/Time", "uint32"), ("ros1/Duration", "int32")):
        definitions[name] = [("secs", seconds, None), ("nsecs", seconds, None)]
    text = schema.data.decode(errors="replace")
    for number, part in enumerate(re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)):
        head = re.match(r"\s*MSG:\s*(\S+)[ \t]*$", part, re.MULTILINE) if number else None
        if number and not head:
            raise InputError(
                f"schema {schema.name}: a line 'MSG: package/Name' is missing after a separator"
            )
        owner = short_name(head[1] if head else schema.name)
        fields = definitions[owner] = list[MessageField]()
        for raw in part[head.end() if head else 0 :].splitlines():
            line = raw.split("#")[0].strip()
            match = FIELD.match(line)
            if line and not match:
                raise InputError(
                    f"schema {owner}: cannot read the line '{line[:60]}'; expected a type and a"
                    " name"
                )
            if not match or line[match.end() :].lstrip().startswith("="):  # a constant
                continue
            kind, array = (
                ROS1_AS_ROS2.get(match["type"], match["type"]) if ros1 else match["type"],
                None,
            )
            if kind not in known:  # a bare name belongs to the package that uses it
                kind = short_name(kind) if "/" in kind else f"{owner.split('/')[0]}/{kind}"
            if match["array"] is not None:
                array = int(match["size"]) if match["size"] and not match["bound"] else -1
            if match["name"] in [name for name, *_ in fields]:
                raise InputError(f"schema {owner}: field '{match['name']}' is defined twice")
            fields.append((match["name"], kind, array))
    for owner, fields in definitions.items():
        for name, kind, _ in fields:
            if kind not in definitions and kind not in known:
                raise InputError(f"schema {owner}: type '{kind}' of field '{name}' is not defined")
    return MessageType(short_name(schema.name), definitions, ros1)


# first byte in the message, type of the number in numpy's spelling (`?` for a bool), and length of
# an array, or None
Leaf = tuple[int, str, int | None]


@dataclass
class Shape:
    """Where the numbers of a message are, and how to read those of its likes."""

    # its numbers, and arrays of numbers, by path
    leaves: dict[str, Leaf] = field(default_factory=dict)
    # place and bytes of strings in arrays, by path
    texts: dict[str, tuple[int, bytes]] = field(default_factory=dict)
    # places and bytes that another message must share
    guards: list[tuple[int, bytes]] = field(default_factory=list)
    wanted: dict[str, Leaf] = field(default_factory=dict)  # the numbers to read, by path

    def leaf_at(self, path: str) -> Leaf | None:
        """The single number at `path`; None where the message lacks the field or its array is too
        short."""
        leaf = self.leaves.get(path)
        if leaf is not None and leaf[2] is not None:
            raise NoNumberError(f"field '{path}' is an array of {leaf[2]}, not one number")
        if leaf is not None or not steps_of(path):
            return leaf
        key, way = steps_of(path)[-1]
        if isinstance(key, tuple):
            names = f"{way.rpartition('.')[0]}.{key[0]}[".removeprefix(".")
            own = [one for one in self.texts if one.startswith(names)]
            # in another message these may have other names
            self.guards += [self.texts[one] for one in own if self.texts[one] not in self.guards]
            found = [self.texts[one][1].rstrip(b"\0").decode(errors="replace") for one in own]
            if one_named(found, key):
                return self.leaf_at(f"{way}[{own[found.index(key[1])].removeprefix(names)}")
        start, kind, length = self.leaves.get(way, (0, "u1", None))
        if not isinstance(key, int) or key >= (length or 0):
            return None
        return start + key * np.dtype(kind).itemsize, kind, None

    def fits(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Which messages of this length, (messages,), have this shape."""
        same = np.ones(rows.size, bool)
        for place, shared in self.guards:
            kind = np.dtype({2: "u2", 4: "u4"}.get(len(shared), f"S{len(shared)}"))
            if shared:
                same &= numbers_in(rows, place, kind) == np.frombuffer(shared, kind)
        return same

    def read(self, rows: NDArray[np.void]) -> Values:
        """The wanted numbers of messages of this shape."""
        values = {}
        for path, (place, spelled, _) in self.wanted.items():
            kind = np.dtype(spelled.replace("?", "u1"))
            native = numbers_in(rows, place, kind).astype(kind.newbyteorder("="))
            values[path] = native != 0 if "?" in spelled else native
        return values


def shape_of(kind: MessageType, payload: bytes | None, paths: Sequence[str] = ()) -> Shape:
    """The shape of one message, to read the fields at `paths`, as far as it has them; without a
    message that of zeros. InputError if the message is not what its type says, NoNumberError if a
    field is no single number."""
    begin = 0 if kind.ros1 else 4
    data = bytes((0, not kind.ros1)) + bytes(1 << 16) if payload is None else payload
    if not kind.ros1 and (len(data) < 4 or data[0] != 0 or data[1] > 1):
        raise InputError(
            f"encapsulation {data[:4].hex()} is not plain CDR; record with the default encoding"
        )
    order, position, shape = (
        "<" if kind.ros1 or data[1] else ">",
        begin,
        Shape(guards=[(0, data[: begin // 2])]),
    )
    too_short = InputError(
        f"a message of {len(data)} bytes is too short for its schema; the schema is not its own"
    )

    def align(size: int) -> None:
        nonlocal position
        position += 0 if kind.ros1 else (begin - position) % size

    def length() -> int:
        """Read the length of a string or a sequence; its bytes become guards."""
        nonlocal position
        align(4)
        told = data[position : position + 4]
        if len(told) < 4:
            raise too_short
        shape.guards.append((position, told))
        position += 4
        return int(struct.unpack(f"{order}I", told)[0])

    def walk(name: str, prefix: str) -> None:
        nonlocal position
        # one without fields has a byte in CDR
        position += not kind.definitions[name] and not kind.ros1
        for own_name, own_type, array in kind.definitions[name]:
            path, number = f"{prefix}{own_name}", PRIMITIVES.get(own_type)
            # at least
            size = np.dtype(number).itemsize if number else 4 if own_type == "string" else 1
            count = 1 if array is None else length() if array < 0 else array
            if array is not None and count * size > len(data) - position:
                raise too_short  # a damaged length would make a loop without end
            if number:
                align(size if count else 1)
                shape.leaves[path] = position, order + number, None if array is None else count
                position += count * size
                continue
            for own in [path] if array is None else [f"{path}[{index}]" for index in range(count)]:
                if own_type != "string":
                    walk(own_type, f"{own}.")
                    continue
                size = length()
                if array is not None:
                    shape.texts[own] = position, data[position : position + size]
                position += size

    walk(kind.name, "")
    if payload is None:
        return shape
    if position > len(data):
        raise too_short
    left = data[position:]
    # DDS pads to four bytes of any content (RTPS 2.5, 9.4.1)
    most = 0 if kind.ros1 else 3 if left.strip(b"\0") else 7
    if len(left) > most:
        said = f"a message of {len(data)} bytes has {len(left)} more than its schema describes"
        remedy = "record the log again with the definitions that its publisher was built with"
        raise InputError(f"{said}; the schema is not its own: {remedy}")
    if len(left) > 3:  # to eight bytes, of zeros
        shape.guards.append((position, left))
    shape.wanted = {path: leaf for path in paths if (leaf := shape.leaf_at(path))}
    return shape


def numbers_in(rows: NDArray[np.void], place: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """The numbers of one type at one place [bytes] in messages of one length, (messages,)."""
    return np.ndarray(rows.shape, kind, rows, place, rows.strides)


def numbers_at(buffer: bytes, places: Indices, kind: np.dtype[Any]) -> NDArray[Any]:
    """The numbers of one type at places in a buffer [bytes], which need not be aligned,
    (places,)."""
    everywhere = np.ndarray((max(0, len(buffer) - kind.itemsize + 1),), kind, buffer, 0, (1,))
    return everywhere[places]


def number_at(message: Any, path: str) -> float | bool | None:
    """The number at a path of an object, None where there is none; NoNumberError where something
    else stands."""
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
            key = list(names).index(key[1]) if names and one_named(names, key) else len(value)
        value = value[key] if key < len(value) else None
    if value is None or value.__class__ in (int, float, bool):
        return value
    if not is_array(value):
        raise no_number(value, path, "a number")
    if len(value):
        raise NoNumberError(f"field '{path}' is an array of {len(value)}, not one number")
    return None


def one_named(names: Sequence[Any], wanted: tuple[str, str]) -> bool:
    """Whether an element has the wanted name; NoNumberError where several have it."""
    if (count := list(names).count(wanted[1])) > 1:
        raise NoNumberError(
            f"{count} elements are named '{wanted[1]}' in '{wanted[0]}': write an index in its"
            " place"
        )
    return count == 1


def no_number(value: Any, way: str, expected: str) -> NoNumberError:
    shown = json.dumps(value, ensure_ascii=False, default=lambda one: " ".join(str(one).split()))
    shown = shown if len(shown) <= 40 else f"{shown[:40]}..."
    what = f"field '{way}'" if way else "the whole"
    return NoNumberError(f"{what} is {shown}, not {expected}")


def is_array(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def all_are(kind: Any, values: Sequence[Any]) -> bool:
    return len(values) > 0 and all(isinstance(one, kind) for one in values)


def member(record: Any, name: str, way: str = "") -> Any:
    """A field of an object at the path `way`, None where it is not written; NoNumberError where
    there is no object."""
    if record.__class__ is dict:
        return record.get(name)
    descriptor = getattr(record, "DESCRIPTOR", None)
    if descriptor is None:
        raise no_number(record, way, "an object with fields")
    item = descriptor.fields_by_name.get(name)
    if item is None or (item.has_presence and not record.HasField(name)):
        return None
    return getattr(record, name)


def json_object(text: bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a message of {len(text)} bytes is not JSON: {error}") from error


def protobuf_decoder(schema: Schema) -> Callable[[bytes], Any]:
    """Makes a message of google.protobuf; InputError where the schema cannot be used, or a message
    does not fit it."""
    # these cost time to import, and few logs need them
    from google.protobuf.message import DecodeError
    from mcap.exceptions import McapError
    from mcap_protobuf.decoder import DecoderFactory

    try:
        decode: Any = DecoderFactory().decoder_for("protobuf", schema)
        decode(b"")
    except (McapError, DecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise InputError(
            f"schema {schema.name}: cannot be read: {' '.join(str(error).split())}"
        ) from error

    def checked(payload: bytes) -> Any:
        try:
            return decode(payload)
        except DecodeError:
            text = f"a message of {len(payload)} bytes is not what its schema says, or is damaged"
            raise InputError(text) from None

    return checked
