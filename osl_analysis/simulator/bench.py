"""One trial of a bench, the dynamometer's or the actuator's own: true motion and torque, recorded log, truth."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from osl_analysis.model.compensator import Gains, select_gains
from osl_analysis.model.drivetrain import actuator_torque
from osl_analysis.model.parameters import DrivetrainParameters
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
from osl_analysis.simulator.recorder import BenchLog, Jumping, TrueSignal, recording_of
from osl_analysis.simulator.settings import ActuatorBench, SimulationSettings, stream
from osl_analysis.trial import Array


def simulate_bench_trial(
    row: Mapping[str, Any], settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[BenchLog, dict[str, object]]:
    """The log of one trial of the sample sheet, and the truth about it. `row` has the sheet's trial, experiment (belt,
    transmission, torque_angle, impedance or actuator), controller, K_d and B_d."""
    trial, effects, gains = str(row["trial"]), settings.effects, None
    if row["experiment"] == "belt":  # K_s scatters from trial to trial
        draw = stream(settings.seed, trial, "belt_scatter").standard_normal()
        p = replace(p, K_s=p.K_s * float(1 + effects.belt_scatter.value * draw))
    elif row["experiment"] == "actuator":
        p = replace(p, f_C=effects.friction.value * p.f_C, f_G=effects.friction.value * p.f_G)
    elif row["experiment"] == "impedance" and settings.joint is None:
        weight = settings.gain_weight.weight
        gains = select_gains(str(row["controller"]), float(row["K_d"]), float(row["B_d"]), p, weight)
    log, drawn = recording_of(trial, true_signals(row, settings, p, gains)[1], settings)
    truth: dict[str, object] = {
        "trial": trial,
        "seed": settings.seed,
        "parameters": asdict(p),  # with this trial's K_s
        "gains": asdict(gains) if gains else None,
        "joint": settings.joint.model_dump() if settings.joint else None,
        **({"foot": settings.foot.model_dump()} if settings.foot else {}),
        "effects": settings.effects.model_dump(),
        "recorder": settings.recorder.model_dump(),
        "drawn": drawn,
    }
    return log, truth


def true_signals(
    row: Mapping[str, Any], settings: SimulationSettings, p: DrivetrainParameters, gains: Gains | None = None
) -> tuple[JointMotion, dict[str, TrueSignal]]:
    """The true motion of a trial, and its true signals by channel. The load cell has the torque of the joint on the
    bench, the paper's tau_j: *minus* the canonical torque."""
    experiment, rate = row["experiment"], settings.dynamometer.rate_hz
    if experiment == "actuator":
        assert settings.actuator is not None  # as SimulationSettings checked
        return actuator_signals(settings.actuator, settings, p)
    command = commanded_motion(row, settings)
    motion = moved(command, settings)
    losses, still = p.B_j * motion.omega + p.J_j * motion.alpha, np.zeros_like(motion.theta)
    theta_m, current = still, still
    if experiment == "belt":  # the actuator is locked at theta_m = 0: all of the joint's angle deflects the belt
        torque = simulate_belt_torque(motion.theta, drivetrain_effects(settings), p) + losses
    elif experiment == "transmission":  # the motor is detached: the belt stays slack, and the idle actuator reads 0
        torque = losses
    elif experiment == "torque_angle" and settings.foot is not None:
        torque = passive_torque(settings.foot, motion)
    elif gains is None:
        assert settings.joint is not None  # else there are gains
        torque = second_order_torque(settings.joint, motion, rate)
    else:  # the controller renders its impedance about theta_eq = 0, from rest at theta_m = 0
        K_1, B_1, theta_eq = np.array([[gains.K_1], [gains.B_1], [0.0]])
        commands = ControlCommands(K_1, B_1, theta_eq, gains.cancels_friction)
        leg = simulate_drivetrain(rate, motion.theta, motion.omega, commands, drivetrain_effects(settings), p)
        theta_m, current, torque = leg.theta_m, leg.current, leg.belt_torque + losses
    mount = settings.effects.mount_stiffness
    return motion, {
        "joint_angle": motion.theta + torque / mount.size if mount.enabled else motion.theta,
        "actuator_angle": theta_m,
        "motor_current": current,
        "commanded_angle": command.theta,
        "load_cell_torque": -torque,
    }


def commanded_motion(row: Mapping[str, Any], settings: SimulationSettings) -> JointMotion:
    """The motion that the dynamometer is told to make in a trial."""
    trial, rate = str(row["trial"]), settings.dynamometer.rate_hz
    if row["experiment"] == "belt":
        return there_and_back(settings.belt, rate)
    if row["experiment"] == "torque_angle" and settings.foot is not None:
        return slow_cycles(settings.foot.cycles, rate)
    excitation = settings.excitation_of(trial) if row["experiment"] == "impedance" else None
    if excitation is None:
        return sine_command(settings.protocol, rate)
    return excitation_motion(excitation, trial, settings.seed, rate)


def moved(command: JointMotion, settings: SimulationSettings) -> JointMotion:
    """The motion of a bench that is told to make another one."""
    bench, bandwidth = settings.dynamometer, settings.effects.dynamometer_bandwidth
    if not bandwidth.enabled:
        return command
    return position_loop(command, bench.rate_hz, bandwidth.size, bench.damping_ratio)


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


def actuator_signals(
    bench: ActuatorBench, settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[JointMotion, dict[str, TrueSignal]]:
    """The true motion of an actuator with these parameters on its own bench, and its true signals by channel. The bench
    follows its commanded angle with `dynamometer_bandwidth`, as the dynamometer does. Its torque transducer has the
    imperfections of the load cell. The torque is that of the actuator on the bench, the paper's tau_m."""
    rate = settings.dynamometer.rate_hz
    time, fading = faded(bench, rate)
    motion = moved(turning(bench, rate), settings)
    tones = sum(tone.size * np.sin(2 * np.pi * tone.frequency_hz * time) for tone in bench.current)
    current = np.asarray(tones * fading.theta)
    exact = CubicSpline(time, np.column_stack([current, motion.omega, motion.alpha]))

    def torque_at(instants: Array) -> Array:
        """True torque [N*m] at any instants [s]. Friction jumps where the velocity is zero, and not at the next sample.
        A curve through the samples has every jump half a step after a sample. A torque transducer that samples later
        than the encoder would read all of them late, which looks like inertia."""
        amperes, omega, alpha = exact(instants).T
        return actuator_torque(amperes, omega, alpha, p)

    torque = Jumping(actuator_torque(current, motion.omega, motion.alpha, p), torque_at)
    return motion, {"actuator_angle": motion.theta, "motor_current": current, "output_torque": torque}


def turning(bench: ActuatorBench, rate_hz: float) -> JointMotion:
    """The commanded angle [rad] with its derivatives: tones of the velocity, faded in and out."""
    time, fading = faded(bench, rate_hz)
    w = 2 * np.pi * np.array([[tone.frequency_hz] for tone in bench.velocity])
    size = np.array([[tone.size] for tone in bench.velocity])
    angle, velocity = size / w * (1 - np.cos(w * time)), size * np.sin(w * time)
    return fading * JointMotion(*(x.sum(axis=0) for x in (angle, velocity, size * w * np.cos(w * time))))


def faded(bench: ActuatorBench, rate_hz: float) -> tuple[Array, JointMotion]:
    """Times (n,) [s] of the schedule, and a window (n,) that rises from 0 to 1 and falls to 0 within `fade_s`, with
    continuous derivatives."""
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    u = np.clip(np.minimum(time, bench.duration_s - time) / bench.fade_s, 0.0, 1.0)
    side = np.where(time < bench.duration_s / 2, 1.0, -1.0) / bench.fade_s
    return time, JointMotion(
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 * side,
        60 * u * (1 - u) * (1 - 2 * u) * side**2,
    )


def write_bench_log(path: Path, log: BenchLog, two_nodes: bool) -> None:
    """Write a log: one topic with all channels, or the standard messages of two nodes, the second of the torque."""
    topic, torque, cell = DYNAMOMETER, "load_cell_torque", "load_cell"
    if torque not in log.channels:
        topic, torque, cell = ACTUATOR, "output_torque", "transducer"
    if not two_nodes:
        write_mcap(path, topic, log.time, log.channels)
        return
    joints = {"joint": "joint_angle", "actuator": "actuator_angle", "command": "commanded_angle"}
    position = {joint: log.channels[angle] for joint, angle in joints.items() if angle in log.channels}
    effort = {"actuator": log.channels["motor_current"]}
    states = joint_states("/joint_states", "bench", log.time, position, effort)
    write_topics(path, [states, wrenches("/wrench", cell, log.torque_time, log.channels[torque])])
