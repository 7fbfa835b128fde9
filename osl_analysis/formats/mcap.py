# SPDX-License-Identifier: Apache-2.0
"""MCAP (https://mcap.dev/spec), also what an interrupted recorder left.

The records are walked from the front, so that a log without its end is read as far as it goes. A
chunk that does not match its checksum is lost, and counted by the summary. The library `mcap`
decodes the records; it would take 15 times as long for the messages.
"""

import struct
import zlib
from collections import Counter
from contextlib import suppress
from io import BytesIO
from operator import methodcaller
from pathlib import Path

import numpy as np
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from numpy.typing import NDArray
from zstandard import ZstdDecompressor

from osl_analysis.base.errors import InputError, on_one_line
from osl_analysis.base.memory import check_unpacked
from osl_analysis.base.recording import End, Format, Recording
from osl_analysis.base.source_file import MessageSource
from osl_analysis.formats.message_layout import rows_at
from osl_analysis.formats.topic import NO_SCHEMA
from osl_analysis.formats.topic_log import TopicLog

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content [bytes]
MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
MESSAGES = Opcode.MESSAGE.value  # a plain number: a log has a million of them
MESSAGE_HEAD = MESSAGE.itemsize - RECORD.size  # bytes of the head within the content


class McapLog(TopicLog):
    """Files of MCAP that are read one after the other."""

    def __init__(self, source: MessageSource | None) -> None:
        super().__init__(source)
        self.schemas: dict[int, Schema] = {}
        self.path = Path()  # of the file that is read
        self.unpacked = 0  # bytes of its chunks

    def take_file(self, path: Path) -> None:
        """Read the records of a file from the front, as far as they go."""
        from mcap.reader import SeekingReader  # takes 0.1 s, which no plan of a run needs

        data = path.read_bytes()
        self.path = path
        self.unpacked = 0
        summary = None
        with suppress(Exception):  # whatever the library meets in a file that is cut off
            summary = SeekingReader(BytesIO(data)).get_summary()
        if summary is not None:  # the chunk that declares a channel may be damaged
            self.schemas |= summary.schemas
            for declared in summary.channels.values():
                self._declare_channel(declared)
        end = self._take_records(data, len(MAGIC))
        if data.startswith(2 * MAGIC, end):
            raise InputError(
                f"a second log begins at byte {end + len(MAGIC)}",
                "split the file there (`head -c`, `tail -c`), and give each part a trial of its"
                " own",
            )
        if end + len(MAGIC) != len(data):
            self.remarks.append(
                f"{path.name} cannot be read behind byte {end}: the recorder did not finish,"
                " or its end is lost"
            )
            if summary is None:
                self.end = End.MISSING
        if summary is not None and summary.statistics is not None:
            for number, count in summary.statistics.channel_message_counts.items():
                name = self.topic_of[number].name if number in self.topic_of else ""
                self.declared[name] += count

    def _take_records(self, data: bytes, position: int) -> int:
        """Read the records from a place on, as far as they go, and give where the last one ends."""
        places = []
        end_of_heads = len(data) - RECORD.size
        while position <= end_of_heads:
            opcode, length = RECORD.unpack_from(data, position)
            begin = position + RECORD.size
            end = begin + length
            if opcode == 0 or end > len(data) or (opcode == MESSAGES and length < MESSAGE_HEAD):
                break
            if opcode == MESSAGES:
                places.append(position)
            else:
                self._take_record(opcode, data[begin:end], end)
            position = end
        self._take_messages(data, np.array(places, np.int64))
        return position

    def _take_record(self, opcode: int, data: bytes, end: int) -> None:
        """Take in a record that is no message, and ends at a place."""
        content = ReadDataStream(BytesIO(data))
        match opcode:
            case Opcode.SCHEMA:
                schema = Schema.read(content)
                self.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                self._declare_channel(Channel.read(content))
            case Opcode.CHUNK:
                self._take_chunk(Chunk.read(content), end)

    def _take_chunk(self, chunk: Chunk, end_of_chunk: int) -> None:
        """Read the records of a chunk that ends at a place; one that is damaged is lost."""
        self.unpacked += chunk.uncompressed_size
        check_unpacked(self.path, self.unpacked)
        try:
            content = _unpacked(chunk)
            places = _messages_alike(content)
            if places.size:
                self._take_messages(content, places)
                return
            end = self._take_records(content, 0)
            if end < len(content):
                raise ValueError(f"it holds no record at byte {end} of its {len(content)} bytes")
        except Exception as error:  # whatever the library meets in a damaged chunk
            self.chunks_lost += 1
            reason = on_one_line(error) or type(error).__name__
            self.remarks.append(f"the chunk that ends at byte {end_of_chunk} is damaged: {reason}")

    def _take_messages(self, content: bytes, places: NDArray[np.int64]) -> None:
        """Give messages at places in some bytes to their topics."""
        heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
        lengths = heads["length"].astype(np.int64) - MESSAGE_HEAD
        log_times_ns = heads["log_time"].astype(np.int64)
        self.add_messages(
            (content, places + MESSAGE.itemsize, lengths), log_times_ns, heads["channel"]
        )

    def _declare_channel(self, channel: Channel) -> None:
        """Take in a channel of the recorder, whose messages are of a topic."""
        schema = self.schemas.get(channel.schema_id, NO_SCHEMA)
        self.declare_channel(channel.id, channel.topic, channel.message_encoding, schema)


def _messages_alike(content: bytes) -> NDArray[np.int64]:
    """Where the messages begin of a chunk that holds nothing but messages of one length, as of one
    topic; empty of another chunk. One by one they would take most of the time of reading."""
    if len(content) < RECORD.size:
        return np.arange(0)
    opcode, length = RECORD.unpack_from(content)
    size = RECORD.size + length
    if opcode != MESSAGES or length < MESSAGE_HEAD or len(content) % size:
        return np.arange(0)
    heads = np.frombuffer(content, f"V{RECORD.size}, V{length}")["f0"]
    is_alike = (heads == heads[0]).all()
    return np.arange(0, len(content) if is_alike else 0, size)


def _unpacked(chunk: Chunk) -> bytes:
    """The content of a chunk, of no more than the size that it states. Raises ValueError: it is of
    another size, or does not match its checksum."""
    most = chunk.uncompressed_size + 1
    content = chunk.data
    if chunk.compression == "zstd":
        content = ZstdDecompressor().stream_reader(content, read_across_frames=True).read(most)
    elif chunk.compression == "lz4":
        content = LZ4FrameDecompressor().decompress(content, max_length=most)
    elif chunk.compression:
        raise ValueError(f"its compression {chunk.compression} is not known")
    if len(content) != chunk.uncompressed_size:
        raise ValueError(f"it unpacks to other than its {chunk.uncompressed_size} bytes")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise ValueError("it does not match its checksum")
    return bytes(content)


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read an MCAP file."""
    log = McapLog(source)
    log.take_file(path)
    is_whole = log.end == End.WHOLE and not log.chunks_lost
    return log.recording("mcap", log.declared or (log.read if is_whole else Counter()))


FORMAT = Format(
    name="mcap",
    suffixes=(".mcap",),
    begins=methodcaller("startswith", MAGIC),
    source=MessageSource,
    read=read,
)
