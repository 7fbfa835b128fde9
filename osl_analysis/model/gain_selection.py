"""The damping gain that minimises Eq. 14, for many pairs at once: all local minima are found, the lowest is taken."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.model.admittance_error import Weight, admittance_error
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

LOWEST, HIGHEST = 1e-9, 1e9
"""Ends of the search for x = B_m + B_1, as multiples of (K_1 J_m)^1/2, the scale of the actuator's damping."""
POINTS = 73
"""Points of the search, a factor of 1.8 apart. `certificate.py` counts the minima without a grid."""


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
    from osl_analysis.model.gain_kernel import lowest_minima  # numba, which few of those that import this module need

    K_d, B_d = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (K_d, B_d)))
    error = admittance_error(K_d, B_d, p, weight, J_j)
    scale = np.sqrt(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)) * p.J_m)
    points = scale[:, None] * np.geomspace(LOWEST, HIGHEST, POINTS)
    x, J, minima, end = lowest_minima(*error.by_pair(), points)
    unbounded = end > 0
    return OptimalDamping(np.where(unbounded, np.inf, x - p.B_m), np.sqrt(J), minima, end < 0, unbounded)
