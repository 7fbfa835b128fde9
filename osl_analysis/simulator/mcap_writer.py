"""An MCAP recorder like those of laboratories: ROS 2 messages in CDR, in zstd chunks with CRCs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from numpy.typing import ArrayLike, NDArray

from osl_analysis.files import atomic_path
from osl_analysis.trial import Array

RULE = "=" * 80 + "\n"
DEPENDENCIES = f"""\
{RULE}MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
SAMPLES = {
    "/dynamometer": """\
float32 joint_angle       # rad, joint encoder of the dynamometer
float32 load_cell_torque  # N*m, exerted by the joint on the dynamometer
float32 actuator_angle    # rad, at the actuator's output
float32 motor_current     # A, q-axis
float32 commanded_angle   # rad, in counts of the joint encoder
""",
    "/actuator": """\
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 output_torque   # N*m, exerted by the actuator's output on the bench
""",
    "/leg": """\
float32 joint_angle     # rad
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 stiffness_gain  # N*m/rad, K_1 at the actuator's output
float32 damping_gain    # N*m*s/rad, B_1 at the actuator's output
bool sync               # level of the synchronisation line
""",
}
"""Fields of the messages of each topic of our own types."""
CDR_TYPES = {"bool": "u1", "uint8": "u1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}
LATENCY_NS = 150_000  # Time [ns] from a sample's stamp to its arrival at the recorder


class LogTopic(NamedTuple):
    """A topic: its name, the type of its messages with its definition, stamps [ns] and messages in CDR, (n,) each."""

    name: str
    schema_name: str
    schema_text: str
    stamps: NDArray[np.int64]
    messages: NDArray[np.void]


def log_topic(
    name: str, schema_name: str, fields: str, frame_id: str, time: Array, members: Mapping[str, tuple[str, Any]]
) -> LogTopic:
    """A topic with messages at time stamps [s], (n,), whose definition has `fields` after a header. Members are in
    order: numpy type, and a value for all messages or a column (n,). In CDR each is aligned to its own size, counted
    from after the encapsulation; text is not aligned. Padding is zero."""
    stamps, frame = np.rint(np.asarray(time) * 1e9).astype(np.int64), frame_id.encode() + b"\0"
    seconds, nanoseconds = np.divmod(stamps, 10**9)
    whole: dict[str, tuple[str, Any]] = {
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
    messages = np.zeros(stamps.size, layout)
    for member, (_, value) in whole.items():
        messages[member] = value
    return LogTopic(name, schema_name, f"std_msgs/Header header\n{fields}{DEPENDENCIES}", stamps, messages)


def sample_topic(topic: str, frame_id: str, fields: str, time: Array, columns: Mapping[str, ArrayLike]) -> LogTopic:
    """Messages of scalar fields, one for each time stamp [s], from 0 to 2^31 s in whole nanoseconds. `fields` declares
    one in each line, to whose type its column (n,) is cast."""
    types = {words[1]: CDR_TYPES[words[0]] for words in map(str.split, fields.splitlines())}
    members = {f"field.{name}": (kind, np.asarray(columns[name])) for name, kind in types.items()}
    return log_topic(topic, f"osl_interfaces/msg/{topic[1:].title()}Sample", fields, frame_id, time, members)


def joint_states(
    topic: str, frame_id: str, time: Array, position: Mapping[str, Array], effort: Mapping[str, Array]
) -> LogTopic:
    """JointState messages: positions [rad] by joint, (n,) each, and the effort of some joints; other efforts are 0."""
    members: dict[str, tuple[str, Any]] = {"names": ("<u4", len(position))}
    for joint in position:
        name = joint.encode() + b"\0"
        members |= {f"name_length.{joint}": ("<u4", len(name)), f"name.{joint}": (f"S{len(name)}", name)}
    members |= {"positions": ("<u4", len(position))}
    members |= {f"position.{joint}": ("<f8", values) for joint, values in position.items()}
    members |= {"velocities": ("<u4", 0), "efforts": ("<u4", len(position))}
    members |= {f"effort.{joint}": ("<f8", effort.get(joint, 0.0)) for joint in position}
    fields = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    return log_topic(topic, "sensor_msgs/msg/JointState", fields, frame_id, time, members)


def wrenches(topic: str, frame_id: str, time: Array, torque: Array) -> LogTopic:
    """WrenchStamped messages with a torque [N*m] about z, (n,). All other components are 0."""
    zeros = {f"{vector}.{axis}": ("<f8", 0.0) for vector in ("force", "torque") for axis in "xyz"}
    fields = (
        f"geometry_msgs/Wrench wrench\n{RULE}MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\n"
        f"geometry_msgs/Vector3 torque\n{RULE}MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
    )
    members = {**zeros, "torque.z": ("<f8", torque)}
    return log_topic(topic, "geometry_msgs/msg/WrenchStamped", fields, frame_id, time, members)


def write_topics(path: Path, topics: Sequence[LogTopic]) -> None:
    """Write the messages of all topics, in the order of their stamps, after a metadata record. The file appears whole
    or not at all."""
    names, messages = ", ".join(topic.name for topic in topics), list[tuple[int, int, int, bytes]]()
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="osl-analysis")
        writer.add_metadata("recording", {"origin": "simulated", "topic": names, "time": "header stamp"})
        for topic in topics:
            schema = writer.register_schema(topic.schema_name, "ros2msg", topic.schema_text.encode())
            channel = writer.register_channel(topic.name, "cdr", schema)
            content = topic.messages.view(f"V{topic.messages.itemsize}").tolist()
            rows = enumerate(zip(topic.stamps.tolist(), content, strict=True))
            messages += [(stamp, channel, row, data) for row, (stamp, data) in rows]
        for stamp, channel, row, data in sorted(messages, key=lambda message: message[0]):
            writer.add_message(channel, stamp + LATENCY_NS, data, stamp, row)
        writer.finish()  # type: ignore[no-untyped-call]
