"""Periodic motions: the period, and the spectra of every whole period.

The period may be a fractional number of samples: the clocks of generator and recorder differ by up
to 1e-4."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured, varies
from osl_analysis.signals import runs
from osl_analysis.trial import Array

Spectrum = NDArray[np.complex128]
COARSE_HZ = 100.0  # rate [Hz], by averaging samples, at which periods are searched
FLOOR = 3e-4  # share of the motion's RMS below which a mismatch counts as none
NEIGHBOURS = 8  # lines to each side that count as neighbours

Stretches = list[tuple[float, float]]
"""First and last time [s] from the first sample of each stretch in which a motion repeats
itself."""


def find_repetition(
    theta: Array, rate_hz: float, usable: NDArray[np.bool_] | None = None
) -> tuple[float, Stretches] | None:
    """The shortest lag [s] after which an angle (n,) [rad], sampled at `rate_hz`, repeats itself,
    and its stretches of two periods or more; None if it does not. `usable` (n,) are the rows that
    are not near a gap.

    At the lags that the autocorrelation proposes, the motion is compared with itself in short
    windows. In a record of several motions of one period, with transients and rests, the comparison
    then fails only where a motion ends. A stepped sine also repeats itself: look for its protocol
    first."""
    check_measured("the angle", theta)
    if not varies(theta):
        return None
    step = max(int(rate_hz / COARSE_HZ), 1)
    rows = len(theta) // step * step
    x = np.asarray(scipy.signal.detrend(theta[:rows].reshape(-1, step).mean(axis=1)))
    every = np.ones(rows, dtype=bool) if usable is None else usable[:rows]
    good = np.asarray(every.reshape(-1, step).all(axis=1))
    spline = scipy.interpolate.make_interp_spline(np.arange(len(x)), x, k=3)
    tried = [
        one
        for lag in likely_lags(x)
        if (one := repetition(x, spline, good, lag, rate_hz / step)) is not None
    ]
    if not tried:
        return None
    best = min(mismatch for _, mismatch, _ in tried)
    # the shortest lag with a mismatch within a factor of two of the best is the period, not a
    # multiple of it
    period, _, stretches = min(one for one in tried if one[1] <= 2 * best + FLOOR)
    return period, stretches


def likely_lags(x: Array) -> Array:
    """Lags at peaks of the autocorrelation of x (n,) after its first negative value, interpolated
    by a parabola. The autocorrelation is divided by the size of both overlapping parts, so that it
    does not fall with the lag; with realisations of two periods each it is 0.5."""
    n, least = len(x), 0.3
    lags = np.arange(n // 2 + 1)
    products = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * n)) ** 2, 2 * n)[lags]
    energy = np.concatenate([[0.0], np.cumsum(x**2)])
    size = np.sqrt(energy[n - lags] * np.maximum(energy[n] - energy[lags], 0.0))
    correlation = np.divide(products, size, out=np.zeros(len(lags)), where=size > 1e-9 * energy[n])
    negative = np.flatnonzero(correlation < 0)
    if not len(negative):
        return np.empty(0)
    inner = np.arange(max(int(negative[0]), 1), len(correlation) - 1)
    before, here, after = correlation[inner - 1], correlation[inner], correlation[inner + 1]
    peak = (here >= before) & (here > after) & (here > least)
    bend = (before - 2 * here + after)[peak]
    at = inner[peak] + 0.5 * (before - after)[peak] / np.where(bend < 0, bend, -1.0)
    highest = np.argsort(-here[peak], kind="stable")[:60]
    last = len(correlation) - 1
    at_end = last > 1 and correlation[last] > max(least, correlation[last - 1])
    return np.array([*at[highest], *([float(last)] if at_end else [])])


def repetition(
    x: Array, spline: Any, good: NDArray[np.bool_], lag: float, rate_hz: float
) -> tuple[float, float, Stretches] | None:
    """The corrected lag [s], the mismatch, and the stretches in which an angle x (n,), with a
    spline through it, repeats itself after a lag [samples]; None if it does not for most of the
    time. The mismatch is the RMS of the difference, median over time, as a share of the angle's.
    Rows that are not `good` do not count."""
    power = scipy.ndimage.uniform_filter1d(x**2, max(round(lag), 1), mode="nearest")
    moving = np.asarray(power > 0.2**2 * np.max(power))  # elsewhere the joint rests
    scale = float(np.sqrt(np.mean(x[moving] ** 2))) if moving.any() else 0.0

    def alike_runs(alike: NDArray[np.bool_]) -> list[slice]:
        """Runs of at least one lag, without gaps, in which the moving joint is `alike` (m,) itself
        a lag later."""
        m, whole, there = len(alike), round(lag), good & moving
        later = np.concatenate([there[whole:], np.repeat(there[-1:], whole)])[:m]
        shortest = 0.98 * lag - 1  # windows and averages blur the ends of a stretch of two periods
        return [run for run in runs(alike & there[:m] & later) if run.stop - run.start > shortest]

    for _ in range(2):
        m = int(len(x) - np.ceil(lag))
        difference = np.asarray(spline(np.arange(m) + lag)) - x[:m]
        window = max(round(0.25 * rate_hz), 1)
        local = np.sqrt(
            np.maximum(scipy.ndimage.uniform_filter1d(difference**2, window, mode="nearest"), 0.0)
        )
        found = alike_runs(local < 0.25 * scale)
        if not found:
            return None
        rows = np.concatenate([np.r_[run] for run in found])
        slope = np.asarray(spline(np.arange(int(rows.max()) + 1) + lag, 1))[rows]
        lag -= float(slope @ difference[rows]) / max(float(slope @ slope), np.finfo(float).tiny)
        if not 1 <= lag < len(x) - 1:  # an angle at rest has no slope
            return None
    middle = float(np.median(local[rows]))
    settled = alike_runs(local < max(5 * middle, FLOOR * scale))  # the transient has ended
    covered = sum(run.stop - run.start + lag for run in settled) / max(int(moving.sum()), 1)
    if middle > 0.1 * scale or covered < 0.5:
        return None
    return (
        lag / rate_hz,
        middle / scale,
        [(run.start / rate_hz, (run.stop + lag) / rate_hz) for run in settled],
    )


@dataclass(frozen=True)
class Realisation:
    """Consecutive whole periods of one periodic motion, unfiltered. Line k is the sine Re(X_k
    exp(2j pi k t/period)) of a signal, t from the first sample of each period; line 0 is its
    mean."""

    period: float  # period [s]
    # lines of the angle [rad] and of the resisting torque [N*m], shape (2, periods, lines)
    spectra: Spectrum
    start: float  # time [s] of the first period, from the first sample of the record

    @property
    def periods(self) -> int:
        return int(self.spectra.shape[1])

    @property
    def frequency_hz(self) -> Array:
        """Frequencies [Hz] of the lines, shape (lines,)."""
        return np.arange(self.spectra.shape[2]) / self.period

    @property
    def mean_lines(self) -> Spectrum:
        """Means over the periods of the lines of angle and torque, (2, lines)."""
        return np.asarray(self.spectra.mean(axis=1))


@dataclass(frozen=True)
class PeriodicMotion:
    period: float  # [s]
    realisations: tuple[Realisation, ...]


def periodic_motion(
    theta: Array,
    torque: Array,
    rate_hz: float,
    highest_hz: float,
    usable: NDArray[np.bool_] | None = None,
) -> PeriodicMotion | None:
    """The realisations in a record of unfiltered angle [rad] and torque [N*m], shape (n,) each;
    None if it does not repeat itself. Lines go up to `highest_hz`. `usable` (n,) are the rows that
    are not near a gap. Raises InputError: a value cannot be measured."""
    check_measured("the torque", torque)
    found = find_repetition(theta, rate_hz, usable)
    if found is None:
        return None
    period, stretches = found
    for _ in range(3):
        made = realisations_of(stretches, period, (theta,), rate_hz, highest_hz)
        if not made:
            return None
        period *= 1 + phase_drift(made)
    made = realisations_of(stretches, period, (theta, torque), rate_hz, highest_hz)
    for one in made:
        mean = one.mean_lines[0]
        apart = np.sum(scatter(one.spectra[0])[1:])
        # a bench repeats the lines of a motion within 1 % of their size, a hand within 5 to 10 %
        if apart > 0.02**2 * np.sum(np.abs(mean[1:]) ** 2):
            return None
    return PeriodicMotion(period, tuple(made)) if made else None


def realisations_of(
    stretches: Stretches, period: float, signals: Sequence[Array], rate_hz: float, highest_hz: float
) -> list[Realisation]:
    """The realisations in the stretches, each counted backwards from its last whole period: the
    incomplete rest is at the beginning, where a transient is. The signals are the angle (n,), and
    the torque."""
    samples, last = period * rate_hz, len(signals[0])
    count = int(np.floor(min(highest_hz, rate_hz / 3) * period + 1e-9)) + 1
    made = []
    for start, stop in stretches:
        end = min(stop * rate_hz, last)
        blurred = 3 * rate_hz / COARSE_HZ  # samples by which the ends of a stretch are uncertain
        periods = int((end - max(start * rate_hz, 0.0) + blurred) / samples)
        first = max(end - periods * samples, 0.0)
        if first + periods * samples > last + 1:
            periods -= 1
        if periods >= 2:  # one has no scatter
            spectra = np.array(
                [period_spectra(signal, first, samples, periods, count) for signal in signals]
            )
            made.append(Realisation(period, spectra, first / rate_hz))
    return made


def period_spectra(
    signal: Array, first: float, samples: float, periods: int, count: int
) -> Spectrum:
    """The first lines of each period of `samples` samples, from the place `first` of a signal (n,)
    on, (periods, count). The drift of the periods' means is subtracted: as a ramp in every period
    it adds 1/k to line k."""
    places = int(np.ceil(samples))
    share = np.arange(places) / places
    # its error is 3e-5 at a sixth of the rate
    spline = scipy.interpolate.make_interp_spline(np.arange(len(signal)), signal, k=5)
    found = np.fft.rfft(spline(first + samples * (np.arange(periods)[:, None] + share)), axis=1)[
        :, :count
    ]
    number = np.arange(periods) - (periods - 1) / 2
    slope = float(number @ found[:, 0].real / places) / float(number @ number)
    found -= slope * np.fft.rfft(share - share.mean())[:count]
    found[:, 0] -= slope * places * number
    found /= places
    found[:, 1:] *= 2
    return found


def phase_drift(made: Sequence[Realisation]) -> float:
    """The share by which the period is too short, from the phases of strong lines over the periods.
    If the true period is longer by a share d, line k of period p is late by 2 pi k p d."""
    found = []
    for one in made:
        mean = one.mean_lines[0]
        k = 1 + np.flatnonzero(np.abs(mean[1:]) > 0.1 * np.abs(mean[1:]).max())
        number = np.arange(one.periods) - (one.periods - 1) / 2
        late = -np.angle(one.spectra[0][:, k] / mean[k])
        found.append(
            [
                2 * np.pi * number[:, None] * k,
                late,
                np.broadcast_to(np.abs(mean[k]) ** 2, late.shape),
            ]
        )
    x, y, w = np.concatenate([np.reshape(one, (3, -1)) for one in found], axis=1)
    return float(np.sum(w * x * y)) / float(np.sum(w * x**2))


def distinct(made: Sequence[Realisation]) -> list[Realisation]:
    """The realisations of one period; a motion recorded twice counts once, since its distortion is
    the same."""
    merged: list[Realisation] = []
    for one in made:
        for place, other in enumerate(merged):
            shift = shift_between(other, one)
            if shift is not None:
                turned = one.spectra * np.exp(2j * np.pi * np.arange(one.spectra.shape[2]) * shift)
                merged[place] = replace(
                    other, spectra=np.concatenate([other.spectra, turned], axis=1)
                )
                break
        else:
            merged.append(one)
    return merged


def shift_between(first: Realisation, second: Realisation) -> float | None:
    """The share of a period by which the second must be advanced to match the first; None for
    another motion: the best correlation of the mean periods is below 0.99."""
    one, two = (r.mean_lines[0, 1:] for r in (first, second))
    cross = one * two.conj()
    count = 16 * (len(cross) + 1)
    along = np.fft.ifft(np.concatenate([[0.0], cross]), count).real * count
    size = float(np.linalg.norm(one) * np.linalg.norm(two))
    if not size or float(along.max()) < 0.99 * size:
        return None
    at, k = -float(np.argmax(along)) / count, np.arange(1, len(cross) + 1)
    for _ in range(3):
        phase = np.angle(cross * np.exp(-2j * np.pi * k * at))
        weight = np.abs(cross) * k
        at += float(np.sum(weight * phase)) / (2 * np.pi * float(np.sum(weight * k)))
    return at


@dataclass(frozen=True)
class LineKinds:
    """Kinds of the lines of a periodic motion, shape (lines,) each; line 0, the mean, is none of
    them."""

    excited: NDArray[np.bool_]
    # odd lines that are not excited, from half the lowest to the highest excited line
    odd: NDArray[np.bool_]
    even: NDArray[np.bool_]  # even lines that are not excited, in the same band

    @property
    def only_odd(self) -> bool:
        """Whether only odd lines are excited, so that odd and even distortion are seen apart."""
        return not self.excited[::2].any()


def lines_of(realisations: Sequence[Realisation]) -> LineKinds:
    """The kinds of the lines that the realisations, of one period, share, from the size of the
    angle's lines. Raises InputError: no line stands out of the noise."""
    size = np.sqrt(np.mean([np.abs(r.mean_lines[0]) ** 2 for r in realisations], axis=0))
    error = np.sqrt(
        np.mean([scatter(r.spectra[0]) / r.periods for r in realisations], axis=0)
        / len(realisations)
    )
    size[0] = 0.0
    largest = scipy.ndimage.maximum_filter1d(size, 2 * NEIGHBOURS + 1)
    excited = (size > 0.05 * largest) & (size > 0.005 * size.max()) & (size > 5.0 * error)
    if not excited.any():
        raise InputError(
            "no line of the motion stands out of the noise; move the joint further, or record for"
            " longer"
        )
    k, at = np.arange(len(size)), np.flatnonzero(excited)
    band = (k >= at[0] / 2) & (k <= at[-1]) & ~excited & (k > 0)
    return LineKinds(excited, band & (k % 2 == 1), band & (k % 2 == 0))


def scatter(periods: Spectrum) -> Array:
    """Variance E|x - mean|^2 of each line in a single period, from lines (periods, lines), of 2
    (periods - 1) degrees of freedom."""
    return np.asarray(
        np.sum(np.abs(periods - periods.mean(axis=0)) ** 2, axis=0) / (len(periods) - 1)
    )


def smoothed_lines(values: Array, weights: Array) -> Array:
    """Mean of the values (lines,) over each line and its `NEIGHBOURS`, with `weights` (lines,)."""
    window = np.ones(2 * NEIGHBOURS + 1)
    total = np.convolve(weights, window, "same")
    return np.asarray(
        np.convolve(values * weights, window, "same") / np.maximum(total, np.finfo(float).tiny)
    )
