"""An MCAP recorder like those of laboratories: ROS 2 messages in CDR, zstd chunks with CRCs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Metadata
from numpy.typing import ArrayLike, NDArray

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.simulator.mcap_writer import Topic, write_recording
from osl_analysis.simulator.messages import LogTopic
from osl_analysis.trial import Array

ENCAPSULATION = b"\x00\x01\x00\x00"
"""CDR, little endian. Everything after it is aligned as if the message began there."""

CDR_TYPES = {"bool": "u1", "uint8": "u1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}


def write_mcap(path: Path, topic: LogTopic, time: Array, columns: Mapping[str, ArrayLike]) -> None:
    """Write one topic with a message for each time stamp [s], from 0 to 2^31 s in whole nanoseconds.

    The columns have shape (n,) each. They are cast to the types of the topic's schema. The schema lists them, in any
    order, after `std_msgs/Header header`. The file appears whole or not at all.

    Raises
    ------
    InputError
        The schema and the columns do not name the same fields, or a field's type is not a plain scalar.
    """
    write_topics(path, [topic_of(topic, nanoseconds(time), columns)])


def write_topics(path: Path, topics: Sequence[Topic]) -> None:
    """Write several topics, their messages in the order in which they arrive. The file appears whole or not at all."""
    names = ", ".join(topic.name for topic in topics)
    metadata = Metadata("recording", {"origin": "simulated", "topic": names, "time": "header stamp"})
    with atomic_path(path) as temporary:
        write_recording(temporary, topics, metadata)


def nanoseconds(time: Array) -> NDArray[np.int64]:
    """Time stamps [s] as whole nanoseconds."""
    return np.rint(np.asarray(time) * 1e9).astype(np.int64)


def topic_of(topic: LogTopic, stamps: NDArray[np.int64], columns: Mapping[str, ArrayLike]) -> Topic:
    """The messages of a logger."""
    types = field_types(topic.schema_text, topic.schema_name)
    if set(types) != set(columns):
        raise InputError(
            f"{topic.schema_name}: the schema has {', '.join(types)} and the columns are {', '.join(columns)}; "
            "give both the same fields"
        )
    constants = header(topic.frame_id)
    layout = cdr_layout(types, len(constants["frame_id"]))
    own = {f"field.{field}": np.asarray(values) for field, values in columns.items()}
    return Topic(topic.name, topic.schema_name, topic.schema_text, stamps, layout, constants, own)


def field_types(schema_text: str, schema_name: str) -> dict[str, str]:
    """numpy type of each field after the header, in the order of the message."""
    own = schema_text.split("===", maxsplit=1)[0]
    declared = [line.split("#")[0].split() for line in own.splitlines() if line.split("#")[0].strip()]
    if not declared or declared[0] != ["std_msgs/Header", "header"]:
        raise InputError(f"{schema_name}: the first field must be 'std_msgs/Header header'; put it there")
    for kind, field in declared[1:]:
        if kind not in CDR_TYPES:
            raise InputError(f"{schema_name}: field '{field}' is a {kind}; use one of {', '.join(CDR_TYPES)}")
    return {field: CDR_TYPES[kind] for kind, field in declared[1:]}


def cdr_layout(types: Mapping[str, str], frame_id_size: int) -> "np.dtype[np.void]":
    """Record of a message with a header and scalars."""
    return aligned(header_members(frame_id_size) | {f"field.{name}": kind for name, kind in types.items()})


def header_members(frame_id_size: int) -> dict[str, str]:
    """Members of a record up to the end of its header, with their numpy types."""
    return {
        "encapsulation": "V4", "sec": "<i4", "nanosec": "<u4", "frame_id_length": "<u4", "frame_id": f"S{frame_id_size}"
    }  # fmt: skip


def header(frame_id: str) -> dict[str, Any]:
    """The members of a header that are the same in all messages of a topic."""
    name = frame_id.encode() + b"\0"
    return {"encapsulation": ENCAPSULATION, "frame_id_length": len(name), "frame_id": name}


def aligned(members: Mapping[str, str]) -> "np.dtype[np.void]":
    """Record with each member aligned to its own size, counted from after the encapsulation; text is not aligned."""
    offsets, end = [], 0
    for kind in members.values():
        size = np.dtype(kind).itemsize
        alignment = 1 if np.dtype(kind).kind in "SV" else size
        start = end if end == 0 else 4 + -(-(end - 4) // alignment) * alignment
        offsets.append(start)
        end = start + size
    return np.dtype({"names": list(members), "formats": list(members.values()), "offsets": offsets, "itemsize": end})
