"""Messages by topic as channels of numbers: CDR, ROS 1, JSON and protobuf.

A container gives its messages part by part. The wanted fields are decoded at once and the bytes
dropped: an hour of messages at 1 kHz is a gigabyte, its numbers are a tenth.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, not_installed
from osl_analysis.formats._objects import (
    FieldDescription,
    fields_in,
    json_object,
    last_name,
    masked_numbers,
    number_at,
)
from osl_analysis.formats._ros_shapes import (
    Leaf,
    MessageType,
    NoNumberError,
    Shape,
    message_type,
    rows_at,
    shape_of,
    shape_of_zeros,
)
from osl_analysis.recording import Channel, Kind, Loss, Recording, Rows
from osl_analysis.units import name_and_ending

Decoder = Callable[[bytes], Any]  # makes an object of a message

ROWS_AT_ONCE = 1 << 16  # messages of one shape that are copied at a time
JOINED_AT_ONCE = 64  # parts of a topic
SECOND_NS = 1_000_000_000
# seconds and nanoseconds of a stamp: ROS 2, protobuf, Foxglove's JSON, ROS 1
STAMP_PARTS = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
ROS_UNITS = {
    "sensor_msgs/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages (REP 103) by the beginning of the field. They are likely and no more:
a laboratory's effort may be a current, and a joint that slides has other ones."""


@dataclass(frozen=True)
class Schema:
    """The definition of a topic's messages."""

    name: str  # `package/msg/Name`
    encoding: str  # `ros2msg`, `ros1msg`, `protobuf` ...
    data: bytes

    @property
    def text(self) -> str:
        """A definition of ROS."""
        return self.data.decode(errors="replace")


@dataclass(frozen=True)
class Messages:
    """Messages of one topic in one part of a file, (messages,) each."""

    buffer: bytes
    starts: NDArray[np.int64]  # where each payload begins in the buffer [bytes]
    lengths: NDArray[np.int64]  # of each payload [bytes]
    log_times_ns: NDArray[np.int64]
    sequence: NDArray[np.uint32] | None = None  # the recorder's or publisher's number of each

    def payload(self, row: int) -> bytes:
        """Bytes of one message."""
        start = int(self.starts[row])
        return self.buffer[start : start + int(self.lengths[row])]


@dataclass(frozen=True)
class _KnownShape:
    """A shape of a topic's messages, with the wanted numbers in it."""

    shape: Shape
    leaves: Mapping[str, Leaf]  # by path; a path that is missing has no number in it
    writer: int


@dataclass
class _Decoded:
    """The wanted numbers of some messages of one shape."""

    places: NDArray[np.int64]  # of the messages among all of the topic, from 0
    values: dict[str, NDArray[Any]]  # by path; a path that is missing has no number there
    writer: int = 0


@dataclass(frozen=True)
class Table:
    """The messages of one topic that are what their type says, in the order of the file.

    Attributes
    ----------
    places
        Place of each among all messages of the topic, from 0, shape (rows,); None if they are all.
    writers
        Number of the writer of each, shape (rows,), if the names in them tell several.
    columns
        By path the numbers, shape (rows,), masked where a message has none.
    """

    places: NDArray[np.int64] | None
    log_times_ns: NDArray[np.int64]
    writers: NDArray[np.int64] | None
    columns: Mapping[str, NDArray[Any]]

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.log_times_ns.size


@dataclass
class Topic:
    """One topic of one channel of the recorder, to which messages are added part by part.

    Attributes
    ----------
    wanted
        Paths of the fields to read; None for all that the first message lists.
    undefined
        Why its messages have no definition, and what to do; empty where they have.
    """

    name: str
    encoding: str
    schema: Schema | None = None
    wanted: Sequence[str] | None = None
    undefined: str = ""
    count: int = 0
    first: bytes | None = None
    undecodable: str = ""  # why none of its messages can be decoded
    misfits: int = 0  # messages that are not what their type says
    misfit: str = ""  # what is wrong with the first of them
    # by field what stands in place of its first number that is none
    no_number: dict[str, str] = field(default_factory=dict)
    is_asked: bool = False  # whether a source file asks for the wanted fields
    # the names in its messages, where they name the elements of arrays, of each writer
    names_by_writer: list[dict[str, list[str]]] = field(default_factory=list)
    _log_times_ns: list[NDArray[np.int64]] = field(default_factory=list)
    _sequence: list[NDArray[np.uint32]] = field(default_factory=list)
    _decoded: list[_Decoded] = field(default_factory=list)
    _waiting: int = 0  # parts that were not joined
    _shapes: dict[int, list[_KnownShape]] = field(default_factory=dict)  # by length of the message

    @cached_property
    def type(self) -> MessageType | Decoder:
        """Its definition, or what makes objects of its messages.

        Raises
        ------
        InputError
            Its messages cannot be decoded.
        """
        if self.undefined:
            raise InputError(f"topic '{self.name}': {self.undefined}")
        if self.encoding == "json":
            return json_object
        kinds = {("cdr", "ros2msg"), ("ros1", "ros1msg"), ("protobuf", "protobuf")}
        if self.schema is None or (self.encoding, self.schema.encoding) not in kinds:
            schema = self.schema.encoding if self.schema else "no schema"
            raise InputError(
                f"topic '{self.name}' is encoded as {self.encoding} ({schema}); read are cdr"
                " (ros2msg), ros1 (ros1msg), protobuf (protobuf) and json: convert the log"
            )
        if self.encoding == "protobuf" and find_spec("mcap_protobuf") is None:
            raise not_installed(f"topic '{self.name}' in protobuf", "mcap-protobuf-support")
        try:
            if self.encoding == "protobuf":
                return _protobuf_decoder(self.schema)
            return message_type(self.schema.name, self.schema.text, self.encoding == "ros1")
        except InputError as error:
            reason = str(error).replace("; ", ", ")
            raise InputError(
                f"topic '{self.name}': {reason}; record again with the definitions that its"
                " publisher was built with, or map another topic"
            ) from error

    def add(self, messages: Messages) -> None:
        """Decode the wanted fields of more messages."""
        if not messages.starts.size:
            return
        if self.first is None:
            self.first = messages.payload(0)
            self.is_asked = self.wanted is not None
            try:
                if self.wanted is None:
                    self.wanted = [description.path for description in self.fields()]
                self.type  # noqa: B018 - whether it can be decoded is told once
            except InputError as error:
                self.undecodable = str(error)
        self._log_times_ns.append(messages.log_times_ns)
        if messages.sequence is not None:
            self._sequence.append(messages.sequence)
        if not self.undecodable:
            if isinstance(self.type, MessageType):
                self._add_by_shape(messages, self.type)
            else:
                self._add_objects(messages, self.type)
        self.count += messages.starts.size

    def _add_by_shape(self, messages: Messages, kind: MessageType) -> None:
        remaining = np.arange(messages.starts.size)
        while remaining.size:  # the messages of one length at a time
            length = int(messages.lengths[remaining[0]])
            is_alike = messages.lengths[remaining] == length
            alike = remaining[is_alike]
            remaining = remaining[~is_alike]
            for places in np.array_split(alike, 1 + alike.size // ROWS_AT_ONCE):
                rows = rows_at(messages.buffer, messages.starts[places], length)
                self._add_rows(self.count + places, rows, kind)

    def _add_rows(
        self, places: NDArray[np.int64], rows: NDArray[np.void], kind: MessageType
    ) -> None:
        """Decode messages of one length, shape by shape."""
        shapes = self._shapes.setdefault(rows.itemsize, [])
        tried = 0
        while places.size:
            if tried == len(shapes):  # the first message of a shape tells it
                try:
                    shapes.append(self._known(shape_of(kind, rows[0].tobytes())))
                except (InputError, RecursionError) as error:
                    self._count_misfit(error)
                    places = places[1:]
                    rows = rows[1:]
                    continue
            known = shapes[tried]
            fits = known.shape.fits(rows)
            if fits.all():
                self._take(known, places, rows)
                return
            if fits.any():
                self._take(known, places[fits], rows[fits])
                places = places[~fits]
                rows = rows[~fits]
            tried += 1

    def _known(self, shape: Shape) -> _KnownShape:
        """Find the wanted numbers of a new shape, and its writer."""
        leaves: dict[str, Leaf] = {}
        for path in self.wanted or ():
            try:
                leaf = shape.leaf_at(path)
            except NoNumberError as error:
                self.no_number.setdefault(path, str(error))
                continue
            if leaf is not None:
                leaves[path] = leaf
        names = shape.names()
        if names not in self.names_by_writer:
            self.names_by_writer.append(names)
        return _KnownShape(shape, leaves, self.names_by_writer.index(names))

    def _take(self, known: _KnownShape, places: NDArray[np.int64], rows: NDArray[np.void]) -> None:
        values = {path: known.shape.read(leaf, rows) for path, leaf in known.leaves.items()}
        self._decoded.append(_Decoded(places, values, known.writer))
        self._waiting += 1
        if self._waiting == JOINED_AT_ONCE:
            self._join_last()

    def _join_last(self) -> None:
        """Join the last parts where they are alike: small arrays of an hour would leave 0.2 GB of
        memory in pieces too small for its columns."""
        parts = self._decoded[-self._waiting :]
        self._waiting = 0
        first = parts[0]
        are_alike = len({(part.writer, *part.values) for part in parts}) == 1
        if are_alike and are_in_order(parts):
            places = np.concatenate([part.places for part in parts])
            values = {
                path: joined_columns([part.values[path] for part in parts]) for path in first.values
            }
            self._decoded[-len(parts) :] = [_Decoded(places, values, first.writer)]

    def _add_objects(self, messages: Messages, decode: Decoder) -> None:
        """Decode messages that become objects, one by one."""
        wanted = list(self.wanted or ())
        places: list[int] = []
        columns: list[list[float | bool | None]] = [[] for _ in wanted]
        for row in range(messages.starts.size):
            place = self.count + row
            try:
                numbers = self._numbers_of(decode(messages.payload(row)), wanted, place)
            except (ValueError, RecursionError) as error:
                self._count_misfit(error)
                continue
            places.append(place)
            for column, number in zip(columns, numbers, strict=True):
                column.append(number)
        values = {
            path: masked_numbers(path, column)
            for path, column in zip(wanted, columns, strict=True)
            if any(number is not None for number in column)
        }
        self._decoded.append(_Decoded(np.array(places, np.int64), values))

    def _numbers_of(
        self, message: Any, wanted: Sequence[str], place: int
    ) -> list[float | bool | None]:
        """The wanted numbers of an object; ValueError if another thing stands in an asked field."""
        numbers: list[float | bool | None] = []
        for path in wanted:
            try:
                numbers.append(number_at(message, path))
            except NoNumberError as error:
                reason = f"{error}, in message {place + 1}"
                self.no_number.setdefault(path, reason)
                if self.is_asked:
                    raise NoNumberError(reason) from error
                numbers.append(None)
        return numbers

    def _count_misfit(self, error: Exception) -> None:
        self.misfits += 1
        self.misfit = self.misfit or str(error)

    def fields(self) -> list[FieldDescription]:
        """List the numbers of its first message, or else of its definition.

        Raises
        ------
        InputError
            Its messages cannot be decoded.
        """
        kind = self.type
        if not isinstance(kind, MessageType):
            if self.first is None and kind is json_object:
                return []  # JSON has no definition
            return list(fields_in(kind(self.first or b""), most_elements=1))
        if self.first is not None:
            with suppress(InputError):
                return _fields_of_shape(shape_of(kind, self.first))
        return _fields_of_shape(shape_of_zeros(kind))

    def table(self) -> Table:
        """Put the messages in the order of the file, and drop the parts."""
        log_times_ns = _concatenated(self._log_times_ns)
        places = None
        order = None
        if self.misfits or self.undecodable or not are_in_order(self._decoded):
            places = _concatenated([part.places for part in self._decoded])
            order = np.argsort(places, kind="stable")
            places = places[order]
            log_times_ns = log_times_ns[places]
        columns: dict[str, NDArray[Any]] = {}
        for path in self.wanted or ():
            if any(path in part.values for part in self._decoded):
                column = self._column(path)
                columns[path] = column if order is None else column[order]
        writers = None
        if len(self.names_by_writer) > 1:
            writers = _concatenated(
                [np.full(part.places.size, part.writer) for part in self._decoded]
            )
            writers = writers if order is None else writers[order]
        self._decoded.clear()
        return Table(places, log_times_ns, writers, columns)

    def _column(self, path: str) -> NDArray[Any]:
        """The numbers of a field in the order in which they were decoded; drops them there."""
        pieces: list[NDArray[Any]] = []
        for part in self._decoded:
            if path in part.values:
                pieces.append(part.values.pop(path))
            else:
                pieces.append(absent_column(part.places.size))
        return joined_columns(pieces)

    @cached_property
    def _numbers(self) -> NDArray[np.uint32]:
        """Sequence numbers of its messages, (messages,); none where nothing counts them."""
        return _concatenated(self._sequence)

    def sequence_at(self, table: Table) -> NDArray[np.int64] | None:
        """Sequence numbers of the messages of a table, (rows,), where they go back."""
        numbers = self._numbers
        if not numbers.size or (numbers[1:] >= numbers[:-1]).all():
            return None
        numbers = numbers if table.places is None else numbers[table.places]
        return numbers.astype(np.int64)

    @cached_property
    def skipped(self) -> int:
        """Messages that the sequence numbers tell to be missing; 0 where nothing counts them."""
        numbers = self._numbers
        if (numbers[1:] - numbers[:-1] == 1).all():
            return 0
        if (numbers[1:] < numbers[:-1]).any():
            numbers = np.sort(numbers, kind="stable")
        if (numbers[1:] == numbers[:-1]).any():
            return 0
        steps = np.diff(numbers.astype(np.int64))
        return int((steps - 1).sum()) if np.median(steps) == 1 else 0


def _concatenated(parts: list[NDArray[Any]]) -> NDArray[Any]:
    """Put parts behind one another, and drop them: an hour of messages need not be held twice."""
    if len(parts) == 1:
        return parts[0]
    whole = np.concatenate(parts) if parts else np.zeros(0, np.int64)
    parts.clear()
    return whole


def are_in_order(parts: Sequence[_Decoded]) -> bool:
    """Tell whether the messages of each part stand behind those of the part before."""
    return all(part.places[-1] < next_part.places[0] for part, next_part in pairwise(parts))


def absent_column(rows: int) -> NDArray[Any]:
    """A column without a value; joined to another one it takes that one's type."""
    return np.ma.array(np.zeros(rows, np.bool_), mask=True)


def joined_columns(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Put pieces of a column behind one another; NumPy's masked arrays take ten times as long."""
    if len(pieces) == 1:
        return pieces[0]
    if any(np.ma.isMaskedArray(piece) for piece in pieces):
        return np.ma.concatenate(pieces)  # type: ignore[no-any-return, no-untyped-call]
    return np.concatenate(pieces)


def _fields_of_shape(shape: Shape) -> list[FieldDescription]:
    """List the numbers of a message of ROS; of an array of messages those of its first."""
    fields: list[FieldDescription] = []
    for path, leaf in shape.leaves.items():
        if "[" in path and not _is_first_element(path):
            continue
        kind = np.dtype(leaf.type).name
        if leaf.count is None:
            fields.append(FieldDescription(path, kind))
            continue
        name, labels = shape.labels_of(path)
        elements = [f"{name}={label}" for label in labels] or ["0"]
        fields += [
            FieldDescription(f"{path}[{element}]", f"{kind}[{leaf.count}]") for element in elements
        ]
    return fields


def _is_first_element(path: str) -> bool:
    return all(part.startswith("0]") for part in path.split("[")[1:])


def _protobuf_decoder(schema: Schema) -> Decoder:
    """Give a function that makes a message of protobuf."""
    # these cost time to import, and few logs need them
    from google.protobuf.message import DecodeError
    from mcap.exceptions import McapError
    from mcap.records import Schema as McapSchema
    from mcap_protobuf.decoder import DecoderFactory

    record = McapSchema(id=1, name=schema.name, encoding=schema.encoding, data=schema.data)
    try:
        decode: Any = DecoderFactory().decoder_for("protobuf", record)
        decode(b"")
    except (McapError, DecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"schema {schema.name}: cannot be read: {reason}") from error

    def checked(payload: bytes) -> Any:
        try:
            return decode(payload)
        except DecodeError:
            raise InputError(
                f"a message of {len(payload)} bytes is not what its schema says, or is damaged"
            ) from None

    return checked


def stamp_fields(path: str) -> list[tuple[str, str]]:
    """Paths of the seconds and nanoseconds of a stamp, as programs call them."""
    return [(f"{path}.{seconds}", f"{path}.{rest}") for seconds, rest in STAMP_PARTS]


def wanted_fields(source: Any) -> dict[str, list[str]] | None:
    """The fields that a source file asks for, by topic; None without a source file."""
    if source is None:
        return None
    wanted: dict[str, list[str]] = {}
    for channel in source.channels.values():
        fields = wanted.setdefault(channel.topic, [])
        fields += [path for path in (channel.field, channel.counter) if path]
        if source.time.source == "header":
            fields += [part for pair in stamp_fields(source.time.field) for part in pair]
    return {topic: list(dict.fromkeys(fields)) for topic, fields in wanted.items()}


def recording_of(
    format_name: str,
    topics: Sequence[Topic],
    names: Collection[str],
    loss: Loss,
    facts: Mapping[str, Any],
    source: Any,
    is_declared: bool = True,
) -> Recording:
    """Put topics that were read together.

    Parameters
    ----------
    topics
        Those that were read; several of one name are of several channels of the recorder.
    names
        Of all topics of the file, for messages to the user.
    loss
        What the container tells of losses; those of decoding are added.
    source
        The source file, or None. It names the stamp in the messages that is their time.
    is_declared
        Whether the container declares how many messages it holds. If not, gaps of their sequence
        numbers tell how many are lost.
    """
    stamp = "header.stamp" if source is None else str(source.time.field)
    remarks = [*loss.remarks]
    by_topic = dict(loss.by_topic)
    channels: list[Channel] = []
    writers_by_name: dict[str, list[Topic]] = {}
    for topic in topics:
        writers_by_name.setdefault(topic.name, []).append(topic)
    for name, writers in writers_by_name.items():
        tables = [topic.table() for topic in writers]
        remarks += _remarks_on(writers, tables)
        by_topic[name] = _counts_of(writers, by_topic.get(name), is_declared)
        channels += _channels_of(writers, tables, stamp, is_asked=source is not None)

    def find_unlisted(address: Mapping[str, str]) -> Channel | None:
        topic = address.get("topic", "")
        if topic not in names:
            raise InputError(
                f"no topic '{topic}' (the file has {listing(sorted(names))}); correct `topic` in"
                " the source file, or exclude the trial if its log is not the right one"
            )
        raise _no_field(writers_by_name.get(topic, []), topic, address.get("field", ""))

    return Recording(
        format=format_name,
        channels=channels,
        loss=replace(loss, by_topic=by_topic, remarks=remarks),
        facts=facts,
        find_unlisted=find_unlisted,
    )


def _counts_of(
    writers: Sequence[Topic], counts: tuple[int, int | None] | None, is_declared: bool
) -> tuple[int, int | None]:
    """Messages of a topic that were read, and that were recorded."""
    read, expected = counts or (sum(topic.count for topic in writers), None)
    misfits = sum(topic.misfits for topic in writers)
    if not is_declared:  # else the recorder itself dropped what its numbers skip
        skipped = sum(topic.skipped for topic in writers)
        counted = read if expected is None else expected
        if skipped > counted - read:
            expected = read + skipped
    if expected is None and misfits:
        expected = read
    return read - misfits, expected


def _no_field(writers: Sequence[Topic], topic: str, path: str) -> InputError:
    """Say why a topic has no numbers for a field."""
    if not any(writer.count for writer in writers):
        return InputError(f"topic '{topic}' has no messages; check that its sensor was running")
    first = next(writer for writer in writers if writer.count)
    if first.undecodable:
        return InputError(first.undecodable)
    if first.misfits == first.count and not first.no_number:
        return InputError(
            f"topic '{topic}': {first.misfit}; record the log again, or exclude the trial"
        )
    names = listing([description.path for description in first.fields()])
    if path in first.no_number:
        return InputError(
            f"topic '{topic}': {first.no_number[path]} (it has {names}); name a number, or one"
            " element of an array, as `field` in the source file"
        )
    return InputError(
        f"topic '{topic}' has no field '{path}' (it has {names}); correct `field` in the source"
        " file, or exclude the trial if its log is not the right one"
    )


def _remarks_on(writers: Sequence[Topic], tables: Sequence[Table]) -> list[str]:
    remarks: list[str] = []
    for topic, table in zip(writers, tables, strict=True):
        what = f"topic '{topic.name}'"
        if topic.undecodable:
            reason = topic.undecodable.removeprefix(f"{what}: ")
            remarks.append(f"{what}: its fields cannot be listed: {reason}")
        if topic.misfits:
            remarks.append(
                f"{topic.misfits} of {topic.count} messages of {what} are lost: {topic.misfit}"
            )
        missing = topic.skipped
        if missing:
            remarks.append(
                f"the sequence numbers of {what} say that {missing} messages beside its"
                f" {topic.count} are not in the file"
            )
        if table.writers is not None:
            counts = Counter(table.writers.tolist())
            kinds = topic.names_by_writer
            alike = {
                path
                for path, texts in kinds[0].items()
                if all(other.get(path) == texts for other in kinds)
            }
            shown = [
                f"{count} with {_names_text(kinds[writer], without=alike)}"
                for writer, count in counts.most_common(3)
            ]
            remarks.append(
                f"the messages of {what} are of {len(counts)} kinds, as of several publishers:"
                f" {', '.join(shown)}"
            )
    if len(writers) > 1:
        counts_text = listing([str(writer.count) for writer in writers])
        remarks.append(
            f"topic '{writers[0].name}' has {len(writers)} channels, of {counts_text} messages"
        )
    return remarks


def _names_text(names: Mapping[str, Sequence[str]], without: Collection[str]) -> str:
    """The names in the messages of a publisher, without those that all have."""
    texts_by_path = {path: texts for path, texts in names.items() if path not in without}
    if not texts_by_path:
        return "no names"
    return " and ".join(f"{path} [{listing(texts, 6)}]" for path, texts in texts_by_path.items())


def _channels_of(
    writers: Sequence[Topic], tables: Sequence[Table], stamp: str, is_asked: bool
) -> list[Channel]:
    """The channels of one topic, by the rows of all of its writers."""
    rows = _rows_of(writers, tables)
    first = next((writer for writer in writers if writer.count), writers[0])
    described: dict[str, str] = {}
    with suppress(ValueError, RecursionError):
        described = {description.path: description.type for description in first.fields()}
    paths = list(described) if first.wanted is None else first.wanted
    units: Mapping[str, str] = {}
    if first.schema is not None:
        units = ROS_UNITS.get(first.schema.name.replace("/msg/", "/"), {})
    channels: list[Channel] = []
    for path in paths:
        has_numbers = any(path in table.columns for table in tables)
        # every message of ROS has a header, and no signal is in it
        is_of_head = path.startswith("header.") and not is_asked
        is_empty = not any(writer.count for writer in writers)
        is_listed = has_numbers or (is_empty and not is_asked)
        if is_of_head or not is_listed:
            continue
        name = last_name(path)
        likely = next((unit for start, unit in units.items() if path.startswith(start)), "")
        channels.append(
            Channel(
                address={"topic": first.name, "field": path},
                rows=rows,
                read=partial(_column, tables, path),
                name=name,
                likely_unit=likely or name_and_ending(name)[1],
                type=described.get(path, ""),
            )
        )
    for parts in stamp_fields(stamp):
        if all(any(part in table.columns for table in tables) for part in parts):
            channels.append(
                Channel(
                    address={"topic": first.name, "field": stamp},
                    rows=rows,
                    read=partial(_stamps, tables, parts),
                    name=last_name(stamp),
                    unit="ns",
                    kind=Kind.CLOCK,
                )
            )
            break
    return channels


def _rows_of(writers: Sequence[Topic], tables: Sequence[Table]) -> Rows:
    """The rows of one topic, writer by writer."""
    kinds = sum(max(1, len(topic.names_by_writer)) for topic in writers)
    numbers = None
    if kinds > 1:
        numbers = _writer_numbers(writers, tables)
    sequence = None
    if len(writers) == 1:
        sequence = writers[0].sequence_at(tables[0])
    lines = None
    if len(tables) > 1 or tables[0].places is not None:
        lines = np.concatenate([_places_of(table) + 1 for table in tables])
    return Rows(
        count=sum(table.count for table in tables),
        name=writers[0].name,
        stamps_ns=_concatenated([table.log_times_ns for table in tables]),
        writers=numbers,
        sequence=sequence,
        lines=lines,
        noun="message",
    )


def _places_of(table: Table) -> NDArray[np.int64]:
    return np.arange(table.count) if table.places is None else table.places


def _writer_numbers(writers: Sequence[Topic], tables: Sequence[Table]) -> NDArray[np.int64]:
    """A number for each channel of the recorder, and for each kind of names in its messages."""
    numbers: list[NDArray[np.int64]] = []
    before = 0
    for topic, table in zip(writers, tables, strict=True):
        kinds = np.zeros(table.count, np.int64) if table.writers is None else table.writers
        numbers.append(kinds + before)
        before += max(1, len(topic.names_by_writer))
    return np.concatenate(numbers)


def _column(tables: Sequence[Table], path: str) -> NDArray[Any]:
    columns: list[NDArray[Any]] = []
    for table in tables:
        if path in table.columns:
            columns.append(table.columns[path])
        else:
            columns.append(absent_column(table.count))
    return joined_columns(columns)


def _stamps(tables: Sequence[Table], parts: tuple[str, str]) -> NDArray[Any]:
    """Whole stamps [ns], (rows,), masked where a message has none."""
    seconds, nanoseconds = (_column(tables, part) for part in parts)
    return whole_stamps(seconds, nanoseconds, parts)


def whole_stamps(
    seconds: NDArray[Any], nanoseconds: NDArray[Any], names: tuple[str, str], noun: str = "message"
) -> NDArray[Any]:
    """Join the seconds and nanoseconds of stamps to whole nanoseconds.

    Raises
    ------
    InputError
        A part is no whole number, or too large.
    """
    largest = (2**63 // SECOND_NS - 1, SECOND_NS)
    whole: list[NDArray[Any]] = []
    for name, values, most in zip(names, (seconds, nanoseconds), largest, strict=True):
        filled = np.ma.filled(values, 0)
        is_wrong = (filled < 0) | (filled > most)
        if filled.dtype.kind == "f":
            is_wrong |= filled != np.rint(filled)
        if filled.dtype == bool or is_wrong.any():
            row = int(np.argmax(is_wrong))
            raise InputError(
                f"field '{name}' is {filled[row]} in {noun} {row + 1}, which is no whole number"
                f" from 0 to {most}; name another time"
            )
        whole.append(filled.astype(np.int64))
    stamps = whole[0] * SECOND_NS + whole[1]
    mask = np.ma.getmaskarray(seconds) | np.ma.getmaskarray(nanoseconds)
    return np.ma.array(stamps, mask=mask) if mask.any() else stamps
