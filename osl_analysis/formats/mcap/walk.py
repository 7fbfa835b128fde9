"""The records of MCAP, one after the other: their headers, and where the messages of a buffer stand."""

import struct
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from mmap import mmap
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from osl_analysis.formats.messages.leaves import Indices, byte_rows

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log_time", "<u8"), ("pub", "<u8")]
)
MESSAGE_HEAD = MESSAGE.itemsize - RECORD.size  # within the content
CHUNK_HEAD = struct.Struct("<QQQII")  # times of first and last message, size, checksum, length of the name
INDEX_HEAD = struct.Struct("<HI")  # channel, bytes of the entries
INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
LONGEST_NAME = 32
NUMBERED = range(Opcode.HEADER, Opcode.DATA_END + 1)
MOST_MESSAGES = 1 << 18  # in one stretch outside of chunks, which bounds what is held at once

Buffer = bytes | mmap


@dataclass
class RecordWalk:
    """Result of a walk through the records of a buffer."""

    messages: Indices
    """Where the message records begin [bytes]."""
    others: list[tuple[int, int, int]] = field(default_factory=list)
    """Opcode, start and end of the content of schema and channel records."""
    end: int = 0
    """End of the walk [bytes]: the end of the buffer, or the first bytes that are not a record."""
    heads: NDArray[Any] | None = None
    """Heads of the message records, where the walk read them all at once."""


def walk_records(buffer: Buffer, begin: int, end: int, most: int) -> RecordWalk:
    """Walk from record to record, up to `most` messages or to the first bytes that are no such record.

    Schema, channel and message records are expected.
    """
    messages, others, position = array("q"), [], begin
    unpack, last = RECORD.unpack_from, end - RECORD.size
    while position <= last and len(messages) < most:
        opcode, length = unpack(buffer, position)
        stop = position + RECORD.size + length
        if stop > end:
            break
        if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD:
            messages.append(position)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and not is_chunk(buffer, position + RECORD.size, stop):
            others.append((opcode, position + RECORD.size, stop))
        else:
            break
        position = stop
    return RecordWalk(np.array(messages, np.int64), others, position)


def walk_by_index(buffer: Buffer, offsets: Indices) -> RecordWalk | None:
    """The same walk over the whole buffer, by the offsets of its messages that an index gives.

    None if the index is wrong: messages and the records between them must fill the buffer without a gap.
    """
    size = len(buffer)
    if offsets.size == 0 or offsets.min() < 0 or offsets.max() > size - MESSAGE.itemsize:
        return None
    starts = np.sort(offsets)
    heads = message_heads(buffer, starts)
    if (heads["opcode"] != Opcode.MESSAGE).any() or (heads["length"] > size).any():
        return None
    if (heads["length"] < MESSAGE_HEAD).any():
        return None
    free = np.concatenate([[0], starts + RECORD.size + heads["length"].astype(np.int64)])
    taken = np.append(starts, size)
    if (free > taken).any():
        return None
    others: list[tuple[int, int, int]] = []
    for i in np.flatnonzero(free < taken).tolist():
        between = walk_records(buffer, int(free[i]), int(taken[i]), 1)
        if between.end != taken[i] or between.messages.size:
            return None
        others += between.others
    return RecordWalk(starts, others, size, heads)


def message_heads(buffer: Buffer, starts: Indices) -> NDArray[Any]:
    """Heads of the message records at `starts`, a structured array of shape (starts,)."""
    return byte_rows(buffer, starts, MESSAGE.itemsize).view(MESSAGE)[:, 0]


def is_chunk(data: Buffer, start: int, end: int) -> bool:
    """Whether the content of a record is that of a chunk, for any opcode: its two lengths agree."""
    if end - start < CHUNK_HEAD.size + 8:
        return False
    name = CHUNK_HEAD.unpack_from(data, start)[4]
    if name > LONGEST_NAME or end - start < CHUNK_HEAD.size + name + 8:
        return False
    body = start + CHUNK_HEAD.size + name + 8
    return bool(struct.unpack_from("<Q", data, body - 8)[0] == end - body)


def is_message_index(data: Buffer, start: int, end: int) -> bool:
    """Whether the content of a record is a message index: its length is that of the entries that it declares."""
    if end - start < INDEX_HEAD.size:
        return False
    size = INDEX_HEAD.unpack_from(data, start)[1]
    return bool(size == end - start - INDEX_HEAD.size and size % INDEX_ENTRY.itemsize == 0)


def index_offsets(data: Buffer, indexes: Sequence[tuple[int, int]]) -> Indices:
    """Offsets of a chunk's messages in its content, from its message index records, in their order."""
    entries = [
        np.frombuffer(data[start + INDEX_HEAD.size : end], INDEX_ENTRY)["offset"].astype(np.int64)
        for start, end in indexes
    ]
    return np.concatenate([np.empty(0, np.int64), *entries])
