"""The sines that a joint did: stretches of one frequency and amplitude, whoever commanded them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import NamedTuple

import numpy as np

from osl_analysis.measured import usual_size
from osl_analysis.signals import run_edges
from osl_analysis.trial import Array

# Largest relative differences between neighbouring cycles of a run; a bench loses as much amplitude
# at 5 Hz.
SAME_FREQUENCY = 0.05
SAME_AMPLITUDE = 0.15
# Largest relative difference of a cycle's amplitude from its run's median; beyond, cycles at its
# ends are a ramp.
ONE_HEIGHT = 0.06
RECENT_CYCLES = 5  # with whose median the next cycle is compared

TURNING_S = 0.02  # [s] within which a moving angle changes measurably
TURNING = 0.1  # of the 95 % quantile of these changes
DEAD_BAND = 0.02  # of the largest angle: rests and noise stay within
DEAD_BAND_NOISES = 5  # standard deviations of the noise

# A second difference of white noise has sqrt(6) of its standard deviation; the median size is
# 0.6745 of a normal one.
SECOND_DIFFERENCE = 0.6745 * np.sqrt(6)

SAMPLES_PER_CYCLE = 64  # tell all of a sine
FEWEST_SAMPLES = 8  # for a sine with its growth and a centre
LARGEST_MISFIT = 0.3  # of the sine's RMS
FREQUENCY_ROUNDS = 4
SMALLEST_SLIP = 1e-9  # cycles over the run, below which the frequency is known

LEFT_SINE = 0.08  # of the amplitude, plus twice the misfit: the angle has left its sine
MISSING_CYCLE = 0.25  # cycles that may be missing at the ends of a run


def noise_of(theta: Array) -> float:
    """Standard deviation of the noise of an angle (n,), in its unit, by its second differences; 0
    of two samples."""
    if len(theta) <= 2:
        return 0.0
    return float(usual_size(np.diff(theta, 2)) / SECOND_DIFFERENCE)


def upward_crossings(time: Array, theta: Array, noise: float) -> Array:
    """Times [s] at which the angle rises through its centre, from below a dead band to above it.

    The band is 2 % of the largest angle, so that rests and noise stay within. The centre is the
    median angle while it changes measurably in 20 ms: it may rest elsewhere, and for longer.
    `noise` is the `noise_of` the angle.
    """
    x = theta - centre_of_motion(time, theta)
    largest = max(float(x.max()), -float(x.min()))
    dead = max(DEAD_BAND * largest, DEAD_BAND_NOISES * noise)
    high = run_edges(x > dead)
    low = run_edges(x < -dead)

    # the end of the last low run before each high one; 0: never yet
    ends_of_low = np.append(low[:, 1], 0)
    low_before = ends_of_low[np.searchsorted(low[:, 1], high[:, 0], side="right") - 1]
    high_before = np.append(0, high[:-1, 1])
    came_up = high[low_before > high_before, 0]

    rises = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
    before = rises[np.searchsorted(rises, came_up) - 1]
    step = time[before + 1] - time[before]
    return np.asarray(time[before] - x[before] * step / (x[before + 1] - x[before]))


def centre_of_motion(time: Array, theta: Array) -> float:
    """Median angle [rad] while it changes measurably; of all rows if it never does."""
    lag = max(round(TURNING_S * (len(time) - 1) / float(time[-1] - time[0])), 1)
    change = np.abs(theta[lag:] - theta[:-lag])
    if not change.size:
        return float(np.median(theta))
    is_moving = change > TURNING * np.quantile(change, 0.95)
    return float(np.median(theta[lag:][is_moving] if is_moving.any() else theta))


@dataclass(frozen=True)
class Run:
    """A stretch of one frequency and amplitude.

    Its sine is the real part of phasor exp(2j pi frequency t) about the centre, t the time of the
    record [s].
    """

    amplitude: float  # [rad]
    frequency_hz: float
    phasor: complex  # [rad]
    centre: float  # angle [rad] about which the sine goes
    start: float  # time [s] at which it begins
    stop: float  # time [s] at which it ends
    misfit: float  # RMS deviation [rad] of its angle from the sine: harmonics, decay, rounding

    @property
    def cycles(self) -> float:
        """Number of cycles, not rounded: the ends of a run are known to a few hundredths."""
        return (self.stop - self.start) * self.frequency_hz

    def angle(self, time: Array) -> Array:
        """The sine's angle [rad] at times [s]."""
        phase = 2 * np.pi * self.frequency_hz * time + np.angle(self.phasor)
        return np.asarray(self.centre + abs(self.phasor) * np.cos(phase))

    def phase_at(self, time: float) -> float:
        """Phase [rad] at a time [s] of the sine, between -pi and pi; 0 where the angle rises
        through its centre."""
        return float(np.angle(1j * self.phasor * np.exp(2j * np.pi * self.frequency_hz * time)))

    def __str__(self) -> str:
        return (
            f"{np.rad2deg(self.amplitude):.2g} deg at {self.frequency_hz:.4g} Hz ({self.cycles:.1f}"
            " cycles)"
        )


class SimilarCycles(NamedTuple):
    """Consecutive cycles of similar frequency and amplitude."""

    rows: slice
    frequency_hz: float


def find_runs(time: Array, theta: Array, crossings: Array, fewest: int) -> list[Run]:
    """Find the runs in a joint angle.

    Parameters
    ----------
    time, theta : Array
        Increasing times (n,) [s] and angles (n,) [rad].
    crossings : Array
        Times [s] at which the angle rises through its centre.
    fewest : int
        Cycles of a run; shorter ones are left out.

    Returns
    -------
    list of Run
        In order of time.

    Notes
    -----
    Consecutive similar cycles make a run, whose sine is fitted. A run extends as far as the angle
    follows its sine, and no other run has begun. Rests, ramps, transients and disturbed cycles lie
    between the runs.
    """
    fitted = [
        fit_run(time, theta, cycles.rows, cycles.frequency_hz)
        for cycles in similar_cycles(time, theta, crossings)
    ]
    runs = prolonged_runs(time, theta, [run for run in fitted if run is not None])
    return [run for run in runs if run.cycles > fewest - MISSING_CYCLE]


def similar_cycles(time: Array, theta: Array, crossings: Array) -> list[SimilarCycles]:
    """Find two or more consecutive cycles, each from one upward crossing [s] to the next, that are
    similar in frequency and amplitude; a single one may belong to a ramp or a rest."""
    if len(crossings) < 2:
        return []
    rows = np.searchsorted(time, crossings)
    height = np.maximum.reduceat(theta, rows)[:-1] - np.minimum.reduceat(theta, rows)[:-1]
    frequency = 1 / np.diff(crossings)
    stretches = list[SimilarCycles]()
    start = 0
    for stop in range(1, len(frequency) + 1):
        if stop < len(frequency):
            recent = slice(max(start, stop - RECENT_CYCLES), stop)
            frequency_change = abs(frequency[stop] / median(frequency[recent].tolist()) - 1)
            height_change = abs(height[stop] / median(height[recent].tolist()) - 1)
            if frequency_change <= SAME_FREQUENCY and height_change <= SAME_AMPLITUDE:
                continue
        first = start
        last = stop
        # a slow ramp stands outside
        heights = height[start:stop]
        usual = np.flatnonzero(np.abs(heights / np.median(heights) - 1) < ONE_HEIGHT)
        if len(usual):
            first = start + int(usual[0])
            last = start + int(usual[-1]) + 1
        if last - first >= 2:
            rate = (last - first) / float(crossings[last] - crossings[first])
            stretches.append(SimilarCycles(slice(int(rows[first]), int(rows[last])), rate))
        start = stop
    return stretches


def fit_run(time: Array, theta: Array, rows: slice, frequency_hz: float) -> Run | None:
    """Fit the sine of about some frequency [Hz] through some rows; None if its misfit exceeds 0.3
    of its RMS.

    The phasor may change linearly in time; the growth of its phase corrects the frequency.
    """
    duration = float(time[rows.stop - 1] - time[rows.start])
    samples_per_cycle = (rows.stop - rows.start) / (duration * frequency_hz)
    stride = max(int(samples_per_cycle / SAMPLES_PER_CYCLE), 1)
    t = time[rows][::stride]
    x = theta[rows][::stride]
    if len(t) < FEWEST_SAMPLES:
        return None
    middle = float(t.mean())
    share = (t - middle) / duration
    for _ in range(FREQUENCY_ROUNDS):
        phase = 2 * np.pi * frequency_hz * (t - middle)
        sine = np.array([np.cos(phase), -np.sin(phase)])
        columns = np.concatenate([np.ones((1, len(t))), sine, share * sine])
        coefficients, *_ = np.linalg.lstsq(columns @ columns.T, columns @ x, rcond=None)
        phasor = complex(*coefficients[1:3])
        growth = complex(*coefficients[3:])
        slip = (growth / phasor).imag / (2 * np.pi)
        frequency_hz += slip / duration
        if abs(slip) < SMALLEST_SLIP:
            break
    residual = x - coefficients @ columns
    if float(np.sqrt(np.mean(residual**2))) > LARGEST_MISFIT * abs(phasor) / np.sqrt(2):
        return None
    phasor *= np.exp(-2j * np.pi * frequency_hz * middle)
    run = Run(
        amplitude=abs(phasor),
        frequency_hz=frequency_hz,
        phasor=phasor,
        centre=float(coefficients[0]),
        start=float(time[rows.start]),
        stop=float(time[rows.stop - 1]),
        misfit=0.0,
    )
    return replace(run, misfit=float(np.sqrt(np.mean((x - run.angle(t)) ** 2))))


def prolonged_runs(time: Array, theta: Array, runs: Sequence[Run]) -> list[Run]:
    """Prolong each run as far as the angle (n,) follows its sine, up to its neighbours."""
    longer: list[Run] = []
    if not runs:
        return longer
    begins = [*(run.start for run in runs[1:]), float(time[-1])]
    before = float(time[0])
    for run, next_begin in zip(runs, begins, strict=True):
        start = followed_until(time, theta, run, before)
        stop = followed_until(time, theta, run, next_begin)
        longer.append(replace(run, start=start, stop=stop))
        before = stop
    return longer


def followed_until(time: Array, theta: Array, run: Run, limit: float) -> float:
    """Time [s] up to which the angle follows the sine, from the middle of its end cycle towards
    `limit` [s]."""
    is_forwards = limit >= run.stop
    end = run.stop if is_forwards else run.start
    low, high = np.searchsorted(time, sorted((end, limit)))
    rows = np.arange(low, min(high + 1, len(time)))
    if not is_forwards:
        rows = rows[::-1]
    deviation = np.abs(theta[rows] - run.angle(time[rows]))
    has_left = deviation > LEFT_SINE * run.amplitude + 2 * run.misfit
    if not has_left.any():
        return limit
    last = max(int(np.argmax(has_left)) - 1, 0)
    return float(time[rows[last]])
