"""The compiled recursion of `admittance_error`, and the search of `gain_selection` for the minima of one pair.

All compiled functions are in this file, because numba's disk cache does not notice changes of functions in other files.
"""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.compiled import compiled
from osl_analysis.trial import Array

REFINEMENTS = 60
"""Largest number of Newton steps."""
ROUNDING = 4e-16
"""Relative size of a Newton step that is none."""


@compiled
def squared_norm(a0: Array, a1: Array, b0: Array, b1: Array, x: float, work: Array) -> tuple[float, float, float]:
    """The sum of Astrom's recursion for a = a0 + x a1, (n + 1,), and b = b0 + x b1, (n,), with two derivatives in x.

    Each row loses its first coefficient. Every second one of those that stay is reduced. A row's part of the sum is
    beta^2/(2 alpha); it is 0 where beta is 0, even if alpha is 0 too (B_d = 0). `work` is (6, n + 1), for the values,
    slopes and curvatures of a and b.
    """
    n = len(b0)
    a, da, dda, b, db, ddb = work[0], work[1], work[2], work[3], work[4], work[5]
    for i in range(n + 1):
        a[i], da[i], dda[i] = a0[i] + x * a1[i], a1[i], 0.0
    for i in range(n):
        b[i], db[i], ddb[i] = b0[i] + x * b1[i], b1[i], 0.0
    total, slope, curvature = 0.0, 0.0, 0.0
    for r in range(n):
        by, dby, ddby = a[r + 1], da[r + 1], dda[r + 1]
        alpha = a[r] / by
        dalpha = (da[r] - alpha * dby) / by
        ddalpha = (dda[r] - 2.0 * dalpha * dby - alpha * ddby) / by
        beta = b[r] / by
        dbeta = (db[r] - beta * dby) / by
        ddbeta = (ddb[r] - 2.0 * dbeta * dby - beta * ddby) / by
        twice, dtwice, ddtwice = 2.0 * (1.0 if beta == 0.0 else alpha), 2.0 * dalpha, 2.0 * ddalpha
        part = beta * beta / twice
        dpart = (2.0 * beta * dbeta - part * dtwice) / twice
        ddpart = (2.0 * (beta * ddbeta + dbeta * dbeta) - 2.0 * dpart * dtwice - part * ddtwice) / twice
        total, slope, curvature = total + part, slope + dpart, curvature + ddpart
        for i in range(r + 2, n, 2):
            c, dc, ddc = a[i + 1], da[i + 1], dda[i + 1]
            a[i] -= alpha * c
            da[i] -= dalpha * c + alpha * dc
            dda[i] -= ddalpha * c + 2.0 * dalpha * dc + alpha * ddc
            b[i] -= beta * c
            db[i] -= dbeta * c + beta * dc
            ddb[i] -= ddbeta * c + 2.0 * dbeta * dc + beta * ddc
    return total, slope, curvature


@compiled
def squared_norms(a0: Array, a1: Array, b0: Array, b1: Array, x: Array) -> tuple[Array, Array, Array]:
    """`squared_norm` of every pair, whose coefficients are (pairs, n + 1) and (pairs, n), at an x of its own."""
    value, slope, curvature, work = np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty((6, a0.shape[1]))
    for i in range(len(x)):
        value[i], slope[i], curvature[i] = squared_norm(a0[i], a1[i], b0[i], b1[i], x[i], work)
    return value, slope, curvature


@compiled
def slopes(a0: Array, a1: Array, b0: Array, b1: Array, x: Array, work: Array) -> Array:
    """The slope of `squared_norm` at every x, (m,). `work` is (4, n + 1, m)."""
    n, m = len(b0), len(x)
    a, da, b, db = work[0], work[1], work[2], work[3]
    for i in range(n + 1):
        for k in range(m):
            a[i, k], da[i, k] = a0[i] + x[k] * a1[i], a1[i]
    for i in range(n):
        for k in range(m):
            b[i, k], db[i, k] = b0[i] + x[k] * b1[i], b1[i]
    slope, alpha, dalpha, beta, dbeta = np.zeros(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    for r in range(n):
        for k in range(m):
            by, dby = a[r + 1, k], da[r + 1, k]
            alpha[k] = a[r, k] / by
            dalpha[k] = (da[r, k] - alpha[k] * dby) / by
            beta[k] = b[r, k] / by
            dbeta[k] = (db[r, k] - beta[k] * dby) / by
            twice = 2.0 * (1.0 if beta[k] == 0.0 else alpha[k])
            slope[k] += (2.0 * beta[k] * dbeta[k] - beta[k] * beta[k] / twice * 2.0 * dalpha[k]) / twice
        for i in range(r + 2, n, 2):
            for k in range(m):
                c, dc = a[i + 1, k], da[i + 1, k]
                a[i, k] -= alpha[k] * c
                da[i, k] -= dalpha[k] * c + alpha[k] * dc
                b[i, k] -= beta[k] * c
                db[i, k] -= dbeta[k] * c + beta[k] * dc
    return slope


@compiled
def refined(a0: Array, a1: Array, b0: Array, b1: Array, low: float, high: float, work: Array) -> float:
    """The root of the slope between `low` (slope < 0) and `high`: Newton's method in log x.

    A step that would leave the bracket is replaced by a bisection.
    """
    x = np.sqrt(low * high)
    for _ in range(REFINEMENTS):
        _, slope, curvature = squared_norm(a0, a1, b0, b1, x, work)
        if slope < 0.0:
            low = x
        else:
            high = x
        following = x * np.exp(-slope / (slope + x * curvature))
        if not low < following < high:
            following = np.sqrt(low * high)
        if abs(following - x) <= ROUNDING * x:
            break
        x = following
    return float(x)


@compiled
def lowest_minima(
    a0: Array, a1: Array, b0: Array, b1: Array, x: Array
) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
    """For each pair the x of the lowest squared norm, the squared norm there, the number of minima, and the end at x.

    The coefficients are (pairs, n + 1) and (pairs, n), the points of the search `x` (pairs, m). Changes of sign of the
    slope between two points bracket the minima. The last result is -1 if x is the first point, 1 if it is the last one,
    and 0 otherwise.
    """
    pairs, m = x.shape
    best, lowest = x[:, 0].copy(), np.full(pairs, np.inf)
    minima, end = np.zeros(pairs, np.int64), np.zeros(pairs, np.int64)
    work, many = np.empty((6, a0.shape[1])), np.empty((4, a0.shape[1], m))
    for i in range(pairs):
        slope = slopes(a0[i], a1[i], b0[i], b1[i], x[i], many)
        for k in range(m - 1):
            if slope[k] < 0.0 and slope[k + 1] >= 0.0:
                minima[i] += 1
                here = refined(a0[i], a1[i], b0[i], b1[i], x[i, k], x[i, k + 1], work)
                norm, _, _ = squared_norm(a0[i], a1[i], b0[i], b1[i], here, work)
                if norm < lowest[i]:
                    best[i], lowest[i] = here, norm
        for side, k in ((-1, 0), (1, m - 1)):
            norm, _, _ = squared_norm(a0[i], a1[i], b0[i], b1[i], x[i, k], work)
            if norm < lowest[i]:
                best[i], lowest[i], end[i] = x[i, k], norm, side
    return best, lowest, minima, end
