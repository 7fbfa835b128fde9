"""Bags of ROS 1, and of ROS 2 in sqlite3 or MCAP, by the library `rosbags`."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.errors import InputError, optional_module
from osl_analysis.formats import _messages, mcap
from osl_analysis.formats._messages import Topic
from osl_analysis.recording import End, Format, Loss, Recording
from osl_analysis.source_file import MessageSource

ROS1 = b"#ROSBAG V"
SQLITE = b"SQLite format 3\0"
DESCRIPTION = "metadata.yaml"
AT_ONCE = 1 << 14  # messages that are decoded together


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read a bag, or the folder of one."""
    wanted = _messages.wanted_fields(source)
    topics: dict[str, Topic] = {}
    counts: dict[str, tuple[int, int | None]] = {}
    with ExitStack() as stack:
        reader = stack.enter_context(_reader(path))
        _take(reader, wanted, topics, counts)
        size = sum(file.stat().st_size for file in _files_in(path) if file.name != DESCRIPTION)
    read_count = sum(count for count, _ in counts.values())
    expected = sum(most or 0 for _, most in counts.values())
    loss = Loss(read_count, expected, End.WHOLE, counts, "absent")
    facts = {"bytes": size, "chunks": 0, "chunks_lost": 0, "messages": read_count}
    return _messages.recording_of("rosbag", list(topics.values()), loss, facts, source)


def _reader(path: Path) -> Any:
    if path.is_dir():
        return optional_module("rosbags.rosbag2", "a bag of ROS 2").Reader(path)
    if path.suffix == ".bag":
        return optional_module("rosbags.rosbag1", "a bag of ROS 1").Reader(path)
    storage = optional_module("rosbags.rosbag2.storage_sqlite3", "a bag of ROS 2")
    return _One(storage.Sqlite3Reader(path))


class _One:
    """One database, without the description of its folder."""

    def __init__(self, storage: Any) -> None:
        self.storage = storage

    def __enter__(self) -> Any:
        self.storage.open()
        return self.storage

    def __exit__(self, *_: object) -> None:
        self.storage.close()


def _take(reader: Any, wanted: Any, topics: dict[str, Topic], counts: dict[str, Any]) -> None:
    """Give the messages of a bag to their topics."""
    waiting: dict[int, tuple[Topic, list[bytes], list[int]]] = {}
    for connection in reader.connections:
        counts[connection.topic] = (0, connection.msgcount)
        if wanted is None or connection.topic in wanted:
            encoding = getattr(connection.ext, "serialization_format", "ros1")
            topic = Topic(
                connection.topic,
                encoding,
                connection.msgtype,
                _definition(connection),
                None if wanted is None else wanted[connection.topic],
            )
            topics.setdefault(connection.topic, topic)
    used = [connection for connection in reader.connections if connection.topic in topics]
    for connection, stamp_ns, data in reader.messages(used or reader.connections):
        name = connection.topic
        counts[name] = (counts[name][0] + 1, counts[name][1])
        topic, payloads, stamps = waiting.setdefault(
            connection.id, (topics.get(name, Topic(name, "")), [], [])
        )
        payloads.append(bytes(data))
        stamps.append(stamp_ns)
        if len(stamps) == AT_ONCE:
            _add(topic, payloads, stamps)
            del waiting[connection.id]
    for topic, payloads, stamps in waiting.values():
        _add(topic, payloads, stamps)


def _add(topic: Topic, payloads: Sequence[bytes], stamps: Sequence[int]) -> None:
    lengths = np.array([len(payload) for payload in payloads], np.int64)
    starts = np.cumsum(lengths) - lengths
    topic.add(b"".join(payloads), starts, lengths, np.array(stamps, np.int64))


def _definition(connection: Any) -> bytes:
    """The definition of a topic's messages: the bag's own, or that of ROS 2 for standard types."""
    if connection.msgdef.data:
        return str(connection.msgdef.data).encode()
    library = optional_module("rosbags.typesys", "a bag without definitions")
    store = library.get_typestore(library.Stores.LATEST)
    if connection.msgtype not in store.types:
        raise InputError(
            f"the bag has no definition of type '{connection.msgtype}'; convert it with"
            " `ros2 bag convert` to MCAP"
        )
    return str(store.generate_msgdef(connection.msgtype, ros_version=2)[0]).encode()


def _begins(begin: bytes) -> bool:
    return begin.startswith((ROS1, SQLITE))


def _is_folder(path: Path) -> bool:
    return (path / DESCRIPTION).is_file()


def _files_in(path: Path) -> list[Path]:
    """A bag, or the files of its folder."""
    return (
        [path] if not path.is_dir() else [file for file in sorted(path.iterdir()) if file.is_file()]
    )


FORMAT = Format(
    name="rosbag",
    suffixes=(".bag", ".db3"),
    begins=_begins,
    source=MessageSource,
    read=read,
    is_folder=_is_folder,
    files_in=_files_in,
)
_ = mcap  # MCAP files of a folder are read by rosbags too
