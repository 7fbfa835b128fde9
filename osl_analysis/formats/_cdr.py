"""Where the numbers of a ROS message stand, by its definition.

The numbers stand at the same places in all messages of one layout: of one length, and with the same
bytes where texts and sequences tell their lengths. One message of a layout is walked. The numbers
of all others are a view of their bytes, which is a thousand times as fast.
"""

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
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
# what ROS 1 has besides, or means otherwise (wiki.ros.org/msg)
ROS1_TYPES = {
    "time": "ros1/Time",
    "duration": "ros1/Duration",
    "Header": "std_msgs/Header",
    "byte": "int8",
}
LINE = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<array>\[(?P<bound><=)?(?P<size>\d*)\])?\s+(?P<name>\w+)"
)
FRAME = "header.frame_id"  # publishers of one topic often write other frames
TOLD_BY_MESSAGE = -1  # length of an array whose length stands in each message
ENCAPSULATION = 4  # bytes before a CDR message; the second one tells the byte order
MOST_PADDING = 3  # bytes behind a message, which DDS fills up to 4 (RTPS 2.5, 9.4.1)
MOST_ZEROS = 7  # bytes behind a message of writers that fill up to 8 by zeros
OTHER_ELEMENT = re.compile(r"\[[1-9]\d*\]")  # of an array; its first one is listed alone


@dataclass(frozen=True)
class Member:
    """One field of a definition: a number, a text or a message, or an array of these."""

    name: str
    type: str  # key of `NUMBERS`, `string`, or `package/Name`
    length: int | None = None  # of an array; None for a single value, or `TOLD_BY_MESSAGE`


@dataclass(frozen=True)
class Definition:
    """The definition of a message, with those of all types in it."""

    name: str  # `package/Name`
    members: Mapping[str, Sequence[Member]]  # by type
    is_ros1: bool  # little-endian, not aligned, no zero at the end of texts


def short_name(name: str) -> str:
    """Write `package/msg/Name` as `package/Name`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


@lru_cache(64)
def definition_of(name: str, text: str, is_ros1: bool) -> Definition:
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
    stamp = [Member("sec", "int32"), Member("nanosec", "uint32")]
    members: dict[str, list[Member]] = {
        "builtin_interfaces/Time": stamp,
        "builtin_interfaces/Duration": stamp,
        "ros1/Time": [Member("secs", "uint32"), Member("nsecs", "uint32")],
        "ros1/Duration": [Member("secs", "int32"), Member("nsecs", "int32")],
    }
    first, *others = re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)
    members[short_name(name)] = _members_in(first, short_name(name), is_ros1)
    for part in others:
        head = re.match(r"\s*MSG:\s*(\S+)[ \t]*$", part, re.MULTILINE)
        if not head:
            raise InputError(f"schema {name}: no line 'MSG: package/Name' behind a separator")
        owner = short_name(head[1])
        members[owner] = _members_in(part[head.end() :], owner, is_ros1)
    for owner, of_owner in members.items():
        for member in of_owner:
            if member.type not in (*members, *NUMBERS, "string"):
                raise InputError(
                    f"schema {owner}: type '{member.type}' of field '{member.name}' is not defined"
                )
    return Definition(short_name(name), members, is_ros1)


def _members_in(text: str, owner: str, is_ros1: bool) -> list[Member]:
    members: dict[str, Member] = {}
    for raw_line in text.splitlines():
        line = raw_line.split("#")[0].strip()
        if not line:
            continue
        match = LINE.match(line)
        if not match:
            raise InputError(
                f"schema {owner}: cannot read the line '{line[:60]}'; expected a type and a name"
            )
        is_constant = line[match.end() :].lstrip().startswith("=")
        if is_constant:
            continue
        if match["name"] in members:
            raise InputError(f"schema {owner}: field '{match['name']}' is defined twice")
        kind = match["type"]
        if is_ros1:
            kind = ROS1_TYPES.get(kind, kind)
        if kind not in NUMBERS and kind != "string":
            # a bare name belongs to the package that uses it
            kind = short_name(kind) if "/" in kind else f"{owner.split('/')[0]}/{kind}"
        length = None
        if match["array"] is not None:
            is_fixed = match["size"] and not match["bound"]
            length = int(match["size"]) if is_fixed else TOLD_BY_MESSAGE
        members[match["name"]] = Member(match["name"], kind, length)
    return list(members.values())


@dataclass(frozen=True)
class Number:
    """A number in a message, or an array of numbers."""

    place: int  # its first byte in the message
    type: str  # in NumPy's spelling, with the byte order; `?` for a truth value
    count: int | None = None  # of an array

    @property
    def dtype(self) -> np.dtype[Any]:
        """Its bytes as NumPy reads them; a truth value is one byte."""
        return np.dtype(self.type.replace("?", "u1"))


@dataclass
class Layout:
    """Where the numbers of a message stand, and how to tell messages of the same layout."""

    numbers: dict[str, Number] = field(default_factory=dict)  # by path
    texts: dict[str, list[str]] = field(default_factory=dict)  # of arrays of texts, by path
    # bytes by their place, which all messages of the layout share
    shared: dict[int, bytes] = field(default_factory=dict)
    frame: str = ""  # name of the frame in its header

    def fits(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Tell which messages of this length, shape (messages,), have this layout."""
        is_same = np.ones(rows.size, bool)
        for place, content in self.shared.items():
            kind = np.dtype(f"S{len(content)}")
            is_same &= numbers_at(rows, place, kind) == np.frombuffer(content, kind)
        return is_same

    def names(self) -> dict[str, list[str]]:
        """The texts that name elements of arrays, by their path, and the frame of the header. They
        differ between publishers."""
        names = {path: self.texts[path] for path in self.texts if self.named_by(path)}
        if self.frame:
            names[FRAME] = [self.frame]
        return names

    def named_by(self, texts_path: str) -> list[str]:
        """Paths of the arrays whose elements are named by the texts beside them."""
        parent, _, name = texts_path.rpartition(".")
        texts = self.texts[texts_path]
        are_names = name.isidentifier() and all(text and "]" not in text for text in texts)
        if not are_names or len(set(texts)) < len(texts):
            return []
        return [
            path
            for path, number in self.numbers.items()
            if number.count == len(texts) > 0 and path.rpartition(".")[0] == parent
        ]

    def listed(self) -> list[str]:
        """Paths of its single numbers; of an array its named elements, or else its first one."""
        labels: dict[str, list[str]] = {}
        for texts_path, texts in self.texts.items():
            name = texts_path.rpartition(".")[2]
            for path in self.named_by(texts_path):
                labels.setdefault(path, [f"{name}={text}" for text in texts])
        paths: list[str] = []
        for path, number in self.numbers.items():
            if number.count is None:
                paths.append(path)
                continue
            elements = labels.get(path) or ["0"][: number.count]
            paths += [f"{path}[{element}]" for element in elements]
        return [path for path in paths if not OTHER_ELEMENT.search(path)]

    def number_at(self, path: str) -> Number | None:
        """Find the single number at a path; None where the message has none.

        The path may end with an index, `position[0]`, or a choice by the array of names beside
        it, `position[name=ankle]`.
        """
        number = self.numbers.get(path)
        if number is not None:
            return number if number.count is None else None
        array_path, _, inside = path.removesuffix("]").rpartition("[")
        array = self.numbers.get(array_path)
        if array is None or array.count is None:
            return None
        index = array.count
        if inside.isdigit():
            index = int(inside)
        else:
            name, _, wanted = inside.partition("=")
            texts_path = f"{array_path.rpartition('.')[0]}.{name}".removeprefix(".")
            texts = self.texts.get(texts_path, [])
            if texts.count(wanted) == 1:
                index = texts.index(wanted)
        if index >= array.count:
            return None
        return Number(array.place + index * array.dtype.itemsize, array.type)

    def column(self, path: str, rows: NDArray[np.void]) -> NDArray[Any] | None:
        """A number of messages of this layout, (messages,); None where they have none."""
        number = self.number_at(path)
        if number is None:
            return None
        kind = number.dtype
        values = numbers_at(rows, number.place, kind).astype(kind.newbyteorder("="))
        return values != 0 if "?" in number.type else values


def numbers_at(rows: NDArray[np.void], place: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """View the numbers at one place [bytes] of messages of one length, (messages,)."""
    return np.ndarray(rows.shape, kind, rows, place, rows.strides)


def rows_at(buffer: bytes, starts: NDArray[np.int64], length: int) -> NDArray[np.void]:
    """Copy the bytes of messages of one length, (messages,), that need not be aligned."""
    kind = np.dtype(f"V{length}")
    everywhere = np.ndarray((max(0, len(buffer) - length + 1),), kind, buffer, 0, (1,))
    return everywhere[starts]


def layout_of(definition: Definition, data: bytes) -> Layout:
    """Walk through a message.

    Raises
    ------
    InputError
        The message is not what its definition says.
    """
    is_plain_cdr = len(data) >= ENCAPSULATION and data[0] == 0 and data[1] <= 1
    if not definition.is_ros1 and not is_plain_cdr:
        raise InputError(
            f"encapsulation {data[:4].hex()} is not plain CDR; record with the default encoding"
        )
    walk = _Walk(definition, data)
    try:
        walk.message(definition.name, "")
    except RecursionError as error:
        raise InputError(f"schema {definition.name}: a type contains itself") from error
    walk.check_end()
    walk.share_names()
    return walk.layout


class _Walk:
    """A walk through one message, which notes where its numbers stand."""

    def __init__(self, definition: Definition, data: bytes) -> None:
        self.definition = definition
        self.data = data
        self.is_ros1 = definition.is_ros1
        self.begin = 0 if self.is_ros1 else ENCAPSULATION
        self.position = self.begin
        self.byte_order = "<" if self.is_ros1 or data[1] else ">"
        self.layout = Layout()
        self.places_of_texts: dict[str, list[tuple[int, int]]] = {}
        if not self.is_ros1:
            self.share(0, 2)

    def message(self, type_name: str, prefix: str) -> None:
        """Walk through the fields of a message whose paths begin with a prefix."""
        members = self.definition.members[type_name]
        if not members and not self.is_ros1:
            self.position += 1  # a message without fields has a byte in CDR
        for member in members:
            path = f"{prefix}{member.name}"
            count = self.count_of(member)
            if member.type in NUMBERS:
                self.numbers(path, member, count)
            elif member.type == "string":
                self.read_texts(path, member, count)
            elif member.length is None:
                self.message(member.type, f"{path}.")
            else:
                for index in range(count):
                    self.message(member.type, f"{path}[{index}].")

    def count_of(self, member: Member) -> int:
        """Number of values of a field."""
        if member.length is None:
            return 1
        count = self.read_length() if member.length == TOLD_BY_MESSAGE else member.length
        size = 4 if member.type == "string" else 1
        if member.type in NUMBERS:
            size = np.dtype(NUMBERS[member.type]).itemsize
        if count * size > len(self.data) - self.position:
            raise self.too_short()  # a damaged length would make a loop without end
        return count

    def numbers(self, path: str, member: Member, count: int) -> None:
        size = np.dtype(NUMBERS[member.type]).itemsize
        if count:
            self.align(size)
        kind = self.byte_order + NUMBERS[member.type]
        length = None if member.length is None else count
        self.layout.numbers[path] = Number(self.position, kind, length)
        self.position += count * size

    def read_texts(self, path: str, member: Member, count: int) -> None:
        texts: list[str] = []
        places: list[tuple[int, int]] = []
        for _ in range(count):
            size = self.read_length()
            begin = self.position
            end = begin + size
            texts.append(self.data[begin:end].rstrip(b"\0").decode(errors="replace"))
            places.append((begin, end))
            self.position = end
        if member.length is not None:
            self.layout.texts[path] = texts
            self.places_of_texts[path] = places
        elif path == FRAME:
            self.layout.frame = texts[0]
            self.share(*places[0])

    def align(self, size: int) -> None:
        if not self.is_ros1:
            self.position += (self.begin - self.position) % size

    def read_length(self) -> int:
        """Read the length of a text or a sequence; all messages of the layout share it."""
        self.align(4)
        if self.position + 4 > len(self.data):
            raise self.too_short()
        (length,) = struct.unpack_from(f"{self.byte_order}I", self.data, self.position)
        self.share(self.position, self.position + 4)
        self.position += 4
        return int(length)

    def share(self, begin: int, end: int) -> None:
        """Note bytes that all messages of the layout share; runs of them are joined."""
        content = self.data[begin:end]
        for place, before in self.layout.shared.items():
            if place + len(before) == begin:
                self.layout.shared[place] = before + content
                return
        if content:
            self.layout.shared[begin] = content

    def share_names(self) -> None:
        """Share the texts that name elements of arrays: in another message they may stand in
        another order."""
        for path, places in self.places_of_texts.items():
            if self.layout.named_by(path):
                for begin, end in places:
                    self.share(begin, end)

    def check_end(self) -> None:
        """Refuse a message that is shorter or longer than its definition."""
        if self.position > len(self.data):
            raise self.too_short()
        padding = self.data[self.position :]
        most = MOST_PADDING if padding.strip(b"\0") else MOST_ZEROS
        if self.is_ros1:
            most = 0
        if len(padding) > most:
            raise InputError(
                f"a message of {len(self.data)} bytes has {len(padding)} more than its schema"
                " describes; record the log again with the definitions that its publisher was"
                " built with"
            )
        if len(padding) > MOST_PADDING:
            self.share(self.position, len(self.data))

    def too_short(self) -> InputError:
        return InputError(
            f"a message of {len(self.data)} bytes is too short for its schema; the schema is not"
            " its own"
        )
