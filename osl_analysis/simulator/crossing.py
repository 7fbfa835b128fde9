"""A trial of the gait laboratory: rigid-body mechanics of a crossing, and its records by Vicon and
the leg.

The foot's path and the ankle's angle are prescribed. The drivetrain's torque is simulated for this
motion and the commands of the leg's controller. The moment of the ground reaction about the ankle
follows from the equations of Newton and Euler for the foot. Axes: x forward, y left, z up, in
metres."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.config.sheet import read_impedance_trajectory
from osl_analysis.errors import optional_module
from osl_analysis.files import atomic_path
from osl_analysis.model.compensator import Weight, check_request, optimal_damping, stiffness_gain
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.simulator import settings as laboratory
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.bench import drivetrain_effects
from osl_analysis.simulator.drivetrain import simulate_drivetrain
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.recorder import (
    SAMPLES,
    rounded_to,
    sample_topic,
    write_topics,
    write_truth,
)
from osl_analysis.simulator.settings import SimulationSettings, WalkingSettings
from osl_analysis.simulator.step import GRAVITY, Pose, TrueWrench, interpolated_at, rotation_about
from osl_analysis.trial import Array

MM = 1e3
PLATE_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Those of C3D force plates: x along laboratory +y, y along +x, z down, turning with the
platform."""


@lru_cache(maxsize=32)
def compensated_damping(path: Path, p: DrivetrainParameters, weight: Weight) -> tuple[Array, Array]:
    """A grid of phases, and B_1 [N*m*s/rad] (Eq. 14) at these. A grid is enough because B_1 is a
    smooth curve."""
    desired, grid = read_impedance_trajectory(path), np.linspace(0.0, 1.0, 51)
    stiffness, damping = desired.at(desired.K_d, grid[:-1]), desired.at(desired.B_d, grid[:-1])
    check_request(stiffness, damping, p)
    B_1 = optimal_damping(stiffness, damping, p, weight).B_1
    return grid, np.array([*B_1, B_1[0]])  # at() is periodic


def walking_commands(step: gait.Step, compensates: bool, p: DrivetrainParameters) -> Array:
    """Commands in a step, as `simulate_drivetrain` takes them, at the rate of the controller. Where
    the file of the desired impedance has no equilibrium angle, K_d and B_d give the nominal ankle
    moment at the nominal angle."""
    trial, walking = step.trial, step.trial.walking
    stride = walking.rates.motion_hz // walking.rates.controller_hz
    c, desired = (
        step.cycle_phase(trial.time[::stride]),
        read_impedance_trajectory(walking.impedance),
    )
    K_d, B_d = desired.at(desired.K_d, c), desired.at(desired.B_d, c)
    K_1, B_1 = K_d / p.n_T**2, B_d / p.n_T**2
    if compensates:
        damping = compensated_damping(walking.impedance, p, walking.gain_weight)
        K_1, B_1 = stiffness_gain(K_d, p), np.interp(np.mod(c, 1.0), *damping)
    # internal plantarflexion moment [N*m/kg]: 0.5 at midstance, 1.4 at push-off, 0 in swing
    sizes = ((0.45, 0.28, 6.0), (0.35, 0.37, 14.0), (1.35, 0.475, 11.0), (-0.15, 0.05, 30.0))
    bumps = gait.periodic_bumps(c, sizes)
    moment = trial.body_mass * (bumps * gait.stance_window(np.mod(c, 1.0) / gait.STANCE_FRACTION))
    angle = gait.nominal_ankle_angle(c)
    theta_eq = (
        angle - (moment - B_d * gait.time_derivative(angle, walking.rates.controller_hz)) / K_d
    )
    if desired.theta_eq is not None:
        theta_eq = desired.at(desired.theta_eq, c)
    return np.array([K_1, B_1, theta_eq * p.n_T])


@dataclass(frozen=True)
class SimulatedCrossing:
    """The truth about a crossing, at the rate of the motion. The poses of foot and shank have their
    origin at the ankle. Commands and drivetrain are at the rate of the leg's controller."""

    time: Array  # time [s], shape (n,)
    step: gait.Step
    motion: JointMotion
    foot: Pose
    shank: Pose
    platform: gait.PlatformMotion
    commands: Array
    drivetrain: Mapping[str, Array]  # as `simulate_drivetrain` gives it
    drivetrain_torque: Array  # resisting torque [N*m] of the drivetrain, shape (n,)
    torque: Array
    """Resisting torque (n,) [N*m] of the joint: from 8 % to 92 % of stance the drivetrain's, in
    swing the foot's."""
    reaction: TrueWrench  # Ground reaction on the foot


def simulate_crossing(
    step: gait.Step, perturbed: bool, effects: Mapping[str, float], p: DrivetrainParameters
) -> SimulatedCrossing:
    """The crossing of one step, with or without the perturbation. A controller that cancels
    friction compensates."""
    rates, time = step.trial.walking.rates, step.trial.time
    motion, foot, shank, platform = move(step, perturbed)
    commands = walking_commands(step, bool(effects["cancels_friction"]), p)
    stride = rates.motion_hz // rates.controller_hz
    theta, omega, (K_1, _, theta_eq) = (
        motion.theta[::stride],
        motion.omega[::stride],
        commands[:, 0],
    )
    rest = (K_1 * theta_eq + p.K_s * theta[0] / p.n_T) / (K_1 + p.K_s / p.n_T**2)
    drivetrain = simulate_drivetrain(rates.controller_hz, theta, omega, commands, effects, p, rest)
    belt = interpolated_at(drivetrain["belt_torque"], rates.controller_hz, time)
    answer = belt + p.B_j * motion.omega + p.J_j * motion.alpha
    torque, reaction = react(step, foot, answer)
    return SimulatedCrossing(
        time, step, motion, foot, shank, platform, commands, drivetrain, answer, torque, reaction
    )


def move(step: gait.Step, perturbed: bool) -> tuple[JointMotion, Pose, Pose, gait.PlatformMotion]:
    """Prescribed motion of ankle, foot, shank and platform. The foot rotates with the platform, and
    the shank by the share `shank_yield` only, so that the ankle angle changes by the rest. In swing
    the foot returns."""
    trial, walking, time, release_s = step.trial, step.trial.walking, step.trial.time, 0.3
    ramp, effects, rate, c = (
        walking.perturbation,
        walking.effects,
        walking.rates.motion_hz,
        step.cycle_phase(time),
    )
    if perturbed:  # held until after toe-off
        platform = gait.ramped_platform(trial, step.command, step.onset, step.toe_off + ramp.hold_s)
    else:
        platform = gait.resting_platform(trial)
    on_platform = 1.0 - gait.smooth_step((time - step.toe_off) / release_s)
    carried, moved = platform.angle * on_platform, platform.shift * on_platform[:, None]
    wander = np.radians(effects.angle_wander.value) * trial.wandering("angle_wander")
    factor = 1 + trial.normal("angle_scale", 0.01)
    # ankle to hip [m], which converts a shift of the platform to an angle of the shank
    leg_length = 0.9
    theta = factor * gait.nominal_ankle_angle(c) + wander + carried - moved[:, 0] / leg_length
    path, pitch = gait.foot_path(c, walking.gait.stride_m)
    if platform.onset is not None:
        given = 0.01 * effects.shank_yield.value * trial.condition.sign * np.radians(ramp.angle_deg)
        theta = theta - given * gait.pulse(time, platform.onset, 0.2, step.toe_off, release_s)
    yaw = rotation_about(2, np.full_like(time, trial.normal("foot_yaw", np.pi / 180)))
    path = gait.nominal_ankle(walking) + step.placement + path @ yaw[0].T
    foot = gait.displaced(carried, moved, walking).after(
        Pose(yaw @ rotation_about(1, -pitch), path)
    )
    omega = gait.time_derivative(theta, rate)
    shank = Pose(foot.rotation @ rotation_about(1, theta), foot.origin)
    return JointMotion(theta, omega, gait.time_derivative(omega, rate)), foot, shank, platform


def react(step: gait.Step, foot: Pose, answer: Array) -> tuple[Array, TrueWrench]:
    """The joint's torque [N*m], shape (n,), and the ground reaction at the ankle. About the ankle's
    axis u the foot needs the moment N = u . (dH/dt + r x m (a - g)). The shank applies +tau (toes
    down), the ground the rest, N - tau, less at both ends of stance. Across the axis the ground's
    moments are small, and the hinge carries the rest."""
    trial, walking, body = step.trial, step.trial.walking, step.trial.walking.foot
    forward, axis, upward = np.moveaxis(foot.rotation, 2, 0)
    mass, effects = trial.body_mass, walking.effects
    own = effects.foot_inertia.value, body.centre_of_mass_m, body.gyration_m
    needed = gait.support(foot, walking.rates.motion_hz, *own).moment_about(foot.origin)
    about_axis, phase = np.einsum("ni,ni->n", needed, axis), step.stance_phase(trial.time)
    contact = gait.stance_window(phase)
    given = contact * (about_axis - answer)
    factor = 1 + 0.01 * effects.force_scale.value * trial.random("force_scale").standard_normal(3)
    force = factor * gait.ground_reaction(phase) * mass * -GRAVITY[2]
    roll = 0.004 * force[:, 2]  # lever [m]
    spin = 0.03 * mass * contact * np.sin(2 * np.pi * phase)  # up to 0.03 N*m/kg
    moment = given[:, None] * axis + roll[:, None] * forward + spin[:, None] * upward
    return about_axis - given, TrueWrench(force, moment, foot.origin)


def impedance_of_leg(
    perturbed: SimulatedCrossing, unperturbed: SimulatedCrossing
) -> dict[str, float]:
    """K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of the drivetrain's response to the perturbation
    over the 100 ms after the onset, by least squares without intercept: before the onset both
    crossings are identical."""
    onset = perturbed.platform.onset
    if onset is None:
        return {}
    rows = (perturbed.time >= onset) & (perturbed.time <= onset + gait.RENDERED_S)
    new, old = perturbed.motion, unperturbed.motion
    columns = np.stack(
        [new.theta - old.theta, new.omega - old.omega, new.alpha - old.alpha], axis=-1
    )[rows]
    answer = (perturbed.drivetrain_torque - unperturbed.drivetrain_torque)[rows]
    K, B, inertia = np.linalg.lstsq(columns, answer, rcond=None)[0]
    return {"K_rendered": float(K), "B_rendered": float(B), "I_rendered": float(inertia)}


def write_leg_log(
    folder: Path,
    crossing: SimulatedCrossing,
    clock: tuple[float, float],
    settings: SimulationSettings,
) -> None:
    """Write the leg's log `leg/<trial>.mcap`, sampled at whole periods of its own clock, whose time
    [s] is offset [s] + (1 + drift) times Vicon's. Gains and current are held from one update of the
    controller to the next."""
    trial, (offset, drift), effects = crossing.step.trial, clock, settings.effects
    rates, drivetrain = trial.walking.rates, crossing.drivetrain
    first, last = (offset + (1 + drift) * crossing.time[[0, -1]]) * rates.leg_hz
    # the margin excludes a period that rounding put before the first sample or after the last
    leg_time = np.arange(np.ceil(first + 1e-6), np.floor(last - 1e-6) + 1) / rates.leg_hz
    time = (leg_time - offset) / (1 + drift)
    held = np.floor(time * rates.controller_hz).astype(int)
    ripple = effects.current_noise.value * trial.random("current_noise").standard_normal(len(time))
    theta = interpolated_at(crossing.motion.theta, rates.motion_hz, time)
    theta_m = interpolated_at(drivetrain["theta_m"], rates.controller_hz, time)
    columns = {
        "joint_angle": rounded_to(theta, trial.walking.effects.leg_joint_encoder.value),
        "actuator_angle": rounded_to(theta_m, effects.actuator_encoder.value),
        "motor_current": rounded_to(
            drivetrain["current"][held] + ripple, effects.current_quantisation.value
        ),
        "stiffness_gain": crossing.commands[0, held],
        "damping_gain": crossing.commands[1, held],
        "sync": sync_level(trial, time),
    }
    topic = sample_topic("/leg", "leg", SAMPLES["/leg"], leg_time, columns)
    write_topics(folder / "leg" / f"{trial.name}.mcap", [topic])


def simulate_walking_trial(
    row: Mapping[str, Any],
    campaign: SimulationSettings,
    walking: WalkingSettings,
    p: DrivetrainParameters,
    raw: Path,
) -> None:
    """Simulate one row of the sample sheet, of walking, plate or static, into a campaign's folder
    `raw`: first the truth, so that every log has one, then `vicon/<trial>.c3d` and, of a walking
    trial, `leg/<trial>.mcap`."""
    trial = gait.GaitTrial(
        str(row["trial"]), campaign.seed, walking, laboratory.condition_of(row, campaign)
    )
    facts: dict[str, object] = {"trial": trial.name, "seed": campaign.seed}
    if row["experiment"] == "walking":
        step, effects = gait.draw_step(trial), drivetrain_effects(campaign)
        # the controller compensates
        effects["cancels_friction"] = row.get("controller") != "uncompensated"
        unperturbed = simulate_crossing(step, False, effects, p)
        walked = simulate_crossing(step, True, effects, p) if row.get("perturbed") else unperturbed
        offset = float(
            walking.effects.leg_clock_offset.value
            * trial.random("leg_clock_offset").uniform(0.5, 1.5)
        )
        drift = float(
            1e-6
            * walking.effects.leg_clock_drift.value
            * trial.random("leg_clock_drift").standard_normal()
        )
        platform, phase = walked.platform, step.cycle_phase(walked.time)
        desired = read_impedance_trajectory(walking.impedance)
        curves = {
            "time": walked.time,
            "phase": phase,
            **vars(walked.motion),
            "torque": walked.torque,
        }
        curves |= {"K_d": desired.at(desired.K_d, phase), "B_d": desired.at(desired.B_d, phase)}
        curves |= {"platform_angle": platform.angle}
        facts |= {
            "perturbed": platform.onset is not None,
            "command_s": platform.command,
            "onset_s": platform.onset,
            "heel_strike_s": step.heel_strike,
            "toe_off_s": step.toe_off,
            "foot_yaw_rad": trial.normal("foot_yaw", np.pi / 180),
            "placement_m": step.placement.tolist(),
            "condition": {
                "direction": trial.condition.direction,
                "subject": trial.condition.person,
            },
            "leg_clock": {"offset_s": offset, "drift": drift},
        }
        facts |= impedance_of_leg(walked, unperturbed)
    else:
        platform = (
            gait.unloaded_platform(trial)
            if row["experiment"] == "plate"
            else gait.resting_platform(trial)
        )
        curves = {"time": trial.time, "platform_angle": platform.angle}
        facts |= {"command_s": platform.command, "onset_s": platform.onset}
    every = walking.rates.motion_hz // walking.rates.analogs_hz
    facts |= {
        "effects": campaign.effects.model_dump(),
        "gait_laboratory": walking.model_dump(mode="json"),
    }
    write_truth(raw, trial.name, facts, {name: curve[::every] for name, curve in curves.items()})
    if row["experiment"] == "walking":
        write_leg_log(raw, walked, (offset, drift), campaign)
        write_crossing_capture(raw, walked)
        return
    nothing = np.zeros((len(trial.time), 3))
    if row["experiment"] == "plate":
        write_capture(raw, trial, {}, platform, TrueWrench(nothing, nothing, nothing))
        return
    # quiet standing: foot flat, shank upright, half the body weight vertically above the ankle
    leg = Pose(platform.pose.rotation, np.tile(gait.nominal_ankle(walking), (len(trial.time), 1)))
    weight = TrueWrench(
        np.tile(-0.5 * trial.body_mass * GRAVITY, (len(trial.time), 1)), nothing, leg.origin
    )
    markers = leg_markers(leg, leg) | on_body(leg, laboratory.ANKLE_AXIS)
    write_capture(raw, trial, markers, platform, weight)


def write_crossing_capture(folder: Path, walked: SimulatedCrossing) -> None:
    """Write the capture of a crossing."""
    markers = leg_markers(walked.foot, walked.shank)
    write_capture(folder, walked.step.trial, markers, walked.platform, walked.reaction)


def write_c3d(
    path: Path, points: Array, analogs: Array, groups: Mapping[str, Mapping[str, Any]]
) -> None:
    """Write markers [m], (frames, labels, 3), NaN where hidden, and analogs, (samples, channels),
    with groups of parameters; the file appears whole or not at all. A hidden marker is stored as
    Nexus does it: coordinates 0 and residual -1. That of a seen one is 0, because readers disagree
    about the byte of a positive residual."""
    file: Any = optional_module("ezc3d", "the simulator of walking").c3d()
    seen = np.isfinite(points).all(axis=2).T
    homogeneous = np.ones((4, *seen.shape))
    homogeneous[:3] = np.where(seen, points.transpose(2, 1, 0) * MM, 0.0)
    masks = np.zeros((7, *seen.shape), dtype=bool)
    file["data"]["points"], file["data"]["analogs"] = homogeneous, analogs.T[None]
    file["data"]["meta_points"] = {
        "residuals": np.where(seen, 0.0, -1.0)[None],
        "camera_masks": masks,
    }
    parameters = file["parameters"]
    for group, values in groups.items():
        if values:
            parameters.create_group_if_needed(group)
        for name, value in values.items():
            # C3D's types are bytes per element, -1 for characters. ezc3d's own `add_parameter`
            # makes floats of whole numbers, which other readers refuse in CHANNEL and TYPE
            kind = -1 if isinstance(value, list) else 2 if value.dtype.kind == "i" else 4
            known = parameters[group].get(name, {"description": "", "is_locked": False})
            parameters[group][name] = {**known, "type": kind, "value": value}
    with atomic_path(path) as temporary:
        file.write(str(temporary))


def sync_level(trial: gait.GaitTrial, time: Array) -> Array:
    """Level, 0 or 1, of the synchronisation line at times [s]: an irregular pulse train over the
    duration of a recording, whose pattern does not repeat. It is low before the first pulse."""
    # intervals [s] between two changes
    shortest, longest, duration = 0.06, 0.25, trial.walking.gait.recording_s
    edges = np.cumsum(trial.random("sync").uniform(shortest, longest, int(duration / shortest) + 1))
    return np.asarray(np.searchsorted(edges[edges < duration], time, side="right") % 2, dtype=float)


def leg_markers(foot: gait.Pose, shank: gait.Pose) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers that foot and shank always carry."""
    return on_body(foot, laboratory.FOOT) | on_body(shank, laboratory.SHANK)


def on_body(body: gait.Pose, places: Mapping[str, gait.Point]) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of points given by their places [m] on a body."""
    return {label: body.point(place) for label, place in places.items()}


def write_capture(
    folder: Path,
    trial: gait.GaitTrial,
    leg: Mapping[str, Array],
    platform: gait.PlatformMotion,
    load: gait.TrueWrench,
) -> None:
    """Write the capture `vicon/<trial>.c3d`: the exact paths of the leg's markers [m] and those of
    the platform, with noise and gaps; the plate under its load, synchronisation, and the trigger,
    high for 20 ms. Without markers on a leg there is no person.

    The plate's signs are as Vicon Nexus stores them: a standing person reads Fz < 0 along z down.
    Its sensors carry the foot and the plate's own mass above them: force F + m (a - g), moment M +
    dH/dt + r x m (a - g). Zeroed at rest."""
    plate, rates, effects = trial.walking.plate, trial.walking.rates, trial.walking.effects
    on_platform = {
        label: np.add(plate.centre_m, place) for label, place in laboratory.PLATFORM.items()
    }
    markers = {**leg, **on_body(platform.pose, on_platform)}
    exact = np.stack(list(markers.values()), axis=1)[:: rates.motion_hz // rates.points_hz]
    time = np.arange(len(exact) * (rates.analogs_hz // rates.points_hz)) / rates.analogs_hz
    turned, rate = platform.pose.rotation @ PLATE_AXES, rates.motion_hz
    sensor = np.array(plate.centre_m) + np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])
    mass, centre = effects.plate_inertia.value, np.add(plate.centre_m, plate.centre_of_mass_m)
    own, about = (
        gait.support(platform.pose, rate, mass, centre, plate.gyration_m),
        platform.pose.point(sensor),
    )
    force, resting = np.einsum("nji,nj->ni", turned, load.force + own.force), -mass * gait.GRAVITY
    moment = np.einsum("nji,nj->ni", turned, load.moment_about(about) + own.moment_about(about))
    zeroed = force - resting @ PLATE_AXES, moment - np.cross(centre - sensor, resting) @ PLATE_AXES
    # force [N], and moment [N*mm] about the sensor's origin, with lag, offset and noise
    channels = []
    for quantity, unit, values in zip(("force", "moment"), (1.0, MM), zeroed, strict=True):
        noise = trial.random(f"{quantity}_noise").standard_normal((len(time), 3))
        offset = trial.random(f"{quantity}_offset").standard_normal(3)
        late = gait.interpolated_at(values, rate, time - 1e-3 * effects.plate_lag.value)
        late = late + getattr(effects, f"{quantity}_noise").value * noise
        channels.append(unit * (late + getattr(effects, f"{quantity}_offset").value * offset))
    command = np.inf if platform.command is None else platform.command
    trigger = np.asarray((time >= command) & (time < command + 0.02), dtype=float)
    analogs = np.column_stack([*channels, 5.0 * sync_level(trial, time), 5.0 * trigger])
    labels, names = list(markers), [*laboratory.PLATE_CHANNELS, "Sync", "Trigger"]
    quadrants = (
        np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=float) @ PLATE_AXES.T
    )
    # in C3D's order
    corners = np.array(plate.centre_m) + quadrants * (0.5 * np.array([*plate.size_m, 0.0]))
    # of the sensor below the surface, z > 0: the sign of Vicon Nexus; that of the C3D manual is the
    # opposite
    origin = np.asarray(PLATE_AXES.T @ np.array([*plate.sensor_offset_m, -plate.sensor_depth_m]))
    person = trial.condition.person if leg else None
    groups: dict[str, dict[str, Any]] = {
        "POINT": {
            "LABELS": labels,
            "DESCRIPTIONS": [""] * len(labels),
            "UNITS": ["mm"],
            "RATE": np.array([float(rates.points_hz)]),
            "X_SCREEN": ["+X"],
            "Y_SCREEN": ["+Z"],
            "FORCE_UNITS": ["N"],
            "MOMENT_UNITS": ["Nmm"],
        },
        "ANALOG": {
            "LABELS": names,
            "DESCRIPTIONS": [""] * len(names),
            "UNITS": [*laboratory.PLATE_CHANNELS.values(), "V", "V"],
            "RATE": np.array([float(rates.analogs_hz)]),
            "FORMAT": ["SIGNED"],
        },
        "FORCE_PLATFORM": {
            "USED": np.array([1]),
            "TYPE": np.array([2]),
            "ZERO": np.array([1, 0]),
            "CORNERS": corners.T[:, :, None] * MM,
            "ORIGIN": origin[:, None] * MM,
            "CHANNEL": np.arange(1, len(laboratory.PLATE_CHANNELS) + 1)[:, None],
            "CAL_MATRIX": np.zeros(0),
        },
        "TRIAL": {"CAMERA_RATE": np.array([float(rates.points_hz)])},
        "SUBJECTS": {} if person is None else {"NAMES": [person]},
        "MANUFACTURER": {"COMPANY": ["osl-analysis"], "SOFTWARE": ["simulator"]},
    }
    write_c3d(folder / "vicon" / f"{trial.name}.c3d", seen_markers(trial, exact), analogs, groups)


def seen_markers(trial: gait.GaitTrial, exact: Array) -> Array:
    """Marker positions [m] with noise, shape (frames, labels, 3), NaN where hidden."""
    effects = trial.walking.effects
    noise = trial.random("marker_noise").standard_normal(exact.shape)
    seen, random = exact + 1e-3 * effects.marker_noise.value * noise, trial.random("marker_gaps")
    for _ in range(random.poisson(effects.marker_gaps.value)):
        # a quarter of them are long
        shortest, longest = (0.05, 0.2) if random.random() < 0.25 else (0.007, 0.04)
        length = int(np.ceil(random.uniform(shortest, longest) * trial.walking.rates.points_hz))
        first, label = random.integers(len(exact)), random.integers(exact.shape[1])
        seen[first : first + length, label] = np.nan
    return seen
