"""The interval of estimates by least squares, for any motion: how the same motion again would
scatter them, with other noise.

Least squares x = A^-1 b is of sums A and b over groups of rows. What a group adds to the error is
told in one of two ways, and both parts add where a recording has both:

* *Groups that repeat one another*, cycles of a sine or periods of a motion: by their spread
  (`between_cycles`). It holds noise alone, since what Eq. 15 misses is the same in each of them.
* *Groups that do not*, seconds of any other motion: by leaving out one at a time (`left_out`). It
  holds what Eq. 15 misses from second to second, too, which no recording tells from noise there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.stats.linear_fit import (
    SMALLEST_DIRECTION,
    between_cycles,
    welch_satterthwaite,
)
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Scatter:
    """Covariance (p, p) of estimates, and the degrees of freedom (p,) of their variances."""

    covariance: Array
    freedom: Array

    def __add__(self, other: "Scatter") -> "Scatter":
        """The scatter by two independent parts of a recording."""
        variances = np.array([np.diag(self.covariance), np.diag(other.covariance)])
        freedom = welch_satterthwaite(variances, np.array([self.freedom, other.freedom]))
        return Scatter(self.covariance + other.covariance, freedom)


def no_scatter(p: int) -> Scatter:
    """The scatter of p estimates by no groups."""
    return Scatter(np.zeros((p, p)), np.full(p, np.inf))


def spread(scores: Array, stratum: NDArray[np.intp]) -> Scatter:
    """The scatter by groups that repeat one another.

    Parameters
    ----------
    scores : Array (m, p)
        By how much the noise of each group moves the estimates.
    stratum : Array (m,)
        Which groups repeat one another, two or more; rising.
    """
    if not len(scores):
        return no_scatter(scores.shape[1])
    number = np.unique(stratum, return_inverse=True)[1]
    return Scatter(*between_cycles(scores, number))


def left_out(A: Array, b: Array, A_g: Array, b_g: Array, groups: int) -> Scatter:
    """The scatter by groups that do not repeat one another, each left out in turn.

    It is the cluster jackknife CV3 of MacKinnon, Nielsen and Webb (J. Appl. Econometrics 38, 2023)
    with the degrees of freedom of Bell and McCaffrey (Survey Methodology 28, 2002). With
    u_g = (A - A_g)^-1 (b - b_g) - x,

        V = (n - 1)/n sum u_g u_g'.

    If the rows had independent errors, the u_g of estimate k would have covariances
    C_gg = d_g[k] and C_gh = -d_g' A d_h, where d_g is column k of (A - A_g)^-1 - A^-1, so that V_k
    is distributed as a chi-square of (sum C_gg)^2 / (sum C_gg^2 + sum C_gh^2) freedoms.

    Parameters
    ----------
    A : Array (p, p)
        Normal equations of all rows.
    b : Array (p,)
        Products of all rows with the torque.
    A_g : Array (m, p, p)
        Normal equations of each group.
    b_g : Array (m, p)
        Its products with the torque.
    groups : int
        Number n of all groups, with those that repeat one another.
    """
    if not len(A_g):
        return no_scatter(len(b))
    scale = np.sqrt(np.diag(A))
    units = np.outer(scale, scale)
    # without a group the rest may tell nothing: the interval is then very wide
    ridge = SMALLEST_DIRECTION * np.eye(len(A))
    inverse = np.linalg.inv(A / units + ridge) / units
    without = np.linalg.inv((A - A_g) / units + ridge) / units
    u = np.einsum("gij,gj->gi", without, b - b_g) - inverse @ b

    d = without - inverse
    own = np.einsum("gkk->gk", d)
    # sum of squares of d_g' A d_h over all g and h, from p x p matrices, less those of g = h
    root = np.linalg.cholesky(A / units + ridge).T * scale
    e = np.einsum("ij,gjk->gik", root, d)
    inner = np.einsum("gik,gjk->kij", e, e)
    of_pairs = np.sum(inner**2, axis=(1, 2)) - np.sum(np.sum(e**2, axis=1) ** 2, axis=0)
    sum_of_squares = np.sum(own**2, axis=0) + of_pairs
    freedom = np.sum(own, axis=0) ** 2 / np.maximum(sum_of_squares, np.finfo(float).tiny)
    return Scatter((groups - 1) / groups * u.T @ u, freedom)
