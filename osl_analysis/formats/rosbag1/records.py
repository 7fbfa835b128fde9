"""Records of a ROS 1 bag: a header of named fields, and data."""

import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from mmap import mmap

import numpy as np

from osl_analysis.formats.messages.leaves import Bytes, Indices, byte_rows, distinct, value_at

Buffer = bytes | mmap
LENGTH = struct.Struct("<I")
MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
"""Kinds of records, by their field `op`."""
MOST_LAYOUTS = 20
"""Layouts of the headers of messages that are told apart; one recorder writes one."""
OWN_FIELDS = {b"op": 1, b"conn": 4, b"time": 8}
"""Fields of a message's header with their sizes [bytes]."""


@dataclass(frozen=True)
class Record:
    """One record."""

    fields: dict[bytes, bytes]
    """Its header."""
    start: int
    """Where its data begins [bytes]."""
    end: int
    """Where its data ends."""

    @property
    def op(self) -> int:
        """Its kind; -1 without one."""
        return self.number(b"op", 1, -1)

    def number(self, name: bytes, size: int = 4, default: int = 0) -> int:
        """An unsigned number in the header; `default` where there is none of this size."""
        value = self.fields.get(name, b"")
        return int.from_bytes(value, "little") if len(value) == size else default


def fields_in(data: Buffer, start: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Name, first byte and end of the value of every field; ends at the first that does not fit."""
    while start + LENGTH.size <= end:
        begin = start + LENGTH.size
        start = begin + LENGTH.unpack_from(data, start)[0]
        name, sign, _ = data[begin : min(start, begin + 64)].partition(b"=")
        if start > end or not sign:
            return
        yield name, begin + len(name) + 1, start


def named_fields(data: Buffer, start: int, end: int) -> dict[bytes, bytes]:
    """The fields between two bytes, by name."""
    return {name: data[first:stop] for name, first, stop in fields_in(data, start, end)}


def record_at(data: Buffer, position: int) -> Record | None:
    """The record at a position; None if no whole record with a kind begins there."""
    head = position + LENGTH.size
    if head > len(data):
        return None
    body = head + LENGTH.unpack_from(data, position)[0]
    if body + LENGTH.size > len(data):
        return None
    start = body + LENGTH.size
    end = start + LENGTH.unpack_from(data, body)[0]
    record = Record(named_fields(data, head, body), start, end)
    return record if end <= len(data) and record.op >= 0 else None


def is_cut_off(data: Buffer, position: int) -> bool:
    """Whether a record begins at a position and the file ends within it, as a killed recorder leaves it."""
    head = position + LENGTH.size
    if head > len(data):
        return True
    body = head + LENGTH.unpack_from(data, position)[0]
    if body + LENGTH.size > len(data):
        return any(name in (b"op", b"compression", b"conn") for name, _, _ in fields_in(data, head, len(data)))
    return b"op" in named_fields(data, head, body)


@dataclass
class ChunkWalk:
    """What the walk through an unpacked chunk found; arrays of shape (messages,)."""

    end: int
    """Where the walk ended [bytes]; the chunk is whole if that is its end."""
    connections: list[Record] = field(default_factory=list)
    """Connections that are declared in it."""
    unknown: int = 0
    """Records of another kind, or of a layout beyond the largest number."""
    connection: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    """Number of each message's connection."""
    time: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    """When each message was received [ns]."""
    starts: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    """Where each message begins [bytes]."""
    lengths: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    """Its length [bytes]."""


def walk_chunk(data: bytes, most: int) -> ChunkWalk:
    """Find the messages and connections in an unpacked chunk, in their order; it ends after `most` records."""
    heads, bodies, sizes = array("q"), array("q"), array("q")
    position, end, unpack = 0, len(data), LENGTH.unpack_from
    while position + 8 <= end and len(heads) < most:
        body = position + 4 + unpack(data, position)[0]
        if body + 4 > end:
            break
        size = unpack(data, body)[0]
        if body + 4 + size > end:
            break
        heads.append(position + 4)
        bodies.append(body)
        sizes.append(size)
        position = body + 4 + size
    head, body, size = (np.frombuffer(values, np.int64) for values in (heads, bodies, sizes))
    walk = ChunkWalk(position)
    is_message = np.zeros(head.size, bool)
    connection, time = np.zeros(head.size, np.int64), np.zeros(head.size, np.int64)
    for length in distinct(body - head):
        (mine,) = np.nonzero(body - head == length)
        for rows, numbers, stamps in messages_among(byte_rows(data, head[mine], length)):
            is_message[mine[rows]] = True
            connection[mine[rows]], time[mine[rows]] = numbers, stamps
    for row in np.flatnonzero(~is_message).tolist():
        record = record_at(data, heads[row] - LENGTH.size)
        if record is not None and record.op == CONNECTION:
            walk.connections.append(record)
        else:
            walk.unknown += 1
    walk.connection, walk.time = connection[is_message], time[is_message]
    walk.starts, walk.lengths = body[is_message] + LENGTH.size, size[is_message]
    return walk


def messages_among(headers: Bytes) -> Iterator[tuple[Indices, Indices, Indices]]:
    """The messages among records by their headers, (records, length): their places, connections and times [ns]."""
    left = np.arange(len(headers))
    for _ in range(MOST_LAYOUTS):
        if not left.size:
            return
        first = headers[left[0]].tobytes()
        places = {name: (start, stop - start) for name, start, stop in fields_in(first, 0, len(first))}
        own = {name: places[name][0] for name, size in OWN_FIELDS.items() if places.get(name, (0, 0))[1] == size}
        if len(own) < len(OWN_FIELDS) or first[own[b"op"]] != MESSAGE:
            left = left[1:]  # a connection, whose header is its own
            continue
        fixed = np.ones(len(first), bool)
        for name in (b"conn", b"time"):
            fixed[own[name] : own[name] + OWN_FIELDS[name]] = False
        rows = headers[left]
        alike = (rows[:, fixed] == rows[0, fixed]).all(axis=1)
        same = np.ascontiguousarray(rows[alike])
        word = np.dtype("<u4")
        seconds, rest = (value_at(same, own[b"time"] + at, word).astype(np.int64) for at in (0, 4))
        yield left[alike], value_at(same, own[b"conn"], word).astype(np.int64), seconds * 1_000_000_000 + rest
        left = left[~alike]
