"""The ROS 2 messages of the three loggers, as `ros2msg` text with the definitions that they depend on."""

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

DYNAMOMETER_TOPIC = "/dynamometer"
DYNAMOMETER_FRAME = "dynamometer"
DYNAMOMETER_SCHEMA = "osl_interfaces/msg/DynamometerSample"
DYNAMOMETER_SAMPLE = (
    SAMPLE_HEADER
    + """
float32 joint_angle       # rad, joint encoder of the dynamometer
float32 load_cell_torque  # N*m, exerted by the joint on the dynamometer
float32 actuator_angle    # rad, at the actuator's output
float32 motor_current     # A, q-axis
float32 commanded_angle   # rad, in counts of the joint encoder
"""
    + DEPENDENCIES
)

ACTUATOR_TOPIC = "/actuator"
ACTUATOR_FRAME = "actuator_bench"
ACTUATOR_SCHEMA = "osl_interfaces/msg/ActuatorSample"
ACTUATOR_SAMPLE = (
    SAMPLE_HEADER
    + """
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 output_torque   # N*m, exerted by the actuator's output on the bench
"""
    + DEPENDENCIES
)

LEG_TOPIC = "/leg"
LEG_FRAME = "leg"
LEG_SCHEMA = "osl_interfaces/msg/LegSample"
LEG_SAMPLE = (
    SAMPLE_HEADER
    + """
float32 joint_angle     # rad
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 stiffness_gain  # N*m/rad, K_1 at the actuator's output
float32 damping_gain    # N*m*s/rad, B_1 at the actuator's output
bool sync               # level of the synchronisation line
"""
    + DEPENDENCIES
)
