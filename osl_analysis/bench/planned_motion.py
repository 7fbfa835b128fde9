"""Planned motions of a joint: the sines that each consists of, its length, and its largest angle.

A plan has the `sines` of its motion, its length `record_s` [s] without rests, its `peak`, and a
description `words`."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.model.multisine import Multisine, odd_multisine
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.trial import Array

LAST_CYCLES = 1  # of a segment, not fitted: the filter smears the next frequency into it
TRANSIENTS = 1  # periods before those of a realisation, for the joint to settle
ENOUGH_REALISATIONS = 4  # number of realisations whose spread gives an interval
MOST_DRAWN = 20  # largest number of realisations in the search for the peak
SINES_OF_CONTINUOUS = 200  # that stand for a motion with a flat spectrum
NOISE_PEAK = 4.0  # RMS of a Gaussian motion that one sample in 16 000 exceeds
PERIODS_TRIED = (2, 3, 4, 6, 8, 12)  # of each realisation, in the search for a length
LONGEST_S, SHORTEST_S = 7200, 10  # of a continuous motion, in that search [s]
MOST_CYCLES, MOST_REALISATIONS = 2000, 200  # in that search


@dataclass(frozen=True)
class Peak:
    """Largest values of a motion."""

    angle: float  # [rad]
    velocity: float  # [rad/s]
    acceleration: float  # [rad/s^2]


@dataclass(frozen=True)
class PlannedSines:
    """The sines of a motion, shape (n,) each."""

    frequency_hz: Array
    size: Array  # amplitude [rad]
    duration_s: Array  # fitted time [s] of this sine
    cycle_s: Array  # period [s] of the whole motion; `duration_s` if it is not periodic
    spacing_hz: float | None = None  # of simultaneous multiples; None: one sine at a time
    independent: float = 1.0  # number of independent values of the distortion at a line

    @property
    def w(self) -> Array:
        return np.asarray(2 * np.pi * self.frequency_hz)

    @property
    def velocity(self) -> Array:
        """RMS velocity [rad/s] of the whole motion during each sine."""
        each = self.size * self.w / np.sqrt(2)
        return each if self.spacing_hz is None else np.full(len(each), np.sqrt(np.sum(each**2)))


@dataclass(frozen=True)
class SteppedSine:
    """A stepped sine: each amplitude at every frequency."""

    amplitudes: tuple[float, ...]  # [rad]
    frequencies_hz: tuple[float, ...]
    cycles: tuple[float, ...]  # number at each frequency
    settle_cycles: int  # first cycles of each, not fitted

    @property
    def sines(self) -> PlannedSines:
        """The fitted cycles are those that `spectral.stepped_sine.settled_cycles` leaves."""
        fitted_cycles = np.maximum(np.floor(self.cycles) - self.settle_cycles - LAST_CYCLES, 1)
        # every frequency at the first amplitude, then at the second, ...
        size = np.repeat(self.amplitudes, len(self.frequencies_hz))
        frequency_hz = np.tile(self.frequencies_hz, len(self.amplitudes))
        duration_s = np.tile(fitted_cycles, len(self.amplitudes)) / frequency_hz
        return PlannedSines(frequency_hz, size, duration_s, cycle_s=1 / frequency_hz)

    @property
    def record_s(self) -> float:
        return len(self.amplitudes) * float(np.sum(np.asarray(self.cycles) / self.frequencies_hz))

    @property
    def peak(self) -> Peak:
        size = max(self.amplitudes)
        w = 2 * np.pi * max(self.frequencies_hz)
        return Peak(size, size * w, size * w**2)

    @property
    def words(self) -> str:
        sines = self.sines
        degrees = listed(np.rad2deg(self.amplitudes))
        hertz = listed(self.frequencies_hz)
        cycles = listed(dict.fromkeys(self.cycles))
        fitted = listed(dict.fromkeys((sines.duration_s / sines.cycle_s).round(6).tolist()))
        return (
            f"stepped sine: {degrees} deg at {hertz} Hz, {cycles} cycles at each ({fitted} fitted)"
        )


@dataclass(frozen=True)
class PeriodicMultisine:
    """Realisations of an odd random-phase multisine, whole periods of each after a transient."""

    period_s: float
    band_hz: tuple[float, float]
    rms: float  # root mean square of the angle [rad]
    periods: int  # fitted periods of each realisation
    realisations: int  # with different phases
    seed: int = 1

    def motion(self, realisation: int) -> Multisine:
        """One realisation; raises as `odd_multisine`."""
        return odd_multisine(self.period_s, self.band_hz, self.rms, self.seed, realisation)

    @property
    def sines(self) -> PlannedSines:
        motion = self.motion(0)
        period_s = np.full(len(motion.lines), self.period_s)
        return PlannedSines(
            motion.frequency_hz,
            motion.size,
            duration_s=self.realisations * self.periods * period_s,
            cycle_s=period_s,
            spacing_hz=1 / self.period_s,
            independent=self.realisations,
        )

    @property
    def record_s(self) -> float:
        return self.realisations * (self.periods + TRANSIENTS) * self.period_s

    @property
    def peak(self) -> Peak:
        """The largest of the realisations, of at most `MOST_DRAWN`."""
        motions = [self.motion(number) for number in range(min(self.realisations, MOST_DRAWN))]
        samples = 16 * int(motions[0].lines[-1])  # 16 of a period of the highest line
        time = self.period_s * np.arange(samples) / samples

        def largest(derivative: int) -> float:
            return float(max(np.abs(motion.angle(time, derivative)).max() for motion in motions))

        return Peak(largest(0), largest(1), largest(2))

    @property
    def words(self) -> str:
        motion = self.motion(0)
        low, high = motion.frequency_hz[[0, -1]]
        noun = "realisation" if self.realisations == 1 else "realisations"
        return (
            f"odd random-phase multisine: {len(motion.lines)} lines from {low:.4g} to {high:.4g} Hz"
            f" and {len(motion.detection)} detection lines, {np.rad2deg(self.rms):.4g} deg rms,"
            f" crest factor {self.peak.angle / self.rms:.3g}, period {self.period_s:.4g} s,"
            f" {self.periods} periods after {TRANSIENTS} of transient, {self.realisations} {noun}"
        )


@dataclass(frozen=True)
class Continuous:
    """A motion without repeats whose spectrum is flat over a band: a linear chirp, or band-limited
    noise."""

    band_hz: tuple[float, float]
    rms: float  # root mean square of the angle [rad]
    record_s: float
    chirp: bool  # whether it is a chirp, with one frequency at a time; else noise

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not (0 < low < high < np.inf and self.rms > 0 and self.record_s > 0):
            raise InputError(
                f"no motion has a band of {low:g} to {high:g} Hz, {self.rms:g} rad rms and "
                f"{self.record_s:g} s; give positive numbers, the lower frequency first"
            )

    @property
    def sines(self) -> PlannedSines:
        """Sines that share its power: in a chirp successive, in noise simultaneous."""
        n = SINES_OF_CONTINUOUS
        low, high = self.band_hz
        spacing_hz = (high - low) / n
        frequency_hz = low + (high - low) * (np.arange(n) + 0.5) / n
        if self.chirp:
            each_s = np.full(n, self.record_s / n)
            return PlannedSines(frequency_hz, np.full(n, np.sqrt(2) * self.rms), each_s, each_s)
        whole_s = np.full(n, self.record_s)
        return PlannedSines(
            frequency_hz,
            np.full(n, self.rms * np.sqrt(2 / n)),
            duration_s=whole_s,
            cycle_s=whole_s,
            spacing_hz=spacing_hz,
            independent=self.record_s * spacing_hz,
        )

    @property
    def peak(self) -> Peak:
        """Of a chirp at its highest frequency; of noise `NOISE_PEAK` times the RMS."""
        w = self.sines.w
        if self.chirp:
            size = float(np.sqrt(2) * self.rms)
            return Peak(size, float(size * w[-1]), float(size * w[-1] ** 2))
        size = NOISE_PEAK * self.rms
        velocity = float(size * np.sqrt(np.mean(w**2)))
        return Peak(size, velocity, float(size * np.sqrt(np.mean(w**4))))

    @property
    def words(self) -> str:
        name = "linear chirp" if self.chirp else "band-limited noise"
        low, high = self.band_hz
        return (
            f"{name}: {low:.4g} to {high:.4g} Hz, {np.rad2deg(self.rms):.4g} deg rms,"
            f" {self.record_s:.4g} s"
        )


Plan = SteppedSine | PeriodicMultisine | Continuous


def listed(numbers: Iterable[float]) -> str:
    """Numbers to four digits, with commas."""
    return ", ".join(f"{number:.4g}" for number in numbers)


def long_enough(plan: Plan, enough: Callable[[Plan], bool]) -> tuple[Plan | None, Plan]:
    """Search for the shortest plan of the same kind such that it and all longer ones are `enough`.

    For a multisine, periods and realisations are chosen together.

    Returns
    -------
    shortest : Plan or None
        None if none is enough.
    longest : Plan
        The longest that is tried.
    """
    tried, shortest, longest = [plan], SHORTEST_S, LONGEST_S
    if isinstance(plan, SteppedSine):
        shortest, longest = plan.settle_cycles + LAST_CYCLES + FEWEST_CYCLES, MOST_CYCLES
    elif isinstance(plan, PeriodicMultisine):  # fewer realisations do not show the distortion
        tried = [replace(plan, periods=periods) for periods in PERIODS_TRIED]
        shortest, longest = ENOUGH_REALISATIONS, MOST_REALISATIONS
    reached = [
        of_length(candidate, shortest_length(candidate, enough, shortest, longest))
        for candidate in tried
        if enough(of_length(candidate, longest))
    ]
    best = min(reached, key=lambda candidate: candidate.record_s, default=None)
    return best, of_length(tried[-1], longest)


def shortest_length(plan: Plan, enough: Callable[[Plan], bool], shortest: int, longest: int) -> int:
    """The smallest number of cycles, realisations or seconds that is enough, by bisection of its
    logarithm; the longest is."""
    too_short, is_enough = shortest - 1, longest
    while is_enough - too_short > 1:
        geometric_mean = round(np.sqrt(max(too_short, 1) * is_enough))
        middle = int(np.clip(geometric_mean, too_short + 1, is_enough - 1))
        if enough(of_length(plan, middle)):
            is_enough = middle
        else:
            too_short = middle
    return is_enough


def of_length(plan: Plan, number: int) -> Plan:
    """The same plan with a number of cycles, realisations or seconds."""
    if isinstance(plan, SteppedSine):
        return replace(plan, cycles=(float(number),) * len(plan.frequencies_hz))
    if isinstance(plan, PeriodicMultisine):
        return replace(plan, realisations=number)
    return replace(plan, record_s=float(number))
