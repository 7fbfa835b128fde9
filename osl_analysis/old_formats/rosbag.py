"""Bags of ROS 1 (by the library `rosbags`) and of ROS 2 (a database of sqlite3), and the folders of
recordings.

The library sorts messages by their times, which would hide a clock that was set back; its index
tells their places."""

import sqlite3
import struct
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

import numpy as np
import yaml
import zstandard
from mcap.records import Channel, Schema

from osl_analysis.errors import InputError, listing, naming, optional_module, quoted
from osl_analysis.old_formats.mcap import MAGIC as MCAP
from osl_analysis.old_formats.mcap import read_mcap
from osl_analysis.old_formats.message_fields import NOT_DEFINED, message_type, numbers_at, short_name
from osl_analysis.old_formats.messages import MessageBlock, MessageFile, joined_parts
from osl_analysis.old_formats.table import reason_of

BAG1 = b"#ROSBAG V2.0\n"
ANY_BAG1 = b"#ROSBAG V"
SQLITE = b"SQLite format 3\0"
# beside the parts of a ROS 2 bag: lists them, and how many messages each topic has
DESCRIPTION = "metadata.yaml"


def read_rosbag1(path: Path) -> MessageFile:
    """Read the index of a ROS 1 bag, and then every intact chunk. InputError if it has none or
    cannot be read."""
    data = path.read_bytes()
    if not data.startswith(BAG1):
        advice = "convert an older one with `rosbag fix`, or check the source's format"
        raise InputError(
            f"{path}: not a ROS 1 bag of version 2.0 (it begins with {quoted(data[:12])}); {advice}"
        )
    if (second := data.find(BAG1, 1)) > 0:
        raise InputError(
            f"{path}: two bags were joined: a second one begins at byte {second}; give each a file"
        )
    library = optional_module("rosbags.rosbag1", "a bag of ROS 1")
    bag, number_of = MessageFile(path, len(data)), dict[int, int]()
    # of each message of the chunk at a byte: place in the chunk, channel and time [ns]
    index: dict[int, list[tuple[int, int, int]]] = defaultdict(list)
    try:
        with library.Reader(path) as reader:
            for number, one in enumerate(reader.connections):
                number_of[one.id] = number
                kind = short_name(one.msgtype)
                bag.declare(
                    Schema(
                        id=number + 1, data=one.msgdef.data.encode(), encoding="ros1msg", name=kind
                    )
                )
                bag.declare(Channel(number, one.topic, "ros1", {}, number + 1))
                for entry in reader.indexes[one.id]:
                    index[entry.chunk_pos].append((entry.offset, number, entry.time))
            every = [(one.pos, one.connection_counts.items()) for one in reader.chunk_infos]
            counts = {at: Counter({number_of[k]: n for k, n in own}) for at, own in every}
            chunks = sorted((at, *one) for at, one in reader.chunks.items())
    except MemoryError:
        raise
    # on a damaged file the library raises whatever its parser comes across
    except Exception as error:
        remedy = (
            "run `rosbag decrypt` first"
            if "encryption" in str(error)
            else "run `rosbag reindex` on a copy"
        )
        said = (
            f"{path}: no bag with a whole index: the recorder did not finish, or the bag is damaged"
        )
        raise InputError(f"{said}; {remedy}, or record again") from error
    damage = bag.damage
    damage.bytes, damage.declared_chunks = len(data) - len(BAG1), len(chunks)
    damage.declared = sum(counts.values(), Counter())
    damage.expected = damage.declared.total()

    def blocks() -> Iterator[MessageBlock]:
        for at, size, start, unpack in chunks:
            try:
                content = unpack(data[start : start + size])
                places, channel, time = np.array(sorted(index[at]), np.int64).reshape(-1, 3).T
                if np.unique(places).size < places.size:
                    raise ValueError("its index names a message twice")
                # each behind a head of its own
                bodies = places + 4 + numbers_at(content, places, np.dtype("<u4"))
                lengths = numbers_at(content, bodies, np.dtype("<u4")).astype(np.int64)
                if (bodies + 4 + lengths > len(content)).any():
                    raise ValueError(f"a message reaches beyond its {len(content)} bytes")
            except (OSError, RuntimeError, ValueError, IndexError, EOFError) as error:
                damage.lose(
                    f"the chunk at byte {at} is damaged: {reason_of(error)}", size, counts[at], 1
                )
                continue
            none = np.zeros(channel.size, np.uint32)
            block = MessageBlock(
                content, channel.astype(np.uint16), none, time, bodies + 4, lengths
            )
            damage.chunks += 1
            damage.read.update(block.counts)
            yield block

    bag.blocks = blocks()
    return bag


REINDEX = (
    "write it again with `ros2 bag reindex`, or name one file of the recording as the trial's log"
)


def read_description(folder: Path, *, whole: bool = True) -> tuple[list[Path], Counter[str]]:
    """The files of the recording in a folder, in its order, and the messages of each topic in all
    of them, as its description says; InputError if it has none, or one not of a `whole` recording
    that can be read."""
    path = folder / DESCRIPTION
    if not path.is_file():
        what = f"{folder}: a folder without {DESCRIPTION}, which lists the files of a ROS 2 bag"
        raise InputError(f"{what}; name the recording in it, or {REINDEX}")
    try:
        text = path.read_bytes()
        if any(
            isinstance(one, yaml.AliasToken) for one in yaml.scan(text, Loader=yaml.CSafeLoader)
        ):
            # a few nested ones would fill the memory
            raise ValueError("it has aliases, which no recorder writes")
        said = yaml.load(text, Loader=yaml.CSafeLoader)["rosbag2_bagfile_information"]
        # older ones begin with the folder
        names = [Path(str(part)).name for part in said["relative_file_paths"]]
        if not names or len(set(names)) < len(names):
            raise ValueError("relative_file_paths lists no file, or one twice")
        counts = Counter[str]()
        for topic in said["topics_with_message_count"]:
            counts[str(topic["topic_metadata"]["name"])] += int(topic["message_count"])
    except (
        yaml.YAMLError,
        RecursionError,
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
    ) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"{path}: not the description of a ROS 2 bag ({reason}); {REINDEX}"
        ) from error
    missing = [name for name in names if not (folder / name).is_file()]
    if whole and missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(names)} files that {DESCRIPTION} lists are"
            f" missing ({listing(missing)}); copy them there, or name one file of the recording as"
            " the trial's log"
        )
    return [folder / name for name in names], counts


def siblings(path: Path) -> tuple[list[Path], Counter[str], str]:
    """What the description beside one file of a bag says, if it lists the file; and a remark for
    the user, if any."""
    with suppress(InputError):
        files, counts = read_description(path.parent, whole=False)
        if path in files:
            remark = (
                f"one of the {len(files)} files of a recording; name the folder"
                f" '{path.parent.name}' to read all"
            )
            return files, counts, remark * (len(files) > 1)
    return [], Counter(), ""


def read_rosbag2(path: Path) -> MessageFile:
    """Open a database, or the folder of a recording in sqlite3 or MCAP; InputError if a part cannot
    be opened."""
    files, counts, remark = (*read_description(path), "") if path.is_dir() else siblings(path)
    if not files or remark:
        bag = read_database(path)
        nothing = f"no {DESCRIPTION} beside it: how many messages were recorded is not known"
        bag.damage.remarks.append(remark or nothing)
        bag.damage.uncounted = True
        return bag
    parts: list[MessageFile] = []
    for file in files:
        begin = beginning(file)
        if begin.startswith(MCAP):
            parts.append(read_mcap(file))
        elif begin == SQLITE:
            parts.append(read_database(file))
        else:
            raise InputError(
                f"{file}: neither a database of sqlite3 nor MCAP (it begins with"
                f" {quoted(begin[:8])}); if it is packed as a whole, unpack it with `zstd -d`, then"
                " run `ros2 bag reindex`; else copy it again"
            )
    return joined_parts(path, parts, counts)


def beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(len(SQLITE))


RECOVER = "save what it holds with `sqlite3 BAG .recover | sqlite3 NEW`, or record it again"


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """A database, read-only and as it stands, so that sqlite writes no file beside it."""
    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as connection:
            yield connection
    except (sqlite3.Error, OverflowError, TypeError, UnicodeDecodeError) as error:
        said = (
            "a number is missing"
            if isinstance(error, TypeError)
            else " ".join(str(error).split())[:120]
        )
        if "no such" in said:
            what = f"{path}: a database of something else ({said}): no bag of ROS 2"
            raise InputError(f"{what}; name the bag itself") from error
        raise InputError(
            f"{path}: the database is damaged or cut off ({said}); {RECOVER}"
        ) from error


def read_database(path: Path) -> MessageFile:
    if (begin := beginning(path)) != SQLITE:
        said = f"{path}: not a bag in sqlite3 (it begins with {quoted(begin[:8])})"
        raise InputError(f"{said}; check the source's format")
    for ending, what in (("-wal", "a write-ahead log"), ("-journal", "a journal")):
        beside = path.with_name(path.name + ending)
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{path}: {what} is beside it ({beside.name}): the recorder did not finish, and"
                " messages are in there; copy both elsewhere, and run `sqlite3 COPY 'PRAGMA"
                " wal_checkpoint(TRUNCATE)'` there"
            )
    with path.open("rb") as file:
        page, changes, pages, counted_at = struct.unpack(
            ">16xH6xII60xI4x", file.read(100).ljust(100, b"\0")
        )
    bag, own = MessageFile(path, path.stat().st_size), dict[str, tuple[str, str]]()
    # else written by an old sqlite
    declared = (65536 if page == 1 else page) * pages * (changes == counted_at)
    if bag.size < declared:  # sqlite would fill up the last page with zeros
        raise InputError(
            f"{path}: the database is cut off: it has {bag.size} of its {declared} bytes; {RECOVER}"
        )
    channel_of: dict[int, int] = {}  # channel by number of a topic in the database
    if 0 < declared < bag.size:
        bag.damage.lose(
            f"{bag.size - declared} bytes stand behind its pages, and are not read", 0, None, 0
        )
    with opened(path) as connection:
        if connection.execute(
            "SELECT 1 FROM sqlite_schema WHERE name = 'message_definitions'"
        ).fetchone():
            query = (
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
            own = {
                str(kind): (str(encoding), str(text))
                for kind, encoding, text in connection.execute(query)
            }
        for topic in connection.execute(
            "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        ):
            number, name, kind, encoding = int(topic[0]), *map(str, topic[1:])
            channel = channel_of.setdefault(number, len(channel_of))
            metadata, schema = {}, channel + 1
            try:
                bag.declare(Schema(schema, definition_of(kind, own), "ros2msg", kind))
            except InputError as error:
                metadata, schema = {NOT_DEFINED: str(error)}, 0
            bag.declare(
                Channel(
                    id=channel,
                    topic=name,
                    message_encoding=encoding,
                    metadata=metadata,
                    schema_id=schema,
                )
            )

    def blocks() -> Iterator[MessageBlock]:
        strangers = 0
        with opened(path) as connection:
            cursor = connection.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
            )
            while rows := cursor.fetchmany(1 << 14):
                known = list[tuple[int, int, bytes]]()  # channel, time [ns] and payload
                for topic, time, data in rows:
                    if topic not in channel_of or not (
                        isinstance(time, int) and isinstance(data, bytes)
                    ):
                        strangers += 1
                        continue
                    # compressed on its own; one in CDR begins with a zero byte
                    if data[:4] == b"\x28\xb5\x2f\xfd":
                        # a damaged one stays as it is, and is no message
                        with suppress(zstandard.ZstdError):
                            data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
                    known.append((channel_of[topic], time, data))
                channel, time = np.array([one[:2] for one in known], np.int64).reshape(-1, 2).T
                lengths = np.array([len(data) for *_, data in known], np.int64)
                content, none = (
                    b"".join(data for *_, data in known),
                    np.zeros(channel.size, np.uint32),
                )
                starts = np.cumsum(lengths) - lengths
                block = MessageBlock(
                    content, channel.astype(np.uint16), none, time, starts, lengths
                )
                bag.damage.read.update(block.counts)
                yield block
        if strangers:
            bag.damage.lose(
                f"{strangers} messages hold no bytes, or belong to no topic of the bag", 0, None, 0
            )

    bag.blocks = blocks()
    return bag


def definition_of(kind: str, own: Mapping[str, tuple[str, str]]) -> bytes:
    """The definition of messages of type `kind` (`package/msg/Name`); InputError if there is none.
    own: encoding and text by type, as bags have them since ROS 2 Iron. `rosbags` has those of the
    standard types."""
    convert = (
        "convert it with `ros2 bag convert` to MCAP where the type is installed, or record with ROS"
        " 2 Iron or on"
    )
    encoding, text = own.get(kind, ("", ""))
    if encoding == "ros2msg" and text.strip():
        return text.encode()
    if encoding == "ros2idl" and text.strip():
        raise InputError(f"type '{kind}' is defined in IDL, which is not read; {convert}")
    lacking = f"the bag has no definition of type '{kind}'"
    with naming(lacking):
        library = optional_module("rosbags.typesys", "a bag without definitions of its messages")
    found = {}  # by what they mean: comments differ
    for one in (one for one in library.Stores if one.name.startswith("ROS2_")):
        store = library.get_typestore(one)
        if kind in store.types:
            text = str(store.generate_msgdef(kind, ros_version=2)[0])
            found[repr(message_type(Schema(0, text.encode(), "", kind), ros1=False))] = (
                text.encode()
            )
    if not found:
        raise InputError(f"{lacking}, which is no standard one; {convert}")
    if len(found) > 1:
        raise InputError(f"{lacking}, which differs between the distributions of ROS 2; {convert}")
    return found.popitem()[1]


def files_in(folder: Path, *, whole: bool = True) -> list[Path]:
    """The files of the recording in a folder: all that a trial is made of. Refused as in
    `read_description`."""
    return [folder / DESCRIPTION, *read_description(folder, whole=whole)[0]]


def recorded_files(path: Path) -> list[Path]:
    """The files of a log, also where some are missing; a folder that is no recording stands for
    itself."""
    try:
        return files_in(path, whole=False) if path.is_dir() else [path]
    except InputError:
        return [path]
