"""Rounding of an encoder or converter: its step, and the noise before it."""

from functools import lru_cache

import numpy as np
import polars as pl

from osl_analysis.measured import check_finite
from osl_analysis.trial import Array


def visible_step(values: Array) -> float | None:
    """The step to which a signal (n,) was rounded, in its unit, between distinct values. None if it is not seen (more
    than half of the values are distinct, or less than 99 % of the differences are a whole number of steps), and for a
    signal that is constant, empty or not finite."""
    if not len(values) or not np.isfinite(values).all():
        return None
    distinct = distinct_values(values, len(values) // 2)
    if distinct is None or len(distinct) < 2:
        return None
    apart = np.diff(distinct)
    apart = apart[apart > 1e-9 * (distinct[-1] - distinct[0])]  # nearer ones are one, converted with another error
    if len(apart) < 2:
        return None
    step = float(np.median(apart[apart < 1.5 * np.min(apart)]))
    off = np.abs(apart / step - np.rint(apart / step))
    return step if float(np.mean(off < 0.02)) >= 0.99 else None


def distinct_values(values: Array, most: int) -> Array | None:
    """The distinct values of a signal (n,), rising; None if there are more than `most`. By hashes: a sort of all values
    takes ten times as long."""
    distinct = pl.Series(values).unique()
    return None if len(distinct) > most else distinct.sort().to_numpy()


@lru_cache
def scatter_of_noise() -> tuple[Array, Array]:
    """Noise before a rounding, in steps, and the scatter [steps^2] that it leaves (Widrow and Kollar, Quantization
    Noise, 2008, ch. 5)."""
    s, k = np.linspace(0, 1, 501), np.arange(1, 101)[:, None]
    return s, s**2 + np.sum((1 - np.exp(-((2 * np.pi * k * s) ** 2))) / (2 * (np.pi * k) ** 2), axis=0)


def noise_before_rounding(scatter: float) -> float:
    """Standard deviation [steps] of the noise before the rounding from the scatter [steps^2] of what it leaves.

    Noise of standard deviation s makes the error of a rounded signal s^2 + 1/12 large on average over all places within
    a step. Of this, sum exp(-(2 pi k s)^2)/(2 pi^2 k^2) over k repeats; the rest is the scatter.

    Raises InputError: A scatter is not finite or cannot be measured.
    """
    check_finite("the scatter", scatter)
    s, left = scatter_of_noise()
    return float(np.sqrt(scatter) if scatter > left[-1] else np.interp(scatter, left, s))
