"""Rounding of an encoder or converter that every cycle repeats, so that the spread between cycles is blind to it."""

import numpy as np

from osl_analysis.stats.covariance import Cycles
from osl_analysis.trial import Array

DISTINCT = 0.5
"""Largest share of distinct values among the samples of a signal whose step is visible."""
WHOLE_STEPS = 0.99
"""Smallest share of the differences between neighbouring values that are a whole number of steps."""


def visible_step(values: Array) -> float | None:
    """The step to which a signal (n,) was rounded, in its unit: between distinct values; None if it is not seen."""
    span = float(np.ptp(values))
    distinct = np.unique(values)
    if span == 0 or len(distinct) > DISTINCT * len(values):
        return None
    apart = np.diff(distinct)
    apart = apart[apart > 1e-9 * span]  # the same value, converted with another error of rounding
    if len(apart) < 2:
        return None
    step = float(np.median(apart[apart < 1.5 * np.min(apart)]))
    off = np.abs(apart / step - np.rint(apart / step))
    return step if float(np.mean(off < 0.02)) >= WHOLE_STEPS else None


def scatter_between_cycles(error: Array, cycles: Cycles) -> Array:
    """Variance between the cycles of each stratum at equal phase, in the squared unit of the error, shape (strata,).

    `error` (n,) is the signal in the rows of the fit without its smooth part. Rounding that every cycle repeats has
    none; rounding and noise that differ from cycle to cycle have theirs.
    """
    variances = []
    for stratum in np.unique(cycles.stratum):
        first, stop = (edge[cycles.stratum == stratum] for edge in (cycles.first, cycles.stop))
        count = max(int(np.min(stop - first)), 1)
        phase = (np.arange(count) + 0.5) / count
        rows = np.floor(first[:, None] + (stop - first)[:, None] * phase + 1e-9).astype(np.intp)
        variances.append(float(np.mean(np.var(error[np.minimum(rows, len(error) - 1)], axis=0, ddof=1))))
    return np.array(variances)
