"""The cubic spline through samples at rising times, evaluated at other rising times.

`scipy.interpolate.CubicSpline` gives the same values. It takes five times as long and ten times the memory: it keeps
four coefficients per sample, and seeks the place of every time anew.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.trial import Array

AT_ONCE = 1 << 16
"""Rows of the grid that are computed at a time."""
NEAR = 50
"""Samples by which the spline is known at an end: what lies farther has a weight below 2^-50, or 0.27^50 where steps
are even."""


def cubic_between(times: Array, values: Array, at: Array, before: NDArray[np.intp]) -> Array:
    """Values (m, signals) at rising times `at` (m,) [s] of the cubics through values (k, signals) at `times` (k,) [s].

    `before` (m,) is the row of the sample at or before each of these times, k - 2 at most. At both ends the first two
    cubics are one (not-a-knot). Four samples at least.
    """
    curved = curvatures(times, np.diff(times), values)
    found = np.empty((values.shape[1], len(at)))
    for first in range(0, len(at), AT_ONCE):  # what a row needs meanwhile is ten times what it leaves
        rows = slice(first, first + AT_ONCE)
        found[:, rows] = between(times, values, curved, at[rows], before[rows])
    return found.T


def between(times: Array, values: Array, curved: Array, at: Array, before: NDArray[np.intp]) -> Array:
    """Values (signals, m) of `cubic_between`, of the cubics with these second derivatives (k, signals) at samples."""
    length = times[before + 1] - times[before]
    share = (at - times[before]) / length
    rest = 1 - share
    bend = -share * rest * length**2 / 6
    found = np.empty((values.shape[1], len(at)))
    for k, (y, curvature) in enumerate(zip(values.T, curved.T, strict=True)):
        line = rest * y[before] + share * y[before + 1]
        found[k] = line + bend * ((1 + rest) * curvature[before] + (1 + share) * curvature[before + 1])
    return found


def curvatures(times: Array, step: Array, values: Array) -> Array:
    """Second derivatives (k, signals) at the samples (k, signals), which lie `step` (k - 1,) [s] apart.

    Those at the ends come from the samples near them. Between, h_i-1 M_i-1 + 2 (h_i-1 + h_i) M_i + h_i M_i+1 is six
    times the change of the slope (de Boor, A Practical Guide to Splines, 1978, ch. IV): a symmetric system.
    """
    found = np.empty_like(values)
    found[0] = scipy.interpolate.CubicSpline(times[:NEAR], values[:NEAR])(times[0], 2)
    found[-1] = scipy.interpolate.CubicSpline(times[-NEAR:], values[-NEAR:])(times[-1], 2)
    slope = np.diff(values, axis=0)
    slope /= step[:, None]
    change = np.diff(slope, axis=0)
    del slope
    change *= 6
    change[0] -= step[0] * found[0]
    change[-1] -= step[-1] * found[-1]
    diagonal = step[:-1] + step[1:]
    diagonal *= 2
    found[1:-1] = scipy.linalg.lapack.dptsv(diagonal, step[1:-1], change, overwrite_d=True, overwrite_b=True)[2]
    return found
