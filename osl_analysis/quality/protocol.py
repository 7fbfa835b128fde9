"""Which amplitudes and frequencies a stepped-sine recording holds, found without the configuration."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.quality.checks import Check, CheckResult, Examined, channel, not_applicable
from osl_analysis.trial import Array

DEAD_BAND = 0.1  # of the largest angle: the angle has changed its sign when it is beyond
SAME_FREQUENCY, SAME_AMPLITUDE = 0.08, 0.15  # relative difference of cycles that count as one run
FREQUENCY_TOLERANCE, AMPLITUDE_TOLERANCE = 0.05, 0.25  # relative difference of a run from the command that it follows
AT_THE_ENDS = 2  # cycles at the ends of a rest, which are not seen whole
FEWEST = 3  # cycles of a run that was not commanded and is reported
NO_STEPPED_SINE = "no stepped sine"


@dataclass(frozen=True)
class Run:
    """Consecutive cycles of one frequency and amplitude."""

    amplitude_deg: float
    frequency_hz: float
    cycles: int

    def is_at(self, amplitude_deg: float, frequency_hz: float, tolerance: float = FREQUENCY_TOLERANCE) -> bool:
        """Whether the run has this amplitude and frequency; `tolerance` is the relative one of the frequency."""
        return (
            abs(self.frequency_hz / frequency_hz - 1) < tolerance
            and abs(self.amplitude_deg / amplitude_deg - 1) < AMPLITUDE_TOLERANCE
        )

    def __str__(self) -> str:
        return f"{self.amplitude_deg:.2g} deg at {self.frequency_hz:.3g} Hz ({self.cycles} cycles)"


def measure_protocol(examined: Examined) -> CheckResult:
    """Number of commanded segments that the joint did not follow.

    A segment is one amplitude at one frequency for the commanded number of cycles. Two cycles fewer are no failure:
    those at the ends of a rest may be unseen. One cycle more is a failure: the fits would not know of it.
    """
    if "theta" not in examined.samples.columns:
        return not_applicable(NO_STEPPED_SINE)
    commanded, found = examined.commanded, sine_runs(*channel(examined.samples, "theta"))
    pairs = [(a, f) for a in commanded.amplitudes_deg for f in commanded.frequencies_hz]
    missing = [pair for pair in pairs if not is_followed(pair, found, commanded.cycles)]
    longer = [run for run in found if is_too_long(run, pairs, commanded.cycles)]
    besides = [run for run in found if run.cycles >= FEWEST and not any(run.is_at(a, f) for a, f in pairs)]
    remarks = [f"missing {a:g} deg at {f:g} Hz" for a, f in missing]
    remarks += [f"{run}, commanded are {commanded.cycles}" for run in longer]
    remarks += [f"besides {run}" for run in besides]
    remarks = remarks or [f"{len(pairs)} commanded pairs of amplitude and frequency found"]
    return CheckResult(float(len(missing) + len(longer)), "; ".join(remarks))


def is_followed(pair: tuple[float, float], found: list[Run], cycles: int) -> bool:
    """Whether one of the runs has this amplitude [deg] and frequency [Hz] for nearly all cycles."""
    return any(run.is_at(*pair) and run.cycles >= max(cycles - AT_THE_ENDS, 1) for run in found)


def is_too_long(run: Run, pairs: list[tuple[float, float]], cycles: int) -> bool:
    """Whether a run has more cycles than all commanded segments of its amplitude and frequency together."""
    segments = sum(run.is_at(a, f, SAME_FREQUENCY) for a, f in pairs)
    return segments > 0 and run.cycles > cycles * segments


def sine_runs(time: Array, theta: Array) -> list[Run]:
    """The cycles of an angle [rad] at times [s], (n,) each; consecutive ones that are alike are one run."""
    frequencies, amplitudes = measured_cycles(time, theta)
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


def measured_cycles(time: Array, theta: Array) -> tuple[Array, Array]:
    """Frequency [Hz] and amplitude [deg] of each cycle, from one upward crossing of the median angle to the next."""
    x = theta - np.median(theta) if theta.size else theta
    certain = np.flatnonzero(abs(x) > DEAD_BAND * abs(x).max(initial=0.0))
    up = (x[certain[1:]] > 0) & (x[certain[:-1]] < 0)
    before, after = certain[:-1][up], certain[1:][up]
    if before.size < 2:
        return np.zeros(0), np.zeros(0)
    crossing = time[before] - x[before] * (time[after] - time[before]) / (x[after] - x[before])
    height = np.maximum.reduceat(x, before)[:-1] - np.minimum.reduceat(x, before)[:-1]
    return 1 / np.diff(crossing), np.rad2deg(height / 2)


PROTOCOL_CHECKS = (
    Check(
        "protocol",
        "segments",
        "above",
        "commanded pairs of amplitude and frequency that the joint did not follow",
        measure_protocol,
        applies_to=lambda experiment: experiment.stepped_sine,
        otherwise=NO_STEPPED_SINE,
    ),
)
