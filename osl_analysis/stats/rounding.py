"""Rounding of an encoder or converter: its step, and the noise before it."""

import numpy as np

from osl_analysis.measured import check_finite
from osl_analysis.trial import Array


def visible_step(values: Array) -> float | None:
    """The step to which a signal (n,) was rounded, in its unit, between distinct values. None if it is not seen (more
    than half of the values are distinct, or less than 99 % of the differences are a whole number of steps), and for a
    signal that is constant, empty or not finite."""
    if not len(values) or not np.isfinite(values).all():
        return None
    distinct = np.unique(values)
    if not 2 <= len(distinct) <= len(values) // 2:
        return None
    apart = np.diff(distinct)
    apart = apart[apart > 1e-9 * (distinct[-1] - distinct[0])]  # nearer ones are one, converted with another error
    if len(apart) < 2:
        return None
    step = float(np.median(apart[apart < 1.5 * np.min(apart)]))
    off = np.abs(apart / step - np.rint(apart / step))
    return step if float(np.mean(off < 0.02)) >= 0.99 else None


def noise_before_rounding(scatter: float) -> float:
    """Standard deviation [steps] of the noise before a rounding, from the scatter [steps^2] of what it leaves.

    Noise of standard deviation s makes the error of a rounded signal s^2 + 1/12 large on average over all places within
    a step. Of this, sum exp(-(2 pi k s)^2)/(2 pi^2 k^2) over k repeats; the rest is the scatter (Widrow and Kollar,
    Quantization Noise, 2008, ch. 5). Raises InputError: A scatter is not finite or cannot be measured.
    """
    check_finite("the scatter", scatter)
    s, k = np.linspace(0, 1, 501), np.arange(1, 101)[:, None]
    left = s**2 + np.sum((1 - np.exp(-((2 * np.pi * k * s) ** 2))) / (2 * (np.pi * k) ** 2), axis=0)
    return float(np.sqrt(scatter) if scatter > left[-1] else np.interp(scatter, left, s))
