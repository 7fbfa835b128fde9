"""An MCAP recorder as a laboratory's: ROS 2 messages in CDR, one wide topic, zstd chunks with CRCs."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from mcap.writer import Writer
from numpy.typing import ArrayLike, NDArray

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.trial import Array

ENCAPSULATION = b"\x00\x01\x00\x00"
"""CDR, little endian; everything after it is aligned as if it began here."""

LATENCY_NS = 150_000
"""From a sample's stamp to its arrival at the recorder."""

CDR_TYPES = {"bool": "u1", "uint8": "u1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}


def write_mcap(
    path: Path,
    topic: str,
    schema_name: str,
    schema_text: str,
    frame_id: str,
    time: Array,
    columns: Mapping[str, ArrayLike],
) -> None:
    """Write one topic, a message per time stamp [s] (whole nanoseconds from 0 to 2^31 s), shape (n,) each column.

    `schema_text` is ros2msg: `std_msgs/Header header` first, then the columns as scalars in any order; they are
    cast to the types given there. The file appears whole or not at all.

    Raises
    ------
    InputError
        The schema and the columns do not name the same fields, or a field's type is not a plain scalar.
    """
    stamps = np.rint(np.asarray(time) * 1e9).astype(np.int64)
    records = cdr_records(schema_text, schema_name, frame_id, stamps, columns)
    size, data = records.itemsize, records.tobytes()
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.add_metadata("recording", {"origin": "simulated", "topic": topic, "time": "header stamp"})
        schema = writer.register_schema(schema_name, "ros2msg", schema_text.encode())
        channel = writer.register_channel(topic, "cdr", schema)
        for i, stamp in enumerate(stamps.tolist()):
            writer.add_message(channel, stamp + LATENCY_NS, data[i * size : (i + 1) * size], stamp, i)
        writer.finish()  # type: ignore[no-untyped-call]


def cdr_records(
    schema_text: str, schema_name: str, frame_id: str, stamps: NDArray[np.int64], columns: Mapping[str, ArrayLike]
) -> "np.ndarray[tuple[int], np.dtype[np.void]]":
    """The messages as a structured array of equally long records, padding included and zero."""
    types = field_types(schema_text, schema_name)
    if set(types) != set(columns):
        raise InputError(
            f"{schema_name}: the schema has {', '.join(types)} and the columns are {', '.join(columns)}; "
            "give both the same fields"
        )
    name = frame_id.encode() + b"\0"
    records = np.zeros(len(stamps), cdr_layout(types, len(name)))
    records["encapsulation"], records["frame_id_length"], records["frame_id"] = ENCAPSULATION, len(name), name
    records["sec"], records["nanosec"] = np.divmod(stamps, 10**9)
    for field, values in columns.items():
        records[f"field.{field}"] = np.asarray(values)
    return records


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
    """Record with each member aligned to its own size, counted from after the encapsulation."""
    members = {
        "encapsulation": "V4", "sec": "<i4", "nanosec": "<u4", "frame_id_length": "<u4", "frame_id": f"S{frame_id_size}"
    }  # fmt: skip
    members |= {f"field.{name}": kind for name, kind in types.items()}
    offsets, end = [], 0
    for name, kind in members.items():
        size = np.dtype(kind).itemsize
        alignment = 1 if name in ("encapsulation", "frame_id") else size
        start = end if end == 0 else 4 + -(-(end - 4) // alignment) * alignment
        offsets.append(start)
        end = start + size
    return np.dtype({"names": list(members), "formats": list(members.values()), "offsets": offsets, "itemsize": end})
