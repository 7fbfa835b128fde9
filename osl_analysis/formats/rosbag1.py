"""Bags of ROS 1, by the library `rosbags`.

It gives messages in the order of their times, which would hide a clock that was set back; its index
tells their places.
"""

from pathlib import Path

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader

from osl_analysis.errors import InputError
from osl_analysis.formats import is_of_file
from osl_analysis.formats._cdr import rows_at
from osl_analysis.formats._messages import Log
from osl_analysis.recording import Format, Recording
from osl_analysis.source_file import MessageSource

BEGINNING = b"#ROSBAG V"


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read a bag; refused if it has no index."""
    log = Log(source)
    data = path.read_bytes()
    if data.find(BEGINNING, 1) > 0:
        raise InputError("holds two bags; cut it in two (`head -c`, `tail -c`), a trial each")
    try:
        with Reader(path) as reader:
            _take_bag(log, reader, data)
    except Exception as error:  # whatever the library meets in a damaged bag
        if not is_of_file(error) and not isinstance(error, RuntimeError):  # of lz4
            raise
        reason = " ".join(str(error).split())
        raise InputError(
            f"no bag with a whole index ({reason}): the recorder did not finish, or the bag is"
            " damaged; run `rosbag reindex` on a copy (`rosbag fix` if it is older than version"
            " 2.0, `rosbag decrypt` if it is encrypted), or record again"
        ) from error
    return log.recording("rosbag1", len(data))


def _take_bag(log: Log, reader: Reader, data: bytes) -> None:
    """Read the messages of every chunk in the order of the file."""
    for connection in reader.connections:
        schema = Schema(0, connection.msgdef.data.encode(), "ros1msg", connection.msgtype)
        log.declare(connection.id, connection.topic, "ros1", schema)
    for info in reader.chunk_infos:
        for channel, count in info.connection_counts.items():
            log.expected[log.name_of[channel]] += count
    index: dict[int, list[tuple[int, int, int]]] = {place: [] for place in reader.chunks}
    for channel, entries in reader.indexes.items():
        for entry in entries:
            index[entry.chunk_pos].append((entry.offset, channel, entry.time))
    for place, chunk in sorted(reader.chunks.items()):
        places, channels, log_times_ns = np.array(sorted(index[place])).reshape(-1, 3).T
        try:
            content = chunk.decompressor(data[chunk.datapos : chunk.datapos + chunk.datasize])
            # each message stands behind a head of its own
            starts = places + 4 + _lengths_at(content, places) + 4
            lengths = _lengths_at(content, starts - 4)
            if (starts + lengths > len(content)).any():
                raise ValueError("a message reaches beyond it")
        except Exception as error:  # whatever the library meets in a damaged chunk
            log.chunks_lost += 1
            log.remarks.append(f"the chunk at byte {place} is damaged: {error}")
            continue
        log.chunks += 1
        for channel in np.unique(channels).tolist():
            of_channel = channels == channel
            messages = (content, starts[of_channel], lengths[of_channel])
            log.add(channel, messages, log_times_ns[of_channel])


def _lengths_at(content: bytes, places: NDArray[np.int64]) -> NDArray[np.int64]:
    """The lengths that stand at some places [bytes]."""
    return rows_at(content, places, 4).view("<u4").astype(np.int64)


def _begins(begin: bytes) -> bool:
    return begin.startswith(BEGINNING)


FORMAT = Format(name="rosbag1", suffixes=(".bag",), begins=_begins, source=MessageSource, read=read)
