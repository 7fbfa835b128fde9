"""Periodic motions: the period, and the spectra of the angle in every whole period.

The period may be a fractional number of samples: the clocks of generator and recorder differ by up
to 1e-4.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured, varies
from osl_analysis.signals import runs
from osl_analysis.trial import Array

Spectrum = NDArray[np.complex128]
# First and last time [s] from the first sample of each stretch in which a motion repeats itself.
Stretches = list[tuple[float, float]]

# ---- What counts as a repetition. Shares are of the RMS of the moving angle.
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
# a bench repeats the lines of a motion within 1 % of their size, a hand within 5 to 10 %
REPEATED_BY_BENCH = 0.02

# ---- What counts as a line
NEIGHBOURS = 8  # lines to each side that count as neighbours
STRONG = 0.1  # of the largest line; weaker ones do not help to find the period
EXCITED_NEARBY = 0.05  # of the largest neighbour
EXCITED = 0.005  # of the largest line
EXCITED_ERRORS = 5.0  # standard errors of the mean over periods


@dataclass(frozen=True)
class Realisation:
    """Consecutive whole periods of one periodic motion, unfiltered.

    Line k is the sine Re(X_k exp(2j pi k t/period)) of the angle, t from the first sample of each
    period; line 0 is its mean.
    """

    period: float  # [s]
    spectra: Spectrum  # lines of the angle [rad], shape (periods, lines)
    start: float  # time [s] of the first period, from the first sample of the record

    @property
    def periods(self) -> int:
        return int(self.spectra.shape[0])

    @property
    def mean_lines(self) -> Spectrum:
        """Means of the lines over the periods, (lines,)."""
        return np.asarray(self.spectra.mean(axis=0))


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
    theta: Array,
    rate_hz: float,
    highest_hz: float,
    usable: NDArray[np.bool_] | None = None,
) -> PeriodicMotion | None:
    """Find the realisations of a periodic motion in a record.

    Parameters
    ----------
    theta : Array
        Unfiltered, (n,) [rad].
    rate_hz : float
        Sampling rate [Hz].
    highest_hz : float
        Up to which lines go [Hz].
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
    """
    repetition = find_repetition(theta, rate_hz, usable)
    if repetition is None:
        return None
    period = repetition.lag
    for _ in range(3):
        realisations = realisations_of(repetition.stretches, period, theta, rate_hz, highest_hz)
        if not realisations:
            return None
        period *= 1 + phase_drift(realisations)
    realisations = realisations_of(repetition.stretches, period, theta, rate_hz, highest_hz)
    if not realisations or not all(map(is_repeated_by_bench, realisations)):
        return None
    return PeriodicMotion(period, tuple(realisations))


def is_repeated_by_bench(realisation: Realisation) -> bool:
    """Whether the angle's lines scatter as little over the periods as a bench makes them."""
    mean = realisation.mean_lines
    variance = np.sum(scatter(realisation.spectra)[1:])
    power = np.sum(np.abs(mean[1:]) ** 2)
    return bool(variance <= REPEATED_BY_BENCH**2 * power)


def find_repetition(
    theta: Array, rate_hz: float, usable: NDArray[np.bool_] | None = None
) -> Repetition | None:
    """Find the shortest lag after which an angle repeats itself.

    Parameters
    ----------
    theta : Array
        (n,) [rad].
    rate_hz : float
        Sampling rate [Hz].
    usable : Array or None
        (n,) rows that are not near a gap; None: all.

    Returns
    -------
    Repetition or None
        With stretches of two periods or more; None if the angle does not repeat itself.

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
    averaged = theta[:rows].reshape(-1, step).mean(axis=1)
    x = np.asarray(scipy.signal.detrend(averaged))
    usable_rows = np.ones(rows, dtype=bool) if usable is None else usable[:rows]
    usable_bins = np.asarray(usable_rows.reshape(-1, step).all(axis=1))
    spline = scipy.interpolate.make_interp_spline(np.arange(len(x)), x, k=3)

    candidates = []
    for lag in likely_lags(x):
        repetition = repetition_after(x, spline, usable_bins, lag, rate_hz / step)
        if repetition is not None:
            candidates.append(repetition)
    if not candidates:
        return None
    best = min(candidate.mismatch for candidate in candidates)
    # the shortest lag with a mismatch within a factor of two of the best is the period, not a
    # multiple of it
    return min(candidate for candidate in candidates if candidate.mismatch <= 2 * best + FLOOR)


def likely_lags(x: Array) -> Array:
    """Lags [samples] at peaks of the autocorrelation of x (n,) after its first negative value,
    interpolated by a parabola; the highest first.

    The autocorrelation is divided by the size of both overlapping parts, so that it does not fall
    with the lag.
    """
    n = len(x)
    lags = np.arange(n // 2 + 1)
    products = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * n)) ** 2, 2 * n)[lags]
    energy = np.concatenate([[0.0], np.cumsum(x**2)])
    size = np.sqrt(energy[n - lags] * np.maximum(energy[n] - energy[lags], 0.0))
    correlation = np.divide(products, size, out=np.zeros(len(lags)), where=size > 1e-9 * energy[n])
    negative = np.flatnonzero(correlation < 0)
    if not len(negative):
        return np.empty(0)

    inner = np.arange(max(int(negative[0]), 1), len(correlation) - 1)
    before = correlation[inner - 1]
    here = correlation[inner]
    after = correlation[inner + 1]
    is_peak = (here >= before) & (here > after) & (here > LEAST_CORRELATION)
    curvature = (before - 2 * here + after)[is_peak]
    slope = (before - after)[is_peak]
    peaks = inner[is_peak] + 0.5 * slope / np.where(curvature < 0, curvature, -1.0)
    highest = peaks[np.argsort(-here[is_peak], kind="stable")[:MOST_LAGS]]

    # a peak at the largest lag has no sample behind it
    last = len(correlation) - 1
    if last > 1 and correlation[last] > max(LEAST_CORRELATION, correlation[last - 1]):
        return np.append(highest, float(last))
    return np.asarray(highest)


def repetition_after(
    x: Array, spline: Any, usable: NDArray[np.bool_], lag: float, rate_hz: float
) -> Repetition | None:
    """The repetition of an angle x (n,) after about a lag [samples]; None if it does not repeat
    itself for most of the time.

    The lag is corrected. `spline` goes through x; rows that are not `usable` (n,) do not count.
    """
    power = scipy.ndimage.uniform_filter1d(x**2, max(round(lag), 1), mode="nearest")
    moving = np.asarray(power > MOVING**2 * np.max(power))
    rms = float(np.sqrt(np.mean(x[moving] ** 2))) if moving.any() else 0.0
    counts = usable & moving

    for _ in range(2):
        rows_compared = int(len(x) - np.ceil(lag))
        difference = np.asarray(spline(np.arange(rows_compared) + lag)) - x[:rows_compared]
        window = max(round(COMPARED_S * rate_hz), 1)
        mean_square = scipy.ndimage.uniform_filter1d(difference**2, window, mode="nearest")
        mismatch = np.sqrt(np.maximum(mean_square, 0.0))
        similar = runs_of_a_lag(mismatch < SIMILAR * rms, counts, lag)
        if not similar:
            return None
        rows = np.concatenate([np.r_[run] for run in similar])
        slope = np.asarray(spline(np.arange(int(rows.max()) + 1) + lag, 1))[rows]
        slope_square = max(float(slope @ slope), np.finfo(float).tiny)
        lag -= float(slope @ difference[rows]) / slope_square
        if not 1 <= lag < len(x) - 1:  # an angle at rest has no slope
            return None

    median = float(np.median(mismatch[rows]))
    settled = runs_of_a_lag(mismatch < max(SETTLED * median, FLOOR * rms), counts, lag)
    repeated = sum(run.stop - run.start + lag for run in settled)
    covered = repeated / max(int(moving.sum()), 1)
    if median > LARGEST_MISMATCH * rms or covered < LEAST_COVERED:
        return None
    stretches = [(run.start / rate_hz, (run.stop + lag) / rate_hz) for run in settled]
    return Repetition(lag / rate_hz, median / rms, stretches)


def runs_of_a_lag(similar: NDArray[np.bool_], counts: NDArray[np.bool_], lag: float) -> list[slice]:
    """Runs of at least one lag [samples] in which the angle is `similar` (m,) to itself a lag
    later, and both rows count (n,)."""
    m = len(similar)
    whole = round(lag)
    counts_later = np.concatenate([counts[whole:], np.repeat(counts[-1:], whole)])[:m]
    shortest = WHOLE_LAG * lag - 1
    return [
        run for run in runs(similar & counts[:m] & counts_later) if run.stop - run.start > shortest
    ]


def realisations_of(
    stretches: Stretches, period: float, theta: Array, rate_hz: float, highest_hz: float
) -> list[Realisation]:
    """Take the whole periods of each stretch, counted backwards from its end.

    The incomplete rest is at the beginning, where a transient is.
    """
    samples = period * rate_hz
    last = len(theta)
    lines = int(np.floor(min(highest_hz, rate_hz / 3) * period + 1e-9)) + 1
    blurred = 3 * rate_hz / COARSE_HZ  # samples by which the ends of a stretch are uncertain
    realisations = []
    for start, stop in stretches:
        end = min(stop * rate_hz, last)
        periods = int((end - max(start * rate_hz, 0.0) + blurred) / samples)
        first = max(end - periods * samples, 0.0)
        if first + periods * samples > last + 1:
            periods -= 1
        if periods < 2:  # one has no scatter
            continue
        spectra = period_spectra(theta, first, samples, periods, lines)
        realisations.append(Realisation(period, spectra, first / rate_hz))
    return realisations


def period_spectra(
    signal: Array, first: float, samples: float, periods: int, lines: int
) -> Spectrum:
    """The first lines of each period, (periods, lines), from the place `first` of a signal (n,) on.

    A period has `samples` samples, not a whole number. The drift of the periods' means is
    subtracted: as a ramp in every period it adds 1/k to line k.
    """
    places = int(np.ceil(samples))
    share = np.arange(places) / places
    # its error is 3e-5 at a sixth of the rate
    spline = scipy.interpolate.make_interp_spline(np.arange(len(signal)), signal, k=5)
    resampled = spline(first + samples * (np.arange(periods)[:, None] + share))
    spectra = np.fft.rfft(resampled, axis=1)[:, :lines]

    number = np.arange(periods) - (periods - 1) / 2
    drift = float(number @ spectra[:, 0].real / places) / float(number @ number)
    spectra -= drift * np.fft.rfft(share - share.mean())[:lines]
    spectra[:, 0] -= drift * places * number

    spectra /= places
    spectra[:, 1:] *= 2
    return spectra


def phase_drift(realisations: Sequence[Realisation]) -> float:
    """The share by which the period is too short, from the phases of strong lines over the periods.

    If the true period is longer by a share d, line k of period p is late by 2 pi k p d.
    """
    expected = []
    late = []
    weight = []
    for realisation in realisations:
        mean = realisation.mean_lines
        size = np.abs(mean[1:])
        k = 1 + np.flatnonzero(size > STRONG * size.max())
        number = np.arange(realisation.periods) - (realisation.periods - 1) / 2
        late_phase = -np.angle(realisation.spectra[:, k] / mean[k])
        expected.append((2 * np.pi * number[:, None] * k).ravel())
        late.append(late_phase.ravel())
        weight.append(np.broadcast_to(np.abs(mean[k]) ** 2, late_phase.shape).ravel())
    x = np.concatenate(expected)
    y = np.concatenate(late)
    w = np.concatenate(weight)
    return float(np.sum(w * x * y)) / float(np.sum(w * x**2))


def excited_lines(realisations: Sequence[Realisation]) -> NDArray[np.intp]:
    """Numbers of the lines that stand out of their neighbours and of the noise.

    Parameters
    ----------
    realisations : Sequence of Realisation
        Of one period; they share the lines.

    Raises
    ------
    InputError
        No line stands out of the noise.
    """
    power = [np.abs(r.mean_lines) ** 2 for r in realisations]
    size = np.sqrt(np.mean(power, axis=0))
    size[0] = 0.0
    variance_of_mean = [scatter(r.spectra) / r.periods for r in realisations]
    error = np.sqrt(np.mean(variance_of_mean, axis=0) / len(realisations))
    largest_nearby = scipy.ndimage.maximum_filter1d(size, 2 * NEIGHBOURS + 1)
    least = np.max(
        [EXCITED_NEARBY * largest_nearby, np.full_like(size, EXCITED * size.max())], axis=0
    )
    excited = np.flatnonzero((size > least) & (size > EXCITED_ERRORS * error))
    if not len(excited):
        raise InputError(
            "no line of the motion stands out of the noise; move the joint further, or record for"
            " longer"
        )
    return excited


def scatter(periods: Spectrum) -> Array:
    """Variance E|x - mean|^2 (lines,) of each line in a single period, from lines (periods, lines),
    of 2 (periods - 1) degrees of freedom."""
    squares = np.abs(periods - periods.mean(axis=0)) ** 2
    return np.asarray(np.sum(squares, axis=0) / (len(periods) - 1))
