"""Recordings of messages by topic, whatever their container is: MCAP, or a bag of ROS.

A container gives its messages in blocks, and counts what it lost. Here their fields become columns,
by topic."""

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
from osl_analysis.old_formats import message_fields
from osl_analysis.old_formats.table import Ledger


class WrongFieldError(InputError):
    """The source file asks for a field that cannot be a column, whatever the messages hold."""


class RefusedFileError(InputError):
    """The file as a whole is not read; what was counted until then says nothing about it."""


@dataclass(frozen=True)
class MessageBlock:
    """The messages of one chunk, or of another part of a file, (n,) each."""

    buffer: bytes
    channel: NDArray[np.uint16]
    # number that the recorder or the publisher gave to each message; often 0
    sequence: NDArray[np.uint32]
    log_time: message_fields.Indices  # when each message was logged [ns]
    starts: message_fields.Indices  # where each payload begins in the buffer [bytes]
    lengths: message_fields.Indices  # length of each payload [bytes]

    @cached_property
    def counts(self) -> Counter[int]:
        """Messages of each channel that has any, in the order of their numbers."""
        counts = np.bincount(self.channel)
        return Counter({number: int(counts[number]) for number in np.flatnonzero(counts).tolist()})

    def only(self, mine: NDArray[np.bool_]) -> "MessageBlock":
        """The messages that are `mine`, (n,)."""
        if mine.all():
            return self
        rows = np.flatnonzero(mine)
        channel, sequence, log_time = self.channel[rows], self.sequence[rows], self.log_time[rows]
        return MessageBlock(
            self.buffer, channel, sequence, log_time, self.starts[rows], self.lengths[rows]
        )


@dataclass
class MessageFile:
    """A log of messages; what it declares and its losses are complete once its blocks are read."""

    path: Path  # where the log is: a file, or the folder of its parts
    size: int  # its size [bytes]
    kind: str = "bag"  # what it is, for messages
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    damage: Ledger = field(default_factory=Ledger)
    # the messages in the order of the file, to be read once
    blocks: Iterator[MessageBlock] = field(init=False)

    def declare(self, one: Channel | Schema) -> None:
        """Take in a channel or a schema. A number means one thing throughout a file."""
        what, known_ones = (
            ("channel", self.channels) if isinstance(one, Channel) else ("schema", self.schemas)
        )
        known = known_ones.setdefault(one.id, one)  # type: ignore[arg-type]
        if known != one:
            names = [
                getattr(each, "topic" if what == "channel" else "name") for each in (known, one)
            ]
            raise RefusedFileError(
                f"{what} {one.id} is {names[0]!a} in one part of the file and {names[1]!a} in"
                " another: two logs were joined, or the file is damaged; record again, or give"
                " each log a file of its own"
            )

    def channels_of(self, topic: str) -> list[int]:
        return [channel.id for channel in self.channels.values() if channel.topic == topic]


def joined_parts(path: Path, parts: Sequence[MessageFile], counts: Counter[str]) -> MessageFile:
    """The files of one recording, one after the other; `counts` are the messages of each topic in
    all of them. A channel has one number in all of them, and their damage is that of the whole."""
    whole, numbers = (
        MessageFile(path, sum(part.size for part in parts)),
        dict[tuple[object, ...], int](),
    )
    total = whole.damage

    def number_of(part: MessageFile, own: int) -> int:
        channel = part.channels[own]
        schema = part.schemas.get(channel.schema_id)
        meaning = (
            channel.topic,
            channel.message_encoding,
            schema and (schema.name, schema.encoding, schema.data),
        )
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
            own, known = (
                part.damage,
                {channel: number_of(part, channel) for channel in sorted(part.channels)},
            )
            for sums, own_counts in (
                (total.read, own.read),
                (total.indexed_lost, own.indexed_lost),
            ):
                sums.update(
                    {known[channel]: n for channel, n in own_counts.items() if channel in known}
                )
            total.end_missing |= own.end_missing
            for name in (
                "gaps",
                "uncounted",
                "verified",
                "chunks",
                "chunks_lost",
                "bytes",
                "bytes_lost",
            ):
                setattr(total, name, getattr(total, name) + getattr(own, name))
            total.remarks += [f"{part.path.name}: {remark}" for remark in own.remarks]
        total.expected = counts.total()
        # only what stands behind the messages is missing
        if total.end_missing and total.expected == total.messages:
            total.end_missing, total.gaps = False, True
        if len({channel.topic for channel in whole.channels.values()}) == len(whole.channels):
            total.declared = Counter({one.id: counts[one.topic] for one in whole.channels.values()})

    whole.blocks = blocks()
    return whole


@dataclass
class ChannelLog:
    """The messages of one channel: when they were logged, the first one, and the fields that were
    wanted."""

    channel: Channel
    schema: Schema | None  # of its messages; None for JSON
    reader: message_fields.Reader | None = None  # of the wanted fields, if there are such
    first: bytes | None = None  # the first message
    # log times of the messages of each block [ns]
    stamps: list[message_fields.Indices] = field(default_factory=list)
    sequence: list[NDArray[np.uint32]] = field(default_factory=list)  # their sequence numbers

    @property
    def log_time(self) -> message_fields.Indices:
        """Log times of the messages [ns], in the order of the file."""
        return np.concatenate([np.empty(0, np.int64), *self.stamps])

    def columns(self, damage: Ledger) -> message_fields.Columns:
        """The wanted fields in the order of recording; counts what does not fit, and remarks on
        what is missing."""
        assert self.reader is not None  # it was made with the fields
        numbers = np.concatenate(self.sequence).astype(np.int64)
        rank, by_number = np.arange(numbers.size), np.argsort(numbers, kind="stable")
        steps, backwards = np.diff(numbers[by_number]), int((np.diff(numbers) < 0).sum())
        if backwards and (steps > 0).all():
            # a tool may have sorted the file by log time since, and the clock was set back while
            # recording: the numbers tell the order if they go back often (a publisher that was
            # restarted goes back, a few times) or explain it
            explained = (np.diff(self.log_time) < 0).any() and (
                np.diff(self.log_time[by_number]) >= 0
            ).all()
            if backwards > 10 or explained:
                rank[by_number] = np.arange(numbers.size)
        found, topic = self.reader.columns(rank), f"topic '{self.channel.topic}'"
        self.reader.parts.clear()  # an hour of messages need not be held twice
        if found.misfits:
            damage.misfits[self.channel.id] += found.misfits
            damage.remarks.append(
                f"{found.misfits} of {numbers.size} messages of {topic} are lost: {found.misfit}"
            )
        again = (steps == 0) & (np.diff(self.log_time[by_number]) == 0)
        onward, copies = steps[~again], 0
        if numbers.size and (numbers == numbers[0]).all():  # nothing counts them
            copies = self.copies_among(found)
            damage.uncounted |= copies > 0
        elif onward.size and (onward > 0).all() and np.median(onward) == 1:  # they count messages
            copies = int(again.sum())
            damage.verified = max(damage.verified - copies, 0)
            # the recorder dropped them, or a chunk was removed
            if missing := int((onward - 1).sum()):
                damage.skipped[self.channel.id] += missing
                said = f"{missing} messages beside its {numbers.size - copies} are not in the file"
                damage.remarks.append(f"the sequence numbers of {topic} say that {said}")
        if copies:
            damage.read[self.channel.id] -= copies
            said = "stand twice in the file, as where a part of it is a copy of another"
            damage.remarks.append(f"{copies} of {numbers.size} messages of {topic} {said}")
        return found

    def copies_among(self, found: message_fields.Columns) -> int:
        """How many messages stand twice, logged at one time with the same numbers, as where a part
        of the file is a copy of another; of a few a driver may have sent each twice."""
        logged = self.log_time[found.rows]
        order = np.argsort(logged, kind="stable")
        same = np.diff(logged[order]) == 0
        if not (np.diff(order)[same] > 1).any():  # one right behind the other is no copy of a part
            return 0
        for values in found.values.values():
            known = np.ma.filled(values[order].astype(np.float64), np.nan)
            same &= (known[1:] == known[:-1]) | (np.isnan(known[1:]) & np.isnan(known[:-1]))
        return int(same.sum())

    def decoding(self, columns: message_fields.Columns) -> dict[str, Any]:
        """How its messages were decoded, for the provenance."""
        found = {
            "channel": self.channel.id,
            "encoding": self.channel.message_encoding,
            "messages": self.log_time.size,
        }
        return found | {
            "one_by_one": len(self.reader.found) if self.reader else 0,
            "misfits": columns.misfits,
        }

    def wrong_field(self, what: str) -> WrongFieldError:
        """The error for a field that is no number in any message; it names those that are."""
        said = f"topic '{self.channel.topic}': {what} (it has {self.names_of_fields()})"
        return WrongFieldError(
            f"{said}; name a number, or one element of an array, as `field` in the source file"
        )

    def names_of_fields(self) -> str:
        words: list[str] = []
        with suppress(ValueError, RecursionError):
            for one in message_fields.describe_message(self.channel, self.schema, self.first):
                is_named = one.length is None or not one.elements[0].isdigit()
                as_whole = [f"{one.path}[0..{one.length - 1}]"] if one.length else []
                words += one.addresses() if is_named else as_whole
        return listing(words)


def read_channels(
    file: MessageFile, wanted: Mapping[str, Sequence[str]] | None = None
) -> list[ChannelLog]:
    """The channels of the wanted topics that have messages, with the wanted fields; or else all,
    without fields."""
    logs: dict[int, ChannelLog] = {}
    for block in file.blocks:
        for number in block.counts:
            channel = file.channels[number]
            if wanted is not None and channel.topic not in wanted:
                continue
            if number not in logs:
                schema = file.schemas.get(channel.schema_id)
                paths = [*dict.fromkeys(wanted[channel.topic])] if wanted else []
                reader = (
                    message_fields.Reader(paths, message_fields.type_of(channel, schema))
                    if wanted
                    else None
                )
                logs[number] = ChannelLog(channel, schema, reader)
            one, mine = logs[number], block.only(block.channel == number)
            if one.first is None:
                one.first = mine.buffer[int(mine.starts[0]) : int(mine.starts[0] + mine.lengths[0])]
            one.stamps.append(mine.log_time)
            one.sequence.append(mine.sequence)
            try:
                if one.reader:
                    one.reader.read(mine.buffer, mine.starts, mine.lengths)
            except message_fields.NoNumberError as error:
                raise one.wrong_field(str(error)) from error
    empty = {
        n: ChannelLog(one, file.schemas.get(one.schema_id)) for n, one in file.channels.items()
    }
    return (
        [*logs.values()]
        if wanted is not None
        else [one for _, one in sorted((empty | logs).items())]
    )


class Decoded(NamedTuple):
    """The messages of one topic, channel by channel in the order of recording; every array has
    shape (n,)."""

    log_time: message_fields.Indices  # when each message was logged [ns]
    channel: NDArray[np.uint16]  # number of each message's channel
    values: message_fields.Values  # numbers by path of the field
    how: list[dict[str, Any]]  # how the messages of each channel were decoded, for the provenance


def unusable(topic: str, own: Sequence[tuple[ChannelLog, message_fields.Columns]]) -> InputError:
    """The error for a topic without a message that can be used."""
    for one, columns in own:
        if one.reader and columns.misfits == one.reader.no_numbers:
            return one.wrong_field(columns.misfit)
    return InputError(
        f"topic '{topic}': {own[0][1].misfit}; record the log again, or exclude the trial"
    )


def decode_topics(
    file: MessageFile, wanted: Mapping[str, Sequence[str]], optional: Collection[str] = ()
) -> dict[str, Decoded]:
    """The wanted fields of each topic, from all channels; InputError if one that is not `optional`
    is not there."""
    logs = [(one, one.columns(file.damage)) for one in read_channels(file, wanted)]
    topics = sorted({channel.topic for channel in file.channels.values()})
    found = {}
    for topic, paths in wanted.items():
        own = [(one, columns) for one, columns in logs if one.channel.topic == topic]
        if topic not in topics:
            said = (
                f"no topic '{topic}' (the file has {listing(topics)}); correct `topic` in the"
                " source file"
            )
            raise InputError(f"{said}, or exclude the trial if its log is not the right one")
        if not own:
            raise InputError(f"topic '{topic}' has no messages; check that its sensor was running")
        used = [(one, columns) for one, columns in own if columns.rows.size]
        if not used:
            raise unusable(topic, own)
        values = {}
        for path in paths:
            values[path] = message_fields.joined_masked(
                [columns.values[path] for _, columns in used]
            )
            if path not in optional and np.ma.getmaskarray(values[path]).all():
                said = (
                    f"topic '{topic}' has no field '{path}' (it has {own[0][0].names_of_fields()})"
                )
                remedy = (
                    "correct `field` in the source file, or exclude the trial if its log is not the"
                    " right one"
                )
                raise InputError(f"{said}; {remedy}")
        log_time = np.concatenate([one.log_time[columns.rows] for one, columns in used])
        channel = [np.full(columns.rows.size, one.channel.id, np.uint16) for one, columns in used]
        how = [one.decoding(columns) for one, columns in own]
        found[topic] = Decoded(log_time, np.concatenate(channel), values, how)
    return found
