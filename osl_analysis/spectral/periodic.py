# SPDX-License-Identifier: Apache-2.0
"""What a motion repeats: the period of any motion, and where whole periods stand. The sines of a
stepped sine are found in `stepped_sine`.

The period may be a fractional number of samples: the clocks of generator and recorder differ by up
to 1e-4.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.measured import rms
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import runs

# Shares are of the RMS of the moving angle.
COARSE_HZ = 100.0  # rate [Hz], by averaging samples, at which periods are searched
MISMATCH_ROUNDING = 3e-4  # share that a spline between samples leaves of an exact repetition
LEAST_CORRELATION = 0.3  # two realisations of two periods each correlate by 0.5
MOST_LAGS = 60  # highest peaks of the autocorrelation that are tried
MOVING = 0.2  # of the largest RMS; below, the joint rests
COMPARED_S = 0.25  # [s] window in which a motion is compared with itself
SIMILAR = 0.25  # share by which a motion may differ from itself in a window
WHOLE_LAG = 0.98  # windows and averages blur the ends of a stretch of two periods
LARGEST_TRANSIENT = 5.0  # median mismatches; more is a transient
LEAST_COVERED = 0.5  # share of the moving time that must repeat itself
LAG_ROUNDS = 2
UNCERTAIN_ROWS = 3.0  # by which the ends of a stretch are uncertain, at `COARSE_HZ`


class PeriodicMotion(NamedTuple):
    """A motion that repeats itself. A realisation is consecutive whole periods."""

    period: float  # [s]
    begins: Array  # time [s] at which each of k periods begins, from the first sample of the record
    realisation: NDArray[np.intp]  # number of the realisation (k,) that it belongs to
    scatter: float  # of periods about their mean, as a share of the angle's


class Repetition(NamedTuple):
    """A lag after which a motion repeats itself, in samples; the smallest lag sorts first."""

    lag: float
    mismatch: float  # RMS of the difference, median over time, as a share of the angle's
    stretches: list[slice]  # in which each row repeats itself a lag later


def periodic_motion(
    theta: Array, rate_hz: float, usable: NDArray[np.bool_]
) -> PeriodicMotion | None:
    """Find the realisations of a periodic motion in a record.

    Parameters
    ----------
    theta : Array
        Unfiltered, (n,) [rad]; the joint moves.
    rate_hz : float
        Sampling rate [Hz].
    usable : Array
        (n,) rows that are not near a gap.

    Returns
    -------
    PeriodicMotion or None
        None if the motion does not repeat itself.

    Notes
    -----
    At the lags that the autocorrelation proposes, the motion is compared with itself in short
    windows. In a record of several motions of one period, with transients and rests, the comparison
    then fails only where a motion ends. A stepped sine also repeats itself: look for its protocol
    first.
    """
    step = max(int(rate_hz / COARSE_HZ), 1)
    rate_hz /= step
    bins = slice(len(theta) // step * step)
    x = scipy.signal.detrend(theta[bins].reshape(-1, step).mean(axis=1))
    spline = scipy.interpolate.make_interp_spline(np.arange(len(x)), x)

    usable_rows = usable[bins][::step]  # near a gap many are not
    repetitions = [repetition_after(x, spline, usable_rows, lag, rate_hz) for lag in likely_lags(x)]
    candidates = list(filter(None, repetitions))
    if not candidates:
        return None
    best = min(candidate.mismatch for candidate in candidates)
    # the shortest lag with a mismatch within a factor of two of the best is the period, not a
    # multiple of it
    lag, _, stretches = min(
        candidate for candidate in candidates if candidate.mismatch <= 2 * best + MISMATCH_ROUNDING
    )
    times = np.arange(lag)
    scatters = []
    realisations: list[Array] = []
    numbers = []
    for stretch in stretches:
        # counted backwards from its end: the incomplete rest is where a transient is
        end = min(stretch.stop + lag, len(theta) / step)
        length = min(end - stretch.start + UNCERTAIN_ROWS, end)
        begins = end - lag * np.arange(length // lag, 0, -1)
        periods = spline(begins[:, None] + times)
        periods -= periods.mean(axis=1, keepdims=True)  # the joint may settle
        scatters.append((periods - periods.mean(axis=0)).std() / periods.std())
        numbers += len(begins) * [len(realisations)]
        realisations.append(begins / rate_hz)
    return PeriodicMotion(
        lag / rate_hz, np.concatenate(realisations), np.array(numbers), max(scatters)
    )


def likely_lags(x: Array) -> NDArray[np.signedinteger]:
    """Lags [samples] at peaks of the autocorrelation of x (n,) after its first negative value; the
    highest first.

    It falls with the lag: of m periods it is (m - 1)/m after one.
    """
    n = len(x)
    correlation = scipy.signal.correlate(x, x)[n - 1 : n + n // 2 + 1] / (x**2).sum()
    beyond_first_swing = np.logical_or.accumulate(correlation < 0)
    peaks, _ = scipy.signal.find_peaks(correlation * beyond_first_swing, LEAST_CORRELATION)
    return peaks[np.argsort(-correlation[peaks])[:MOST_LAGS]]


def repetition_after(
    x: Array, spline: Any, usable: NDArray[np.bool_], lag: float, rate_hz: float
) -> Repetition | None:
    """The repetition of an angle x (n,) after about a lag [samples]; None if it does not repeat
    itself for most of the time.

    The lag is corrected. `spline` goes through x; rows that are not `usable` (n,) do not count.
    """
    power = scipy.ndimage.uniform_filter1d(x**2, round(lag), mode="nearest")
    moving = power > MOVING**2 * power.max()
    counts = usable & moving
    size = rms(x[moving])
    window = round(COMPARED_S * rate_hz)

    def runs_of_a_lag(similar: NDArray[np.bool_]) -> list[slice]:
        """Runs of at least one lag in which rows are similar to those a lag later, and both
        count."""
        m = min(len(similar), len(x) - round(lag))  # the lag has been corrected since
        both_count = counts[:m] & counts[round(lag) :][:m]
        least = WHOLE_LAG * lag - 1
        return [run for run in runs(similar[:m] & both_count) if run.stop - run.start > least]

    for _ in range(LAG_ROUNDS):
        later = np.arange(lag, len(x) - 1)
        difference = spline(later) - x[: len(later)]
        mean_square = scipy.ndimage.uniform_filter1d(difference**2, window, mode="nearest")
        mismatch = np.sqrt(np.maximum(mean_square, 0.0))
        similar = runs_of_a_lag(mismatch < SIMILAR * size)
        if not similar:
            return None
        rows = np.concatenate([np.r_[run] for run in similar])
        slope = spline(rows + lag, 1)
        lag -= float(slope @ difference[rows] / (slope @ slope))
        if not 1 <= lag < len(x) - 1:
            return None

    median = np.median(mismatch[rows])
    settled = runs_of_a_lag(mismatch < max(LARGEST_TRANSIENT * median, MISMATCH_ROUNDING * size))
    covered = sum(run.stop - run.start + lag for run in settled) / moving.sum()
    return Repetition(lag, median / size, settled) if covered > LEAST_COVERED else None
