"""The damping gain that minimises Eq. 14, for many pairs at once: all local minima are found, the lowest is taken."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.model.admittance_error import AdmittanceError, Weight, admittance_error
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

LOWEST, HIGHEST = 1e-9, 1e9
"""Ends of the search for x = B_m + B_1, as multiples of (K_1 J_m)^1/2, the scale of the actuator's damping."""
POINTS = 73
"""Points of the search, a factor of 1.8 apart. `certificate.py` counts the minima without a grid."""
REFINEMENTS = 60
"""Largest number of Newton steps."""
PAIRS_AT_ONCE = 2000
"""Largest number of pairs that are computed together, which limits the memory."""


@dataclass(frozen=True)
class OptimalDamping:
    """The best damping gain of each pair, shape (pairs,) each.

    Attributes
    ----------
    B_1
        Damping gain [N*m*s/rad] at the global minimum of Eq. 14.
    error
        The norm of Eq. 14 there [rad/(N*m)/s^1/2].
    minima
        Number of stable local minima.
    at_lower_bound
        The error falls towards B_m + B_1 = 0: the joint alone damps more than was asked for. `B_1` is then the last
        stable value of the search.
    unbounded
        The error decreases for every increase of B_1: a locked motor would be best. `B_1` is then infinite.
    """

    B_1: Array
    error: Array
    minima: NDArray[np.int64]
    at_lower_bound: NDArray[np.bool_]
    unbounded: NDArray[np.bool_]


def optimal_damping(
    K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0
) -> OptimalDamping:
    """Minimise ||W (Y - Y_d)||_2 over B_1 with B_m + B_1 > 0 (Eq. 14), for K_d, B_d of shape (pairs,).

    The slope of the squared norm is exact (`admittance_error`). Its changes of sign on a logarithmic grid bracket the
    stationary points. Newton's method within each bracket refines them to rounding. The function does not check the
    requests; `compensator.check_request` refuses impossible ones.
    """
    K_d, B_d = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (K_d, B_d)))
    error = admittance_error(K_d, B_d, p, weight, J_j)
    scale = np.sqrt(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)) * p.J_m)
    blocks = [slice(i, i + PAIRS_AT_ONCE) for i in range(0, len(K_d), PAIRS_AT_ONCE)]
    best = [best_of(error.pairs(block), scale[block]) for block in blocks]
    x, J, minima, end = (np.concatenate(parts) for parts in zip(*best, strict=True))
    unbounded = end > 0
    return OptimalDamping(np.where(unbounded, np.inf, x - p.B_m), np.sqrt(J), minima, end < 0, unbounded)


def best_of(error: AdmittanceError, scale: Array) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
    """x = B_m + B_1 of the lowest squared norm J, J itself, the number of minima, and the end of the search at x.

    The last is -1 if x is the lower end, 1 if it is the upper end, and 0 otherwise.
    """
    grid = np.geomspace(LOWEST, HIGHEST, POINTS)
    slopes = np.array([error.squared(scale * g).slope for g in grid])
    k, pair = np.nonzero((slopes[:-1] < 0) & (slopes[1:] >= 0))
    x = refined(error.pairs(pair), scale[pair] * grid[k], scale[pair] * grid[k + 1])
    J = error.pairs(pair).squared(x).value
    lower, upper = scale * LOWEST, scale * HIGHEST
    candidates = [(lower, error.squared(lower).value, -1), (upper, error.squared(upper).value, 1)]
    best_x, best_J, end = lower, np.full_like(scale, np.inf), np.zeros(len(scale), dtype=np.int64)
    order = np.argsort(-J, kind="stable")
    best_x = best_x.copy()
    best_x[pair[order]], best_J[pair[order]] = x[order], J[order]
    for at, value, side in candidates:
        better = value < best_J
        best_x, best_J, end = np.where(better, at, best_x), np.where(better, value, best_J), np.where(better, side, end)
    return best_x, best_J, np.bincount(pair, minlength=len(scale)), end


def refined(error: AdmittanceError, low: Array, high: Array) -> Array:
    """The root of the slope between `low` (slope < 0) and `high`: Newton's method in log x.

    A step that would leave the bracket is replaced by a bisection.
    """
    x = np.sqrt(low * high)
    for _ in range(REFINEMENTS):
        J = error.squared(x)
        below = J.slope < 0
        low, high = np.where(below, x, low), np.where(below, high, x)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = x * np.exp(-J.slope / (J.slope + x * J.curvature))
        inside = (step > low) & (step < high)
        following = np.where(inside, step, np.sqrt(low * high))
        if np.array_equal(following, x) or (np.abs(following - x) <= 4e-16 * x).all():
            break
        x = following
    return x
