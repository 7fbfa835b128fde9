"""MCAP (https://mcap.dev/spec), also what an interrupted recorder left.

The records are walked from the front, so that a log without its end is read as far as it goes. A
chunk that does not match its checksum is lost, and counted by the indexes behind it. The library
`mcap` decodes the records; it would take 30 times as long for the messages.
"""

import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Schema
from mcap.stream_reader import get_chunk_data_stream
from numpy.typing import NDArray

from osl_analysis.errors import InputError, quoted
from osl_analysis.formats import _messages
from osl_analysis.formats._cdr import rows_at
from osl_analysis.recording import End, Format, Recording
from osl_analysis.source_file import MessageSource

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content [bytes]
INDEX_HEAD = struct.Struct("<HI")  # channel, size of the entries [bytes]
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


class Log(_messages.Log):
    """A log that is read: its topics, and what is lost."""

    def __init__(self, source: MessageSource | None) -> None:
        super().__init__(source)
        self.schemas: dict[int, Schema] = {}
        self.counts: Counter[str] = Counter()  # messages by topic, as the summary declares them
        self.lost: Counter[str] = Counter()  # those of damaged chunks, as their indexes do
        self.checked = 0  # messages that a checksum covers

    def take_file(self, path: Path) -> None:
        """Read the records of a file from the front, as far as they go."""
        data = path.read_bytes()
        if not data.startswith(MAGIC):
            raise InputError(
                f"not an MCAP file (it begins with {quoted(data[:8])}); check the path and the"
                " source's format"
            )
        summary = None
        with suppress(Exception):  # whatever the library meets in a file that is cut off
            summary = SeekingReader(BytesIO(data)).get_summary()
        if summary is not None:  # the chunk that declares a channel may be damaged
            self.schemas |= summary.schemas
            for declared in summary.channels.values():
                self._declare_channel(declared)
        end = self._take_records(data)
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

    def _take_records(self, data: bytes) -> int:
        """Read the records in the order of the file, and give where the last of them ends."""
        chunk: Chunk | None = None
        indexes: dict[int, NDArray[np.int64]] = {}  # places in the chunk, by channel
        loose: list[int] = []  # places of messages outside of chunks
        end = 0
        for position, opcode, end in _records_in(data, len(MAGIC)):
            content = data[position + RECORD.size : end] if opcode != Opcode.MESSAGE else b""
            if opcode == Opcode.MESSAGE_INDEX:
                channel, size = INDEX_HEAD.unpack_from(content)
                entries = np.frombuffer(content, "<i8", size // 8, INDEX_HEAD.size)
                indexes[channel] = entries[1::2]  # behind their log times
                continue
            self._take_chunk(chunk, indexes)
            chunk = Chunk.read(_stream(content)) if opcode == Opcode.CHUNK else None
            indexes = {}
            if opcode == Opcode.MESSAGE:
                loose.append(position)
            else:
                self._declare(opcode, content)
        self._take_chunk(chunk, indexes)
        self._take_messages(data, np.array(loose, np.int64))
        return end

    def _take_chunk(self, chunk: Chunk | None, indexes: Mapping[int, NDArray[np.int64]]) -> None:
        """Read the messages of a chunk, now that its indexes are known."""
        if chunk is None:
            return
        try:
            stream, _ = get_chunk_data_stream(chunk, validate_crc=True)
            content: bytes = stream.read(chunk.uncompressed_size)
            places = self._places_in(content, [*indexes.values()])
        except Exception as error:  # whatever the library meets in a damaged chunk
            self.chunks_lost += 1
            for channel, listed in indexes.items():
                self.lost[self.name_of.get(channel, "")] += listed.size
            reason = " ".join(str(error).split()) or type(error).__name__
            self.remarks.append(f"chunk {self.chunks + self.chunks_lost} is damaged: {reason}")
            return
        self.chunks += 1
        if chunk.uncompressed_crc:
            self.checked += places.size
        self._take_messages(content, places)

    def _places_in(self, content: bytes, indexed: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
        """Places of the messages in a chunk [bytes]; takes in what else it declares."""
        listed = np.sort(np.concatenate([np.zeros(0, np.int64), *indexed]))
        walked: list[int] = []
        end = 0
        for position, opcode, end in _records_in(content, 0):
            if opcode != Opcode.MESSAGE:
                self._declare(opcode, content[position + RECORD.size : end])
                continue
            if not walked and _follow_from(position, listed, content):
                return listed
            walked.append(position)
        if end < len(content):
            raise ValueError(f"it holds no record at byte {end} of its {len(content)} bytes")
        return np.array(walked, np.int64)

    def _take_messages(self, content: bytes, places: NDArray[np.int64]) -> None:
        """Give messages at places in some bytes to their topics."""
        heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
        for channel in np.flatnonzero(np.bincount(heads["channel"])).tolist():
            is_of_channel = heads["channel"] == channel
            starts = places[is_of_channel] + MESSAGE.itemsize
            lengths = heads["length"][is_of_channel].astype(np.int64) - MESSAGE_HEAD
            log_times_ns = heads["log_time"][is_of_channel].astype(np.int64)
            self.add(channel, (content, starts, lengths), log_times_ns)

    def _declare(self, opcode: int, content: bytes) -> None:
        """Take in a schema or a channel; other records say nothing of messages."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(content))
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            self._declare_channel(Channel.read(_stream(content)))

    def _declare_channel(self, channel: Channel) -> None:
        schema = self.schemas.get(channel.schema_id, _messages.NO_SCHEMA)
        self.declare(channel.id, channel.topic, channel.message_encoding, schema)


def _records_in(data: bytes, position: int) -> Iterator[tuple[int, int, int]]:
    """Place, opcode and end of each record, up to one that cannot be."""
    while position + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, position)
        end = position + RECORD.size + length
        is_short = opcode == Opcode.MESSAGE and length < MESSAGE_HEAD
        if opcode == 0 or end > len(data) or is_short:
            return
        yield position, opcode, end
        position = end


def _follow_from(begin: int, places: NDArray[np.int64], content: bytes) -> bool:
    """Whether the messages at these places follow one another, from a byte to the end of all."""
    is_inside = places.size and places[-1] + MESSAGE.itemsize <= len(content)
    if not is_inside or places[0] != begin:
        return False
    heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
    ends = places + RECORD.size + heads["length"].astype(np.int64)
    are_messages = (heads["opcode"] == Opcode.MESSAGE).all()
    return bool(are_messages and (ends == np.append(places[1:], len(content))).all())


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read an MCAP file."""
    log = Log(source)
    log.take_file(path)
    if log.counts:
        log.expected = log.counts
    elif log.end == End.WHOLE or log.lost:
        log.expected = log.read + log.lost
    return log.recording("mcap", path.stat().st_size)


def _begins(begin: bytes) -> bool:
    return begin.startswith(MAGIC)


FORMAT = Format(name="mcap", suffixes=(".mcap",), begins=_begins, source=MessageSource, read=read)
