# SPDX-License-Identifier: Apache-2.0
"""MCAP (https://mcap.dev/spec), also what an interrupted recorder left, and the folder of a ROS 2
recording in MCAP: its description, and the files that this lists.

The records are walked from the front, so that a log without its end is read as far as it goes. A
chunk that does not match its checksum is lost, and counted by the summary. The library `mcap`
decodes the records; it would take 15 times as long for the messages.
"""

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO
from operator import methodcaller
from pathlib import Path

import numpy as np
import yaml
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from numpy.typing import NDArray
from zstandard import ZstdDecompressor

from osl_analysis.base.errors import (
    InputError,
    likeliest,
    listing,
    naming,
    on_one_line,
    shortened,
)
from osl_analysis.base.memory import check_unpacked
from osl_analysis.base.recording import End, Format, Loss, Recording, Rows
from osl_analysis.base.source_file import MessageSource
from osl_analysis.base.yaml_settings import check_size, text_in
from osl_analysis.formats.message_layout import rows_at
from osl_analysis.formats.reading import beginning
from osl_analysis.formats.topic import LOG_TIME, NO_SCHEMA, PLACE_KEY, Topic, stamp_fields

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content [bytes]
MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
MESSAGES = Opcode.MESSAGE.value  # a plain number: a log has a million of them
MESSAGE_HEAD = MESSAGE.itemsize - RECORD.size  # bytes of the head within the content
DESCRIPTION = "metadata.yaml"
REINDEX = "write it again with `ros2 bag reindex`, or name one file of the recording"


class Log:
    """Files that are read, and how much of them was.

    Parameters
    ----------
    source
        The source file, or None. It names the fields to read, and the stamp in the messages.
    """

    def __init__(self, source: MessageSource | None) -> None:
        self.wanted = None if source is None else _wanted_fields(source)
        self.stamp = "header.stamp" if source is None else source.time.field
        self.schemas: dict[int, Schema] = {}
        self.topics: dict[str, Topic] = {}
        self.topic_of: dict[int, Topic] = {}  # by number of the recorder's channel
        self.declared: Counter[str] = Counter()  # as the summary has them
        self.chunks_lost = 0
        self.end = End.WHOLE
        self.remarks: list[str] = []
        self.path = Path()  # of the file that is read
        self.unpacked = 0  # bytes of its chunks

    def take_file(self, path: Path) -> None:
        """Read the records of a file from the front, as far as they go."""
        from mcap.reader import SeekingReader  # takes 0.1 s, which no plan of a run needs

        data = path.read_bytes()
        self.path = path
        self.unpacked = 0
        summary = None
        with suppress(Exception):  # whatever the library meets in a file that is cut off
            summary = SeekingReader(BytesIO(data)).get_summary()
        if summary is not None:  # the chunk that declares a channel may be damaged
            self.schemas |= summary.schemas
            for declared in summary.channels.values():
                self._declare_channel(declared)
        end = self._take_records(data, len(MAGIC))
        if data.startswith(2 * MAGIC, end):
            raise InputError(
                f"a second log begins at byte {end + len(MAGIC)}",
                "split the file there (`head -c`, `tail -c`), and give each part a trial of its"
                " own",
            )
        if end + len(MAGIC) != len(data):
            self.remarks.append(
                f"{path.name} cannot be read behind byte {end}: the recorder did not finish,"
                " or its end is lost"
            )
            if summary is None:
                self.end = End.MISSING
        if summary is not None and summary.statistics is not None:
            for number, count in summary.statistics.channel_message_counts.items():
                name = self.topic_of[number].name if number in self.topic_of else ""
                self.declared[name] += count

    def _take_records(self, data: bytes, position: int) -> int:
        """Read the records from a place on, as far as they go, and give where the last one ends."""
        places = []
        end_of_heads = len(data) - RECORD.size
        while position <= end_of_heads:
            opcode, length = RECORD.unpack_from(data, position)
            begin = position + RECORD.size
            end = begin + length
            if opcode == 0 or end > len(data) or (opcode == MESSAGES and length < MESSAGE_HEAD):
                break
            if opcode == MESSAGES:
                places.append(position)
            else:
                self._take_record(opcode, data[begin:end], end)
            position = end
        self._take_messages(data, np.array(places, np.int64))
        return position

    def _take_record(self, opcode: int, data: bytes, end: int) -> None:
        """Take in a record that is no message, and ends at a place."""
        content = ReadDataStream(BytesIO(data))
        match opcode:
            case Opcode.SCHEMA:
                schema = Schema.read(content)
                self.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                self._declare_channel(Channel.read(content))
            case Opcode.CHUNK:
                self._take_chunk(Chunk.read(content), end)

    def _take_chunk(self, chunk: Chunk, end_of_chunk: int) -> None:
        """Read the records of a chunk that ends at a place; one that is damaged is lost."""
        self.unpacked += chunk.uncompressed_size
        check_unpacked(self.path, self.unpacked)
        try:
            content = _unpacked(chunk)
            places = _messages_alike(content)
            if places.size:
                self._take_messages(content, places)
                return
            end = self._take_records(content, 0)
            if end < len(content):
                raise ValueError(f"it holds no record at byte {end} of its {len(content)} bytes")
        except Exception as error:  # whatever the library meets in a damaged chunk
            self.chunks_lost += 1
            reason = on_one_line(error) or type(error).__name__
            self.remarks.append(f"the chunk that ends at byte {end_of_chunk} is damaged: {reason}")

    def _take_messages(self, content: bytes, places: NDArray[np.int64]) -> None:
        """Give messages at places in some bytes to their topics."""
        heads = rows_at(content, places, MESSAGE.itemsize).view(MESSAGE)
        lengths = heads["length"].astype(np.int64) - MESSAGE_HEAD
        log_times_ns = heads["log_time"].astype(np.int64)
        for channel in np.flatnonzero(np.bincount(heads["channel"])).tolist():
            own = np.flatnonzero(heads["channel"] == channel)
            if channel in self.topic_of:
                messages = (content, places[own] + MESSAGE.itemsize, lengths[own])
                self.topic_of[channel].add(messages, log_times_ns[own], channel)

    def _declare_channel(self, channel: Channel) -> None:
        """Take in a channel of the recorder, whose messages are of a topic."""
        name = channel.topic
        if name not in self.topics:
            schema = self.schemas.get(channel.schema_id, NO_SCHEMA)
            fields = None if self.wanted is None else self.wanted.get(name, {})
            self.topics[name] = Topic(name, channel.message_encoding, schema, fields)
        self.topic_of[channel.id] = self.topics[name]

    @property
    def read(self) -> Counter[str]:
        """Messages by topic."""
        return Counter({name: topic.count for name, topic in self.topics.items()})

    def recording(self, format_name: str, declared: Counter[str]) -> Recording:
        """Put together what was read, of the messages by topic that a file declares; none if it
        does not.

        Raises
        ------
        InputError
            Two publishers wrote into a topic that the source file names.
        """
        counts = self.read
        read = counts.total()
        expected = declared.total() or None
        if expected not in (None, read):
            self.remarks.append(f"it declares {expected} messages and holds {read}")
        by_topic = {
            name: (count, declared[name] if expected else None)
            for name, count in sorted(counts.items())
        }
        channels = []
        for topic in self.topics.values():
            if not topic.is_wanted:
                continue
            if topic.lost:
                of_topic = declared[topic.name] or topic.count
                by_topic[topic.name] = (len(topic.table), of_topic)
                self.remarks.append(
                    f"{topic.lost} of {topic.count} messages of topic '{topic.name}' are lost:"
                    f" {topic.reason}"
                )
            try:
                topic.check_one_publisher()
            except InputError as error:
                if self.wanted is not None:
                    raise
                self.remarks.append(str(error))
            rows = Rows(
                count=len(topic.table),
                name=topic.name,
                stamps_ns=topic.table[LOG_TIME].to_numpy(),
                lines=topic.table[PLACE_KEY].to_numpy() + 1 if topic.lost else None,
                noun="message",
            )
            channels += topic.channels(rows, {"topic": topic.name}, [self.stamp])
        return Recording(
            format=format_name,
            channels=channels,
            loss=Loss(read, expected, self.end, by_topic, self.remarks),
            facts={
                "chunks_lost": self.chunks_lost,
                "messages": read,
            },
            find_unlisted=self._find_unlisted,
        )

    def _find_unlisted(self, address: Mapping[str, str]) -> None:
        """Say why a topic has no numbers for a field."""
        name, path = address.values()
        topic = self.topics.get(name)
        if topic is None or not topic.count:
            names = sorted(+self.read)
            raise InputError(
                f"no messages of '{name}' (the file has {listing(names)})",
                likeliest(name, names)
                or "correct `topic`, check that its sensor was on, or copy a file"
                " again that was cut off",
            )
        if topic.lost == topic.count:
            raise InputError(f"topic '{name}': {topic.reason}", topic.remedy)
        raise InputError(
            f"topic '{name}' has no number '{path}' (it has {listing([*topic.listed])})",
            likeliest(path, [*topic.listed]) or "correct `field` in the source file",
        )


def _wanted_fields(source: MessageSource) -> dict[str, dict[str, None]]:
    """The fields that a source file asks for, by topic, and the velocity beside each position."""
    stamps = []
    if source.time.source == "header":
        stamps = [path for parts in stamp_fields(source.time.field) for path in parts]
    wanted: dict[str, dict[str, None]] = {}  # in their order, each once
    for channel in source.channels.values():
        beside = channel.field.replace("position", "velocity")
        paths = filter(None, (channel.field, channel.counter, beside, *stamps))
        wanted.setdefault(channel.topic, {}).update(dict.fromkeys(paths))
    return wanted


def _messages_alike(content: bytes) -> NDArray[np.int64]:
    """Where the messages begin of a chunk that holds nothing but messages of one length, as of one
    topic; empty of another chunk. One by one they would take most of the time of reading."""
    if len(content) < RECORD.size:
        return np.arange(0)
    opcode, length = RECORD.unpack_from(content)
    size = RECORD.size + length
    if opcode != MESSAGES or length < MESSAGE_HEAD or len(content) % size:
        return np.arange(0)
    heads = np.frombuffer(content, f"V{RECORD.size}, V{length}")["f0"]
    is_alike = (heads == heads[0]).all()
    return np.arange(0, len(content) if is_alike else 0, size)


def _unpacked(chunk: Chunk) -> bytes:
    """The content of a chunk, of no more than the size that it states. Raises ValueError: it is of
    another size, or does not match its checksum."""
    most = chunk.uncompressed_size + 1
    content = chunk.data
    if chunk.compression == "zstd":
        content = ZstdDecompressor().stream_reader(content, read_across_frames=True).read(most)
    elif chunk.compression == "lz4":
        content = LZ4FrameDecompressor().decompress(content, max_length=most)
    elif chunk.compression:
        raise ValueError(f"its compression {chunk.compression} is not known")
    if len(content) != chunk.uncompressed_size:
        raise ValueError(f"it unpacks to other than its {chunk.uncompressed_size} bytes")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise ValueError("it does not match its checksum")
    return bytes(content)


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read an MCAP file."""
    log = Log(source)
    log.take_file(path)
    is_whole = log.end == End.WHOLE and not log.chunks_lost
    return log.recording("mcap", log.declared or (log.read if is_whole else Counter()))


FORMAT = Format(
    name="mcap",
    suffixes=(".mcap",),
    begins=methodcaller("startswith", MAGIC),
    source=MessageSource,
    read=read,
)


def read_bag(path: Path, source: MessageSource | None) -> Recording:
    """Read the parts of the folder of a ROS 2 recording one after the other."""
    parts, counts = _described(path)
    log = Log(source)
    for part in parts:
        with naming(part):
            if not beginning(part).startswith(MAGIC):
                raise InputError(
                    "is no MCAP",
                    "convert the recording with `rosbags-convert --src FOLDER --dst NEW"
                    " --dst-storage mcap`, which stands beside `osl-analysis`",
                )
            log.take_file(part)
    return log.recording("rosbag2", counts)


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
        text = path.read_text(encoding="utf-8")
        with naming(path):
            check_size(text)
        about = yaml.load(text, yaml.CSafeLoader)["rosbag2_bagfile_information"]
        # older ones begin with the folder
        files = [folder / Path(name).name for name in about["relative_file_paths"]]
        for topic in about["topics_with_message_count"]:
            counts[text_in(topic["topic_metadata"]["name"])] += int(topic["message_count"])
    except InputError:
        raise
    except (yaml.YAMLError, RecursionError, LookupError, TypeError, ValueError) as error:
        reason = shortened(on_one_line(error))
        raise InputError(
            f"{path}: not the description of a ROS 2 bag ({reason})", REINDEX
        ) from error
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(files)} files that {DESCRIPTION} lists are"
            f" missing ({listing(missing)})",
            f"copy them there, or {REINDEX}",
        )
    return files, counts


BAG = Format(
    name="rosbag2",
    suffixes=(".db3", ".bag"),  # to say how they are converted
    begins=lambda begin: False,
    source=MessageSource,
    read=read_bag,
    is_folder=lambda path: (path / DESCRIPTION).is_file(),
    files_in=lambda path: [path / DESCRIPTION, *_described(path)[0]],
)
