"""The drivetrain of Eq. 9 with its friction, in time: belt torque for a measured joint angle and given gains.

The linear part is N(s) theta_m = K_s/n_T theta with N of `drivetrain.joint_admittance`. Between samples it is solved
exactly for an angle that is linear there. Friction is constant over a step: the torque that would stop the actuator,
limited to the largest friction.
"""

import math

import numpy as np
from scipy.linalg import expm

from osl_analysis.compiled import compiled
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import belt_deflection, belt_torque
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.trial import Array


def belt_response(
    theta: Array, rate_hz: float, gains: Gains, p: DrivetrainParameters, friction: float, sign_width: float
) -> Array:
    """Torque [N*m] in the belt, shape (n,), for a joint angle theta [rad] at uniform samples. The actuator starts at
    rest, in equilibrium with the first angle. Its friction, `friction` times that of the parameters, has the true sign
    of the velocity and can hold it at rest. If the gains cancel friction, the current includes the feedforward of
    Eq. 5, whose sign is smoothed over velocities of `sign_width` [rad/s]."""
    # N(s) theta_m = K_s/n_T theta + e over one sample, e a torque [N*m] constant in between: the next state (theta_m,
    # omega_m) is transition (2, 4) @ (theta_m, omega_m, theta, next theta) + push (2,) e
    step, continuous = 1 / rate_hz, np.zeros((5, 5))
    continuous[0, 1] = continuous[2, 3] = 1.0
    continuous[1] = (-(gains.K_1 + p.K_s / p.n_T**2), -(p.B_m + gains.B_1), p.K_s / p.n_T, 0.0, 1.0)
    continuous[1] /= p.J_m
    exact = expm(continuous * step)[:2]
    slope = exact[:, 3] / step
    transition = np.column_stack([exact[:, :2], exact[:, 2] - slope, slope])
    loop = (
        gains.K_1, gains.B_1, p.k_tau * p.n_m, p.f_C, p.f_G, friction, gains.cancels_friction, sign_width,
        p.n_T, p.K_s2,
    )  # fmt: skip
    start = p.K_s / p.n_T * theta[0] / (gains.K_1 + p.K_s / p.n_T**2)
    theta = np.ascontiguousarray(theta, dtype=float)
    theta_m = np.empty_like(theta)
    actuator_path(theta, theta_m, float(start), transition, np.ascontiguousarray(exact[:, 4]), loop)
    return belt_torque(belt_deflection(theta, theta_m, p), p)


@compiled
def actuator_path(
    theta: Array, path: Array, start: float, transition: Array, push: Array, loop: tuple[float, ...]
) -> None:
    """Fill `path`, (n,), with the angle theta_m [rad] of the actuator that starts at rest at `start` [rad], for theta
    (n,). Eq. 5 is written out for numbers; `motor_current` has it for arrays."""
    (a, b, c, d), (e, f, g, h) = transition
    drift, kick = push
    K_1, B_1, torque_constant, f_C, f_G, scale, cancels, sign_width, n_T, K_s2 = loop
    theta_m, omega_m = start, 0.0
    path[0] = theta_m
    for i in range(len(theta) - 1):
        now, then = theta[i], theta[i + 1]
        u = -K_1 * theta_m - B_1 * omega_m
        direction = math.tanh(omega_m / sign_width) if cancels else 0.0
        r = u + direction * f_C
        current = r / (torque_constant - (direction if r >= 0.0 else -direction) * f_G)
        theta_s = now - theta_m / n_T
        torque = torque_constant * current - u + K_s2 * theta_s * abs(theta_s) / n_T
        free = e * theta_m + f * omega_m + g * now + h * then + kick * torque
        limit = scale * (f_C + f_G * abs(current))
        friction = min(max(free / kick, -limit), limit)
        theta_m = a * theta_m + b * omega_m + c * now + d * then + drift * (torque - friction)
        omega_m = free - kick * friction
        path[i + 1] = theta_m
