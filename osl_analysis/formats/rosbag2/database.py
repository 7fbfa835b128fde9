"""A ROS 2 bag in a database of sqlite3 (.db3), read in the order of recording.

It is opened read-only and as it stands, so that sqlite writes no file beside it. What is not in the database yet, in a
write-ahead log beside it, would be missed: such a bag is refused.
"""

import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.channel_reader import NOT_DEFINED
from osl_analysis.formats.mcap.chunk import MessageBlock
from osl_analysis.formats.mcap.damage import Damage
from osl_analysis.formats.mcap.declared import Declared
from osl_analysis.formats.mcap.limits import Budget, RefusedFileError
from osl_analysis.formats.rosbag2.definitions import NoDefinitionError, definition_of
from osl_analysis.formats.rosbag2.metadata import Metadata, siblings

MAGIC = b"SQLite format 3\0"
ZSTD = b"\x28\xb5\x2f\xfd"
"""How a compressed message begins. One in CDR begins with a zero byte."""
LARGEST_MESSAGE = 1 << 26
"""Bytes of one message, and of any other value in the database."""
AT_ONCE = 1 << 14
"""Messages of a block."""
LARGEST_BLOCK = 1 << 24
"""Bytes after which a block ends."""
RECOVER = "save what it holds with `sqlite3 BAG .recover | sqlite3 NEW`, or record it again"
REMEDY = "convert it with `ros2 bag convert` to the topics that you need, if you trust it"
COLUMNS = {
    "topics": {"id", "name", "type", "serialization_format"},
    "messages": {"id", "topic_id", "timestamp", "data"},
}
"""Tables of a bag, with the columns that are read."""


@dataclass
class Database:
    """A bag whose topics were read; `blocks` reads its messages."""

    path: Path
    """Where the file is."""
    budget: Budget
    """What may still be read."""
    metadata: Metadata | None = None
    """The description of the bag, if it lies beside it."""
    numbers: dict[int, int] = field(default_factory=dict)
    """Channel by number of a topic in the database."""
    declared: Declared = field(default_factory=Declared)
    """Its topics as channels, and their message definitions."""
    damage: Damage = field(default_factory=Damage)
    """Losses; complete once the blocks are read."""
    kind: str = "bag"
    """What it is, for messages."""

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages in the order of recording. Call it once.

        Raises
        ------
        InputError
            The database is damaged, holds something else than messages, or unpacks to more than is allowed.
        """
        try:
            with closing(opened(self.path)) as connection:
                rows = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
                while block := self.block(rows):
                    yield block
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
            raise unreadable(self.path, error) from error

    def block(self, rows: sqlite3.Cursor) -> MessageBlock | None:
        """The next messages; None after the last one."""
        channels, times, parts, size = [], [], [], 0
        for topic, time, data in rows:
            if not (isinstance(topic, int) and isinstance(time, int) and isinstance(data, bytes)):
                raise RefusedFileError(
                    f"{self.path}: a row of the table 'messages' holds {type(data).__name__} at {time!r:.40} and no "
                    f"message; {RECOVER}"
                )
            if topic not in self.numbers:
                self.damage.misfits[-1] += 1
                continue
            part = self.unpacked(data) if data[:4] == ZSTD else data
            channels.append(self.numbers[topic])
            times.append(time)
            parts.append(part)
            size += len(part)
            if len(parts) >= AT_ONCE or size > LARGEST_BLOCK:
                break
        if not parts:
            self.settle()
            return None
        self.budget.take_records(0, len(parts))
        self.budget.take_bytes(size)
        lengths = np.array([len(part) for part in parts], np.int64)
        channel = np.array(channels, np.uint16)
        self.damage.read.update(Counter(channels))
        none = np.zeros(channel.size, np.uint32)
        return MessageBlock(
            b"".join(parts), channel, none, np.array(times, np.int64), np.cumsum(lengths) - lengths, lengths
        )

    def unpacked(self, data: bytes) -> bytes:
        """A message that was compressed on its own."""
        try:
            size = zstandard.get_frame_parameters(data).content_size
            if size == zstandard.CONTENTSIZE_UNKNOWN:
                content = zstandard.ZstdDecompressor().stream_reader(data).read(LARGEST_MESSAGE + 1)
                self.budget.take_chunk(0, len(data), len(content))
                return bytes(content)
            self.budget.take_chunk(0, len(data), size)
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        except zstandard.ZstdError:
            return data  # it is no message in CDR then, which is counted where it is decoded

    def settle(self) -> None:
        """Note what the whole bag tells once all of it was read."""
        strangers = self.damage.misfits.pop(-1, 0)
        if strangers:
            self.damage.lose(f"{strangers} messages belong to topics that are not in the bag", 0, None, 0)


def read_database(path: Path, described: Metadata | None = None) -> Database:
    """Open a bag; its messages are read by `blocks`.

    described: the description of the recording that it is a part of; without it, the one beside it is used.

    Raises
    ------
    InputError
        It is no database, no bag, damaged, or still has a write-ahead log or a journal.
    """
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
    if begin != MAGIC:
        raise InputError(f"{path}: not a bag in sqlite3 (it begins with {begin[:8]!r}); check the source's format")
    for ending, what in (("-wal", "a write-ahead log"), ("-journal", "a journal")):
        beside = path.with_name(path.name + ending)
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{path}: {what} is beside it ({beside.name}): the recorder did not finish, and messages are in there; "
                "copy both elsewhere, and run `sqlite3 COPY 'PRAGMA wal_checkpoint(TRUNCATE)'` there"
            )
    metadata, remark = siblings(path) if described is None else (described, "")
    bag = Database(path, Budget(path.stat().st_size, remedy=REMEDY), metadata)
    try:
        with closing(opened(path)) as connection:
            check_tables(path, connection)
            declare_topics(bag, connection)
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
        raise unreadable(path, error) from error
    if remark:
        bag.damage.remark(remark)
    elif described is None:
        expect(bag.damage, bag.declared, metadata)
    return bag


def expect(damage: Damage, declared: Declared, metadata: Metadata | None) -> None:
    """Note how many messages a whole recording should have; without its description nobody knows."""
    damage.finished = metadata is not None
    if metadata is None:
        damage.remark("no metadata.yaml beside it: how many messages were recorded is not known")
        return
    by_channel = {channel.id: metadata.counts[channel.topic] for channel in declared.channels.values()}
    damage.declared = Counter(by_channel)
    damage.declared_messages = metadata.counts.total()


def opened(path: Path) -> sqlite3.Connection:
    """The database, read-only, with limits on what one value may be."""
    connection = sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1", uri=True)
    try:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_MESSAGE)
        connection.execute("PRAGMA trusted_schema = OFF")
    except sqlite3.Error:  # where the file is no whole database, the first statement fails
        connection.close()
        raise
    return connection


def check_tables(path: Path, connection: sqlite3.Connection) -> None:
    """Refuse a database that is no bag. A view or a virtual table could hold anything, without end."""
    found = {}
    for kind, name, text in connection.execute("SELECT type, name, sql FROM sqlite_schema"):
        if kind == "table" and name in COLUMNS and str(text).upper().startswith("CREATE TABLE"):
            described = connection.execute(f"PRAGMA table_xinfo({name})").fetchall()
            found[name] = {str(column[1]) for column in described if not column[6]}  # without computed columns
    for name, columns in COLUMNS.items():
        if name not in found:
            raise InputError(f"{path}: a database without the table '{name}': no bag of ROS 2; name the bag itself")
        if not columns <= found[name]:
            lacking = ", ".join(sorted(columns - found[name]))
            raise InputError(f"{path}: its table '{name}' lacks {lacking}: no bag of ROS 2; name the bag itself")


def declare_topics(bag: Database, connection: sqlite3.Connection) -> None:
    """Take in the topics, with the definitions of their messages."""
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")}
    own: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        own = {str(kind): (str(encoding), str(text)) for kind, encoding, text in connection.execute(query)}
    distribution = bag.metadata.distribution if bag.metadata else ""
    for topic in connection.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id LIMIT 65535"):
        number, name, kind, encoding = int(topic[0]), *map(str, topic[1:])
        channel = bag.numbers.setdefault(number, len(bag.numbers))
        metadata, schema = {}, 0
        try:
            definition = definition_of(kind, own, distribution)
            schema = channel + 1
            bag.declared.take(Opcode.SCHEMA, Schema(schema, definition, "ros2msg", kind), provisional=False)
        except NoDefinitionError as error:
            metadata = {NOT_DEFINED: str(error)}
        one = Channel(id=channel, topic=name, message_encoding=encoding, metadata=metadata, schema_id=schema)
        bag.declared.take(Opcode.CHANNEL, one, provisional=False)


def unreadable(path: Path, error: Exception) -> InputError:
    """The error for a database that sqlite cannot read."""
    return InputError(f"{path}: the database is damaged or cut off ({' '.join(str(error).split())[:120]}); {RECOVER}")
