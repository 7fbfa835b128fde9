"""Quantiles of many values without sorting, or copying, all of them.

A thousand of the values tell between which two the quantile lies. One in ten lies there, and only these are sorted.
"""

import numpy as np

from osl_analysis.pieces import pieces
from osl_analysis.trial import Array

TRIED = 1 << 10
"""Values that tell where a quantile lies."""
BESIDE = 50
"""Places in their order by which they may be wrong: three standard errors of a median."""


def quantile(values: Array, share: float) -> float:
    """Quantile of finite values (n,), linear between the two nearest of them, as `np.quantile`; 0.5 is the median."""
    place = share * (len(values) - 1)
    first = int(place)
    low, high = ordered(values, first, min(first + 1, len(values) - 1))
    return low + (high - low) * (place - first)


def median(values: Array) -> float:
    """Median of finite values (n,)."""
    return quantile(values, 0.5)


def ordered(values: Array, first: int, last: int) -> tuple[float, float]:
    """The values (n,) that a sort would bring to two neighbouring places."""
    tried = np.sort(values[:: max(len(values) // TRIED, 1)])
    near = round(first / len(values) * len(tried))
    low = tried[near - BESIDE] if near >= BESIDE else -np.inf
    high = tried[near + BESIDE] if near + BESIDE < len(tried) else np.inf
    below, found = 0, []
    for rows in pieces(len(values)):
        part = values[rows]
        below += int(np.count_nonzero(part < low))
        found.append(part[(part >= low) & (part <= high)])
    between = np.concatenate(found)
    if not below <= first <= last < below + len(between):  # the values that were tried are not like the others
        below, between = 0, values
    some = np.partition(between, [first - below, last - below])
    return float(some[first - below]), float(some[last - below])
