"""The log files of the two benches: one topic with all channels, or the standard messages of two nodes."""

from pathlib import Path

from osl_analysis.simulator import messages
from osl_analysis.simulator.actuator_bench import ActuatorLog
from osl_analysis.simulator.dynamometer import DynamometerLog
from osl_analysis.simulator.mcap_recorder import write_mcap, write_topics
from osl_analysis.simulator.standard_messages import joint_states, wrenches

JOINT_STATES_TOPIC, WRENCH_TOPIC = "/joint_states", "/wrench"


def write_dynamometer_log(path: Path, log: DynamometerLog, two_nodes: bool) -> None:
    """Write the dynamometer's log. With two nodes, the second one is the load cell's."""
    columns = {
        "joint_angle": log.joint_angle,
        "load_cell_torque": log.load_cell_torque,
        "actuator_angle": log.actuator_angle,
        "motor_current": log.motor_current,
        "commanded_angle": log.commanded_angle,
    }
    if not two_nodes:
        write_mcap(path, messages.DYNAMOMETER, log.time, columns)
        return
    position = {"joint": log.joint_angle, "actuator": log.actuator_angle, "command": log.commanded_angle}
    joints = joint_states(JOINT_STATES_TOPIC, "bench", log.time, position, {"actuator": log.motor_current})
    write_topics(path, [joints, wrenches(WRENCH_TOPIC, "load_cell", log.torque_time, log.load_cell_torque)])


def write_actuator_log(path: Path, log: ActuatorLog, two_nodes: bool) -> None:
    """Write the log of the actuator's bench. With two nodes, the second one is the transducer's."""
    columns = {
        "actuator_angle": log.actuator_angle,
        "motor_current": log.motor_current,
        "output_torque": log.output_torque,
    }
    if not two_nodes:
        write_mcap(path, messages.ACTUATOR, log.time, columns)
        return
    joints = joint_states(
        JOINT_STATES_TOPIC, "bench", log.time, {"actuator": log.actuator_angle}, {"actuator": log.motor_current}
    )
    write_topics(path, [joints, wrenches(WRENCH_TOPIC, "transducer", log.torque_time, log.output_torque)])
