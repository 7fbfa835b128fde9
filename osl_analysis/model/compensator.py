# SPDX-License-Identifier: Apache-2.0
"""The compensator: the choice of K_1 and B_1 (Eqs. 12-14).

Eq. 14, in the letters of `drivetrain.dynamic_stiffness`, with Q = B_d s + K_d and K_1 from Eq. 13:

    W (Y - Y_d) = b(s; x)/a(s; x),   a = W_den D Q,   b = W_num (N Q - D).

Both are affine in x = B_m + B_1. Astrom's recursion (Introduction to Stochastic Control Theory,
1970, ch. 5) turns the squared norm into a sum over the rows of a's Routh table, so that its slope
in x is exact. Its changes of sign on a logarithmic grid bracket the minima, of which
docs/gain_selection.md says how many there are.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import Field

from osl_analysis.base.errors import InputError, UnreachableImpedanceError, nearest
from osl_analysis.base.trial import Array
from osl_analysis.base.yaml_settings import FilterOrder, Settings
from osl_analysis.model.drivetrain import (
    LARGEST_PARAMETER,
    SMALLEST_PARAMETER,
    DrivetrainParameters,
)

CONTROLLERS = ("compensated", "uncompensated")  # whose gains the draft states

# The search for x = B_m + B_1, in the scale (K_1 J_m)^1/2 of the actuator's damping, over the range
# of a parameter. The points are a factor of 1.8 apart; the closest two minima that were found are a
# factor of 4 apart.
POINTS = 73
ROUNDING = 4 * float(np.finfo(float).eps)  # of a root, as a share of it


class Weight(Settings):
    """W of Eq. 14: the Butterworth low-pass with which the laboratory selected its gains.

    The paper's is 1 Hz (2 pi rad/s) of order 3. The limits of its cut-off lie far outside the
    frequencies at which a leg moves.
    """

    cutoff_hz: Annotated[float, Field(ge=1e-3, le=1e4)]  # Cut-off [Hz].
    order: FilterOrder  # Order.


PAPER_WEIGHT = Weight(cutoff_hz=1.0, order=3)


@dataclass(frozen=True)
class Gains:
    """Control gains at the actuator's output."""

    K_1: float  # stiffness gain [N*m/rad]
    B_1: float  # damping gain [N*m*s/rad]
    cancels_friction: bool  # whether the controller adds the friction term of Eq. 5


class OptimalDamping(NamedTuple):
    """The minimum of Eq. 14 over B_1."""

    B_1: float  # damping gain [N*m*s/rad] at the global minimum; infinite where `unbounded`
    error: float  # the norm there [rad/(N*m)/s^1/2]
    # whether the error falls towards B_m + B_1 = 0, so that the joint alone damps more than was
    # asked for; B_1 is then the last stable value of the search
    at_lower_bound: bool
    # whether the error falls for every increase of B_1: a locked motor would be best
    unbounded: bool


def check_request(K_d: float, B_d: float, p: DrivetrainParameters) -> None:
    """Refuse a desired impedance that no gains can render: the belt is in series, so K_d is between
    0 and K_s. Sizes that only a wrong unit has are refused, too.

    Parameters
    ----------
    K_d, B_d : float
        Stiffness [N*m/rad] and damping [N*m*s/rad].
    p : DrivetrainParameters

    Raises
    ------
    UnreachableImpedanceError
    """
    if not SMALLEST_PARAMETER <= K_d < p.K_s:
        raise UnreachableImpedanceError(
            f"K_d = {K_d:g} N*m/rad cannot be rendered: the actuator acts in series with a"
            f" belt of K_s = {p.K_s:g} N*m/rad",
            f"ask for {SMALLEST_PARAMETER:g} or more, and less than K_s",
            settings=["K_d"],
        )
    if B_d != 0 and not SMALLEST_PARAMETER <= B_d <= LARGEST_PARAMETER:
        raise UnreachableImpedanceError(
            f"B_d = {B_d:g} N*m*s/rad cannot be rendered",
            f"ask for 0, or {SMALLEST_PARAMETER:g} to {LARGEST_PARAMETER:g} N*m*s/rad",
            settings=["B_d"],
        )


def stiffness_gain(K_d: ArrayLike, p: DrivetrainParameters) -> Array:
    """The gain K_1 = K_d K_s/(n_T^2 (K_s - K_d)) [N*m/rad] that gives the joint the static
    stiffness K_d (Eq. 13) [N*m/rad], any shape."""
    K_d = np.asarray(K_d, dtype=float)
    return np.asarray(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)))


def compensated_gains(
    K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight = PAPER_WEIGHT
) -> Gains:
    """Find the gains that render a stiffness and a damping best (Eqs. 13-14).

    Parameters
    ----------
    K_d, B_d : float
        [N*m/rad] and [N*m*s/rad].
    p : DrivetrainParameters
    weight : Weight
        W of Eq. 14.

    Returns
    -------
    Gains

    Raises
    ------
    UnreachableImpedanceError
        As `check_request`, or no finite B_1 minimises the error of Eq. 14.
    """
    damping = optimal_damping(K_d, B_d, p, weight)
    if damping.unbounded:
        raise UnreachableImpedanceError(
            f"no finite B_1 minimises Eq. 14 for K_d = {K_d:g} N*m/rad, B_d = {B_d:g} N*m*s/rad:"
            f" with the cut-off of W at {weight.cutoff_hz:g} Hz the error decreases until the"
            " motor is locked",
            "lower the cut-off of W",
        )
    K_1 = float(stiffness_gain(K_d, p))
    return Gains(K_1, damping.B_1, cancels_friction=True)


def uncompensated_gains(K_d: float, B_d: float, p: DrivetrainParameters) -> Gains:
    """Find the gains that neglect the drivetrain's dynamics: K_1 = K_d/n_T^2, B_1 = B_d/n_T^2, no
    friction term. Raises UnreachableImpedanceError: K_d or B_d is negative or not finite."""
    for name, value in (("K_d", K_d), ("B_d", B_d)):
        if not 0 <= value < np.inf:
            raise UnreachableImpedanceError(
                f"{name} = {value:g} cannot be asked for",
                "give a finite number, 0 or more",
                settings=[name],
            )
    return Gains(K_d / p.n_T**2, B_d / p.n_T**2, cancels_friction=False)


def select_gains(
    controller: str, K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight = PAPER_WEIGHT
) -> Gains:
    """Find the gains of a trial.

    Parameters
    ----------
    controller : str
        `compensated` or `uncompensated`.
    K_d, B_d : float
        [N*m/rad] and [N*m*s/rad].
    p : DrivetrainParameters
    weight : Weight
        W of Eq. 14.

    Returns
    -------
    Gains

    Raises
    ------
    InputError
        Another controller; or as `compensated_gains`.
    """
    if controller not in CONTROLLERS:
        raise InputError(
            f"the gains of controller '{controller}' are not"
            f" known{nearest(controller, CONTROLLERS)}",
            f"write one of {', '.join(CONTROLLERS)}",
        )
    if controller == "uncompensated":
        return uncompensated_gains(K_d, B_d, p)
    return compensated_gains(K_d, B_d, p, weight)


def optimal_damping(
    K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight
) -> OptimalDamping:
    """Minimise ||W (Y - Y_d)||_2 over B_1 with B_m + B_1 > 0 (Eq. 14).

    Parameters
    ----------
    K_d, B_d : float
        [N*m/rad] and [N*m*s/rad].
    p : DrivetrainParameters
    weight : Weight
        W.

    Returns
    -------
    OptimalDamping

    Raises
    ------
    UnreachableImpedanceError
        As `check_request`.
    """
    check_request(K_d, B_d, p)
    K_1 = float(stiffness_gain(K_d, p))
    W = scipy.signal.butter(weight.order, 2 * np.pi * weight.cutoff_hz, analog=True)
    polynomials = admittance_error(K_d, B_d, K_1, p, W)[..., None]
    scale = np.sqrt(K_1 * p.J_m)
    x = scale * np.geomspace(SMALLEST_PARAMETER, LARGEST_PARAMETER, POINTS)
    _, slope = squared_norm(x, polynomials)

    def slope_at(x: float) -> float:
        return float(squared_norm(np.array([x]), polynomials)[1][0])

    # candidates are the minima in their brackets, then the two ends of the search
    is_bracket = (slope[:-1] < 0) & (slope[1:] >= 0)
    minima = [
        scipy.optimize.brentq(
            slope_at, x[k], x[k + 1], xtol=SMALLEST_PARAMETER * x[k], rtol=ROUNDING
        )
        for k in np.flatnonzero(is_bracket)
    ]
    candidates = np.array([*minima, x[0], x[-1]])
    norms, _ = squared_norm(candidates, polynomials)
    best = int(np.argmin(norms))
    unbounded = best == len(minima) + 1
    return OptimalDamping(
        B_1=np.inf if unbounded else float(candidates[best] - p.B_m),
        error=float(np.sqrt(norms[best])),
        at_lower_bound=best == len(minima),
        unbounded=unbounded,
    )


def admittance_error(
    K_d: float, B_d: float, K_1: float, p: DrivetrainParameters, W: tuple[Array, Array]
) -> Array:
    """Expand W (Y - Y_d) = b/a of a pair K_d [N*m/rad], B_d [N*m*s/rad] with the gain K_1; W is the
    weight's numerator, a constant, and denominator.

    N Q - D is computed as N (Q - P) + c, so that no nearly equal numbers are subtracted; by Eq. 12
    its constant term is exactly 0.

    Returns
    -------
    Array (4, n + 1)
        Coefficients in s [rad/s] of a0, a1, b0 and b1, where a = a0 + x a1 and b = b0 + x b1;
        highest power first, with zeros as missing higher powers.
    """
    gain, W_den = W
    # N = N0 + x N1
    N0 = [p.J_m, 0.0, K_1 + p.K_s_at_actuator]
    N1 = [1.0, 0.0]
    P = [p.B_j, p.K_s]
    Q = [B_d, K_d]
    Q_minus_P = np.subtract(Q, P)
    D0 = np.convolve(N0, P)
    b0 = np.convolve(N0, Q_minus_P)
    D0[-1] = K_1 * p.K_s  # kappa K_s - c
    b0[-1] = 0.0  # kappa (K_d - K_s) + c = 0 (Eq. 12)

    W_den_Q = np.convolve(Q, W_den)
    a0 = np.convolve(D0, W_den_Q)
    a1 = np.convolve(np.convolve(N1, P), W_den_Q)
    b1 = np.convolve(N1, Q_minus_P)
    parts = (a0, a1, gain * b0, gain * b1)
    return np.array([np.pad(part, (len(a0) - len(part), 0)) for part in parts])


def squared_norm(x: Array, polynomials: Array) -> tuple[Array, Array]:
    """||b/a||^2 [(rad/(N*m))^2/s] at x [N*m*s/rad], and its derivative in x, by the coefficients of
    `admittance_error`, whose further dimensions broadcast with x.

    Each row of the recursion loses its first coefficient, and every second one of those that stay
    is reduced. A row's part of the sum, beta^2/(2 alpha), is 0 where beta is 0, even if alpha is 0
    too (B_d = 0).
    """
    a0, a1, b0, b1 = polynomials
    a = a0 + x * a1
    b = (b0 + x * b1)[1:]  # its first coefficient is 0
    da = a1 + np.zeros_like(a)
    db = b1[1:] + np.zeros_like(b)
    total = np.zeros_like(x)
    slope = np.zeros_like(x)
    n = len(b)
    for r in range(n):
        next_a = a[r + 1]
        alpha = a[r] / next_a
        beta = b[r] / next_a
        dalpha = (da[r] - alpha * da[r + 1]) / next_a
        dbeta = (db[r] - beta * da[r + 1]) / next_a
        twice_alpha = 2 * np.where(beta == 0, 1.0, alpha)
        part = beta * beta / twice_alpha
        total += part
        slope += 2 * (beta * dbeta - part * dalpha) / twice_alpha
        reduced = slice(r + 2, n, 2)
        c = a[r + 3 :: 2]
        dc = da[r + 3 :: 2]
        a[reduced] -= alpha * c
        b[reduced] -= beta * c
        da[reduced] -= dalpha * c + alpha * dc
        db[reduced] -= dbeta * c + beta * dc
    return total, slope
