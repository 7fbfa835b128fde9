"""The drivetrain of Eq. 9 with its friction, in time: belt torque for a measured joint angle and given gains.

The linear part is N(s) theta_m = K_s/n_T theta with N of `drivetrain.joint_admittance`. Between samples it is solved
exactly for an angle that is linear there. Friction is constant over a step: the torque that would stop the actuator,
limited to the largest friction.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.compiled import compiled
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import belt_deflection, belt_torque
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Controller:
    """What the law of Eqs. 5-7 was programmed with, which may differ from the drivetrain that it controls."""

    gains: Gains
    p: DrivetrainParameters  # those of torque constant and friction in the feedforward of Eq. 5
    sign_width: float  # velocity [rad/s] over which the sign of the velocity is smoothed
    angle_delay: float = 0.0  # age [s] of theta_m where it is used
    velocity_delay: float = 0.0  # age [s] of omega_m where it is used


def belt_response(
    theta: Array, rate_hz: float, controller: Controller, p: DrivetrainParameters, friction: float = 1.0
) -> Array:
    """Torque [N*m] in the belt, shape (n,), for a joint angle theta [rad] at uniform samples. The actuator starts at
    rest, in equilibrium with the first angle. Its friction, `friction` times that of the parameters p, has the true
    sign of the velocity and can hold it at rest. If the gains cancel friction, the current includes the feedforward of
    Eq. 5."""
    # N(s) theta_m = K_s/n_T theta + e over one sample, e a torque [N*m] constant in between: the next state (theta_m,
    # omega_m) is transition (2, 4) @ (theta_m, omega_m, theta, next theta) + push (2,) e
    step, continuous, gains = 1 / rate_hz, np.zeros((5, 5)), controller.gains
    continuous[0, 1] = continuous[2, 3] = 1.0
    continuous[1] = (-(gains.K_1 + p.K_s / p.n_T**2), -(p.B_m + gains.B_1), p.K_s / p.n_T, 0.0, 1.0)
    continuous[1] /= p.J_m
    exact = scipy.linalg.expm(continuous * step)[:2]
    slope = exact[:, 3] / step
    transition = np.column_stack([exact[:, :2], exact[:, 2] - slope, slope])
    law = (
        gains.K_1, gains.B_1, gains.cancels_friction, controller.sign_width, controller.p.k_tau * controller.p.n_m,
        controller.p.f_C, controller.p.f_G, controller.angle_delay * rate_hz, controller.velocity_delay * rate_hz,
    )  # fmt: skip
    plant = (p.k_tau * p.n_m, friction * p.f_C, friction * p.f_G, p.n_T, p.K_s2)
    start = p.K_s / p.n_T * theta[0] / (gains.K_1 + p.K_s / p.n_T**2)
    theta = np.ascontiguousarray(theta, dtype=float)
    path = np.zeros((2, len(theta)))
    path[0, 0] = start
    actuator_path(theta, path, transition, np.ascontiguousarray(exact[:, 4]), law, plant)
    return belt_torque(belt_deflection(theta, path[0], p), p)


@compiled
def actuator_path(
    theta: Array, path: Array, transition: Array, push: Array, law: tuple[float, ...], plant: tuple[float, ...]
) -> None:
    """Fill `path`, (2, n), with angle [rad] and velocity [rad/s] of the actuator, from those of the first sample, for
    theta (n,). Eq. 5 is written out for numbers; `motor_current` has it for arrays."""
    (a, b, c, d), (e, f, g, h) = transition
    drift, kick = push
    K_1, B_1, cancels, sign_width, constant, f_C, f_G, angle_age, velocity_age = law
    torque_constant, coulomb, gear, n_T, K_s2 = plant
    for i in range(len(theta) - 1):
        now, then = theta[i], theta[i + 1]
        theta_m, omega_m = path[0, i], path[1, i]
        old_angle, old_velocity = aged(path[0], i, angle_age), aged(path[1], i, velocity_age)
        u = -K_1 * old_angle - B_1 * old_velocity
        direction = math.tanh(old_velocity / sign_width) if cancels else 0.0
        r = u + direction * f_C
        current = r / (constant - (direction if r >= 0.0 else -direction) * f_G)
        theta_s = now - theta_m / n_T
        torque = torque_constant * current + K_1 * theta_m + B_1 * omega_m + K_s2 * theta_s * abs(theta_s) / n_T
        free = e * theta_m + f * omega_m + g * now + h * then + kick * torque
        limit = coulomb + gear * abs(current)
        friction = min(max(free / kick, -limit), limit)
        path[0, i + 1] = a * theta_m + b * omega_m + c * now + d * then + drift * (torque - friction)
        path[1, i + 1] = free - kick * friction


@compiled
def aged(values: Array, i: int, age: float) -> float:
    """A signal (n,) as it was `age` samples before sample i, on a line between samples; the first one before it."""
    whole = int(age)
    late = values[max(i - whole, 0)]
    return float(late + (age - whole) * (values[max(i - whole - 1, 0)] - late))
