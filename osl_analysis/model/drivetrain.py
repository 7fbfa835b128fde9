"""The drivetrain: actuator (Eqs. 1-2), belt transmission (Eqs. 3-4), joint admittance (Eqs. 8-11), in the paper's
signs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.trial import Array


@dataclass(frozen=True)
class RationalFunction:
    """numerator(s) / denominator(s); coefficients with the highest power first."""

    numerator: Array
    denominator: Array

    def __call__(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Value at complex frequencies s [rad/s], any shape."""
        s = np.asarray(s, dtype=np.complex128)
        return np.asarray(np.polyval(self.numerator, s) / np.polyval(self.denominator, s), dtype=np.complex128)

    def poles(self) -> NDArray[np.complex128]:
        """Roots of the denominator [rad/s]."""
        return np.roots(self.denominator).astype(np.complex128)


def motor_friction(direction: ArrayLike, current: ArrayLike, p: DrivetrainParameters) -> Array:
    """Coulomb and gear friction f [N*m] at the actuator's output (Eq. 2) for a current I_q [A]. `direction` is the sign
    of omega_m, or a smooth substitute between -1 and 1."""
    return np.asarray(np.asarray(direction) * (p.f_C + p.f_G * np.abs(current)))


def actuator_torque(current: ArrayLike, omega_m: ArrayLike, alpha_m: ArrayLike, p: DrivetrainParameters) -> Array:
    """Torque tau_m [N*m] at the actuator's output from I_q [A], omega_m [rad/s] and alpha_m [rad/s^2] (Eq. 1)."""
    friction = motor_friction(np.sign(omega_m), current, p)
    return np.asarray(
        np.asarray(current) * p.k_tau * p.n_m - friction - p.B_m * np.asarray(omega_m) - p.J_m * np.asarray(alpha_m)
    )


def belt_deflection(theta: ArrayLike, theta_m: ArrayLike, p: DrivetrainParameters) -> Array:
    """Deflection theta_s [rad] of the belt, seen at the joint (Eq. 3)."""
    return np.asarray(theta) - np.asarray(theta_m) / p.n_T


def belt_torque(theta_s: ArrayLike, p: DrivetrainParameters) -> Array:
    """Torque tau_s [N*m] in the belt (Eq. 8), plus the quadratic term K_s2, which is 0 in most parameter files."""
    theta_s = np.asarray(theta_s)
    return np.asarray(p.K_s * theta_s + p.K_s2 * theta_s * np.abs(theta_s))


def desired_admittance(K_d: float, B_d: float) -> RationalFunction:
    """Y_d = 1/Q = 1/(B_d s + K_d) [rad/(N*m)] (Eq. 11). If K_d/B_d is above 1e9 rad/s, B_d counts as 0."""
    return RationalFunction(np.array([1.0]), np.array([B_d, K_d] if B_d > 1e-9 * K_d else [K_d]))


def joint_admittance(K_1: float, B_1: float, p: DrivetrainParameters, J_j: float = 0.0) -> RationalFunction:
    """Closed-loop integral admittance Y = theta_j/tau [rad/(N*m)] for gains K_1 and B_1 (Eqs. 9-10).

    Y = N/D with

        N = J_m s^2 + x s + kappa      the actuator under control, x = B_m + B_1, kappa = K_1 + K_s/n_T^2
        P = J_j s^2 + B_j s + K_s      the joint that the belt holds
        D = N P - c                    c = (K_s/n_T)^2

    The other modules use the same letters. The paper neglects J_j. `J_j=p.J_j` includes the joint's inertia; the
    denominator then has one power more.
    """
    N = np.array([p.J_m, p.B_m + B_1, K_1 + p.K_s / p.n_T**2])
    P = np.array([J_j, p.B_j, p.K_s])
    D = np.convolve(N, P)
    D[-1] -= p.K_s**2 / p.n_T**2
    return RationalFunction(N, D if J_j else D[1:])
