"""Which of the columns that are called like a clock tells the time, as far as their readings say it."""

import math
from collections.abc import Mapping

import numpy as np

from osl_analysis.errors import listing, printable
from osl_analysis.trial import Array

LARGEST_DIFFERENCE = 0.005
"""Largest difference, as a share, of what two clocks of one recording span: it puts I wrong by twice as much."""
MOSTLY = 0.9
"""Smallest share of the steps of a clock that do not go back."""
MOST_NAMED = 6
"""Largest number of clocks that are named."""


def likely_clock(readings: Mapping[str, Array], what: str = "columns") -> tuple[str | None, list[str]]:
    """The clock that a draft names, and what the user has to decide, from the readings (n,) of all that are called so.

    The first of several, if they span the same time in s, ms, us or ns. None if they contradict each other, as then B
    and I depend on the choice. What does not run, as the duration of each loop, is no clock beside one that does.
    """
    spans = {name: span_of(values) for name, values in readings.items()}
    running = [name for name, span in spans.items() if span > 0] or list(readings)
    if len(running) < 2:
        return next(iter(running), None), []
    count, first = f"{len(running)} {what} may be the clock", running[0]
    if all(one_time(readings[name], readings[first]) for name in running):
        named, taken = (listing([printable(name) for name in some], MOST_NAMED) for some in (running, running[:1]))
        return first, [f"{count}, to be checked: {named}; {taken} is taken"]
    named = listing([f"{printable(name)} spans {spans[name]:.6g}" for name in running], MOST_NAMED)
    return None, [f"{count}, and they contradict each other: {named}; name the one by which the signals were sampled"]


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if they do not run."""
    known = values[np.isfinite(values)]
    runs = known.size > 1 and float(np.mean(np.diff(known) >= 0)) > MOSTLY
    return max(float(known[-1] - known[0]), 0.0) if runs else 0.0


def one_time(one: Array, other: Array) -> bool:
    """Whether two clocks span the same time, in units that are a power of 1000 apart, where both have readings."""
    if one.shape == other.shape:
        known = np.isfinite(one) & np.isfinite(other)
        one, other = one[known], other[known]
    spans = span_of(one), span_of(other)
    if min(spans) <= 0:
        return max(spans) <= 0
    ratio = spans[0] / spans[1]
    return abs(ratio / 1000.0 ** round(math.log10(ratio) / 3) - 1) <= LARGEST_DIFFERENCE
