"""MCAP (https://mcap.dev/spec).

Written by hand: the `mcap` library takes 30 times as long, and gives nothing of a log without its
end.

The records of the top level are walked from the front, so that a log without its end is read as far
as it goes. A chunk that does not match its checksum is lost, and counted by the indexes behind it.
The summary tells how many messages the recorder wrote.
"""

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Statistics
from mcap.records import Schema as SchemaRecord
from numpy.typing import NDArray

from osl_analysis.errors import InputError, quoted
from osl_analysis.formats import _messages
from osl_analysis.formats._bag_description import description_beside
from osl_analysis.formats._messages import Messages, Schema, Topic
from osl_analysis.formats._ros_shapes import rows_at
from osl_analysis.recording import End, Format, Loss, Recording
from osl_analysis.source_file import MessageSource

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content [bytes]
# opcode, length, where the summary and its offsets begin, its checksum
FOOTER = struct.Struct("<BQQQI")
# times of the first and the last message, size of the records [bytes], their checksum, length
# [bytes] of the name of the compression, which follows
CHUNK_HEAD = struct.Struct("<QQQII")
CHUNK_LENGTH = struct.Struct("<Q")  # of the records that follow, as they are compressed [bytes]
INDEX_HEAD = struct.Struct("<HI")  # channel, size of the entries [bytes]
INDEX_ENTRY = 16  # bytes: log time, place in the chunk
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


class DamagedChunkError(Exception):
    """A chunk cannot be read. The message completes the sentence "it ..."."""


class IndexedChunk(NamedTuple):
    """A chunk with what the message indexes behind it list."""

    start: int  # first byte of its content in the file
    content: memoryview
    counts: Counter[int]  # messages of each channel
    places: list[NDArray[np.int64]]  # of messages in the chunk [bytes]


class Log:
    """A log that is read: its topics, and what is lost.

    `shared` has the topics of the parts before, where the log is one of several parts: a topic
    goes on in the next part.
    """

    def __init__(
        self,
        data: bytes,
        wanted: Mapping[str, list[str]] | None,
        shared: dict[Any, Topic] | None = None,
    ) -> None:
        self.data = data
        self.wanted = wanted
        self.shared = shared
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, SchemaRecord] = {}
        self.topics: dict[int, Topic] = {}  # those that are wanted
        self.read: Counter[int] = Counter()  # messages by channel
        self.lost: Counter[int] = Counter()
        self.checked = 0  # messages that a checksum covers
        self.chunks = 0
        self.chunks_lost = 0
        self.statistics: Statistics | None = None
        self.end = End.MISSING
        self.remarks: list[str] = []
        # by the checksum of the data section, where no other one covers some of its messages
        self.is_data_wrong = False
        self.is_data_right = False
        self._chunk: IndexedChunk | None = None
        self._decompressor = zstandard.ZstdDecompressor()

    def walk(self) -> None:
        """Read the file; of one that cannot be read from end to end, say if it holds two logs.

        A sound file is not searched, which takes a second for an hour.
        """
        try:
            self._take_file()
        except Exception:
            self._check_one_log()
            raise
        if self.remarks:
            self._check_one_log()

    def _check_one_log(self) -> None:
        second_log = self.data.find(MAGIC + bytes([Opcode.HEADER]), 1)
        if second_log > 0:
            raise _two_logs(second_log)

    def _take_file(self) -> None:
        """Read the records of the top level."""
        data = self.data
        view = memoryview(data)
        has_footer = self._take_summary()
        position = len(MAGIC)
        has_data_end = False
        while position + RECORD.size <= len(data) and self.end == End.MISSING:
            opcode, length = RECORD.unpack_from(data, position)
            start = position + RECORD.size
            end = start + length
            if opcode == 0 or end > len(data):
                break
            if opcode != Opcode.MESSAGE_INDEX:
                self._take_chunk()
            if opcode == Opcode.CHUNK:
                self._chunk = IndexedChunk(start, view[start:end], Counter(), [])
            elif opcode == Opcode.MESSAGE_INDEX:
                self._take_index(start)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                end = self._take_records(data, position, in_chunk=False)
            elif opcode == Opcode.DATA_END and not has_data_end:
                has_data_end = True
                checksum = DataEnd.read(_stream(data[start:end])).data_section_crc
                if checksum and self.checked < self.read.total():
                    is_right = zlib.crc32(data[:position]) == checksum
                    self.is_data_wrong = not is_right
                    self.is_data_right = is_right
            elif opcode == Opcode.FOOTER:
                self._take_footer(end)
            position = end
        self._take_chunk()
        if self.end == End.WHOLE:
            return
        if has_footer:
            self.end = End.WHOLE
            self.remarks.append(f"from byte {position} on it cannot be read up to its summary")
        else:
            self.remarks.append(
                "no footer: the recorder did not finish, or the end is lost; how much is not known"
            )

    def _take_summary(self) -> bool:
        """Read what the summary lists, and tell whether the file has a footer.

        The chunk that declares a channel may be damaged, and the counts tell what is lost.
        """
        data = self.data
        footer = data[-len(MAGIC) - FOOTER.size : -len(MAGIC)]
        if not data.endswith(MAGIC) or len(footer) < FOOTER.size or footer[0] != Opcode.FOOTER:
            return False
        _, _, position, _, _ = FOOTER.unpack(footer)
        while 0 < position <= len(data) - RECORD.size:
            opcode, length = RECORD.unpack_from(data, position)
            start = position + RECORD.size
            position = start + length
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(opcode, data[start:position])
            elif opcode == Opcode.STATISTICS:
                self.statistics = Statistics.read(_stream(data[start:position]))
            elif opcode == Opcode.FOOTER:
                break
        return True

    def _take_footer(self, end: int) -> None:
        after = end + len(MAGIC)
        if self.data[end:after] != MAGIC:
            return
        if len(self.data) > after:
            raise InputError(
                f"ends at byte {after} and has {len(self.data) - after} bytes after it; keep what"
                f" is before them (`head -c {after}`), and if they are another log, give that a"
                " file and a trial of its own (`tail -c`)"
            )
        self.end = End.WHOLE

    def _take_index(self, start: int) -> None:
        """Note where an index says that messages of a channel stand in the last chunk."""
        if self._chunk is None:
            return
        channel, size = INDEX_HEAD.unpack_from(self.data, start)
        entries = np.frombuffer(self.data, "<i8", size // 8, start + INDEX_HEAD.size)
        self._chunk.counts[channel] += size // INDEX_ENTRY
        self._chunk.places.append(entries[1::2])

    def _take_chunk(self) -> None:
        """Read the last chunk, now that its indexes are known."""
        chunk = self._chunk
        self._chunk = None
        if chunk is None:
            return
        try:
            content, is_checked = self._unpacked(chunk.content)
            self._take_records(content, 0, in_chunk=True, index=chunk, is_checked=is_checked)
        except (DamagedChunkError, struct.error, UnicodeDecodeError) as error:
            self.chunks_lost += 1
            self.lost += chunk.counts
            reason = error if isinstance(error, DamagedChunkError) else "cannot be read"
            self.remarks.append(f"the chunk at byte {chunk.start} is damaged: it {reason}")
        else:
            self.chunks += 1

    def _unpacked(self, chunk: memoryview) -> tuple[bytes, bool]:
        """Decompress the records of a chunk, check them, and tell whether a checksum covers them.

        Raises
        ------
        DamagedChunkError
            They cannot be decompressed, or do not match their size or checksum.
        struct.error
            The chunk is too short.
        """
        _, _, size, checksum, name_length = CHUNK_HEAD.unpack_from(chunk)
        if size > LARGEST_CHUNK:
            raise DamagedChunkError(f"declares {size / 1e9:.3g} GB, at most 1 GB is read")
        begin = CHUNK_HEAD.size + name_length
        compression = bytes(chunk[CHUNK_HEAD.size : begin]).decode()
        (packed_length,) = CHUNK_LENGTH.unpack_from(chunk, begin)
        begin += CHUNK_LENGTH.size
        packed = chunk[begin : begin + packed_length]
        try:
            if compression == "zstd":
                content = self._decompressor.decompress(packed, size) if size else b""
            elif compression == "lz4":
                content = lz4.frame.decompress(packed)
            elif compression:
                raise DamagedChunkError(
                    f"is compressed with {compression[:20]!a}; zstd and lz4 are read"
                )
            else:
                content = bytes(packed)
        except (zstandard.ZstdError, RuntimeError, OSError, EOFError, ValueError) as error:
            raise DamagedChunkError("cannot be decompressed") from error
        if len(content) != size:
            raise DamagedChunkError(f"holds {len(content)} of {size} bytes")
        if checksum and zlib.crc32(content) != checksum:
            raise DamagedChunkError("does not match its checksum")
        return content, bool(checksum)

    def _take_records(
        self,
        content: bytes,
        begin: int,
        in_chunk: bool,
        index: IndexedChunk | None = None,
        is_checked: bool = False,
    ) -> int:
        """Read schemas, channels and messages, and give the place where others begin.

        Messages that an index lists are passed at one go.
        """
        indexed = no_messages()
        if index is not None and index.places:
            indexed = messages_at(content, np.concatenate(index.places))
        runs = indexed.runs()
        is_passed = np.zeros(indexed.places.size, bool)
        single: list[int] = []
        declarations: list[tuple[int, bytes]] = []
        position = begin
        while position + RECORD.size <= len(content):
            if position in runs:
                run, position = runs[position]
                is_passed[run] = True
                continue
            opcode, length = RECORD.unpack_from(content, position)
            start = position + RECORD.size
            end = start + length
            if end > len(content):
                break
            if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD:
                single.append(position)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                declarations.append((opcode, content[start:end]))
            elif not in_chunk:
                break
            position = end
        if in_chunk and position != len(content):
            raise DamagedChunkError(
                f"holds no record at byte {position} of its {len(content)} bytes"
            )
        for opcode, record in declarations:
            self._declare(opcode, record)
        # Mostly every message is in the index. Otherwise the heads are read again, by the places of
        # the messages that stand there: of some the index has none, or a wrong one.
        messages = indexed
        if single or not is_passed.all():
            passed = indexed.places[is_passed]
            messages = messages_at(content, np.concatenate([np.array(single, np.int64), passed]))
        self._take_messages(content, messages, is_checked)
        return position

    def _take_messages(self, content: bytes, messages: "MessagesAt", is_checked: bool) -> None:
        places = messages.places
        heads = messages.heads
        channel = heads["channel"].astype(np.int64)
        lengths = heads["length"].astype(np.int64) - MESSAGE_HEAD
        log_times_ns = heads["log_time"].astype(np.int64)
        sequence = heads["sequence"].astype(np.uint32)
        counts = np.bincount(channel)
        for number in np.flatnonzero(counts).tolist():
            self.read[number] += int(counts[number])
            if is_checked:
                self.checked += int(counts[number])
            if number not in self.channels:
                self.lost[number] += int(counts[number])
            if number not in self.topics:
                continue
            of_channel = np.flatnonzero(channel == number)
            self.topics[number].add(
                Messages(
                    buffer=content,
                    starts=places[of_channel] + MESSAGE.itemsize,
                    lengths=lengths[of_channel],
                    log_times_ns=log_times_ns[of_channel],
                    sequence=sequence[of_channel],
                )
            )

    def _declare(self, opcode: int, content: bytes) -> None:
        """Take in a schema or a channel. A number means one thing throughout a file."""
        if opcode == Opcode.SCHEMA:
            schema = SchemaRecord.read(_stream(content))
            known_schema = self.schemas.setdefault(schema.id, schema)
            if known_schema != schema:
                raise _joined("schema", schema.id, known_schema.name, schema.name)
            return
        channel = Channel.read(_stream(content))
        known_channel = self.channels.setdefault(channel.id, channel)
        if known_channel != channel:
            raise _joined("channel", channel.id, known_channel.topic, channel.topic)
        if channel.id in self.topics or (
            self.wanted is not None and channel.topic not in self.wanted
        ):
            return
        record = self.schemas.get(channel.schema_id)
        schema = Schema(record.name, record.encoding, record.data) if record else None
        topic = Topic(
            name=channel.topic,
            encoding=channel.message_encoding,
            schema=schema,
            wanted=None if self.wanted is None else self.wanted[channel.topic],
        )
        if self.shared is not None:
            topic = self.shared.setdefault((topic.name, topic.encoding, schema), topic)
        self.topics[channel.id] = topic

    def loss(self) -> Loss:
        """What was lost, by the summary, or else by the indexes of the chunks."""
        read = self.read.total() - sum(self.read[n] for n in self.lost if n not in self.channels)
        strangers = self.read.total() - read
        remarks = [*self.remarks]
        if strangers:
            remarks.append(f"{strangers} messages belong to channels that are not declared")
        expected: int | None = None
        declared: Counter[int] | None = None
        if self.end == End.WHOLE and self.statistics is not None:
            expected = self.statistics.message_count
            declared = Counter(self.statistics.channel_message_counts)
            if declared.total() != expected:  # the counts by channel may be left out
                declared = None
        elif self.end == End.WHOLE or self.lost:
            expected = read + self.lost.total()
        if expected is not None and expected != read:
            remarks.append(f"it declares {expected} messages and holds {read}")
        by_topic: dict[str, tuple[int, int | None]] = {}
        for number, channel in sorted(self.channels.items()):
            count = self.read[number]
            most = count + self.lost[number]
            if declared is not None:
                most = declared[number]
            before, before_most = by_topic.get(channel.topic, (0, 0))
            is_known = expected is not None and before_most is not None
            by_topic[channel.topic] = (
                before + count,
                (before_most or 0) + most if is_known else None,
            )
        checksums = "checked" if self.is_data_right else "absent"
        if self.checked:
            checksums = "checked" if self.checked == self.read.total() else "mixed"
        return Loss(read, expected, self.end, by_topic, checksums, tuple(remarks))


def _stream(content: bytes) -> Any:
    return ReadDataStream(BytesIO(content))


@dataclass(frozen=True)
class MessagesAt:
    """Messages in a chunk, by their places."""

    places: NDArray[np.int64]  # (n,) rising [bytes]
    heads: NDArray[Any]  # (n,) of `MESSAGE`

    def runs(self) -> dict[int, tuple[slice, int]]:
        """Runs of messages that follow one another to the byte.

        By the first message's place: the slice of the run in `places`, and the byte after its last
        message.
        """
        ends = self.places + RECORD.size + self.heads["length"].astype(np.int64)
        begins_run = np.flatnonzero(self.places[1:] != ends[:-1]) + 1
        cuts = [0, *begins_run.tolist(), self.places.size]
        return {
            int(self.places[first]): (slice(first, last), int(ends[last - 1]))
            for first, last in pairwise(cuts)
            if last > first
        }


def no_messages() -> MessagesAt:
    return MessagesAt(np.zeros(0, np.int64), np.zeros(0, MESSAGE))


def messages_at(content: bytes, places: NDArray[np.int64]) -> MessagesAt:
    """Take the messages at places (n,) [bytes], without those that hold something else."""
    is_inside = (places >= 0) & (places <= len(content) - MESSAGE.itemsize)
    places = np.sort(places[is_inside], kind="stable")
    heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
    lengths = heads["length"].astype(np.int64)
    fits = (lengths >= MESSAGE_HEAD) & (lengths <= len(content) - RECORD.size - places)
    is_message = fits & (heads["opcode"] == Opcode.MESSAGE)
    if not is_message.all():
        places = places[is_message]
        heads = heads[is_message]
    return MessagesAt(places, heads)


def _joined(what: str, number: int, name: str, other_name: str) -> InputError:
    return InputError(
        f"{what} {number} is {name!a} in one part of the file and {other_name!a} in another: two"
        " logs were joined, or the file is damaged; record again, or give each log a file of its"
        " own"
    )


def _two_logs(place: int) -> InputError:
    return InputError(
        f"holds two logs, the second from byte {place} on: split them into two files there"
        " (`head -c`, `tail -c`) and give each a trial of its own"
    )


def read_log(
    path: Path,
    wanted: Mapping[str, list[str]] | None,
    shared: dict[Any, Topic] | None = None,
) -> Log:
    """Read the wanted fields of the wanted topics, or all."""
    log = Log(path.read_bytes(), wanted, shared)
    if not log.data.startswith(MAGIC):
        raise InputError(
            f"not an MCAP file (it begins with {quoted(log.data[:8])}); check the path and the"
            " source's format"
        )
    log.walk()
    log.data = b""
    if log.is_data_wrong:
        raise InputError(
            "the checksum of the data section does not match, and no other covers its messages;"
            " copy the file again, or record again"
        )
    return log


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read an MCAP file."""
    log = read_log(path, _messages.wanted_fields(source))
    loss = log.loss()
    _, remark = description_beside(path)
    if remark:
        loss = replace(loss, remarks=[*loss.remarks, remark])
    facts = {
        "bytes": path.stat().st_size,
        "chunks": log.chunks,
        "chunks_lost": log.chunks_lost,
        "messages": log.read.total(),
    }
    names = {channel.topic for channel in log.channels.values()}
    topics = [topic for _, topic in sorted(log.topics.items())]
    is_declared = log.statistics is not None
    return _messages.recording_of("mcap", topics, names, loss, facts, source, is_declared)


def _begins(begin: bytes) -> bool:
    return begin.startswith(MAGIC)


FORMAT = Format(name="mcap", suffixes=(".mcap",), begins=_begins, source=MessageSource, read=read)
