# SPDX-License-Identifier: Apache-2.0
"""A crossing of the gait laboratory in rigid-body mechanics.

The foot's path and the ankle's angle are prescribed. The drivetrain's torque is simulated for this
motion and the commands of the leg's controller. The moment of the ground reaction about the ankle
follows from the equations of Newton and Euler for the foot. Axes: x forward, y left, z up, in
metres.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from osl_analysis.base.trial import Array
from osl_analysis.config.impedance_trajectory import STANCE_SHARE, read_impedance_trajectory
from osl_analysis.model.compensator import Weight, optimal_damping, stiffness_gain
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.bench_trial import JointMotion
from osl_analysis.simulator.laboratory_settings import ANKLE_MOMENT, NOMINAL
from osl_analysis.simulator.rigid_body import (
    GRAVITY,
    Pose,
    TrueWrench,
    interpolated_at,
    rotation_about,
    support,
    time_derivative,
)
from osl_analysis.simulator.two_mass_drivetrain import simulate_drivetrain

DAMPING_PHASES = 51  # of the grid on which B_1 is computed; B_1 is a smooth curve between


@cache
def compensated_damping(path: Path, p: DrivetrainParameters, weight: Weight) -> tuple[Array, Array]:
    """A grid of phases, and B_1 [N*m*s/rad] (Eq. 14) at these, for the desired impedance of a
    file."""
    desired = read_impedance_trajectory(path)
    grid = np.linspace(0.0, 1.0, DAMPING_PHASES)
    K_d = desired.at(desired.K_d, grid[:-1])
    B_d = desired.at(desired.B_d, grid[:-1])
    pairs = zip(K_d.tolist(), B_d.tolist(), strict=True)
    B_1 = [optimal_damping(*pair, p, weight).B_1 for pair in pairs]
    return grid, np.array([*B_1, B_1[0]])  # at() is periodic


def walking_commands(step: gait.Step, p: DrivetrainParameters) -> Array:
    """Find the commands of the controller, which compensates (Eqs. 13-14), in a step.

    Parameters
    ----------
    step : gait.Step
    p : DrivetrainParameters

    Returns
    -------
    Array
        (3, n) as `simulate_drivetrain` takes them, at the rate of the controller. K_d and B_d give
        the nominal ankle moment at the nominal angle.
    """
    walking = step.trial.walking
    stride = walking.rates.motion_hz // walking.rates.controller_hz
    c = step.cycle_phase(step.trial.time[::stride])
    desired = read_impedance_trajectory(walking.impedance)
    K_d = desired.at(desired.K_d, c)
    B_d = desired.at(desired.B_d, c)
    grid, damping = compensated_damping(walking.impedance, p, walking.gain_weight)
    K_1 = stiffness_gain(K_d, p)
    B_1 = np.interp(np.mod(c, 1.0), grid, damping)
    window = gait.stance_window(np.mod(c, 1.0) / STANCE_SHARE)
    moment = walking.gait.body_mass_kg * (gait.periodic_bumps(c, ANKLE_MOMENT) * window)
    angle = gait.nominal_ankle_angle(c)
    velocity = time_derivative(angle, walking.rates.controller_hz)
    theta_eq = angle - (moment - B_d * velocity) / K_d
    return np.array([K_1, B_1, theta_eq * p.n_T])


@dataclass(frozen=True)
class SimulatedCrossing:
    """The truth about a crossing, at the rate of the motion. Commands and drivetrain are at the
    rate of the leg's controller."""

    time: Array  # (n,) [s]
    step: gait.Step
    motion: JointMotion  # of the ankle
    # the poses of foot and shank have their origin at the ankle
    foot: Pose
    shank: Pose
    platform: gait.PlatformMotion
    commands: Array  # (3, m) as `simulate_drivetrain` takes them
    drivetrain: Mapping[str, Array]  # (m,) each, as `simulate_drivetrain` gives it
    drivetrain_torque: Array  # resisting torque (n,) [N*m] of the drivetrain
    # resisting torque (n,) [N*m] of the joint: from 8 % to 92 % of stance the drivetrain's, in
    # swing the foot's
    torque: Array
    reaction: TrueWrench  # ground reaction on the foot


def simulate_crossing(
    step: gait.Step, perturbed: bool, effects: Mapping[str, float], p: DrivetrainParameters
) -> SimulatedCrossing:
    """Simulate the crossing of one step.

    Parameters
    ----------
    step : gait.Step
    perturbed : bool
        Whether the platform moves.
    effects : Mapping
        As `simulate_drivetrain` takes them.
    p : DrivetrainParameters
    """
    rates = step.trial.walking.rates
    time = step.trial.time
    ankle, foot, shank, platform = move(step, perturbed)
    commands = walking_commands(step, p)
    stride = rates.motion_hz // rates.controller_hz
    theta = ankle.theta[::stride]
    omega = ankle.omega[::stride]

    K_1, _, theta_eq = commands[:, 0]
    rest_angle = (K_1 * theta_eq + p.K_s * theta[0] / p.n_T) / (K_1 + p.K_s_at_actuator)
    drivetrain = simulate_drivetrain(
        rates.controller_hz, theta, omega, commands, effects, p, rest_angle
    )
    belt_torque = interpolated_at(drivetrain["belt_torque"], rates.controller_hz, time)
    drivetrain_torque = belt_torque + p.B_j * ankle.omega + p.J_j * ankle.alpha
    torque, reaction = react(step, foot, drivetrain_torque)
    return SimulatedCrossing(
        time=time,
        step=step,
        motion=ankle,
        foot=foot,
        shank=shank,
        platform=platform,
        commands=commands,
        drivetrain=drivetrain,
        drivetrain_torque=drivetrain_torque,
        torque=torque,
        reaction=reaction,
    )


def move(step: gait.Step, perturbed: bool) -> tuple[JointMotion, Pose, Pose, gait.PlatformMotion]:
    """Prescribe the motion of ankle, foot, shank and platform.

    The foot rotates with the platform, and the shank by the share `shank_yield` only, so that the
    ankle angle changes by the rest. In swing the foot returns.
    """
    trial = step.trial
    walking = trial.walking
    time = trial.time
    platform = gait.resting_platform(trial)
    if perturbed:
        back = step.toe_off + walking.perturbation.hold_s
        platform = gait.ramped_platform(trial, step.command, step.onset, back)
    on_platform = 1.0 - gait.smooth_step((time - step.toe_off) / NOMINAL.release_s)
    carried_angle = platform.angle * on_platform

    theta = measured_ankle_angle(step, carried_angle, platform)
    omega = time_derivative(theta, walking.rates.motion_hz)
    alpha = time_derivative(omega, walking.rates.motion_hz)

    path, pitch = gait.foot_path(step.cycle_phase(time), walking.gait.stride_m)
    yaw = rotation_about(2, np.full_like(time, trial.normal("foot_yaw", np.pi / 180)))
    ankle = gait.nominal_ankle(walking) + step.placement + path @ yaw[0].T
    foot_on_floor = Pose(yaw @ rotation_about(1, -pitch), ankle)
    foot = gait.turned(carried_angle, walking).after(foot_on_floor)
    shank = Pose(foot.rotation @ rotation_about(1, theta), foot.origin)
    return JointMotion(theta, omega, alpha), foot, shank, platform


def measured_ankle_angle(
    step: gait.Step, carried_angle: Array, platform: gait.PlatformMotion
) -> Array:
    """Angle (n,) [rad] of the ankle: the nominal one with its variations, and the angle (n,) [rad]
    in which the platform carries the foot."""
    trial = step.trial
    effects = trial.walking.effects
    wander = np.radians(effects.angle_wander.value) * trial.wandering()
    factor = 1 + trial.normal("angle_scale", 0.01)
    nominal = gait.nominal_ankle_angle(step.cycle_phase(trial.time))
    theta = factor * nominal + wander + carried_angle
    if platform.onset is None:
        return np.asarray(theta)
    share = 0.01 * effects.shank_yield.value
    turn = np.radians(trial.walking.perturbation.angle_deg)
    yielded = share * turn
    course = gait.pulse(
        trial.time, platform.onset, NOMINAL.yield_s, step.toe_off, NOMINAL.release_s
    )
    return theta - yielded * course


def react(step: gait.Step, foot: Pose, drivetrain_torque: Array) -> tuple[Array, TrueWrench]:
    """Find the joint's torque and the ground reaction.

    Parameters
    ----------
    step : gait.Step
    foot : Pose
    drivetrain_torque : Array
        Resisting torque (n,) [N*m] of the drivetrain.

    Returns
    -------
    torque : Array
        Resisting torque (n,) [N*m] of the joint.
    reaction : TrueWrench
        At the ankle.

    Notes
    -----
    About the ankle's axis u the foot needs the moment N = u . (dH/dt + r x m (a - g)). The shank
    applies +tau (toes down), the ground the rest, N - tau, less at both ends of stance. Across the
    axis the ground's moments are small, and the hinge carries the rest.
    """
    trial = step.trial
    effects = trial.walking.effects
    body = trial.walking.foot
    forward, axis, upward = np.moveaxis(foot.rotation, 2, 0)
    needed = support(
        foot,
        trial.walking.rates.motion_hz,
        effects.foot_inertia.value,
        body.centre_of_mass_m,
        body.gyration_m,
    ).moment_about(foot.origin)
    about_axis = np.einsum("ni,ni->n", needed, axis)

    phase = step.stance_phase(trial.time)
    contact = gait.stance_window(phase)
    from_ground = contact * (about_axis - drivetrain_torque)
    scale = 1 + 0.01 * effects.force_scale.value * trial.random("force_scale").standard_normal(3)
    body_mass = trial.walking.gait.body_mass_kg
    force = scale * gait.ground_reaction(phase) * body_mass * -GRAVITY[2]
    roll = NOMINAL.roll_lever * force[:, 2]
    spin = NOMINAL.spin_moment * body_mass * contact * np.sin(2 * np.pi * phase)
    moment = from_ground[:, None] * axis + roll[:, None] * forward + spin[:, None] * upward
    return about_axis - from_ground, TrueWrench(force, moment, foot.origin)


def impedance_of_leg(
    perturbed: SimulatedCrossing, unperturbed: SimulatedCrossing
) -> dict[str, float]:
    """Find K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of the drivetrain's response to the
    perturbation over the 100 ms after the onset; empty if the platform rests.

    It is by least squares without intercept: before the onset both crossings are identical.
    """
    onset = perturbed.platform.onset
    if onset is None:
        return {}
    rows = (perturbed.time >= onset) & (perturbed.time <= onset + gait.RENDERED_S)
    with_turn = perturbed.motion
    without = unperturbed.motion
    columns = np.column_stack(
        [
            with_turn.theta - without.theta,
            with_turn.omega - without.omega,
            with_turn.alpha - without.alpha,
        ]
    )
    torque = perturbed.drivetrain_torque - unperturbed.drivetrain_torque
    K, B, I = np.linalg.lstsq(columns[rows], torque[rows])[0]
    return {"K_rendered": float(K), "B_rendered": float(B), "I_rendered": float(I)}


def leg_clock(trial: gait.GaitTrial) -> tuple[float, float]:
    """Offset [s] and drift of the leg's clock, whose time is offset + (1 + drift) times Vicon's."""
    usual_offset = trial.walking.effects.leg_clock_offset.value
    offset = usual_offset * trial.random("leg_clock_offset").uniform(0.5, 1.5)
    return offset, trial.normal("leg_clock_drift", 1e-6)
