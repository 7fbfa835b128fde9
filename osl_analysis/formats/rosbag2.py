"""Bags of ROS 2: a database of sqlite3, or the folder of a recording in sqlite3 or MCAP.

`rosbags` gives messages in the order of their times, which would hide a clock that was set back:
the database is read in the order of its rows. The library knows the definitions of standard
messages.
"""

import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

from osl_analysis.errors import InputError, naming, optional_module, quoted
from osl_analysis.formats import _messages, mcap
from osl_analysis.formats._bag_description import (
    DESCRIPTION,
    Description,
    description_beside,
    read_description,
)
from osl_analysis.formats._messages import Messages, Schema, Topic
from osl_analysis.formats._ros_shapes import message_type
from osl_analysis.recording import End, Format, Loss, Recording
from osl_analysis.source_file import MessageSource

SQLITE = b"SQLite format 3\0"
# page size, counter of changes, pages, counter at which the pages were counted
DATABASE_HEAD = struct.Struct(">16xH6xII60xI4x")
LARGEST_PAGE = 65536  # bytes; written as 1
ZSTD = b"\x28\xb5\x2f\xfd"  # a message compressed on its own; one in CDR begins with a zero byte
ROWS_AT_ONCE = 1 << 14
RECOVER = "save what it holds with `sqlite3 BAG .recover | sqlite3 NEW`, or record it again"
CONVERT = (
    "convert it with `ros2 bag convert` to MCAP where the type is installed, or record with ROS 2"
    " Iron or on"
)


@dataclass
class Bag:
    """The parts of a bag that were read so far."""

    wanted: Mapping[str, list[str]] | None
    topics: dict[Any, Topic] = field(default_factory=dict)  # by name, encoding and schema
    names: set[str] = field(default_factory=set)  # of all topics
    read: Counter[str] = field(default_factory=Counter)  # messages by topic
    lost: int = 0  # messages that are known to be lost
    chunks: int = 0
    chunks_lost: int = 0
    end: End = End.WHOLE
    checksums: set[str] = field(default_factory=set)
    remarks: list[str] = field(default_factory=list)

    def topic(self, topic: Topic) -> Topic:
        """The topic of this name and type, which goes on in the next part."""
        return self.topics.setdefault((topic.name, topic.encoding, topic.schema), topic)


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read a database, or the parts of a folder one after the other."""
    bag = Bag(_messages.wanted_fields(source))
    description: Description | None
    if path.is_dir():
        description = read_description(path)
        parts = description.files
    else:
        description, remark = description_beside(path)
        parts = [path]
        if description is None:
            bag.remarks.append(
                remark
                or f"no {DESCRIPTION} beside it: how many messages were recorded is not known"
            )
    for part in parts:
        _read_part(part, bag, is_one_of_several=len(parts) > 1)
    facts = {
        "bytes": sum(part.stat().st_size for part in parts),
        "chunks": bag.chunks,
        "chunks_lost": bag.chunks_lost,
        "messages": bag.read.total(),
    }
    loss = _loss_of(bag, description)
    topics = list(bag.topics.values())
    return _messages.recording_of("rosbag2", topics, bag.names, loss, facts, source)


def _read_part(path: Path, bag: Bag, is_one_of_several: bool) -> None:
    with path.open("rb") as file:
        begin = file.read(len(SQLITE))
    with naming(path):
        if begin.startswith(mcap.MAGIC):
            remarks = _read_mcap(path, bag)
        elif begin == SQLITE:
            remarks = _read_database(path, bag)
        else:
            raise InputError(
                f"neither a database of sqlite3 nor MCAP (it begins with {quoted(begin[:8])}); if"
                " it is packed as a whole, unpack it with `zstd -d`, then run `ros2 bag reindex`;"
                " else copy it again"
            )
    if is_one_of_several:
        remarks = [f"{path.name}: {remark}" for remark in remarks]
    bag.remarks += remarks


def _read_mcap(path: Path, bag: Bag) -> Sequence[str]:
    log = mcap.read_log(path, bag.wanted, bag.topics)
    loss = log.loss()
    for name, (read, _) in loss.by_topic.items():
        bag.names.add(name)
        bag.read[name] += read
    bag.lost += loss.lost or 0
    bag.chunks += log.chunks
    bag.chunks_lost += log.chunks_lost
    bag.checksums.add(loss.checksums)
    if loss.end == End.MISSING:
        bag.end = End.MISSING
    return loss.remarks


def _loss_of(bag: Bag, description: Description | None) -> Loss:
    """What was lost, by the description, or else as far as the parts tell."""
    read = bag.read.total()
    checksums = bag.checksums.pop() if len(bag.checksums) == 1 else "mixed"
    if description is None:
        by_topic = {name: (bag.read[name], None) for name in sorted(bag.names)}
        expected = read + bag.lost if bag.lost else None
        return Loss(read, expected, bag.end, by_topic, checksums, bag.remarks)
    expected = description.counts.total()
    if expected != read:
        bag.remarks.append(f"it declares {expected} messages and holds {read}")
    elif bag.end == End.MISSING:
        bag.end = End.WHOLE  # only what stands behind the messages is missing
    counts = {name: (bag.read[name], description.counts[name]) for name in sorted(bag.names)}
    return Loss(read, expected, bag.end, counts, checksums, bag.remarks)


def _read_database(path: Path, bag: Bag) -> Sequence[str]:
    """Read the messages of a database in the order of its rows."""
    _check_beside(path)
    remarks = _check_size(path)
    with _opened(path) as connection:
        topics = _topics_in(connection, bag)
        cursor = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        strangers = 0
        rows = cursor.fetchmany(ROWS_AT_ONCE)
        while rows:
            strangers += _take_rows(rows, topics, bag)
            rows = cursor.fetchmany(ROWS_AT_ONCE)
    bag.checksums.add("absent")
    if strangers:
        bag.lost += strangers
        remarks.append(f"{strangers} messages hold no bytes, or belong to no topic of the bag")
    return remarks


def _topics_in(connection: sqlite3.Connection, bag: Bag) -> dict[int, Topic]:
    """The topics by their number in the database."""
    has_definitions = connection.execute(
        "SELECT 1 FROM sqlite_schema WHERE name = 'message_definitions'"
    ).fetchone()
    definitions: dict[str, tuple[str, str]] = {}
    if has_definitions:
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        for kind, encoding, text in connection.execute(query):
            definitions[str(kind)] = (str(encoding), str(text))
    topics: dict[int, Topic] = {}
    query = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
    for number, name, kind, encoding in connection.execute(query):
        if not isinstance(number, int):
            raise InputError(f"topic '{name}' has no number: the database is damaged; {RECOVER}")
        topic = Topic(str(name), str(encoding))
        bag.names.add(topic.name)
        if bag.wanted is not None:
            topic.wanted = bag.wanted.get(topic.name, [])
        if bag.wanted is None or topic.name in bag.wanted:
            try:
                text = _definition_of(str(kind), definitions)
                topic.schema = Schema(str(kind), "ros2msg", text.encode())
            except InputError as error:
                topic.undefined = str(error)
            topic = bag.topic(topic)
        topics[number] = topic
    return topics


def _take_rows(rows: Sequence[Any], topics: Mapping[int, Topic], bag: Bag) -> int:
    """Add messages to their topics; gives the number of those that belong to none."""
    payloads: dict[int, list[bytes]] = {}
    times: dict[int, list[int]] = {}
    strangers = 0
    for number, time_ns, data in rows:
        if number not in topics or not isinstance(time_ns, int) or not isinstance(data, bytes):
            strangers += 1
            continue
        payloads.setdefault(number, []).append(_unpacked(data))
        times.setdefault(number, []).append(time_ns)
    for number, of_topic in payloads.items():
        topic = topics[number]
        bag.read[topic.name] += len(of_topic)
        if bag.wanted is not None and topic.name not in bag.wanted:
            continue
        lengths = np.array([len(payload) for payload in of_topic], np.int64)
        starts = np.cumsum(lengths) - lengths
        topic.add(Messages(b"".join(of_topic), starts, lengths, np.array(times[number], np.int64)))
    return strangers


def _unpacked(data: bytes) -> bytes:
    if not data.startswith(ZSTD):
        return data
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError:
        return data  # a damaged one is no message, and counted so


def _definition_of(kind: str, definitions: Mapping[str, tuple[str, str]]) -> str:
    """The definition of messages of a type (`package/msg/Name`).

    Parameters
    ----------
    definitions
        Encoding and text by type, as bags have them since ROS 2 Iron. `rosbags` has those of the
        standard types.

    Raises
    ------
    InputError
        There is none, or one that differs between distributions of ROS 2.
    """
    encoding, text = definitions.get(kind, ("", ""))
    if encoding == "ros2msg" and text.strip():
        return text
    if encoding == "ros2idl" and text.strip():
        raise InputError(f"type '{kind}' is defined in IDL, which is not read; {CONVERT}")
    lacking = f"the bag has no definition of type '{kind}'"
    with naming(lacking):
        library = optional_module("rosbags.typesys", "a bag without definitions of its messages")
    texts: dict[str, str] = {}  # by what they mean: comments differ
    for store_name in library.Stores:
        if not store_name.name.startswith("ROS2_"):
            continue
        store = library.get_typestore(store_name)
        if kind in store.types:
            text = str(store.generate_msgdef(kind, ros_version=2)[0])
            texts[repr(message_type(kind, text, is_ros1=False))] = text
    if not texts:
        raise InputError(f"{lacking}, which is no standard one; {CONVERT}")
    if len(texts) > 1:
        raise InputError(f"{lacking}, which differs between the distributions of ROS 2; {CONVERT}")
    return texts.popitem()[1]


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a database read-only and as it stands, so that sqlite writes no file beside it."""
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as connection:
            yield connection
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:120]
        if "no such" in reason:
            raise InputError(
                f"a database of something else ({reason}): no bag of ROS 2; name the bag itself"
            ) from error
        raise InputError(f"the database is damaged or cut off ({reason}); {RECOVER}") from error


def _check_beside(path: Path) -> None:
    """Refuse a database with a log of changes beside it: messages are in there."""
    for ending, what in (("-wal", "a write-ahead log"), ("-journal", "a journal")):
        beside = path.with_name(path.name + ending)
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{what} is beside it ({beside.name}): the recorder did not finish, and messages"
                " are in there; copy both elsewhere, and run `sqlite3 COPY 'PRAGMA"
                " wal_checkpoint(TRUNCATE)'` there"
            )


def _check_size(path: Path) -> list[str]:
    """Refuse a database that is cut off: sqlite would fill up the last page with zeros."""
    with path.open("rb") as file:
        head = file.read(DATABASE_HEAD.size).ljust(DATABASE_HEAD.size, b"\0")
    page, changes, pages, counted_at = DATABASE_HEAD.unpack(head)
    size = path.stat().st_size
    if changes != counted_at:
        return []  # an old sqlite wrote it, and did not count
    stated_size = (LARGEST_PAGE if page == 1 else page) * pages
    if size < stated_size:
        raise InputError(
            f"the database is cut off: it has {size} of its {stated_size} bytes; {RECOVER}"
        )
    if 0 < stated_size < size:
        return [f"{size - stated_size} bytes stand behind its pages, and are not read"]
    return []


def _begins(begin: bytes) -> bool:
    return begin.startswith(SQLITE)


def _is_folder(path: Path) -> bool:
    return (path / DESCRIPTION).is_file()


def _files_in(path: Path) -> list[Path]:
    """The description of a folder and the files that it lists, as far as they are there."""
    if not path.is_dir():
        return [path]
    files = read_description(path, is_whole=False).files
    return [path / DESCRIPTION, *files]


FORMAT = Format(
    name="rosbag2",
    suffixes=(".db3",),
    begins=_begins,
    source=MessageSource,
    read=read,
    is_folder=_is_folder,
    files_in=_files_in,
)
