"""Where the numbers of a ROS message stand, by its definition.

The numbers stand in the same places in all messages of one *shape*: of one length, and with the
same bytes where strings and sequences tell their lengths (the shape's *guards*). One message of a
shape is walked; the numbers of all others are a view of their bytes, a thousand times as fast.
"""

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError

# types in NumPy's spelling; rosidl maps `char` to uint8
# (design.ros2.org/articles/legacy_interface_definition.html)
NUMBERS = {
    "bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2",
    "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
KNOWN_TYPES = (*NUMBERS, "string")  # a wstring has no portable encoding
# types that ROS 1 has, or means otherwise (wiki.ros.org/msg)
ROS1_TYPES = {
    "time": "ros1/Time",
    "duration": "ros1/Duration",
    "Header": "std_msgs/Header",
    "byte": "int8",
}
DEFINITION_LINE = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<array>\[(?P<bound><=)?(?P<size>\d*)\])?\s+(?P<name>\w+)"
)
FRAME = "header.frame_id"  # publishers of one topic often write other frames
TOLD_BY_MESSAGE = -1  # length of an array whose length stands in each message
ENCAPSULATION = 4  # bytes before a CDR message; the second one tells the byte order
WORDS = (8, 4, 2, 1)  # bytes of a whole number
MOST_PADDING = 7  # DDS fills up to 4 bytes of any content (RTPS 2.5, 9.4.1), some to 8 zeros


class NoNumberError(ValueError):
    """Something else than one number stands in a wanted field."""


@dataclass(frozen=True)
class MessageField:
    """One field of a definition: a number, a string or a message, or an array of these."""

    name: str
    type: str  # key of `NUMBERS`, `string`, or `package/Name`
    length: int | None = None  # of an array; None for a single value, or `TOLD_BY_MESSAGE`


@dataclass(frozen=True)
class MessageType:
    """A message's definition with those of all types in it."""

    name: str  # `package/Name`
    fields: Mapping[str, Sequence[MessageField]]  # by type
    is_ros1: bool  # little-endian, not aligned, no zero at the end of strings


def short_name(name: str) -> str:
    """Write `package/msg/Name` as `package/Name`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def message_type(name: str, text: str, is_ros1: bool) -> MessageType:
    """Parse a definition in ros2msg or ros1msg.

    Parameters
    ----------
    name
        Name of the type, with or without `/msg`.
    text
        Its definition, followed by those of the types in it, each after a line of `=` and a line
        `MSG: package/Name`.

    Raises
    ------
    InputError
        A line cannot be read, or a type is not defined.
    """
    stamp = [MessageField("sec", "int32"), MessageField("nanosec", "uint32")]
    fields: dict[str, list[MessageField]] = {
        "builtin_interfaces/Time": stamp,
        "builtin_interfaces/Duration": stamp,
        "ros1/Time": [MessageField("secs", "uint32"), MessageField("nsecs", "uint32")],
        "ros1/Duration": [MessageField("secs", "int32"), MessageField("nsecs", "int32")],
    }
    first, *others = re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)
    fields[short_name(name)] = _fields_in(first, short_name(name), is_ros1)
    for part in others:
        head = re.match(r"\s*MSG:\s*(\S+)[ \t]*$", part, re.MULTILINE)
        if not head:
            raise InputError(
                f"schema {name}: a line 'MSG: package/Name' is missing after a separator"
            )
        owner = short_name(head[1])
        fields[owner] = _fields_in(part[head.end() :], owner, is_ros1)
    for owner, members in fields.items():
        for member in members:
            if member.type not in fields and member.type not in KNOWN_TYPES:
                raise InputError(
                    f"schema {owner}: type '{member.type}' of field '{member.name}' is not defined"
                )
    return MessageType(short_name(name), fields, is_ros1)


def _fields_in(text: str, owner: str, is_ros1: bool) -> list[MessageField]:
    fields: list[MessageField] = []
    for raw_line in text.splitlines():
        line = raw_line.split("#")[0].strip()
        if not line:
            continue
        match = DEFINITION_LINE.match(line)
        if not match:
            raise InputError(
                f"schema {owner}: cannot read the line '{line[:60]}'; expected a type and a name"
            )
        is_constant = line[match.end() :].lstrip().startswith("=")
        if is_constant:
            continue
        kind = match["type"]
        if is_ros1:
            kind = ROS1_TYPES.get(kind, kind)
        if kind not in KNOWN_TYPES:
            # a bare name belongs to the package that uses it
            kind = short_name(kind) if "/" in kind else f"{owner.split('/')[0]}/{kind}"
        length = None
        if match["array"] is not None:
            is_fixed = match["size"] and not match["bound"]
            length = int(match["size"]) if is_fixed else TOLD_BY_MESSAGE
        if any(member.name == match["name"] for member in fields):
            raise InputError(f"schema {owner}: field '{match['name']}' is defined twice")
        fields.append(MessageField(match["name"], kind, length))
    return fields


@dataclass(frozen=True)
class Leaf:
    """A number in a message, or an array of numbers."""

    place: int  # its first byte in the message
    type: str  # in NumPy's spelling, with the byte order; `?` for a truth value
    count: int | None = None  # of an array

    @property
    def dtype(self) -> np.dtype[Any]:
        """Its bytes as NumPy reads them; a truth value is one byte."""
        return np.dtype(self.type.replace("?", "u1"))


@dataclass
class Shape:
    """Where the numbers of a message stand, and how to tell messages of the same shape."""

    leaves: dict[str, Leaf] = field(default_factory=dict)  # by path
    # texts of arrays of strings, by the array's path
    texts: dict[str, list[str]] = field(default_factory=dict)
    guards: list[tuple[int, bytes]] = field(default_factory=list)  # place and bytes
    frame: str = ""  # name of the frame in its header

    def fits(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Tell which messages of this length, shape (messages,), have this shape."""
        same = np.ones(rows.size, bool)
        for place, shared in self.guards:
            kind = np.dtype(f"u{len(shared)}")
            same &= numbers_in(rows, place, kind) == np.frombuffer(shared, kind)
        return same

    def names(self) -> dict[str, list[str]]:
        """Arrays of names by their path, where they name the elements of an array of numbers; and
        the frame of the header."""
        names: dict[str, list[str]] = {}
        if self.frame:
            names[FRAME] = [self.frame]
        for path, leaf in self.leaves.items():
            if leaf.count:
                name, texts = self.labels_of(path)
                if texts:
                    names[f"{path.rpartition('.')[0]}.{name}".removeprefix(".")] = texts
        return names

    def labels_of(self, path: str) -> tuple[str, list[str]]:
        """Name the elements of an array of numbers.

        Gives the name of the first array of as many different texts beside it, and these texts;
        empty where there is none.
        """
        parent = path.rpartition(".")[0]
        for texts_path, texts in self.texts.items():
            texts_parent, _, texts_name = texts_path.rpartition(".")
            is_beside = texts_parent == parent and re.fullmatch(r"\w+", texts_name)
            are_names = len(set(texts)) == len(texts) and all(x and "]" not in x for x in texts)
            if is_beside and are_names and len(texts) == self.leaves[path].count:
                return texts_name, texts
        return "", []

    def leaf_at(self, path: str) -> Leaf | None:
        """Find the single number at a path; None where the message has none.

        The path may end with an index, `position[0]`, or a choice by the array of names beside
        it, `position[name=ankle]`.

        Raises
        ------
        NoNumberError
            The path leads to an array, or several elements have the wanted name.
        """
        leaf = self.leaves.get(path)
        if leaf is not None:
            if leaf.count is not None:
                raise NoNumberError(f"field '{path}' is an array of {leaf.count}, not one number")
            return leaf
        array_path, bracket, inside = path.removesuffix("]").rpartition("[")
        array = self.leaves.get(array_path)
        if not bracket or array is None or array.count is None:
            return None
        if inside.isdigit():
            index = int(inside)
        else:
            names_name, _, wanted = inside.partition("=")
            parent = array_path.rpartition(".")[0]
            names = self.texts.get(f"{parent}.{names_name}".removeprefix("."), [])
            if names.count(wanted) > 1:
                raise NoNumberError(
                    f"{names.count(wanted)} elements are named '{wanted}' in '{names_name}': write"
                    " an index in its place"
                )
            if wanted not in names:
                return None
            index = names.index(wanted)
        if index >= array.count:
            return None
        return Leaf(array.place + index * array.dtype.itemsize, array.type)

    def read(self, leaf: Leaf, rows: NDArray[np.void]) -> NDArray[Any]:
        """Read a number of messages of this shape, (messages,), in the machine's byte order."""
        native = leaf.dtype.newbyteorder("=")
        values = numbers_in(rows, leaf.place, leaf.dtype).astype(native)
        return values != 0 if "?" in leaf.type else values


def numbers_in(rows: NDArray[np.void], place: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """View the numbers at one place [bytes] of messages of one length, (messages,)."""
    return np.ndarray(rows.shape, kind, rows, place, rows.strides)


def rows_at(buffer: bytes, starts: NDArray[np.int64], length: int) -> NDArray[np.void]:
    """Copy the bytes of messages of one length, (messages,), that need not be aligned."""
    kind = np.dtype(f"V{length}")
    everywhere = np.ndarray((max(0, len(buffer) - length + 1),), kind, buffer, 0, (1,))
    return everywhere[starts]


def shape_of(kind: MessageType, data: bytes) -> Shape:
    """Walk through a message.

    Raises
    ------
    InputError
        The message is not what its definition says.
    """
    is_plain_cdr = len(data) >= ENCAPSULATION and data[0] == 0 and data[1] <= 1
    if not kind.is_ros1 and not is_plain_cdr:
        raise InputError(
            f"encapsulation {data[:4].hex()} is not plain CDR; record with the default encoding"
        )
    walk = _Walk(kind, data)
    walk.message(kind.name, "")
    walk.check_end()
    walk.guard_names()
    walk.shape.guards = in_words(walk.shape.guards)
    return walk.shape


def in_words(guards: Sequence[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    """Write guards as whole numbers of 8, 4, 2 or 1 bytes, which are compared faster than texts;
    those that follow one another to the byte are joined before."""
    joined: dict[int, bytes] = {}  # by the place behind each
    for place, shared in sorted(set(guards)):
        joined[place + len(shared)] = joined.pop(place, b"") + shared
    words: list[tuple[int, bytes]] = []
    for end, shared in joined.items():
        place = end - len(shared)
        while place < end:
            size = next(size for size in WORDS if size <= end - place)
            begin = place - end + len(shared)
            words.append((place, shared[begin : begin + size]))
            place += size
    return words


def shape_of_zeros(kind: MessageType) -> Shape:
    """Walk through a message of zeros, for a topic without messages: its arrays are empty."""
    little_endian_cdr = b"\0\1\0\0"
    data = (b"" if kind.is_ros1 else little_endian_cdr) + bytes(1 << 16)
    walk = _Walk(kind, data)
    walk.message(kind.name, "")
    return walk.shape


class _Walk:
    """A walk through one message, which notes where its numbers stand."""

    def __init__(self, kind: MessageType, data: bytes) -> None:
        self.kind = kind
        self.data = data
        self.begin = 0 if kind.is_ros1 else ENCAPSULATION
        self.position = self.begin
        self.byte_order = "<" if kind.is_ros1 or data[1] else ">"
        self.shape = Shape()
        self.text_guards: dict[str, list[tuple[int, bytes]]] = {}
        if not kind.is_ros1:
            self.shape.guards.append((0, data[:2]))

    def message(self, name: str, prefix: str) -> None:
        """Walk through the fields of a message whose paths begin with a prefix."""
        fields = self.kind.fields[name]
        if not fields and not self.kind.is_ros1:
            self.position += 1  # a message without fields has a byte in CDR
        for member in fields:
            path = f"{prefix}{member.name}"
            count = self.count_of(member)
            if member.type in NUMBERS:
                self.numbers(path, member, count)
            elif member.type == "string":
                self.strings(path, member, count)
            elif member.length is None:
                self.message(member.type, f"{path}.")
            else:
                for index in range(count):
                    self.message(member.type, f"{path}[{index}].")

    def count_of(self, member: MessageField) -> int:
        """Number of values of a field."""
        if member.length is None:
            return 1
        count = self.read_length() if member.length == TOLD_BY_MESSAGE else member.length
        least_bytes = 4 if member.type == "string" else 1
        if member.type in NUMBERS:
            least_bytes = np.dtype(NUMBERS[member.type]).itemsize
        if count * least_bytes > len(self.data) - self.position:
            raise self.too_short()  # a damaged length would make a loop without end
        return count

    def numbers(self, path: str, member: MessageField, count: int) -> None:
        size = np.dtype(NUMBERS[member.type]).itemsize
        if count:
            self.align(size)
        kind = self.byte_order + NUMBERS[member.type]
        self.shape.leaves[path] = Leaf(
            self.position, kind, None if member.length is None else count
        )
        self.position += count * size

    def strings(self, path: str, member: MessageField, count: int) -> None:
        texts: list[str] = []
        guards: list[tuple[int, bytes]] = []
        for _ in range(count):
            size = self.read_length()
            text = self.data[self.position : self.position + size]
            texts.append(text.rstrip(b"\0").decode(errors="replace"))
            guards.append((self.position, text))
            self.position += size
        if member.length is not None:
            self.shape.texts[path] = texts
            self.text_guards[path] = guards
        elif path == FRAME:
            self.shape.frame = texts[0]
            self.shape.guards += guards

    def align(self, size: int) -> None:
        if not self.kind.is_ros1:
            self.position += (self.begin - self.position) % size

    def read_length(self) -> int:
        """Read the length of a string or a sequence; its bytes are a guard."""
        self.align(4)
        length = self.data[self.position : self.position + 4]
        if len(length) < 4:
            raise self.too_short()
        self.shape.guards.append((self.position, length))
        self.position += 4
        return int(struct.unpack(f"{self.byte_order}I", length)[0])

    def guard_names(self) -> None:
        """Guard the texts that name the elements of an array: in another message these may stand
        in another order."""
        for path, texts in self.shape.texts.items():
            parent = path.rpartition(".")[0]
            for other_path, leaf in self.shape.leaves.items():
                if other_path.rpartition(".")[0] == parent and leaf.count == len(texts):
                    self.shape.guards += self.text_guards[path]
                    break

    def check_end(self) -> None:
        """Refuse a message that is shorter or longer than its definition."""
        if self.position > len(self.data):
            raise self.too_short()
        padding = self.data[self.position :]
        most = 3 if padding.strip(b"\0") else MOST_PADDING
        if self.kind.is_ros1:
            most = 0
        if len(padding) > most:
            raise InputError(
                f"a message of {len(self.data)} bytes has {len(padding)} more than its schema"
                " describes; the schema is not its own: record the log again with the definitions"
                " that its publisher was built with"
            )
        if len(padding) > 3:
            self.shape.guards.append((self.position, padding))

    def too_short(self) -> InputError:
        return InputError(
            f"a message of {len(self.data)} bytes is too short for its schema; the schema is not"
            " its own"
        )
