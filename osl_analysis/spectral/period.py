"""The period of a motion that repeats itself, and where in the record it does so.

The period need not be a whole number of samples: the clocks of generator and recorder differ by up to 1e-4.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from osl_analysis.measured import check_measured, varies
from osl_analysis.signals import runs
from osl_analysis.trial import Array

Spectrum = NDArray[np.complex128]
COARSE_HZ = 100.0  # rate [Hz] at which periods are looked for; neighbouring samples are averaged down to it
LEAST_CORRELATION = 0.3
"""Smallest autocorrelation of a lag that is tried. With realisations of two periods each it is a half."""
MOST_CANDIDATES = 60  # largest number of lags that are tried
LARGEST_MISMATCH = 0.1
"""Largest difference between a motion and itself a period later, as a share of its RMS, in the middle of all times."""
LOCAL_MISMATCH = 0.25  # the same at one time, within a quarter of a second
REST = 0.2  # RMS over one period, as a share of the largest one, below which the joint rests
LEAST_COVERED = 0.5  # smallest share of the time in motion in which it must repeat itself
FLOOR = 3e-4  # share of the motion's RMS below which a mismatch is none


@dataclass(frozen=True)
class CoarseMotion:
    """An angle (n,) [rad], averaged down to about `COARSE_HZ` without its mean and its drift."""

    theta: Array
    rate_hz: float
    usable: NDArray[np.bool_]  # samples that are not near a gap, shape (n,)

    @cached_property
    def autocorrelation(self) -> Array:
        """Correlation of the part that overlaps at each lag of up to half the record, shape (n//2 + 1,). It is divided
        by the size of both overlapping parts, so that it does not fall with the lag."""
        n, x = len(self.theta), self.theta
        lags = np.arange(n // 2 + 1)
        products = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * n)) ** 2, 2 * n)[lags]
        energy = np.concatenate([[0.0], np.cumsum(x**2)])
        size = np.sqrt(energy[n - lags] * np.maximum(energy[n] - energy[lags], 0.0))
        return np.asarray(np.divide(products, size, out=np.zeros(len(lags)), where=size > 1e-9 * energy[n]))

    def later(self, lag: float) -> Array:
        """The angle `lag` samples later, a whole number or not, at each of its first samples, shape (m,)."""
        m = int(len(self.theta) - np.ceil(lag))
        return np.asarray(self._spline(np.arange(m) + lag))

    def slope(self, lag: float, rows: int) -> Array:
        """Derivative [rad/sample] of `later`, shape (rows,)."""
        return np.asarray(self._spline(np.arange(rows) + lag, 1))

    @cached_property
    def _spline(self):  # type: ignore[no-untyped-def]
        return make_interp_spline(np.arange(len(self.theta)), self.theta, k=3)


@dataclass(frozen=True)
class Repetition:
    """A motion that repeats itself after a lag."""

    period: float  # lag [s], not a whole number of samples
    mismatch: float
    """RMS of the difference between the motion and itself a lag later, as a share of its RMS; median over time."""
    covered: float  # share of the time in motion that belongs to a stretch in which it repeats itself
    stretches: tuple[tuple[float, float], ...]
    """First and last time [s] from the first sample of each stretch of two periods or more."""


def find_repetition(theta: Array, rate_hz: float, usable: NDArray[np.bool_] | None = None) -> Repetition | None:
    """The shortest lag after which an angle (n,) [rad], sampled at `rate_hz`, repeats itself; None if it does not.

    The autocorrelation, divided by the size of what overlaps, gives the lags that may be the period. At each of them
    the motion is compared with itself in short windows. A record may hold several motions with the same period, each
    with a transient, and rests between them: their comparison fails only where one motion ends. `usable` (n,) are the
    rows that are not near a gap.

    A stepped sine also repeats itself: look for its protocol first.
    """
    check_measured("the angle", theta)
    if not varies(theta):
        return None
    motion = coarse(theta, rate_hz, usable)
    tried = [found for lag in candidates(motion.autocorrelation) if (found := repetition(motion, lag)) is not None]
    if not tried:
        return None
    best = min(one.mismatch for one in tried)
    # of lags with mismatches within a factor of two the shortest one is the period, and not a multiple of it
    return min((one for one in tried if one.mismatch <= 2 * best + FLOOR), key=lambda one: one.period)


def coarse(theta: Array, rate_hz: float, usable: NDArray[np.bool_] | None) -> CoarseMotion:
    """The angle (n,) averaged over neighbours down to about `COARSE_HZ`, without its mean and its drift."""
    step = max(int(rate_hz / COARSE_HZ), 1)
    rows = len(theta) // step * step
    mean = theta[:rows].reshape(-1, step).mean(axis=1)
    good = np.ones(len(theta), dtype=bool) if usable is None else usable
    place = np.arange(len(mean)) - (len(mean) - 1) / 2
    slope = float(place @ mean) / max(float(place @ place), 1.0)
    return CoarseMotion(
        mean - mean.mean() - slope * place, rate_hz / step, np.asarray(good[:rows].reshape(-1, step).all(axis=1))
    )


def candidates(correlation: Array) -> Array:
    """Lags at peaks of the autocorrelation (n,) behind its first negative value, between samples by a parabola."""
    negative = np.flatnonzero(correlation < 0)
    if not len(negative):
        return np.empty(0)
    inner = np.arange(max(int(negative[0]), 1), len(correlation) - 1)
    before, here, after = correlation[inner - 1], correlation[inner], correlation[inner + 1]
    peak = (here >= before) & (here > after) & (here > LEAST_CORRELATION)
    bend = (before - 2 * here + after)[peak]
    at = inner[peak] + 0.5 * (before - after)[peak] / np.where(bend < 0, bend, -1.0)
    highest = np.argsort(-here[peak], kind="stable")[:MOST_CANDIDATES]
    last = len(correlation) - 1
    ends = [float(last)] if last > 1 and correlation[last] > max(LEAST_CORRELATION, correlation[last - 1]) else []
    return np.array([*at[highest], *ends])


def repetition(motion: CoarseMotion, lag: float) -> Repetition | None:
    """Where the motion repeats itself after a lag [coarse samples]; None if it does not in most of its time. Steps of
    Gauss and Newton in these stretches correct the lag."""
    moving = in_motion(motion, lag)
    scale = float(np.sqrt(np.mean(motion.theta[moving] ** 2))) if moving.any() else 0.0
    for _ in range(2):
        difference, local = mismatch(motion, lag)
        alike = alike_runs(motion, moving, lag, local < LOCAL_MISMATCH * scale)
        rows = np.concatenate([np.r_[run] for run in alike]) if alike else np.empty(0, dtype=np.intp)
        if not len(rows):
            return None
        slope = motion.slope(lag, int(rows.max()) + 1)[rows]
        lag -= float(slope @ difference[rows]) / max(float(slope @ slope), np.finfo(float).tiny)
    middle = float(np.median(local[rows]))
    settled = alike_runs(motion, moving, lag, local < max(5 * middle, FLOOR * scale))  # the transient has ended
    covered = sum(run.stop - run.start + lag for run in settled) / max(int(moving.sum()), 1)
    if middle > LARGEST_MISMATCH * scale or covered < LEAST_COVERED:
        return None
    times = tuple((run.start / motion.rate_hz, (run.stop + lag) / motion.rate_hz) for run in settled)
    return Repetition(lag / motion.rate_hz, middle / scale, min(covered, 1.0), times)


def in_motion(motion: CoarseMotion, lag: float) -> NDArray[np.bool_]:
    """Samples (n,) about which the joint moves for one lag."""
    power = uniform_filter1d(motion.theta**2, max(round(lag), 1), mode="nearest")
    return np.asarray(power > REST**2 * np.max(power))


def mismatch(motion: CoarseMotion, lag: float) -> tuple[Array, Array]:
    """The motion a lag later minus the motion, and its RMS in windows of a quarter of a second, shape (m,) each."""
    later = motion.later(lag)
    difference = later - motion.theta[: len(later)]
    window = max(round(0.25 * motion.rate_hz), 1)
    return difference, np.sqrt(np.maximum(uniform_filter1d(difference**2, window, mode="nearest"), 0.0))


def alike_runs(motion: CoarseMotion, moving: NDArray[np.bool_], lag: float, alike: NDArray[np.bool_]) -> list[slice]:
    """Runs of at least one lag in which the moving joint is `alike` (m,) itself a lag later, without gaps."""
    m, whole = len(alike), round(lag)
    good = motion.usable & moving
    later = np.concatenate([good[whole:], np.repeat(good[-1:], whole)])[:m]
    shortest = 0.98 * lag - 1  # windows and averages blur the ends of a stretch of two periods
    return [run for run in runs(alike & good[:m] & later) if run.stop - run.start > shortest]
