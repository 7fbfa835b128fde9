"""One chunk of an MCAP file: unpacked within limits, checked against its checksum, and split into messages."""

import struct
import zlib
from dataclasses import dataclass
from mmap import mmap

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from osl_analysis.formats.mcap.walk import (
    CHUNK_HEAD,
    MESSAGE,
    Buffer,
    RecordWalk,
    index_offsets,
    message_heads,
    walk_by_index,
    walk_records,
)
from osl_analysis.formats.messages.leaves import Indices

LARGEST_CHUNK = 256 << 20
"""Bytes that a compressed chunk may declare. Recorders write 1 to 8 MB; a chunk that declares more than the limit is
damaged or malicious."""


class DamagedChunkError(Exception):
    """The chunk cannot be read, or does not hold what was written. The message completes the sentence "it ..."."""


@dataclass(frozen=True)
class MessageBlock:
    """The messages of one chunk, or of one stretch of a file without chunks, (n,) each."""

    buffer: bytes | mmap
    """The bytes that hold the messages."""
    channel: NDArray[np.uint16]
    """Number of each message's channel."""
    log_time: Indices
    """When each message was logged [ns]."""
    starts: Indices
    """Where each payload begins in the buffer [bytes]."""
    lengths: Indices
    """Length of each payload [bytes]."""
    others: list[tuple[int, int, int]]
    """Opcode, start and end of the schemas and channels among the messages."""


def block_of(buffer: Buffer, walk: RecordWalk) -> MessageBlock:
    """The messages that a walk through the buffer found."""
    heads = message_heads(buffer, walk.messages) if walk.heads is None else walk.heads
    lengths = heads["length"].astype(np.int64) - (MESSAGE.itemsize - 9)
    channel, log_time = heads["channel"].astype(np.uint16), heads["log_time"].astype(np.int64)
    return MessageBlock(buffer, channel, log_time, walk.messages + MESSAGE.itemsize, lengths, walk.others)


def read_chunk(data: Buffer, start: int, end: int, indexes: list[tuple[int, int]]) -> tuple[MessageBlock, bool, bool]:
    """The messages of a chunk, whether a checksum covers them, and whether the index is right.

    `start` and `end` are those of the chunk record's content in `data`, `indexes` those of its message index records.

    Raises
    ------
    DamagedChunkError
        Unknown compression, more bytes than are unpacked, a wrong checksum, or bytes that are not records.
    """
    _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(data, start)
    body = start + CHUNK_HEAD.size + name_length + 8
    content = unpacked(data[start + CHUNK_HEAD.size : body - 8], data[body:end], size)
    if crc and zlib.crc32(content) != crc:
        raise DamagedChunkError("does not match its checksum")
    offsets = index_offsets(data, indexes)
    walk = walk_by_index(content, offsets)
    indexed = walk is not None
    walk = walk or walk_records(content, 0, len(content), len(content))
    if walk.end != len(content):
        raise DamagedChunkError(f"holds no record at byte {walk.end} of its {len(content)} bytes")
    right = indexed or not indexes or np.array_equal(np.sort(offsets), walk.messages)
    return block_of(content, walk), crc != 0, right


def unpacked(name: bytes, body: bytes, size: int) -> bytes:
    """The chunk's content, which must be of the declared size."""
    if name and size > LARGEST_CHUNK:
        raise DamagedChunkError(f"declares {size} bytes, more than the {LARGEST_CHUNK} that are unpacked")
    try:
        content = decompressed(name, body, size)
    except (zstandard.ZstdError, RuntimeError, EOFError, struct.error, MemoryError) as error:
        raise DamagedChunkError(f"cannot be decompressed ({' '.join(str(error).split())})") from error
    if len(content) != size:
        raise DamagedChunkError(f"holds {len(content)} of {size} bytes")
    return content


def decompressed(name: bytes, body: bytes, size: int) -> bytes:
    """Decompress to at most one byte more than the declared size, independent of what the stream declares."""
    if name == b"":
        return body
    if name == b"zstd":
        declared = zstandard.get_frame_parameters(body).content_size if body else 0
        if declared not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise DamagedChunkError(f"holds {declared} of {size} bytes")
        return zstandard.ZstdDecompressor().decompress(body, max_output_size=size) if size else b""
    if name == b"lz4":
        content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(body, max_length=size + 1)
        return content
    raise DamagedChunkError(f"says it is compressed with {name[:20].decode('latin1')!a}; zstd and lz4 are read")
