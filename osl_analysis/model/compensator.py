"""The compensator: friction feedforward (Eqs. 5-7) and the choice of K_1 and B_1 (Eqs. 12-14)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.gain_selection import optimal_damping
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

CONTROLLERS = ("compensated", "uncompensated")
"""The controllers whose gains the draft states."""
PAPER_WEIGHT = Weight(cutoff_hz=1.0, order=3)
SMALLEST, LARGEST = 1e-9, 1e6
"""Limits of a desired stiffness [N*m/rad], and of a desired damping [N*m*s/rad] that is not 0."""


@dataclass(frozen=True)
class Gains:
    """Control gains at the actuator's output.

    Attributes
    ----------
    K_1
        Stiffness gain [N*m/rad].
    B_1
        Damping gain [N*m*s/rad].
    cancels_friction
        Whether the controller adds the friction term of Eq. 5.
    """

    K_1: float
    B_1: float
    cancels_friction: bool


def motor_current(u: ArrayLike, direction: ArrayLike, p: DrivetrainParameters) -> Array:
    """Current I_q [A] that makes the actuator's torque u [N*m]: Eq. 5, which has I_q on both sides, solved for I_q.

    `direction` is the smoothed sign of the *measured* actuator velocity, between -1 and 1 (`smooth_sign`).
    With r = u + s f_C: I_q = r/(k_tau n_m - s f_G) if r >= 0, else r/(k_tau n_m + s f_G).
    """
    s = np.asarray(direction)
    r = np.asarray(u) + s * p.f_C
    return np.asarray(r / (p.k_tau * p.n_m - np.where(r >= 0, s, -s) * p.f_G))


def smooth_sign(omega_m: ArrayLike, width: float) -> Array:
    """tanh(omega_m/width): the sign of a velocity [rad/s], smoothed over `width` [rad/s] so that it cannot chatter."""
    return np.tanh(np.asarray(omega_m) / width)


def check_request(K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters) -> None:
    """Refuse a desired stiffness [N*m/rad] or damping [N*m*s/rad], any shape, that no gains can render.

    Raises
    ------
    UnreachableImpedanceError
        A K_d is not between 0 and K_s: the belt is in series, so no positive K_1 renders it. Or a B_d is negative or
        not finite. Or a value other than B_d = 0 lies outside `SMALLEST` to `LARGEST`. The message names the accepted
        range.
    """
    K_d, B_d = (np.ravel(np.asarray(values, dtype=float)) for values in (K_d, B_d))
    for value in K_d[~((K_d > 0) & (K_d < p.K_s))]:
        nearest = f"less than {p.K_s:g} (99 % of it: {0.99 * p.K_s:.4g})" if value >= p.K_s else "more than 0"
        raise UnreachableImpedanceError(
            f"K_d = {value:g} N*m/rad cannot be rendered: the actuator acts in series with a belt of "
            f"K_s = {p.K_s:g} N*m/rad; ask for {nearest}"
        )
    for value in B_d[~((B_d >= 0) & (B_d < np.inf))]:
        raise UnreachableImpedanceError(
            f"B_d = {value:g} N*m*s/rad cannot be rendered: a desired damping must be finite and not negative; ask "
            "for 0 or more"
        )
    for name, unit, values in (("K_d", "N*m/rad", K_d), ("B_d", "N*m*s/rad", B_d)):
        for value in values[((values < SMALLEST) | (values > LARGEST)) & (values != 0)]:
            raise UnreachableImpedanceError(
                f"{name} = {value:g} {unit} is outside the accepted range; ask for {SMALLEST:g} to {LARGEST:g} {unit}"
            )


def stiffness_gain(K_d: ArrayLike, p: DrivetrainParameters) -> Array:
    """K_1 [N*m/rad] that gives the joint the static stiffness K_d [N*m/rad] (Eq. 13), any shape.

    Raises
    ------
    UnreachableImpedanceError
        As `check_request`.
    """
    check_request(K_d, 0.0, p)
    K_d = np.asarray(K_d, dtype=float)
    return np.asarray(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)))


def compensated_gains(K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight = PAPER_WEIGHT) -> Gains:
    """Gains that render stiffness K_d [N*m/rad] and damping B_d [N*m*s/rad] best (Eqs. 13-14).

    Raises
    ------
    UnreachableImpedanceError
        As `check_request`, or the error of Eq. 14 decreases for every increase of B_1, so that no finite B_1 minimises
        it.
    """
    check_request(K_d, B_d, p)
    damping = optimal_damping([K_d], [B_d], p, weight)
    if damping.unbounded[0]:
        raise UnreachableImpedanceError(
            f"no finite B_1 minimises Eq. 14 for K_d = {K_d:g} N*m/rad, B_d = {B_d:g} N*m*s/rad: with the cut-off of W "
            f"at {weight.cutoff_hz:g} Hz the error decreases until the motor is locked; lower the cut-off of W"
        )
    return Gains(float(stiffness_gain(K_d, p)), float(damping.B_1[0]), cancels_friction=True)


def uncompensated_gains(K_d: float, B_d: float, p: DrivetrainParameters) -> Gains:
    """Gains that neglect the drivetrain's dynamics: K_1 = K_d/n_T^2, B_1 = B_d/n_T^2, no friction term.

    Raises
    ------
    UnreachableImpedanceError
        K_d or B_d is negative or not finite.
    """
    for name, value in (("K_d", K_d), ("B_d", B_d)):
        if not 0 <= value < np.inf:
            raise UnreachableImpedanceError(f"{name} = {value:g} cannot be asked for; give a finite number, 0 or more")
    return Gains(K_d / p.n_T**2, B_d / p.n_T**2, cancels_friction=False)


def select_gains(
    controller: str, K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight = PAPER_WEIGHT
) -> Gains:
    """The gains of a `compensated` or an `uncompensated` trial. Raises as `compensated_gains`."""
    if controller == "uncompensated":
        return uncompensated_gains(K_d, B_d, p)
    return compensated_gains(K_d, B_d, p, weight)
