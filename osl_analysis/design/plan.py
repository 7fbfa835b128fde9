"""Protocols that are planned: of which sines the motion consists, for how long each is fitted, and how long to record.

A plan has `sines`, `record_s` (length of the record [s], without rests), `peak` (largest angle [rad], velocity [rad/s]
and acceleration [rad/s^2]) and `words`. Its length is a number of cycles, of realisations, or of seconds: `lengths` are
the smallest and the largest that are tried, `of_length` is the same plan with another one. `banded` is the same plan
with a band [Hz] that is wider at one end.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.multisine import Multisine, odd_multisine
from osl_analysis.spectral.response import ENOUGH_REALISATIONS
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.trial import Array

LAST_CYCLES = 1  # Cycles at the end of a segment that are not fitted: the filter smears the next frequency into them
TRANSIENTS = 1  # Periods before those of a realisation, in which the joint settles
MOST_DRAWN = 20  # Number of realisations whose largest angle is looked for


@dataclass(frozen=True)
class Sines:
    """The sines of a motion, shape (n,) each."""

    frequency_hz: Array  # Frequency [Hz]
    size: Array  # Amplitude [rad]
    duration_s: Array  # Time [s] in which this sine is fitted
    cycle_s: Array  # Time [s] after which the whole motion repeats itself; `duration_s` where it does not
    velocity: Array  # RMS velocity [rad/s] of the whole motion while this sine is there
    cycles: Array  # Number of repetitions from whose spread the interval comes

    @property
    def w(self) -> Array:
        return np.asarray(2 * np.pi * self.frequency_hz)

    @property
    def alone(self) -> NDArray[np.bool_]:
        """Whether a sine is the whole motion while it is there."""
        return np.asarray(np.isclose(self.velocity, self.size * self.w / np.sqrt(2)), dtype=np.bool_)


@dataclass(frozen=True)
class SteppedSine:
    """A stepped sine: each amplitude at every frequency."""

    amplitudes: tuple[float, ...]  # Amplitudes [rad]
    frequencies_hz: tuple[float, ...]  # Frequencies [Hz]
    cycles: tuple[float, ...]  # Number of cycles at each frequency
    settle_cycles: int  # Cycles at the start of each that are not fitted

    @property
    def fitted(self) -> Array:
        """Number of cycles at each frequency that are fitted, as `protocol.stepped_sine.settled_cycles` leaves them."""
        return np.asarray(np.maximum(np.floor(np.asarray(self.cycles)) - self.settle_cycles - LAST_CYCLES, 1))

    @property
    def sines(self) -> Sines:
        a, f = (x.ravel() for x in np.meshgrid(self.amplitudes, self.frequencies_hz, indexing="ij"))
        fitted = np.tile(self.fitted, len(self.amplitudes))
        return Sines(f, a, fitted / f, 1 / f, np.sqrt(2) * np.pi * f * a, fitted)

    @property
    def record_s(self) -> float:
        return len(self.amplitudes) * float(np.sum(np.asarray(self.cycles) / self.frequencies_hz))

    @property
    def peak(self) -> tuple[float, float, float]:
        a, w = max(self.amplitudes), 2 * np.pi * max(self.frequencies_hz)
        return a, a * w, a * w**2

    @property
    def words(self) -> str:
        degrees = ", ".join(f"{np.rad2deg(a):.4g}" for a in self.amplitudes)
        hertz = ", ".join(f"{f:.4g}" for f in self.frequencies_hz)
        each = ", ".join(f"{n:.4g}" for n in dict.fromkeys(self.cycles))
        fitted = ", ".join(f"{n:.4g}" for n in dict.fromkeys(self.fitted.tolist()))
        return f"stepped sine: {degrees} deg at {hertz} Hz, {each} cycles at each ({fitted} fitted)"

    @property
    def lengths(self) -> tuple[int, int]:
        return self.settle_cycles + LAST_CYCLES + FEWEST_CYCLES, 2000

    def of_length(self, n: int) -> "SteppedSine":
        return replace(self, cycles=(float(n),) * len(self.frequencies_hz))

    def banded(self, low: float, high: float) -> "SteppedSine":
        f = tuple(sorted({low, *self.frequencies_hz, high}))
        return replace(self, frequencies_hz=f, cycles=(float(np.max(self.cycles)),) * len(f))


@dataclass(frozen=True)
class PeriodicMultisine:
    """Realisations of an odd random-phase multisine, whole periods of each after a transient."""

    period_s: float  # Period [s]
    band_hz: tuple[float, float]  # Lowest and highest frequency [Hz]
    rms: float  # Root mean square of the angle [rad]
    periods: int  # Periods of each realisation that are fitted
    realisations: int  # Number of realisations, which differ in their phases
    seed: int = 1  # Seed of lines and phases

    @cached_property
    def first(self) -> Multisine:
        return self.motion(0)

    def motion(self, realisation: int) -> Multisine:
        """One realisation; raises as `odd_multisine`."""
        return odd_multisine(self.period_s, self.band_hz, self.rms, self.seed, realisation)

    def of_peak(self, peak: float, realisations: int) -> "PeriodicMultisine":
        """The same with the largest angle [rad] that any of this many realisations reaches."""
        one = replace(self, rms=1.0)
        return replace(self, rms=peak / max(one.motion(r).peak for r in range(realisations)))

    @property
    def sines(self) -> Sines:
        motion, count = self.first, self.realisations * self.periods
        f = motion.frequency_hz
        velocity = float(np.sqrt(np.sum((2 * np.pi * f * motion.size) ** 2) / 2))
        each = np.ones(len(f))
        return Sines(f, motion.size, count * self.period_s * each, self.period_s * each, velocity * each, count * each)

    @property
    def record_s(self) -> float:
        return self.realisations * (self.periods + TRANSIENTS) * self.period_s

    @property
    def peak(self) -> tuple[float, float, float]:
        n = 16 * int(self.first.lines[-1])
        time = self.period_s * np.arange(n) / n
        motions = [self.motion(r) for r in range(min(self.realisations, MOST_DRAWN))]
        angle, velocity, acceleration = (
            max(float(np.max(np.abs(m.angle(time, derivative)))) for m in motions) for derivative in range(3)
        )
        return angle, velocity, acceleration

    @property
    def words(self) -> str:
        low, high = self.first.frequency_hz[[0, -1]]
        return (
            f"odd random-phase multisine: {len(self.first.lines)} lines from {low:.4g} to {high:.4g} Hz and "
            f"{len(self.first.detection)} detection lines, {np.rad2deg(self.rms):.4g} deg rms, "
            f"crest factor {self.peak[0] / self.rms:.3g}, period {self.period_s:.4g} s, {self.periods} periods after "
            f"{TRANSIENTS} of transient, {self.realisations} realisation{'s' if self.realisations > 1 else ''}"
        )

    @property
    def lengths(self) -> tuple[int, int]:
        """From four realisations on: their spread is the only interval that has the distortion as it is."""
        return ENOUGH_REALISATIONS, 200

    def of_length(self, n: int) -> "PeriodicMultisine":
        return replace(self, realisations=n)

    def banded(self, low: float, high: float) -> "PeriodicMultisine":
        return replace(self, band_hz=(low, high))


@dataclass(frozen=True)
class Continuous:
    """A motion with a flat spectrum over a band that does not repeat itself: a linear chirp, or band-limited noise."""

    band_hz: tuple[float, float]  # Lowest and highest frequency [Hz]
    rms: float  # Root mean square of the angle [rad]
    duration_s: float  # Length of the record [s]
    chirp: bool  # Whether it is a chirp, which has one frequency at a time; else it is noise

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not (0 < low < high < np.inf and self.rms > 0 and self.duration_s > 0):
            raise InputError(
                f"no motion has a band of {low:g} to {high:g} Hz, {self.rms:g} rad rms and "
                f"{self.duration_s:g} s; give positive numbers, the lower frequency first"
            )

    @property
    def sines(self) -> Sines:
        """200 sines that share its power: of a chirp one after the other, of noise all at a time."""
        n, (low, high) = 200, self.band_hz
        f, one = low + (high - low) * (np.arange(n) + 0.5) / n, np.ones(n)
        T, w = self.duration_s * one, 2 * np.pi * f
        if self.chirp:
            return Sines(f, np.sqrt(2) * self.rms * one, T / n, T / n, self.rms * w, one)
        return Sines(f, self.rms * np.sqrt(2 / n) * one, T, T, self.rms * np.sqrt(np.mean(w**2)) * one, one)

    @property
    def record_s(self) -> float:
        return self.duration_s

    @property
    def peak(self) -> tuple[float, float, float]:
        """Of noise four times the RMS, which one sample in 16 000 exceeds."""
        w = 2 * np.pi * np.asarray(self.sines.frequency_hz)
        if self.chirp:
            largest = np.sqrt(2) * self.rms * w[-1] ** np.arange(3)
        else:
            largest = 4 * self.rms * np.array([np.sqrt(np.mean(w ** (2 * k))) for k in range(3)])
        return float(largest[0]), float(largest[1]), float(largest[2])

    @property
    def words(self) -> str:
        name, (low, high) = "linear chirp" if self.chirp else "band-limited noise", self.band_hz
        return f"{name}: {low:.4g} to {high:.4g} Hz, {np.rad2deg(self.rms):.4g} deg rms, {self.duration_s:.4g} s"

    @property
    def lengths(self) -> tuple[int, int]:
        return 10, 7200

    def of_length(self, n: int) -> "Continuous":
        return replace(self, duration_s=float(n))

    def banded(self, low: float, high: float) -> "Continuous":
        return replace(self, band_hz=(low, high))


Plan = SteppedSine | PeriodicMultisine | Continuous
TRIED_PERIODS = (2, 3, 4, 6, 8, 12)  # Periods of a realisation that are tried


def long_enough(plan: Plan, enough: Callable[[Plan], bool]) -> Plan | None:
    """The shortest plan of the same kind that is `enough`; None if no length that is tried is. Of a multisine, periods
    and realisations are chosen together."""
    plans = [replace(plan, periods=n) for n in TRIED_PERIODS] if isinstance(plan, PeriodicMultisine) else [plan]
    found = [one for one in (shortest(each, enough) for each in plans) if one is not None]
    return min(found, key=lambda one: one.record_s, default=None)


def shortest(plan: Plan, enough: Callable[[Plan], bool]) -> Plan | None:
    """The plan with the smallest length that is enough, where every larger one is; None if the largest is not."""
    first, high = plan.lengths
    if not enough(plan.of_length(high)):
        return None
    low = first - 1
    while high - low > 1:
        middle = int(np.clip(round(np.sqrt(max(low, 1) * high)), low + 1, high - 1))
        low, high = (low, middle) if enough(plan.of_length(middle)) else (middle, high)
    return plan.of_length(high)


def longest(plan: Plan) -> Plan:
    most = replace(plan, periods=max(TRIED_PERIODS)) if isinstance(plan, PeriodicMultisine) else plan
    return most.of_length(most.lengths[1])
