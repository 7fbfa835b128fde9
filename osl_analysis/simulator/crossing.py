"""One crossing of the walkway as rigid-body mechanics: foot, shank and platform, ankle torque, ground reaction.

The foot's path and the ankle's angle are prescribed. The drivetrain's torque is simulated for this motion and the
commands of the leg's controller. The moment of the ground reaction about the ankle follows from the equations of Newton
and Euler for the foot. Axes: x forward, y left, z up, in metres.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.model.compensator import check_request, stiffness_gain
from osl_analysis.model.gain_selection import Weight, optimal_damping
from osl_analysis.simulator.drivetrain import ControlCommands, DrivetrainEffects, DrivetrainMotion, simulate_drivetrain
from osl_analysis.simulator.plan import Condition
from osl_analysis.simulator.platform import (
    PlatformMotion,
    displaced,
    nominal_ankle,
    perturbed_platform,
    pulse,
    resting_platform,
)
from osl_analysis.simulator.rigid_body import (
    GRAVITY,
    Pose,
    RigidBody,
    TrueWrench,
    interpolated_at,
    rotation_about,
    time_derivative,
)
from osl_analysis.simulator.step import (
    WINDOW_S,
    Step,
    ankle_path,
    foot_pitch,
    ground_reaction,
    nominal_ankle_angle,
    nominal_ankle_moment,
    smooth_step,
    stance_window,
)
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import AXES, Array

B_1_GRID = 50


@lru_cache(maxsize=32)
def compensated_damping(
    path: Path, K_d: float | None, B_d: float | None, p: DrivetrainParameters, weight: Weight
) -> tuple[Array, Array]:
    """A grid of phases, and B_1 [N*m*s/rad] (Eq. 14) at these. A grid is enough because B_1 is a smooth curve."""
    desired = Condition(K_d=K_d, B_d=B_d).desired(path)
    grid = np.linspace(0.0, 1.0, B_1_GRID + 1)
    stiffness, damping = desired.at(desired.K_d, grid), desired.at(desired.B_d, grid)
    # at() is periodic, so the grid's last point is its first
    check_request(stiffness, damping, p)
    B_1 = optimal_damping(stiffness[:-1], damping[:-1], p, weight).B_1
    return grid, np.array([*B_1, B_1[0]])


def walking_commands(
    step: Step, time: Array, walking: WalkingSettings, compensates: bool, p: DrivetrainParameters
) -> ControlCommands:
    """Commands to the actuator in a step, shape (updates of the controller,); `time` [s] is that of the motion. The
    equilibrium angle is chosen so that K_d and B_d give the step's ankle moment at the step's nominal angle."""
    stride, condition = walking.rates.motion_hz // walking.rates.controller_hz, step.condition
    c, desired = step.cycle_phase(time[::stride]), condition.desired(walking.impedance)
    K_d, B_d = desired.at(desired.K_d, c), desired.at(desired.B_d, c)
    if compensates:
        damping = compensated_damping(walking.impedance, condition.K_d, condition.B_d, p, walking.gain_weight.weight)
        K_1, B_1 = stiffness_gain(K_d, p), np.interp(np.mod(c, 1.0), *damping)
    else:
        K_1, B_1 = K_d / p.n_T**2, B_d / p.n_T**2
    moment = step.load * step.body_mass * nominal_ankle_moment(c) + step.torque_wander[::stride]
    if desired.theta_eq is not None:
        usual = step.body_mass * nominal_ankle_moment(c)
        theta_eq = desired.at(desired.theta_eq, c) - (moment - usual) / K_d
    else:
        angle = step.change.amplitude * nominal_ankle_angle(c)
        elastic = moment - B_d * time_derivative(angle, walking.rates.controller_hz)
        theta_eq = angle - elastic / K_d
    return ControlCommands(K_1, B_1, theta_eq * p.n_T, cancels_friction=compensates)


YIELD_S = 0.2
SLIP_S = 0.1
RELEASE_S = 0.3
ROLL_LEVER_M = 0.004
FREE_MOMENT = 0.03  # Largest free moment divided by body mass [N*m/kg]


@dataclass(frozen=True)
class LegMotion:
    """True motion of leg and platform. The poses of foot and shank have their origin at the ankle. theta [rad], omega
    [rad/s] and alpha [rad/s^2] are the joint's angle with its derivatives, shape (n,) each."""

    theta: Array
    omega: Array
    alpha: Array
    foot: Pose
    shank: Pose
    platform: PlatformMotion


@dataclass(frozen=True)
class SimulatedCrossing:
    """The truth about a crossing."""

    time: Array  # Time [s], shape (n,), at the rate of the motion
    step: Step  # What was drawn
    motion: LegMotion  # Motion of leg and platform
    commands: ControlCommands  # Commands to the leg's controller, at its own rate
    drivetrain: DrivetrainMotion  # Motion of the leg's drivetrain, at the controller's rate
    drivetrain_torque: Array  # Resisting torque [N*m] of the drivetrain, shape (n,)
    torque: Array
    """Resisting torque [N*m] of the joint, shape (n,): from 8 % to 92 % of stance that of the drivetrain, and in swing
    the torque that the swinging foot needs."""
    reaction: TrueWrench  # Ground reaction on the foot


def simulate_crossing(
    time: Array,
    step: Step,
    perturbed: bool,
    compensates: bool,
    walking: WalkingSettings,
    effects: DrivetrainEffects,
    p: DrivetrainParameters,
) -> SimulatedCrossing:
    """The crossing of one step, with or without the perturbation, on a regular grid at the motion's rate."""
    step = step.as_walked(perturbed)
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


def move(time: Array, step: Step, perturbed: bool, walking: WalkingSettings) -> LegMotion:
    """Prescribed motion: the nominal step, its random deviations, and the platform under the foot. The foot rotates
    with the platform. The shank rotates by the share `shank_yield` only, so that the ankle angle changes by the rest.
    In swing the foot returns from the platform's angle."""
    platform = perturbed_platform(time, step, walking) if perturbed else resting_platform(time)
    rate, c = walking.rates.motion_hz, step.cycle_phase(time)
    on_platform = 1.0 - smooth_step((time - step.toe_off) / RELEASE_S)
    carried, moved = platform.angle * on_platform, platform.shift * on_platform[:, None]
    theta = step.change.amplitude * step.angle_factor * nominal_ankle_angle(c) + step.wander + carried
    theta = theta - moved[:, 0] / walking.perturbation.leg_length_m
    path = ankle_path(c, walking.gait.stride_m)
    if platform.onset is not None:
        given = 0.01 * walking.effects.shank_yield.value * step.condition.sign
        given *= np.radians(walking.perturbation.angle_deg)
        theta = theta - given * pulse(time, platform.onset, YIELD_S, step.toe_off, RELEASE_S)
        slip = 1e-3 * walking.effects.foot_slip.value
        path[:, 0] -= slip * pulse(time, platform.onset, SLIP_S, step.toe_off, RELEASE_S)
    yaw = rotation_about(2, np.full_like(time, step.yaw))
    ankle = nominal_ankle(walking)
    flat = Pose(yaw @ rotation_about(1, -foot_pitch(c)), ankle + step.placement + path @ yaw[0].T)
    foot = displaced(carried, moved, walking).after(flat)
    shank = Pose(foot.rotation @ rotation_about(1, theta), foot.origin)
    omega = time_derivative(theta, rate)
    return LegMotion(theta, omega, time_derivative(omega, rate), foot, shank, platform)


def react(
    time: Array, step: Step, motion: LegMotion, answer: Array, walking: WalkingSettings
) -> tuple[Array, TrueWrench]:
    """The joint's torque [N*m], shape (n,), and the ground reaction at the ankle. About the ankle's axis u the foot
    needs the moment N = u . (dH/dt + r x m (a - g)). The shank applies +tau (toes down), and the ground applies the
    rest, N - tau. The part of the ground decreases with its force at the beginning and end of stance. Across the axis
    the ground's moments are small, and the hinge carries the rest."""
    foot, mass = motion.foot, step.body_mass
    forward, axis, upward = (foot.rotation[:, :, i] for i in range(3))
    body = RigidBody(
        walking.effects.foot_inertia.value, np.array(walking.foot.centre_of_mass_m), np.array(walking.foot.gyration_m)
    )
    needed = body.support(foot, walking.rates.motion_hz).moment_about(foot.origin)
    about_axis = np.einsum("ni,ni->n", needed, axis)
    phase = step.stance_phase(time)
    contact = stance_window(phase)
    given = contact * (about_axis - answer)
    force = step.load * step.force_factor * ground_reaction(phase) * mass * -GRAVITY[2]
    roll = ROLL_LEVER_M * force[:, 2]
    spin = FREE_MOMENT * mass * contact * np.sin(2 * np.pi * phase)
    moment = given[:, None] * axis + roll[:, None] * forward + spin[:, None] * upward
    return about_axis - given, TrueWrench(force, moment, foot.origin)


def rendered_impedance(perturbed: SimulatedCrossing, unperturbed: SimulatedCrossing) -> dict[str, float]:
    """K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of the drivetrain's response to the perturbation. Least squares of
    d_torque = K d_theta + B d_omega + I d_alpha without intercept, over the 100 ms after the onset. Both crossings are
    identical before the onset, so that the differences are exactly zero there."""
    onset = perturbed.motion.platform.onset
    if onset is None:
        return {}
    rows = (perturbed.time >= onset) & (perturbed.time <= onset + WINDOW_S)
    new, old = perturbed.motion, unperturbed.motion
    columns = np.stack([new.theta - old.theta, new.omega - old.omega, new.alpha - old.alpha], axis=-1)[rows]
    answer = (perturbed.drivetrain_torque - unperturbed.drivetrain_torque)[rows]
    K, B, inertia = np.linalg.lstsq(columns, answer, rcond=None)[0]
    return {"K_rendered": float(K), "B_rendered": float(B), "I_rendered": float(inertia)}


def crossing_curves(
    crossing: SimulatedCrossing, unperturbed: SimulatedCrossing, walking: WalkingSettings
) -> dict[str, Array]:
    """Exact curves in SI units, shape (n,) each, laboratory axes. force and moment: ground reaction on the foot, the
    moment about the centre of the plate's surface where the platform has carried it (`plate_centre`); axis: the
    ankle's, through `ankle`; foot_moment: what the foot's weight and inertia demand about it, so that torque =
    foot_moment - axis . (moment + (plate_centre - ankle) x force)."""
    motion, desired = crossing.motion, crossing.step.condition.desired(walking.impedance)
    phase = crossing.step.cycle_phase(crossing.time)
    centre = motion.platform.pose.point(np.array(walking.plate.centre_m))
    axis = motion.foot.rotation[:, :, 1]
    ground = np.einsum("ni,ni->n", crossing.reaction.moment, axis)
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
        "foot_moment": crossing.torque + ground,
    }
    curves |= components("ankle", motion.foot.origin) | components("axis", axis) | components("plate_centre", centre)
    curves |= components("force", crossing.reaction.force)
    return curves | components("moment", crossing.reaction.moment_about(centre))


def platform_curves(time: Array, platform: PlatformMotion, walking: WalkingSettings) -> dict[str, Array]:
    """Exact curves of a platform without a foot: its angle [rad] and the centre of the plate's surface [m]."""
    centre = platform.pose.point(np.array(walking.plate.centre_m))
    return {"time": time, "platform_angle": platform.angle} | components("plate_centre", centre)


def components(name: str, vectors: Array) -> dict[str, Array]:
    """Columns name_x, name_y, name_z of vectors, shape (n, 3)."""
    return {f"{name}_{axis}": vectors[:, i] for i, axis in enumerate(AXES)}
