"""An MCAP recorder like those of laboratories: ROS 2 messages in CDR, zstd chunks with CRCs.

All messages are known beforehand, so that the file is made chunk by chunk, not message by message. It equals the one
that `mcap.writer.Writer` writes for the same messages.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import ArrayLike, NDArray

from osl_analysis.files import atomic_path
from osl_analysis.trial import Array


@dataclass(frozen=True)
class LogTopic:
    """A topic that a recorder writes."""

    name: str  # Name of the topic
    schema_name: str  # Name of the message's type
    schema_text: str  # Definition of the type, with those that it depends on. It begins with `std_msgs/Header header`
    frame_id: str  # Frame in the header of every message


SAMPLE_HEADER = "std_msgs/Header header"
DEPENDENCIES = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
DYNAMOMETER = LogTopic(
    "/dynamometer",
    "osl_interfaces/msg/DynamometerSample",
    SAMPLE_HEADER
    + """
float32 joint_angle       # rad, joint encoder of the dynamometer
float32 load_cell_torque  # N*m, exerted by the joint on the dynamometer
float32 actuator_angle    # rad, at the actuator's output
float32 motor_current     # A, q-axis
float32 commanded_angle   # rad, in counts of the joint encoder
"""
    + DEPENDENCIES,
    "dynamometer",
)
ACTUATOR = LogTopic(
    "/actuator",
    "osl_interfaces/msg/ActuatorSample",
    SAMPLE_HEADER
    + """
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 output_torque   # N*m, exerted by the actuator's output on the bench
"""
    + DEPENDENCIES,
    "actuator_bench",
)
LEG = LogTopic(
    "/leg",
    "osl_interfaces/msg/LegSample",
    SAMPLE_HEADER
    + """
float32 joint_angle     # rad
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 stiffness_gain  # N*m/rad, K_1 at the actuator's output
float32 damping_gain    # N*m*s/rad, B_1 at the actuator's output
bool sync               # level of the synchronisation line
"""
    + DEPENDENCIES,
    "leg",
)


PROFILE, LIBRARY, COMPRESSION = "ros2", "osl-analysis", "zstd"
CHUNK_SIZE = 1 << 20  # A chunk ends with the message that takes it beyond this size [bytes]
LATENCY_NS = 150_000  # Time [ns] from a sample's stamp to its arrival at the recorder
OVERHEAD = 9  # Bytes of a record before its content: the opcode and the length
MESSAGE = {"opcode": "u1", "length": "<u8", "channel": "<u2", "sequence": "<u4", "log": "<u8", "publish": "<u8"}
"""Members of a message's record before its data."""


@dataclass(frozen=True)
class Topic:
    """The messages of one topic, which are equally long: the schema as ros2msg, and time stamps [ns], (n,). A message
    has the `layout`, with the members `sec` and `nanosec` of its stamp. `constants` are members that are the same in
    every message, `columns` those that differ, (n,) each. Other members and the padding are zero."""

    name: str
    schema_name: str
    schema_text: str
    stamps: NDArray[np.int64]
    layout: "np.dtype[np.void]"
    constants: Mapping[str, bytes | int]
    columns: Mapping[str, NDArray[Any]]

    @property
    def record(self) -> "np.dtype[np.void]":
        """A message with what is before it in its record."""
        return np.dtype([*MESSAGE.items(), ("data", self.layout)])

    def definitions(self, channel: int) -> tuple[Schema, Channel]:
        """The schema and the channel, which have the same number."""
        text = self.schema_text.encode()
        schema = Schema(id=channel, name=self.schema_name, encoding="ros2msg", data=text)
        return schema, Channel(id=channel, topic=self.name, message_encoding="cdr", schema_id=channel, metadata={})

    def messages(self, channel: int, rows: NDArray[np.intp]) -> "np.ndarray[tuple[int], np.dtype[np.void]]":
        """The records of some messages; a message's sequence number is its row."""
        one = np.zeros(1, self.record)
        one["opcode"], one["length"], one["channel"] = Opcode.MESSAGE, one.itemsize - OVERHEAD, channel
        for name, value in self.constants.items():
            one["data"][name] = value
        messages = np.repeat(one.view(f"V{one.itemsize}"), len(rows)).view(one.dtype)  # as bytes, with the padding
        stamps, data = self.stamps[rows], messages["data"]
        messages["sequence"], messages["log"], messages["publish"] = rows, stamps + LATENCY_NS, stamps
        data["sec"], data["nanosec"] = np.divmod(stamps, 10**9)
        for name, values in self.columns.items():
            data[name] = values[rows]
        return messages


@dataclass(frozen=True)
class Content:
    """What one chunk holds: its bytes, and by channel the index of its messages, (m, 2): log time [ns] and place."""

    data: memoryview
    index: Mapping[int, NDArray[np.uint64]]

    def chunk(self) -> Chunk:
        """The record of the chunk."""
        times = np.concatenate([index[:, 0] for index in self.index.values()])
        return Chunk(
            compression=COMPRESSION,
            data=zstandard.compress(self.data),
            message_start_time=int(times.min()),
            message_end_time=int(times.max()),
            uncompressed_crc=zlib.crc32(self.data),
            uncompressed_size=len(self.data),
        )


def write_recording(path: Path, topics: Sequence[Topic], metadata: Metadata) -> None:
    """Write the messages of all topics, in the order of their stamps, after a metadata record."""
    definitions = [topic.definitions(number) for number, topic in enumerate(topics, 1)]
    indexes = list[ChunkIndex]()
    with path.open("wb") as file:
        start = MCAP0_MAGIC + encoded([Header(PROFILE, LIBRARY)])
        described = encoded([metadata])
        file.write(start + described)
        for content in contents(topics, encoded(record for pair in definitions for record in pair)):
            chunk, begin = content.chunk(), file.tell()
            record = encoded([chunk])
            file.write(record)
            offsets, own = dict[int, int](), file.tell()
            for channel, index in content.index.items():
                offsets[channel] = file.tell()
                file.write(message_index(channel, index))
            indexes.append(chunk_index(chunk, begin, len(record), offsets, file.tell() - own))
        file.write(encoded([DataEnd(0)]))
        groups: dict[Opcode, Sequence[McapRecord]] = {
            Opcode.SCHEMA: [schema for schema, _ in definitions],
            Opcode.CHANNEL: [channel for _, channel in definitions],
            Opcode.STATISTICS: [statistics(topics, indexes)],
            Opcode.CHUNK_INDEX: indexes,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [MetadataIndex(offset=len(start), length=len(described), name=metadata.name)],
        }
        file.write(summary(groups, file.tell()) + MCAP0_MAGIC)


def contents(topics: Sequence[Topic], definitions: bytes) -> Iterator[Content]:
    """The chunks, the first of which begins with the definitions of schemas and channels."""
    stamps = np.concatenate([topic.stamps for topic in topics])
    order = np.argsort(stamps, kind="stable")
    counts = [len(topic.stamps) for topic in topics]
    owner, row = np.repeat(np.arange(len(topics)), counts)[order], np.concatenate([np.arange(n) for n in counts])[order]
    ends = len(definitions) + np.cumsum(np.array([topic.record.itemsize for topic in topics])[owner])
    first, begin = 0, 0
    while first < len(ends):
        last = min(int(np.searchsorted(ends, begin + CHUNK_SIZE, side="right")), len(ends) - 1) + 1
        data, index = np.empty(int(ends[last - 1]) - begin, np.uint8), dict[int, NDArray[np.uint64]]()
        if first == 0:
            data[: len(definitions)] = np.frombuffer(definitions, np.uint8)
        of_topics = [first + np.flatnonzero(owner[first:last] == k) for k in range(len(topics))]
        present = [k for k, own in enumerate(of_topics) if len(own)]
        for k in sorted(present, key=lambda k: of_topics[k][0]):  # as each comes first in the chunk
            own = of_topics[k]
            messages = topics[k].messages(k + 1, row[own])
            places = ends[own] - messages.itemsize - begin
            every = (len(data) - messages.itemsize + 1,)
            np.ndarray(every, f"V{messages.itemsize}", data, 0, (1,))[places] = messages.view(f"V{messages.itemsize}")
            index[k + 1] = np.stack([messages["log"], places], axis=1).astype("<u8")
        yield Content(data.data, index)
        first, begin = last, int(ends[last - 1])


def encoded(records: Iterable[McapRecord]) -> bytes:
    """Records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def message_index(channel: int, index: NDArray[np.uint64]) -> bytes:
    """The record with the index of a channel's messages in the chunk before it."""
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + index.nbytes, channel, index.nbytes) + index.tobytes()


def chunk_index(chunk: Chunk, begin: int, length: int, offsets: dict[int, int], index_length: int) -> ChunkIndex:
    """The summary's record of a chunk of `length` bytes at `begin`, whose message indexes stand at `offsets`."""
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=begin,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=index_length,
        message_index_offsets=offsets,
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )


def statistics(topics: Sequence[Topic], indexes: Sequence[ChunkIndex]) -> Statistics:
    """The summary's numbers of messages."""
    used = dict.fromkeys(channel for index in indexes for channel in index.message_index_offsets)
    counts = {channel: len(topics[channel - 1].stamps) for channel in used}
    return Statistics(
        attachment_count=0,
        channel_count=len(topics),
        channel_message_counts=counts,
        chunk_count=len(indexes),
        message_count=sum(counts.values()),
        message_end_time=max((index.message_end_time for index in indexes), default=0),
        message_start_time=min((index.message_start_time for index in indexes), default=0),
        metadata_count=1,
        schema_count=len(topics),
    )


def summary(groups: Mapping[Opcode, Sequence[McapRecord]], start: int) -> bytes:
    """The summary at `start`, its offsets, and the footer with the CRC of both."""
    data, offsets = b"", list[SummaryOffset]()
    for opcode, records in groups.items():
        group = encoded(records)
        offsets.append(SummaryOffset(group_opcode=opcode, group_start=start + len(data), group_length=len(group)))
        data += group
    offsets_start = start + len(data)
    data += encoded(offsets)
    crc = zlib.crc32(data + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start))
    return data + encoded([Footer(start, offsets_start, crc)])


ENCAPSULATION = b"\x00\x01\x00\x00"  # CDR, little endian. Everything after it is aligned as if the message began there
CDR_TYPES = {"bool": "u1", "uint8": "u1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}


def write_mcap(path: Path, topic: LogTopic, time: Array, columns: Mapping[str, ArrayLike]) -> None:
    """Write one topic with a message for each time stamp [s], from 0 to 2^31 s in whole nanoseconds. The columns, (n,)
    each, are cast to the types of the fields that the schema lists after its header."""
    declared = topic.schema_text.split("===", maxsplit=1)[0].splitlines()[1:]
    types = {words[1]: CDR_TYPES[words[0]] for words in map(str.split, declared) if words}
    layout = aligned(header_members(topic.frame_id) | {f"field.{field}": kind for field, kind in types.items()})
    values = {f"field.{field}": np.asarray(columns[field]) for field in types}
    stamps, constants = nanoseconds(time), header(topic.frame_id)
    write_topics(path, [Topic(topic.name, topic.schema_name, topic.schema_text, stamps, layout, constants, values)])


def write_topics(path: Path, topics: Sequence[Topic]) -> None:
    """Write several topics, their messages in the order in which they arrive. The file appears whole or not at all."""
    names = ", ".join(topic.name for topic in topics)
    metadata = Metadata("recording", {"origin": "simulated", "topic": names, "time": "header stamp"})
    with atomic_path(path) as temporary:
        write_recording(temporary, topics, metadata)


def nanoseconds(time: Array) -> NDArray[np.int64]:
    """Time stamps [s] as whole nanoseconds."""
    return np.rint(np.asarray(time) * 1e9).astype(np.int64)


def header_members(frame_id: str) -> dict[str, str]:
    """Members of a record up to the end of its header, with their numpy types."""
    frame = f"S{len(frame_id) + 1}"
    return {"encapsulation": "V4", "sec": "<i4", "nanosec": "<u4", "frame_id_length": "<u4", "frame_id": frame}


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


RULE = "=" * 80 + "\n"
JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_STATE_TEXT = (
    f"{SAMPLE_HEADER}\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + DEPENDENCIES
)
WRENCH = "geometry_msgs/msg/WrenchStamped"
VECTOR = "float64 x\nfloat64 y\nfloat64 z\n"
WRENCH_TEXT = (
    f"{SAMPLE_HEADER}\ngeometry_msgs/Wrench wrench\n{RULE}MSG: geometry_msgs/Wrench\n"
    f"geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n{RULE}MSG: geometry_msgs/Vector3\n{VECTOR}"
    + DEPENDENCIES
)


def joint_states(
    topic: str, frame_id: str, time: Array, position: Mapping[str, Array], effort: Mapping[str, Array]
) -> Topic:
    """JointState messages: positions [rad] by joint, (n,) each, and the effort of some joints; the other efforts are
    0."""
    names = [name.encode() + b"\0" for name in position]
    members = header_members(frame_id) | {"names": "<u4"}
    constants = header(frame_id) | dict.fromkeys(("names", "positions", "efforts"), len(names))
    for k, name in enumerate(names):
        members |= {f"name_length.{k}": "<u4", f"name.{k}": f"S{len(name)}"}
        constants |= {f"name_length.{k}": len(name), f"name.{k}": name}
    members |= {"positions": "<u4"} | {f"position.{joint}": "<f8" for joint in position}
    members |= {"velocities": "<u4", "efforts": "<u4"} | {f"effort.{joint}": "<f8" for joint in position}
    columns = {f"position.{joint}": values for joint, values in position.items()}
    columns |= {f"effort.{joint}": values for joint, values in effort.items()}
    return Topic(topic, JOINT_STATE, JOINT_STATE_TEXT, nanoseconds(time), aligned(members), constants, columns)


def wrenches(topic: str, frame_id: str, time: Array, torque: Array) -> Topic:
    """WrenchStamped messages with a torque [N*m] about z, (n,). All other components are 0."""
    axes = [f"{vector}.{axis}" for vector in ("force", "torque") for axis in "xyz"]
    layout = aligned(header_members(frame_id) | dict.fromkeys(axes, "<f8"))
    columns = {"torque.z": torque}
    return Topic(topic, WRENCH, WRENCH_TEXT, nanoseconds(time), layout, header(frame_id), columns)
