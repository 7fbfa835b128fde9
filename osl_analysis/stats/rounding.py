"""Rounding of an encoder or converter that every cycle repeats, so that the spread between cycles is blind to it."""

from functools import cache

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.measured import check_finite, check_measured
from osl_analysis.stats.covariance import Cycles, check_repeated
from osl_analysis.trial import Array

SAME = 1e-9
"""Difference of two values, as a share of the range, below which they are one that was converted with another error."""
DISTINCT = 0.5  # largest share of distinct values among the samples of a signal whose step is visible
HARMONICS = 8  # harmonics of the error of rounding: 93 % of its variance
ORDERS = np.tile(np.arange(1, HARMONICS + 1), 2)
SIZES = 1 / (np.sqrt(2) * np.pi * ORDERS) / np.sqrt(np.sum(1 / ORDERS**2) / 2 * 6 / np.pi**2)
"""Orders of `rounding_harmonics`, and their sizes in the error [steps]."""
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


def rounding_harmonics(signal: Array, step: float) -> Array:
    """The error of the rounded signal (n,) as cosines and sines (2 k, n) of its place between two steps, k `HARMONICS`.

    The error is sum of step/(pi k) sin(2 pi k (signal + zero)/step), with a sign that alternates. A zero of the sensor
    that lies anywhere makes the phases of the harmonics random: what is linear in the error then has the sum of squares
    over these rows, each times its size (`SIZES`), as its variance. The harmonics that are left out count
    as those that are kept.
    """
    waves = np.empty((2, HARMONICS, len(signal)))
    place = signal / step
    place -= np.rint(place)
    half = np.tan(np.pi * place)  # of half the angle: one function in place of two
    share = 2 / (1 + half**2)
    np.subtract(share, 1.0, out=waves[0, 0])
    np.multiply(share, half, out=waves[1, 0])
    twice = 2 * waves[0, 0]
    for n in range(1, HARMONICS):  # f((k + 1) x) = 2 cos(x) f(k x) - f((k - 1) x)
        np.multiply(twice, waves[:, n - 1], out=waves[:, n])
        waves[:, n] -= waves[:, n - 2] if n > 1 else [[1.0], [0.0]]
    return waves.reshape(2 * HARMONICS, len(signal))


@cache
def scatter_of_noise() -> tuple[Array, Array]:
    """Standard deviations (501,) of noise [steps], and the scatter (501,) [steps^2] that it has behind the rounding."""
    s, k = np.linspace(0, 1, 501), np.arange(1, 101)[:, None]
    return s, s**2 + np.sum((1 - np.exp(-((2 * np.pi * k * s) ** 2))) / (2 * (np.pi * k) ** 2), axis=0)


def noise_before_rounding(scatter: Array) -> Array:
    """Standard deviation [steps] of the noise before the rounding from the scatter [steps^2] of what it leaves.

    Noise of standard deviation s makes the error of a rounded signal s^2 + 1/12 large on average over all places within
    a step. Of this, sum exp(-(2 pi k s)^2)/(2 pi^2 k^2) over k repeats; the rest is the scatter (Widrow and Kollar,
    Quantization Noise, 2008, ch. 5).

    Raises InputError: A scatter is not finite or cannot be measured.
    """
    check_finite("the scatter", scatter)
    s, left = scatter_of_noise()
    return np.where(scatter > left[-1], np.sqrt(scatter), np.interp(scatter, left, s))


def scatter_between_cycles(error: Array, cycles: Cycles, every: int = 1) -> Array:
    """Variance between the cycles of each stratum at equal phase, in the squared unit of the error, shape (strata,).

    `error` (n,) is the signal in the rows of the fit without its smooth part; several (k, n) have the shape
    (k, strata). Rounding that every cycle repeats has none; rounding and noise that differ from cycle to cycle have
    theirs. Of the rows of a cycle, one in `every` is seen.

    Raises InputError: A value cannot be measured, or a stratum has a single cycle.
    """
    check_measured("the error of rounding", error)
    members = np.bincount(cycles.stratum)
    check_repeated(members.astype(float))
    if not error.shape[-1]:
        raise InputError("no samples between the cycles' edges; record the trial again")
    variances: list[Array] = []
    for stop in np.cumsum(members):
        own = slice(stop - members[len(variances)], stop)
        first, length = cycles.first[own], cycles.stop[own] - cycles.first[own]
        count = max(int(np.min(length)), 1)
        phase = (np.arange(0, count, every) + 0.5) / count
        rows = (first[:, None] + 1e-9 + length[:, None] * phase).astype(np.intp)
        alike = np.take(error, np.minimum(rows, error.shape[-1] - 1), axis=-1)
        alike -= alike.mean(axis=-2, keepdims=True)
        variances.append(np.einsum("...ij,...ij->...", alike, alike) / (len(phase) * (len(first) - 1)))
    return np.stack(variances, axis=-1)
