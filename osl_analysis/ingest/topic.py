"""Fields of one MCAP topic, decoded: whatever the lengths, shapes, channels and file order of its messages."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.cdr import Indices, field_names, layout_of, leaf_at, read_leaves
from osl_analysis.ingest.mcap_records import McapFile
from osl_analysis.ingest.ros2_schema import Definitions, parse_schema, short_name


@dataclass(frozen=True)
class Decoded:
    """Messages in order of log time [ns]: each field's values, in its own number type, and whether it was there.

    Every array has shape (n,).
    """

    log_time: Indices
    values: dict[str, NDArray[Any]]
    present: dict[str, NDArray[np.bool_]]


def decode_topic(file: McapFile, topic: str, paths: Sequence[str]) -> Decoded:
    """The fields at `paths`, from all channels of a topic.

    Raises
    ------
    InputError
        The topic or a field is not there, it has no messages, or they cannot be decoded.
    """
    numbers = [number for number, channel in file.channels.items() if channel.topic == topic]
    if not numbers:
        topics = sorted({channel.topic for channel in file.channels.values()})
        raise InputError(f"no topic '{topic}'; the file has {', '.join(topics) or 'none'}")
    numbers = [number for number in numbers if file.batches.get(number)]
    if not numbers:
        raise InputError(f"topic '{topic}' has no messages; check that its sensor was running")
    decoded = merged([part for number in numbers for part in decode_channel(file, number, paths)], paths)
    for path in paths:
        if not decoded.present[path].any():
            fields = ", ".join(fields_of(file, numbers[0]))
            raise InputError(f"topic '{topic}' has no field '{path}'; it has {fields}")
    return decoded


def decode_channel(file: McapFile, number: int, paths: Sequence[str]) -> Iterator[Decoded]:
    """The fields at `paths`, once per shape of message."""
    name, definitions = message_type(file, number)
    for batch in file.batches[number]:
        log_time, rows = batch.log_time, batch.rows
        while log_time.size:
            layout = layout_of(definitions, name, rows[0].tobytes())
            leaves = {path: leaf for path in paths if (leaf := leaf_at(layout, path))}
            same = (rows[:, layout.guards] == rows[0, layout.guards]).all(axis=1)
            yield of_one_shape(log_time[same], read_leaves(rows[same], leaves), paths)
            log_time, rows = log_time[~same], rows[~same]


def of_one_shape(log_time: Indices, found: dict[str, NDArray[Any]], paths: Sequence[str]) -> Decoded:
    """Values of messages of one shape; a field that the shape lacks is absent in all of them."""
    absent = np.zeros(log_time.size, bool)  # joins with any number type without changing it
    values = {path: found.get(path, absent) for path in paths}
    return Decoded(log_time, values, {path: np.full(log_time.size, path in found) for path in paths})


def message_type(file: McapFile, number: int) -> tuple[str, Definitions]:
    """Name and definitions of a channel's messages.

    Raises
    ------
    InputError
        The messages are not ROS 2 CDR, or the schema cannot be read.
    """
    channel = file.channels[number]
    schema = file.schemas.get(channel.schema_id)
    encoding = schema.encoding if schema else "no schema"
    if schema is None or channel.message_encoding != "cdr" or encoding != "ros2msg":
        raise InputError(
            f"topic '{channel.topic}' is encoded as {channel.message_encoding} ({encoding}); "
            "only ROS 2 messages, cdr (ros2msg), are read: convert the log"
        )
    return short_name(schema.name), parse_schema(schema.name, schema.data.decode(errors="replace"))


def fields_of(file: McapFile, number: int) -> list[str]:
    """The fields of a channel's first message."""
    name, definitions = message_type(file, number)
    return field_names(layout_of(definitions, name, file.batches[number][0].rows[0].tobytes()))


def merged(parts: Sequence[Decoded], paths: Sequence[str]) -> Decoded:
    """All parts in order of log time; messages of equal log time stay in file order."""
    log_time = np.concatenate([part.log_time for part in parts])
    order = np.argsort(log_time, kind="stable")
    return Decoded(
        log_time[order],
        {path: np.concatenate([part.values[path] for part in parts])[order] for path in paths},
        {path: np.concatenate([part.present[path] for part in parts])[order] for path in paths},
    )
