"""The cubic spline through samples at rising times, evaluated at other rising times.

`scipy.interpolate.CubicSpline` gives the same values. It takes many times as long and ten times the memory: it keeps
four coefficients per sample, and seeks the place of every time anew.
"""

from collections.abc import Callable, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.pieces import pieces
from osl_analysis.trial import Array

Before = Callable[[Array], NDArray[np.intp]]
"""Row of the sample at or before each of some rising times, the last but one at most."""
Measure = Callable[[Array], None]
"""What is told the distances [s] of some times to their nearest samples."""
NEAR = 50
"""Samples by which the spline is known at an end: what lies farther has a weight below 2^-50, or 0.27^50 where steps
are even."""


def cubic_between(
    times: Array, signals: Sequence[Array], at: Array, before: Before, measure: Measure | None = None
) -> list[Array]:
    """Values (m,) of each signal at rising times `at` (m,) [s], of the cubics through its samples (k,) at `times` (k,).

    At both ends the first two cubics are one (not-a-knot); nothing is extrapolated. Four samples at least. The spline
    is found piece by piece, each with `NEAR` samples more on either side.
    """
    found = [np.empty(len(at)) for _ in signals]
    for rows in pieces(len(at)):
        some = at[rows]
        if some[0] < times[0] or some[-1] > times[-1]:
            some = np.clip(some, times[0], times[-1])
        row = before(some)
        known = slice(max(int(row[0]) - NEAR, 0), min(int(row[-1]) + 2 + NEAR, len(times)))
        ends = known.start == 0, known.stop == len(times)
        values = np.array([signal[known] for signal in signals])
        curved = curvatures(times[known], values, ends)
        left = times.take(row)
        length, passed = times.take(row + 1) - left, some - left
        if measure:
            measure(np.minimum(passed, length - passed))
        for one, piece in zip(found, between(values, curved, passed, length, row - known.start), strict=True):
            one[rows] = piece
    return found


def between(values: Array, curved: Array, passed: Array, length: Array, before: NDArray[np.intp]) -> list[Array]:
    """Values (m,) of each of the signals (signals, k) behind samples `before` (m,), by their second derivatives there.

    `passed` (m,) [s] is the time since that sample, `length` (m,) [s] the one from it to the next.
    """
    behind = before + 1
    share = passed / length
    rest = 1 - share
    bend = -share * rest * length**2 / 6
    return [
        rest * y.take(before)
        + share * y.take(behind)
        + bend * ((1 + rest) * c.take(before) + (1 + share) * c.take(behind))
        for y, c in zip(values, curved, strict=True)
    ]


def curvatures(times: Array, values: Array, ends: tuple[bool, bool]) -> Array:
    """Second derivatives (signals, k) at the samples (signals, k) at rising times (k,) [s].

    Those at an end of the record come from the samples near it; at an end of a piece they are 0, which is forgotten
    within `NEAR` samples. Between, h_i-1 M_i-1 + 2 (h_i-1 + h_i) M_i + h_i M_i+1 is six times the change of the slope
    (de Boor, A Practical Guide to Splines, 1978, ch. IV): a symmetric system.
    """
    found, step = np.zeros_like(values), np.diff(times)
    for is_end, near, end in zip(ends, (slice(NEAR), slice(-NEAR, None)), (0, -1), strict=True):
        if is_end:
            found[:, end] = scipy.interpolate.CubicSpline(times[near], values[:, near], axis=1)(times[end], 2)
    change = 6 * np.diff(np.diff(values) / step)
    change[:, 0] -= step[0] * found[:, 0]
    change[:, -1] -= step[-1] * found[:, -1]
    diagonal = 2 * (step[:-1] + step[1:])
    solved = scipy.linalg.lapack.dptsv(diagonal, step[1:-1], change.T, overwrite_d=True, overwrite_b=True)[2]
    found[:, 1:-1] = solved.T
    return found
