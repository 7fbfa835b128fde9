"""MCAP files written byte by byte, for what no writer writes: legal rarities and two logs in one file."""

import struct
import zlib

import lz4.frame
import zstandard
from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
SCHEMA_TEXT = b"float64 a"


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def schema(number: int = 1, content: bytes = SCHEMA_TEXT, more: bytes = b"") -> bytes:
    body = struct.pack("<H", number) + text(b"lab_msgs/msg/S") + text(b"ros2msg") + text(content)
    return record(Opcode.SCHEMA, body + more)


def channel(number: int, topic: bytes, encoding: bytes = b"cdr", schema_id: int = 1, more: bytes = b"") -> bytes:
    body = struct.pack("<HH", number, schema_id) + text(topic) + text(encoding) + text(b"")
    return record(Opcode.CHANNEL, body + more)


def cdr(value: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", value)


def message(number: int, time: int, payload: bytes, sequence: int = 0, publish: int | None = None) -> bytes:
    head = struct.pack("<HIQQ", number, sequence, time, time if publish is None else publish)
    return record(Opcode.MESSAGE, head + payload)


def messages(number: int, values: range) -> list[bytes]:
    """One per millisecond, each with its own value."""
    return [message(number, i * 1_000_000, cdr(float(i)), i) for i in values]


PACK = {
    b"": lambda content: content,
    b"zstd": zstandard.ZstdCompressor().compress,
    b"lz4": lz4.frame.compress,
}


def chunk(content: bytes, compression: bytes = b"zstd", crc: bool = True, more: bytes = b"") -> bytes:
    packed = PACK[compression](content)
    head = struct.pack("<QQQI", 0, 1 << 62, len(content), zlib.crc32(content) if crc else 0)
    return record(Opcode.CHUNK, head + text(compression) + struct.pack("<Q", len(packed)) + packed + more)


def index(number: int, entries: list[tuple[int, int]], more: bytes = b"") -> bytes:
    packed = b"".join(struct.pack("<QQ", *entry) for entry in entries)
    return record(Opcode.MESSAGE_INDEX, struct.pack("<H", number) + text(packed) + more)


def statistics(counts: dict[int, int], chunks: int, more: bytes = b"", of_channels: bool = True) -> bytes:
    by_channel = b"".join(struct.pack("<HQ", *count) for count in counts.items()) if of_channels else b""
    head = struct.pack("<QHIIIIQQ", sum(counts.values()), 1, len(counts), 0, 0, chunks, 0, 0)
    return record(Opcode.STATISTICS, head + text(by_channel) + more)


def header(more: bytes = b"") -> bytes:
    return record(Opcode.HEADER, text(b"") + text(b"") + more)


def log(*parts: bytes, summary: bytes = b"", more: bytes = b"", shift: int = 0, crc: bool = True) -> bytes:
    """A whole file of these parts; the footer says that the summary begins `shift` bytes later than it does."""
    data = MAGIC + header(more) + b"".join(parts) + record(Opcode.DATA_END, bytes(4) + more)
    begin = len(data) + shift if summary else 0
    opening = struct.pack("<BQ", Opcode.FOOTER, 20 + len(more)) + struct.pack("<QQ", begin, 0)
    return data + summary + opening + struct.pack("<I", zlib.crc32(summary + opening) if crc else 0) + more + MAGIC
