"""The records of MCAP, one after the other: their headers, and where the messages of a buffer stand."""

import struct
import zlib
from array import array
from collections import Counter
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
COMPRESSIONS = (b"zstd", b"lz4")
NUMBERED = range(Opcode.HEADER, Opcode.DATA_END + 1)
"""Opcodes that the format defines. Records of higher ones are private or of a later version, and are skipped."""
MOST_RECORDS = 1 << 18  # in one stretch outside of chunks, which bounds what is held at once

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
    unknown: int = 0
    """Records of opcodes that the format does not define, which were skipped."""


def walk_records(buffer: Buffer, begin: int, end: int, most: int, *, in_chunk: bool) -> RecordWalk:
    """Walk from record to record, up to `most` records or to the first bytes that are no such record.

    Schema, channel and message records are expected. In a chunk, records of opcodes that the format does not define are
    skipped; outside of one they end the walk.
    """
    messages, unknown, position = array("q"), 0, begin
    others: list[tuple[int, int, int]] = []
    unpack, last = RECORD.unpack_from, end - RECORD.size
    while position <= last and len(messages) + len(others) + unknown < most:
        opcode, length = unpack(buffer, position)
        stop = position + RECORD.size + length
        if stop > end:
            break
        if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD:
            messages.append(position)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and not is_disguised_chunk(buffer, position + RECORD.size, stop):
            others.append((opcode, position + RECORD.size, stop))
        elif in_chunk and opcode not in NUMBERED and opcode:
            unknown += 1
        else:
            break
        position = stop
    return RecordWalk(np.array(messages, np.int64), others, position, unknown=unknown)


def walk_by_index(buffer: Buffer, offsets: Indices) -> RecordWalk | None:
    """The same walk over the whole buffer, by the offsets of its messages that an index gives.

    None if the index is wrong: messages and the records between them must fill the buffer without a gap.
    """
    size = len(buffer)
    if offsets.size == 0 or offsets.min() < 0 or offsets.max() > size - MESSAGE.itemsize:
        return None
    starts = np.sort(offsets, kind="stable")  # fast, because the offsets of each channel rise
    heads = message_heads(buffer, starts)
    lengths = heads["length"].astype(np.int64)  # one that is too large for it becomes negative
    if (heads["opcode"] != Opcode.MESSAGE).any() or lengths.min() < MESSAGE_HEAD or lengths.max() > size:
        return None
    free, taken = np.zeros(len(starts) + 1, np.int64), np.full(len(starts) + 1, size, np.int64)
    free[1:], taken[:-1] = starts + RECORD.size, starts
    free[1:] += lengths
    if (free > taken).any():
        return None
    others: list[tuple[int, int, int]] = []
    unknown = 0
    for i in np.flatnonzero(free < taken).tolist():
        between = walk_records(buffer, int(free[i]), int(taken[i]), size, in_chunk=True)
        if between.end != taken[i] or between.messages.size:
            return None
        others += between.others
        unknown += between.unknown
    return RecordWalk(starts, others, size, heads, unknown)


def message_heads(buffer: Buffer, starts: Indices) -> NDArray[Any]:
    """Heads of the message records at `starts`, a structured array of shape (starts,)."""
    return byte_rows(buffer, starts, MESSAGE.itemsize).view(MESSAGE)[:, 0]


def is_chunk(data: Buffer, start: int, end: int) -> bool:
    """Whether the content of a record can be that of a chunk: what it declares fits in.

    A later version of the format may add fields at the end of a record (MCAP specification, "Records").
    """
    if end - start < CHUNK_HEAD.size + 8:
        return False
    name = CHUNK_HEAD.unpack_from(data, start)[4]
    body = start + CHUNK_HEAD.size + name + 8
    if name > LONGEST_NAME or body > end:
        return False
    return body_of(data, start)[1] <= end


def is_disguised_chunk(data: Buffer, start: int, end: int) -> bool:
    """Whether the content of a record of another opcode is that of a chunk: names and lengths leave no doubt."""
    if not is_chunk(data, start, end):
        return False
    _, _, size, _, length = CHUNK_HEAD.unpack_from(data, start)
    name = data[start + CHUNK_HEAD.size : start + CHUNK_HEAD.size + length]
    body, stop = body_of(data, start)
    return stop == end and (name in COMPRESSIONS or (name == b"" and size == stop - body > 0))


def body_of(data: Buffer, start: int) -> tuple[int, int]:
    """Start and end of the compressed records of a chunk whose content begins at `start`."""
    body = start + CHUNK_HEAD.size + CHUNK_HEAD.unpack_from(data, start)[4] + 8
    return body, body + struct.unpack_from("<Q", data, body - 8)[0]


def is_message_index(data: Buffer, start: int, end: int, *, exact: bool = False) -> bool:
    """Whether the content of a record can be a message index: the entries that it declares fit in.

    If `exact` is asked for, they must fill it.
    """
    if end - start < INDEX_HEAD.size:
        return False
    size, space = INDEX_HEAD.unpack_from(data, start)[1], end - start - INDEX_HEAD.size
    return bool(size % INDEX_ENTRY.itemsize == 0 and (size == space or (size < space and not exact)))


def index_entries(data: Buffer, start: int) -> tuple[int, NDArray[Any]]:
    """Channel, and log times and offsets of its messages, from a sound message index record."""
    channel, size = INDEX_HEAD.unpack_from(data, start)
    begin = start + INDEX_HEAD.size
    return channel, np.frombuffer(data[begin : begin + size], INDEX_ENTRY)


def index_offsets(data: Buffer, indexes: Sequence[tuple[int, int]]) -> Indices:
    """Offsets of a chunk's messages in its content, from its message index records, in their order."""
    entries = [index_entries(data, start)[1]["offset"].astype(np.int64) for start, _ in indexes]
    return np.concatenate([np.empty(0, np.int64), *entries])


def indexed_messages(data: Buffer, indexes: Sequence[tuple[int, int]]) -> Counter[int]:
    """How many messages of each channel a chunk's message index records list."""
    counts = Counter[int]()
    for start, _ in indexes:
        channel, entries = index_entries(data, start)
        counts[channel] += entries.size
    return counts


def crc_of(data: Buffer, start: int, end: int) -> int:
    """CRC-32 of a stretch, computed piece by piece because a slice of a mapped file is a copy."""
    crc = 0
    for position in range(start, end, 1 << 20):
        crc = zlib.crc32(data[position : min(position + (1 << 20), end)], crc)
    return crc
