"""Recordings of messages by topic, whatever their container is: MCAP, or a bag of ROS.

A container gives its messages in blocks, and counts what it lost. Here their fields become columns, by topic.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.message_fields import (
    Columns,
    Indices,
    NoNumberError,
    Reader,
    Values,
    describe_message,
    joined_masked,
    kind_of,
)


class WrongFieldError(InputError):
    """The source file asks for a field that cannot be a column, whatever the messages hold."""


class RefusedFileError(InputError):
    """The file as a whole is not read; what was counted until then says nothing about it."""


@dataclass(frozen=True)
class MessageBlock:
    """The messages of one chunk, or of another part of a file, (n,) each."""

    buffer: bytes
    channel: NDArray[np.uint16]
    sequence: NDArray[np.uint32]  # number that the recorder or the publisher gave to each message; often 0
    log_time: Indices  # when each message was logged [ns]
    starts: Indices  # where each payload begins in the buffer [bytes]
    lengths: Indices  # length of each payload [bytes]

    @cached_property
    def counts(self) -> Counter[int]:
        """Messages of each channel that has any, in the order of their numbers."""
        counts = np.bincount(self.channel)
        return Counter({number: int(counts[number]) for number in np.flatnonzero(counts).tolist()})

    def only(self, mine: NDArray[np.bool_]) -> "MessageBlock":
        """The messages that are `mine`, (n,)."""
        if mine.all():
            return self
        channel, sequence, log_time = self.channel[mine], self.sequence[mine], self.log_time[mine]
        return MessageBlock(self.buffer, channel, sequence, log_time, self.starts[mine], self.lengths[mine])


@dataclass
class Damage:
    """Losses of a log, counted while it is read, for the trial's provenance."""

    finished: bool = False  # the recorder closed the file. If it did not, nobody knows what is missing.
    gaps: bool = False  # some part of the file cannot be read or is missing; the summary counts as a part
    declared_messages: int | None = None  # messages in it as it says; None if it does not, or is not trusted
    declared: Counter[int] | None = None  # the same for each channel
    declared_chunks: int | None = None  # chunks in the file as it says itself
    read: Counter[int] = field(default_factory=Counter)  # messages of each channel
    verified: int = 0  # messages that were read and are covered by a checksum that was right
    misfits: Counter[int] = field(default_factory=Counter)  # of `read`, what does not fit its own schema and is lost
    chunks: int = 0
    chunks_lost: int = 0  # chunks that were found and could not be read
    indexed_lost: Counter[int] = field(default_factory=Counter)  # lost messages of each channel that an index lists
    uncounted: bool = False  # something was lost, and no index tells how many messages it held
    bytes: int = 0  # bytes of the file's data section
    bytes_lost: int = 0  # bytes of it that could not be read, without those at the end of a file that was cut off
    remarks: list[str] = field(default_factory=list)  # faults of the file, a sentence each

    def lose(self, remark: str, size: int, messages: Counter[int] | None, chunks: int) -> None:
        """Count a lost stretch: bytes, messages of each channel (None if their number is not known), chunks."""
        self.remarks.append(remark)
        self.chunks_lost += chunks
        self.bytes_lost += size
        self.uncounted |= messages is None
        self.indexed_lost.update(messages or {})

    @property
    def messages(self) -> int:
        return self.read.total()

    def messages_lost(self, channels: Collection[int] | None = None) -> int | None:
        """Lost messages of some channels, else of all; None where the file, as one not closed, does not tell."""
        if not self.finished:
            return None
        if self.declared_messages is not None and channels is None:
            return max(0, self.declared_messages - self.messages) + self.misfits.total()
        if self.declared is not None and channels is not None:
            return sum(max(0, self.declared[one] - self.read[one]) + self.misfits[one] for one in channels)
        told = self.declared_messages == self.messages or (self.declared_messages is None and not self.uncounted)
        return total_of(self.indexed_lost + self.misfits, channels) if told else None

    def share_lost(self, channels: Collection[int] | None = None) -> float:
        """Lost share of the messages of some channels, of all if none are named. Where the file does not tell how many,
        that of all messages or of the bytes stands for it, if it is larger. What may be missing at the end of a file
        that was not closed counts for nothing: no byte of it is there."""
        lost = self.messages_lost(channels)
        certain = total_of(self.indexed_lost + self.misfits, channels) if lost is None else lost
        sound = self.read - self.misfits
        share = certain / max(1, total_of(sound, channels) + certain)
        if lost is not None or not (self.uncounted or self.finished):
            return share
        total = self.messages_lost() or 0
        return min(1.0, max(share, total / max(1, sound.total() + total), self.bytes_lost / max(1, self.bytes)))

    def crc(self) -> str:
        """Whether checksums cover what was read."""
        if self.verified == self.messages and self.messages:
            return "checked"
        return "mixed" if self.verified else "absent"

    def report(self, topics: dict[str, Collection[int]]) -> dict[str, Any]:
        """The provenance's `damage`, with the channels of each topic that is used; null is what nobody knows."""
        lost = self.messages_lost()
        chunks = max(self.chunks_lost, (self.declared_chunks or 0) - self.chunks) if self.finished else None
        contradicted = self.declared is not None and +self.declared != +self.read
        contradicted |= self.declared_messages not in (None, self.messages)
        by_topic = {
            topic: {"messages": total_of(self.read, own), "messages_lost": self.messages_lost(own)}
            for topic, own in topics.items()
        }
        return {
            "complete": lost == 0 and chunks == 0 and not self.gaps and not contradicted,
            "crc": self.crc(),
            "chunks_lost": chunks,
            "messages_lost": lost,
            "share_lost": max((self.share_lost(channels) for channels in topics.values()), default=self.share_lost()),
            "topics": by_topic,
            "remarks": self.all_remarks(),
        }

    def all_remarks(self) -> list[str]:
        """The remarks, with those that follow from the counts of the whole file."""
        remarks, more = self.remarks[:20], len(self.remarks) - 20
        remarks += [f"and {more} more remarks"] * (more > 0)
        if self.declared_messages not in (None, self.messages):
            remarks.append(f"it declares {self.declared_messages} messages and holds {self.messages}")
        if self.crc() != "checked" and self.messages:
            uncovered = self.messages - self.verified
            remarks.append(f"not verifiable: no checksum covers {uncovered} of {self.messages} messages")
        return remarks


def total_of(counts: Counter[int], channels: Collection[int] | None) -> int:
    """The sum of the counts of some channels, else of all."""
    return counts.total() if channels is None else sum(counts[one] for one in channels)


@dataclass
class MessageFile:
    """A log of messages; what it declares and its losses are complete once its blocks are read."""

    path: Path  # where the log is: a file, or the folder of its parts
    size: int  # its size [bytes]
    kind: str = "bag"  # what it is, for messages
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    damage: Damage = field(default_factory=Damage)
    blocks: Iterator[MessageBlock] = field(init=False)  # the messages in the order of the file, to be read once

    def declare(self, one: Channel | Schema) -> None:
        """Take in a channel or a schema. A number means one thing throughout a file."""
        what, known_ones = ("channel", self.channels) if isinstance(one, Channel) else ("schema", self.schemas)
        known = known_ones.setdefault(one.id, one)  # type: ignore[arg-type]
        if known != one:
            names = [getattr(each, "topic" if what == "channel" else "name") for each in (known, one)]
            raise RefusedFileError(
                f"{what} {one.id} is {names[0]!a} in one part of the file and {names[1]!a} in another: two logs "
                "were joined, or the file is damaged; record again, or give each log a file of its own"
            )

    def channels_of(self, topic: str) -> list[int]:
        return [channel.id for channel in self.channels.values() if channel.topic == topic]


def joined_parts(path: Path, parts: Sequence[MessageFile], counts: Counter[str]) -> MessageFile:
    """The files of one recording, one after the other; `counts` are the messages of each topic in all of them. A
    channel has one number in all of them, and their damage is that of the whole."""
    whole, numbers = MessageFile(path, sum(part.size for part in parts)), dict[tuple[object, ...], int]()
    total = whole.damage
    total.finished = all(part.damage.finished for part in parts)

    def number_of(part: MessageFile, own: int) -> int:
        channel = part.channels[own]
        schema = part.schemas.get(channel.schema_id)
        meaning = channel.topic, channel.message_encoding, schema and (schema.name, schema.encoding, schema.data)
        number = numbers.setdefault(meaning, len(numbers))
        if schema:
            whole.schemas[number + 1] = replace(schema, id=number + 1)
        whole.channels[number] = replace(channel, id=number, schema_id=number + 1 if schema else 0)
        return number

    def blocks() -> Iterator[MessageBlock]:
        for part in parts:
            for block in part.blocks:
                renumbered = np.zeros(1 << 16, np.uint16)
                for channel in block.counts:
                    renumbered[channel] = number_of(part, channel)
                yield replace(block, channel=renumbered[block.channel])
            own, known = part.damage, {channel: number_of(part, channel) for channel in sorted(part.channels)}
            for sums, own_counts in ((total.read, own.read), (total.indexed_lost, own.indexed_lost)):
                sums.update({known[channel]: n for channel, n in own_counts.items() if channel in known})
            for name in ("gaps", "uncounted", "verified", "chunks", "chunks_lost", "bytes", "bytes_lost"):
                setattr(total, name, getattr(total, name) + getattr(own, name))
            total.remarks += [f"{part.path.name}: {remark}" for remark in own.remarks]
        total.declared_messages = counts.total()
        if len({channel.topic for channel in whole.channels.values()}) == len(whole.channels):
            total.declared = Counter({one.id: counts[one.topic] for one in whole.channels.values()})

    whole.blocks = blocks()
    return whole


@dataclass
class ChannelLog:
    """The messages of one channel: when they were logged, the first one, and the fields that were wanted."""

    channel: Channel
    schema: Schema | None  # of its messages; None for JSON
    reader: Reader | None = None  # of the wanted fields, if there are such
    first: bytes | None = None  # the first message
    stamps: list[Indices] = field(default_factory=list)  # log times of the messages of each block [ns]
    sequence: list[NDArray[np.uint32]] = field(default_factory=list)  # their sequence numbers

    @property
    def log_time(self) -> Indices:
        """Log times of the messages [ns], in the order of the file."""
        return np.concatenate([np.empty(0, np.int64), *self.stamps])

    def columns(self, damage: Damage) -> Columns:
        """The wanted fields in the order of recording; counts what does not fit, and remarks on what is missing."""
        assert self.reader is not None  # it was made with the fields
        numbers = np.concatenate(self.sequence).astype(np.int64)
        rank, by_number = np.arange(numbers.size), np.argsort(numbers, kind="stable")
        steps, backwards = np.diff(numbers[by_number]), int((np.diff(numbers) < 0).sum())
        if backwards and (steps > 0).all():
            # a tool may have sorted the file by log time since, and the clock was set back while recording: the numbers
            # tell the order if they go back often (a publisher that was restarted goes back, a few times) or explain it
            explained = (np.diff(self.log_time) < 0).any() and (np.diff(self.log_time[by_number]) >= 0).all()
            if backwards > 10 or explained:
                rank[by_number] = np.arange(numbers.size)
        found, topic = self.reader.columns(rank), f"topic '{self.channel.topic}'"
        if found.misfits:
            damage.misfits[self.channel.id] += found.misfits
            damage.remarks.append(f"{found.misfits} of {numbers.size} messages of {topic} are lost: {found.misfit}")
        if (steps > 0).all() and (steps > 1).any() and np.median(steps) == 1:  # they count messages
            missing = int((steps - 1).sum())  # the recorder dropped them, or a chunk was removed
            damage.remarks.append(
                f"the sequence numbers of {topic} say that {missing} messages beside its {numbers.size} are not in "
                "the file"
            )
        return found

    def wrong_field(self, what: str) -> WrongFieldError:
        """The error for a field that is no number in any message; it names those that are."""
        return WrongFieldError(
            f"topic '{self.channel.topic}': {what} (it has {self.names_of_fields()}); name a number, or one element "
            "of an array, as `field` in the source file"
        )

    def names_of_fields(self) -> str:
        """The fields of the first message."""
        words: list[str] = []
        with suppress(ValueError, RecursionError):
            for one in describe_message(self.channel, self.schema, self.first):
                is_named = one.length is None or not one.elements[0].isdigit()
                as_whole = [f"{one.path}[0..{one.length - 1}]"] if one.length else []
                words += one.addresses() if is_named else as_whole
        return listing(words)


def read_channels(file: MessageFile, wanted: Mapping[str, Sequence[str]] | None = None) -> list[ChannelLog]:
    """The channels of the wanted topics that have messages, with the wanted fields; or else all, without fields."""
    logs: dict[int, ChannelLog] = {}
    for block in file.blocks:
        for number in block.counts:
            channel = file.channels[number]
            if wanted is not None and channel.topic not in wanted:
                continue
            if number not in logs:
                schema = file.schemas.get(channel.schema_id)
                reader = Reader([*dict.fromkeys(wanted[channel.topic])], kind_of(channel, schema)) if wanted else None
                logs[number] = ChannelLog(channel, schema, reader)
            one, mine = logs[number], block.only(block.channel == number)
            if one.first is None:
                one.first = mine.buffer[int(mine.starts[0]) : int(mine.starts[0] + mine.lengths[0])]
            one.stamps.append(mine.log_time)
            one.sequence.append(mine.sequence)
            try:
                if one.reader:
                    one.reader.read(mine.buffer, mine.starts, mine.lengths)
            except NoNumberError as error:
                raise one.wrong_field(str(error)) from error
    empty = {n: ChannelLog(one, file.schemas.get(one.schema_id)) for n, one in file.channels.items()}
    return [*logs.values()] if wanted is not None else [one for _, one in sorted((empty | logs).items())]


class Decoded(NamedTuple):
    """The messages of one topic, channel by channel in the order of recording; every array has shape (n,)."""

    log_time: Indices  # when each message was logged [ns]
    channel: NDArray[np.uint16]  # number of each message's channel
    values: Values  # numbers by path of the field
    how: list[dict[str, Any]]  # how the messages of each channel were decoded, for the provenance


def decode_topics(
    file: MessageFile, wanted: Mapping[str, Sequence[str]], optional: Collection[str] = ()
) -> dict[str, Decoded]:
    """The wanted fields of each topic, from all channels; InputError if one that is not `optional` is not there."""
    logs = [(one, one.columns(file.damage)) for one in read_channels(file, wanted)]
    topics = sorted({channel.topic for channel in file.channels.values()})
    found = {}
    for topic, paths in wanted.items():
        own = [(one, columns) for one, columns in logs if one.channel.topic == topic]
        if topic not in topics:
            raise InputError(
                f"no topic '{topic}' (the file has {listing(topics)}); correct `topic` in the source file, or exclude "
                "the trial if its log is not the right one"
            )
        if not own:
            raise InputError(f"topic '{topic}' has no messages; check that its sensor was running")
        used = [(one, columns) for one, columns in own if columns.rows.size]
        if not used:
            for one, columns in own:
                if one.reader and columns.misfits == one.reader.no_numbers:
                    raise one.wrong_field(columns.misfit)
            raise InputError(f"topic '{topic}': {own[0][1].misfit}; record the log again, or exclude the trial")
        values = {}
        for path in paths:
            values[path] = joined_masked([columns.values[path] for _, columns in used])
            if path not in optional and np.ma.getmaskarray(values[path]).all():
                raise InputError(
                    f"topic '{topic}' has no field '{path}' (it has {own[0][0].names_of_fields()}); correct `field` in "
                    "the source file, or exclude the trial if its log is not the right one"
                )
        log_time = np.concatenate([one.log_time[columns.rows] for one, columns in used])
        channel = [np.full(columns.rows.size, one.channel.id, np.uint16) for one, columns in used]
        how = [
            {
                "channel": one.channel.id,
                "encoding": one.channel.message_encoding,
                "messages": one.log_time.size,
                "one_by_one": len(one.reader.found) if one.reader else 0,
                "misfits": columns.misfits,
            }
            for one, columns in own
        ]
        found[topic] = Decoded(log_time, np.concatenate(channel), values, how)
    return found
