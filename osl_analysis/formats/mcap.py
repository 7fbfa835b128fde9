"""MCAP (https://mcap.dev/spec), also what an interrupted recorder left.

The records are walked from the front, so that a log without its end is read as far as it goes. A
chunk that does not match its checksum is lost, and counted by the summary. The library `mcap`
decodes the records; it would take 15 times as long for the messages.
"""

import struct
from collections import Counter
from contextlib import suppress
from io import BytesIO
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats import _messages
from osl_analysis.formats._cdr import rows_at
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
MESSAGE_CODE = int(Opcode.MESSAGE)  # compared faster
MESSAGE_HEAD = MESSAGE.itemsize - RECORD.size  # bytes of the head within the content
INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length of the content, channel, size of the entries
INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("place", "<i8")])  # place in the chunk [bytes]


class Log(_messages.Log):
    """A log that is read: its topics, and what is lost."""

    def __init__(self, source: MessageSource | None) -> None:
        super().__init__(source)
        self.schemas: dict[int, Schema] = {}
        self.counts: Counter[str] = Counter()  # messages by topic, as the summary declares them
        self.checked = 0  # messages that a checksum covers

    def take_file(self, path: Path) -> None:
        """Read the records of a file from the front, as far as they go."""
        from mcap.reader import SeekingReader  # takes 0.1 s, which no plan of a run needs

        data = path.read_bytes()
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
        if self.checked:
            self.checksums = "checked" if self.checked == self.read.total() else "mixed"

    def _take_records(self, data: bytes, position: int, listed: Any = ()) -> int:
        """Read the records from a place on, as far as they go, and give where the last one ends.

        Parameters
        ----------
        listed
            Places of the messages up to the end, where they are known.
        """
        places: list[int] = []
        size = int(listed[0]) if len(listed) else len(data)
        while position + RECORD.size <= size:
            opcode, length = RECORD.unpack_from(data, position)
            begin = position + RECORD.size
            end = begin + length
            if opcode == 0 or end > size or (opcode == MESSAGE_CODE and length < MESSAGE_HEAD):
                break
            if opcode == MESSAGE_CODE:
                places.append(position)
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(data[begin:end]))
                self.schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                self._declare_channel(Channel.read(_stream(data[begin:end])))
            elif opcode == Opcode.CHUNK:
                self._take_chunk(Chunk.read(_stream(data[begin:end])), data, end)
            position = end
        self._take_messages(data, np.append(places, listed).astype(np.int64))
        return len(data) if position == size else position

    def _take_chunk(self, chunk: Chunk, data: bytes, end_of_chunk: int) -> None:
        """Read the records of a chunk that ends at a place; one that is damaged is lost."""
        from mcap.stream_reader import get_chunk_data_stream  # as above

        before = self.read.total()
        try:
            stream, _ = get_chunk_data_stream(chunk, validate_crc=True)
            content: bytes = stream.read(chunk.uncompressed_size)
            end = self._take_records(content, 0, _listed_places(data, end_of_chunk, content))
            if end < len(content):
                raise ValueError(f"it holds no record at byte {end} of its {len(content)} bytes")
        except Exception as error:  # whatever the library meets in a damaged chunk
            self.chunks_lost += 1
            reason = " ".join(str(error).split()) or type(error).__name__
            self.remarks.append(f"the chunk that ends at byte {end_of_chunk} is damaged: {reason}")
            return
        if chunk.uncompressed_crc:
            self.checked += self.read.total() - before

    def _take_messages(self, content: bytes, places: NDArray[np.int64]) -> None:
        """Give messages at places in some bytes to their topics."""
        heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
        lengths = heads["length"].astype(np.int64) - MESSAGE_HEAD
        messages = (content, places + MESSAGE.itemsize, lengths)
        self.add(heads["channel"].copy(), messages, heads["log_time"].astype(np.int64))

    def _declare_channel(self, channel: Channel) -> None:
        schema = self.schemas.get(channel.schema_id, _messages.NO_SCHEMA)
        self.declare(channel.id, channel.topic, channel.message_encoding, schema)


def _listed_places(data: bytes, position: int, content: bytes) -> Any:
    """Places of the messages in a chunk by the indexes behind it; none where these are damaged, or
    something else stands between the messages or behind them."""
    places: list[Any] = []
    with suppress(LookupError, ValueError, struct.error):
        while data[position] == Opcode.MESSAGE_INDEX:
            _, length, _, size = INDEX_HEAD.unpack_from(data, position)
            begin = position + INDEX_HEAD.size
            places.append(np.frombuffer(data[begin : begin + size], INDEX_ENTRY)["place"])
            position += RECORD.size + length
        listed = np.sort(np.concatenate(places))
        heads = rows_at(content, listed, MESSAGE.itemsize).view(MESSAGE)
        ends = listed + RECORD.size + heads["length"].astype(np.int64)
        follows = ends == np.append(listed[1:], len(content))
        if (follows & (heads["opcode"] == MESSAGE_CODE)).all():
            return listed
    return ()


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


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
