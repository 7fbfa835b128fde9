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

from osl_analysis.errors import InputError, on_one_line
from osl_analysis.formats import _messages
from osl_analysis.formats._cdr import rows_at
from osl_analysis.memory import check_unpacked
from osl_analysis.recording import End, Format, Recording
from osl_analysis.source_file import MessageSource

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
MESSAGE_HEAD = MESSAGE.itemsize - RECORD.size  # bytes of the head within the content
PART_BYTES = 1 << 24  # in which messages are found at once


class Log(_messages.Log):
    """A log that is read: its topics, and what is lost."""

    def __init__(self, source: MessageSource | None) -> None:
        super().__init__(source)
        self.schemas: dict[int, Schema] = {}
        self.counts: Counter[str] = Counter()  # messages by topic, as the summary declares them
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
                f"a second log begins at byte {end + len(MAGIC)}; split the file there (`head -c`,"
                " `tail -c`), and give each part a trial of its own"
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
                self.counts[self.name_of.get(number, "")] += count

    def _take_records(self, data: bytes, position: int) -> int:
        """Read the records from a place on, as far as they go, and give where the last one ends."""
        places = [np.empty(0, int)]
        while position + RECORD.size <= len(data):
            opcode, length = RECORD.unpack_from(data, position)
            begin = position + RECORD.size
            end = begin + length
            is_short = opcode == Opcode.MESSAGE and length < MESSAGE_HEAD
            if opcode == 0 or end > len(data) or is_short:
                break
            content = ReadDataStream(BytesIO(data[begin:end]))
            match opcode:
                case Opcode.MESSAGE:
                    messages, end = _chain(data, position, end)
                    places.append(messages)
                case Opcode.SCHEMA:
                    schema = Schema.read(content)
                    self.schemas[schema.id] = schema
                case Opcode.CHANNEL:
                    self._declare_channel(Channel.read(content))
                case Opcode.CHUNK:
                    self._take_chunk(Chunk.read(content), end)
            position = end
        self._take_messages(data, np.concatenate(places))
        return position

    def _take_chunk(self, chunk: Chunk, end_of_chunk: int) -> None:
        """Read the records of a chunk that ends at a place; one that is damaged is lost."""
        self.unpacked += chunk.uncompressed_size
        check_unpacked(self.path, self.unpacked)
        try:
            content = _unpacked(chunk)
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
        messages = (content, places + MESSAGE.itemsize, lengths)
        self.add(heads["channel"], messages, heads["log_time"].astype(np.int64))

    def _declare_channel(self, channel: Channel) -> None:
        schema = self.schemas.get(channel.schema_id, _messages.NO_SCHEMA)
        self.declare(channel.id, channel.topic, channel.message_encoding, schema)


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


def _chain(data: bytes, position: int, end: int) -> tuple[NDArray[np.int64], int]:
    """Places of the messages that follow one another from a place on, and where the last one ends;
    at most `PART_BYTES`, or the first message, which ends at `end`.

    Any byte may look like the begin of a message. Those that are one lead from the first one to the
    next, found all at once.
    """
    content = data[position : max(position + PART_BYTES, end)]
    first_bytes = np.frombuffer(content, np.uint8)[: 1 - MESSAGE.itemsize]
    places = np.flatnonzero(first_bytes == Opcode.MESSAGE.value)
    lengths = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)["length"]
    ends = places + RECORD.size + np.minimum(lengths, len(content)).astype(int)
    may_be = (lengths >= MESSAGE_HEAD) & (ends <= len(content))
    places, ends = places[may_be], ends[may_be]

    follower = np.searchsorted(places, ends)
    follower[np.append(places, -1)[follower] != ends] = places.size  # none follows
    follower = np.append(follower, places.size)
    chain = np.zeros(1, int)
    while chain[-1] < places.size:  # twice as many each time
        chain = np.append(chain, follower[chain])
        follower = follower[follower]
    chain = chain[chain < places.size]
    return position + places[chain], position + int(ends[chain[-1]])


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read an MCAP file."""
    log = Log(source)
    log.take_file(path)
    is_whole = log.end == End.WHOLE and not log.chunks_lost
    log.expected = log.counts or (log.read if is_whole else Counter())
    return log.recording("mcap")


FORMAT = Format(
    name="mcap",
    suffixes=(".mcap",),
    begins=methodcaller("startswith", MAGIC),
    source=MessageSource,
    read=read,
)
