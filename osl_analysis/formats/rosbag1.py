"""Bags of ROS 1, by the library `rosbags`.

It gives messages in the order of their times, which would hide a clock that was set back; its index
tells their places.
"""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.errors import InputError, optional_module
from osl_analysis.formats import _messages, beginning, is_of_file
from osl_analysis.formats._cdr import rows_at, short_name
from osl_analysis.formats._messages import Container, Messages, Schema, Topic
from osl_analysis.recording import Format, Loss, Recording
from osl_analysis.source_file import MessageSource

BEGINNING = b"#ROSBAG V"
BEGINNING_2 = b"#ROSBAG V2.0\n"
LENGTH = np.dtype("<u4")  # of the head of a message, and of its data [bytes]


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read a bag; refused if it has no index."""
    if not beginning(path).startswith(BEGINNING_2):
        raise InputError(
            "not a ROS 1 bag of version 2.0; convert an older one with `rosbag fix`, or check the"
            " source's format"
        )
    library = optional_module("rosbags.rosbag1", "a bag of ROS 1")
    try:
        with library.Reader(path) as reader:
            bag = Bag(reader, path, source)
            bag.read_chunks()
    except (MemoryError, InputError):
        raise
    except Exception as error:  # whatever the library meets in a damaged bag
        if not is_of_file(error):
            raise
        remedy = "run `rosbag reindex` on a copy"
        if "encryption" in str(error):
            remedy = "run `rosbag decrypt` first"
        raise InputError(
            "no bag with a whole index: the recorder did not finish, or the bag is damaged;"
            f" {remedy}, or record again"
        ) from error
    return bag.recording("rosbag1", path.stat().st_size, bag.loss(), source)


class Bag(Container):
    """A bag that is read chunk by chunk."""

    def __init__(self, reader: Any, path: Path, source: MessageSource | None) -> None:
        super().__init__(_messages.wanted_fields(source))
        self.reader = reader
        self.data = path.read_bytes()
        second = self.data.find(BEGINNING_2, 1)
        if second > 0:
            raise InputError(
                f"two bags were joined: a second one begins at byte {second}; give each a file"
            )
        self.topic_by_connection: dict[int, Topic] = {}
        self.name_of: dict[int, str] = {}  # of the topic of each connection
        self.expected: Counter[str] = Counter()  # messages by topic
        for connection in reader.connections:
            self.name_of[connection.id] = connection.topic
            schema = Schema(
                short_name(connection.msgtype), "ros1msg", connection.msgdef.data.encode()
            )
            topic = self.topic_of(connection.topic, "ros1", schema)
            if topic is not None:
                self.topic_by_connection[connection.id] = topic
        for chunk in reader.chunk_infos:
            for connection, count in chunk.connection_counts.items():
                self.expected[self.name_of[connection]] += count

    def read_chunks(self) -> None:
        """Read the messages of every chunk in the order of the file."""
        index: dict[int, list[tuple[int, int, int]]] = {place: [] for place in self.reader.chunks}
        for connection, entries in self.reader.indexes.items():
            for entry in entries:
                index[entry.chunk_pos].append((entry.offset, connection, entry.time))
        for place, chunk in sorted(self.reader.chunks.items()):
            try:
                packed = self.data[chunk.datapos : chunk.datapos + chunk.datasize]
                content = chunk.decompressor(packed)
                self._take(content, sorted(index[place]))
            except (OSError, RuntimeError, ValueError, IndexError, EOFError) as error:
                self.chunks_lost += 1
                reason = " ".join(str(error).split())[:100]
                self.remarks.append(f"the chunk at byte {place} is damaged: {reason}")
            else:
                self.chunks += 1
        self.data = b""

    def _take(self, content: bytes, entries: list[tuple[int, int, int]]) -> None:
        places, connections, times_ns = np.array(entries, np.int64).reshape(-1, 3).T
        # each message stands behind a head of its own
        data = places + 4 + rows_at(content, places, 4).view(LENGTH).astype(np.int64)
        lengths = rows_at(content, data, 4).view(LENGTH).astype(np.int64)
        if (data + 4 + lengths > len(content)).any():
            raise ValueError(f"a message reaches beyond its {len(content)} bytes")
        for connection in np.unique(connections).tolist():
            of_connection = connections == connection
            self.read[self.name_of[connection]] += int(of_connection.sum())
            if connection in self.topic_by_connection:
                starts = data[of_connection] + 4
                own_times_ns = times_ns[of_connection]
                self.topic_by_connection[connection].add(
                    Messages(content, starts, lengths[of_connection], own_times_ns, connection)
                )

    def loss(self) -> Loss:
        """What was lost, by the index."""
        remarks = [*self.remarks]
        read = self.read.total()
        expected = self.expected.total()
        if read != expected:
            remarks.append(f"it declares {expected} messages and holds {read}")
        by_topic = {
            name: (self.read[name], self.expected[name]) for name in sorted(self.name_of.values())
        }
        return Loss(read, expected, by_topic=by_topic, checksums="absent", remarks=remarks)


def _begins(begin: bytes) -> bool:
    return begin.startswith(BEGINNING)


FORMAT = Format(name="rosbag1", suffixes=(".bag",), begins=_begins, source=MessageSource, read=read)
