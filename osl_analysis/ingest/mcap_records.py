"""MCAP files down to the bytes of their messages, per channel and per length, with every checksum checked.

The records are scanned from the front and the summary is never needed, so that a file without one takes the
same path.
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Schema, Statistics
from mcap.stream_reader import get_chunk_data_stream

from osl_analysis.errors import InputError
from osl_analysis.ingest.cdr import Bytes, Indices

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])

COMPRESSIONS = ("", "zstd", "lz4")  # the library passes chunks of any other compression on as they are

Record = TypeVar("Record", Channel, Chunk, DataEnd, Schema, Statistics)


@dataclass(frozen=True)
class Batch:
    """Messages of one channel and one length: log times [ns], shape (n,), and bytes, shape (n, length)."""

    log_time: Indices
    rows: Bytes


@dataclass
class McapFile:
    """Channels and schemas of a file, and the messages of the topics that were asked for, by channel id.

    `messages` counts those of all topics, `unverified` those that no checksum covers.
    """

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    batches: dict[int, list[Batch]] = field(default_factory=lambda: defaultdict(list))
    messages: int = 0
    unverified: int = 0


def read_mcap(path: Path, topics: Collection[str]) -> McapFile:
    """Every message of the given topics.

    Raises
    ------
    InputError
        No MCAP file, an incomplete or damaged one, or one with an unknown compression.
    """
    data = path.read_bytes()
    if data[:8] != MAGIC:
        raise InputError(
            f"{path}: not an MCAP file (it begins with {data[:8]!r}); check the path and the source's format"
        )
    file = McapFile()
    try:
        scan_file(data, file, topics)
    except (ValueError, OverflowError, RuntimeError, struct.error, McapError, zstandard.ZstdError) as error:
        raise InputError(
            f"{path}: damaged or incomplete MCAP: {error}; record again, or try `mcap recover` and check what is left"
        ) from error
    return file


def scan_file(data: bytes, file: McapFile, topics: Collection[str]) -> None:
    """Fill `file` from the data section of the whole file's bytes, and check it against what follows it."""
    finished = False
    for opcode, start, end in records(data, add_records(data, len(MAGIC), file, topics)):
        finished |= opcode == Opcode.FOOTER
        if opcode == Opcode.DATA_END:
            check_data(data, start, end, file)
        elif opcode == Opcode.CHANNEL:  # a channel without messages stands in the summary only
            channel = parsed(Channel, data, start, end)
            file.channels.setdefault(channel.id, channel)
        elif opcode == Opcode.STATISTICS:
            declared = parsed(Statistics, data, start, end).message_count
            if declared != file.messages:
                raise InputError(f"it declares {declared} messages and holds {file.messages}")
    if not finished:
        raise InputError("the file has no footer: the recorder did not finish")


def add_records(buffer: bytes, begin: int, file: McapFile, topics: Collection[str]) -> int:
    """Add what the records of a buffer hold, chunks included; return the position at which the data end."""
    starts, lengths, end = [], [], begin
    for opcode, start, end in records(buffer, begin):
        if opcode == Opcode.MESSAGE:
            starts.append(start)
            lengths.append(end - start)
        elif opcode == Opcode.SCHEMA:
            schema = parsed(Schema, buffer, start, end)
            file.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parsed(Channel, buffer, start, end)
            file.channels[channel.id] = channel
        elif opcode == Opcode.CHUNK:
            add_chunk(parsed(Chunk, buffer, start, end), start, file, topics)
        elif opcode == Opcode.DATA_END:
            end = start - RECORD.size
            break
    if starts:
        add_messages(buffer, np.array(starts), np.array(lengths), file, topics)
    return end


def add_chunk(chunk: Chunk, start: int, file: McapFile, topics: Collection[str]) -> None:
    """Add what a chunk holds, decompressed and checked against its checksum (0 means that there is none)."""
    if chunk.compression not in COMPRESSIONS:
        raise InputError(f"the chunk at byte {start} is compressed with '{chunk.compression}'; zstd and lz4 are read")
    stream, size = get_chunk_data_stream(chunk)
    content = stream.read(size)
    if size != chunk.uncompressed_size:
        raise InputError(f"the chunk at byte {start} holds {size} of {chunk.uncompressed_size} bytes")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise InputError(f"the checksum of the chunk at byte {start} does not match")
    unverified = file.unverified
    add_records(content, 0, file, topics)
    if chunk.uncompressed_crc:
        file.unverified = unverified


def check_data(data: bytes, start: int, end: int, file: McapFile) -> None:
    """Check all data before the record that ends them against its checksum (0 means that there is none)."""
    expected = parsed(DataEnd, data, start, end).data_section_crc
    if expected:
        if zlib.crc32(memoryview(data)[: start - RECORD.size]) != expected:
            raise InputError("the checksum of the data section does not match")
        file.unverified = 0


def records(buffer: bytes, begin: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the content of each record; the file's closing magic ends the walk."""
    position, total = begin, len(buffer)
    while position + RECORD.size <= total:
        opcode, length = RECORD.unpack_from(buffer, position)
        start = position + RECORD.size
        position = start + length
        if position > total:
            raise InputError(f"the record at byte {start} is {length} bytes long, {total - start} are there")
        yield opcode, start, position
    if buffer[position:] not in (b"", MAGIC):
        raise InputError(f"{total - position} bytes after the last record are no record")


def parsed(kind: type[Record], buffer: bytes, start: int, end: int) -> Record:
    """One record, by the mcap library."""
    record: Record = kind.read(ReadDataStream(BytesIO(buffer[start:end])))
    return record


def add_messages(buffer: bytes, starts: Indices, lengths: Indices, file: McapFile, topics: Collection[str]) -> None:
    """Sort the messages of one buffer by channel and length, and copy out those of the topics."""
    if (lengths < MESSAGE.itemsize).any():
        raise InputError("a message record is shorter than its own head")
    file.messages += starts.size
    file.unverified += starts.size
    heads = gather(buffer, starts, MESSAGE.itemsize).view(MESSAGE)[:, 0]
    for number in np.unique(heads["channel"]).tolist():
        if number not in file.channels:
            raise InputError(f"a message belongs to channel {number}, which is not declared")
        if file.channels[number].topic not in topics:
            continue
        mine = heads["channel"] == number
        for length in np.unique(lengths[mine]).tolist():
            chosen = mine & (lengths == length)
            rows = gather(buffer, starts[chosen] + MESSAGE.itemsize, length - MESSAGE.itemsize)
            file.batches[number].append(Batch(heads["log_time"][chosen].astype(np.int64), rows))


def gather(buffer: bytes, starts: Indices, length: int) -> Bytes:
    """The `length` bytes from each start, shape (starts, length), through one overlapping view of the buffer."""
    if length == 0:
        return np.empty((starts.size, 0), np.uint8)
    windows = np.ndarray((len(buffer) - length + 1,), f"V{length}", buffer, 0, (1,))
    return windows[starts].view(np.uint8).reshape(starts.size, length)
