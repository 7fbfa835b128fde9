"""Standard ROS 2 messages of a bench with two nodes: sensor_msgs/JointState and geometry_msgs/WrenchStamped."""

from collections.abc import Mapping

from osl_analysis.simulator.mcap_recorder import aligned, header, header_members, nanoseconds
from osl_analysis.simulator.mcap_writer import Topic
from osl_analysis.simulator.messages import DEPENDENCIES, SAMPLE_HEADER
from osl_analysis.trial import Array

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
    members = header_members(len(frame_id) + 1) | {"names": "<u4"}
    for k, name in enumerate(names):
        members |= {f"name_length.{k}": "<u4", f"name.{k}": f"S{len(name)}"}
    for field in ("position", "effort"):
        # effort comes after the empty list of velocities
        members |= ({} if field == "position" else {"velocities": "<u4"}) | {f"{field}s": "<u4"}
        members |= {f"{field}.{joint}": "<f8" for joint in position}
    constants = header(frame_id) | dict.fromkeys(("names", "positions", "efforts"), len(names))
    for k, name in enumerate(names):
        constants |= {f"name_length.{k}": len(name), f"name.{k}": name}
    columns = {f"position.{joint}": values for joint, values in position.items()}
    columns |= {f"effort.{joint}": values for joint, values in effort.items()}
    return Topic(topic, JOINT_STATE, JOINT_STATE_TEXT, nanoseconds(time), aligned(members), constants, columns)


def wrenches(topic: str, frame_id: str, time: Array, torque: Array) -> Topic:
    """WrenchStamped messages with a torque [N*m] about z, (n,). All other components are 0."""
    axes = [f"{vector}.{axis}" for vector in ("force", "torque") for axis in "xyz"]
    layout = aligned(header_members(len(frame_id) + 1) | dict.fromkeys(axes, "<f8"))
    columns = {"torque.z": torque}
    return Topic(topic, WRENCH, WRENCH_TEXT, nanoseconds(time), layout, header(frame_id), columns)
