"""Messages by topic as channels of numbers: CDR, ROS 1, JSON and protobuf.

A container gives its messages part by part. The wanted fields are decoded at once and the bytes
dropped: an hour of messages at 1 kHz is a gigabyte, its numbers are a tenth.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from importlib.util import find_spec
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, nearest, not_installed
from osl_analysis.formats._cdr import Layout, definition_of, layout_of, rows_at
from osl_analysis.formats._objects import (
    STAMP_PARTS,
    last_name,
    masked_numbers,
    numbers_in,
    whole_stamps,
)
from osl_analysis.recording import Channel, Kind, Loss, Recording, Rows
from osl_analysis.units import name_and_ending

# what defines the messages of each encoding that is read; JSON needs no definition
SCHEMA_ENCODINGS = {"cdr": "ros2msg", "ros1": "ros1msg", "protobuf": "protobuf"}
ROS_UNITS = {
    "JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "Wrench": {"force": "N", "torque": "N*m"},
    "WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages (REP 103) by the beginning of the field. They are likely and no more:
a laboratory's effort may be a current, and a joint that slides has other ones."""
NEW_DEFINITION = (
    "record again with the definitions that its publisher was built with, or map another topic"
)


@dataclass(frozen=True)
class Schema:
    """The definition of a topic's messages."""

    name: str = ""  # `package/msg/Name`
    encoding: str = ""  # `ros2msg`, `ros1msg`, `protobuf` ...
    data: bytes = b""


@dataclass(frozen=True)
class Messages:
    """Messages of one topic in one part of a file, (messages,) each."""

    buffer: bytes
    starts: NDArray[np.int64]  # where each payload begins in the buffer [bytes]
    lengths: NDArray[np.int64]  # of each payload [bytes]
    log_times_ns: NDArray[np.int64]
    connection: int = 0  # number of the recorder's channel, as of one publisher


@dataclass(frozen=True)
class Writer:
    """Who wrote messages: the recorder's channel, and the names in them."""

    connection: int
    names: Mapping[str, Sequence[str]]  # texts that name elements of arrays, by path

    @property
    def text(self) -> str:
        """It, for messages to the user."""
        names = [f"{path} [{listing(texts, 6)}]" for path, texts in self.names.items()]
        return " and ".join(names) or f"channel {self.connection} of the recorder"

    def is_other(self, other: "Writer") -> bool:
        """Whether another publisher wrote the messages of another writer: names may lack in some
        messages, and are others in none."""
        shared = self.names.keys() & other.names.keys()
        has_other_names = any(self.names[path] != other.names[path] for path in shared)
        return self.connection != other.connection or has_other_names


@dataclass
class Part:
    """The wanted numbers of some messages of one writer."""

    places: NDArray[np.int64]  # among all messages of the topic, from 0
    log_times_ns: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]  # by path; a path that is missing has no number there
    writer: int  # its number in the topic's `writers`


@dataclass
class Topic:
    """One topic, to which messages are added part by part.

    Attributes
    ----------
    wanted
        Paths of the fields to read; None for all.
    undefined
        Why its messages have no definition, and what to do; empty where they have.
    undecodable
        Why none of its messages can be decoded, and what to do.
    lost
        Number of messages that are not what their type says; `reason` is that of the first.
    """

    name: str
    encoding: str
    schema: Schema = Schema()
    wanted: Sequence[str] | None = None
    undefined: str = ""
    count: int = 0
    undecodable: str = ""
    lost: int = 0
    reason: str = ""
    parts: list[Part] = field(default_factory=list)
    listed: dict[str, None] = field(default_factory=dict)  # paths of its numbers, for messages
    writers: list[Writer] = field(default_factory=list)
    # by connection and length of the message: its layouts, each with its writer
    layouts: dict[tuple[int, int], list[tuple[Layout, int]]] = field(default_factory=dict)

    @cached_property
    def decode(self) -> Callable[[bytes], Any] | None:
        """A function that makes an object of a message; None where layouts decode it.

        Raises
        ------
        InputError
            Its messages cannot be decoded.
        """
        if self.undefined:
            raise InputError(self.undefined)
        if self.encoding == "json":
            return json.loads
        if SCHEMA_ENCODINGS.get(self.encoding) != self.schema.encoding:
            raise InputError(
                f"encoded as {self.encoding or 'nothing'} ({self.schema.encoding or 'no schema'}),"
                " and read are cdr (ros2msg), ros1 (ros1msg), protobuf (protobuf) and json; convert"
                " the log"
            )
        if self.encoding == "protobuf":
            return _protobuf_decoder(self.schema)
        self.layout_of(b"")
        return None

    def layout_of(self, data: bytes) -> Layout:
        """The layout of a message of ROS. Without a message, its definition is only checked."""
        text = self.schema.data.decode(errors="replace")
        definition = definition_of(self.schema.name, text, self.encoding == "ros1")
        return layout_of(definition, data) if data else Layout()

    def add(self, messages: Messages) -> None:
        """Decode the wanted fields of more messages."""
        try:
            decode = self.decode
        except InputError as error:
            self.undecodable = f"{error.reason}; {error.remedy or NEW_DEFINITION}"
        else:
            if decode is None:
                self._add_by_layout(messages)
            else:
                self._add_objects(messages, decode)
        self.count += messages.starts.size

    def _add_by_layout(self, messages: Messages) -> None:
        remaining = np.arange(messages.starts.size)
        while remaining.size:  # the messages of one length at a time
            length = int(messages.lengths[remaining[0]])
            is_alike = messages.lengths[remaining] == length
            alike = remaining[is_alike]
            rows = rows_at(messages.buffer, messages.starts[alike], length)
            self._add_rows(alike, rows, messages)
            remaining = remaining[~is_alike]

    def _add_rows(
        self, places: NDArray[np.int64], rows: NDArray[np.void], messages: Messages
    ) -> None:
        """Decode messages of one length, layout by layout."""
        layouts = self.layouts.setdefault((messages.connection, rows.itemsize), [])
        tried = 0
        while places.size:
            if tried == len(layouts):  # the first message of a layout tells it
                try:
                    layout = self.layout_of(rows[0].tobytes())
                except InputError as error:
                    self._lose(error)
                    places = places[1:]
                    rows = rows[1:]
                    continue
                self.listed.update(dict.fromkeys(layout.listed()))
                layouts.append((layout, self._writer(messages.connection, layout.names())))
            layout, writer = layouts[tried]
            fits = layout.fits(rows)
            if fits.any():
                self._keep(layout, writer, places[fits], rows[fits], messages)
                places = places[~fits]
                rows = rows[~fits]
            tried += 1

    def _keep(
        self,
        layout: Layout,
        writer: int,
        places: NDArray[np.int64],
        rows: NDArray[np.void],
        messages: Messages,
    ) -> None:
        columns: dict[str, NDArray[Any]] = {}
        for path in layout.listed() if self.wanted is None else self.wanted:
            column = layout.column(path, rows)
            if column is not None:
                columns[path] = column
        log_times_ns = messages.log_times_ns[places]
        self.parts.append(Part(self.count + places, log_times_ns, columns, writer))

    def _add_objects(self, messages: Messages, decode: Callable[[bytes], Any]) -> None:
        """Decode messages that become objects, one by one."""
        rows: list[int] = []
        decoded: list[dict[str, float | bool]] = []
        bounds = zip(messages.starts.tolist(), messages.lengths.tolist(), strict=True)
        for row, (start, length) in enumerate(bounds):
            try:
                numbers = numbers_in(decode(messages.buffer[start : start + length]))
            except (ValueError, RecursionError) as error:
                self._lose(error)
                continue
            rows.append(row)
            decoded.append(numbers)
        self.listed.update(dict.fromkeys(path for numbers in decoded for path in numbers))
        columns: dict[str, NDArray[Any]] = {}
        for path in self.listed if self.wanted is None else self.wanted:
            if path in self.listed:
                columns[path] = masked_numbers(path, [numbers.get(path) for numbers in decoded])
        places = np.array(rows, np.int64)
        writer = self._writer(messages.connection, {})
        log_times_ns = messages.log_times_ns[places]
        self.parts.append(Part(self.count + places, log_times_ns, columns, writer))

    def _writer(self, connection: int, names: Mapping[str, Sequence[str]]) -> int:
        """The number of a writer."""
        writer = Writer(connection, names)
        if writer not in self.writers:
            self.writers.append(writer)
        return self.writers.index(writer)

    def _lose(self, error: Exception) -> None:
        self.lost += 1
        self.reason = self.reason or " ".join(str(error).split())


def _protobuf_decoder(schema: Schema) -> Callable[[bytes], Any]:
    """A function that makes a message of protobuf."""
    if find_spec("mcap_protobuf") is None:
        raise not_installed("protobuf", "mcap-protobuf-support")
    # these cost time to import, and few logs need them
    from google.protobuf.message import DecodeError
    from mcap.records import Schema as Record
    from mcap_protobuf.decoder import DecoderFactory

    try:
        record = Record(1, schema.data, schema.encoding, schema.name)
        decode: Any = DecoderFactory().decoder_for("protobuf", record)
        decode(b"")
    except Exception as error:  # whatever the library meets in a damaged definition
        reason = " ".join(str(error).split())
        raise InputError(f"schema {schema.name}: cannot be read: {reason}") from error

    def checked(payload: bytes) -> Any:
        try:
            return decode(payload)
        except DecodeError as error:
            raise InputError(
                f"a message of {len(payload)} bytes is not what its schema says, or is damaged"
            ) from error

    return checked


def wanted_fields(source: Any) -> dict[str, list[str]] | None:
    """The fields that a source file asks for, by topic; None without a source file."""
    if source is None:
        return None
    wanted: dict[str, list[str]] = {}
    for channel in source.channels.values():
        fields = wanted.setdefault(channel.topic, [])
        fields += [path for path in (channel.field, channel.counter) if path]
        if source.time.source == "header":
            fields += [path for pair in stamp_fields(source.time.field) for path in pair]
    return {topic: list(dict.fromkeys(fields)) for topic, fields in wanted.items()}


class Container:
    """A file of messages that is read part by part: its topics, and how much of it was read."""

    def __init__(self, wanted: Mapping[str, list[str]] | None) -> None:
        self.wanted = wanted  # fields by topic; None for all
        self.topics: dict[tuple[Any, ...], Topic] = {}  # those that are wanted
        self.read: Counter[Any] = Counter()  # messages by topic or by channel
        self.chunks = 0
        self.chunks_lost = 0
        self.remarks: list[str] = []

    def topic_of(
        self, name: str, encoding: str, schema: Schema, undefined: str = ""
    ) -> Topic | None:
        """The topic of some channel of the recorder; None where it is not wanted."""
        if self.wanted is not None and name not in self.wanted:
            return None
        fields = None if self.wanted is None else self.wanted[name]
        topic = Topic(name, encoding, schema, fields, undefined)
        return self.topics.setdefault((name, encoding, schema), topic)

    def recording(self, format_name: str, size: int, loss: Loss, source: Any) -> Recording:
        """What was read of a file of a size [bytes]; arguments and errors of `recording_of`."""
        facts = {"bytes": size, "chunks": self.chunks, "chunks_lost": self.chunks_lost}
        facts["messages"] = self.read.total()
        return recording_of(format_name, [*self.topics.values()], loss, facts, source)


def stamp_fields(path: str) -> list[tuple[str, str]]:
    """Paths of the seconds and nanoseconds of a stamp, as programs call them."""
    return [(f"{path}.{seconds}", f"{path}.{rest}") for seconds, rest in STAMP_PARTS]


def recording_of(
    format_name: str, topics: Sequence[Topic], loss: Loss, facts: Mapping[str, Any], source: Any
) -> Recording:
    """Put topics that were read together.

    Parameters
    ----------
    topics
        Those that were read; several of one name have messages of several types.
    loss
        What the container tells of losses, with all its topics; those of decoding are added.
    source
        The source file, or None. It names the stamp in the messages that is their time.

    Raises
    ------
    InputError
        Two publishers wrote into a topic that the source file names.
    """
    stamp = "header.stamp" if source is None else str(source.time.field)
    remarks = [*loss.remarks]
    by_topic = dict(loss.by_topic)
    channels: list[Channel] = []
    for topic in topics:
        where = f"topic '{topic.name}'"
        if topic.undecodable:
            remarks.append(f"{where}: its fields cannot be listed: {topic.undecodable}")
        if topic.lost:
            read, expected = by_topic.get(topic.name, (topic.count, None))
            by_topic[topic.name] = (read - topic.lost, read if expected is None else expected)
            remarks.append(
                f"{topic.lost} of {topic.count} messages of {where} are lost: {topic.reason}"
            )
        try:
            _check_one_publisher(topic, topics, stamp)
        except InputError as error:
            if source is not None:
                raise
            remarks.append(str(error))
        channels += _channels_of(topic, stamp, is_asked=source is not None)
    return Recording(
        format=format_name,
        channels=channels,
        loss=replace(loss, by_topic=by_topic, remarks=remarks),
        facts=facts,
        find_unlisted=partial(_find_unlisted, topics, sorted(by_topic)),
    )


def _find_unlisted(
    topics: Sequence[Topic], names: Sequence[str], address: Mapping[str, str]
) -> Channel | None:
    """Say why a topic has no numbers for a field."""
    name = address.get("topic", "")
    path = address.get("field", "")
    if name not in names:
        advice = nearest(name, names) or "; correct `topic` in the source file"
        raise InputError(f"no topic '{name}' (the file has {listing(names)}){advice}")
    of_name = [topic for topic in topics if topic.name == name and topic.count]
    if not of_name:
        raise InputError(f"topic '{name}' has no messages; check that its sensor was running")
    topic = of_name[0]
    if topic.undecodable:
        raise InputError(f"topic '{name}': {topic.undecodable}")
    if topic.lost == topic.count:
        raise InputError(f"topic '{name}': {topic.reason}; record the log again")
    advice = nearest(path, [*topic.listed]) or "; correct `field` in the source file"
    raise InputError(
        f"topic '{name}' has no number '{path}' (it has {listing([*topic.listed])}){advice}"
    )


def _check_one_publisher(topic: Topic, topics: Sequence[Topic], stamp: str) -> None:
    """Refuse a topic whose numbers come from several writers at the same time: their values would
    be mixed, sample by sample.

    Publishers of different joints may share a topic, where each joint is asked by its name.
    """
    if any(other is not topic and other.name == topic.name and other.count for other in topics):
        raise InputError(
            f"topic '{topic.name}' has messages of several types; record each under a topic of its"
            " own"
        )
    of_head = {path for pair in stamp_fields(stamp) for path in pair}
    for ours, theirs in combinations(range(len(topic.writers)), 2):
        if not topic.writers[ours].is_other(topic.writers[theirs]):
            continue
        both = [[part for part in topic.parts if part.writer == one] for one in (ours, theirs)]
        paths = [{path for part in parts for path in part.columns} for parts in both]
        shared = [path for path in paths[0] & paths[1] - of_head if not path.startswith("header.")]
        spans = [_span(parts) for parts in both]
        if shared and spans[0][0] < spans[1][1] and spans[1][0] < spans[0][1]:
            counts = [sum(part.places.size for part in parts) for parts in both]
            raise InputError(
                f"topic '{topic.name}' has two publishers at the same time: {counts[0]} messages"
                f" are of {topic.writers[ours].text}, {counts[1]} of {topic.writers[theirs].text};"
                " record each under a topic of its own"
            )


def _span(parts: Sequence[Part]) -> tuple[int, int]:
    """Log times of the first and the last message of some parts [ns]."""
    first = min(int(part.log_times_ns.min()) for part in parts)
    last = max(int(part.log_times_ns.max()) for part in parts)
    return first, last


def _channels_of(topic: Topic, stamp: str, is_asked: bool) -> Iterator[Channel]:
    """The channels of one topic, which share its rows."""
    table = _table_of(topic)
    rows = Rows(
        count=table.log_times_ns.size,
        name=topic.name,
        stamps_ns=table.log_times_ns,
        lines=table.places + 1 if topic.lost else None,
        noun="message",
    )
    units = ROS_UNITS.get(topic.schema.name.rpartition("/")[2], {})
    for path in table.columns:
        if path.startswith("header.") and not is_asked:
            continue  # every message of ROS has a header, and no signal is in it
        name = last_name(path)
        likely = next((unit for start, unit in units.items() if path.startswith(start)), "")
        yield Channel(
            address={"topic": topic.name, "field": path},
            rows=rows,
            read=partial(table.columns.__getitem__, path),
            name=name,
            likely_unit=likely or name_and_ending(name)[1],
        )
    for names in stamp_fields(stamp):
        if set(names) <= table.columns.keys():
            seconds, nanoseconds = (table.columns[name] for name in names)
            yield Channel(
                address={"topic": topic.name, "field": stamp},
                rows=rows,
                read=partial(whole_stamps, seconds, nanoseconds, names, "message"),
                name=last_name(stamp),
                unit="ns",
                kind=Kind.CLOCK,
            )
            break


def _table_of(topic: Topic) -> Part:
    """The messages of a topic in the order of the file; its parts are dropped, since an hour of
    messages need not be held twice."""
    parts = topic.parts
    topic.parts = []
    places = np.concatenate([np.zeros(0, np.int64), *(part.places for part in parts)])
    log_times_ns = np.concatenate([np.zeros(0, np.int64), *(part.log_times_ns for part in parts)])
    columns: dict[str, NDArray[Any]] = {}
    for path in topic.listed if topic.wanted is None else topic.wanted:
        pieces = [part.columns.pop(path, None) for part in parts]
        if any(piece is not None for piece in pieces):
            columns[path] = _joined(pieces, parts)
    order = np.argsort(places, kind="stable")
    if (order[1:] < order[:-1]).any():
        places = places[order]
        log_times_ns = log_times_ns[order]
        columns = {path: column[order] for path, column in columns.items()}
    return Part(places, log_times_ns, columns, 0)


def _joined(pieces: Sequence[NDArray[Any] | None], parts: Sequence[Part]) -> NDArray[Any]:
    """A column in one piece, masked where a part has no such number."""
    present = [
        # a masked truth value takes the type of what it is joined to
        np.ma.array(np.zeros(part.places.size, np.bool_), mask=True) if piece is None else piece
        for piece, part in zip(pieces, parts, strict=True)
    ]
    if any(np.ma.isMaskedArray(piece) for piece in present):
        return np.ma.concatenate(present)  # type: ignore[no-any-return, no-untyped-call]
    return np.concatenate(present)  # ten times as fast
