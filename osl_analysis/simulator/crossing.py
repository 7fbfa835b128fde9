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
    nominal_ankle,
    perturbed_platform,
    pulse,
    resting_platform,
    turned_about,
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
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

YIELD_S = 0.2
SLIP_S = 0.1
RELEASE_S = 0.3
WANDER_HZ = (0.3, 4.0)
WANDER_WAVES = 6
ROLL_LEVER_M = 0.004
FREE_MOMENT = 0.03
"""Largest free moment divided by body mass [N*m/kg]."""


@dataclass(frozen=True)
class Step:
    """Random quantities of one crossing, the same with and without the perturbation."""

    heel_strike: float
    """Time [s] of heel strike."""
    stance: float
    """Duration [s] of stance."""
    command: float
    """Time [s] at which the perturbation is commanded."""
    angle_factor: float
    """Factor of the ankle's angle."""
    wander: Array
    """Smooth deviation [rad] of the ankle's angle, shape (n,)."""
    force_factor: Array
    """Factor of each component of the ground reaction, shape (3,)."""
    placement: Array
    """Deviation [m] of the foot's place forward, to the left and up, shape (3,)."""
    yaw: float
    """Direction [rad] of the foot, to the left."""

    @property
    def toe_off(self) -> float:
        """Time [s] at which the foot leaves the platform."""
        return self.heel_strike + self.stance

    @property
    def cycle(self) -> float:
        """Duration [s] of the gait cycle."""
        return self.stance / gait.STANCE_FRACTION

    def stance_phase(self, time: Array) -> Array:
        """Phase of stance at times [s]: 0 at heel strike, 1 at toe-off. The perturbation does not change it."""
        return (time - self.heel_strike) / self.stance

    def cycle_phase(self, time: Array) -> Array:
        """Phase of the gait cycle at times [s]: 0 at the heel strike on the platform, 1 at the next."""
        return (time - self.heel_strike) / self.cycle


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


def draw_step(trial: str, seed: int, time: Array, walking: WalkingSettings) -> Step:
    """Draw a crossing. Each effect has its own random stream."""
    effects, nominal = walking.effects, walking.gait

    def normal(effect: str, unit: float = 1.0) -> float:
        """A normal deviate with the effect's standard deviation, in SI units."""
        return unit * float(getattr(effects, effect).value * stream(seed, trial, effect).standard_normal())

    stance = nominal.stance_s * (1 + normal("stance_scatter", 0.01))
    heel_strike = nominal.heel_strike_s + normal("heel_strike_scatter")
    phase = stream(seed, trial, "perturbation_phase").uniform(*walking.perturbation.stance_phase)
    force = stream(seed, trial, "force_scale").standard_normal(3)
    return Step(
        heel_strike=heel_strike,
        stance=stance,
        command=heel_strike + phase * stance,
        angle_factor=1 + normal("angle_scale", 0.01),
        wander=np.radians(effects.angle_wander.value) * wandering(stream(seed, trial, "angle_wander"), time),
        force_factor=1 + 0.01 * effects.force_scale.value * force,
        placement=np.array([normal("placement_forward", 1e-3), normal("placement_sideways", 1e-3), 0.0]),
        yaw=normal("foot_yaw", np.pi / 180),
    )


def wandering(random: np.random.Generator, time: Array) -> Array:
    """A smooth deviation of unit standard deviation, shape (n,): slow waves of random size, frequency and phase."""
    sizes = random.standard_normal(WANDER_WAVES) * np.sqrt(2 / WANDER_WAVES)
    pitches, phases = random.uniform(*WANDER_HZ, WANDER_WAVES), random.uniform(0, 2 * np.pi, WANDER_WAVES)
    return np.asarray(np.cos(2 * np.pi * np.outer(time, pitches) + phases) @ sizes)


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
    motion = move(time, step, perturbed, walking)
    stride = walking.rates.motion_hz // walking.rates.controller_hz
    phase = step.cycle_phase(time[::stride])
    commands = walking_commands(phase, step.cycle, walking.gait.body_mass_kg, walking.impedance, compensates, p)
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
    platform = perturbed_platform(time, step.command, step.toe_off, walking) if perturbed else resting_platform(time)
    rate, c = walking.rates.motion_hz, step.cycle_phase(time)
    on_platform = 1.0 - gait.smooth_step((time - step.toe_off) / RELEASE_S)
    carried = platform.angle * on_platform
    theta = step.angle_factor * gait.nominal_ankle_angle(c) + step.wander + carried
    path = gait.ankle_path(c, walking.gait.stride_m)
    if platform.onset is not None:
        given = 0.01 * walking.effects.shank_yield.value * np.radians(walking.perturbation.angle_deg)
        theta = theta - given * pulse(time, platform.onset, YIELD_S, step.toe_off, RELEASE_S)
        slip = 1e-3 * walking.effects.foot_slip.value
        path[:, 0] -= slip * pulse(time, platform.onset, SLIP_S, step.toe_off, RELEASE_S)
    yaw = rotation_about(2, np.full_like(time, step.yaw))
    ankle = nominal_ankle(walking)
    flat = Pose(yaw @ rotation_about(1, -gait.foot_pitch(c)), ankle + step.placement + path @ yaw[0].T)
    foot = turned_about(ankle, carried).after(flat)
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
    foot, mass = motion.foot, walking.gait.body_mass_kg
    forward, axis, upward = (foot.rotation[:, :, i] for i in range(3))
    body = RigidBody(
        walking.effects.foot_inertia.value, np.array(walking.foot.centre_of_mass_m), np.array(walking.foot.gyration_m)
    )
    needed = body.support(foot, walking.rates.motion_hz).moment_about(foot.origin)
    about_axis = np.einsum("ni,ni->n", needed, axis)
    phase = step.stance_phase(time)
    contact = gait.stance_window(phase)
    given = contact * (about_axis - answer)
    force = step.force_factor * gait.ground_reaction(phase) * mass * -GRAVITY[2]
    roll = ROLL_LEVER_M * force[:, 2]
    spin = FREE_MOMENT * mass * contact * np.sin(2 * np.pi * phase)
    moment = given[:, None] * axis + roll[:, None] * forward + spin[:, None] * upward
    return about_axis - given, TrueWrench(force, moment, foot.origin)
