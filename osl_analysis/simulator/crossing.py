"""One crossing of the walkway as rigid-body mechanics: foot, shank and platform, ankle torque, ground reaction.

The foot's path and the ankle's angle are prescribed; the drivetrain answers with a torque, and the ground reaction's
moment about the ankle is what Newton and Euler then demand of the foot. Axes: x forward, y left, z up, metres.
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
"""Largest free moment over body mass [N*m/kg]."""


@dataclass(frozen=True)
class Step:
    """What is drawn for one crossing, whether it is perturbed or not.

    Times [s]: heel strike, duration of stance, command of the perturbation. Angle: factor and deviation [rad],
    shape (n,). Factor of each force component, shape (3,). Placement [m] forward and left, and yaw [rad] to the left.
    """

    heel_strike: float
    stance: float
    command: float
    angle_factor: float
    wander: Array
    force_factor: Array
    placement: Array
    yaw: float

    @property
    def toe_off(self) -> float:
        """Time [s] at which the foot leaves the platform."""
        return self.heel_strike + self.stance

    @property
    def cycle(self) -> float:
        """Duration [s] of the gait cycle."""
        return self.stance / gait.STANCE_FRACTION

    def stance_phase(self, time: Array) -> Array:
        """0 at heel strike, 1 at toe-off, at times [s]; the perturbation does not touch it."""
        return (time - self.heel_strike) / self.stance

    def cycle_phase(self, time: Array) -> Array:
        """0 at the heel strike on the platform, 1 at the next, at times [s]."""
        return (time - self.heel_strike) / self.cycle


@dataclass(frozen=True)
class LegMotion:
    """Joint angle [rad] with both derivatives, shape (n,), and the poses of foot and shank, origin at the ankle."""

    theta: Array
    omega: Array
    alpha: Array
    foot: Pose
    shank: Pose
    platform: PlatformMotion


@dataclass(frozen=True)
class SimulatedCrossing:
    """A crossing on the grid of `time` [s], shape (n,).

    `torque` [N*m] is the joint's resisting torque; while 8 % to 92 % of stance it is the drivetrain's
    (`drivetrain_torque`), outside it goes over to what the swinging foot needs. `reaction` acts on the foot.
    `drivetrain` and `commands` are at the controller's rate.
    """

    time: Array
    step: Step
    motion: LegMotion
    commands: ControlCommands
    drivetrain: DrivetrainMotion
    drivetrain_torque: Array
    torque: Array
    reaction: TrueWrench


def draw_step(trial: str, seed: int, time: Array, walking: WalkingSettings) -> Step:
    """Draw a crossing; each effect has a random stream of its own."""
    effects, nominal = walking.effects, walking.gait

    def normal(effect: str, unit: float = 1.0) -> float:
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
    """A smooth deviation of unit standard deviation, shape (n,): a few slow waves of random size, pitch and phase."""
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
    """Prescribed motion: the nominal step, what was drawn, and the platform under the foot.

    The shank, which carries the body, hardly follows the platform: the ankle takes up the rotation but for the
    share that the shank yields. In swing the foot lets go of the platform's angle.
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

    About the ankle's axis u the foot needs the moment N = u . (dH/dt + r x m (a - g)); the shank gives it +tau
    (toes down), the ground the rest, N - tau. As the foot is set down and lifted the ground's share fades with its
    force. Across the axis the ground's moments are small and the hinge carries what is missing.
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
