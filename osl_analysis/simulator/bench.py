"""One trial of a bench, the dynamometer's or the actuator's own: true motion and torque, recorded
log, truth."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from osl_analysis.model.compensator import Gains, select_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, actuator_torque
from osl_analysis.simulator import drivetrain, joint_motion, recorder
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.settings import SimulationSettings, stream
from osl_analysis.trial import Array


def simulate_bench_trial(
    row: Mapping[str, Any], settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[dict[str, Array], dict[str, object]]:
    """The log of one trial of the sample sheet, as `recording_of` gives it, and the truth about it.
    `row` has the sheet's trial, experiment (belt, transmission, torque_angle, impedance or
    actuator), controller, K_d and B_d."""
    trial, effects, gains = str(row["trial"]), settings.effects, None
    if row["experiment"] == "belt":  # K_s scatters from trial to trial
        draw = stream(settings.seed, trial, "belt_scatter").standard_normal()
        p = replace(p, K_s=p.K_s * float(1 + effects.belt_scatter.value * draw))
    elif row["experiment"] == "actuator":
        p = replace(p, f_C=effects.friction.value * p.f_C, f_G=effects.friction.value * p.f_G)
    elif row["experiment"] == "impedance" and settings.joint is None:
        weight = settings.gain_weight
        gains = select_gains(
            str(row["controller"]), float(row["K_d"]), float(row["B_d"]), p, weight
        )
    log, drawn = recorder.recording_of(trial, true_signals(row, settings, p, gains)[1], settings)
    return log, {
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


def true_signals(
    row: Mapping[str, Any],
    settings: SimulationSettings,
    p: DrivetrainParameters,
    gains: Gains | None = None,
) -> tuple[JointMotion, dict[str, recorder.TrueSignal]]:
    """The true motion of a trial, and its true signals by channel. The load cell has the torque of
    the joint on the bench, the paper's tau_j: *minus* the canonical torque. The actuator's own
    transducer has imperfections, too."""
    experiment, bench, bandwidth = (
        row["experiment"],
        settings.dynamometer,
        settings.effects.dynamometer_bandwidth,
    )
    rate, own = bench.rate_hz, np.zeros(0)
    if experiment == "actuator" and settings.actuator is not None:
        command, own = joint_motion.actuator_command(settings.actuator, rate)
    elif experiment == "belt":
        command = joint_motion.there_and_back(settings.belt, rate)
    elif experiment == "torque_angle" and settings.foot is not None:
        command = joint_motion.slow_cycles(settings.foot.cycles, rate)
    else:
        trial, others = str(row["trial"]), settings.excitations if experiment == "impedance" else ()
        own_motion = [one for one in others if trial.rpartition("_")[0].endswith(f"_{one.name}")]
        command = (
            joint_motion.excitation_motion(own_motion[0], trial, settings.seed, rate)
            if own_motion
            else joint_motion.sine_command(settings.protocol, rate)
        )
    follows = bandwidth.enabled  # either bench
    motion = (
        joint_motion.position_loop(command, rate, bandwidth.size, bench.damping_ratio)
        if follows
        else command
    )
    if experiment == "actuator":
        driven = np.column_stack([own, motion.omega, motion.alpha])
        exact = scipy.interpolate.CubicSpline(np.arange(len(own)) / rate, driven)

        def torque_at(instants: Array) -> Array:
            """True torque [N*m] of the actuator on the bench, the paper's tau_m, at any instants
            [s]. Friction jumps where the velocity is zero. A curve through the samples has each
            jump half a step after a sample, which looks like inertia to a transducer that samples
            later."""
            amperes, omega, alpha = exact(instants).T
            return actuator_torque(amperes, omega, alpha, p)

        return motion, {
            "actuator_angle": motion.theta,
            "motor_current": own,
            "output_torque": torque_at,
        }
    losses, still = p.B_j * motion.omega + p.J_j * motion.alpha, np.zeros_like(motion.theta)
    theta_m, current = still, still
    # the actuator is locked at theta_m = 0: all of the joint's angle deflects the belt
    if experiment == "belt":
        belt = drivetrain.constants(drivetrain_effects(settings), p)
        torque = drivetrain.belt_path(np.ascontiguousarray(motion.theta), belt) + losses
    # the motor is detached: the belt stays slack, and the idle actuator reads 0
    elif experiment == "transmission":
        torque = losses
    elif experiment == "torque_angle" and settings.foot is not None:
        torque = drivetrain.passive_torque(settings.foot, motion)
    elif gains is None:
        assert settings.joint is not None  # else there are gains
        K, B, I = settings.joint.K, settings.joint.B, settings.joint.I
        # a hundredth of a slow sine's speed
        friction = settings.joint.coulomb.value * np.tanh(motion.omega / 1e-3)
        torque = K * motion.theta + B * motion.omega + I * motion.alpha + friction
    else:  # the controller renders its impedance about theta_eq = 0, from rest at theta_m = 0
        commands, effects = (
            np.array([[gains.K_1], [gains.B_1], [0.0]]),
            drivetrain_effects(settings, gains),
        )
        leg = drivetrain.simulate_drivetrain(rate, motion.theta, motion.omega, commands, effects, p)
        theta_m, current, torque = leg["theta_m"], leg["current"], leg["belt_torque"] + losses
    mount = settings.effects.mount_stiffness
    return motion, {
        "joint_angle": motion.theta + torque / mount.size if mount.enabled else motion.theta,
        "actuator_angle": theta_m,
        "motor_current": current,
        "commanded_angle": command.theta,
        "load_cell_torque": -torque,
    }


def drivetrain_effects(
    settings: SimulationSettings, gains: Gains | None = None
) -> dict[str, float]:
    """The effects of the settings, as the drivetrain's simulation takes them, with the controller
    of these gains."""
    effects, integrated = settings.effects, settings.drivetrain
    return {
        "friction": effects.friction.enabled,
        "friction_scale": effects.friction.size,
        "cancels_friction": gains is not None and gains.cancels_friction,
        "control_delay": int(effects.control_delay.value),
        "encoder_resolution": effects.actuator_encoder.value,
        "velocity_cutoff_hz": effects.velocity_filter.value,
        "sign_width": integrated.sign_width,
        "hysteresis_torque": effects.belt_hysteresis.value,
        "hysteresis_width": integrated.hysteresis_width,
        "substeps": integrated.substeps,
        "control_updates": (
            integrated.control_updates if effects.control_delay.enabled else integrated.substeps
        ),
    }


def write_bench_log(path: Path, log: Mapping[str, Array], two_nodes: bool) -> None:
    """Write a log: one topic with all channels, or the standard messages of two nodes, the second
    of the torque."""
    topic, frame, torque, cell = "/dynamometer", "dynamometer", "load_cell_torque", "load_cell"
    if torque not in log:
        topic, frame, torque, cell = "/actuator", "actuator_bench", "output_torque", "transducer"
    if not two_nodes:
        recorder.write_topics(
            path, [recorder.sample_topic(topic, frame, recorder.SAMPLES[topic], log["time"], log)]
        )
        return
    joints = {"joint": "joint_angle", "actuator": "actuator_angle", "command": "commanded_angle"}
    position = {joint: log[angle] for joint, angle in joints.items() if angle in log}
    effort = {"actuator": log["motor_current"]}
    states = recorder.joint_states("/joint_states", "bench", log["time"], position, effort)
    recorder.write_topics(
        path, [states, recorder.wrenches("/wrench", cell, log["torque_time"], log[torque])]
    )
