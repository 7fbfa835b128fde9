"""An MCAP recorder like those of laboratories: ROS 2 messages in CDR, zstd chunks with CRCs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
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


LATENCY_NS = 150_000  # Time [ns] from a sample's stamp to its arrival at the recorder


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

    def messages(self) -> list[bytes]:
        """The messages in CDR."""
        one = np.zeros(1, self.layout)
        for name, value in self.constants.items():
            one[name] = value
        data = np.repeat(one.view(f"V{one.itemsize}"), len(self.stamps)).view(one.dtype)  # as bytes, with the padding
        data["sec"], data["nanosec"] = np.divmod(self.stamps, 10**9)
        for name, values in self.columns.items():
            data[name] = values
        whole = data.tobytes()
        return [whole[start : start + one.itemsize] for start in range(0, len(whole), one.itemsize)]


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
    """Write several topics, their messages in the order of their stamps. The file appears whole or not at all."""
    names = ", ".join(topic.name for topic in topics)
    order = np.argsort(np.concatenate([topic.stamps for topic in topics]), kind="stable").tolist()
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="osl-analysis")
        writer.add_metadata("recording", {"origin": "simulated", "topic": names, "time": "header stamp"})
        messages = list[tuple[int, int, int, bytes]]()
        for topic in topics:
            schema = writer.register_schema(topic.schema_name, "ros2msg", topic.schema_text.encode())
            channel = writer.register_channel(topic.name, "cdr", schema)
            own = zip(topic.stamps.tolist(), topic.messages(), strict=True)
            messages += [(channel, sequence, stamp, data) for sequence, (stamp, data) in enumerate(own)]
        for channel, sequence, stamp, data in map(messages.__getitem__, order):
            writer.add_message(channel, stamp + LATENCY_NS, data, stamp, sequence)
        writer.finish()


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
