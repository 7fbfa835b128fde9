"""An MCAP file whose messages are all known beforehand: it is made chunk by chunk, not message by message.

The file equals the one that `mcap.writer.Writer` writes for the same messages: zstd chunks with CRCs, message indexes
and a summary.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

PROFILE, LIBRARY, COMPRESSION = "ros2", "osl-analysis", "zstd"
CHUNK_SIZE = 1 << 20
"""A chunk ends with the message that takes it beyond this size [bytes]."""
LATENCY_NS = 150_000
"""Time [ns] from a sample's stamp to its arrival at the recorder."""
OVERHEAD = 9
"""Bytes of a record before its content: the opcode and the length."""
MESSAGE = {"opcode": "u1", "length": "<u8", "channel": "<u2", "sequence": "<u4", "log": "<u8", "publish": "<u8"}
"""Members of a message's record before its data."""


@dataclass(frozen=True)
class Topic:
    """The messages of one topic, which are equally long: the schema as ros2msg, and time stamps [ns], (n,).

    A message has the `layout`, with the members `sec` and `nanosec` of its stamp. `constants` are members that are the
    same in every message, `columns` those that differ, (n,) each. Other members and the padding are zero.
    """

    name: str
    schema_name: str
    schema_text: str
    stamps: NDArray[np.int64]
    layout: "np.dtype[np.void]"
    constants: Mapping[str, bytes | int]
    columns: Mapping[str, NDArray[Any]]

    @property
    def record(self) -> "np.dtype[np.void]":
        """A message with what is before it in its record."""
        return np.dtype([*MESSAGE.items(), ("data", self.layout)])

    def definitions(self, channel: int) -> tuple[Schema, Channel]:
        """The schema and the channel, which have the same number."""
        text = self.schema_text.encode()
        schema = Schema(id=channel, name=self.schema_name, encoding="ros2msg", data=text)
        return schema, Channel(id=channel, topic=self.name, message_encoding="cdr", schema_id=channel, metadata={})

    def messages(self, channel: int, rows: NDArray[np.intp]) -> "np.ndarray[tuple[int], np.dtype[np.void]]":
        """The records of some messages; a message's sequence number is its row."""
        one = np.zeros(1, self.record)
        one["opcode"], one["length"], one["channel"] = Opcode.MESSAGE, one.itemsize - OVERHEAD, channel
        for name, value in self.constants.items():
            one["data"][name] = value
        messages = np.repeat(one.view(f"V{one.itemsize}"), len(rows)).view(one.dtype)  # as bytes, with the padding
        stamps, data = self.stamps[rows], messages["data"]
        messages["sequence"], messages["log"], messages["publish"] = rows, stamps + LATENCY_NS, stamps
        data["sec"], data["nanosec"] = np.divmod(stamps, 10**9)
        for name, values in self.columns.items():
            data[name] = values[rows]
        return messages


@dataclass(frozen=True)
class Content:
    """What one chunk holds: its bytes, and by channel the index of its messages, (m, 2): log time [ns] and place."""

    data: memoryview
    index: Mapping[int, NDArray[np.uint64]]

    def chunk(self) -> Chunk:
        """The record of the chunk."""
        times = np.concatenate([index[:, 0] for index in self.index.values()])
        return Chunk(
            compression=COMPRESSION,
            data=zstandard.compress(self.data),
            message_start_time=int(times.min()),
            message_end_time=int(times.max()),
            uncompressed_crc=zlib.crc32(self.data),
            uncompressed_size=len(self.data),
        )


def write_recording(path: Path, topics: Sequence[Topic], metadata: Metadata) -> None:
    """Write the messages of all topics, in the order of their stamps, after a metadata record."""
    definitions = [topic.definitions(number) for number, topic in enumerate(topics, 1)]
    indexes = list[ChunkIndex]()
    with path.open("wb") as file:
        start = MCAP0_MAGIC + encoded([Header(PROFILE, LIBRARY)])
        described = encoded([metadata])
        file.write(start + described)
        for content in contents(topics, encoded(record for pair in definitions for record in pair)):
            chunk, begin = content.chunk(), file.tell()
            record = encoded([chunk])
            file.write(record)
            offsets, own = dict[int, int](), file.tell()
            for channel, index in content.index.items():
                offsets[channel] = file.tell()
                file.write(message_index(channel, index))
            indexes.append(chunk_index(chunk, begin, len(record), offsets, file.tell() - own))
        file.write(encoded([DataEnd(0)]))
        groups: dict[Opcode, Sequence[McapRecord]] = {
            Opcode.SCHEMA: [schema for schema, _ in definitions],
            Opcode.CHANNEL: [channel for _, channel in definitions],
            Opcode.STATISTICS: [statistics(topics, indexes)],
            Opcode.CHUNK_INDEX: indexes,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [MetadataIndex(offset=len(start), length=len(described), name=metadata.name)],
        }
        file.write(summary(groups, file.tell()) + MCAP0_MAGIC)


def contents(topics: Sequence[Topic], definitions: bytes) -> Iterator[Content]:
    """The chunks, the first of which begins with the definitions of schemas and channels."""
    stamps = np.concatenate([topic.stamps for topic in topics])
    order = np.argsort(stamps, kind="stable")
    counts = [len(topic.stamps) for topic in topics]
    owner, row = np.repeat(np.arange(len(topics)), counts)[order], np.concatenate([np.arange(n) for n in counts])[order]
    ends = len(definitions) + np.cumsum(np.array([topic.record.itemsize for topic in topics])[owner])
    first, begin = 0, 0
    while first < len(ends):
        last = min(int(np.searchsorted(ends, begin + CHUNK_SIZE, side="right")), len(ends) - 1) + 1
        data, index = np.empty(int(ends[last - 1]) - begin, np.uint8), dict[int, NDArray[np.uint64]]()
        if first == 0:
            data[: len(definitions)] = np.frombuffer(definitions, np.uint8)
        of_topics = [first + np.flatnonzero(owner[first:last] == k) for k in range(len(topics))]
        present = [k for k, own in enumerate(of_topics) if len(own)]
        for k in sorted(present, key=lambda k: of_topics[k][0]):  # as each comes first in the chunk
            own = of_topics[k]
            messages = topics[k].messages(k + 1, row[own])
            places = ends[own] - messages.itemsize - begin
            every = (len(data) - messages.itemsize + 1,)
            np.ndarray(every, f"V{messages.itemsize}", data, 0, (1,))[places] = messages.view(f"V{messages.itemsize}")
            index[k + 1] = np.stack([messages["log"], places], axis=1).astype("<u8")
        yield Content(data.data, index)
        first, begin = last, int(ends[last - 1])


def encoded(records: Iterable[McapRecord]) -> bytes:
    """Records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def message_index(channel: int, index: NDArray[np.uint64]) -> bytes:
    """The record with the index of a channel's messages in the chunk before it."""
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + index.nbytes, channel, index.nbytes) + index.tobytes()


def chunk_index(chunk: Chunk, begin: int, length: int, offsets: dict[int, int], index_length: int) -> ChunkIndex:
    """The summary's record of a chunk of `length` bytes at `begin`, whose message indexes stand at `offsets`."""
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=begin,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=index_length,
        message_index_offsets=offsets,
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )


def statistics(topics: Sequence[Topic], indexes: Sequence[ChunkIndex]) -> Statistics:
    """The summary's numbers of messages."""
    used = dict.fromkeys(channel for index in indexes for channel in index.message_index_offsets)
    counts = {channel: len(topics[channel - 1].stamps) for channel in used}
    return Statistics(
        attachment_count=0,
        channel_count=len(topics),
        channel_message_counts=counts,
        chunk_count=len(indexes),
        message_count=sum(counts.values()),
        message_end_time=max((index.message_end_time for index in indexes), default=0),
        message_start_time=min((index.message_start_time for index in indexes), default=0),
        metadata_count=1,
        schema_count=len(topics),
    )


def summary(groups: Mapping[Opcode, Sequence[McapRecord]], start: int) -> bytes:
    """The summary at `start`, its offsets, and the footer with the CRC of both."""
    data, offsets = b"", list[SummaryOffset]()
    for opcode, records in groups.items():
        group = encoded(records)
        offsets.append(SummaryOffset(group_opcode=opcode, group_start=start + len(data), group_length=len(group)))
        data += group
    offsets_start = start + len(data)
    data += encoded(offsets)
    crc = zlib.crc32(data + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start))
    return data + encoded([Footer(start, offsets_start, crc)])
