"""The two-mass drivetrain in time: prescribed joint motion, actuator with friction, sampled controller.

Between two samples of the controller the actuator is integrated in `substeps` fine steps by the second-order
Stoermer-Verlet scheme (half drift, kick, half drift): J_m domega_m/dt = k_tau n_m I_q - f - B_m omega_m + tau_s/n_T,
where tau_s is the belt's torque at theta_s = theta - theta_m/n_T. Friction enters the kick implicitly with the true
sign of the velocity. The actuator therefore sticks exactly, for any step.

In its place a trial may have a joint of Eq. 15, or a passive foot.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import InputError
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.kernel import Controller, Plant, belt_path, integrate, torque_through_gap
from osl_analysis.simulator.settings import PassiveFoot, SecondOrderJoint, SlippingSpring
from osl_analysis.trial import Array

LARGEST_ANGLE = 100.0  # Largest angle [rad] of the actuator's output, 16 turns. Beyond it the control loop is unstable


@dataclass(frozen=True)
class ControlCommands:
    """Commands to the controller at each of its n samples, at the *actuator's* output, or for all of them: (1,)."""

    K_1: Array  # Stiffness gain [N*m/rad], shape (n,) or (1,)
    B_1: Array  # Damping gain [N*m*s/rad], shape as of K_1
    theta_eq: Array  # Equilibrium angle [rad], shape as of K_1
    cancels_friction: bool  # Whether the controller adds the friction term of Eq. 5


@dataclass(frozen=True)
class DrivetrainEffects:
    """The difference between the simulated drivetrain with its controller and the linear model."""

    friction: bool  # Whether there is friction. Without it the controller cancels none, and the loop is linear
    control_delay: int  # Delay from a measurement to the current computed from it [updates of the controller]
    encoder_resolution: float  # Resolution [rad] of the encoder at the actuator's output. 0: an ideal encoder
    velocity_cutoff_hz: float | None
    """Cut-off [Hz] of the one-pole low-pass over the differentiated encoder. None: the true velocity."""
    sign_width: float  # Velocity [rad/s] over which the controller smooths its sign
    hysteresis_torque: float  # Largest rate-independent torque [N*m] of the belt
    hysteresis_width: float  # Deflection [rad] over which the hysteresis torque changes sign after a reversal
    friction_scale: float = 1.0
    """Ratio of the true friction to the friction of the parameters, which the controller cancels."""
    substeps: int = 20  # Integration steps per sample
    control_updates: int = 1
    """Updates of the controller per sample. The current is held between updates. A value equal to `substeps` gives the
    continuous controller of linear theory."""

    def __post_init__(self) -> None:
        if self.control_updates < 1 or self.substeps % self.control_updates:
            raise InputError(
                f"{self.control_updates} updates of the controller do not fit evenly into {self.substeps} fine steps; "
                "choose a divisor"
            )


IDEAL = DrivetrainEffects(
    friction=False,
    control_delay=0,
    encoder_resolution=0.0,
    velocity_cutoff_hz=None,
    sign_width=0.1,
    hysteresis_torque=0.0,
    hysteresis_width=1e-3,
)


@dataclass(frozen=True)
class DrivetrainMotion:
    """True values at the samples, shape (n,): theta_m [rad], omega_m [rad/s], current [A], belt torque [N*m]. The
    current is the one applied from that sample on; the belt torque contains its hysteresis."""

    theta_m: Array
    omega_m: Array
    current: Array
    belt_torque: Array


def simulate_drivetrain(
    rate_hz: float,
    theta: Array,
    omega: Array,
    commands: ControlCommands,
    effects: DrivetrainEffects,
    p: DrivetrainParameters,
    theta_m_start: float = 0.0,
) -> DrivetrainMotion:
    """Motion of the actuator under a prescribed joint motion, from rest at `theta_m_start` [rad].

    theta [rad] and omega [rad/s], shape (n,), are sampled at `rate_hz` [Hz]. omega must be the exact derivative of
    theta, because the motion is interpolated by cubic Hermite polynomials.
    """
    columns = np.empty((4, len(theta)))
    gains = np.vstack([commands.K_1, commands.B_1, commands.theta_eq]).astype(float)
    plant, controller = build_plant(rate_hz, effects, p), build_controller(rate_hz, commands, effects, p)
    theta, omega = np.ascontiguousarray(theta, dtype=float), np.ascontiguousarray(omega, dtype=float)
    integrate(theta, omega, gains, float(theta_m_start), plant, controller, columns)
    if not np.abs(columns[0]).max(initial=0.0) <= LARGEST_ANGLE:  # NaN is none either
        raise InputError(
            f"the simulated actuator runs away, beyond {LARGEST_ANGLE:g} rad: its loop is unstable with K_1 up to "
            f"{np.max(commands.K_1):.4g} N*m/rad, B_1 down to {np.min(commands.B_1):.4g} N*m*s/rad; lower "
            "effects.control_delay, raise effects.velocity_filter or control_updates, or ask for more damping"
        )
    return DrivetrainMotion(*columns)


def simulate_belt_torque(theta_s: Array, effects: DrivetrainEffects, p: DrivetrainParameters) -> Array:
    """Torque [N*m] of the belt along a path of deflections theta_s [rad], shape (n,), with hysteresis."""
    return belt_path(np.ascontiguousarray(theta_s, dtype=float), build_plant(1.0, effects, p))


def build_plant(rate_hz: float, effects: DrivetrainEffects, p: DrivetrainParameters) -> Plant:
    """The drivetrain in the form of the compiled kernel. The actuator's damping is trapezoidal."""
    scale = effects.friction_scale if effects.friction else 0.0
    inertia, half_damping = p.J_m * rate_hz * effects.substeps, 0.5 * p.B_m
    return Plant(
        step=1.0 / (rate_hz * effects.substeps),
        substeps=effects.substeps,
        kept=(inertia - half_damping) / (inertia + half_damping),
        mobility=1.0 / (inertia + half_damping),
        n_T=p.n_T,
        K_s=p.K_s,
        K_s2=p.K_s2,
        torque_constant=p.k_tau * p.n_m,
        f_C=scale * p.f_C,
        f_G=scale * p.f_G,
        hysteresis_torque=effects.hysteresis_torque,
        hysteresis_width=effects.hysteresis_width,
    )


def build_controller(
    rate_hz: float, commands: ControlCommands, effects: DrivetrainEffects, p: DrivetrainParameters
) -> Controller:
    """The controller in the form of the compiled kernel, at the rate of its updates."""
    rate, cutoff = float(rate_hz * effects.control_updates), effects.velocity_cutoff_hz
    return Controller(
        every=effects.substeps // effects.control_updates,
        updates_per_second=rate,
        delay=effects.control_delay,
        resolution=effects.encoder_resolution,
        smoothing=0.0 if cutoff is None else float(-np.expm1(-2 * np.pi * cutoff / rate)),
        sign_width=effects.sign_width,
        cancels_friction=commands.cancels_friction,
        torque_constant=p.k_tau * p.n_m,
        f_C=p.f_C if effects.friction else 0.0,
        f_G=p.f_G if effects.friction else 0.0,
    )


SIGN_WIDTH = 1e-3  # Velocity [rad/s] over which Coulomb friction changes its sign, a hundredth of a slow sine's largest
GAP_SUBSTEPS = 20  # Integration steps per sample for a joint with backlash


def second_order_torque(joint: SecondOrderJoint, motion: JointMotion, rate_hz: float) -> Array:
    """Resisting torque [N*m] of the joint, shape (n,), where the bench makes `motion`."""
    theta, omega, alpha = motion.theta, motion.omega, motion.alpha
    if joint.backlash.value:
        angle, velocity, acceleration = (np.ascontiguousarray(x, dtype=float) for x in (theta, omega, alpha))
        K_B_I, gap = (joint.K, joint.B, joint.I), joint.backlash.value
        linear = torque_through_gap(angle, velocity, acceleration, K_B_I, gap, 1 / rate_hz, GAP_SUBSTEPS)
    else:
        linear = joint.K * theta + joint.B * omega + joint.I * alpha
    return linear + joint.K * joint.stiffening.value * theta**3 + joint.coulomb.value * np.tanh(omega / SIGN_WIDTH)


def foot_torque(foot: PassiveFoot, motion: JointMotion) -> Array:
    """Resisting torque [N*m] of a passive foot on a motion from rest, shape (n,)."""
    theta = motion.theta
    elastic = foot.K * theta * (1 + foot.stiffening * theta**2) + foot.B * motion.omega
    return np.asarray(elastic + sum(slipping_torque(theta, spring) for spring in foot.slipping))


def slipping_torque(theta: Array, spring: SlippingSpring) -> Array:
    """Torque (n,) [N*m] of a slipping spring, 0 at the first angle; exact on each way between two turns."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta)))) + 1
    torque = np.zeros_like(theta)
    for a, b in pairwise([0, *turns.tolist(), len(theta) - 1]):
        way = slice(a, b + 1)
        torque[way] = np.clip(torque[a] + spring.stiffness * (theta[way] - theta[a]), -spring.limit, spring.limit)
    return torque
