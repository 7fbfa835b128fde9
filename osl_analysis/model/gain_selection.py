"""The damping gain that minimises Eq. 14, for many pairs of a desired stiffness and damping at once.

In the letters of `drivetrain.joint_admittance`, with Q = B_d s + K_d and K_1 from Eq. 13,

    W (Y - Y_d) = b(s; x)/a(s; x),   a = W_den D Q,   b = W_num (N Q - D).

Both are affine in x = B_m + B_1. Astrom's recursion (Introduction to Stochastic Control Theory, 1970, ch. 5) turns the
squared norm into a sum over the rows of a's Routh table, so that its slope in x is exact. Its changes of sign on a
logarithmic grid bracket the minima, of which docs/gain_selection.md says how many there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.trial import Array

HIGHEST_ORDER_OF_W = 10
SLOWEST_HZ, FASTEST_HZ = 1e-3, 1e4
"""Lowest and highest accepted cut-off of W [Hz]. Both lie far outside the frequencies at which a leg moves."""


@dataclass(frozen=True)
class Weight:
    """W of Eq. 14: a Butterworth low-pass of the given cut-off [Hz] and order (the paper's: 1 Hz = 2 pi rad/s, 3).
    Raises UnreachableImpedanceError outside of 0.001 to 10000 Hz, or of orders 1 to 10."""

    cutoff_hz: float
    order: int

    def __post_init__(self) -> None:
        if self.order not in range(1, HIGHEST_ORDER_OF_W + 1):
            raise UnreachableImpedanceError(
                f"the weight W of Eq. 14 has order {self.order}; use a whole number from 1 to {HIGHEST_ORDER_OF_W}"
            )
        if not SLOWEST_HZ <= self.cutoff_hz <= FASTEST_HZ:
            raise UnreachableImpedanceError(
                f"the weight W has its cut-off at {self.cutoff_hz:g} Hz; use {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz"
            )


def optimal_damping(
    K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0
) -> dict[str, Array]:
    """Minimise ||W (Y - Y_d)||_2 over B_1 with B_m + B_1 > 0 (Eq. 14), for K_d, B_d of shape (pairs,): of each pair,

    B_1: damping gain [N*m*s/rad] at the global minimum.
    error: the norm there [rad/(N*m)/s^1/2].
    minima: number of stable local minima.
    at_lower_bound: the error falls towards B_m + B_1 = 0, so that the joint alone damps more than was asked for. `B_1`
        is then the last stable value of the search.
    unbounded: the error falls for every increase of B_1: a locked motor would be best. `B_1` is then infinite.

    The paper neglects the joint's inertia; `J_j` [kg*m^2] includes it. `compensator.check_request` refuses impossible
    requests. The search for x = B_m + B_1 spans 1e-9 to 1e9 times (K_1 J_m)^1/2, the scale of the actuator's damping,
    in points a factor of 1.8 apart. The closest two minima that were found are a factor of 4 apart.
    """
    from scipy.optimize.elementwise import find_root  # 0.2 s, for the few that select gains

    K_d, B_d = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (K_d, B_d)))
    polynomials = admittance_error(K_d, B_d, p, weight, J_j)
    scale, points = np.sqrt(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)) * p.J_m), 73
    x = scale[:, None] * np.geomspace(1e-9, 1e9, points)
    J, slope = squared_norm(x, *([c[:, None] for c in each] for each in polynomials))
    falls = (slope[:, :-1] < 0) & (slope[:, 1:] >= 0)
    pair, k = np.nonzero(falls)
    own = [[c[pair] for c in each] for each in polynomials]
    sizes = np.cumsum([len(each) for each in own])[:-1]

    def slope_at(at: Array, *coefficients: Array) -> Array:
        """The slope by pair; scipy leaves out the pairs that have converged."""
        parts = [[coefficients[i] for i in part] for part in np.split(np.arange(len(coefficients)), sizes)]
        return squared_norm(at, *parts)[1]

    candidates, norms = np.full((2, len(x), points + 1), np.inf)
    candidates[pair, k] = find_root(slope_at, (x[pair, k], x[pair, k + 1]), args=tuple(c for e in own for c in e)).x
    norms[pair, k] = squared_norm(candidates[pair, k], *own)[0]
    candidates[:, -2:], norms[:, -2:] = x[:, [0, -1]], J[:, [0, -1]]
    best = np.argmin(norms, axis=1)  # of the minima, and the two ends of the search
    lowest, unbounded = (np.arange(len(x)), best), best == points
    return {
        "B_1": np.where(unbounded, np.inf, candidates[lowest] - p.B_m),
        "error": np.sqrt(norms[lowest]),
        "minima": falls.sum(axis=1),
        "at_lower_bound": best == points - 1,
        "unbounded": unbounded,
    }


def admittance_error(
    K_d: Array, B_d: Array, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0
) -> list[list[Array]]:
    """The coefficients a0, a1, b0, b1 of the polynomials a = a0 + x a1 and b = b0 + x b1 in s [rad/s], highest power
    first, of every pair K_d [N*m/rad], B_d [N*m*s/rad], shape (pairs,). N Q - D is computed as N (Q - P) + c, so that
    no nearly equal numbers are subtracted; by Eq. 12 its constant term is exactly 0."""
    K_1 = K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d))
    gain, W = scipy.signal.butter(weight.order, 2 * np.pi * weight.cutoff_hz, analog=True)
    zero, one = np.zeros_like(K_d), np.ones_like(K_d)
    N0, N1 = [p.J_m * one, zero, K_1 + p.K_s / p.n_T**2], [one, zero]  # N = N0 + x N1
    P = [J_j * one] * bool(J_j) + [p.B_j * one, p.K_s * one]
    Q = [zero] * bool(J_j) + [B_d, K_d]
    difference = [q - j for q, j in zip(Q, P, strict=True)]
    D0, b0 = polynomial_product(N0, P), polynomial_product(N0, difference)
    D0[-1], b0[-1] = K_1 * p.K_s, zero  # kappa K_s - c, and kappa (K_d - K_s) + c = 0 (Eq. 12)
    fixed = polynomial_product([B_d, K_d], [w * one for w in W])
    a0 = polynomial_product(D0, fixed)
    a1 = polynomial_product(polynomial_product(N1, P), fixed)
    b1 = polynomial_product(N1, difference)

    numerator = [[gain[-1] * one for one in b] for b in (b0, b1)]
    lengths = (len(a0), len(a0), len(a0) - 1, len(a0) - 1)  # with zeros as missing higher powers
    return [[zero] * (n - len(c)) + c for n, c in zip(lengths, (a0, a1, *numerator), strict=True)]


def polynomial_product(u: Sequence[Array], v: Sequence[Array]) -> list[Array]:
    """Product of two polynomials whose coefficients are arrays."""
    out = [np.zeros_like(u[0])] * (len(u) + len(v) - 1)
    for i, ui in enumerate(u):
        for j, vj in enumerate(v):
            out[i + j] = out[i + j] + ui * vj
    return out


def squared_norm(
    x: Array, a0: Sequence[Array], a1: Sequence[Array], b0: Sequence[Array], b1: Sequence[Array]
) -> tuple[Array, Array]:
    """||b/a||^2 [(rad/(N*m))^2/s] at x [N*m*s/rad], and its derivative in x; coefficients broadcast with x. Each row of
    the recursion loses its first coefficient, and every second one of those that stay is reduced. A row's part of the
    sum, beta^2/(2 alpha), is 0 where beta is 0, even if alpha is 0 too (B_d = 0)."""
    a, da = [c + x * d for c, d in zip(a0, a1, strict=True)], list(a1)
    b, db = [c + x * d for c, d in zip(b0, b1, strict=True)], list(b1)
    n, total, slope = len(b), np.zeros_like(x), np.zeros_like(x)
    for r in range(n):
        alpha, beta = a[r] / a[r + 1], b[r] / a[r + 1]
        dalpha, dbeta = (da[r] - alpha * da[r + 1]) / a[r + 1], (db[r] - beta * da[r + 1]) / a[r + 1]
        twice = 2 * np.where(beta == 0, 1.0, alpha)
        part = beta * beta / twice
        total, slope = total + part, slope + 2 * (beta * dbeta - part * dalpha) / twice
        for i in range(r + 2, n, 2):
            c, dc = a[i + 1], da[i + 1]
            a[i], da[i] = a[i] - alpha * c, da[i] - (dalpha * c + alpha * dc)
            b[i], db[i] = b[i] - beta * c, db[i] - (dbeta * c + beta * dc)
    return total, slope
