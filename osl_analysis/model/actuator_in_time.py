"""The actuator under its controller in time, with friction.

The linear part is N(s) theta_m = K_s/n_T theta. Between samples it is solved exactly for an angle
that is linear there. Friction is constant over a step: what would stop the actuator, within the
largest friction.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.model.compensator import Gains
from osl_analysis.model.compiled import compiled
from osl_analysis.model.drivetrain import DrivetrainParameters, belt_deflection, belt_torque
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Controller:
    """The program's numbers in the law of Eqs. 5-7, which may differ from the drivetrain that it
    controls."""

    gains: Gains
    p: DrivetrainParameters  # torque constant and friction in the feedforward of Eq. 5
    sign_width: float  # velocity [rad/s] over which its sign is smoothed
    angle_delay: float = 0.0  # age [s] of theta_m at its use
    velocity_delay: float = 0.0  # age [s] of omega_m at its use


def belt_responses(
    theta: Array, rate_hz: float, legs: Sequence[tuple[Controller, DrivetrainParameters]]
) -> Array:
    """Find the torque in the belt of legs whose joint is turned.

    Parameters
    ----------
    theta : Array
        Joint angle (n,) [rad] at uniform samples.
    rate_hz : float
        Sampling rate [Hz].
    legs : Sequence of (Controller, DrivetrainParameters)
        k legs.

    Returns
    -------
    Array
        (k, n) [N*m].

    Notes
    -----
    The actuator starts at rest, in equilibrium with the first angle. Its friction has the true sign
    of the velocity and can hold it at rest. If the gains cancel friction, the current includes the
    feedforward of Eq. 5.
    """
    theta = np.ascontiguousarray(theta, dtype=float)
    # angle [rad] and velocity [rad/s] of each actuator
    paths = np.zeros((len(legs), 2, len(theta)))
    for path, (controller, p) in zip(paths, legs, strict=True):
        stiffness = controller.gains.K_1 + p.K_s / p.n_T**2
        path[0, 0] = p.K_s / p.n_T * theta[0] / stiffness
    actuator_paths(
        theta,
        paths,
        np.array([motion_over_a_step(*leg, 1 / rate_hz) for leg in legs]),
        np.array([numbers_of_law(controller, rate_hz) for controller, _ in legs]),
        np.array([(p.k_tau * p.n_m, p.f_C, p.f_G, p.n_T, p.K_s2) for _, p in legs]),
    )
    return np.array(
        [
            belt_torque(belt_deflection(theta, theta_m, p), p)
            for theta_m, (_, p) in zip(paths[:, 0], legs, strict=True)
        ]
    ).reshape(len(legs), len(theta))


def motion_over_a_step(controller: Controller, p: DrivetrainParameters, step: float) -> Array:
    """Coefficients (10,) of N(s) theta_m = K_s/n_T theta + e over a step [s], e a torque [N*m] that
    is constant in between.

    The next state (theta_m, omega_m) is transition (2, 4) @ (theta_m, omega_m, theta, next theta) +
    push (2,) e.
    """
    gains = controller.gains
    # rates of theta_m, omega_m, theta, slope of theta, e
    rates = np.zeros((5, 5))
    rates[0, 1] = 1.0
    rates[1, 0] = -(gains.K_1 + p.K_s / p.n_T**2)
    rates[1, 1] = -(p.B_m + gains.B_1)
    rates[1, 2] = p.K_s / p.n_T
    rates[1, 4] = 1.0
    rates[1] /= p.J_m
    rates[2, 3] = 1.0
    exact = scipy.linalg.expm(rates * step)[:2]
    slope = exact[:, 3] / step
    transition = np.column_stack([exact[:, :2], exact[:, 2] - slope, slope])
    push = exact[:, 4]
    return np.append(transition, push)


def numbers_of_law(controller: Controller, rate_hz: float) -> tuple[float, ...]:
    """The numbers of a controller as `actuator_paths` takes them; ages in samples."""
    gains = controller.gains
    p = controller.p
    return (
        gains.K_1,
        gains.B_1,
        gains.cancels_friction,
        controller.sign_width,
        p.k_tau * p.n_m,
        p.f_C,
        p.f_G,
        controller.angle_delay * rate_hz,
        controller.velocity_delay * rate_hz,
    )


@compiled
def actuator_paths(theta: Array, paths: Array, motions: Array, laws: Array, plants: Array) -> None:
    """Fill `paths`, (k, 2, n), with angle [rad] and velocity [rad/s] of k actuators for theta (n,),
    from those of the first sample.

    Each step depends on the one before it; the processor fills the wait with the other actuators.
    Eq. 5 is written out for scalars; `motor_current` has it for arrays.
    """
    for i in range(len(theta) - 1):
        now = theta[i]
        then = theta[i + 1]
        for leg in range(len(paths)):
            path = paths[leg]
            # linear part of a step: next angle and next velocity by theta_m, omega_m, theta and the
            # next theta, and by a torque
            (
                angle_by_angle,
                angle_by_velocity,
                angle_by_theta,
                angle_by_next_theta,
                velocity_by_angle,
                velocity_by_velocity,
                velocity_by_theta,
                velocity_by_next_theta,
                angle_by_torque,
                velocity_by_torque,
            ) = motions[leg]
            K_1, B_1, cancels, sign_width, constant, f_C, f_G, angle_age, velocity_age = laws[leg]
            torque_constant, coulomb, gear, n_T, K_s2 = plants[leg]
            theta_m = path[0, i]
            omega_m = path[1, i]

            old_angle = aged(path[0], i, angle_age)
            old_velocity = aged(path[1], i, velocity_age)
            u = -K_1 * old_angle - B_1 * old_velocity
            direction = math.tanh(old_velocity / sign_width) if cancels else 0.0
            r = u + direction * f_C
            current = r / (constant - (direction if r >= 0.0 else -direction) * f_G)

            # what the linear part does not have
            theta_s = now - theta_m / n_T
            torque = (
                torque_constant * current
                + K_1 * theta_m
                + B_1 * omega_m
                + K_s2 * theta_s * abs(theta_s) / n_T
            )
            velocity_without_friction = (
                velocity_by_angle * theta_m
                + velocity_by_velocity * omega_m
                + velocity_by_theta * now
                + velocity_by_next_theta * then
                + velocity_by_torque * torque
            )
            # friction stops the actuator, if it is large enough for that
            largest = coulomb + gear * abs(current)
            stopping = velocity_without_friction / velocity_by_torque
            friction = min(max(stopping, -largest), largest)
            path[0, i + 1] = (
                angle_by_angle * theta_m
                + angle_by_velocity * omega_m
                + angle_by_theta * now
                + angle_by_next_theta * then
                + angle_by_torque * (torque - friction)
            )
            path[1, i + 1] = velocity_without_friction - velocity_by_torque * friction


@compiled
def aged(values: Array, i: int, age: float) -> float:
    """A signal (n,) `age` samples before sample i, interpolated linearly; before the first sample,
    the first value."""
    whole = int(age)
    newer = values[max(i - whole, 0)]
    older = values[max(i - whole - 1, 0)]
    return float(newer + (age - whole) * (older - newer))
