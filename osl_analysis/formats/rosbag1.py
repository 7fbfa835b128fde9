# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1, by the index that `rosbags` reads.

Its own reader sorts messages by time, which would hide a clock that was set back, and takes them
one by one. The index tells their places, in the order of the file.
"""

import bz2
import re
from collections.abc import Callable
from operator import methodcaller
from pathlib import Path

import numpy as np
from lz4.frame import LZ4FrameDecompressor
from mcap.records import Schema
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader, ReaderError

from osl_analysis.base.errors import InputError, on_one_line
from osl_analysis.base.memory import check_unpacked
from osl_analysis.base.recording import Format, Recording
from osl_analysis.base.source_file import MessageSource
from osl_analysis.formats.message_layout import rows_at
from osl_analysis.formats.topic_log import TopicLog

MAGIC = b"#ROSBAG V"
LENGTH_BYTES = 4  # of the length before each head and each message
UNPACK: dict[bytes, Callable[[bytes, int], bytes]] = {
    b"none": lambda packed, size: packed,
    b"bz2": lambda packed, size: bz2.BZ2Decompressor().decompress(packed, max_length=size),
    b"lz4": lambda packed, size: LZ4FrameDecompressor().decompress(packed, max_length=size),
}


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read a bag; refused if it has no index."""
    log = TopicLog(source)
    data = path.read_bytes()
    if data.find(MAGIC, 1) > 0:
        raise InputError(
            "holds two bags",
            "cut it in two (`head -c`, `tail -c`), and give each a trial of its own",
        )
    try:
        with Reader(path) as reader:
            _take_bag(log, reader, data, path)
    except (ReaderError, AssertionError) as error:  # of the library, for a damaged index
        raise InputError(
            f"has no whole index ({on_one_line(error) or 'its records do not fit'}): the recorder"
            " did not finish, or the bag is damaged",
            "run `rosbag reindex` on a copy (`rosbag decrypt` if it is encrypted), or record again",
        ) from error
    return log.recording("rosbag1", log.declared)


def _take_bag(log: TopicLog, reader: Reader, data: bytes, path: Path) -> None:
    """Read the messages of every chunk in the order of the file."""
    for connection in reader.connections:
        schema = Schema(0, connection.msgdef.data.encode(), "ros1msg", connection.msgtype)
        log.declare_channel(connection.id, connection.topic, "ros1", schema)
    for info in reader.chunk_infos:
        for channel, count in info.connection_counts.items():
            log.declared[log.topic_of[channel].name] += count
    index: dict[int, list[tuple[int, int, int]]] = {place: [] for place in reader.chunks}
    for channel, entries in reader.indexes.items():
        for entry in entries:
            index[entry.chunk_pos].append((entry.offset, channel, entry.time))
    unpacked = 0
    for place, chunk in sorted(reader.chunks.items()):
        head = data[place : chunk.datapos]
        size = int.from_bytes(re.findall(b"size=(.{4})", head, re.DOTALL)[0], "little")
        unpacked += size
        check_unpacked(path, unpacked)
        try:
            (compression,) = re.findall(b"compression=([a-z0-9]+)", head)
            content = UNPACK[compression](
                data[chunk.datapos : chunk.datapos + chunk.datasize], size
            )
            if len(content) != size:
                raise ValueError(f"it unpacks to other than its {size} bytes")
            offsets, channels, log_times_ns = np.array(sorted(index[place])).reshape(-1, 3).T
            starts = offsets + LENGTH_BYTES + _lengths_at(content, offsets) + LENGTH_BYTES
            lengths = _lengths_at(content, starts - LENGTH_BYTES)
            if (starts + lengths > len(content)).any():
                raise ValueError("a message reaches beyond it")
        except Exception as error:  # whatever a library meets in a damaged chunk
            log.chunks_lost += 1
            log.remarks.append(f"the chunk at byte {place} is damaged: {on_one_line(error)}")
            continue
        log.add_messages((content, starts, lengths), log_times_ns, channels)


def _lengths_at(content: bytes, places: NDArray[np.int64]) -> NDArray[np.int64]:
    """The lengths that stand at some places [bytes]."""
    return rows_at(content, places, LENGTH_BYTES).view("<u4").astype(np.int64)


FORMAT = Format(
    name="rosbag1",
    suffixes=(".bag",),
    begins=methodcaller("startswith", MAGIC),
    source=MessageSource,
    read=read,
)
