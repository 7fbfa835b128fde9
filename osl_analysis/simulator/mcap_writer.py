"""An MCAP recorder like those of laboratories: ROS 2 messages in CDR, zstd chunks with CRCs. All messages are known
beforehand, so that the file is made chunk by chunk. It equals the one that `mcap.writer.Writer` writes."""

import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

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

RULE = "=" * 80 + "\n"
SAMPLE_HEADER = "std_msgs/Header header"
DEPENDENCIES = f"""\
{RULE}MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


Records = np.ndarray[tuple[int], np.dtype[np.void]]


@dataclass(frozen=True)
class LogTopic:
    """A topic that a recorder writes, and its messages, which are equally long."""

    name: str
    schema_name: str  # name of the message's type
    schema_text: str  # definition of the type, with those that it depends on. It begins with `std_msgs/Header header`
    frame_id: str  # frame in the header of every message
    records: Records = field(default_factory=lambda: np.zeros(0, np.dtype([("", "u1")])))
    """A record of each message, (n,), with the members of `RECORD_HEAD` and `data`; the number of its channel is 0."""


DYNAMOMETER = LogTopic(
    "/dynamometer",
    "osl_interfaces/msg/DynamometerSample",
    f"""{SAMPLE_HEADER}
float32 joint_angle       # rad, joint encoder of the dynamometer
float32 load_cell_torque  # N*m, exerted by the joint on the dynamometer
float32 actuator_angle    # rad, at the actuator's output
float32 motor_current     # A, q-axis
float32 commanded_angle   # rad, in counts of the joint encoder
{DEPENDENCIES}""",
    "dynamometer",
)
ACTUATOR = LogTopic(
    "/actuator",
    "osl_interfaces/msg/ActuatorSample",
    f"""{SAMPLE_HEADER}
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 output_torque   # N*m, exerted by the actuator's output on the bench
{DEPENDENCIES}""",
    "actuator_bench",
)
LEG = LogTopic(
    "/leg",
    "osl_interfaces/msg/LegSample",
    f"""{SAMPLE_HEADER}
float32 joint_angle     # rad
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 stiffness_gain  # N*m/rad, K_1 at the actuator's output
float32 damping_gain    # N*m*s/rad, B_1 at the actuator's output
bool sync               # level of the synchronisation line
{DEPENDENCIES}""",
    "leg",
)
JOINT_STATE_TEXT = (
    f"{SAMPLE_HEADER}\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{DEPENDENCIES}"
)
WRENCH_TEXT = (
    f"{SAMPLE_HEADER}\ngeometry_msgs/Wrench wrench\n{RULE}MSG: geometry_msgs/Wrench\n"
    f"geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n{RULE}MSG: geometry_msgs/Vector3\n"
    f"float64 x\nfloat64 y\nfloat64 z\n{DEPENDENCIES}"
)

LIBRARY = "osl-analysis"
CHUNK_SIZE = 1 << 20  # A chunk ends with the message that takes it beyond this size [bytes]
LATENCY_NS = 150_000  # Time [ns] from a sample's stamp to its arrival at the recorder
RECORD_HEAD = {"opcode": "u1", "length": "<u8", "channel": "<u2", "sequence": "<u4", "log": "<u8", "publish": "<u8"}
"""Members of a message's record before its data."""
CDR_TYPES = {"bool": "u1", "uint8": "u1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}

Members = dict[str, tuple[str, Any]]
"""Members of a message in order: numpy type, and a value for all messages or a column (n,) of values."""


def holding(topic: LogTopic, time: Array, members: Members) -> LogTopic:
    """The topic with messages at time stamps [s], (n,), in CDR: a header, then their own members. Each member is
    aligned to its own size, counted from after the encapsulation; text is not aligned. Padding is zero."""
    stamps, frame = np.rint(np.asarray(time) * 1e9).astype(np.int64), topic.frame_id.encode() + b"\0"
    seconds, nanoseconds = np.divmod(stamps, 10**9)
    whole: Members = {
        "encapsulation": ("V4", b"\x00\x01\x00\x00"),  # little endian
        "sec": ("<i4", seconds),
        "nanosec": ("<u4", nanoseconds),
        "frame_id_length": ("<u4", len(frame)),
        "frame_id": (f"S{len(frame)}", frame),
        **members,
    }
    kinds, offsets, end = [np.dtype(kind) for kind, _ in whole.values()], list[int](), 0
    for kind in kinds:
        alignment = 1 if kind.kind in "SV" else kind.itemsize
        offsets.append(end if end == 0 else 4 + -(-(end - 4) // alignment) * alignment)
        end = offsets[-1] + kind.itemsize
    layout = np.dtype({"names": list(whole), "formats": kinds, "offsets": offsets, "itemsize": end})
    records = np.zeros(stamps.size, np.dtype([*RECORD_HEAD.items(), ("data", layout)]))
    records["opcode"], records["length"] = Opcode.MESSAGE, records.itemsize - 9  # without opcode and length
    records["sequence"], records["log"], records["publish"] = np.arange(stamps.size), stamps + LATENCY_NS, stamps
    for member, (_, value) in whole.items():
        records["data"][member] = value
    return replace(topic, records=records)


def joint_states(
    topic: str, frame_id: str, time: Array, position: Mapping[str, Array], effort: Mapping[str, Array]
) -> LogTopic:
    """JointState messages: positions [rad] by joint, (n,) each, and the effort of some joints; other efforts are 0."""
    members: Members = {"names": ("<u4", len(position))}
    for joint in position:
        name = joint.encode() + b"\0"
        members |= {f"name_length.{joint}": ("<u4", len(name)), f"name.{joint}": (f"S{len(name)}", name)}
    members |= {"positions": ("<u4", len(position))}
    members |= {f"position.{joint}": ("<f8", values) for joint, values in position.items()}
    members |= {"velocities": ("<u4", 0), "efforts": ("<u4", len(position))}
    members |= {f"effort.{joint}": ("<f8", effort.get(joint, 0.0)) for joint in position}
    return holding(LogTopic(topic, "sensor_msgs/msg/JointState", JOINT_STATE_TEXT, frame_id), time, members)


def wrenches(topic: str, frame_id: str, time: Array, torque: Array) -> LogTopic:
    """WrenchStamped messages with a torque [N*m] about z, (n,). All other components are 0."""
    members: Members = {f"{vector}.{axis}": ("<f8", 0.0) for vector in ("force", "torque") for axis in "xyz"}
    members["torque.z"] = ("<f8", torque)
    return holding(LogTopic(topic, "geometry_msgs/msg/WrenchStamped", WRENCH_TEXT, frame_id), time, members)


def write_mcap(path: Path, topic: LogTopic, time: Array, columns: Mapping[str, ArrayLike]) -> None:
    """Write one topic with a message for each time stamp [s], from 0 to 2^31 s in whole nanoseconds. The columns, (n,)
    each, are cast to the types of the fields that the schema lists after its header."""
    declared = topic.schema_text.split("===", maxsplit=1)[0].splitlines()[1:]
    types = {words[1]: CDR_TYPES[words[0]] for words in map(str.split, declared) if words}
    members: Members = {f"field.{name}": (kind, np.asarray(columns[name])) for name, kind in types.items()}
    write_topics(path, [holding(topic, time, members)])


def write_topics(path: Path, topics: Sequence[LogTopic]) -> None:
    """Write the messages of all topics, in the order of their stamps, after a metadata record; last the summary, its
    offsets, and the footer with the CRC of both. The file appears whole or not at all."""
    names = ", ".join(topic.name for topic in topics)
    metadata = Metadata("recording", {"origin": "simulated", "topic": names, "time": "header stamp"})
    schemas, channels = list[McapRecord](), list[McapRecord]()
    for number, topic in enumerate(topics, 1):
        schemas.append(Schema(number, topic.schema_text.encode(), "ros2msg", topic.schema_name))
        channels.append(Channel(number, topic.name, "cdr", {}, number))
    defined = encoded(one for pair in zip(schemas, channels, strict=True) for one in pair)
    data, starts, channel = in_order_of_stamps(topics, defined)
    ends, indexes, first, begin = np.append(starts[1:], len(data)), list[ChunkIndex](), 0, 0
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        head, described = MCAP0_MAGIC + encoded([Header("ros2", LIBRARY)]), encoded([metadata])
        file.write(head + described)
        while first < len(starts):
            last = min(int(np.searchsorted(ends, begin + CHUNK_SIZE, side="right")), len(ends) - 1) + 1
            content, end = data[begin : ends[last - 1]], int(ends[last - 1])
            indexes.append(write_chunk(file, content, starts[first:last] - begin, channel[first:last]))
            first, begin = last, end
        file.write(encoded([DataEnd(0)]))
        used = dict.fromkeys(number for index in indexes for number in index.message_index_offsets)
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(topics),
            channel_message_counts={number: len(topics[number - 1].records) for number in used},
            chunk_count=len(indexes),
            message_count=len(starts),
            message_end_time=max((index.message_end_time for index in indexes), default=0),
            message_start_time=min((index.message_start_time for index in indexes), default=0),
            metadata_count=1,
            schema_count=len(topics),
        )
        groups: dict[Opcode, Sequence[McapRecord]] = {
            Opcode.SCHEMA: schemas,
            Opcode.CHANNEL: channels,
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: indexes,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [MetadataIndex(offset=len(head), length=len(described), name=metadata.name)],
        }
        start, summary, offsets = file.tell(), b"", list[McapRecord]()
        for opcode, records in groups.items():
            group = encoded(records)
            offsets.append(SummaryOffset(opcode, group_start=start + len(summary), group_length=len(group)))
            summary += group
        offsets_start = start + len(summary)
        summary += encoded(offsets)
        crc = zlib.crc32(summary + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start))
        file.write(summary + encoded([Footer(start, offsets_start, crc)]) + MCAP0_MAGIC)


def in_order_of_stamps(
    topics: Sequence[LogTopic], defined: bytes
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
    """The definitions and then the records of all messages, as bytes; where each record begins, and its channel."""
    order = np.argsort(np.concatenate([topic.records["publish"] for topic in topics]), kind="stable")
    channel = np.repeat(np.arange(len(topics)) + 1, [len(topic.records) for topic in topics])[order]
    sizes = np.array([topic.records.itemsize for topic in topics])[channel - 1]
    ends = len(defined) + np.cumsum(sizes)
    data = np.empty(len(defined) + int(sizes.sum()), np.uint8)
    data[: len(defined)] = np.frombuffer(defined, np.uint8)
    for number, topic in enumerate(topics, 1):
        as_bytes, own = np.dtype(f"V{topic.records.itemsize}"), np.flatnonzero(channel == number)
        records = topic.records.view(as_bytes).copy().view(topic.records.dtype)  # as bytes, with the padding
        records["channel"] = number
        if own.size:
            everywhere = np.ndarray((len(data) - records.itemsize + 1,), as_bytes, data, 0, (1,))
            rows = order[own] - sum(len(other.records) for other in topics[: number - 1])
            everywhere[ends[own] - records.itemsize] = records.view(as_bytes)[rows]
    return data, ends - sizes, channel


def write_chunk(
    file: BinaryIO, content: NDArray[np.uint8], starts: NDArray[np.int64], channel: NDArray[np.int64]
) -> ChunkIndex:
    """Write a chunk of messages that begin at `starts` [bytes], and the index of each channel, as each comes first."""
    log = np.ndarray((len(content) - 7,), "<u8", content, 0, (1,))[starts + 15]
    chunk = Chunk(
        compression="zstd",
        data=zstandard.compress(content.data),
        message_start_time=int(log.min()),
        message_end_time=int(log.max()),
        uncompressed_crc=zlib.crc32(content.data),
        uncompressed_size=len(content),
    )
    begin, record = file.tell(), encoded([chunk])
    file.write(record)
    offsets, own = dict[int, int](), file.tell()
    for number in dict.fromkeys(channel.tolist()):
        offsets[number] = file.tell()
        index = np.stack([log, starts.astype(np.uint64)], axis=1)[channel == number]
        file.write(struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + index.nbytes, number, index.nbytes) + index.tobytes())
    return ChunkIndex(
        chunk_length=len(record),
        chunk_start_offset=begin,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=file.tell() - own,
        message_index_offsets=offsets,
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )


def encoded(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
