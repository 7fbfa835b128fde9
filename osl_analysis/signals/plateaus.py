# SPDX-License-Identifier: Apache-2.0
"""Plateaus of a stepped current, and whether the shaft stands meanwhile: a clamped actuator."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import runs

BIN_S = 0.05  # s; averaging time in the search for plateaus
LEVEL_CHANGE = 0.02  # of the current's range, by which means of a plateau differ at most
SHORTEST_LEVEL = 5  # changes between such means: a plateau of 0.3 s
SETTLING, ENDING = 3, 1  # means left out: the torque settles, and the filter spreads the next step
FEWEST_PLATEAUS = 8  # whose scatter, one left out at a time, gives an interval
LEAST_SPAN = 0.5  # of the current's range between plateaus; less are rests between two motions


def plateaus_of(time: Array, current: Array) -> list[slice]:
    """Find the plateaus of a stepped current.

    Parameters
    ----------
    time : Array
        Rising (n,) [s]; a bin of `BIN_S` without a row ends a plateau.
    current : Array
        (n,) [A].

    Returns
    -------
    list of slice
        Rows in which means over `BIN_S` change by less than 2 % of their range for 0.3 s or more.
        The first 0.15 s and the last 0.1 s are left out.
    """
    begins, number = bins_of(time)
    if len(begins) <= SHORTEST_LEVEL:
        return []
    stops = np.append(begins[1:], len(time))
    means = means_from(begins, current)
    span = np.ptp(means)
    is_steady = (np.abs(np.diff(means)) < LEVEL_CHANGE * span) & (np.diff(number) == 1)

    found = []
    for run in runs(is_steady):
        if run.stop - run.start >= SHORTEST_LEVEL:
            last = run.stop - 1 - ENDING  # the last mean of the run is number run.stop
            found.append(slice(begins[run.start + SETTLING], stops[last]))
    return found


def bins_of(time: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First rows (k,) of the bins of rising times (n,) [s], and their numbers."""
    usual_step = np.median(np.diff(time)) if len(time) > 1 else 0.0
    # a hundredth of a step, so that rounding does not move rows to the bin before
    number = np.floor((time - time[0] + 0.01 * usual_step) / BIN_S).astype(np.intp)
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    return begins, number[begins]


def means_from(begins: NDArray[np.intp], values: Array) -> Array:
    """Means (k,) of values (n,) over bins that begin at these rows (k,)."""
    rows = np.diff(np.append(begins, len(values)))
    return np.add.reduceat(values, begins) / rows


def is_clamped(
    time: Array,
    current: Array,
    plateaus: Sequence[slice],
    motion: Array | None,
    is_angle: bool,
    slowest: float,
) -> bool:
    """Whether a shaft stands at the plateaus of its current; it may twitch between them.

    Parameters
    ----------
    time, current : Array
        (n,) [s], [A].
    plateaus : sequence of slice
        Of the current (`plateaus_of`).
    motion : Array or None
        Angle (n,) [rad] or velocity [rad/s] of the shaft, which may be noisy; None: not recorded.
    is_angle : bool
        Which of the two it is.
    slowest : float
        Velocity [rad/s] below which the shaft stands.
    """
    if len(plateaus) < FEWEST_PLATEAUS:
        return False
    begins, _ = bins_of(time)
    levels = [current[level].mean() for level in plateaus]
    if np.ptp(levels) < LEAST_SPAN * np.ptp(means_from(begins, current)):
        return False
    if motion is None:
        return True
    rows = [motion[level] for level in plateaus]
    if is_angle:
        at = [time[level] for level in plateaus]
        speeds = [np.polyfit(t, angle, 1)[0] for t, angle in zip(at, rows, strict=True)]
    else:
        speeds = [velocity.mean() for velocity in rows]
    return bool(np.median(np.abs(speeds)) < slowest)
