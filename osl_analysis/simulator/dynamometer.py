"""One dynamometer trial: the true motion and torque, the recorded signals, and the truth file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from osl_analysis.model.compensator import Gains, select_gains
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator.bench_recorder import recorded
from osl_analysis.simulator.drivetrain_sim import (
    ControlCommands,
    DrivetrainEffects,
    simulate_belt_torque,
    simulate_drivetrain,
)
from osl_analysis.simulator.excitations import excitation_motion
from osl_analysis.simulator.joint_motion import JointMotion, position_loop, stepped_sine, there_and_back
from osl_analysis.simulator.second_order_joint import second_order_torque
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.truth_recorder import bench_truth
from osl_analysis.trial import Array


@dataclass(frozen=True)
class DynamometerLog:
    """Signals that the dynamometer's recorder writes, with the recorder's units and signs.

    time [s] of the recorder's clock has shape (n,), as every channel except the torque. torque_time [s] has shape (m,),
    as the torque; it equals `time` if one node records all signals. joint_angle, actuator_angle, commanded_angle [rad];
    motor_current [A]; load_cell_torque [N*m] is the torque of the joint on the bench, the paper's tau_j: *minus* the
    canonical torque.
    """

    time: Array
    joint_angle: Array
    load_cell_torque: Array
    actuator_angle: Array
    motor_current: Array
    commanded_angle: Array
    torque_time: Array


@dataclass(frozen=True)
class BenchResponse:
    """True theta_m [rad], current [A] and resisting torque [N*m] of the joint, shape (n,) each."""

    theta_m: Array
    current: Array
    torque: Array


def simulate_dynamometer_trial(
    row: Mapping[str, Any], settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[DynamometerLog, dict[str, object]]:
    """The log of one trial of the sample sheet, and the truth about it.

    `row` has the sheet's trial, experiment (belt, transmission, torque_angle or impedance), controller, K_d and B_d.
    """
    trial, gains = str(row["trial"]), None
    if row["experiment"] == "belt":
        p = replace(p, K_s=p.K_s * scatter(trial, settings))
        command, motion = moved(there_and_back(settings.belt, settings.dynamometer.rate_hz), settings)
        response = simulate_belt(motion, drivetrain_effects(settings), p)
    elif row["experiment"] == "torque_angle" and settings.foot is not None:
        command, motion = moved(settings.foot.cycles.motion(settings.dynamometer.rate_hz), settings)
        still = np.zeros_like(motion.theta)
        response = BenchResponse(still, still, settings.foot.torque(motion))
    else:
        command, motion = moved(commanded(row, settings), settings)
        if row["experiment"] == "transmission":
            response = simulate_transmission(motion, p)
        elif settings.joint is not None:
            still = np.zeros_like(motion.theta)
            torque = second_order_torque(settings.joint, motion, settings.dynamometer.rate_hz)
            response = BenchResponse(still, still, torque)
        else:
            weight = settings.gain_weight.weight
            gains = select_gains(str(row["controller"]), float(row["K_d"]), float(row["B_d"]), p, weight)
            response = simulate_impedance(settings.dynamometer.rate_hz, motion, gains, drivetrain_effects(settings), p)
    log, drawn = recorded_dynamometer(trial, command, motion, response, settings)
    return log, bench_truth(trial, settings, p, gains, drawn)


def commanded(row: Mapping[str, Any], settings: SimulationSettings) -> JointMotion:
    """The motion that the dynamometer is told to make in a transmission or impedance trial."""
    trial, rate = str(row["trial"]), settings.dynamometer.rate_hz
    excitation = settings.excitation_of(trial) if row["experiment"] == "impedance" else None
    if excitation is None:
        return stepped_sine(settings.protocol, rate)
    return excitation_motion(excitation, trial, settings.seed, rate)


def moved(command: JointMotion, settings: SimulationSettings) -> tuple[Array, JointMotion]:
    """The commanded angle [rad], and the resulting motion of the dynamometer."""
    bandwidth = settings.effects.dynamometer_bandwidth
    if not bandwidth.enabled:
        return command.theta, command
    bench = settings.dynamometer
    return command.theta, position_loop(command, bench.rate_hz, bandwidth.size, bench.damping_ratio)


def simulate_belt(motion: JointMotion, effects: DrivetrainEffects, p: DrivetrainParameters) -> BenchResponse:
    """The actuator is locked at theta_m = 0: all of the joint's angle deflects the belt."""
    still = np.zeros_like(motion.theta)
    elastic = simulate_belt_torque(motion.theta, effects, p)
    return BenchResponse(still, still, elastic + p.B_j * motion.omega + p.J_j * motion.alpha)


def simulate_transmission(motion: JointMotion, p: DrivetrainParameters) -> BenchResponse:
    """The motor is detached: the belt stays slack (theta_s = 0), the idle actuator's encoder and current read 0."""
    still = np.zeros_like(motion.theta)
    return BenchResponse(still, still, p.B_j * motion.omega + p.J_j * motion.alpha)


def simulate_impedance(
    rate_hz: float, motion: JointMotion, gains: Gains, effects: DrivetrainEffects, p: DrivetrainParameters
) -> BenchResponse:
    """The controller renders its impedance about theta_eq = 0, from rest at theta_m = 0."""
    K_1, B_1, theta_eq = np.array([[gains.K_1], [gains.B_1], [0.0]])
    commands = ControlCommands(K_1, B_1, theta_eq, gains.cancels_friction)
    leg = simulate_drivetrain(rate_hz, motion.theta, motion.omega, commands, effects, p)
    return BenchResponse(leg.theta_m, leg.current, leg.belt_torque + p.B_j * motion.omega + p.J_j * motion.alpha)


def drivetrain_effects(settings: SimulationSettings) -> DrivetrainEffects:
    """The effects of the settings, as arguments of the drivetrain's simulation."""
    effects, drivetrain = settings.effects, settings.drivetrain
    return DrivetrainEffects(
        friction=effects.friction.enabled,
        friction_scale=effects.friction.size,
        control_delay=int(effects.control_delay.value),
        control_updates=drivetrain.control_updates if effects.control_delay.enabled else drivetrain.substeps,
        encoder_resolution=effects.actuator_encoder.value,
        velocity_cutoff_hz=effects.velocity_filter.size if effects.velocity_filter.enabled else None,
        sign_width=drivetrain.sign_width,
        hysteresis_torque=effects.belt_hysteresis.value,
        hysteresis_width=drivetrain.hysteresis_width,
        substeps=drivetrain.substeps,
    )


def scatter(trial: str, settings: SimulationSettings) -> float:
    """Ratio of the trial's K_s to that of the parameter file."""
    draw = stream(settings.seed, trial, "belt_scatter").standard_normal()
    return float(1 + settings.effects.belt_scatter.value * draw)


def recorded_dynamometer(
    trial: str, command: Array, motion: JointMotion, response: BenchResponse, settings: SimulationSettings
) -> tuple[DynamometerLog, dict[str, float]]:
    """The recorded log, and the errors that were drawn for this trial."""
    mount = settings.effects.mount_stiffness
    nodes, drawn = recorded(
        trial,
        {
            "joint_angle": motion.theta + response.torque / mount.size if mount.enabled else motion.theta,
            "actuator_angle": response.theta_m,
            "motor_current": response.current,
            "commanded_angle": command,
            "load_cell_torque": -response.torque,
        },
        settings,
    )
    channels = {name: values for node in nodes for name, values in node.channels.items()}
    return DynamometerLog(time=nodes[0].time, torque_time=nodes[-1].time, **channels), drawn
