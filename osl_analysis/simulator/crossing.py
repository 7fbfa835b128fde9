"""A trial of the gait laboratory: rigid-body mechanics of a crossing, and its records by Vicon and the leg.

The foot's path and the ankle's angle are prescribed. The drivetrain's torque is simulated for this motion and the
commands of the leg's controller. The moment of the ground reaction about the ankle follows from the equations of Newton
and Euler for the foot. Axes: x forward, y left, z up, in metres.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from osl_analysis.model.compensator import check_request, stiffness_gain
from osl_analysis.model.gain_selection import Weight, optimal_damping
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.simulator import step as gait
from osl_analysis.simulator import vicon
from osl_analysis.simulator.bench import drivetrain_effects
from osl_analysis.simulator.drivetrain import ControlCommands, DrivetrainEffects, DrivetrainMotion, simulate_drivetrain
from osl_analysis.simulator.mcap_writer import LEG, write_mcap
from osl_analysis.simulator.plan import Condition, condition_of
from osl_analysis.simulator.recorder import rounded_to, write_truth
from osl_analysis.simulator.rigid_body import (
    GRAVITY,
    Pose,
    RigidBody,
    TrueWrench,
    interpolated_at,
    rotation_about,
    time_derivative,
)
from osl_analysis.simulator.settings import SimulationSettings, stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import AXES, Array


@lru_cache(maxsize=32)
def compensated_damping(
    path: Path, p: DrivetrainParameters, weight: Weight, K_d: float | None = None, B_d: float | None = None
) -> tuple[Array, Array]:
    """A grid of phases, and B_1 [N*m*s/rad] (Eq. 14) at these. A grid is enough because B_1 is a smooth curve."""
    desired, grid = Condition(K_d=K_d, B_d=B_d).desired(path), np.linspace(0.0, 1.0, 51)
    stiffness, damping = desired.at(desired.K_d, grid), desired.at(desired.B_d, grid)
    # at() is periodic, so the grid's last point is its first
    check_request(stiffness, damping, p)
    B_1 = optimal_damping(stiffness[:-1], damping[:-1], p, weight).B_1
    return grid, np.array([*B_1, B_1[0]])


def walking_commands(
    step: gait.Step, time: Array, walking: WalkingSettings, compensates: bool, p: DrivetrainParameters
) -> ControlCommands:
    """Commands to the actuator in a step, shape (updates of the controller,); `time` [s] is that of the motion. Unless
    the file of the desired impedance has an equilibrium angle, it is chosen so that K_d and B_d give the step's ankle
    moment at the step's nominal angle."""
    stride, asked = walking.rates.motion_hz // walking.rates.controller_hz, step.condition
    c, desired = step.cycle_phase(time[::stride]), asked.desired(walking.impedance)
    K_d, B_d = desired.at(desired.K_d, c), desired.at(desired.B_d, c)
    if compensates:
        damping = compensated_damping(walking.impedance, p, walking.gain_weight.weight, asked.K_d, asked.B_d)
        K_1, B_1 = stiffness_gain(K_d, p), np.interp(np.mod(c, 1.0), *damping)
    else:
        K_1, B_1 = K_d / p.n_T**2, B_d / p.n_T**2
    # internal plantarflexion moment: 0.5 N*m/kg at midstance, 1.4 at push-off, 0 in swing
    bumps = gait.periodic_bumps(c, gait.ANKLE_MOMENT)
    usual = step.body_mass * (bumps * gait.stance_window(np.mod(c, 1.0) / gait.STANCE_FRACTION))
    moment = step.change.load * step.change.amplitude * usual + step.torque_wander[::stride]
    if desired.theta_eq is not None:
        theta_eq = desired.at(desired.theta_eq, c) - (moment - usual) / K_d
    else:
        angle = step.change.amplitude * gait.nominal_ankle_angle(c)
        theta_eq = angle - (moment - B_d * time_derivative(angle, walking.rates.controller_hz)) / K_d
    return ControlCommands(K_1, B_1, theta_eq * p.n_T, cancels_friction=compensates)


@dataclass(frozen=True)
class LegMotion:
    """True motion of leg and platform. The poses of foot and shank have their origin at the ankle. theta [rad], omega
    [rad/s] and alpha [rad/s^2] are the joint's angle with its derivatives, shape (n,) each."""

    theta: Array
    omega: Array
    alpha: Array
    foot: Pose
    shank: Pose
    platform: gait.PlatformMotion


@dataclass(frozen=True)
class SimulatedCrossing:
    """The truth about a crossing. Commands and drivetrain are at the rate of the leg's controller."""

    time: Array  # time [s], shape (n,), at the rate of the motion
    step: gait.Step
    motion: LegMotion
    commands: ControlCommands
    drivetrain: DrivetrainMotion
    drivetrain_torque: Array  # resisting torque [N*m] of the drivetrain, shape (n,)
    torque: Array
    """Resisting torque [N*m] of the joint, shape (n,): from 8 % to 92 % of stance that of the drivetrain, and in swing
    the torque that the swinging foot needs."""
    reaction: TrueWrench  # Ground reaction on the foot


def simulate_crossing(
    time: Array,
    step: gait.Step,
    perturbed: bool,
    compensates: bool,
    walking: WalkingSettings,
    effects: DrivetrainEffects,
    p: DrivetrainParameters,
) -> SimulatedCrossing:
    """The crossing of one step, with or without the perturbation, on a regular grid at the motion's rate."""
    step = step if perturbed else replace(step, hurry=0.0)  # which the perturbation alone brings
    motion = move(time, step, perturbed, walking)
    stride = walking.rates.motion_hz // walking.rates.controller_hz
    commands = walking_commands(step, time, walking, compensates, p)
    theta, omega = motion.theta[::stride], motion.omega[::stride]
    rest = (commands.K_1[0] * commands.theta_eq[0] + p.K_s * theta[0] / p.n_T) / (commands.K_1[0] + p.K_s / p.n_T**2)
    drivetrain = simulate_drivetrain(walking.rates.controller_hz, theta, omega, commands, effects, p, rest)
    belt = interpolated_at(drivetrain.belt_torque, walking.rates.controller_hz, time)
    answer = belt + p.B_j * motion.omega + p.J_j * motion.alpha
    torque, reaction = react(time, step, motion, answer, walking)
    return SimulatedCrossing(time, step, motion, commands, drivetrain, answer, torque, reaction)


def move(time: Array, step: gait.Step, perturbed: bool, walking: WalkingSettings) -> LegMotion:
    """Prescribed motion: the nominal step, its random deviations, and the platform under the foot. The foot rotates
    with the platform. The shank rotates by the share `shank_yield` only, so that the ankle angle changes by the rest.
    In swing the foot returns from the platform's angle."""
    platform = gait.perturbed_platform(time, step, walking) if perturbed else gait.resting_platform(time, walking)
    rate, c, release_s = walking.rates.motion_hz, step.cycle_phase(time), 0.3
    on_platform = 1.0 - gait.smooth_step((time - step.toe_off) / release_s)
    carried, moved = platform.angle * on_platform, platform.shift * on_platform[:, None]
    theta = step.change.amplitude * step.angle_factor * gait.nominal_ankle_angle(c) + step.wander + carried
    theta = theta - moved[:, 0] / walking.perturbation.leg_length_m
    path = gait.ankle_path(c, walking.gait.stride_m)
    if platform.onset is not None:
        given = 0.01 * walking.effects.shank_yield.value * step.condition.sign
        given *= np.radians(walking.perturbation.angle_deg)
        theta = theta - given * gait.pulse(time, platform.onset, 0.2, step.toe_off, release_s)
        slip = 1e-3 * walking.effects.foot_slip.value
        path[:, 0] -= slip * gait.pulse(time, platform.onset, 0.1, step.toe_off, release_s)
    yaw = rotation_about(2, np.full_like(time, step.yaw))
    path = gait.nominal_ankle(walking) + step.placement + path @ yaw[0].T
    foot = gait.displaced(carried, moved, walking).after(Pose(yaw @ rotation_about(1, -gait.foot_pitch(c)), path))
    shank = Pose(foot.rotation @ rotation_about(1, theta), foot.origin)
    omega = time_derivative(theta, rate)
    return LegMotion(theta, omega, time_derivative(omega, rate), foot, shank, platform)


def react(
    time: Array, step: gait.Step, motion: LegMotion, answer: Array, walking: WalkingSettings
) -> tuple[Array, TrueWrench]:
    """The joint's torque [N*m], shape (n,), and the ground reaction at the ankle. About the ankle's axis u the foot
    needs the moment N = u . (dH/dt + r x m (a - g)). The shank applies +tau (toes down), and the ground applies the
    rest, N - tau. The part of the ground decreases with its force at the beginning and end of stance. Across the axis
    the ground's moments are small, and the hinge carries the rest."""
    foot, mass = motion.foot, step.body_mass
    forward, axis, upward = foot.axes
    body = RigidBody(
        walking.effects.foot_inertia.value, np.array(walking.foot.centre_of_mass_m), np.array(walking.foot.gyration_m)
    )
    needed = body.support(foot, walking.rates.motion_hz).moment_about(foot.origin)
    about_axis = np.einsum("ni,ni->n", needed, axis)
    phase = step.stance_phase(time)
    contact = gait.stance_window(phase)
    given = contact * (about_axis - answer)
    force = (
        step.change.load * step.change.amplitude * step.force_factor * gait.ground_reaction(phase) * mass * -GRAVITY[2]
    )
    roll = 0.004 * force[:, 2]  # lever [m]
    spin = 0.03 * mass * contact * np.sin(2 * np.pi * phase)  # up to 0.03 N*m/kg
    moment = given[:, None] * axis + roll[:, None] * forward + spin[:, None] * upward
    return about_axis - given, TrueWrench(force, moment, foot.origin)


def impedance_of_leg(perturbed: SimulatedCrossing, unperturbed: SimulatedCrossing) -> dict[str, float]:
    """K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of the drivetrain's response to the perturbation. Least squares of
    d_torque = K d_theta + B d_omega + I d_alpha without intercept, over the 100 ms after the onset. Both crossings are
    identical before the onset, so that the differences are exactly zero there."""
    onset = perturbed.motion.platform.onset
    if onset is None:
        return {}
    rows = (perturbed.time >= onset) & (perturbed.time <= onset + gait.RENDERED_S)
    new, old = perturbed.motion, unperturbed.motion
    columns = np.stack([new.theta - old.theta, new.omega - old.omega, new.alpha - old.alpha], axis=-1)[rows]
    answer = (perturbed.drivetrain_torque - unperturbed.drivetrain_torque)[rows]
    K, B, inertia = np.linalg.lstsq(columns, answer, rcond=None)[0]
    return {"K_rendered": float(K), "B_rendered": float(B), "I_rendered": float(inertia)}


def crossing_truth(
    crossing: SimulatedCrossing, unperturbed: SimulatedCrossing, walking: WalkingSettings
) -> tuple[dict[str, object], dict[str, Array]]:
    """The random quantities of a crossing and exact curves in SI units,
    shape (n,) each, laboratory axes. force and moment: ground reaction on the foot, the moment about the centre of the
    plate's surface where the platform has carried it (`plate_centre`); axis: the ankle's, through `ankle`; foot_moment:
    what the foot's weight and inertia demand about it, so that torque = foot_moment - axis . (moment + (plate_centre -
    ankle) x force)."""
    motion, step, condition = crossing.motion, crossing.step, crossing.step.condition
    desired, phase, axis = condition.desired(walking.impedance), step.cycle_phase(crossing.time), motion.foot.axes[1]
    centre = motion.platform.pose.point(np.array(walking.plate.centre_m))
    curves = {
        "time": crossing.time,
        "phase": phase,
        "theta": motion.theta,
        "omega": motion.omega,
        "alpha": motion.alpha,
        "torque": crossing.torque,
        "theta_unperturbed": unperturbed.motion.theta,
        "torque_unperturbed": unperturbed.torque,
        "K_d": desired.at(desired.K_d, phase),
        "B_d": desired.at(desired.B_d, phase),
        "platform_angle": motion.platform.angle,
        "foot_moment": crossing.torque + np.einsum("ni,ni->n", crossing.reaction.moment, axis),
    }
    curves |= components("ankle", motion.foot.origin) | components("axis", axis) | components("plate_centre", centre)
    curves |= components("force", crossing.reaction.force)
    curves |= components("moment", crossing.reaction.moment_about(centre))
    planned = {name: getattr(condition, name) for name in ("direction", "K_d", "B_d", "stance_phase", "session")}
    facts: dict[str, object] = {
        "perturbed": motion.platform.onset is not None,
        "command_s": motion.platform.command,
        "onset_s": motion.platform.onset,
        "heel_strike_s": step.heel_strike,
        "toe_off_s": step.toe_off,
        "foot_yaw_rad": step.yaw,
        "placement_m": step.placement.tolist(),
        "condition": planned | {"subject": condition.person},
        "change": step.change.model_dump(mode="json", exclude={"of", "share"}),
    }
    return facts, curves


def components(name: str, vectors: Array) -> dict[str, Array]:
    """Columns name_x, name_y, name_z of vectors, shape (n, 3)."""
    return {f"{name}_{axis}": vectors[:, i] for i, axis in enumerate(AXES)}


def write_leg_log(
    path: Path,
    crossing: SimulatedCrossing,
    clock: tuple[float, float],
    settings: SimulationSettings,
    walking: WalkingSettings,
) -> None:
    """Write the leg's log, sampled at whole periods of its own clock, whose time [s] is offset [s] + (1 + drift) times
    Vicon's; the file has the name of the trial. Gains and current are held from one update of the controller to the
    next."""
    (offset, drift), rates, effects, seed = clock, walking.rates, settings.effects, settings.seed
    first, last = (offset + (1 + drift) * crossing.time[[0, -1]]) * rates.leg_hz
    # the margin excludes a period that rounding put before the first sample or after the last
    leg_time = np.arange(np.ceil(first + 1e-6), np.floor(last - 1e-6) + 1) / rates.leg_hz
    time = (leg_time - offset) / (1 + drift)
    held = np.floor(time * rates.controller_hz).astype(int)
    ripple = effects.current_noise.value * stream(seed, path.stem, "current_noise").standard_normal(len(time))
    theta = interpolated_at(crossing.motion.theta, rates.motion_hz, time)
    theta_m = interpolated_at(crossing.drivetrain.theta_m, rates.controller_hz, time)
    columns = {
        "joint_angle": rounded_to(theta, walking.effects.leg_joint_encoder.value),
        "actuator_angle": rounded_to(theta_m, effects.actuator_encoder.value),
        "motor_current": rounded_to(crossing.drivetrain.current[held] + ripple, effects.current_quantisation.value),
        "stiffness_gain": crossing.commands.K_1[held],
        "damping_gain": crossing.commands.B_1[held],
        "sync": vicon.sync_level(path.stem, seed, walking.gait.recording_s, time),
    }
    write_mcap(path, LEG, leg_time, columns)


def motion_grid(walking: WalkingSettings) -> Array:
    """Times [s] of the motion: whole marker frames, at the motion's rate."""
    rates = walking.rates
    frames = round(walking.gait.recording_s * rates.points_hz)
    return np.arange(frames * (rates.motion_hz // rates.points_hz)) / rates.motion_hz


def simulate_walking_trial(
    row: Mapping[str, object],
    settings: SimulationSettings,
    walking: WalkingSettings,
    p: DrivetrainParameters,
    folder: Path,
) -> None:
    """Simulate one row of the sample sheet, of experiment walking, plate or static, into a campaign's raw folder.

    Writes the truth first, so that every log has a truth. Then writes `vicon/<trial>.c3d` and, for a walking trial,
    `leg/<trial>.mcap`. The controller compensates unless that of the row is 'uncompensated'.
    """
    trial, time, seed, condition = str(row["trial"]), motion_grid(walking), settings.seed, condition_of(row, settings)
    facts: dict[str, object] = {"trial": trial, "seed": seed}
    if row["experiment"] == "walking":
        step = gait.draw_step(trial, seed, time, walking, condition)
        compensates, effects = str(row.get("controller")) != "uncompensated", drivetrain_effects(settings)
        unperturbed = walked = simulate_crossing(time, step, False, compensates, walking, effects, p)
        if row.get("perturbed"):
            walked = simulate_crossing(time, step, True, compensates, walking, effects, p)
        offset = walking.effects.leg_clock_offset.value * stream(seed, trial, "leg_clock_offset").uniform(0.5, 1.5)
        drift = 1e-6 * walking.effects.leg_clock_drift.value * stream(seed, trial, "leg_clock_drift").standard_normal()
        clock = float(offset), float(drift)
        found, curves = crossing_truth(walked, unperturbed, walking)
        facts |= found | {"leg_clock": {"offset_s": clock[0], "drift": clock[1]}}
        facts |= impedance_of_leg(walked, unperturbed)
        scene = scene_of(walked, walking, seed)
    else:
        if row["experiment"] == "plate":
            platform = gait.unloaded_platform(time, trial, seed, walking, condition)
            nothing = np.zeros((len(time), 3))
            load = TrueWrench(nothing, nothing, nothing)
            scene = vicon.Scene(vicon.platform_markers(platform.pose, walking), platform.pose, load, platform.command)
        else:  # quiet standing: foot flat, shank upright, half the body weight vertically above the ankle
            platform = gait.resting_platform(time, walking)
            leg = Pose(platform.pose.rotation, np.tile(gait.nominal_ankle(walking), (len(time), 1)))
            mass = condition.body_mass(walking.gait.body_mass_kg)
            weight = np.tile(-0.5 * mass * GRAVITY, (len(time), 1))
            markers = vicon.leg_markers(leg, leg, condition, walking, seed) | vicon.on_body(leg, vicon.ANKLE_AXIS)
            markers |= vicon.platform_markers(platform.pose, walking)
            load = TrueWrench(weight, np.zeros_like(weight), leg.origin)
            scene = vicon.Scene(markers, platform.pose, load, None, mass, condition.person)
        centre = platform.pose.point(np.array(walking.plate.centre_m))
        curves = {"time": time, "platform_angle": platform.angle} | components("plate_centre", centre)
        facts |= {"command_s": platform.command, "onset_s": platform.onset}
    every = walking.rates.motion_hz // walking.rates.analogs_hz
    facts |= {"effects": settings.effects.model_dump(), "gait_laboratory": walking.model_dump(mode="json")}
    write_truth(folder, trial, facts, {name: curve[::every] for name, curve in curves.items()})
    if row["experiment"] == "walking":
        write_leg_log(folder / "leg" / f"{trial}.mcap", walked, clock, settings, walking)
    vicon.write_c3d(folder / "vicon" / f"{trial}.c3d", vicon.vicon_recording(trial, seed, scene, walking))


def scene_of(walked: SimulatedCrossing, walking: WalkingSettings, seed: int = 0) -> vicon.Scene:
    """The quantities of a crossing that Vicon records. The seed decides where markers are in later sessions.

    The load on the plate is about the ankle of the foot that walks, its pressure even over the width of the foot. The
    floor carries what is beside the plate; the middle of the rest is half of that further to the left. The other foot's
    load is a Gaussian curve about mid-stance, 0.15 m behind the nominal ankle and 0.18 m to the left.
    """
    motion, step, reaction = walked.motion, walked.step, walked.reaction
    platform, phase, beside = motion.platform, step.stance_phase(walked.time), 1e-3 * step.change.overhang_mm
    on_plate, ankle = 1.0 - beside / gait.FOOT_WIDTH, reaction.point + np.array([0.0, 0.5 * beside, 0.0])
    curve = np.exp(-(((phase - 0.5) / 0.12) ** 2)) * ((phase > 0) & (phase < 1))
    other = curve[:, None] * (-0.01 * step.change.second_foot_percent * step.body_mass * GRAVITY)
    place = np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, 0.0]) + np.array([-0.15, 0.18, 0.0])
    lever = platform.pose.point(place) - ankle
    load = TrueWrench(on_plate * reaction.force + other, on_plate * reaction.moment + np.cross(lever, other), ankle)
    markers = vicon.leg_markers(motion.foot, motion.shank, step.condition, walking, seed)
    markers |= vicon.platform_markers(platform.pose, walking)
    return vicon.Scene(markers, platform.pose, load, platform.command, step.body_mass, step.condition.person)
