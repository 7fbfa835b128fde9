"""The compensator: friction feedforward (Eqs. 5-7) and the choice of K_1 and B_1 (Eqs. 12-14)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar
from scipy.signal import butter

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model.drivetrain import RationalFunction, desired_admittance, joint_admittance
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

WEIGHT_ORDER = 3
WEIGHT_CUTOFF_HZ = 1.0


@dataclass(frozen=True)
class Gains:
    """Control gains at the actuator's output: K_1 [N*m/rad], B_1 [N*m*s/rad]; whether friction is cancelled."""

    K_1: float
    B_1: float
    cancels_friction: bool


def motor_current(u: ArrayLike, direction: ArrayLike, p: DrivetrainParameters) -> Array:
    """Current I_q [A] that makes the actuator's torque u [N*m]: Eq. 5 solved for I_q, which stands on both sides.

    `direction` is the smoothed sign of the *measured* actuator velocity, between -1 and 1 (`smooth_sign`).
    With r = u + s f_C: I_q = r/(k_tau n_m - s f_G) if r >= 0, else r/(k_tau n_m + s f_G).
    """
    s = np.asarray(direction)
    r = np.asarray(u) + s * p.f_C
    return np.asarray(r / (p.k_tau * p.n_m - np.where(r >= 0, s, -s) * p.f_G))


def smooth_sign(omega_m: ArrayLike, width: float) -> Array:
    """tanh(omega_m/width): the sign of a velocity [rad/s], smooth over `width` [rad/s] so that it can't chatter."""
    return np.tanh(np.asarray(omega_m) / width)


def stiffness_gain(K_d: ArrayLike, p: DrivetrainParameters) -> Array:
    """K_1 [N*m/rad] that gives the joint the static stiffness K_d [N*m/rad] (Eq. 13).

    Raises
    ------
    UnreachableImpedanceError
        K_d is not between 0 and K_s: in series with the belt no positive K_1 renders it.
    """
    K_d = np.asarray(K_d, dtype=float)
    for value in np.ravel(K_d):
        if not 0 < value < p.K_s:
            raise UnreachableImpedanceError(
                f"K_d = {value:g} N*m/rad cannot be rendered: the actuator acts in series with a belt of "
                f"K_s = {p.K_s:g} N*m/rad, so ask for more than 0 and less than {p.K_s:g}"
            )
    return np.asarray(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)))


def compensated_gains(K_d: float, B_d: float, p: DrivetrainParameters) -> Gains:
    """Gains that render stiffness K_d [N*m/rad] and damping B_d [N*m*s/rad] best (Eqs. 13-14).

    Raises
    ------
    UnreachableImpedanceError
        K_d is not between 0 and K_s, or B_d is negative or not finite.
    """
    if not (np.isfinite(B_d) and B_d >= 0):
        raise UnreachableImpedanceError(f"B_d = {B_d:g} N*m*s/rad cannot be rendered stably; ask for 0 or more")
    K_1 = float(stiffness_gain(K_d, p))
    return Gains(K_1, damping_gain(K_d, B_d, K_1, p), cancels_friction=True)


def uncompensated_gains(K_d: float, B_d: float, p: DrivetrainParameters) -> Gains:
    """Gains that neglect the drivetrain's dynamics: K_d/n_T^2, B_d/n_T^2 and no friction term."""
    return Gains(K_d / p.n_T**2, B_d / p.n_T**2, cancels_friction=False)


def select_gains(controller: str, K_d: float, B_d: float, p: DrivetrainParameters) -> Gains:
    """The gains of a `compensated` or an `uncompensated` trial; raises as `compensated_gains`."""
    rules = {"compensated": compensated_gains, "uncompensated": uncompensated_gains}
    return rules[controller](K_d, B_d, p)


def damping_gain(K_d: float, B_d: float, K_1: float, p: DrivetrainParameters) -> float:
    """B_1 [N*m*s/rad] that minimises ||W (Y - Y_d)||_2 with B_m + B_1 > 0 (Eq. 14), by a bounded search.

    The search is over log(B_m + B_1), which keeps the loop stable by construction; it spans six decades around
    B_d/n_T^2 and the drivetrain's own damping.
    """
    scale = B_d / p.n_T**2 + p.B_j / p.n_T**2 + p.B_m
    found = minimize_scalar(
        lambda x: admittance_error(K_d, B_d, K_1, scale * np.exp(x) - p.B_m, p),
        bounds=(-np.log(1e3), np.log(1e3)),
        method="bounded",
        options={"xatol": 1e-7},
    )
    return float(scale * np.exp(found.x) - p.B_m)


def admittance_error(K_d: float, B_d: float, K_1: float, B_1: float, p: DrivetrainParameters) -> float:
    """||W (Y - Y_d)||_2, W a third-order Butterworth low-pass at 1 Hz = 2 pi rad/s (Eq. 14)."""
    Y, Y_d = joint_admittance(K_1, B_1, p), desired_admittance(K_d, B_d)
    b, a = butter(WEIGHT_ORDER, 2 * np.pi * WEIGHT_CUTOFF_HZ, analog=True)
    difference = np.polysub(np.polymul(Y.numerator, Y_d.denominator), np.polymul(Y_d.numerator, Y.denominator))
    denominator = np.polymul(np.polymul(Y.denominator, Y_d.denominator), a)
    return h2_norm(RationalFunction(np.polymul(b, difference).astype(float), denominator.astype(float)))


def h2_norm(system: RationalFunction) -> float:
    """||G||_2 of a strictly proper stable G, by the controllability Gramian of its companion form.

    Time is scaled by the geometric mean of the poles, which keeps the Lyapunov equation well conditioned.
    """
    monic = np.asarray(system.denominator) / system.denominator[0]
    order = len(monic) - 1
    rate = float(np.abs(monic[-1]) ** (1 / order))
    a = monic[1:] / rate ** np.arange(1, order + 1)
    b = np.zeros(order)
    numerator = np.trim_zeros(system.numerator, "f") / system.denominator[0]
    b[order - len(numerator) :] = numerator / rate ** np.arange(order - len(numerator) + 1, order + 1)
    A = np.vstack([-a, np.eye(order - 1, order)])
    B = np.eye(order, 1)
    gramian = solve_continuous_lyapunov(A, -B @ B.T)
    return float(np.sqrt(max(float(b @ gramian @ b), 0.0) * rate))
