"""One channel of an MCAP file: which reader decodes its messages, and which fields they have."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.mcap.chunk import MessageBlock
from osl_analysis.formats.mcap.limits import REMEDY, RefusedFileError, WrongFieldError
from osl_analysis.formats.message_file import MessageFile
from osl_analysis.formats.messages import cdr, ros1
from osl_analysis.formats.messages.description import FieldDescription, describe_json
from osl_analysis.formats.messages.effort import Effort, EffortError, LongMessageError, TextEffort, effort_for
from osl_analysis.formats.messages.json_messages import ByText
from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.formats.messages.one_by_one import Values, WholeArrayError
from osl_analysis.formats.messages.templates import ByShape

Reader = ByShape | ByText
ENCODINGS = (("cdr", "ros2msg"), ("ros1", "ros1msg"), ("protobuf", "protobuf"))  # of messages and schema; JSON: none
NOT_DEFINED = "not defined"
"""Key in a channel's metadata under which a reader says why the channel has no schema, and what to do."""


@dataclass
class ChannelReader:
    """One channel's reader, and what it has read so far."""

    channel: Channel
    """Topic and encoding."""
    schema: Schema | None
    """Schema of the messages; None for JSON."""
    reader: Reader
    """Reads the wanted fields."""
    parts: list[tuple[Indices, Values]] = field(default_factory=list)
    """Places among the channel's messages, and values, of batches of messages."""
    log_times: list[Indices] = field(default_factory=list)
    """When the messages of each block were logged [ns]."""
    sequences: list[NDArray[np.uint32]] = field(default_factory=list)
    """Their sequence numbers."""
    first: bytes = b""
    """The first message, to list its fields."""
    messages: int = 0
    """Messages so far."""
    remedy: str = REMEDY
    """What to do where the messages are too much to decode."""

    def add(self, mine: MessageBlock) -> None:
        """Read messages of a block, all of which are the channel's."""
        if not self.messages:
            self.first = mine.buffer[int(mine.starts[0]) : int(mine.starts[0] + mine.lengths[0])]
        try:
            for rows, values in self.reader.read(mine.buffer, mine.starts, mine.lengths):
                self.parts.append((self.messages + rows, values))
        except LongMessageError as error:
            raise RefusedFileError(f"topic '{self.channel.topic}': {error}") from error
        except EffortError as error:
            raise RefusedFileError(f"topic '{self.channel.topic}': {error}; {self.remedy}") from error
        except WholeArrayError as error:
            raise self.wrong_field(str(error)) from error
        self.messages += mine.starts.size
        self.log_times.append(mine.log_time)
        self.sequences.append(mine.sequence)

    def settle(self) -> None:
        """Take the messages in which a truth value stands where others have a number for misfits."""
        counts = [set(values) - self.truths(values) for _, values in self.parts]
        numeric = set().union(*counts)
        for rows, values in self.parts:
            mixed = self.truths(values) & numeric
            if mixed:
                path = min(mixed)
                shown = str(bool(values[path][0])).lower()
                self.reader.misfits += rows.size
                self.reader.misfit = self.reader.misfit or (
                    f"field '{path}' is {shown}, not a number as elsewhere, in message {int(rows[0]) + 1}"
                )
        self.parts = [(rows, values) for rows, values in self.parts if not self.truths(values) & numeric]

    @staticmethod
    def truths(values: Values) -> set[str]:
        """Paths at which truth values stand."""
        return {path for path, numbers in values.items() if numbers.dtype == bool}

    def wrong_field(self, what: str) -> WrongFieldError:
        """The error for a field that is no number in any message; it names those that are."""
        fields = names_of_fields(self, "")
        return WrongFieldError(
            f"topic '{self.channel.topic}': {what} (it has {fields}); name a number, or one element of an array, as "
            "`field` in the source file"
        )

    def how(self) -> dict[str, Any]:
        """How its messages were decoded, for the provenance."""
        return {
            "channel": self.channel.id,
            "encoding": self.channel.message_encoding,
            "messages": self.messages,
            "one_by_one": self.reader.read_alone,
            "misfits": self.reader.misfits,
        }


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
    if channel.message_encoding == "ros1":
        return ros1.describe_ros1(schema, payload)
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
    words = [
        field.addresses() if chosen or field.labels else [field.in_words()]
        for field in chosen or fields
        if field.length != 0
    ]
    return listing([one for several in words for one in several])


def reader_of(
    file: MessageFile, number: int, paths: Sequence[str], either: Collection[str], texts: TextEffort
) -> ChannelReader:
    """A reader for the messages of a channel; `texts` limits the JSON of all channels.

    Raises
    ------
    InputError
        The encoding is not one that is read, or the schema cannot be read.
    """
    channel = file.declared.channels[number]
    schema = file.declared.schemas.get(channel.schema_id)
    check_encoding(channel, schema)
    remedy = file.budget.remedy
    if channel.message_encoding == "json" or schema is None:
        return ChannelReader(channel, schema, ByText(paths, either, effort=texts), remedy=remedy)
    try:
        reader = reader_by_schema(channel, schema, paths, effort_for(file.budget.file_bytes))
        return ChannelReader(channel, schema, reader, remedy=remedy)
    except InputError as error:
        raise InputError(
            f"topic '{channel.topic}': {str(error).replace('; ', ', ')}; record again with the definitions that its "
            "publisher was built with, or map another topic"
        ) from error


def reader_by_schema(channel: Channel, schema: Schema, paths: Sequence[str], effort: Effort) -> ByShape:
    """A reader for binary messages; `effort` limits its walks. Raises InputError if the schema cannot be read."""
    if channel.message_encoding == "cdr":
        return cdr.cdr_reader(schema, paths, effort)
    if channel.message_encoding == "ros1":
        return ros1.ros1_reader(schema, paths, effort)
    from osl_analysis.formats.messages import protobuf

    return protobuf.protobuf_reader(schema, paths, effort)


def check_encoding(channel: Channel, schema: Schema | None) -> None:
    """Refuse messages of an encoding that is not read."""
    encoding = (channel.message_encoding, schema.encoding if schema else "no schema")
    if NOT_DEFINED in channel.metadata:
        raise InputError(f"topic '{channel.topic}': {channel.metadata[NOT_DEFINED]}")
    if encoding not in ENCODINGS and channel.message_encoding != "json":
        raise InputError(
            f"topic '{channel.topic}' is encoded as {encoding[0]} ({encoding[1]}); read are cdr (ros2msg), ros1 "
            "(ros1msg), protobuf (protobuf) and json: convert the log"
        )
