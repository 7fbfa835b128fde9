# SPDX-License-Identifier: Apache-2.0
"""Where the numbers of a ROS message stand, by its definition.

The numbers stand at the same places in all messages of one layout: of one length, and with the same
bytes where texts and sequences tell their lengths. One message of a layout is walked. The numbers
of all others are a view of their bytes, which is a thousand times as fast.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from osl_analysis.base.errors import InputError

# types that are uint8 (design.ros2.org/articles/legacy_interface_definition.html); NumPy calls all
# others as ROS does
UNSIGNED_BYTES = ("byte", "char", "octet")
BUILT_IN = get_typestore(Stores.EMPTY).fielddefs  # stamps and durations
MOST_ELEMENTS = 64  # of an array that are read: longer ones are images, and no signals
MOST_LETTERS = 200_000  # of a definition, whose reading takes a second then; usual are 5,000
ENCAPSULATION = 4  # bytes before a CDR message; the second one tells the byte order
MOST_PADDING = 3  # bytes behind a message, which DDS fills up to 4 (RTPS 2.5, 9.4.1)
OTHER_ELEMENT = re.compile(r"\[[1-9]\d*\]")  # of an array; its first one is listed alone
NEW_RECORDING = "record again with the definitions that its publisher was built with"

Fields = Sequence[tuple[str, Any]]  # name and type of each field, as rosbags describes them


def full_name(name: str) -> str:
    """Write `package/Name` as `package/msg/Name`."""
    package, *_, last = name.split("/")
    return f"{package}/msg/{last}"


@lru_cache
def definition_of(name: str, data: bytes) -> Mapping[str, Fields]:
    """Parse a definition in ros2msg or ros1msg, followed by those of the types in it: the fields of
    each type, by its full name. Raises the library's error."""
    if len(data) > MOST_LETTERS:
        raise InputError(f"schema {name} has {len(data)} letters", NEW_RECORDING)
    text = data.decode(errors="replace").replace("\r", "")
    types = {**BUILT_IN, **get_types_from_msg(text, full_name(name))}
    return {owner: fields for owner, (_, fields) in types.items()}


def rows_at(content: bytes, starts: NDArray[np.int64], length: int) -> NDArray[np.void]:
    """Copy the bytes of messages of one length, (messages,), that need not be aligned."""
    kind = np.dtype(f"V{length}")
    everywhere = np.ndarray((max(0, len(content) - length + 1),), kind, content, 0, (1,))
    return everywhere[starts]


class Layout:
    """Where the numbers of a message stand, and how to tell messages of the same layout.

    Parameters
    ----------
    name, definition
        Name of the type of the message, and its definition.
    data
        The message, which is walked.
    is_ros1
        Whether it is serialised as by ROS 1: little-endian, without encapsulation, alignment and
        the zero at the end of texts. Else it is CDR.

    Attributes
    ----------
    numbers
        Type and place [bytes] of each number, by path.
    listed
        Paths of the numbers in their order; of an array its named elements, or else its first one.
    names
        The texts that name elements of arrays. They differ between publishers.

    Raises
    ------
    InputError
        The message is not what its definition says.
    """

    def __init__(self, name: str, definition: bytes, data: bytes, is_ros1: bool = False) -> None:
        if not is_ros1 and not data.startswith((b"\0\0", b"\0\1")):
            raise InputError(
                f"encapsulation {data[:4].hex()} is not plain CDR",
                "record with the default encoding and without compression of messages",
            )
        self.definition = definition_of(name, definition)
        self.data = data
        self.is_ros1 = is_ros1
        self.begin = 0 if is_ros1 else ENCAPSULATION
        self.position = self.begin
        self.byte_order: Literal["little", "big"] = "little" if is_ros1 or data[1] else "big"
        self.numbers: dict[str, tuple[np.dtype[Any], int]] = {}
        self.names = ""
        self.is_shared = np.zeros(len(data), bool)  # bytes that all messages of the layout share
        self.is_shared[: self.begin // 2] = True  # the mark of plain CDR
        self._walk_message(full_name(name), "")
        more = len(data) - self.position
        if more > (0 if is_ros1 else MOST_PADDING):
            raise InputError(
                f"a message of {len(data)} bytes has {more} more than its schema describes",
                NEW_RECORDING,
            )
        last_at = {place: path for path, (_, place) in self.numbers.items()}  # names come last
        in_order = [last_at[place] for place in sorted(last_at)]
        self.listed = [path for path in in_order if not OTHER_ELEMENT.search(path)]

    def fits(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Tell which messages of this length, shape (messages,), have this layout."""
        content = rows.view(np.uint8).reshape(rows.size, -1)[:, self.is_shared]
        return (content == np.frombuffer(self.data, np.uint8)[self.is_shared]).all(axis=1)

    def columns(
        self, rows: NDArray[np.void], paths: Collection[str] | None
    ) -> dict[str, NDArray[Any]]:
        """Numbers of messages of this layout, (messages,) each, by path; a path that they lack is
        left out. None stands for all that are listed."""
        columns = {}
        for path in self.listed if paths is None else paths:
            if path in self.numbers:
                kind, place = self.numbers[path]
                values = np.ndarray(rows.shape, kind, rows, place, rows.strides)
                columns[path] = values.astype(kind.newbyteorder("="))
        return columns

    def _walk_message(self, type_name: str, prefix: str) -> None:
        """Walk through the fields of a message whose paths begin with a prefix."""
        if type_name not in self.definition:
            raise InputError(f"type '{type_name}' is not defined", NEW_RECORDING)
        fields = self.definition[type_name]
        if not fields and not self.is_ros1:
            self._take(1)  # a message without fields has a byte in CDR
        counts = {}  # of arrays of numbers, by path
        texts_of = {}  # by field, with where they stand
        for name, (kind, inner) in fields:
            path = f"{prefix}{name}"
            is_array = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
            (element, what), count = inner if is_array else ((kind, inner), 1)
            if kind == Nodetype.SEQUENCE:
                count = self._take_length()
            begin = self.position
            if element == Nodetype.NAME:
                for index in range(count):
                    self._walk_message(what, f"{path}[{index}]." if is_array else f"{path}.")
            elif what[0] == "string":
                texts = [self._take_text() for _ in range(count)]
                if is_array:
                    texts_of[name] = (texts, slice(begin, self.position))
            else:
                self._take_numbers(path, what[0], count, is_array)
                if is_array:
                    counts[path] = count
        for name, (texts, stretch) in texts_of.items():
            named = [path for path, count in counts.items() if count == len(texts)]
            if named and all(texts) and len(set(texts)) == len(texts) > 0:
                self.names += f", {prefix}{name} [{', '.join(texts)}]"
                self.is_shared[stretch] = True  # another message may have them in another order
                for path in named:
                    for index, text in enumerate(texts[:MOST_ELEMENTS]):
                        number = self.numbers[f"{path}[{index}]"]
                        self.numbers[f"{path}[{name}={text}]"] = number

    def _take_numbers(self, path: str, kind: str, count: int, is_array: bool) -> None:
        """Note where numbers stand one after the other."""
        number = np.dtype("uint8" if kind in UNSIGNED_BYTES else kind)
        size = number.itemsize
        begin = self._take(count * size, size if count else 1)
        for index in range(min(count, MOST_ELEMENTS)):
            element = f"{path}[{index}]" if is_array else path
            self.numbers[element] = (number.newbyteorder(self.byte_order), begin + index * size)

    def _take_text(self) -> str:
        size = self._take_length()
        begin = self._take(size)
        return self.data[begin : begin + size].rstrip(b"\0").decode(errors="replace")

    def _take_length(self) -> int:
        """Take the length of a text or a sequence; all messages of the layout share it."""
        begin = self._take(4, 4)
        self.is_shared[begin : begin + 4] = True
        return int.from_bytes(self.data[begin : begin + 4], self.byte_order)

    def _take(self, size: int, multiple: int = 1) -> int:
        """Go on by some bytes, in CDR from a multiple of others, and give where they begin."""
        begin = self.position
        if not self.is_ros1:
            begin += (self.begin - begin) % multiple
        self.position = begin + size
        if self.position > len(self.data):
            raise InputError(
                f"a message of {len(self.data)} bytes is too short for its schema", NEW_RECORDING
            )
        return begin
