"""Bags of ROS 1 (wiki.ros.org/Bags/Format/2.0) and of ROS 2 (a database of sqlite3), and the folders of recordings.

The library `rosbags` gives messages in the order of their times, so that a clock that was set back would not be seen,
and reads no bag whose recorder was killed. It is the judge in the tests, and has the definitions of standard types.
"""

import bz2
import re
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import lz4.frame
import numpy as np
import yaml
import zstandard
from mcap.records import Channel, Schema

from osl_analysis.errors import InputError, listing
from osl_analysis.formats import optional_module
from osl_analysis.formats.mcap import MAGIC as MCAP
from osl_analysis.formats.mcap import DamagedChunkError, Unpackers, read_mcap, unpacked
from osl_analysis.formats.message_fields import NOT_DEFINED, message_type
from osl_analysis.formats.messages import MessageBlock, MessageFile, RefusedFileError, SplitLog

BAG1 = b"#ROSBAG V2.0\n"
ANY_BAG1 = b"#ROSBAG V"
SQLITE = b"SQLite format 3\0"
MESSAGE_DATA, BAG, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 5, 6, 7
"""Kinds of records of a ROS 1 bag, by their field `op`."""
LENGTH = struct.Struct("<I")
BAG_UNPACKERS: Unpackers = {
    b"none": lambda packed, _: packed,
    b"bz2": lambda packed, _: bz2.BZ2Decompressor().decompress(packed),
    b"lz4": lambda packed, _: lz4.frame.LZ4FrameDecompressor().decompress(packed),
}
DESCRIPTION = "metadata.yaml"
"""The file beside the parts of a ROS 2 bag, which lists them, with how many messages each topic should have."""


# --- ROS 1


class BagRecord(NamedTuple):
    """One record: a header of named fields, and data."""

    fields: dict[bytes, bytes]
    start: int  # where its data begins [bytes]
    end: int

    @property
    def op(self) -> int:
        return self.number(b"op", 1, -1)

    def number(self, name: bytes, size: int = 4, default: int = 0) -> int:
        """An unsigned number in the header; `default` without one of this size."""
        value = self.fields.get(name, b"")
        return int.from_bytes(value, "little") if len(value) == size else default


def named_fields(data: bytes, start: int, end: int) -> dict[bytes, bytes]:
    fields = {}
    while start + LENGTH.size <= end:
        begin = start + LENGTH.size
        start = begin + LENGTH.unpack_from(data, start)[0]
        name, sign, value = data[begin:start].partition(b"=")
        if start > end or not sign:
            break
        fields[name] = value
    return fields


def record_at(data: bytes, position: int) -> BagRecord | None:
    """The record at a position; None if no whole record begins there."""
    head = position + LENGTH.size
    if head > len(data):
        return None
    body = head + LENGTH.unpack_from(data, position)[0]
    start = body + LENGTH.size
    if start > len(data) or (end := start + LENGTH.unpack_from(data, body)[0]) > len(data):
        return None
    return BagRecord(named_fields(data, head, body), start, end)


@dataclass
class Bag1(MessageFile):
    """A ROS 1 bag whose top level was scanned; `blocks` reads its messages. Every intact chunk is read."""

    data: bytes = b""
    sections: list[tuple[int, int, BagRecord | None]] = field(default_factory=list)
    """Start and end of its chunks and of unreadable stretches, in order, with the chunk's record."""
    counts: dict[int, Counter[int]] = field(default_factory=dict)
    """Messages of each connection in the chunk at a byte, as the bag's index says."""
    numbers: dict[int, int] = field(default_factory=dict)  # channel by number of a connection

    def scan(self) -> None:
        data, damage = self.data, self.damage
        head = record_at(data, len(BAG1))
        if head is None or head.op != BAG:
            raise InputError("the header of the bag is damaged; run `rosbag reindex` on a copy, or record again")
        if head.fields.get(b"encryptor"):
            raise InputError(f"the bag is encrypted ({head.fields[b'encryptor'][:40]!r}); run `rosbag decrypt` first")
        index = head.number(b"index_pos", 8)
        damage.finished = 0 < index <= len(data) and self.take_index(index, head)
        damage.bytes = (index if damage.finished else len(data)) - len(BAG1)
        if damage.finished:
            damage.declared = self.by_channel(sum(self.counts.values(), Counter()))
            damage.declared_messages = damage.declared.total()
            damage.declared_chunks = head.number(b"chunk_count")
        else:
            what = "whole index" if index else "index at its end"
            damage.remarks.append(f"no {what}: the recorder did not finish, or the end is lost; how much is not known")
        self.find_chunks(head.end, index if damage.finished else len(data))
        damage.gaps = any(record is None for *_, record in self.sections)

    def take_index(self, position: int, head: BagRecord) -> bool:
        """Take in the connections and chunks that the index lists; whether it is whole."""
        expected = head.number(b"conn_count"), head.number(b"chunk_count")
        connections, chunks = 0, 0
        while position < len(self.data):
            record = record_at(self.data, position)
            if record is None or record.op not in (CONNECTION, CHUNK_INFO):
                return False
            if record.op == CONNECTION:
                self.connect(self.data, record)
                connections += 1
            else:
                pairs = np.frombuffer(self.data, "<u4", (record.end - record.start) // 8 * 2, record.start)
                self.counts[record.number(b"chunk_pos", 8)] = Counter(dict(pairs.reshape(-1, 2).tolist()))
                chunks += 1
            position = record.end
        return (connections, chunks) == expected

    def find_chunks(self, position: int, end: int) -> None:
        """Find the chunks between two bytes. After bytes that are no record, the next chunk is where the index says."""
        while position < end:
            record = record_at(self.data, position)
            if record is not None and record.op >= 0 and record.end <= end:
                if record.op in (CHUNK, MESSAGE_DATA):
                    self.sections.append((position, record.end, record if record.op == CHUNK else None))
                elif record.op == CONNECTION:
                    self.connect(self.data, record)
                position = record.end
                continue
            if self.data.startswith(BAG1, position):
                text = f"two bags were joined: a second one begins at byte {position}; give each a file"
                raise RefusedFileError(text)
            after = min((at for at in self.counts if at > position), default=end)
            head = position + LENGTH.size  # a killed recorder leaves the beginning of a record
            length = LENGTH.unpack_from(self.data, position)[0] if head <= len(self.data) else 0
            begun = named_fields(self.data, head, min(head + length, len(self.data))).keys() & {
                b"op",
                b"compression",
                b"conn",
            }
            expected = not self.damage.finished and after == end and (begun or head > len(self.data))
            if not expected and self.data[position:after].strip(b"\0"):  # some writers leave room before the index
                self.sections.append((position, after, None))
            position = after

    def connect(self, data: bytes, record: BagRecord) -> None:
        """Take in a connection: a topic and the definition of its messages; raises RefusedFileError as `declare`."""
        number = self.numbers.setdefault(record.number(b"conn"), len(self.numbers))
        about = named_fields(data, record.start, record.end)
        name, text = (about.get(key, b"").decode(errors="replace") for key in (b"type", b"message_definition"))
        topic = record.fields.get(b"topic", b"").decode(errors="replace")
        self.declare(Schema(number + 1, text.encode(), "ros1msg", name))
        self.declare(Channel(number, topic, "ros1", {}, number + 1))

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages of every intact chunk, in the order of the file. Call it once."""
        for start, end, record in self.sections:
            if record is None:
                self.damage.lose(f"bytes {start} to {end} are no chunk of messages", end - start, None, 0)
                continue
            try:
                packed, name = self.data[record.start : record.end], record.fields.get(b"compression", b"")
                size = len(packed) if name == b"none" else record.number(b"size")
                block = self.block_of(unpacked(packed, name, size, BAG_UNPACKERS), start)
            except DamagedChunkError as error:
                lost = self.counts.get(start)
                text = f"the chunk at byte {start} is damaged: it {error}"
                self.damage.lose(text, end - start, lost and self.by_channel(lost), 1)
                continue
            self.damage.chunks += 1
            self.damage.read.update(block.counts)
            yield block

    def by_channel(self, counts: Counter[int]) -> Counter[int]:
        return Counter({self.numbers[one]: count for one, count in counts.items() if one in self.numbers})

    def block_of(self, content: bytes, start: int) -> MessageBlock:
        """The messages of an unpacked chunk that begins at `start`."""
        position, unknown, connections = 0, 0, []
        found: list[tuple[int, int, int, int]] = []  # connection, time, start and length of each message
        while position < len(content):
            record = record_at(content, position)
            if record is None:
                raise DamagedChunkError(f"holds no record at byte {position} of its {len(content)} bytes")
            if record.op == MESSAGE_DATA and len(record.fields.get(b"time", b"")) == 8 and b"conn" in record.fields:
                seconds, rest = struct.unpack("<II", record.fields[b"time"])
                time = seconds * 1_000_000_000 + rest
                found.append((record.number(b"conn"), time, record.start, record.end - record.start))
            elif record.op == CONNECTION:
                connections.append(record)
            else:
                unknown += 1
            position = record.end
        for record in connections:
            self.connect(content, record)
        if unknown:
            self.damage.remarks.append(f"{unknown} records of the chunk at byte {start} are of no known kind")
        connection, time, starts, lengths = np.array(found, np.int64).reshape(-1, 4).T
        strangers = set(connection.tolist()) - self.numbers.keys()
        if strangers:
            raise DamagedChunkError(f"has messages of connection {min(strangers)}, which is not declared")
        channel = np.array([self.numbers[one] for one in connection.tolist()], np.uint16)
        return MessageBlock(content, channel, np.zeros(channel.size, np.uint32), time, starts, lengths)


def read_bag1(path: Path) -> Bag1:
    """Scan a ROS 1 bag; its messages are read by `blocks`."""
    data = path.read_bytes()
    if not data.startswith(ANY_BAG1):
        raise InputError(
            f"{path}: not a ROS 1 bag (it begins with {data[:8]!r}); check the path and the source's format"
        )
    if not data.startswith(BAG1):
        version = data[: len(BAG1)].decode("latin1").strip()
        raise InputError(
            f"{path}: a bag that begins with {version!a}, not with version 2.0; convert it with `rosbag fix`"
        )
    bag = Bag1(path, len(data), data=data)
    try:
        bag.scan()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return bag


SPLIT_NAME = re.compile(r"(?P<name>.*)_(?P<number>\d+)\.bag(\.active)?")
"""How `rosbag record --split` names its files; the one that it was writing when it was killed is still `active`."""
DATE = re.compile(r"\d{4}(-\d\d){5}")  # when a file was begun, in its name; each has its own
ONE_BAG = "keep the files of one recording in the folder, or name one bag as the trial's log"


def split_parts(folder: Path) -> list[Path]:
    """The bags of one recording of ROS 1 in order; `rosbag record --max-splits` may have deleted earlier ones."""
    numbered, strangers, names = dict[int, Path](), [], set()
    bags = bags_in(folder)
    for path in bags:
        if part := SPLIT_NAME.fullmatch(path.name):
            numbered[int(part["number"])] = path
            names.add(DATE.sub("DATE", part["name"]))
        else:
            strangers.append(path.name)
    if strangers:
        raise InputError(
            f"{folder}: {listing(strangers)} cannot be a file of a split recording of ROS 1, which are called "
            f"NAME_0.bag, NAME_1.bag; {ONE_BAG}"
        )
    if len(names) > 1 or len(numbered) < len(bags):
        raise InputError(f"{folder}: files of several recordings ({listing([path.name for path in bags])}); {ONE_BAG}")
    missing = [f"{min(names)}_{one}.bag" for one in range(min(numbered), max(numbered)) if one not in numbered]
    if missing:
        raise InputError(
            f"{folder}: the file{'s' * (len(missing) > 1)} {listing(missing)} of the recording cannot be found; copy "
            "what is missing there, or name one bag as the trial's log"
        )
    return [numbered[one] for one in sorted(numbered)]


def bags_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.name.endswith((".bag", ".bag.active")))


def read_rosbag1(path: Path) -> MessageFile:
    """Open a bag, or the folder of a recording in several bags; InputError if one cannot be opened or is missing."""
    if not path.is_dir():
        return read_bag1(path)
    bags = [read_bag1(file) for file in split_parts(path)]
    log = SplitLog(path, sum(bag.size for bag in bags), parts=bags)
    begin = bags[0].path.name
    first = SPLIT_NAME.fullmatch(begin)
    if first and int(first["number"]) > 0:
        log.damage.remarks.append(f"the recording begins with '{begin}': its files before that are not here")
    return log


# --- ROS 2

REINDEX = "write it again with `ros2 bag reindex`, or name one file of the recording as the trial's log"
RECOVER = "save what it holds with `sqlite3 BAG .recover | sqlite3 NEW`, or record it again"
CONVERT = (
    "convert it with `ros2 bag convert` to MCAP where the type is installed, or record it with ROS 2 Iron or later"
)


class Description(NamedTuple):
    """What `metadata.yaml` says of a bag."""

    parts: tuple[str, ...]  # names of its files, in the order of recording, without their folder
    counts: Counter[str]  # messages of each topic in all parts
    distribution: str  # distribution of ROS that recorded it, such as `humble`; empty where it is not said
    is_packed: bool  # its files are compressed as a whole


def read_description(folder: Path) -> Description:
    """The description in a folder; raises InputError if there is none, or it is not what ROS 2 writes."""
    path = folder / DESCRIPTION
    if not path.is_file():
        raise InputError(f"{folder}: a folder without {DESCRIPTION}, which lists the parts of a bag; {REINDEX}")
    try:
        said = yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)["rosbag2_bagfile_information"]
        parts = tuple(Path(str(part)).name for part in said["relative_file_paths"])  # older ones begin with the folder
        if not parts or len(set(parts)) < len(parts):
            raise ValueError("relative_file_paths lists no file, or one twice")
        counts = Counter[str]()
        for topic in said["topics_with_message_count"]:
            counts[str(topic["topic_metadata"]["name"])] += int(topic["message_count"])
        mode = str(said.get("compression_mode") or "").lower() if said.get("compression_format") else ""
        is_packed = mode == "file" or any(name.endswith(".zstd") for name in parts)
        return Description(parts, counts, str(said.get("ros_distro") or ""), is_packed)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: no YAML ({' '.join(str(error).split())[:120]}); {REINDEX}") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: not the description of a ROS 2 bag ({error!s:.80}); {REINDEX}") from error


def described_parts(folder: Path) -> list[Path]:
    """The files of the ROS 2 bag in a folder, in the order of recording."""
    described = read_description(folder)
    missing = [name for name in described.parts if not (folder / name).is_file()]
    if described.is_packed:
        raise InputError(
            f"{folder}: its files are compressed as a whole ({listing(described.parts)}); unpack them with `zstd -d`, "
            "then run `ros2 bag reindex`"
        )
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(described.parts)} files that {DESCRIPTION} lists are missing "
            f"({listing(missing)}); copy them there, or name one file of the recording as the trial's log"
        )
    return [folder / name for name in described.parts]


def siblings(path: Path) -> tuple[Description | None, str]:
    """The description beside one file of a bag, if it lists the file; and a remark for the user, or an empty text."""
    try:
        described = read_description(path.parent)
    except InputError:
        return None, ""
    if path.name not in described.parts:
        return None, ""
    count, folder = len(described.parts), path.parent.name
    return described, f"one of the {count} files of a recording; name the folder '{folder}' to read all" * (count > 1)


def read_rosbag2(path: Path) -> MessageFile:
    """Open a database, or the folder of a recording in sqlite3 or MCAP; InputError if a part cannot be opened."""
    if not path.is_dir():
        return read_database(path)
    described = read_description(path)
    parts: list[MessageFile] = []
    for file in described_parts(path):
        begin = beginning(file)
        if begin.startswith(MCAP):
            parts.append(read_mcap(file))
        elif begin == SQLITE:
            parts.append(read_database(file, described))
            parts[-1].damage.finished = True  # its description is that of the whole
        else:
            raise InputError(
                f"{file}: neither a database of sqlite3 nor MCAP (it begins with {begin[:8]!r}); copy it again, or "
                "record again"
            )
    return SplitLog(path, sum(part.size for part in parts), parts=parts, counts=described.counts)


def beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(len(SQLITE))


@dataclass
class Database(MessageFile):
    """A bag in a database of sqlite3 (.db3), whose topics were read; `blocks` reads its messages."""

    numbers: dict[int, int] = field(default_factory=dict)  # channel by number of a topic in the database

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages in the order of recording. Call it once."""
        strangers = 0
        with opened(self.path) as connection:
            cursor = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
            while rows := cursor.fetchmany(1 << 14):
                for topic, time, data in rows:
                    if not (isinstance(topic, int) and isinstance(time, int) and isinstance(data, bytes)):
                        raise RefusedFileError(
                            f"{self.path}: a row of the table 'messages' holds {type(data).__name__} at {time!r:.40} "
                            f"and no message; {RECOVER}"
                        )
                known = [row for row in rows if row[0] in self.numbers]
                strangers += len(rows) - len(known)
                if known:
                    yield self.block(known)
        if strangers:
            self.damage.lose(f"{strangers} messages belong to topics that are not in the bag", 0, None, 0)

    def block(self, rows: list[tuple[int, int, bytes]]) -> MessageBlock:
        channel = np.array([self.numbers[topic] for topic, _, _ in rows], np.uint16)
        payloads = [data for _, _, data in rows]
        for place, data in enumerate(payloads):
            if data[:4] == b"\x28\xb5\x2f\xfd":  # compressed on its own; one in CDR begins with a zero byte
                with suppress(zstandard.ZstdError):  # a damaged one stays as it is, and is counted as no message
                    payloads[place] = zstandard.ZstdDecompressor().decompressobj().decompress(data)
        lengths, time = np.array([len(one) for one in payloads]), np.array([time for _, time, _ in rows], np.int64)
        none = np.zeros(len(rows), np.uint32)
        block = MessageBlock(b"".join(payloads), channel, none, time, np.cumsum(lengths) - lengths, lengths)
        self.damage.read.update(block.counts)
        return block


def read_database(path: Path, described: Description | None = None) -> Database:
    """Open a bag. `described` is the description of its recording; without it, the one beside it is used."""
    if (begin := beginning(path)) != SQLITE:
        raise InputError(f"{path}: not a bag in sqlite3 (it begins with {begin[:8]!r}); check the source's format")
    for ending, what in (("-wal", "a write-ahead log"), ("-journal", "a journal")):
        beside = path.with_name(path.name + ending)
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{path}: {what} is beside it ({beside.name}): the recorder did not finish, and messages are in there; "
                "copy both elsewhere, and run `sqlite3 COPY 'PRAGMA wal_checkpoint(TRUNCATE)'` there"
            )
    description, remark = siblings(path) if described is None else (described, "")
    bag = Database(path, path.stat().st_size)
    with opened(path) as connection:
        declare_topics(bag, connection, description.distribution if description else "")
    if remark:
        bag.damage.remarks.append(remark)
    elif description is None:
        bag.damage.remarks.append("no metadata.yaml beside it: how many messages were recorded is not known")
    elif described is None:
        bag.damage.finished = True
        bag.damage.declared = Counter({one.id: description.counts[one.topic] for one in bag.channels.values()})
        bag.damage.declared_messages = description.counts.total()
    return bag


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """A database, read-only and as it stands, so that sqlite writes no file beside it."""
    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as connection:
            yield connection
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
        said = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: the database is damaged or cut off ({said}); {RECOVER}") from error


def declare_topics(bag: Database, connection: sqlite3.Connection, distribution: str) -> None:
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")}
    needed = {
        "topics": {"id", "name", "type", "serialization_format"},
        "messages": {"id", "topic_id", "timestamp", "data"},
    }
    for table, columns in needed.items():
        if table not in tables:
            raise InputError(
                f"{bag.path}: a database without the table '{table}': no bag of ROS 2; name the bag itself"
            )
        lacking = sorted(columns - {str(row[1]) for row in connection.execute(f"PRAGMA table_info({table})")})
        if lacking:
            raise InputError(
                f"{bag.path}: its table '{table}' lacks {', '.join(lacking)}: no bag of ROS 2; name the bag itself"
            )
    own: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        own = {str(kind): (str(encoding), str(text)) for kind, encoding, text in connection.execute(query)}
    for topic in connection.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id"):
        number, name, kind, encoding = int(topic[0]), *map(str, topic[1:])
        channel = bag.numbers.setdefault(number, len(bag.numbers))
        definition, reason = definition_of(kind, own, distribution)
        if not reason:
            bag.declare(Schema(channel + 1, definition, "ros2msg", kind))
        metadata, schema = ({NOT_DEFINED: reason}, 0) if reason else ({}, channel + 1)
        bag.declare(Channel(id=channel, topic=name, message_encoding=encoding, metadata=metadata, schema_id=schema))


def definition_of(kind: str, own: Mapping[str, tuple[str, str]], distribution: str) -> tuple[bytes, str]:
    """The definition of messages of type `kind` (`package/msg/Name`), or why there is none and what to do.

    own: encoding and text of the definitions in the bag, which has them since ROS 2 Iron, by type. Without one,
    `rosbags` has those of the standard types.
    """
    encoding, text = own.get(kind, ("", ""))
    if encoding == "ros2msg" and text.strip():
        return text.encode(), ""
    if encoding == "ros2idl" and text.strip():
        return b"", f"type '{kind}' is defined in IDL, which is not read; {CONVERT}"
    lacking = f"the bag has no definition of type '{kind}'"
    try:
        library = optional_module("rosbags.typesys", "ros", "a bag without definitions of its messages")
    except InputError as error:
        return b"", f"{lacking}: {error}"
    stores = {store.name: library.get_typestore(store) for store in library.Stores if store.name.startswith("ROS2_")}
    stores = {name: store for name, store in stores.items() if kind in store.types}
    found = {name: str(store.generate_msgdef(kind, ros_version=2)[0]) for name, store in stores.items()}
    own_distribution = f"ROS2_{distribution.upper()}"
    if not found:
        return b"", f"{lacking}, which is no standard one; {CONVERT}"
    types = {repr(message_type(Schema(0, one.encode(), "", kind), ros1=False)) for one in found.values()}
    if own_distribution not in found and len(types) > 1:
        return b"", f"{lacking}, which differs between the distributions of ROS 2; {CONVERT}"
    return found.get(own_distribution, next(iter(found.values()))).encode(), ""


# --- a recording that is a folder


def folder_format(folder: Path) -> str:
    """Name of the format of the recording in a folder. What holds bags of ROS 1 and no description is of ROS 1."""
    return "rosbag1" if not (folder / DESCRIPTION).is_file() and bags_in(folder) else "rosbag2"


def files_in(folder: Path) -> list[Path]:
    """The files of the recording in a folder: all that a trial is made of."""
    if folder_format(folder) == "rosbag1":
        return split_parts(folder)
    if not (folder / DESCRIPTION).is_file():
        raise InputError(
            f"{folder}: a folder that is no ROS 2 bag (it has no `{DESCRIPTION}` that lists its files); name the "
            f"recording in it; {REINDEX}"
        )
    return [folder / DESCRIPTION, *described_parts(folder)]


def recorded_files(path: Path) -> list[Path]:
    """The files of a log, also where some are missing; a folder that is no recording stands for itself."""
    if not path.is_dir():
        return [path]
    try:
        if folder_format(path) == "rosbag1":
            return split_parts(path)
        return [path / DESCRIPTION, *(path / part for part in read_description(path).parts)]
    except InputError:
        return [path]
