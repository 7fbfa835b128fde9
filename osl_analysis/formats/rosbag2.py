"""Bags of ROS 2: a database of sqlite3, or the folder of a recording in sqlite3 or MCAP.

`rosbags` gives messages in the order of their times, which would hide a clock that was set back:
the database is read in the order of its rows. The library knows the definitions of standard
messages.
"""

import sqlite3
import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import yaml
import zstandard

from osl_analysis.errors import InputError, listing, naming, optional_module
from osl_analysis.formats import _messages, beginning, mcap
from osl_analysis.formats._cdr import definition_of
from osl_analysis.formats._messages import Container, Messages, Schema, Topic
from osl_analysis.recording import End, Format, Loss, Recording
from osl_analysis.source_file import MessageSource

DESCRIPTION = "metadata.yaml"
SQLITE = b"SQLite format 3\0"
DATABASE_HEAD = struct.Struct(">16xH10xI")  # page size, pages
LARGEST_PAGE = 65536  # bytes; written as 1
ZSTD = b"\x28\xb5\x2f\xfd"  # a message compressed on its own; one in CDR begins with a zero byte
ROWS_AT_ONCE = 1 << 14
REINDEX = "write it again with `ros2 bag reindex`, or name one file of the recording"
RECOVER = "save what it holds with `sqlite3 BAG .recover | sqlite3 NEW`, or record it again"
CONVERT = (
    "convert it with `ros2 bag convert` to MCAP where the type is installed, or record with ROS 2"
    " Iron or on"
)


class Bag(Container):
    """The parts of a bag that were read so far."""

    def __init__(self, wanted: Mapping[str, list[str]] | None) -> None:
        super().__init__(wanted)
        self.lost = 0  # messages that are known to be lost
        self.end = End.WHOLE
        self.checksums: set[str] = set()

    def take(self, path: Path) -> None:
        """Read a part."""
        begin = beginning(path)
        if begin.startswith(mcap.MAGIC):
            self._take_mcap(path)
        elif begin.startswith(SQLITE):
            _check_whole(path)
            address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"  # writes no file beside it
            try:
                with closing(sqlite3.connect(address, uri=True)) as connection:
                    self._take_database(connection)
            except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
                raise InputError(
                    f"no bag of ROS 2, or one that is damaged or cut off ({error}); {RECOVER}"
                ) from error
        else:
            raise InputError(
                "neither a database of sqlite3 nor MCAP; if it is packed as a whole, unpack it with"
                " `zstd -d`, then run `ros2 bag reindex`; else copy it again"
            )

    def _take_mcap(self, path: Path) -> None:
        log = mcap.Log(self.wanted)
        log.topics = self.topics  # a topic goes on from part to part
        log.take_file(path.read_bytes())
        loss = log.loss()
        for name, (read_count, _) in loss.by_topic.items():
            self.read[name] += read_count
        self.lost += loss.lost or 0
        self.chunks += log.chunks
        self.chunks_lost += log.chunks_lost
        self.checksums.add(loss.checksums)
        self.remarks += [f"{path.name}: {remark}" for remark in loss.remarks]
        if loss.end == End.MISSING:
            self.end = End.MISSING

    def _take_database(self, connection: sqlite3.Connection) -> None:
        """Read the messages of a database in the order of its rows."""
        topics = self._topics_in(connection)
        cursor = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        while rows := cursor.fetchmany(ROWS_AT_ONCE):
            payloads: dict[int, list[bytes]] = {number: [] for number in topics}
            times: dict[int, list[int]] = {number: [] for number in topics}
            for number, time_ns, data in rows:
                if number in topics and isinstance(time_ns, int) and isinstance(data, bytes):
                    payloads[number].append(_unpacked(data))
                    times[number].append(time_ns)
                else:
                    self.lost += 1
            for number, topic in topics.items():
                self._give(topic, payloads[number], times[number], number)
        self.checksums.add("absent")

    def _topics_in(self, connection: sqlite3.Connection) -> dict[int, Topic]:
        """The topics by their number in the database."""
        definitions: dict[str, tuple[str, str]] = {}
        query = "SELECT 1 FROM sqlite_schema WHERE name = 'message_definitions'"
        if connection.execute(query).fetchone():
            query = (
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
            for kind, encoding, text in connection.execute(query):
                definitions[str(kind)] = (str(encoding), str(text))
        topics: dict[int, Topic] = {}
        query = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        for number, name, kind, encoding in connection.execute(query):
            self.read[str(name)] += 0
            schema = Schema()
            undefined = ""
            if self.wanted is None or name in self.wanted:
                try:
                    text = _definition_of(str(kind), definitions)
                    schema = Schema(str(kind), "ros2msg", text.encode())
                except InputError as error:
                    undefined = str(error)
            topic = self.topic_of(str(name), str(encoding), schema, undefined)
            topics[number] = topic or Topic(str(name), str(encoding))
        return topics

    def _give(
        self, topic: Topic, payloads: Sequence[bytes], times_ns: Sequence[int], connection: int
    ) -> None:
        self.read[topic.name] += len(payloads)
        if payloads and (self.wanted is None or topic.name in self.wanted):
            lengths = np.array([len(payload) for payload in payloads], np.int64)
            starts = np.cumsum(lengths) - lengths
            log_times_ns = np.array(times_ns, np.int64)
            topic.add(Messages(b"".join(payloads), starts, lengths, log_times_ns, connection))

    def loss(self, counts: Counter[str] | None) -> Loss:
        """What was lost, by the messages of each topic that the description counts, if there is
        one."""
        read_count = self.read.total()
        checksums = self.checksums.pop() if len(self.checksums) == 1 else "mixed"
        remarks = [*self.remarks]
        if counts is None:
            by_topic: dict[str, tuple[int, int | None]] = {
                name: (count, None) for name, count in self.read.items()
            }
            expected = read_count + self.lost if self.lost else None
            if self.lost:
                remarks.append(f"{self.lost} messages hold no bytes, or belong to no topic")
            return Loss(read_count, expected, self.end, by_topic, checksums, remarks)
        if counts.total() != read_count:
            remarks.append(f"it declares {counts.total()} messages and holds {read_count}")
        elif self.end == End.MISSING:
            self.end = End.WHOLE  # only what stands behind the messages is missing
        by_topic = {name: (count, counts[name]) for name, count in self.read.items()}
        return Loss(read_count, counts.total(), self.end, by_topic, checksums, remarks)


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read a database, or the parts of a folder one after the other."""
    bag = Bag(_messages.wanted_fields(source))
    parts = [path]
    counts: Counter[str] | None = None
    if path.is_dir():
        parts, counts = _described(path)
    for part in parts:
        with naming(part):
            bag.take(part)
    size = sum(part.stat().st_size for part in parts)
    return bag.recording("rosbag2", size, bag.loss(counts), source)


def _described(folder: Path) -> tuple[list[Path], Counter[str]]:
    """The files of a recording in its order, and the messages of each topic in all of them.

    Raises
    ------
    InputError
        The description in the folder cannot be read, or files are missing.
    """
    path = folder / DESCRIPTION
    counts: Counter[str] = Counter()
    try:
        about = yaml.safe_load(path.read_bytes())["rosbag2_bagfile_information"]
        # older ones begin with the folder
        files = [folder / Path(str(name)).name for name in about["relative_file_paths"]]
        for topic in about["topics_with_message_count"]:
            counts[str(topic["topic_metadata"]["name"])] += int(topic["message_count"])
        if len(set(files)) < max(1, len(files)):
            raise ValueError("relative_file_paths lists no file, or one twice")
    except (yaml.YAMLError, RecursionError, LookupError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"{path}: not the description of a ROS 2 bag ({reason}); {REINDEX}"
        ) from error
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(files)} files that {DESCRIPTION} lists are"
            f" missing ({listing(missing)}); copy them there, or {REINDEX}"
        )
    return files, counts


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
            texts[repr(definition_of(kind, text, is_ros1=False))] = text
    if not texts:
        raise InputError(f"{lacking}, which is no standard one; {CONVERT}")
    if len(texts) > 1:
        raise InputError(f"{lacking}, which differs between the distributions of ROS 2; {CONVERT}")
    return texts.popitem()[1]


def _unpacked(data: bytes) -> bytes:
    if not data.startswith(ZSTD):
        return data
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError:
        return data  # a damaged one is no message, and counted so


def _check_whole(path: Path) -> None:
    """Refuse a database that is cut off, whose last page sqlite would fill up with zeros, and one
    with messages in a log of changes beside it."""
    for ending, what in (("-wal", "a write-ahead log"), ("-journal", "a journal")):
        beside = path.with_name(path.name + ending)
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{what} is beside it ({beside.name}): the recorder did not finish, and messages"
                " are in there; copy both elsewhere, and run `sqlite3 COPY 'PRAGMA"
                " wal_checkpoint(TRUNCATE)'` there"
            )
    head = beginning(path)[: DATABASE_HEAD.size].ljust(DATABASE_HEAD.size, b"\0")
    page, pages = DATABASE_HEAD.unpack(head)
    stated_size = (LARGEST_PAGE if page == 1 else page) * pages
    size = path.stat().st_size
    if size < stated_size:
        raise InputError(
            f"the database is cut off: it has {size} of its {stated_size} bytes; {RECOVER}"
        )


def _begins(begin: bytes) -> bool:
    return begin.startswith(SQLITE)


def _is_folder(path: Path) -> bool:
    return (path / DESCRIPTION).is_file()


def _files_in(path: Path) -> list[Path]:
    """The description of a folder and the files that it lists."""
    return [path / DESCRIPTION, *_described(path)[0]] if path.is_dir() else [path]


FORMAT = Format(
    name="rosbag2",
    suffixes=(".db3",),
    begins=_begins,
    source=MessageSource,
    read=read,
    is_folder=_is_folder,
    files_in=_files_in,
)
