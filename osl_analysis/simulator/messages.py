"""The topics of the three loggers: their ROS 2 messages as `ros2msg` text, with the definitions that they depend on."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LogTopic:
    """A topic that a recorder writes."""

    name: str
    """Name of the topic."""
    schema_name: str
    """Name of the message's type."""
    schema_text: str
    """Definition of the type, with those that it depends on. It begins with `std_msgs/Header header`."""
    frame_id: str
    """Frame in the header of every message."""


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
