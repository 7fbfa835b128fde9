"""Fields of MCAP topics, decoded from messages of any encoding, shape, channel and order in the file."""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.mcap.channel_reader import ChannelReader, names_of_fields, reader_of
from osl_analysis.formats.mcap.order import missing_numbers, recording_order
from osl_analysis.formats.message_file import MessageFile
from osl_analysis.formats.messages.effort import text_effort_for
from osl_analysis.formats.messages.json_messages import ByText
from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.formats.messages.one_by_one import Values


@dataclass(frozen=True)
class Decoded:
    """The messages of one topic, channel by channel in the order of recording; every array has shape (n,)."""

    log_time: Indices
    """When each message was logged [ns]."""
    channel: NDArray[np.uint16]
    """Number of each message's channel."""
    values: dict[str, NDArray[Any]]
    """Numbers by path of the field, in the type of the message."""
    present: dict[str, NDArray[np.bool_]]
    """Whether the message has the field, by path."""
    how: list[dict[str, Any]] = field(default_factory=list)
    """How the messages of each channel were decoded, for the provenance."""


def decode_topics(
    file: MessageFile,
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
    texts = text_effort_for(file.budget.file_bytes)
    for block in file.blocks():
        for number in block.counts:
            topic = file.declared.channels[number].topic
            if topic in wanted:
                if number not in readers:
                    readers[number] = reader_of(file, number, wanted[topic], either, texts)
                readers[number].add(block.of_channel(number))
    by_topic: dict[str, list[ChannelReader]] = defaultdict(list)
    for reader in readers.values():
        by_topic[reader.channel.topic].append(reader)
        reader.settle()
        note_misfits(file, reader)
        note_missing(file, reader)
    by_name = {topic: decoded_topic(file, topic, by_topic[topic], paths) for topic, paths in wanted.items()}
    for topic, one in by_name.items():
        for path in wanted[topic]:
            if path not in {*optional, *either} and not one.present[path].any():
                names = names_of_fields(by_topic[topic][0], path)
                raise InputError(
                    f"topic '{topic}' has no field '{path}' (it has {names}); correct `field` in the source file, or "
                    "exclude the trial if its log is not the right one"
                )
    return by_name


def note_misfits(file: MessageFile, reader: ChannelReader) -> None:
    """Count the messages that do not fit their schema as lost."""
    if reader.reader.misfits:
        file.damage.misfits[reader.channel.id] += reader.reader.misfits
        file.damage.remark(
            f"{reader.reader.misfits} of {reader.messages} messages of topic '{reader.channel.topic}' are lost: "
            f"{reader.reader.misfit}"
        )


def note_missing(file: MessageFile, reader: ChannelReader) -> None:
    """Remark on sequence numbers that are missing: evidence that a recorder dropped messages or a chunk was removed."""
    missing = missing_numbers(np.concatenate(reader.sequences))
    if missing:
        file.damage.remark(
            f"the sequence numbers of topic '{reader.channel.topic}' say that {missing} messages beside its "
            f"{reader.messages} are not in the file"
        )


def decoded_topic(file: MessageFile, topic: str, readers: Sequence[ChannelReader], paths: Sequence[str]) -> Decoded:
    """The messages of one topic, from the readers of its channels."""
    if topic not in {channel.topic for channel in file.declared.channels.values()}:
        topics = sorted({channel.topic for channel in file.declared.channels.values()})
        raise InputError(
            f"no topic '{topic}' (the file has {listing(topics)}); correct `topic` in the source file, or exclude the "
            "trial if its log is not the right one"
        )
    if not readers:
        raise InputError(f"topic '{topic}' has no messages; check that its sensor was running")
    decoded = [reader for reader in readers if reader.parts]
    if not decoded:
        raise no_messages(topic, readers)
    log_time, channel, rows, before = [], [], [], 0
    for reader in decoded:
        logged, places = np.concatenate(reader.log_times), np.concatenate([place for place, _ in reader.parts])
        order = in_order_of(recording_order(logged, np.concatenate(reader.sequences)), places)
        reader.log_times.clear()  # what is not needed any more is released: a log of hours is in memory once
        reader.sequences.clear()
        every = order is None and places.size == logged.size
        log_time.append(logged if every else logged[places if order is None else places[order]])
        channel.append(np.full(places.size, reader.channel.id, np.uint16))
        rows.append(slice(before, before + places.size) if order is None else before + order)
        before += places.size
        del logged, places, order
    parts = [(places.size, values) for reader in decoded for places, values in reader.parts]
    for reader in decoded:
        reader.parts.clear()
    order = None if all(isinstance(one, slice) for one in rows) else np.concatenate([np.r_[one] for one in rows])
    rows.clear()
    values, present = {}, {}
    for path in dict.fromkeys(paths):
        values[path], present[path] = joined_field(parts, path, order)
    how = [reader.how() for reader in readers]
    return Decoded(np.concatenate(log_time), np.concatenate(channel), values, present, how)


def in_order_of(recorded: Indices | None, places: Indices) -> Indices | None:
    """Indices that put messages at `places` of a channel in the order of recording, which `recorded` gives.

    None where they are in it.
    """
    if recorded is None:
        rise = (places[1:] > places[:-1]).all()  # as in most files
        return None if rise else np.argsort(places, kind="stable")
    rank = np.empty_like(recorded)
    rank[recorded] = np.arange(recorded.size)
    return np.argsort(rank[places])


def no_messages(topic: str, readers: Sequence[ChannelReader]) -> InputError:
    """The error for a topic of which no message can be used."""
    for one in readers:
        if isinstance(one.reader, ByText) and one.reader.misfits == one.reader.no_numbers > 0:
            return one.wrong_field(one.reader.misfit)
    return InputError(f"topic '{topic}': {readers[0].reader.misfit}; record the log again, or exclude the trial")


def joined_field(
    parts: Sequence[tuple[int, Values]], path: str, order: Indices | None
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """One field of all messages, taken out of the parts, each with its number of messages; and which ones have it."""
    sizes = [size for size, _ in parts]
    has = [path in values for _, values in parts]
    if not any(has):
        nowhere = np.broadcast_to(False, sum(sizes))
        return nowhere, nowhere
    there = np.broadcast_to(True, sum(sizes)) if all(has) else np.repeat(has, sizes)
    # False joins with any number type without changing it
    pieces = [values.pop(path, np.zeros(size, bool)) for size, values in parts]
    joined = np.concatenate(pieces)
    return (joined, there) if order is None else (joined[order], there[order])
