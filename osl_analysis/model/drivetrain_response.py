"""The drivetrain of Eq. 9 with its friction, in time: belt torque for a measured joint angle and given gains.

The linear part is N(s) theta_m = K_s/n_T theta with N of `drivetrain.joint_admittance`. Between samples it is solved
exactly for an angle that is linear there. Friction is constant over a step: the torque that would stop the actuator,
limited to the largest friction. numba's cache does not notice changes in other files. Therefore all compiled functions
are in this file, and Eq. 5 is repeated here for scalars (`compensator.motor_current` computes it for arrays).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from osl_analysis.compiled import compiled
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import belt_deflection, belt_torque
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Friction:
    """The actuator's true friction, and the controller's smoothing of the velocity's sign.

    Attributes
    ----------
    scale
        Ratio of the true friction to the friction in the parameter file.
    sign_width
        Velocity [rad/s] over which the controller smooths the sign.
    """

    scale: float
    sign_width: float


class Loop(NamedTuple):
    """Gains, motor and friction in SI units, as arguments of the compiled functions.

    Attributes
    ----------
    K_1, B_1
        Control gains [N*m/rad], [N*m*s/rad] at the actuator's output.
    torque_constant
        k_tau n_m [N*m/A].
    f_C, f_G
        Coulomb friction [N*m] and gear friction [N*m/A] in the controller's model.
    limit
        Ratio of the true friction to the friction in the controller's model.
    cancels
        Whether the controller cancels friction.
    sign_width
        Velocity [rad/s] over which the controller smooths the sign.
    n_T
        Ratio of the belt.
    K_s2
        Quadratic stiffness [N*m/rad^2] of the belt.
    """

    K_1: float
    B_1: float
    torque_constant: float
    f_C: float
    f_G: float
    limit: float
    cancels: bool
    sign_width: float
    n_T: float
    K_s2: float


def belt_response(theta: Array, rate_hz: float, gains: Gains, p: DrivetrainParameters, friction: Friction) -> Array:
    """Torque [N*m] in the belt, shape (n,), for a joint angle theta [rad] at uniform samples, starting at rest.

    The actuator starts in equilibrium with the first angle. Friction has the true sign of the velocity and can hold the
    actuator at rest. If the gains cancel friction, the current includes the feedforward of Eq. 5, with its smoothed
    sign.
    """
    transition, push = discretised(gains, p, rate_hz)
    loop = Loop(
        gains.K_1, gains.B_1, p.k_tau * p.n_m, p.f_C, p.f_G, friction.scale, gains.cancels_friction,
        friction.sign_width, p.n_T, p.K_s2,
    )  # fmt: skip
    start = p.K_s / p.n_T * theta[0] / (gains.K_1 + p.K_s / p.n_T**2)
    theta_m = actuator_path(np.ascontiguousarray(theta, dtype=float), float(start), transition, push, loop)
    return belt_torque(belt_deflection(theta, theta_m, p), p)


def discretised(gains: Gains, p: DrivetrainParameters, rate_hz: float) -> tuple[Array, Array]:
    """The solution of N(s) theta_m = K_s/n_T theta + e over one sample, e a torque [N*m] constant in between.

    The next state (theta_m, omega_m) is transition (2, 4) @ (theta_m, omega_m, theta, next theta) + push (2,) e.
    """
    step, continuous = 1 / rate_hz, np.zeros((5, 5))
    continuous[0, 1] = continuous[2, 3] = 1.0
    continuous[1] = (-(gains.K_1 + p.K_s / p.n_T**2), -(p.B_m + gains.B_1), p.K_s / p.n_T, 0.0, 1.0)
    continuous[1] /= p.J_m
    exact = expm(continuous * step)[:2]
    slope = exact[:, 3] / step
    return np.column_stack([exact[:, :2], exact[:, 2] - slope, slope]), np.ascontiguousarray(exact[:, 4])


@compiled
def feedforward(u: float, direction: float, loop: Loop) -> float:
    """Current [A] for an actuator torque u [N*m] (Eq. 5 in closed form). A direction of 0 ignores friction."""
    r = u + direction * loop.f_C
    side = direction if r >= 0.0 else -direction
    return r / (loop.torque_constant - side * loop.f_G)


@compiled
def actuator_path(theta: Array, start: float, transition: Array, push: Array, loop: Loop) -> Array:
    """Angle theta_m [rad], shape (n,), of the actuator that starts at rest at `start` [rad]."""
    (a, b, c, d), (e, f, g, h) = transition
    drift, kick = push
    path = np.empty_like(theta)
    theta_m, omega_m = start, 0.0
    path[0] = theta_m
    for i in range(len(theta) - 1):
        now, then = theta[i], theta[i + 1]
        u = -loop.K_1 * theta_m - loop.B_1 * omega_m
        direction = float(np.tanh(omega_m / loop.sign_width)) if loop.cancels else 0.0
        current = feedforward(u, direction, loop)
        theta_s = now - theta_m / loop.n_T
        torque = loop.torque_constant * current - u + loop.K_s2 * theta_s * abs(theta_s) / loop.n_T
        free = e * theta_m + f * omega_m + g * now + h * then + kick * torque
        limit = loop.limit * (loop.f_C + loop.f_G * abs(current))
        friction = min(max(free / kick, -limit), limit)
        theta_m = a * theta_m + b * omega_m + c * now + d * then + drift * (torque - friction)
        omega_m = free - kick * friction
        path[i + 1] = theta_m
    return path
