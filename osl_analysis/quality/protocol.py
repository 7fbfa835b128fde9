"""Which amplitudes and frequencies really are in a stepped-sine log, whatever the configuration says."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.quality.finding import Finding
from osl_analysis.trial import Array

DEAD_BAND = 0.1  # of the largest amplitude, that an angle must pass to have changed sides
SAME_FREQUENCY, SAME_AMPLITUDE = 0.08, 0.15  # within one run of cycles
FREQUENCY_TOLERANCE, AMPLITUDE_TOLERANCE = 0.05, 0.25  # against what was commanded
AT_THE_ENDS = 2  # cycles that begin or end in a rest and are not seen whole
FEWEST = 3  # cycles that make a run of something that was not commanded


@dataclass(frozen=True)
class Commanded:
    """Amplitudes [deg], each at every frequency [Hz] for so many cycles."""

    amplitudes_deg: Sequence[float]
    frequencies_hz: Sequence[float]
    cycles: int


@dataclass(frozen=True)
class Run:
    """Consecutive cycles of one frequency [Hz] and amplitude [deg]."""

    amplitude_deg: float
    frequency_hz: float
    cycles: int

    def is_at(self, amplitude_deg: float, frequency_hz: float, tolerance: float = FREQUENCY_TOLERANCE) -> bool:
        """Whether this is what was commanded; `tolerance` of the frequency."""
        return (
            abs(self.frequency_hz / frequency_hz - 1) < tolerance
            and abs(self.amplitude_deg / amplitude_deg - 1) < AMPLITUDE_TOLERANCE
        )

    def __str__(self) -> str:
        return f"{self.amplitude_deg:.2g} deg at {self.frequency_hz:.3g} Hz ({self.cycles} cycles)"


def check_protocol(time: Array, theta: Array, commanded: Commanded) -> Finding:
    """Number of commanded pairs that are not in the angle [rad] at times [s], (n,) each, for as many cycles.

    Cycles at the ends of a rest may be unseen; one more than was commanded is one that a fit would not know of.
    """
    runs = sine_runs(time, theta)
    pairs = [(a, f) for a in commanded.amplitudes_deg for f in commanded.frequencies_hz]
    needed = max(commanded.cycles - AT_THE_ENDS, 1)
    missing = [(a, f) for a, f in pairs if not any(run.is_at(a, f) and run.cycles >= needed for run in runs)]
    besides = [run for run in runs if run.cycles >= FEWEST and not any(run.is_at(a, f) for a, f in pairs)]
    longer = [
        run
        for run in runs
        if run.cycles > commanded.cycles * sum(run.is_at(a, f, SAME_FREQUENCY) for a, f in pairs) > 0
    ]
    said = [f"missing {a:g} deg at {f:g} Hz" for a, f in missing]
    said += [f"{run}, commanded are {commanded.cycles}" for run in longer]
    said += [f"besides {run}" for run in besides]
    said = said or [f"{len(pairs)} commanded pairs of amplitude and frequency found"]
    return Finding(float(len(missing) + len(longer)), "; ".join(said))


def sine_runs(time: Array, theta: Array) -> list[Run]:
    """The cycles of an angle [rad] at times [s], (n,) each, consecutive ones of one kind together."""
    frequencies, amplitudes = cycles_of(time, theta)
    runs: list[Run] = []
    start = 0
    for stop in range(1, frequencies.size + 1):
        if stop < frequencies.size and (
            abs(frequencies[stop] / frequencies[start] - 1) < SAME_FREQUENCY
            and abs(amplitudes[stop] / amplitudes[start] - 1) < SAME_AMPLITUDE
        ):
            continue
        kind = float(np.median(amplitudes[start:stop])), float(np.median(frequencies[start:stop]))
        runs.append(Run(*kind, stop - start))
        start = stop
    return runs


def cycles_of(time: Array, theta: Array) -> tuple[Array, Array]:
    """Frequency [Hz] and amplitude [deg] of each cycle from one upward passage of the middle to the next."""
    x = theta - np.median(theta) if theta.size else theta
    certain = np.flatnonzero(abs(x) > DEAD_BAND * abs(x).max(initial=0.0))
    up = (x[certain[1:]] > 0) & (x[certain[:-1]] < 0)
    before, after = certain[:-1][up], certain[1:][up]
    if before.size < 2:
        return np.zeros(0), np.zeros(0)
    crossing = time[before] - x[before] * (time[after] - time[before]) / (x[after] - x[before])
    height = np.maximum.reduceat(x, before)[:-1] - np.minimum.reduceat(x, before)[:-1]
    return 1 / np.diff(crossing), np.rad2deg(height / 2)
