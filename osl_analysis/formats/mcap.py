"""MCAP (https://mcap.dev/spec), by the library `mcap`, and what an interrupted recorder left."""

import struct
from collections import Counter
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema, Statistics
from mcap.stream_reader import get_chunk_data_stream
from numpy.lib.stride_tricks import sliding_window_view

from osl_analysis.formats import _messages
from osl_analysis.formats._messages import Topic
from osl_analysis.recording import End, Format, Loss, Recording
from osl_analysis.source_file import MessageSource

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
MESSAGE = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
     ("log_time", "<u8"), ("publish_time", "<u8")]
)  # fmt: skip
MESSAGE_HEAD = MESSAGE.itemsize - RECORD.size
READERS: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.STATISTICS: Statistics,
}


class Log:
    """A log that is read: its topics, and what is lost."""

    def __init__(self, wanted: Mapping[str, list[str]] | None, topics: dict[str, Topic]) -> None:
        self.wanted = wanted
        self.topics = topics
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.read: Counter[str] = Counter()
        self.statistics: Statistics | None = None
        self.chunks = 0
        self.chunks_lost = 0
        self.is_checked = True
        self.end = End.MISSING
        self.remarks: list[str] = []

    def take_file(self, path: Path) -> None:
        """Read a file record by record, up to its end or as far as it goes."""
        data = path.read_bytes()
        position = len(MAGIC)
        while position + RECORD.size <= len(data) and self.end is End.MISSING:
            opcode, length = RECORD.unpack_from(data, position)
            start = position + RECORD.size
            if opcode == 0 or start + length > len(data):
                break
            if opcode in READERS:
                self.take(READERS[opcode].read(_stream(data[start : start + length])))
            elif opcode == Opcode.MESSAGE:
                self.is_checked = False
                self.take_chunk(data[position : start + length])
            elif opcode == Opcode.FOOTER:
                self.end = End.WHOLE
            position = start + length
        if self.end is End.MISSING:
            self.remarks.append("its end is missing: the recorder did not finish, or it is cut")
        elif position + len(MAGIC) < len(data):
            self.remarks.append("bytes stand behind its end, as of another log, and are not read")

    def take(self, record: Any) -> None:
        """Take in a record that is no message."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.declare(record)
        elif isinstance(record, Statistics):
            self.statistics = record
        else:
            self.chunks += 1
            self.is_checked = self.is_checked and record.uncompressed_crc != 0
            try:
                stream, _ = get_chunk_data_stream(record, validate_crc=True)
            except Exception as error:
                self.chunks_lost += 1
                self.remarks.append(f"chunk {self.chunks} is damaged, and is not read: {error}")
            else:
                self.take_chunk(stream._stream.getvalue())

    def declare(self, channel: Channel) -> None:
        self.channels[channel.id] = channel
        if self.wanted is not None and channel.topic not in self.wanted:
            return
        schema = self.schemas.get(channel.schema_id)
        name, text = (schema.name, schema.data) if schema else ("", b"")
        wanted = None if self.wanted is None else self.wanted[channel.topic]
        topic = Topic(channel.topic, channel.message_encoding, name, text, wanted)
        self.topics.setdefault(channel.topic, topic)

    def take_chunk(self, content: bytes) -> None:
        """Give the messages of a chunk to their topics."""
        places: list[int] = []
        position = 0
        unpack = RECORD.unpack_from
        while position < len(content):
            opcode, length = unpack(content, position)
            if opcode == Opcode.MESSAGE:
                places.append(position)
            elif opcode in READERS:
                start = position + RECORD.size
                self.take(READERS[opcode].read(_stream(content[start : start + length])))
            position += RECORD.size + length
        starts = np.array(places, np.int64)
        windows = sliding_window_view(np.frombuffer(content, np.uint8), MESSAGE.itemsize)
        heads = windows[starts].view(MESSAGE)[:, 0]
        for channel in np.unique(heads["channel"]).tolist():
            is_own = heads["channel"] == channel
            name = self.channels[channel].topic
            self.read[name] += int(is_own.sum())
            if name in self.topics:
                lengths = heads["length"][is_own].astype(np.int64) - MESSAGE_HEAD
                log_times_ns = heads["log_time"][is_own].astype(np.int64)
                begins = starts[is_own] + MESSAGE.itemsize
                self.topics[name].add(content, begins, lengths, log_times_ns)

    def loss(self) -> Loss:
        """What was lost, by the statistics at the end."""
        expected = None
        counts: Counter[str] = Counter()
        if self.statistics is not None:
            expected = self.statistics.message_count
            for number, count in self.statistics.channel_message_counts.items():
                counts[self.channels[number].topic] += count
        names = sorted({channel.topic for channel in self.channels.values()})
        is_known = expected is not None and counts.total() == expected
        by_topic = {name: (self.read[name], counts[name] if is_known else None) for name in names}
        checksums = "checked" if self.is_checked else "absent"
        return Loss(self.read.total(), expected, self.end, by_topic, checksums, self.remarks)


def _stream(content: bytes) -> Any:
    return ReadDataStream(BytesIO(content))


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read an MCAP file."""
    log = Log(_messages.wanted_fields(source), {})
    log.take_file(path)
    facts = {
        "bytes": path.stat().st_size,
        "chunks": log.chunks - log.chunks_lost,
        "chunks_lost": log.chunks_lost,
        "messages": log.read.total(),
    }
    return _messages.recording_of("mcap", list(log.topics.values()), log.loss(), facts, source)


def _begins(begin: bytes) -> bool:
    return begin.startswith(MAGIC)


FORMAT = Format(name="mcap", suffixes=(".mcap",), begins=_begins, source=MessageSource, read=read)
