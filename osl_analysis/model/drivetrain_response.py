"""The drivetrain of Eq. 9 with its friction, in time: belt torque for a measured joint angle and given gains.

Between samples the linear part is exact for an angle that is linear there; friction is one torque per step, as much as
stops the actuator and no more than its limit. Compiled functions stand in one file: see `compiled`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, ParamSpec, TypeVar, cast

import numpy as np
from numba import njit
from scipy.linalg import expm

from osl_analysis.model.compensator import Gains
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Friction:
    """Friction of the actuator over what the parameters say, and the width [rad/s] of the sign that cancels it."""

    scale: float
    sign_width: float


class Loop(NamedTuple):
    """Gains, motor and friction in SI units; `limit` is the true friction over the one that the controller believes."""

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


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function, compiled on its first call and kept on disk, where changes in other files go unseen."""
    return cast(Callable[P, R], njit(cache=True, error_model="numpy")(function))


def belt_response(theta: Array, rate_hz: float, gains: Gains, p: DrivetrainParameters, friction: Friction) -> Array:
    """Torque [N*m] in the belt, shape (n,), that answers a joint angle theta [rad] at uniform samples, from rest.

    The actuator starts where the first angle leaves it in equilibrium. Friction acts with the true sign of the
    velocity and holds the actuator at rest; where the gains cancel it, the current adds Eq. 5's smooth feedforward.
    """
    transition, push = discretised(gains, p, rate_hz)
    loop = Loop(
        gains.K_1, gains.B_1, p.k_tau * p.n_m, p.f_C, p.f_G, friction.scale, gains.cancels_friction,
        friction.sign_width, p.n_T, p.K_s2,
    )  # fmt: skip
    start = p.K_s / p.n_T * theta[0] / (gains.K_1 + p.K_s / p.n_T**2)
    theta_m = actuator_path(np.ascontiguousarray(theta, dtype=float), float(start), transition, push, loop)
    theta_s = theta - theta_m / p.n_T
    return np.asarray(p.K_s * theta_s + p.K_s2 * theta_s * np.abs(theta_s))


def discretised(gains: Gains, p: DrivetrainParameters, rate_hz: float) -> tuple[Array, Array]:
    """J_m theta_m'' + (B_m + B_1) theta_m' + (K_1 + K_s/n_T^2) theta_m = K_s/n_T theta + e over one sample.

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
    """Current [A] for an actuator torque u [N*m] (Eq. 5 in closed form); direction 0 ignores friction."""
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
