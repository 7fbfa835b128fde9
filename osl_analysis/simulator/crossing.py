"""One crossing of the walkway as rigid-body mechanics: foot, shank and platform, ankle torque, ground reaction.

The foot's path and the ankle's angle are prescribed. The drivetrain's torque is simulated for this motion. The moment
of the ground reaction about the ankle follows from the equations of Newton and Euler for the foot. Axes: x forward, y
left, z up, in metres.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator import gait
from osl_analysis.simulator.drivetrain_sim import (
    ControlCommands,
    DrivetrainEffects,
    DrivetrainMotion,
    simulate_drivetrain,
)
from osl_analysis.simulator.leg_controller import walking_commands
from osl_analysis.simulator.platform_motion import (
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
from osl_analysis.simulator.step import Step
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

YIELD_S = 0.2
SLIP_S = 0.1
RELEASE_S = 0.3
ROLL_LEVER_M = 0.004
FREE_MOMENT = 0.03
"""Largest free moment divided by body mass [N*m/kg]."""


@dataclass(frozen=True)
class LegMotion:
    """True motion of leg and platform. The poses of foot and shank have their origin at the ankle.

    theta [rad], omega [rad/s] and alpha [rad/s^2] are the joint's angle with its derivatives, shape (n,) each.
    """

    theta: Array
    omega: Array
    alpha: Array
    foot: Pose
    shank: Pose
    platform: PlatformMotion


@dataclass(frozen=True)
class SimulatedCrossing:
    """The truth about a crossing."""

    time: Array
    """Time [s], shape (n,), at the rate of the motion."""
    step: Step
    """What was drawn."""
    motion: LegMotion
    """Motion of leg and platform."""
    commands: ControlCommands
    """Commands to the leg's controller, at its own rate."""
    drivetrain: DrivetrainMotion
    """Motion of the leg's drivetrain, at the controller's rate."""
    drivetrain_torque: Array
    """Resisting torque [N*m] of the drivetrain, shape (n,)."""
    torque: Array
    """Resisting torque [N*m] of the joint, shape (n,): from 8 % to 92 % of stance that of the drivetrain, and in swing
    the torque that the swinging foot needs."""
    reaction: TrueWrench
    """Ground reaction on the foot."""


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
    """Prescribed motion: the nominal step, its random deviations, and the platform under the foot.

    The foot rotates with the platform. The shank rotates by the share `shank_yield` only, so that the ankle angle
    changes by the rest. In swing the foot returns from the platform's angle.
    """
    platform = perturbed_platform(time, step, walking) if perturbed else resting_platform(time)
    rate, c = walking.rates.motion_hz, step.cycle_phase(time)
    on_platform = 1.0 - gait.smooth_step((time - step.toe_off) / RELEASE_S)
    carried, moved = platform.angle * on_platform, platform.shift * on_platform[:, None]
    theta = step.change.amplitude * step.angle_factor * gait.nominal_ankle_angle(c) + step.wander + carried
    theta = theta - moved[:, 0] / walking.perturbation.leg_length_m
    path = gait.ankle_path(c, walking.gait.stride_m)
    if platform.onset is not None:
        given = 0.01 * walking.effects.shank_yield.value * step.condition.sign
        given *= np.radians(walking.perturbation.angle_deg)
        theta = theta - given * pulse(time, platform.onset, YIELD_S, step.toe_off, RELEASE_S)
        slip = 1e-3 * walking.effects.foot_slip.value
        path[:, 0] -= slip * pulse(time, platform.onset, SLIP_S, step.toe_off, RELEASE_S)
    yaw = rotation_about(2, np.full_like(time, step.yaw))
    ankle = nominal_ankle(walking)
    flat = Pose(yaw @ rotation_about(1, -gait.foot_pitch(c)), ankle + step.placement + path @ yaw[0].T)
    foot = displaced(carried, moved, walking).after(flat)
    shank = Pose(foot.rotation @ rotation_about(1, theta), foot.origin)
    omega = time_derivative(theta, rate)
    return LegMotion(theta, omega, time_derivative(omega, rate), foot, shank, platform)


def react(
    time: Array, step: Step, motion: LegMotion, answer: Array, walking: WalkingSettings
) -> tuple[Array, TrueWrench]:
    """The joint's torque [N*m], shape (n,), and the ground reaction at the ankle.

    About the ankle's axis u the foot needs the moment N = u . (dH/dt + r x m (a - g)). The shank applies +tau (toes
    down), and the ground applies the rest, N - tau. The part of the ground decreases with its force at the beginning
    and end of stance. Across the axis the ground's moments are small, and the hinge carries the rest.
    """
    foot, mass = motion.foot, step.body_mass
    forward, axis, upward = (foot.rotation[:, :, i] for i in range(3))
    body = RigidBody(
        walking.effects.foot_inertia.value, np.array(walking.foot.centre_of_mass_m), np.array(walking.foot.gyration_m)
    )
    needed = body.support(foot, walking.rates.motion_hz).moment_about(foot.origin)
    about_axis = np.einsum("ni,ni->n", needed, axis)
    phase = step.stance_phase(time)
    contact = gait.stance_window(phase)
    given = contact * (about_axis - answer)
    force = step.load * step.force_factor * gait.ground_reaction(phase) * mass * -GRAVITY[2]
    roll = ROLL_LEVER_M * force[:, 2]
    spin = FREE_MOMENT * mass * contact * np.sin(2 * np.pi * phase)
    moment = given[:, None] * axis + roll[:, None] * forward + spin[:, None] * upward
    return about_axis - given, TrueWrench(force, moment, foot.origin)
