"""Realisations of a periodic motion: the spectra of angle and torque in every whole period of a record,
which of their lines are excited, and these lines as a table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.ndimage import maximum_filter1d

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.spectral.period import COARSE_HZ, Repetition, Spectrum, find_repetition
from osl_analysis.trial import Array

FEWEST_PERIODS = 2  # smallest number of periods of a realisation; one has no scatter
BLURRED = 3  # coarse samples by which the ends of a stretch are uncertain
REFINEMENTS = 2  # how often the period is corrected by the phases of its lines
STRONG = 0.1  # size of a line, as a share of the largest, from which its phase helps to find the period
LARGEST_UNSTEADINESS = 0.02
"""Largest difference of the lines of two periods, as a share of their size. A bench repeats a motion within 1 %, a hand
that tries to within 5 to 10."""
SAME_MOTION = 0.99
"""Correlation of two mean periods, at the best shift, from which they are one realisation, recorded twice."""


@dataclass(frozen=True)
class Realisation:
    """Whole periods of one periodic motion, which follow one another. Line k is the sine Re(X_k exp(2j pi k t/period))
    of a signal; line 0 is its mean. The first sample of each period is its zero of time. No filter was applied: a ratio
    of torque and angle needs none where both have the same."""

    period: float  # period [s]
    rate_hz: float  # sampling rate [Hz]
    theta: Spectrum  # lines of the angle [rad], shape (periods, lines)
    torque: Spectrum  # lines of the resisting torque [N*m], shape (periods, lines)
    start: float  # when the first period begins [s], from the first sample of the record
    steps: tuple[float | None, float | None] = (None, None)
    """Steps to which angle [rad] and torque [N*m] were rounded; None where they are not known."""

    @property
    def periods(self) -> int:
        return len(self.theta)

    @property
    def frequency_hz(self) -> Array:
        """Frequencies [Hz] of the lines, shape (lines,)."""
        return np.arange(self.theta.shape[1]) / self.period


@dataclass(frozen=True)
class PeriodicMotion:
    """A periodic motion and its realisations."""

    period: float  # period [s]
    period_error_ppm: float  # standard error of the period, from the scatter of the lines' phases [1e-6 of the period]
    realisations: tuple[Realisation, ...]


def periodic_motion(
    theta: Array, torque: Array, rate_hz: float, highest_hz: float, usable: NDArray[np.bool_] | None = None
) -> PeriodicMotion | None:
    """The realisations in a record of angle [rad] and torque [N*m], shape (n,) each; None if it does not repeat itself.

    Lines go up to `highest_hz`. `usable` (n,) are the rows that are not near a gap. The signals are not filtered.

    Raises InputError: A value cannot be measured.
    """
    check_measured("the torque", torque)
    found = find_repetition(theta, rate_hz, usable)
    if found is None:
        return None
    period, error, made = found.period, np.inf, list[Realisation]()
    for _ in range(REFINEMENTS + 1):
        made = realisations_of(found, period, (theta,), rate_hz, highest_hz)
        if not made:
            return None
        change, error = phase_drift(made)
        period *= 1 + change
    made = realisations_of(found, period, (theta, torque), rate_hz, highest_hz)
    for one in made:
        mean = one.theta.mean(axis=0)
        apart = np.sum(np.abs((one.theta - mean)[:, 1:]) ** 2) / (one.periods - 1)
        if apart > LARGEST_UNSTEADINESS**2 * np.sum(np.abs(mean[1:]) ** 2):
            return None
    return PeriodicMotion(period, 1e6 * error, tuple(made)) if made else None


def realisations_of(
    found: Repetition, period: float, signals: Sequence[Array], rate_hz: float, highest_hz: float
) -> list[Realisation]:
    """The realisations in the stretches that were found, each from its last whole period backwards. A transient is at
    the beginning of a stretch; what is over is therefore left out there. The signals are the angle (n,) and the torque,
    or the angle alone, whose lines then stand in both places."""
    samples, last = period * rate_hz, len(signals[0])
    count = int(np.floor(min(highest_hz, rate_hz / 3) * period + 1e-9)) + 1
    made = []
    for start, stop in found.stretches:
        end = min(stop * rate_hz, last)
        periods = int((end - max(start * rate_hz, 0.0) + BLURRED * rate_hz / COARSE_HZ) / samples)
        first = max(end - periods * samples, 0.0)
        if first + periods * samples > last + 1:
            periods -= 1
        if periods >= FEWEST_PERIODS:
            spectra = [period_spectra(signal, first, samples, periods, count) for signal in signals]
            made.append(Realisation(period, rate_hz, spectra[0], spectra[-1], first / rate_hz))
    return made


def period_spectra(signal: Array, first: float, samples: float, periods: int, count: int) -> Spectrum:
    """The first lines of each period of `samples` samples from the place `first` of a signal (n,) on, (periods, count).
    The drift that the means of the periods show is taken off. It is a ramp in every period, so that no scatter shows
    it, and adds 1/k to line k."""
    places = int(np.ceil(samples))
    share = np.arange(places) / places
    spline = make_interp_spline(np.arange(len(signal)), signal, k=5)  # errs by 3e-5 at a sixth of the rate
    found = np.fft.rfft(spline(first + samples * (np.arange(periods)[:, None] + share)), axis=1)[:, :count]
    number = np.arange(periods) - (periods - 1) / 2
    slope = float(number @ found[:, 0].real / places) / float(number @ number)
    found -= slope * np.fft.rfft(share - share.mean())[:count]
    found[:, 0] -= slope * places * number
    found /= places
    found[:, 1:] *= 2
    return found


def phase_drift(made: Sequence[Realisation]) -> tuple[float, float]:
    """By which share the period is too short, from the phases of strong lines over the periods, with standard error. If
    the true period is longer by a share d, line k of period p is late by 2 pi k p d."""
    steps, phases, weights = list[Array](), list[Array](), list[Array]()
    for one in made:
        mean = one.theta.mean(axis=0)
        k = 1 + np.flatnonzero(np.abs(mean[1:]) > STRONG * np.abs(mean[1:]).max())
        number = np.arange(one.periods) - (one.periods - 1) / 2
        steps.append((2 * np.pi * number[:, None] * k).ravel().astype(float))
        phases.append(-np.angle(one.theta[:, k] / mean[k]).ravel())
        weights.append(np.broadcast_to(np.abs(mean[k]) ** 2, (one.periods, len(k))).ravel())
    x, y, w = (np.concatenate(each) for each in (steps, phases, weights))
    size = float(np.sum(w * x**2))
    share = float(np.sum(w * x * y)) / size
    left = float(np.sqrt(np.sum((w * x * (y - share * x)) ** 2))) / size
    return share, left


def distinct(made: Sequence[Realisation]) -> list[Realisation]:
    """The realisations of one period, those that are one motion recorded twice joined to one, in their order. A motion
    that is repeated has the same distortion again; only other phases give another one."""
    joined: list[Realisation] = []
    for one in with_common_lines(made):
        for place, other in enumerate(joined):
            shift = shift_between(other, one)
            if shift is not None:
                k = np.arange(one.theta.shape[1])
                turn = np.exp(2j * np.pi * k * shift)
                joined[place] = replace(
                    other,
                    theta=np.vstack([other.theta, one.theta * turn]),
                    torque=np.vstack([other.torque, one.torque * turn]),
                )
                break
        else:
            joined.append(one)
    return joined


def with_common_lines(made: Sequence[Realisation]) -> list[Realisation]:
    """The realisations with the lines that all have: the period decides whether the last one is below the cut-off."""
    lines = min((one.theta.shape[1] for one in made), default=0)
    return [replace(one, theta=one.theta[:, :lines], torque=one.torque[:, :lines]) for one in made]


def shift_between(first: Realisation, second: Realisation) -> float | None:
    """Share of a period by which the second must be turned on to be the first; None if it is another motion."""
    one, two = (r.theta.mean(axis=0)[1:] for r in (first, second))
    if abs(first.period - second.period) > 1e-3 * first.period:
        return None
    cross = one * two.conj()
    count = 16 * (len(cross) + 1)
    along = np.fft.ifft(np.concatenate([[0.0], cross]), count).real * count
    size = float(np.linalg.norm(one) * np.linalg.norm(two))
    if not size or float(along.max()) < SAME_MOTION * size:
        return None
    at, k = -float(np.argmax(along)) / count, np.arange(1, len(cross) + 1)
    for _ in range(3):
        phase = np.angle(cross * np.exp(-2j * np.pi * k * at))
        weight = np.abs(cross) * k
        at += float(np.sum(weight * phase)) / (2 * np.pi * float(np.sum(weight * k)))
    return at


NEIGHBOURS = 8  # lines to each side of a line that count as its neighbourhood
BESIDE_NEIGHBOURS, BESIDE_ALL = 0.05, 0.005
"""Size of an excited line, as a share of the largest one in its neighbourhood, and of all."""
ABOVE_NOISE = 5.0  # standard errors by which an excited line differs from 0
PERIODS_AGREE = 1e-3  # largest difference between the periods of realisations that are analysed together, as a share


@dataclass(frozen=True)
class LineKinds:
    """Kinds of the lines of a periodic motion, shape (lines,) each; line 0, the mean, is none of them."""

    excited: NDArray[np.bool_]
    odd: NDArray[np.bool_]  # odd lines that are not excited, from half the lowest to the highest excited line
    even: NDArray[np.bool_]  # even lines that are not excited, in the same band

    @property
    def only_odd(self) -> bool:
        """Whether only odd lines are excited, so that odd and even distortion are seen apart."""
        return not self.excited[::2].any()

    @property
    def detection(self) -> NDArray[np.bool_]:
        """Lines that show the distortion at excited lines: of an odd motion the odd ones, else all, (lines,)."""
        return self.odd if self.only_odd else self.odd | self.even


def lines_of(realisations: Sequence[Realisation]) -> LineKinds:
    """The kinds of the lines that the realisations share, from the size of the angle's lines.

    Raises InputError: There is no realisation, periods differ, or no line stands out of the noise.
    """
    check_alike(realisations)
    size = np.sqrt(np.mean([np.abs(r.theta.mean(axis=0)) ** 2 for r in realisations], axis=0))
    error = np.sqrt(np.mean([scatter(r.theta) / r.periods for r in realisations], axis=0) / len(realisations))
    size[0] = 0.0
    largest = maximum_filter1d(size, 2 * NEIGHBOURS + 1)
    excited = (size > BESIDE_NEIGHBOURS * largest) & (size > BESIDE_ALL * size.max()) & (size > ABOVE_NOISE * error)
    if not excited.any():
        raise InputError("no line of the motion stands out of the noise; move the joint further, or record for longer")
    k, at = np.arange(len(size)), np.flatnonzero(excited)
    band = (k >= at[0] / 2) & (k <= at[-1]) & ~excited & (k > 0)
    return LineKinds(excited, band & (k % 2 == 1), band & (k % 2 == 0))


def check_alike(realisations: Sequence[Realisation]) -> None:
    """Refuse no realisation, or realisations with different periods."""
    if not realisations:
        raise InputError("no periods to fit; record at least two periods of the motion")
    periods = np.array([r.period for r in realisations])
    if np.ptp(periods) > PERIODS_AGREE * periods[0]:
        raise InputError(
            f"realisations with periods from {periods.min():.6g} to {periods.max():.6g} s cannot be fitted together; "
            "analyse them as trials of their own"
        )


def scatter(periods: Spectrum) -> Array:
    """Variance E|x - mean|^2 of a single period of each line, from lines (periods, lines); it has 2 (periods - 1)
    degrees of freedom."""
    return np.asarray(np.sum(np.abs(periods - periods.mean(axis=0)) ** 2, axis=0) / (len(periods) - 1))


def smoothed_lines(values: Array, weights: Array) -> Array:
    """Mean of the values (lines,) over each line and its `NEIGHBOURS`, with `weights` (lines,)."""
    window = np.ones(2 * NEIGHBOURS + 1)
    total = np.convolve(weights, window, "same")
    return np.asarray(np.convolve(values * weights, window, "same") / np.maximum(total, np.finfo(float).tiny))


SIZES_AGREE = 0.1
"""Largest difference between the sizes of two motions, and of their lines, that are realisations of one condition, as a
share. Friction weighs more in a smaller motion."""
LINES: dict[str, type[pl.DataType]] = {
    "trial": pl.String,
    **dict.fromkeys(("realisation", "period", "line"), pl.Int64),
    **dict.fromkeys(("period_s", "rate_hz", "start_s", "theta_step", "torque_step"), pl.Float64),
    **dict.fromkeys(("theta_re", "theta_im", "torque_re", "torque_im"), pl.Float64),
}
"""Columns of the lines of the periods of a trial."""


def lines_frame(trial: str, realisations: Sequence[Realisation]) -> pl.DataFrame:
    """A row per realisation, period and line."""
    frames = []
    for number, one in enumerate(realisations):
        period, line = (index.ravel() for index in np.indices(one.theta.shape))
        theta, torque = one.theta.ravel(), one.torque.ravel()
        columns: dict[str, object] = {
            "trial": trial, "realisation": number, "period": period, "line": line, "period_s": one.period,
            "rate_hz": one.rate_hz, "start_s": one.start,
            "theta_step": one.steps[0], "torque_step": one.steps[1], "theta_re": theta.real, "theta_im": theta.imag,
            "torque_re": torque.real, "torque_im": torque.imag,
        }  # fmt: skip
        frames.append(pl.DataFrame(columns, schema=LINES))
    return pl.concat(frames)


def realisations_from(lines: pl.DataFrame) -> list[Realisation]:
    """The realisations of one trial that `lines_frame` wrote."""
    made = []
    for rows in lines.partition_by("realisation", maintain_order=True):
        shape = (rows["period"].n_unique(), rows["line"].n_unique())
        theta, torque = (
            (rows[f"{name}_re"].to_numpy() + 1j * rows[f"{name}_im"].to_numpy()).reshape(shape)
            for name in ("theta", "torque")
        )
        period, rate_hz, start, *steps = rows.select("period_s", "rate_hz", "start_s", "theta_step", "torque_step").row(
            0
        )
        made.append(Realisation(period, rate_hz, theta, torque, start, (steps[0], steps[1])))
    return made


def alike(first: Realisation, second: Realisation) -> bool:
    """Whether two motions differ in their phases only: the same period, and lines of the same size."""
    if abs(first.period - second.period) > PERIODS_AGREE * first.period:
        return False
    one, two = (np.abs(r.theta.mean(axis=0)[1:]) for r in with_common_lines([first, second]))
    return bool(np.linalg.norm(one - two) <= SIZES_AGREE * np.linalg.norm(one))


def pooled(trials: Mapping[str, Sequence[Realisation]]) -> list[dict[str, list[Realisation]]]:
    """Trials of one condition, each by name with its realisations, sorted by motions that are alike; two or more each.
    A trial whose own realisations differ is with those that are like its first one."""
    groups: list[dict[str, list[Realisation]]] = []
    for name, made in trials.items():
        for group in groups:
            if alike(next(iter(group.values()))[0], made[0]):
                group[name] = list(made)
                break
        else:
            groups.append({name: list(made)})
    return [group for group in groups if len(group) > 1]
