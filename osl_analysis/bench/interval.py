# SPDX-License-Identifier: Apache-2.0
"""The interval of estimates by least squares, for any motion: how the same motion again would
scatter them, with other noise.

Least squares x = A^-1 b is of sums A and b over groups of rows, which tell its error in one of two
ways:

* *Groups that repeat one another*, cycles of a sine or periods of a motion: by their spread
  (`spread`). It holds noise alone, since what Eq. 15 misses is the same in each of them.
* *Groups that do not*, seconds of any other motion: by leaving out one at a time (`left_out`). It
  holds what Eq. 15 misses from second to second, too, which no recording tells from noise there.
"""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.trial import Array
from osl_analysis.stats.linear_fit import SMALLEST_DIRECTION, between_cycles


def spread(
    noise_g: Array,
    A_g: Array,
    inverse: Array,
    stratum: NDArray[np.intp],
    repeat: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """The scatter by groups that repeat one another.

    A group that repeats no other, as the one settled cycle of a sine, is taken to scatter as the
    others do: by the share that its columns have in what white noise of the torque does to each
    estimate.

    Parameters
    ----------
    noise_g : Array (m, p)
        Products of the columns with the residual of the torque, in each group.
    A_g : Array (m, p, p)
        Products of the columns in each group.
    inverse : Array (p, p)
        Of the normal equations of all groups.
    stratum : Array (m,)
        Which groups repeat one another; rising.
    repeat : Array (m,)
        Which repeat any.

    Returns
    -------
    covariance : Array (p, p)
        Of the estimates.
    freedom : Array (p,)
        Degrees of freedom of its variances.
    """
    number = np.unique(stratum[repeat], return_inverse=True)[1]
    covariance, freedom = between_cycles(noise_g[repeat] @ inverse, number)
    of_repeats, of_all = (
        np.diag(inverse @ groups.sum(axis=0) @ inverse) for groups in (A_g[repeat], A_g)
    )
    more = np.sqrt(of_all / of_repeats)
    return covariance * np.outer(more, more), freedom


def left_out(A: Array, b: Array, A_g: Array, b_g: Array) -> tuple[Array, Array]:
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
    A_g : Array (n, p, p)
        Normal equations of each group.
    b_g : Array (n, p)
        Its products with the torque.

    Returns
    -------
    covariance, freedom
        As `spread`.
    """
    n = len(A_g)
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
    return (n - 1) / n * u.T @ u, freedom
