"""Where the numbers of a ROS message stand, by the fields of its definition."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, optional_module

NUMBERS = {
    "bool": "?",
    "byte": "u1",
    "char": "u1",
    "octet": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
STAMP = [("sec", (1, ("int32", 0))), ("nanosec", (1, ("uint32", 0)))]
TIME_TYPES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
BASE, NAME, ARRAY = 1, 2, 3  # as rosbags numbers the kinds of fields; 4 is a sequence
MOST_ELEMENTS = 64  # of an array that is listed; longer ones are images and the like
ENCAPSULATION = 4  # bytes before a message in CDR


def full_name(name: str) -> str:
    """Write `package/Name` as `package/msg/Name`."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest.rpartition('/')[2]}"


@lru_cache(64)
def fields_by_type(name: str, text: str) -> Mapping[str, Sequence[Any]]:
    """The fields of a message's type, and of those in it, as rosbags describes them."""
    library = optional_module("rosbags.typesys", "messages of ROS")
    try:
        known = library.get_types_from_msg(text, full_name(name))
    except Exception as error:
        reason = " ".join(str(error).split())[:100]
        raise InputError(f"schema {name}: cannot be read ({reason}); record again") from error
    fields = {owner: members for owner, (_, members) in known.items()}
    return {**dict.fromkeys(TIME_TYPES, STAMP), **fields}


@dataclass
class Layout:
    """Places of the numbers of a message, and the bytes that messages of the same layout share."""

    numbers: dict[str, tuple[int, np.dtype[Any]]] = field(default_factory=dict)
    by_name: dict[str, str] = field(default_factory=dict)
    shared: dict[int, int] = field(default_factory=dict)

    def fits(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Which messages (messages, bytes) have this layout."""
        places = list(self.shared)
        values = np.array(list(self.shared.values()), np.uint8)
        return np.asarray((rows[:, places] == values).all(axis=1))

    def column(self, path: str, rows: NDArray[np.uint8]) -> NDArray[Any] | None:
        """A number of messages (messages, bytes), (messages,); None where they have none."""
        at = self.numbers.get(self.by_name.get(path, path))
        if at is None:
            return None
        place, kind = at
        stored = np.ascontiguousarray(rows[:, place : place + kind.itemsize]).view(kind)[:, 0]
        return stored.astype(kind.newbyteorder("="))

    @property
    def listed(self) -> list[str]:
        """Paths of its numbers; of those in a named array by their names."""
        named = {index: path for path, index in self.by_name.items()}
        return [named.get(path, path) for path in self.numbers]


class Walk:
    """A walk through one message, which notes where its numbers stand."""

    def __init__(self, name: str, text: str, data: bytes, is_ros1: bool) -> None:
        self.fields = fields_by_type(name, text)
        self.data = data
        self.is_ros1 = is_ros1
        self.begin = 0 if is_ros1 else ENCAPSULATION
        self.order = "<" if is_ros1 or data[1] else ">"
        self.at = self.begin
        self.layout = Layout()
        if not is_ros1:
            self.share(0, 2)
        self.message(full_name(name), "")
        padding = len(data) - self.at
        if not 0 <= padding <= (0 if is_ros1 else 7):
            raise InputError(f"a message of {len(data)} bytes is not what its schema describes")

    def message(self, name: str, prefix: str) -> None:
        """Walk through the fields of a message whose paths begin with a prefix."""
        names: dict[str, list[str]] = {}
        arrays: dict[str, int] = {}
        if not self.fields[name] and not self.is_ros1:
            self.at += 1  # CDR has one byte for a message without fields
        for member, (kind, inner) in self.fields[name]:
            path = prefix + member
            if kind in (BASE, NAME):
                self.single(kind, inner, path)
                continue
            (of, element), size = inner
            count = size if kind == ARRAY else self.length()
            if of == BASE and element[0] in NUMBERS:
                arrays[path] = count
                self.array(element[0], path, count)
            elif of == BASE:
                names[member] = [self.text(is_shared=count <= MOST_ELEMENTS) for _ in range(count)]
            else:
                for index in range(count):
                    self.single(of, element, f"{path}[{index}]")
        for member, texts in names.items():
            if len(set(texts)) < len(texts):
                continue
            for path, count in arrays.items():
                if count == len(texts):
                    for index, text in enumerate(texts):
                        self.layout.by_name[f"{path}[{member}={text}]"] = f"{path}[{index}]"

    def single(self, kind: int, inner: Any, path: str) -> None:
        if kind == NAME:
            self.message(inner, f"{path}.")
        elif inner[0] in NUMBERS:
            self.array(inner[0], path, 1, is_array=False)
        else:
            self.text()

    def array(self, name: str, path: str, count: int, is_array: bool = True) -> None:
        """Note numbers that stand behind one another."""
        kind = np.dtype(self.order + NUMBERS[name])
        if count and not self.is_ros1:
            self.at += (self.begin - self.at) % kind.itemsize
        for index in range(count if count <= MOST_ELEMENTS else 0):
            own = f"{path}[{index}]" if is_array else path
            self.layout.numbers[own] = (self.at + index * kind.itemsize, kind)
        self.at += count * kind.itemsize

    def length(self) -> int:
        """Read the length of a text or a sequence."""
        if not self.is_ros1:
            self.at += (self.begin - self.at) % 4
        if self.at + 4 > len(self.data):
            raise InputError(f"a message of {len(self.data)} bytes is too short for its schema")
        (count,) = struct.unpack_from(f"{self.order}I", self.data, self.at)
        self.share(self.at, self.at + 4)
        self.at += 4
        if count > len(self.data):
            raise InputError(
                f"a message of {len(self.data)} bytes is not what its schema describes"
            )
        return int(count)

    def text(self, is_shared: bool = False) -> str:
        size = self.length()
        text = self.data[self.at : self.at + size]
        if is_shared:
            self.share(self.at, self.at + size)
        self.at += size
        return text.rstrip(b"\0").decode(errors="replace")

    def share(self, begin: int, end: int) -> None:
        self.layout.shared |= dict(enumerate(self.data[begin:end], start=begin))


def layout_of(name: str, text: str, data: bytes, is_ros1: bool) -> Layout:
    """Walk through a message. Raises InputError: it is not what its definition says."""
    if not is_ros1 and not (len(data) >= ENCAPSULATION and data[0] == 0 and data[1] <= 1):
        raise InputError(f"encapsulation {data[:4].hex()} is not plain CDR; record as such")
    return Walk(name, text, data, is_ros1).layout
