"""One trial of a bench, the dynamometer's or the actuator's own: true motion and torque, recorded log, truth."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.model.compensator import Gains, select_gains
from osl_analysis.model.drivetrain import actuator_torque
from osl_analysis.simulator.drivetrain import (
    ControlCommands,
    DrivetrainEffects,
    passive_torque,
    second_order_torque,
    simulate_belt_torque,
    simulate_drivetrain,
)
from osl_analysis.simulator.joint_motion import (
    JointMotion,
    excitation_motion,
    position_loop,
    sine_command,
    slow_cycles,
    there_and_back,
)
from osl_analysis.simulator.mcap_writer import ACTUATOR, DYNAMOMETER, joint_states, wrenches, write_mcap, write_topics
from osl_analysis.simulator.recorder import BenchLog, Jumping, TrueSignal, bench_truth, recording_of
from osl_analysis.simulator.settings import ActuatorBench, SimulationSettings, stream
from osl_analysis.trial import Array


@dataclass(frozen=True)
class BenchResponse:
    """True theta_m [rad], current [A] and resisting torque [N*m] of the joint, shape (n,) each."""

    theta_m: Array
    current: Array
    torque: Array


def unpowered(torque: Array) -> BenchResponse:
    """The response of a joint whose actuator stays where it is and has no current."""
    return BenchResponse(np.zeros_like(torque), np.zeros_like(torque), torque)


def simulate_dynamometer_trial(
    row: Mapping[str, Any], settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[BenchLog, dict[str, object]]:
    """The log of one trial of the sample sheet, and the truth about it. `row` has the sheet's trial, experiment (belt,
    transmission, torque_angle or impedance), controller, K_d and B_d."""
    trial, gains = str(row["trial"]), None
    if row["experiment"] == "belt":
        p = replace(p, K_s=p.K_s * belt_scatter(trial, settings))
        command, motion = moved(there_and_back(settings.belt, settings.dynamometer.rate_hz), settings)
        response = simulate_belt(motion, drivetrain_effects(settings), p)
    elif row["experiment"] == "torque_angle" and settings.foot is not None:
        command, motion = moved(slow_cycles(settings.foot.cycles, settings.dynamometer.rate_hz), settings)
        response = unpowered(passive_torque(settings.foot, motion))
    else:
        command, motion = moved(commanded_motion(row, settings), settings)
        if row["experiment"] == "transmission":
            response = simulate_transmission(motion, p)
        elif settings.joint is not None:
            response = unpowered(second_order_torque(settings.joint, motion, settings.dynamometer.rate_hz))
        else:
            weight = settings.gain_weight.weight
            gains = select_gains(str(row["controller"]), float(row["K_d"]), float(row["B_d"]), p, weight)
            response = simulate_impedance(settings.dynamometer.rate_hz, motion, gains, drivetrain_effects(settings), p)
    log, drawn = recorded_dynamometer(trial, command, motion, response, settings)
    return log, bench_truth(trial, settings, p, gains, drawn)


def commanded_motion(row: Mapping[str, Any], settings: SimulationSettings) -> JointMotion:
    """The motion that the dynamometer is told to make in a transmission or impedance trial."""
    trial, rate = str(row["trial"]), settings.dynamometer.rate_hz
    excitation = settings.excitation_of(trial) if row["experiment"] == "impedance" else None
    if excitation is None:
        return sine_command(settings.protocol, rate)
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
    elastic = simulate_belt_torque(motion.theta, effects, p)
    return unpowered(elastic + p.B_j * motion.omega + p.J_j * motion.alpha)


def simulate_transmission(motion: JointMotion, p: DrivetrainParameters) -> BenchResponse:
    """The motor is detached: the belt stays slack (theta_s = 0), the idle actuator's encoder and current read 0."""
    return unpowered(p.B_j * motion.omega + p.J_j * motion.alpha)


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
        velocity_cutoff_hz=effects.velocity_filter.value,
        sign_width=drivetrain.sign_width,
        hysteresis_torque=effects.belt_hysteresis.value,
        hysteresis_width=drivetrain.hysteresis_width,
        substeps=drivetrain.substeps,
    )


def belt_scatter(trial: str, settings: SimulationSettings) -> float:
    """Ratio of the trial's K_s to that of the parameter file."""
    draw = stream(settings.seed, trial, "belt_scatter").standard_normal()
    return float(1 + settings.effects.belt_scatter.value * draw)


def recorded_dynamometer(
    trial: str, command: Array, motion: JointMotion, response: BenchResponse, settings: SimulationSettings
) -> tuple[BenchLog, dict[str, float]]:
    """The recorded log, and the errors that were drawn for this trial. The load cell has the torque of the joint on the
    bench, the paper's tau_j: *minus* the canonical torque."""
    mount = settings.effects.mount_stiffness
    signals: dict[str, TrueSignal] = {
        "joint_angle": motion.theta + response.torque / mount.size if mount.enabled else motion.theta,
        "actuator_angle": response.theta_m,
        "motor_current": response.current,
        "commanded_angle": command,
        "load_cell_torque": -response.torque,
    }
    return recording_of(trial, signals, settings)


def simulate_actuator_trial(
    trial: str, settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[BenchLog, dict[str, object]]:
    """The log of one trial, and its truth. `settings.actuator` must not be None. The bench follows its commanded
    angle with `dynamometer_bandwidth`, as the dynamometer does. Its torque transducer has the imperfections of the
    load cell."""
    assert settings.actuator is not None  # as SimulationSettings checked
    _, motion = moved(turning(settings.actuator, settings.dynamometer.rate_hz), settings)
    current = current_schedule(settings.actuator, settings.dynamometer.rate_hz)
    friction = settings.effects.friction.value
    actuator = replace(p, f_C=friction * p.f_C, f_G=friction * p.f_G)
    log, drawn = recorded_actuator(trial, motion, current, actuator, settings)
    return log, bench_truth(trial, settings, actuator, None, drawn)


def turning(bench: ActuatorBench, rate_hz: float) -> JointMotion:
    """The commanded angle [rad] with its derivatives: tones of the velocity, faded in and out."""
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    w = 2 * np.pi * np.array([[tone.frequency_hz] for tone in bench.velocity])
    size = np.array([[tone.size] for tone in bench.velocity])
    angle, velocity = size / w * (1 - np.cos(w * time)), size * np.sin(w * time)
    tones = JointMotion(*(x.sum(axis=0) for x in (angle, velocity, size * w * np.cos(w * time))))
    return fading(time, bench.duration_s, bench.fade_s) * tones


def fading(time: Array, duration: float, fade: float) -> JointMotion:
    """A window (n,) that rises from 0 to 1 and falls to 0 within `fade` [s], with continuous derivatives."""
    u = np.clip(np.minimum(time, duration - time) / fade, 0.0, 1.0)
    side = np.where(time < duration / 2, 1.0, -1.0) / fade
    return JointMotion(
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 * side,
        60 * u * (1 - u) * (1 - 2 * u) * side**2,
    )


def current_schedule(bench: ActuatorBench, rate_hz: float) -> Array:
    """Commanded I_q [A], which the current loop follows: the sum of the tones, faded in and out."""
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    tones = sum(tone.size * np.sin(2 * np.pi * tone.frequency_hz * time) for tone in bench.current)
    return np.asarray(tones * fading(time, bench.duration_s, bench.fade_s).theta)


def recorded_actuator(
    trial: str, motion: JointMotion, current: Array, p: DrivetrainParameters, settings: SimulationSettings
) -> tuple[BenchLog, dict[str, float]]:
    """The recorded log of an actuator with these parameters, and the errors that were drawn for this trial. The torque
    is that of the actuator on the bench, the paper's tau_m."""
    torque = torque_of(motion, current, p, settings.dynamometer.rate_hz)
    return recording_of(
        trial, {"actuator_angle": motion.theta, "motor_current": current, "output_torque": torque}, settings
    )


def torque_of(motion: JointMotion, current: Array, p: DrivetrainParameters, rate_hz: float) -> Jumping:
    """True torque [N*m] of the actuator. Its friction jumps where the velocity is zero, and not at the next sample. A
    curve through the samples has every jump half a step after a sample. A torque transducer that samples later than the
    encoder would read all of them late, which looks like inertia."""

    time, true = np.arange(len(current)) / rate_hz, np.column_stack([current, motion.omega, motion.alpha])

    def at(instants: Array) -> Array:
        """The torque at any instants [s]."""
        amperes, omega, alpha = CubicSpline(time, true)(instants).T
        return actuator_torque(amperes, omega, alpha, p)

    return Jumping(actuator_torque(current, motion.omega, motion.alpha, p), at)


JOINTS = {"joint": "joint_angle", "actuator": "actuator_angle", "command": "commanded_angle"}


def write_bench_log(path: Path, log: BenchLog, two_nodes: bool) -> None:
    """Write a log: one topic with all channels, or the standard messages of two nodes, the second of the torque."""
    topic, torque, cell = DYNAMOMETER, "load_cell_torque", "load_cell"
    if torque not in log.channels:
        topic, torque, cell = ACTUATOR, "output_torque", "transducer"
    if not two_nodes:
        write_mcap(path, topic, log.time, log.channels)
        return
    position = {joint: log[angle] for joint, angle in JOINTS.items() if angle in log.channels}
    joints = joint_states("/joint_states", "bench", log.time, position, {"actuator": log["motor_current"]})
    write_topics(path, [joints, wrenches("/wrench", cell, log.torque_time, log[torque])])
