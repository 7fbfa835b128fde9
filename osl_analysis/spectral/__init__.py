"""What a motion repeats: the period of any motion, and where whole periods stand. The sines of a
stepped sine are found in `stepped_sine`.

The period may be a fractional number of samples: the clocks of generator and recorder differ by up
to 1e-4.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.measured import check_measured, varies
from osl_analysis.signals import runs
from osl_analysis.trial import Array

# First and last time [s] from the first sample of each stretch in which a motion repeats itself.
Stretches = list[tuple[float, float]]

# Shares are of the RMS of the moving angle.
COARSE_HZ = 100.0  # rate [Hz], by averaging samples, at which periods are searched
FLOOR = 3e-4  # share below which a mismatch counts as none
LEAST_CORRELATION = 0.3  # two realisations of two periods each correlate by 0.5
MOST_LAGS = 60  # highest peaks of the autocorrelation that are tried
MOVING = 0.2  # of the largest RMS; below, the joint rests
COMPARED_S = 0.25  # [s] window in which a motion is compared with itself
SIMILAR = 0.25  # share by which a motion may differ from itself in a window
WHOLE_LAG = 0.98  # windows and averages blur the ends of a stretch of two periods
SETTLED = 5.0  # median mismatches; more is a transient
LARGEST_MISMATCH = 0.1  # share, median over time, beyond which a motion does not repeat itself
LEAST_COVERED = 0.5  # share of the moving time that must repeat itself
LARGEST_SCATTER = 0.03  # of periods about their mean: a bench leaves 1 %, a hand 5 to 10 %
SMALLEST_SIZE = 1e-9  # of the record's energy: what is smaller is a rest
LAG_ROUNDS = 2


@dataclass(frozen=True)
class Realisation:
    """Consecutive whole periods of one periodic motion."""

    start: float  # time [s] of the first period, from the first sample of the record
    periods: int  # two or more


@dataclass(frozen=True)
class PeriodicMotion:
    """A motion that repeats itself."""

    period: float  # [s]
    realisations: tuple[Realisation, ...]


class Repetition(NamedTuple):
    """A lag after which a motion repeats itself; the smallest lag sorts first."""

    lag: float  # [s]
    mismatch: float  # RMS of the difference, median over time, as a share of the angle's
    stretches: Stretches


def periodic_motion(
    theta: Array, rate_hz: float, usable: NDArray[np.bool_] | None = None
) -> PeriodicMotion | None:
    """Find the realisations of a periodic motion in a record.

    Parameters
    ----------
    theta : Array
        Unfiltered, (n,) [rad].
    rate_hz : float
        Sampling rate [Hz].
    usable : Array or None
        (n,) rows that are not near a gap; None: all.

    Returns
    -------
    PeriodicMotion or None
        None if the motion does not repeat itself as well as a bench does.

    Raises
    ------
    InputError
        A value cannot be measured.

    Notes
    -----
    At the lags that the autocorrelation proposes, the motion is compared with itself in short
    windows. In a record of several motions of one period, with transients and rests, the comparison
    then fails only where a motion ends. A stepped sine also repeats itself: look for its protocol
    first.
    """
    check_measured("the angle", theta)
    if not varies(theta):
        return None
    step = max(int(rate_hz / COARSE_HZ), 1)
    rows = len(theta) // step * step
    x = np.asarray(scipy.signal.detrend(theta[:rows].reshape(-1, step).mean(axis=1)))
    is_usable = np.ones(len(theta), dtype=bool) if usable is None else usable
    usable_bins = np.asarray(is_usable[:rows].reshape(-1, step).all(axis=1))
    spline = scipy.interpolate.make_interp_spline(np.arange(len(x)), x, k=3)

    found = [
        repetition_after(x, spline, usable_bins, lag, rate_hz / step) for lag in likely_lags(x)
    ]
    candidates = [repetition for repetition in found if repetition is not None]
    if not candidates:
        return None
    best = min(candidate.mismatch for candidate in candidates)
    # the shortest lag with a mismatch within a factor of two of the best is the period, not a
    # multiple of it
    chosen = min(candidate for candidate in candidates if candidate.mismatch <= 2 * best + FLOOR)
    realisations = whole_periods(chosen, len(theta) / rate_hz)
    times = np.arange(0, chosen.lag, 1 / COARSE_HZ)
    for realisation in realisations:
        begins = realisation.start + chosen.lag * np.arange(realisation.periods)
        periods = spline((begins[:, None] + times) * rate_hz / step)
        periods -= periods.mean(axis=1, keepdims=True)  # the joint may settle
        if np.std(periods - periods.mean(axis=0)) > LARGEST_SCATTER * np.std(periods):
            return None
    return PeriodicMotion(chosen.lag, realisations) if realisations else None


def whole_periods(repetition: Repetition, seconds: float) -> tuple[Realisation, ...]:
    """The whole periods of each stretch of a record of some duration, counted backwards from its
    end: the incomplete rest is at the beginning, where a transient is."""
    period = repetition.lag
    realisations = []
    for start, stop in repetition.stretches:
        end = min(stop, seconds)
        # the ends of a stretch are uncertain by three samples
        periods = int(min(end - max(start, 0.0) + 3 / COARSE_HZ, end) / period)
        if periods > 1:  # one has no scatter
            realisations.append(Realisation(end - periods * period, periods))
    return tuple(realisations)


def likely_lags(x: Array) -> Array:
    """Lags [samples] at peaks of the autocorrelation of x (n,) after its first negative value; the
    highest first.

    The autocorrelation is divided by the size of both overlapping parts, so that it does not fall
    with the lag.
    """
    n = len(x)
    lags = np.arange(n // 2 + 1)
    products = scipy.signal.correlate(x, x)[n - 1 :][lags]
    energy = np.concatenate([[0.0], np.cumsum(x**2)])
    size = np.sqrt(energy[n - lags] * np.maximum(energy[n] - energy[lags], 0.0))
    correlation = products / np.maximum(size, SMALLEST_SIZE * energy[n])
    beyond_first_swing = np.logical_or.accumulate(correlation < 0)
    # a peak at the largest lag has no sample behind it
    height = np.append(np.where(beyond_first_swing, correlation, 0.0), 0.0)
    peaks, _ = scipy.signal.find_peaks(height, LEAST_CORRELATION)
    return peaks[np.argsort(-height[peaks], kind="stable")[:MOST_LAGS]].astype(np.float64)


def repetition_after(
    x: Array, spline: Any, usable: NDArray[np.bool_], lag: float, rate_hz: float
) -> Repetition | None:
    """The repetition of an angle x (n,) after about a lag [samples]; None if it does not repeat
    itself for most of the time.

    The lag is corrected. `spline` goes through x; rows that are not `usable` (n,) do not count.
    """
    power = scipy.ndimage.uniform_filter1d(x**2, max(round(lag), 1), mode="nearest")
    moving = power > MOVING**2 * np.max(power)
    counts = usable & moving
    rms = float(np.sqrt(np.mean(x[moving] ** 2)))
    window = max(round(COMPARED_S * rate_hz), 1)

    def runs_of_a_lag(similar: NDArray[np.bool_]) -> list[slice]:
        """Runs of at least one lag in which rows are similar to those a lag later, and both
        count."""
        m = len(similar)
        both_count = counts[:m] & counts[round(lag) : round(lag) + m]
        least = WHOLE_LAG * lag - 1
        return [run for run in runs(similar & both_count) if run.stop - run.start > least]

    for _ in range(LAG_ROUNDS):
        compared = np.arange(int(len(x) - np.ceil(lag)))
        difference = spline(compared + lag) - x[compared]
        mean_square = scipy.ndimage.uniform_filter1d(difference**2, window, mode="nearest")
        mismatch = np.sqrt(np.maximum(mean_square, 0.0))
        similar = runs_of_a_lag(mismatch < SIMILAR * rms)
        if not similar:
            return None
        rows = np.concatenate([np.r_[run] for run in similar])
        slope = spline(rows + lag, 1)
        lag -= float(slope @ difference[rows] / (slope @ slope))
        if not 1 <= lag < len(x) - 1:
            return None

    median = float(np.median(mismatch[rows]))
    settled = runs_of_a_lag(mismatch < max(SETTLED * median, FLOOR * rms))
    covered = sum(run.stop - run.start + lag for run in settled) / np.count_nonzero(moving)
    if median > LARGEST_MISMATCH * rms or covered < LEAST_COVERED:
        return None
    stretches = [(run.start / rate_hz, (run.stop + lag) / rate_hz) for run in settled]
    return Repetition(lag / rate_hz, median / rms, stretches)
