"""One chunk of an MCAP file: unpacked within limits, checked against its checksum, and split into messages."""

import struct
import zlib
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from mmap import mmap

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from osl_analysis.formats.mcap.limits import HIGHEST_RATIO, Budget
from osl_analysis.formats.mcap.walk import (
    CHUNK_HEAD,
    COMPRESSIONS,
    MESSAGE,
    Buffer,
    RecordWalk,
    body_of,
    index_offsets,
    indexed_messages,
    message_heads,
    walk_by_index,
    walk_records,
)
from osl_analysis.formats.messages.leaves import Indices

FRAME_HEADER = 1 << 16  # bytes by which a frame that holds next to nothing may be larger than what its ratio allows


class DamagedChunkError(Exception):
    """The chunk cannot be read, or does not hold what was written. The message completes the sentence "it ..."."""


@dataclass(frozen=True)
class MessageBlock:
    """The messages of one chunk, or of one stretch of a file without chunks, (n,) each."""

    buffer: bytes | mmap
    """The bytes that hold the messages."""
    channel: NDArray[np.uint16]
    """Number of each message's channel."""
    sequence: NDArray[np.uint32]
    """Number that the recorder or the publisher gave to each message; often 0."""
    log_time: Indices
    """When each message was logged [ns]."""
    starts: Indices
    """Where each payload begins in the buffer [bytes]."""
    lengths: Indices
    """Length of each payload [bytes]."""
    others: list[tuple[int, int, int]] = field(default_factory=list)
    """Opcode, start and end of the schemas and channels among the messages."""

    @cached_property
    def counts(self) -> Counter[int]:
        """Messages of each channel that has any, in the order of their numbers."""
        counts = np.bincount(self.channel)
        return Counter({number: int(counts[number]) for number in np.flatnonzero(counts).tolist()})

    def of_channel(self, number: int) -> "MessageBlock":
        """The messages of one channel."""
        return self if len(self.counts) == 1 else self.of(np.flatnonzero(self.channel == number))

    def of(self, rows: NDArray[np.intp]) -> "MessageBlock":
        """Some of the messages, by their indices."""
        channel, sequence, log_time = self.channel.take(rows), self.sequence.take(rows), self.log_time.take(rows)
        return MessageBlock(
            self.buffer, channel, sequence, log_time, self.starts.take(rows), self.lengths.take(rows), self.others
        )


@dataclass(frozen=True)
class ReadChunk:
    """A chunk that was read."""

    block: MessageBlock
    """Its messages."""
    verified: bool = False
    """A checksum covers them."""
    index_is_right: bool = True
    """Its message index, if it has one, lists these messages and no others."""
    lost: Counter[int] = field(default_factory=Counter)
    """Messages of each channel that the index lists and that are records of an unknown opcode instead."""


def block_of(buffer: Buffer, walk: RecordWalk) -> MessageBlock:
    """The messages that a walk through the buffer found."""
    heads = message_heads(buffer, walk.messages) if walk.heads is None else walk.heads
    lengths = heads["length"].astype(np.int64) - (MESSAGE.itemsize - 9)
    channel, sequence = heads["channel"].astype(np.uint16), heads["sequence"].astype(np.uint32)
    log_time = heads["log_time"].astype(np.int64)
    return MessageBlock(buffer, channel, sequence, log_time, walk.messages + MESSAGE.itemsize, lengths, walk.others)


def read_chunk(data: Buffer, start: int, indexes: list[tuple[int, int]], budget: Budget) -> ReadChunk:
    """The messages of the chunk whose record's content begins at `start`; `indexes` are its message index records.

    Raises
    ------
    DamagedChunkError
        Unknown compression, another size than declared, a wrong checksum, or bytes that are not records.
    InputError
        It would unpack to more than is allowed.
    """
    crc = CHUNK_HEAD.unpack_from(data, start)[3]
    content = unpacked(data, start, budget)
    if crc and zlib.crc32(content) != crc:
        raise DamagedChunkError("does not match its checksum")
    offsets = index_offsets(data, indexes)
    walk = walk_by_index(content, offsets)
    if walk is not None:
        budget.take_records(start, walk.messages.size + len(walk.others))
        return ReadChunk(block_of(content, walk), crc != 0)
    walk = walk_records(content, 0, len(content), budget.left_records() + 1, in_chunk=True)
    budget.take_records(start, walk.messages.size + len(walk.others) + walk.unknown)
    if walk.end != len(content):
        raise DamagedChunkError(f"holds no record at byte {walk.end} of its {len(content)} bytes")
    block = block_of(content, walk)
    right = not indexes or np.array_equal(np.sort(offsets), walk.messages)
    lost = Counter[int]()
    if not crc and walk.unknown and not right:  # without a checksum a flipped opcode passes for a private one
        lost = indexed_messages(data, indexes) - block.counts
    return ReadChunk(block, crc != 0, bool(right), lost)


def check_budget(data: Buffer, starts: Iterable[int], budget: Budget) -> None:
    """Count the chunks whose records' contents begin at `starts`, before any of them is unpacked.

    Raises
    ------
    InputError
        They would unpack to more than is allowed.
    """
    for start in starts:
        with suppress(DamagedChunkError):  # it is never unpacked
            packed_chunk(data, start, budget)


def packed_chunk(data: Buffer, start: int, budget: Budget) -> tuple[bytes, memoryview, int]:
    """Compression, content as it is stored, and declared size of a chunk, counted in the budget."""
    _, _, size, _, length = CHUNK_HEAD.unpack_from(data, start)
    name = data[start + CHUNK_HEAD.size : start + CHUNK_HEAD.size + length]
    begin, end = body_of(data, start)
    body = memoryview(data)[begin:end]
    if name:
        check_declared(name, body, size)
        budget.take_chunk(start, len(body), size)
    return name, body, size


def unpacked(data: Buffer, start: int, budget: Budget) -> bytes:
    """The content of a chunk, which must be of the declared size."""
    name, body, size = packed_chunk(data, start, budget)
    try:
        content = decompressed(name, body, size)
    except (zstandard.ZstdError, RuntimeError, EOFError, struct.error, MemoryError) as error:
        raise DamagedChunkError(f"cannot be decompressed ({' '.join(str(error).split())})") from error
    if len(content) != size:
        raise DamagedChunkError(f"holds {len(content)} of {size} bytes")
    return content


def check_declared(name: bytes, body: memoryview, size: int) -> None:
    """Refuse a chunk whose declared size cannot be right, so that it counts as damaged and not as too large."""
    if name not in COMPRESSIONS:
        raise DamagedChunkError(f"says it is compressed with {name[:20].decode('latin1')!a}; zstd and lz4 are read")
    if size > HIGHEST_RATIO[name] * len(body) + FRAME_HEADER:
        raise DamagedChunkError(f"declares {size} bytes, which {len(body)} bytes of {name.decode()} cannot hold")
    if name == b"zstd" and body:
        try:
            declared = zstandard.get_frame_parameters(body).content_size
        except zstandard.ZstdError as error:
            raise DamagedChunkError(f"cannot be decompressed ({' '.join(str(error).split())})") from error
        if declared not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise DamagedChunkError(f"holds {declared} of {size} bytes")


def decompressed(name: bytes, body: memoryview, size: int) -> bytes:
    """Decompress to at most one byte more than the declared size, independent of what the stream declares."""
    if name == b"":
        return bytes(body)
    if name == b"zstd":
        return zstandard.ZstdDecompressor().decompress(body, max_output_size=size) if size else b""
    content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(body, max_length=size + 1)
    return content
