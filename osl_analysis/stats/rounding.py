"""Rounding of an encoder or converter: its step, and the noise before it."""

from functools import cache

import numpy as np
import polars as pl

from osl_analysis.measured import check_finite
from osl_analysis.trial import Array

SAME = 1e-9
"""Difference of two values, as a share of the range, below which they are one that was converted with another error."""
DISTINCT = 0.5  # largest share of distinct values among the samples of a signal whose step is visible
WHOLE_STEPS = 0.99  # smallest share of the differences between neighbouring values that are a whole number of steps


def visible_step(values: Array) -> float | None:
    """The step to which a signal (n,) was rounded, in its unit: between distinct values; None if it is not seen, and
    for a signal that is constant, empty or not finite."""
    if not len(values) or not np.isfinite(values).all():
        return None
    span = float(np.ptp(values))
    distinct = distinct_values(values, int(DISTINCT * len(values)))
    if span == 0 or distinct is None:
        return None
    apart = np.diff(distinct)
    apart = apart[apart > SAME * span]
    if len(apart) < 2:
        return None
    step = float(np.median(apart[apart < 1.5 * np.min(apart)]))
    off = np.abs(apart / step - np.rint(apart / step))
    return step if float(np.mean(off < 0.02)) >= WHOLE_STEPS else None


def distinct_values(values: Array, most: int) -> Array | None:
    """The distinct values of a signal (n,), rising; None if there are more than `most`. By hashes: a sort of all values
    takes ten times as long."""
    distinct = pl.Series(values).unique()
    return None if len(distinct) > most else distinct.sort().to_numpy()


@cache
def scatter_of_noise() -> tuple[Array, Array]:
    """Standard deviations (501,) of noise [steps], and the scatter (501,) [steps^2] that it has behind the rounding."""
    s, k = np.linspace(0, 1, 501), np.arange(1, 101)[:, None]
    return s, s**2 + np.sum((1 - np.exp(-((2 * np.pi * k * s) ** 2))) / (2 * (np.pi * k) ** 2), axis=0)


def noise_before_rounding(scatter: float) -> float:
    """Standard deviation [steps] of the noise before the rounding from the scatter [steps^2] of what it leaves.

    Noise of standard deviation s makes the error of a rounded signal s^2 + 1/12 large on average over all places within
    a step. Of this, sum exp(-(2 pi k s)^2)/(2 pi^2 k^2) over k repeats; the rest is the scatter (Widrow and Kollar,
    Quantization Noise, 2008, ch. 5).

    Raises InputError: A scatter is not finite or cannot be measured.
    """
    check_finite("the scatter", scatter)
    s, left = scatter_of_noise()
    return float(np.sqrt(scatter) if scatter > left[-1] else np.interp(scatter, left, s))
