"""Messages by topic as channels of numbers: CDR, ROS 1, JSON and protobuf."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, nearest, optional_module
from osl_analysis.formats._cdr import MOST_ELEMENTS, Layout, layout_of
from osl_analysis.recording import Channel, Kind, Loss, Recording, Rows
from osl_analysis.units import name_and_ending

SECOND_NS = 1_000_000_000
STAMP_PARTS = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
ROS_UNITS = {
    "JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "Wrench": {"force": "N", "torque": "N*m"},
    "WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages (REP 103), which laboratories do not always keep."""


@dataclass
class Topic:
    """A topic of one type, to which messages are added part by part."""

    name: str
    encoding: str
    schema: str = ""
    text: bytes = b""
    wanted: Sequence[str] | None = None
    count: int = 0
    unread: int = 0
    reason: str = ""
    parts: list[tuple[NDArray[np.int64], dict[str, NDArray[Any]]]] = field(default_factory=list)
    layouts: list[Layout] = field(default_factory=list)
    paths: dict[str, None] = field(default_factory=dict)

    @cached_property
    def decode(self) -> Callable[[bytes], Any]:
        """A function that makes an object of a message in JSON or protobuf."""
        if self.encoding == "json":
            return json.loads
        if self.encoding != "protobuf":
            raise InputError(
                f"topic '{self.name}' is encoded as {self.encoding}; read are cdr (ros2msg), ros1,"
                " protobuf and json: convert the log"
            )
        factory = optional_module("mcap_protobuf.decoder", "protobuf")
        record = optional_module("mcap.records", "MCAP").Schema(
            1, self.text, "protobuf", self.schema
        )
        decoder: Callable[[bytes], Any] = factory.DecoderFactory().decoder_for("protobuf", record)
        return decoder

    def add(
        self,
        data: bytes,
        starts: NDArray[np.int64],
        lengths: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
    ) -> None:
        """Decode messages that stand at places in some bytes."""
        self.count += starts.size
        if self.encoding in ("cdr", "ros1"):
            self.add_by_layout(data, starts, lengths, stamps_ns)
            return
        rows = []
        for start, length in zip(starts.tolist(), lengths.tolist(), strict=True):
            try:
                rows.append(dict(numbers_in(self.decode(data[start : start + length]))))
            except Exception as error:
                self.refuse(1, error)
                rows.append({})
        paths = dict.fromkeys(path for row in rows for path in row)
        columns = {path: masked([row.get(path) for row in rows]) for path in paths}
        self.keep(stamps_ns, columns)

    def add_by_layout(
        self,
        data: bytes,
        starts: NDArray[np.int64],
        lengths: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
    ) -> None:
        remaining = np.arange(starts.size)
        content = np.frombuffer(data, np.uint8)
        while remaining.size:
            length = int(lengths[remaining[0]])
            of_length = remaining[lengths[remaining] == length]
            rows = sliding_window_view(content, length)[starts[of_length]]
            layout = next((known for known in self.layouts if self.fits_first(known, rows)), None)
            if layout is None:
                try:
                    layout = layout_of(
                        self.schema,
                        self.text.decode(errors="replace"),
                        rows[0].tobytes(),
                        self.encoding == "ros1",
                    )
                except InputError as error:
                    self.refuse(1, error)
                    remaining = remaining[1:]
                    continue
                self.layouts.append(layout)
            fits = layout.fits(rows)
            paths = layout.listed if self.wanted is None else self.wanted
            found = {path: layout.column(path, rows[fits]) for path in paths}
            columns = {path: values for path, values in found.items() if values is not None}
            self.keep(stamps_ns[of_length[fits]], columns)
            remaining = np.setdiff1d(remaining, of_length[fits], assume_unique=True)

    def fits_first(self, known: Layout, rows: NDArray[np.uint8]) -> bool:
        return max(known.shared, default=0) < rows.shape[1] and bool(known.fits(rows[:1])[0])

    def keep(self, stamps_ns: NDArray[np.int64], columns: dict[str, NDArray[Any]]) -> None:
        self.paths |= dict.fromkeys(columns)
        self.parts.append((stamps_ns, columns))

    def refuse(self, count: int, error: Exception) -> None:
        self.unread += count
        self.reason = self.reason or " ".join(str(error).split())[:120]

    def column(self, path: str) -> NDArray[Any]:
        """All numbers of a field, (messages,), masked where a message has none."""
        pieces = [
            columns.get(path, np.ma.masked_all(stamps.size, np.bool_))
            for stamps, columns in self.parts
        ]
        if any(np.ma.isMaskedArray(piece) for piece in pieces):
            return np.ma.concatenate(pieces)
        return np.concatenate(pieces)


def numbers_in(value: Any, path: str = "") -> Iterator[tuple[str, float | bool]]:
    """The numbers of an object of JSON or protobuf, by path."""
    if isinstance(value, bool | int | float):
        yield path, value
    elif isinstance(value, Mapping):
        for name, member in value.items():
            yield from numbers_in(member, f"{path}.{name}".removeprefix("."))
    elif hasattr(value, "DESCRIPTOR"):
        for item in value.DESCRIPTOR.fields:
            if not item.has_presence or value.HasField(item.name):
                own = f"{path}.{item.name}".removeprefix(".")
                yield from numbers_in(getattr(value, item.name), own)
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        for index, member in enumerate(value[:MOST_ELEMENTS]):
            yield from numbers_in(member, f"{path}[{index}]")


def masked(numbers: Sequence[float | bool | None]) -> NDArray[Any]:
    """Numbers in an array, masked where there is none."""
    mask = [number is None for number in numbers]
    values = np.array([0 if number is None else number for number in numbers])
    return np.ma.array(values, mask=mask) if any(mask) else values


def wanted_fields(source: Any) -> dict[str, list[str]] | None:
    """The fields that a source file asks for, by topic; None without a source file."""
    if source is None:
        return None
    wanted: dict[str, list[str]] = {}
    for channel in source.channels.values():
        fields = wanted.setdefault(channel.topic, [])
        fields += [path for path in (channel.field, channel.counter) if path]
        if source.time.source == "header":
            fields += [f"{source.time.field}.{part}" for pair in STAMP_PARTS for part in pair]
    return {topic: list(dict.fromkeys(fields)) for topic, fields in wanted.items()}


def recording_of(
    format_name: str, topics: Sequence[Topic], loss: Loss, facts: Mapping[str, Any], source: Any
) -> Recording:
    """Make channels of topics, and count what could not be read."""
    stamp = "header.stamp" if source is None else source.time.field
    remarks = [*loss.remarks]
    by_topic = dict(loss.by_topic)
    channels: list[Channel] = []
    for topic in topics:
        if topic.unread:
            read, expected = by_topic.get(topic.name, (topic.count, None))
            expected = read if expected is None else expected
            by_topic[topic.name] = (read - topic.unread, expected)
            remarks.append(
                f"{topic.unread} of {topic.count} messages of topic '{topic.name}' are lost:"
                f" {topic.reason}"
            )
        channels += channels_of(topic, stamp, is_asked=source is not None)

    def find_unlisted(address: Mapping[str, str]) -> Channel | None:
        name = address.get("topic", "")
        known = [topic for topic in topics if topic.name == name]
        if not known:
            names = sorted(by_topic)
            raise InputError(
                f"no topic '{name}' (the file has {listing(names)}){nearest(name, names)}"
            )
        if not known[0].count:
            raise InputError(f"topic '{name}' has no messages; check that its sensor was running")
        paths = known[0].layouts[0].listed if known[0].layouts else [*known[0].paths]
        raise InputError(
            f"topic '{name}' has no number '{address.get('field')}' (it has {listing(paths)});"
            f" correct `field` in the source file. {known[0].reason}".rstrip(". ")
        )

    return Recording(
        format=format_name,
        channels=channels,
        facts=facts,
        find_unlisted=find_unlisted,
        loss=replace(loss, by_topic=by_topic, remarks=remarks),
    )


def channels_of(topic: Topic, stamp: str, is_asked: bool) -> list[Channel]:
    """The channels of a topic, which share its rows."""
    stamps_ns = np.concatenate([own for own, _ in topic.parts] or [np.zeros(0, np.int64)])
    rows = Rows(stamps_ns.size, topic.name, stamps_ns=stamps_ns, noun="message")
    units = ROS_UNITS.get(topic.schema.rpartition("/")[2], {})
    channels: list[Channel] = []
    for path in topic.paths:
        if path.startswith("header.") and not is_asked:
            continue
        name = path.partition("[")[0].rpartition(".")[2]
        likely = next((unit for begin, unit in units.items() if path.startswith(begin)), "")
        channels.append(
            Channel(
                {"topic": topic.name, "field": path},
                rows,
                partial(topic.column, path),
                name=name,
                likely_unit=likely or name_and_ending(name)[1],
            )
        )
    for seconds, nanoseconds in STAMP_PARTS:
        parts = (f"{stamp}.{seconds}", f"{stamp}.{nanoseconds}")
        if set(parts) <= topic.paths.keys():
            channels.append(
                Channel(
                    {"topic": topic.name, "field": stamp},
                    rows,
                    partial(whole_stamps, topic, parts),
                    name=stamp.rpartition(".")[2],
                    unit="ns",
                    kind=Kind.CLOCK,
                )
            )
            break
    return channels


def whole_stamps(topic: Topic, parts: tuple[str, str]) -> NDArray[Any]:
    """Whole stamps [ns], (messages,), masked where a message has none."""
    seconds, nanoseconds = (topic.column(part).astype(np.int64) for part in parts)
    return seconds * SECOND_NS + nanoseconds
