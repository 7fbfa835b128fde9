# SPDX-License-Identifier: Apache-2.0
"""Messages by topic as channels of numbers: those of ROS 1 and 2, JSON and protobuf.

A container gives its messages part by part. The wanted fields are decoded at once and the bytes
dropped: an hour of messages at 1 kHz is a gigabyte, its numbers are a tenth.

A path is dotted: `position[0]`; in messages of ROS also `position[name=ankle]`, the element at the
place of `ankle` in the array `name` beside it. A name with a dot or a bracket stands in brackets,
written as JSON writes a text: `functions["loadcell.mz"]`.
"""

import json
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property, partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from mcap.records import Schema
from numpy.typing import NDArray
from polars import selectors

from osl_analysis.base.errors import InputError, on_one_line, optional_module, quoted, shortened
from osl_analysis.base.files import package_yaml
from osl_analysis.base.recording import SECOND_NS, Channel, Kind, Rows
from osl_analysis.formats.message_layout import MOST_ELEMENTS, Layout, definition_of, rows_at
from osl_analysis.formats.reading import is_of_file

ROS_UNITS = package_yaml(Path(__file__).with_name("ros_units.yaml"))
"""Units of standard messages (REP 103) by the beginning of the field. They are likely and no more:
a laboratory's effort may be a current, and a joint that slides has other ones."""
MOST_FIELDS = 2000  # of objects; a robot has some hundred, and each is a column
PLAIN_NAME = re.compile(r"[^.\[\]]+")
CHOICES = re.compile(r"(\[[^\]\"]*\])+$")  # an index, or the name of an element
READ = int | float | str  # built once: a log has a million of them
# seconds and nanoseconds of a stamp: ROS, protobuf, Foxglove's JSON, ROS 1 in JSON
STAMP_PARTS = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
# of a message, as columns beside those of its numbers, whose paths never begin so
PLACE_KEY, LOG_TIME = ".place", ".log_time"

Decoded = tuple[NDArray[np.int64], str, Mapping[str, Any]]
"""Which of the messages these are, the names in them as text, and their columns by path."""


NO_SCHEMA = Schema(0, b"", "", "")
Bytes = tuple[bytes, NDArray[np.int64], NDArray[np.int64]]
"""Messages that stand in some bytes: these, where each message begins, and its length."""


class Topic:
    """One topic, to which messages are added part by part.

    Parameters
    ----------
    wanted
        Paths of the fields to read, of which there may be none; None for all.

    Attributes
    ----------
    count
        Number of its messages.
    reason, remedy
        Why the first of those that cannot be decoded cannot, and what to do.
    listed
        Paths of its numbers, read or not.
    spans
        Log times [ns] between which each number was written, by path and publisher: a channel of
        the recorder and the names in its messages.
    """

    def __init__(
        self,
        name: str,
        encoding: str,
        schema: Schema = NO_SCHEMA,
        wanted: Collection[str] | None = None,
    ) -> None:
        self.name = name
        self.encoding = encoding
        self.schema = schema
        self.wanted = wanted
        self.count = 0
        self.reason = ""
        self.remedy = ""
        self.listed: dict[str, None] = {}  # in their order, each once
        self.spans: defaultdict[str, defaultdict[str, list[int]]] = defaultdict(
            lambda: defaultdict(list)
        )
        # encoding, and encoding, name and text of the schema, of each channel of the recorder
        self.types: set[tuple[str, str, str, bytes]] = set()
        self.layouts: dict[int, Layout] = {}  # the last one, by length of the messages
        self.parts: list[dict[str, Any]] = []  # columns of each path, of a chunk of messages
        self.decode: Callable[[Bytes], Iterator[Decoded]] | None = None
        self.is_wanted = wanted is None or bool(wanted)
        try:
            self.decode = self._decoder() if self.is_wanted else None
        except Exception as error:  # whatever a library meets in a damaged definition
            self._note(error)

    def add(self, messages: Bytes, log_times_ns: NDArray[np.int64], channel: int) -> None:
        """Decode the wanted fields of more messages, of a channel of the recorder."""
        if self.decode is not None:
            for places, names, columns in self.decode(messages):
                times_ns = log_times_ns[places]
                publisher = f"channel {channel} of the recorder{names}"
                if columns:
                    span_ns = [int(times_ns.min()), int(times_ns.max())]
                    for path in columns:
                        self.spans[path][publisher] += span_ns
                place_and_time = {PLACE_KEY: self.count + places, LOG_TIME: times_ns}
                self.parts.append({**place_and_time, **columns})
        self.count += log_times_ns.size

    def _decoder(self) -> Callable[[Bytes], Iterator[Decoded]]:
        """What decodes its messages. Raises an error where nothing does."""
        schema = self.schema
        match self.encoding, schema.encoding:
            case "json", _:
                return partial(self._as_objects, json.loads)
            case "protobuf", "protobuf":
                library = optional_module(
                    "mcap_protobuf.decoder", "protobuf", "mcap-protobuf-support"
                )
                decode = library.DecoderFactory().decoder_for("protobuf", schema)
                decode(b"")
                return partial(self._as_objects, decode)
            case ("cdr", "ros2msg") | ("ros1", "ros1msg"):
                definition_of(schema.name, schema.data)  # refused here once, not by message
                return self._by_layout
            case (("cdr" | "ros1"), ""):
                raise InputError(
                    f"its type {schema.name or 'without a name'} is defined neither in the log nor"
                    " by ROS",
                    "convert the log where that type is installed, by `ros2 bag convert` to MCAP,"
                    " which stores definitions",
                )
        raise InputError(
            f"encoded as {self.encoding or 'nothing'} ({schema.encoding or 'no schema'}), and"
            " read are cdr (ros2msg), ros1 (ros1msg), protobuf (protobuf) and json",
            "convert the log, as with `ros2 bag convert` to MCAP",
        )

    def _by_layout(self, messages: Bytes) -> Iterator[Decoded]:
        """Decode messages of ROS, those of one layout at a time."""
        content, starts, lengths = messages
        for length in np.flatnonzero(np.bincount(lengths)).tolist():
            places = np.flatnonzero(lengths == length)
            rows = rows_at(content, starts[places], length)
            while places.size:
                layout = self.layouts.get(length)
                if layout is None or not layout.fits(rows[:1])[0]:
                    try:
                        layout = Layout(
                            self.schema.name,
                            self.schema.data,
                            rows[0].tobytes(),
                            is_ros1=self.encoding == "ros1",
                        )
                    except Exception as error:
                        self._note(error)
                        places = places[1:]
                        rows = rows[1:]
                        continue
                    self.listed.update(dict.fromkeys(layout.listed))
                self.layouts[length] = layout
                fits = layout.fits(rows)
                fitting = rows if fits.all() else rows[fits]  # nearly always all, and no copy
                yield places[fits], layout.names, layout.columns(fitting, self.wanted)
                places = places[~fits]
                rows = rows[~fits]

    def _as_objects(self, decode: Callable[[bytes], Any], messages: Bytes) -> Iterator[Decoded]:
        """Decode messages that become objects, one by one."""
        content, starts, lengths = messages
        objects = []
        places = []
        for place, start in enumerate(starts.tolist()):
            try:
                values: dict[str, Any] = {}
                take_values(decode(content[start : start + lengths[place]]), "", values)
                objects.append(values)
                places.append(place)
            except Exception as error:
                self._note(error)
        columns = {column.name: column for column in frame_of(objects)}
        self.listed.update(dict.fromkeys(columns))
        wanted = columns if self.wanted is None else self.wanted
        wanted_columns = {path: column for path, column in columns.items() if path in wanted}
        yield np.array(places, np.int64), "", wanted_columns

    def _note(self, error: Exception) -> None:
        """Note why messages are lost; a fault of this program is raised."""
        if not is_of_file(error):
            raise error
        if not self.reason:
            self.reason = getattr(error, "reason", shortened(on_one_line(error)))
            self.remedy = getattr(error, "remedy", "record the log again")

    def check_one_publisher(self) -> None:
        """Refuse numbers that several publishers write at one time: they would be mixed, sample by
        sample. Refuse messages of two types: those of the second would be decoded as of the first,
        and give wrong numbers where both are equally long.

        Publishers of different joints may share a topic, where each joint is asked by its name.
        """
        if len(self.types) > 1:
            raise InputError(
                f"topic '{self.name}' has messages of {len(self.types)} types",
                "record each type under a topic of its own",
            )
        for path, spans in self.spans.items():
            in_order = sorted((min(times_ns), max(times_ns)) for times_ns in spans.values())
            are_mixed = any(later[0] <= earlier[1] for earlier, later in pairwise(in_order))
            if are_mixed and not path.startswith("header."):
                raise InputError(
                    f"topic '{self.name}' has {len(spans)} publishers at the same time:"
                    f" {' or '.join([*spans][:3])}",
                    "record each under a topic of its own",
                )

    @cached_property
    def table(self) -> pl.DataFrame:
        """Its messages in the order of the file, with a column of each path that was read."""
        empty = pl.DataFrame(schema={PLACE_KEY: pl.Int64, LOG_TIME: pl.Int64})
        frames = [frame_of_parts(list(parts)) for _, parts in groupby(self.parts, column_types)]
        table = pl.concat([empty, *frames], how="diagonal_relaxed", rechunk=True)
        self.parts = []  # an hour need not be held twice
        return table if table[PLACE_KEY].is_sorted() else table.sort(PLACE_KEY)

    @property
    def lost(self) -> int:
        """Number of its messages that cannot be decoded."""
        return self.count - len(self.table)

    def column(self, path: str) -> NDArray[Any]:
        """The numbers of a field, (messages,), masked where a message has none."""
        numbers = self.table[path]
        if not numbers.null_count():
            return numbers.to_numpy()
        values = numbers.fill_null(strategy="zero").to_numpy()
        return np.ma.array(values, mask=numbers.is_null().to_numpy())

    def channels(
        self, rows: Rows, address: Mapping[str, str], stamps: Iterable[str]
    ) -> list[Channel]:
        """A channel of each number that was read, and of each stamp that there is of those asked.

        `address` is what stands before the field in that of a channel.
        """
        units = ROS_UNITS.get(self.schema.name.rpartition("/")[2], {})
        channels = []
        paths = self.table.columns[2:]  # behind place and log time
        for path in paths:
            likely = next((unit for start, unit in units.items() if path.startswith(start)), "")
            read = partial(self.column, path)
            place = {**address, "field": path}
            channels.append(Channel(place, rows, read, last_name(path), likely_unit=likely))
        for stamp in stamps:
            for parts in stamp_fields(stamp):
                if set(parts) <= set(paths):
                    read = partial(self._whole_stamps, parts)
                    place = {**address, "field": stamp}
                    name = last_name(stamp)
                    clock = Channel(place, rows, read, name, unit="ns", kind=Kind.CLOCK)
                    channels.append(clock)
        return channels

    def _whole_stamps(self, parts: Sequence[str]) -> Any:
        """Stamps [ns] (messages,) of seconds and nanoseconds, masked where one is; refused if they
        are no whole numbers."""
        seconds, nanoseconds = map(self.column, parts)
        for path, values in zip(parts, (seconds, nanoseconds), strict=True):
            if values.dtype.kind not in "iu":
                raise InputError(
                    f"field '{path}' has values that are no whole numbers", "name another time"
                )
        return SECOND_NS * seconds.astype(np.int64) + nanoseconds


def column_types(part: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Names and types of the columns of a part, in their order."""
    return [(name, values.dtype) for name, values in part.items()]


def frame_of_parts(parts: Sequence[Mapping[str, Any]]) -> pl.DataFrame:
    """One frame of parts with the same columns, arrays or series; a frame for each chunk of a log
    would take half of the time of reading."""
    columns = {}
    for name, first in parts[0].items():
        chunks = [part[name] for part in parts]
        columns[name] = (
            pl.concat(chunks) if isinstance(first, pl.Series) else np.concatenate(chunks)
        )
    return pl.DataFrame(columns)


def stamp_fields(path: str) -> list[tuple[str, str]]:
    """Paths of the seconds and nanoseconds of a stamp, as programs call them."""
    return [(f"{path}.{seconds}", f"{path}.{nanoseconds}") for seconds, nanoseconds in STAMP_PARTS]


def frame_of(objects: Sequence[Mapping[str, Any]]) -> pl.DataFrame:
    """Make a column of each number in flat objects, null where one has none, or a text that is no
    number.

    Raises
    ------
    InputError
        Names are data: each would be a column.
    """
    names = {name for values in objects for name in values}
    if len(names) > MOST_FIELDS:
        raise InputError(
            f"its messages have {len(names)} fields with names of their own",
            "record names that stay the same, and what changes as values",
        )
    frame = pl.DataFrame(objects, strict=False, infer_schema_length=None)
    numbers = frame.with_columns(selectors.string().cast(pl.Float64, strict=False))
    return numbers.select(column for column in numbers if column.null_count() < len(numbers))


def take_values(value: Any, path: str, values: dict[str, Any]) -> None:
    """Take the numbers and texts in an object, by path; of a long array the first
    `MOST_ELEMENTS`."""
    if isinstance(value, READ):
        values[path] = value
    elif isinstance(value, dict):
        for name, member in value.items():
            take_values(member, joined_path(path, name), values)
    elif isinstance(value, list):
        for index, member in enumerate(value[:MOST_ELEMENTS]):
            take_values(member, f"{path}[{index}]", values)
    elif hasattr(value, "DESCRIPTOR"):
        take_values(_members_of(value), path, values)


def _members_of(message: Any) -> dict[str, Any]:
    """The fields of a message of protobuf that are set, or always have a value."""
    members = {}
    for field in message.DESCRIPTOR.fields:
        if not field.has_presence or message.HasField(field.name):
            value = getattr(message, field.name)
            is_array = isinstance(value, Sequence) and not isinstance(value, str | bytes)
            members[field.name] = list(value) if is_array else value
    return members


@cache
def joined_path(path: str, name: str) -> str:
    """The path of a field of an object."""
    if not PLAIN_NAME.fullmatch(name):
        return f"{path}[{quoted(name)}]"
    return f"{path}.{name}" if path else name


def last_name(path: str) -> str:
    """The name at the end of a path, also where an index or a choice follows it."""
    plain = CHOICES.sub("", path)
    begin = '["' if plain.endswith('"]') else "."
    return plain.removesuffix('"]').rpartition(begin)[2]
