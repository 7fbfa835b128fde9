"""Logs of the simulated laboratories as MCAP like those of real ones: ROS 2 messages in CDR, zstd
chunks with CRCs.

All messages are known beforehand, so the file is made chunk by chunk. One by one, as
`mcap.writer.Writer` takes them, they would take as long as all simulating.
"""

import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zstandard
from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from numpy.typing import ArrayLike, NDArray

from osl_analysis.files import atomic_path
from osl_analysis.trial import Array

McapRecord = mcap_records.McapRecord

RULE = "=" * 80 + "\n"  # between the definitions of a ROS 2 schema
ARRIVES_NS = 150_000  # [ns] in which a sample arrives at the recorder
CHUNK_BYTES = 1 << 20  # of messages in a chunk, at most
LITTLE_ENDIAN_CDR = b"\x00\x01\x00\x00"
RECORD_HEAD_BYTES = 9  # opcode and length of a record, which its length does not count

HEADER_DEFINITIONS = (
    f"{RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    f"{RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
JOINT_STATE_FIELDS = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
WRENCH_FIELDS = (
    f"geometry_msgs/Wrench wrench\n{RULE}MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3"
    f" force\ngeometry_msgs/Vector3 torque\n{RULE}MSG: geometry_msgs/Vector3\nfloat64"
    " x\nfloat64 y\nfloat64 z\n"
)
# fields of the messages of each topic of our own types
SAMPLES = {
    "/dynamometer": (
        """\
float32 joint_angle       # rad, joint encoder of the dynamometer
float32 load_cell_torque  # N*m, exerted by the joint on the dynamometer
float32 actuator_angle    # rad, at the actuator's output
float32 motor_current     # A, q-axis
float32 commanded_angle   # rad, in counts of the joint encoder
"""
    ),
    "/actuator": (
        """\
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 output_torque   # N*m, exerted by the actuator's output on the bench
"""
    ),
    "/leg": (
        """\
float32 joint_angle     # rad
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 stiffness_gain  # N*m/rad, K_1 at the actuator's output
float32 damping_gain    # N*m*s/rad, B_1 at the actuator's output
bool sync               # level of the synchronisation line
"""
    ),
}
CDR_TYPES = {"bool": "u1", "float32": "<f4"}


class LogTopic(NamedTuple):
    """A topic of equally long messages."""

    name: str
    schema_name: str
    schema_text: str
    records: NDArray[np.void]  # (n,) of MCAP, one for each message


def log_topic(
    name: str,
    schema_name: str,
    fields: str,
    frame_id: str,
    time: Array,
    members: Mapping[str, tuple[str, Any]],
) -> LogTopic:
    """Make a topic with a message per time stamp.

    Parameters
    ----------
    name, schema_name : str
    fields : str
        Definition of the message after its header.
    frame_id : str
        Of the header.
    time : Array
        (n,) [s].
    members : Mapping
        In order: numpy type, and a value for all messages or a column (n,).
    """
    stamps = np.rint(np.asarray(time) * 1e9).astype(np.int64)
    seconds, nanoseconds = np.divmod(stamps, 10**9)
    frame = frame_id.encode() + b"\0"
    message: dict[str, tuple[str, Any]] = {
        "encapsulation": ("V4", LITTLE_ENDIAN_CDR),
        "sec": ("<i4", seconds),
        "nanosec": ("<u4", nanoseconds),
        "frame_id_length": ("<u4", len(frame)),
        "frame_id": (f"S{len(frame)}", frame),
        **members,
    }
    record = [
        ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
        ("log", "<u8"), ("publish", "<u8"), ("data", cdr_layout(message)),
    ]  # fmt: skip
    records = np.zeros(len(stamps), np.dtype(record))
    records["opcode"] = Opcode.MESSAGE
    records["length"] = records.itemsize - RECORD_HEAD_BYTES
    records["sequence"] = np.arange(len(stamps))
    records["log"] = stamps + ARRIVES_NS
    records["publish"] = stamps
    for member, (_, value) in message.items():
        records["data"][member] = value
    schema = f"std_msgs/Header header\n{fields}{HEADER_DEFINITIONS}"
    return LogTopic(name, schema_name, schema, records)


def cdr_layout(members: Mapping[str, tuple[str, Any]]) -> np.dtype[np.void]:
    """Layout of a message in CDR: each member is aligned to its own size, counted from after the
    encapsulation of four bytes; text is not aligned."""
    kinds = [np.dtype(kind) for kind, _ in members.values()]
    offsets = []
    end = 0
    for kind in kinds:
        alignment = 1 if kind.kind in "SV" else kind.itemsize
        offset = 0 if end == 0 else 4 + -(-(end - 4) // alignment) * alignment
        offsets.append(offset)
        end = offset + kind.itemsize
    return np.dtype({"names": list(members), "formats": kinds, "offsets": offsets, "itemsize": end})


def sample_topic(
    topic: str, frame_id: str, time: Array, columns: Mapping[str, ArrayLike]
) -> LogTopic:
    """Make a topic of `SAMPLES`, a message for each time stamp.

    Parameters
    ----------
    topic, frame_id : str
    time : Array
        (n,) [s], from 0 to 2^31 s in whole nanoseconds.
    columns : Mapping
        (n,) by field.
    """
    fields = SAMPLES[topic]
    members = {}
    for line in fields.splitlines():
        kind, name, *_ = line.split()
        members[f"field.{name}"] = (CDR_TYPES[kind], np.asarray(columns[name]))
    schema_name = f"osl_interfaces/msg/{topic[1:].title()}Sample"
    return log_topic(topic, schema_name, fields, frame_id, time, members)


def joint_states(
    topic: str,
    frame_id: str,
    time: Array,
    position: Mapping[str, Array],
    effort: Mapping[str, Array],
) -> LogTopic:
    """Make a topic of JointState messages: positions [rad] by joint, (n,) each, and the effort of
    some joints; other efforts are 0."""
    names: dict[str, tuple[str, Any]] = {}
    for joint in position:
        text = joint.encode() + b"\0"
        names[f"name_length.{joint}"] = ("<u4", len(text))
        names[f"name.{joint}"] = (f"S{len(text)}", text)
    members: dict[str, tuple[str, Any]] = {
        "names": ("<u4", len(position)),
        **names,
        "positions": ("<u4", len(position)),
        **{f"position.{joint}": ("<f8", values) for joint, values in position.items()},
        "velocities": ("<u4", 0),
        "efforts": ("<u4", len(position)),
        **{f"effort.{joint}": ("<f8", effort.get(joint, 0.0)) for joint in position},
    }
    schema_name = "sensor_msgs/msg/JointState"
    return log_topic(topic, schema_name, JOINT_STATE_FIELDS, frame_id, time, members)


def wrenches(topic: str, frame_id: str, time: Array, torque: Array) -> LogTopic:
    """Make a topic of WrenchStamped messages with a torque (n,) [N*m] about z; all other components
    are 0."""
    members: dict[str, tuple[str, Any]] = {}
    for vector in ("force", "torque"):
        for axis in "xyz":
            members[f"{vector}.{axis}"] = ("<f8", 0.0)
    members["torque.z"] = ("<f8", torque)
    schema_name = "geometry_msgs/msg/WrenchStamped"
    return log_topic(topic, schema_name, WRENCH_FIELDS, frame_id, time, members)


def write_topics(path: Path, topics: Sequence[LogTopic]) -> None:
    """Write the messages of all topics as MCAP, each topic in chunks of its own with a checksum.

    There is no index, which is for seeking. The file appears whole or not at all.
    """
    records: list[McapRecord] = [mcap_records.Header("ros2", "osl-analysis")]
    for number, topic in enumerate(topics, 1):
        text = topic.schema_text.encode()
        records.append(mcap_records.Schema(number, text, "ros2msg", topic.schema_name))
        records.append(mcap_records.Channel(number, topic.name, "cdr", {}, number))
    for number, topic in enumerate(topics, 1):
        topic.records["channel"] = number
        rows = CHUNK_BYTES // topic.records.itemsize
        for first in range(0, topic.records.size, rows):
            records.append(chunk_of(topic.records[first : first + rows]))
    records += [mcap_records.DataEnd(0), mcap_records.Footer(0, 0, 0)]

    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]
    with atomic_path(path) as temporary:
        temporary.write_bytes(MCAP0_MAGIC + content + MCAP0_MAGIC)


def chunk_of(messages: NDArray[np.void]) -> mcap_records.Chunk:
    """A chunk of messages, with a checksum."""
    content = messages.tobytes()
    return mcap_records.Chunk(
        compression="zstd",
        data=zstandard.compress(content),
        message_start_time=int(messages["log"].min()),
        message_end_time=int(messages["log"].max()),
        uncompressed_crc=zlib.crc32(content),
        uncompressed_size=len(content),
    )
