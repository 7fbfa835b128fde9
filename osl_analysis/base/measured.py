# SPDX-License-Identifier: Apache-2.0
"""Check which numbers can be a measurement, and find the step to which a signal is rounded.

A fit refuses a number that no sensor can give, before it overflows, underflows or becomes NaN.
"""

import math
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from osl_analysis.base.errors import InputError

# No laboratory signal, in SI units, comes near these sizes. Within them no estimate overflows or
# underflows: the highest power that one needs is the squared variance of a quotient of two signals.
LARGEST_SIGNAL = 1e30
SMALLEST_SIGNAL = 1e-30

# Mean square of an exact fit's rounding error, as a share of the mean square of y. The processor
# decides whether an exact fit leaves 0 or 1e-16. No result may depend on it.
EXACT_FIT_ROUNDING = 1e-24

NORMAL_MEDIAN = 0.6745  # of |x| of a normal deviate, in standard deviations
UNIFORM_WIDTH = math.sqrt(12)  # standard deviations that a uniform distribution is wide


def check_finite(name: str, values: ArrayLike, least: float = 0.0) -> None:
    """Refuse numbers that are not finite, or too large, or too small.

    Parameters
    ----------
    name : str
        What the numbers are, for the message.
    values : ArrayLike
        Numbers of any shape.
    least : float
        The largest may not be below it in size, unless all are 0.

    Raises
    ------
    InputError
    """
    array = np.asarray(values)
    largest = np.abs(array).max(initial=0.0)
    if not np.isfinite(largest):
        raise InputError(
            f"{name} is not finite at sample {np.argmin(np.isfinite(array))}",
            "repair the log, or cut it there",
        )
    if largest > LARGEST_SIGNAL or 0 < largest < least:
        raise InputError(
            f"{name} reaches {largest:.3g}, which no sensor gives",
            "check its channel and unit in the source file, and the bytes of the log",
        )


def check_measured(name: str, values: ArrayLike) -> None:
    """Refuse a signal of any shape, in SI units, that no sensor can give; `name` is for the
    message."""
    check_finite(name, values, least=SMALLEST_SIGNAL)


def rounding_of(y: NDArray[np.float64]) -> float:
    """Mean square of the residual that rounding leaves in an exact fit to y (n,), in y's unit
    squared; 0 if n is 0."""
    return EXACT_FIT_ROUNDING * float(y @ y) / max(len(y), 1)


def varies(y: NDArray[np.float64]) -> bool:
    """Whether y (n,) varies by more than its rounding. The computed variance of a constant 0.1 is
    2e-34, not 0."""
    return bool(len(y)) and float(np.var(y)) > rounding_of(y)


def rms(values: NDArray[np.float64]) -> float:
    """Root of the mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def usual_step(time: NDArray[Any]) -> float:
    """Median step of times (n,), or their mean if most stamps are repeated; 0 of one."""
    steps = np.diff(time)
    return float(np.median(steps) or steps.mean()) if steps.size else 0.0


def cycle_duration(angle: NDArray[np.float64], step_s: float) -> float:
    """Duration [s] of a cycle of an angle (n,) that goes to and fro, by its mean speed over the
    way, so that rests do not count. `step_s` [s] is from sample to sample."""
    steps = np.abs(np.diff(angle))
    return float(2 * np.ptp(angle) * steps.sum() / (steps @ steps) * step_s)


def noise_of(values: NDArray[np.float64], order: int = 3) -> float:
    """Standard deviation of white noise in (n,) values, by their differences of an order, which a
    slower motion hardly has; 0 of too few."""
    if len(values) <= order:
        return 0.0
    white_noise_factor = math.sqrt(math.comb(2 * order, order)) * NORMAL_MEDIAN
    return float(np.median(np.abs(np.diff(values, order)))) / white_noise_factor


SPIKE_SHARE = 0.15  # least size of a spike, of the range of most values
SPIKE_STEPS = 1.5  # of the smallest change; an encoder's last digit changes by one
SPIKE_BENDS = 10.0  # usual second differences, of which a spike has more
FAR_OFF = 5.0  # ranges beyond which a number that recurs is of no sensor, also in a row
FEWEST_RECURRING = 3  # spikes of one value, as of bits that stood high
MOST_SPOILED = 0.1  # share of the values; of more, the channel itself is like this


def spoiled(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether values (n,) are none of a sensor: each leaps off both neighbours and back, or is a
    value that recurs in such leaps, or far off. A wrap and a step of a command are none."""
    usual = values[np.isfinite(values)]
    low, middle, high = np.quantile(usual, (0.05, 0.5, 0.95)) if usual.size else (0.0, 0.0, 0.0)
    if high == low or values.size < FEWEST_RECURRING:
        return np.zeros(values.size, bool)
    steps = np.pad(np.diff(values), 2)
    sizes = np.abs(steps)
    bend = np.quantile(np.nan_to_num(np.abs(np.diff(steps))), 0.75)
    smaller = np.minimum(sizes[1:-2], sizes[2:-1])
    around = np.maximum(sizes[:-3], sizes[3:])
    # one step of a coarse channel that mostly rests is no spike
    smallest = np.min(sizes, where=sizes > 0, initial=np.inf)
    limit = max(SPIKE_SHARE * (high - low), SPIKE_BENDS * bend, SPIKE_STEPS * smallest)
    comes_back = steps[1:-2] * steps[2:-1] < 0
    is_alone = comes_back & (smaller > np.maximum(limit, around))
    # of distinct values, since a short motion before a long rest is not far off
    lowest, highest = np.quantile(np.unique(usual), (0.05, 0.95))
    may_recur = is_alone | (np.abs(values - middle) > FAR_OFF * (highest - lowest))
    if not may_recur.any():
        return may_recur
    distinct_values, counts = np.unique(values[may_recur], return_counts=True)
    is_spoiled = is_alone | np.isin(values, distinct_values[counts >= FEWEST_RECURRING])
    return is_spoiled & (is_spoiled.mean() <= MOST_SPOILED)


# Differences of distinct values, as a share of the usual one, below which they are one value with
# other errors of rounding, as of a mean of a few decimals
ONE_VALUE_ROUNDING = 0.02
# of a step, by which a whole number of steps may be off: the last decimal of a log may be a
# twentieth of the step; by chance a tenth would be as near
FROM_WHOLE = 0.05
WHOLE_SHARE = 0.99  # of the differences, that are whole numbers of steps


def visible_step(values: NDArray[np.float64]) -> float | None:
    """Find the step to which a signal was rounded.

    Parameters
    ----------
    values : NDArray[np.float64]
        (n,).

    Returns
    -------
    float or None
        In the signal's unit. None if it cannot be seen: more than half of the values are distinct,
        or less than 99 % of their differences are whole numbers of steps. None also for a signal
        that is constant, empty or not finite.
    """
    if not np.isfinite(values).all():
        return None
    unique = pl.Series(values).unique()  # by hashes: only the few of a rounded signal are sorted
    if not 2 <= len(unique) <= len(values) // 2:
        return None
    distinct = unique.sort().to_numpy()
    low, high = np.quantile(distinct, (0.05, 0.95))  # a few values far off do not change the usual
    differences = np.diff(distinct)
    usual = max(high - low, np.finfo(float).eps * np.abs(distinct).max()) / len(distinct)
    differences = differences[differences > ONE_VALUE_ROUNDING * usual]
    if len(differences) < 2:
        return None
    rough = np.median(differences[differences < 1.5 * np.min(differences)])
    step = float(differences.sum() / np.rint(differences / rough).sum())
    steps = differences / step
    is_whole = np.abs(steps - np.rint(steps)) < FROM_WHOLE
    return step if np.mean(is_whole) >= WHOLE_SHARE else None
