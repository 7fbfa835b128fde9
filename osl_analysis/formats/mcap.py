"""MCAP (https://mcap.dev/spec), also what an interrupted recorder left.

The records are walked from the front, so that a log without its end is read as far as it goes. A
chunk that does not match its checksum is lost, and counted by the indexes behind it. The library
`mcap` decodes the records; it would take 30 times as long for the messages.
"""

import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Statistics
from mcap.records import Schema as SchemaRecord
from mcap.stream_reader import get_chunk_data_stream
from numpy.typing import NDArray

from osl_analysis.errors import InputError, quoted
from osl_analysis.formats import _messages
from osl_analysis.formats._cdr import rows_at
from osl_analysis.formats._messages import Container, Messages, Schema, Topic
from osl_analysis.recording import End, Format, Loss, Recording
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
LARGEST_CHUNK = 1_000_000_000  # bytes of a chunk; recorders write a few million


class Log(Container):
    """A log that is read: its topics, and what is lost."""

    def __init__(self, wanted: Mapping[str, list[str]] | None) -> None:
        super().__init__(wanted)
        self.topic_by_channel: dict[int, Topic] = {}
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, SchemaRecord] = {}
        self.lost: Counter[int] = Counter()
        self.statistics: Statistics | None = None
        self.checked = 0  # messages that a checksum covers
        self.end = End.MISSING

    def take_file(self, data: bytes) -> None:
        """Read the records of a file from the front, as far as they go."""
        self._take_summary(data)
        try:
            last = self._take_records(data)
        except Exception:
            _check_one_log(data)
            raise
        self._check_end(data, last)

    def _take_records(self, data: bytes) -> int:
        """Read the records, and give the place of the last one [bytes]."""
        chunk: Chunk | None = None
        indexed: dict[int, NDArray[np.int64]] = {}  # places in the chunk by channel
        loose: list[int] = []  # places of messages outside of chunks
        position = 0
        for position, opcode, length in _records_in(data, len(MAGIC)):
            start = position + RECORD.size
            content = data[start : start + length] if opcode != Opcode.MESSAGE else b""
            if opcode == Opcode.MESSAGE_INDEX:
                channel, size = INDEX_HEAD.unpack_from(content)
                entries = np.frombuffer(content, "<i8", size // 8, INDEX_HEAD.size)
                indexed[channel] = entries[1::2]  # behind their log times
                continue
            self._take_chunk(chunk, indexed)
            chunk = None
            indexed = {}
            if opcode == Opcode.CHUNK:
                chunk = Chunk.read(_stream(content))
            elif opcode == Opcode.MESSAGE:
                loose.append(position)
            elif opcode == Opcode.FOOTER:
                self.end = End.WHOLE
                break
            else:
                self._declare(opcode, content)
        self._take_chunk(chunk, indexed)
        self._take_messages(data, np.array(loose, np.int64), is_checked=False)
        return position

    def _take_summary(self, data: bytes) -> None:
        """Read what the summary declares: the chunk that declares a channel may be damaged."""
        summary = None
        with suppress(Exception):  # whatever the library meets in a file that is cut off
            summary = SeekingReader(BytesIO(data)).get_summary()
        if summary is not None:
            self.statistics = summary.statistics
            self.schemas.update(summary.schemas)
            for channel in summary.channels.values():
                self._declare_channel(channel)

    def _check_end(self, data: bytes, last: int) -> None:
        """Say what is missing of a file whose `last` record begins there [byte]."""
        if self.end == End.WHOLE:
            end = last + RECORD.size + RECORD.unpack_from(data, last)[1] + len(MAGIC)
            if len(data) > end:
                _check_one_log(data)
                raise InputError(
                    f"ends at byte {end} and has {len(data) - end} bytes after it; keep what is"
                    f" before them (`head -c {end}`)"
                )
            return
        _check_one_log(data)
        if self.statistics is not None:
            self.end = End.WHOLE
            self.remarks.append(f"behind byte {last} it cannot be read up to its summary")
            return
        self.remarks.append(
            "no footer: the recorder did not finish, or the end is lost; how much is not known"
        )

    def _take_chunk(self, chunk: Chunk | None, indexed: Mapping[int, NDArray[np.int64]]) -> None:
        """Read the messages of a chunk, now that its indexes are known."""
        if chunk is None:
            return
        try:
            content = _unpacked(chunk)
            places = self._places_in(content, [*indexed.values()])
        except InputError:
            raise
        except Exception as error:  # whatever the library meets in a damaged chunk
            self.chunks_lost += 1
            self.lost.update({channel: own.size for channel, own in indexed.items()})
            reason = " ".join(str(error).split()) or type(error).__name__
            self.remarks.append(f"chunk {self.chunks + self.chunks_lost} is damaged: {reason}")
            return
        self.chunks += 1
        self._take_messages(content, places, is_checked=chunk.uncompressed_crc != 0)

    def _places_in(self, content: bytes, indexed: list[NDArray[np.int64]]) -> NDArray[np.int64]:
        """Places of the messages in a chunk [bytes], rising; takes in what else it declares.

        Where the indexes list messages that follow one another to the end of the chunk, only the
        records before them are walked.
        """
        places = np.sort(np.concatenate([np.zeros(0, np.int64), *indexed]))
        is_inside = (places >= 0) & (places <= len(content) - MESSAGE.itemsize)
        is_listed = bool(places.size and is_inside.all())
        if is_listed:
            heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
            ends = places + RECORD.size + heads["length"].astype(np.int64)
            follow = bool((ends[:-1] == places[1:]).all()) and int(ends[-1]) == len(content)
            is_listed = follow and bool((heads["opcode"] == Opcode.MESSAGE).all())
        walked: list[int] = []
        end = 0
        for position, opcode, length in _records_in(content, 0):
            if is_listed and position == places[0]:
                return places
            end = position + RECORD.size + length
            if opcode == Opcode.MESSAGE:
                walked.append(position)
            else:
                self._declare(opcode, content[position + RECORD.size : end])
        if end < len(content):
            raise ValueError(f"it holds no record at byte {end} of its {len(content)} bytes")
        return np.array(walked, np.int64)

    def _take_messages(self, content: bytes, places: NDArray[np.int64], is_checked: bool) -> None:
        """Give messages at places in some bytes to their topics."""
        heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
        lengths = heads["length"].astype(np.int64) - MESSAGE_HEAD
        log_times_ns = heads["log_time"].astype(np.int64)
        channels = heads["channel"].astype(np.int64)
        for channel in np.flatnonzero(np.bincount(channels)).tolist():
            own = np.flatnonzero(channels == channel)
            self.read[channel] += own.size
            if is_checked:
                self.checked += own.size
            if channel in self.topic_by_channel:
                starts = places[own] + MESSAGE.itemsize
                self.topic_by_channel[channel].add(
                    Messages(content, starts, lengths[own], log_times_ns[own], channel)
                )

    def _declare(self, opcode: int, content: bytes) -> None:
        """Take in a schema or a channel; other records say nothing of messages."""
        if opcode == Opcode.SCHEMA:
            schema = SchemaRecord.read(_stream(content))
            known = self.schemas.setdefault(schema.id, schema)
            if known != schema:
                raise _two_meanings("schema", schema.id, known.name, schema.name)
        elif opcode == Opcode.CHANNEL:
            self._declare_channel(Channel.read(_stream(content)))

    def _declare_channel(self, channel: Channel) -> None:
        known = self.channels.setdefault(channel.id, channel)
        if known != channel:
            raise _two_meanings("channel", channel.id, known.topic, channel.topic)
        if channel.id in self.topic_by_channel:
            return
        record = self.schemas.get(channel.schema_id)
        schema = Schema(record.name, record.encoding, record.data) if record else Schema()
        topic = self.topic_of(channel.topic, channel.message_encoding, schema)
        if topic is not None:
            self.topic_by_channel[channel.id] = topic

    def loss(self) -> Loss:
        """What was lost, by the summary, or else by the indexes of the chunks."""
        strangers = sum(count for number, count in self.read.items() if number not in self.channels)
        read = self.read.total() - strangers
        remarks = [*self.remarks]
        if strangers:
            remarks.append(f"{strangers} messages belong to channels that are not declared")
        counts = self.read + self.lost
        expected: int | None = None
        if self.statistics is not None:
            expected = self.statistics.message_count
            declared = Counter(self.statistics.channel_message_counts)
            if declared.total() == expected:  # the counts by channel may be left out
                counts = declared
        elif self.end == End.WHOLE or self.lost:
            expected = read + self.lost.total()
        if expected is not None and expected != read:
            remarks.append(f"it declares {expected} messages and holds {read}")
        by_topic: dict[str, tuple[int, int | None]] = {}
        for number, channel in sorted(self.channels.items()):
            before, before_expected = by_topic.get(channel.topic, (0, 0))
            by_topic[channel.topic] = (
                before + self.read[number],
                None if expected is None else (before_expected or 0) + counts[number],
            )
        checksums = "absent"
        if self.checked:
            checksums = "checked" if self.checked == self.read.total() else "mixed"
        return Loss(read, expected, self.end, by_topic, checksums, tuple(remarks))


def _check_one_log(data: bytes) -> None:
    """Refuse a file with a second log, which is cut off in its first or cannot be read."""
    second_log = data.find(MAGIC + bytes([Opcode.HEADER]), 1)
    if second_log > 0:
        raise InputError(
            f"holds two logs, the second from byte {second_log} on; split them into two files there"
            " (`head -c`, `tail -c`) and give each a trial of its own"
        )


def _records_in(data: bytes, begin: int) -> Iterator[tuple[int, int, int]]:
    """Place, opcode and length of each record, up to one that cannot be."""
    position = begin
    while position + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, position)
        end = position + RECORD.size + length
        is_short = opcode == Opcode.MESSAGE and length < MESSAGE_HEAD
        if opcode == 0 or end > len(data) or is_short:
            return
        yield position, opcode, length
        position = end


def _unpacked(chunk: Chunk) -> bytes:
    """The records of a chunk. Raises ValueError, or an error of the library: it is damaged."""
    if chunk.uncompressed_size > LARGEST_CHUNK:
        raise ValueError(
            f"it declares {chunk.uncompressed_size / 1e9:.3g} GB, at most 1 GB is read"
        )
    stream, _ = get_chunk_data_stream(chunk, validate_crc=True)
    content: bytes = stream.read(chunk.uncompressed_size)
    return content


def _stream(content: bytes) -> Any:
    return ReadDataStream(BytesIO(content))


def _two_meanings(what: str, number: int, name: str, other_name: str) -> InputError:
    return InputError(
        f"{what} {number} is {name!a} in one part of the file and {other_name!a} in another: two"
        " logs were joined, or the file is damaged; record again, or give each log a file of its"
        " own"
    )


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read an MCAP file."""
    data = path.read_bytes()
    if not data.startswith(MAGIC):
        raise InputError(
            f"not an MCAP file (it begins with {quoted(data[:8])}); check the path and the source's"
            " format"
        )
    log = Log(_messages.wanted_fields(source))
    log.take_file(data)
    return log.recording("mcap", len(data), log.loss(), source)


def _begins(begin: bytes) -> bool:
    return begin.startswith(MAGIC)


FORMAT = Format(name="mcap", suffixes=(".mcap",), begins=_begins, source=MessageSource, read=read)
