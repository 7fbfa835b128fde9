"""Fields of MCAP topics, decoded from messages of any encoding, shape, channel and order in the file."""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.chunk import MessageBlock
from osl_analysis.formats.mcap.mcap_file import McapFile
from osl_analysis.formats.messages import cdr
from osl_analysis.formats.messages.description import FieldDescription, describe_json
from osl_analysis.formats.messages.json_messages import ByText
from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.formats.messages.one_by_one import Values
from osl_analysis.formats.messages.templates import ByShape

Reader = ByShape | ByText
ENCODINGS = (("cdr", "ros2msg"), ("protobuf", "protobuf"))  # of messages and their schema; JSON needs none


@dataclass(frozen=True)
class Decoded:
    """The messages of one topic, in order of log time; every array has shape (n,)."""

    log_time: Indices
    """When each message was logged [ns]."""
    values: dict[str, NDArray[Any]]
    """Numbers by path of the field, in the type of the message."""
    present: dict[str, NDArray[np.bool_]]
    """Whether the message has the field, by path."""
    how: list[dict[str, Any]] = field(default_factory=list)
    """How the messages of each channel were decoded, for the provenance."""


@dataclass
class ChannelReader:
    """One channel's reader, and what it has read so far."""

    channel: Channel
    """Topic and encoding."""
    schema: Schema | None
    """Schema of the messages; None for JSON."""
    reader: Reader
    """Reads the wanted fields."""
    parts: list[tuple[Indices, Indices, Values]] = field(default_factory=list)
    """Log times [ns], places in the file and values of batches of messages."""
    first: bytes = b""
    """The first message, to list its fields."""
    messages: int = 0
    """Messages so far."""

    def add(self, block: MessageBlock, chosen: Indices, before: int) -> None:
        """Read the chosen messages of a block; `before` messages of the file precede the block."""
        starts, lengths = block.starts[chosen], block.lengths[chosen]
        if not self.messages:
            self.first = block.buffer[int(starts[0]) : int(starts[0] + lengths[0])]
        self.messages += chosen.size
        log_time = block.log_time[chosen]
        place = before + chosen
        for rows, values in self.reader.read(block.buffer, starts, lengths):
            is_all = rows.size == chosen.size
            self.parts.append((log_time, place, values) if is_all else (log_time[rows], place[rows], values))

    def how(self) -> dict[str, Any]:
        """How its messages were decoded, for the provenance."""
        return {
            "channel": self.channel.id,
            "encoding": self.channel.message_encoding,
            "messages": self.messages,
            "one_by_one": self.reader.read_alone,
            "misfits": self.reader.misfits,
        }


def decode_topics(
    file: McapFile,
    wanted: Mapping[str, Sequence[str]],
    optional: Collection[str] = (),
    either: Collection[str] = (),
) -> dict[str, Decoded]:
    """The wanted fields of each topic, from all its channels, in one pass through the file.

    Fields of `optional` may be absent. Fields of `either` are different spellings of the same field; some may be
    absent.

    Raises
    ------
    InputError
        A topic or a field is missing, a topic has no messages, or none of them can be decoded.
    """
    readers: dict[int, ChannelReader] = {}
    before = 0
    for block in file.blocks():
        for number in np.flatnonzero(np.bincount(block.channel)).tolist():
            topic = file.channels[number].topic
            if topic in wanted:
                if number not in readers:
                    readers[number] = reader_of(file, number, wanted[topic], either)
                readers[number].add(block, np.flatnonzero(block.channel == number), before)
        before += block.starts.size
    by_topic: dict[str, list[ChannelReader]] = defaultdict(list)
    for reader in readers.values():
        by_topic[reader.channel.topic].append(reader)
        note_misfits(file, reader)
    by_name = {topic: decoded_topic(file, topic, by_topic[topic], paths) for topic, paths in wanted.items()}
    for topic, one in by_name.items():
        for path in wanted[topic]:
            if path not in {*optional, *either} and not one.present[path].any():
                names = names_of_fields(by_topic[topic][0], path)
                raise InputError(f"topic '{topic}' has no field '{path}'; it has {names}")
    return by_name


def note_misfits(file: McapFile, reader: ChannelReader) -> None:
    """Count the messages that do not fit their schema as lost."""
    if reader.reader.misfits:
        file.damage.misfits += reader.reader.misfits
        file.damage.remark(
            f"{reader.reader.misfits} of {reader.messages} messages of topic '{reader.channel.topic}' are lost: "
            f"{reader.reader.misfit}"
        )


def decoded_topic(file: McapFile, topic: str, readers: Sequence[ChannelReader], paths: Sequence[str]) -> Decoded:
    """The messages of one topic, from the readers of its channels."""
    if topic not in {channel.topic for channel in file.channels.values()}:
        topics = sorted({channel.topic for channel in file.channels.values()})
        raise InputError(f"no topic '{topic}'; the file has {', '.join(topics) or 'none'}")
    if not readers:
        raise InputError(f"topic '{topic}' has no messages; check that its sensor was running")
    parts = [part for reader in readers for part in reader.parts]
    if not parts:
        raise InputError(f"topic '{topic}': {readers[0].reader.misfit}")
    log_time = np.concatenate([log_time for log_time, _, _ in parts])
    place = np.concatenate([place for _, place, _ in parts])
    is_sorted = (np.diff(log_time) >= 0).all() and (np.diff(place) > 0).all()
    order = None if is_sorted else np.lexsort((place, log_time))
    values, present = {}, {}
    for path in paths:
        values[path], present[path] = joined_field(parts, path, order)
    return Decoded(
        log_time if order is None else log_time[order], values, present, [reader.how() for reader in readers]
    )


def joined_field(
    parts: Sequence[tuple[Indices, Indices, Values]], path: str, order: Indices | None
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """One field of all messages, and whether each message has it."""
    sizes = [times.size for times, _, _ in parts]
    has = [path in values for _, _, values in parts]
    if not any(has):
        return np.zeros(sum(sizes), bool), np.zeros(sum(sizes), bool)
    there = np.ones(sum(sizes), bool) if all(has) else np.repeat(has, sizes)
    # False joins with any number type without changing it
    pieces = [values.get(path, np.zeros(size, bool)) for (_, _, values), size in zip(parts, sizes, strict=True)]
    joined = np.concatenate(pieces)
    return (joined, there) if order is None else (joined[order], there[order])


def describe_message(channel: Channel, schema: Schema | None, payload: bytes | None) -> list[FieldDescription]:
    """The fields of a channel's message; without a message, the fields of its schema.

    Raises
    ------
    InputError
        The encoding is not read, or the message does not fit its schema.
    """
    check_encoding(channel, schema)
    if channel.message_encoding == "json" or schema is None:
        return describe_json(payload) if payload is not None else []
    if channel.message_encoding == "cdr":
        return cdr.describe_cdr(schema, payload)
    from osl_analysis.formats.messages import protobuf  # costs time to import, and few logs need it

    return protobuf.describe_protobuf(schema, payload)


def names_of_fields(one: ChannelReader, path: str) -> str:
    """The fields of a channel's first message, for a message to the user about `path`.

    Where the path chooses an element by name, these are the names that its array has, if it has any.
    """
    try:
        fields = describe_message(one.channel, one.schema, one.first)
    except (ValueError, RecursionError):
        fields = []
    array, bracket, name = path.rpartition("[")
    chosen = [field for field in fields if bracket and "=" in name and field.path == array and field.labels]
    words = [field.addresses() if chosen else [field.in_words()] for field in chosen or fields if field.length != 0]
    return ", ".join(one for several in words for one in several) or "none"


def reader_of(file: McapFile, number: int, paths: Sequence[str], either: Collection[str]) -> ChannelReader:
    """A reader for the messages of a channel.

    Raises
    ------
    InputError
        The encoding is not one that is read, or the schema cannot be read.
    """
    channel = file.channels[number]
    schema = file.schemas.get(channel.schema_id)
    check_encoding(channel, schema)
    if channel.message_encoding == "json" or schema is None:
        return ChannelReader(channel, schema, ByText(paths, either))
    try:
        if channel.message_encoding == "cdr":
            return ChannelReader(channel, schema, cdr.cdr_reader(schema, paths))
        from osl_analysis.formats.messages import protobuf

        return ChannelReader(channel, schema, protobuf.protobuf_reader(schema, paths))
    except InputError as error:
        raise InputError(f"topic '{channel.topic}': {error}") from error


def check_encoding(channel: Channel, schema: Schema | None) -> None:
    """Refuse messages of an encoding that is not read."""
    encoding = (channel.message_encoding, schema.encoding if schema else "no schema")
    if encoding not in ENCODINGS and channel.message_encoding != "json":
        raise InputError(
            f"topic '{channel.topic}' is encoded as {encoding[0]} ({encoding[1]}); read are cdr (ros2msg), protobuf "
            "(protobuf) and json: convert the log"
        )
