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
from osl_analysis.simulator import joint_motion, mcap_log, recorder, two_mass_drivetrain
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.random_numbers import generator_of
from osl_analysis.simulator.simulation_settings import SecondOrderJoint, SimulationSettings
from osl_analysis.trial import Array

COULOMB_WIDTH = 1e-3  # velocity [rad/s] of a joint's friction: a hundredth of a slow sine's speed


def simulate_bench_trial(
    row: Mapping[str, Any], settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[dict[str, Array], dict[str, object]]:
    """Simulate one trial of the sample sheet.

    Parameters
    ----------
    row : Mapping
        The sheet's trial, experiment (belt, transmission, impedance or actuator),
        controller, K_d and B_d.
    settings : SimulationSettings
    p : DrivetrainParameters

    Returns
    -------
    log : dict
        As `recording_of` gives it.
    truth : dict
    """
    trial = str(row["trial"])
    experiment = row["experiment"]
    p = parameters_of_trial(trial, experiment, settings, p)
    gains = None
    if experiment == "impedance" and settings.joint is None:
        K_d = float(row["K_d"])
        B_d = float(row["B_d"])
        gains = select_gains(str(row["controller"]), K_d, B_d, p, settings.gain_weight)
    _, signals = true_signals(row, settings, p, gains)
    log, drawn = recorder.recording_of(trial, signals, settings)
    truth: dict[str, object] = {
        "trial": trial,
        "seed": settings.seed,
        "parameters": asdict(p),  # with this trial's K_s
        "gains": asdict(gains) if gains else None,
        "joint": settings.joint.model_dump() if settings.joint else None,
        "effects": settings.effects.model_dump(),
        "recorder": settings.recorder.model_dump(),
        "drawn": drawn,
    }
    return log, truth


def parameters_of_trial(
    trial: str, experiment: str, settings: SimulationSettings, p: DrivetrainParameters
) -> DrivetrainParameters:
    """The device's parameters in one trial: K_s scatters in the belt experiment, and the actuator's
    own friction is the true one."""
    effects = settings.effects
    if experiment == "belt":
        draw = generator_of(settings.seed, trial, "belt_scatter").standard_normal()
        return replace(p, K_s=p.K_s * float(1 + effects.belt_scatter.value * draw))
    if experiment == "actuator":
        return replace(p, f_C=effects.friction.value * p.f_C, f_G=effects.friction.value * p.f_G)
    return p


def true_signals(
    row: Mapping[str, Any],
    settings: SimulationSettings,
    p: DrivetrainParameters,
    gains: Gains | None = None,
) -> tuple[JointMotion, dict[str, recorder.TrueSignal]]:
    """Find the true motion of a trial, and its true signals.

    Parameters
    ----------
    row : Mapping
        Trial and experiment of the sheet.
    settings : SimulationSettings
    p : DrivetrainParameters
    gains : Gains or None
        Of an impedance trial's controller; None: a joint of Eq. 15.

    Returns
    -------
    motion : JointMotion
    signals : dict
        By channel. The load cell has the torque of the joint on the bench, the paper's tau_j:
        *minus* the canonical torque. The actuator's own transducer has imperfections, too.
    """
    experiment = row["experiment"]
    rate = settings.dynamometer.rate_hz
    if experiment == "actuator" and settings.actuator is not None:
        command, current = joint_motion.actuator_command(settings.actuator, rate)
        motion = followed(command, settings)
        return motion, {
            "actuator_angle": motion.theta,
            "motor_current": current,
            "output_torque": output_torque(motion, current, rate, p),
        }

    command = joint_command(row, settings)
    motion = followed(command, settings)
    losses = p.B_j * motion.omega + p.J_j * motion.alpha
    # an idle actuator reads 0
    theta_m = np.zeros_like(motion.theta)
    current = np.zeros_like(motion.theta)
    if experiment == "belt":
        # the actuator is locked at theta_m = 0: all of the joint's angle deflects the belt
        belt = two_mass_drivetrain.constants(drivetrain_effects(settings), p)
        deflection = np.ascontiguousarray(motion.theta)
        torque = two_mass_drivetrain.belt_path(deflection, belt) + losses
    elif experiment == "transmission":
        # the motor is detached: the belt stays slack
        torque = losses
    elif gains is None:
        assert settings.joint is not None  # else there are gains
        torque = second_order_torque(settings.joint, motion)
    else:
        # the controller renders its impedance about theta_eq = 0, from rest at theta_m = 0
        commands = np.array([[gains.K_1], [gains.B_1], [0.0]])
        effects = drivetrain_effects(settings, gains)
        leg = two_mass_drivetrain.simulate_drivetrain(
            rate, motion.theta, motion.omega, commands, effects, p
        )
        theta_m = leg["theta_m"]
        current = leg["current"]
        torque = leg["belt_torque"] + losses

    return motion, {
        "joint_angle": motion.theta,
        "actuator_angle": theta_m,
        "motor_current": current,
        "commanded_angle": command.theta,
        "load_cell_torque": -torque,
    }


def joint_command(row: Mapping[str, Any], settings: SimulationSettings) -> JointMotion:
    """The motion that the dynamometer is told to follow in a trial."""
    experiment = row["experiment"]
    rate = settings.dynamometer.rate_hz
    if experiment == "belt":
        return joint_motion.there_and_back(settings.belt, rate)
    trial = str(row["trial"])
    if experiment == "impedance":
        name_without_number = trial.rpartition("_")[0]
        for excitation in settings.excitations:
            if name_without_number.endswith(f"_{excitation.name}"):
                return joint_motion.excitation_motion(excitation, trial, settings.seed, rate)
    return joint_motion.sine_command(settings.protocol, rate)


def followed(command: JointMotion, settings: SimulationSettings) -> JointMotion:
    """The motion of a bench, with finite bandwidth if its effect is on."""
    bandwidth = settings.effects.dynamometer_bandwidth
    if not bandwidth.enabled:
        return command
    bench = settings.dynamometer
    return joint_motion.position_loop(command, bench.rate_hz, bandwidth.size, bench.damping_ratio)


def output_torque(
    motion: JointMotion, current: Array, rate_hz: float, p: DrivetrainParameters
) -> recorder.TrueSignal:
    """The true torque [N*m] of the actuator on the bench, the paper's tau_m, as a function of
    instants [s].

    Friction jumps where the velocity is zero. A curve through the samples has each jump half a step
    after a sample, which looks like inertia to a transducer that samples later.
    """
    samples = np.column_stack([current, motion.omega, motion.alpha])
    exact = scipy.interpolate.CubicSpline(np.arange(len(current)) / rate_hz, samples)

    def torque_at(instants: Array) -> Array:
        current, omega_m, alpha_m = exact(instants).T
        return actuator_torque(current, omega_m, alpha_m, p)

    return torque_at


def second_order_torque(joint: SecondOrderJoint, motion: JointMotion) -> Array:
    """Resisting torque (n,) [N*m] of Eq. 15, with Coulomb friction."""
    friction = joint.coulomb.value * np.tanh(motion.omega / COULOMB_WIDTH)
    return joint.K * motion.theta + joint.B * motion.omega + joint.I * motion.alpha + friction


def drivetrain_effects(
    settings: SimulationSettings, gains: Gains | None = None
) -> dict[str, float]:
    """The effects of the settings, as the drivetrain's simulation takes them, with the controller
    of these gains."""
    effects = settings.effects
    drivetrain = settings.drivetrain
    is_sampled = effects.control_delay.enabled
    return {
        "friction": effects.friction.enabled,
        "friction_scale": effects.friction.size,
        "cancels_friction": gains is not None and gains.cancels_friction,
        "control_delay": int(effects.control_delay.value),
        "encoder_resolution": effects.actuator_encoder.value,
        "velocity_cutoff_hz": effects.velocity_filter.value,
        "sign_width": drivetrain.sign_width,
        "hysteresis_torque": effects.belt_hysteresis.value,
        "hysteresis_width": drivetrain.hysteresis_width,
        "substeps": drivetrain.substeps,
        "control_updates": drivetrain.control_updates if is_sampled else drivetrain.substeps,
    }


def write_bench_log(path: Path, log: Mapping[str, Array], two_nodes: bool) -> None:
    """Write a log: one topic with all channels, or the standard messages of two nodes, the second
    of the torque."""
    bench, torque_frame, torque = "dynamometer", "load_cell", "load_cell_torque"
    if torque not in log:
        bench, torque_frame, torque = "actuator", "transducer", "output_torque"
    if two_nodes:
        joints = {
            "joint": "joint_angle",
            "actuator": "actuator_angle",
            "command": "commanded_angle",
        }
        position = {joint: log[channel] for joint, channel in joints.items() if channel in log}
        effort = {"actuator": log["motor_current"]}
        topics = [
            mcap_log.joint_states("/joint_states", "bench", log["time"], position, effort),
            mcap_log.wrenches("/wrench", torque_frame, log["torque_time"], log[torque]),
        ]
    else:
        frame = "dynamometer" if bench == "dynamometer" else "actuator_bench"
        topics = [mcap_log.sample_topic(f"/{bench}", frame, log["time"], log)]
    mcap_log.write_topics(path, topics)
