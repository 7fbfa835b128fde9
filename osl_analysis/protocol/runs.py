"""The stepped sine that is commanded, and what a joint really did: runs of one frequency and amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median

import numpy as np

from osl_analysis.measured import usual_size
from osl_analysis.signals import run_edges
from osl_analysis.trial import Array

FREQUENCY_TOLERANCE = 0.05
"""Largest relative deviation of a recorded frequency from the commanded one that it follows: a clock is off by less."""
AMPLITUDE_TOLERANCE = 0.25
"""Largest relative deviation of a recorded amplitude from the commanded one. Some is lost to the dynamometer's
bandwidth."""


@dataclass(frozen=True)
class SteppedSineProtocol:
    """A stepped sine: each amplitude at every frequency, in any order and with or without rests."""

    amplitudes: Sequence[float]  # amplitudes [rad]
    frequencies_hz: Sequence[float]  # frequencies [Hz]
    cycles: float | Sequence[float]  # number of cycles at each frequency: one number for all, or one for each

    @property
    def cycles_at(self) -> tuple[float, ...]:
        """Number of cycles at each frequency; not whole where a time per frequency is commanded."""
        each = np.broadcast_to(np.asarray(self.cycles, dtype=float), len(self.frequencies_hz))
        return tuple(float(n) for n in each)

    def amplitude_near(self, amplitude: float) -> float | None:
        """The commanded amplitude [rad] that a recorded one follows; None if it is beyond the tolerance of all."""
        nearest = min(self.amplitudes, key=lambda commanded: abs(amplitude / commanded - 1), default=None)
        if nearest is None or abs(amplitude / nearest - 1) > AMPLITUDE_TOLERANCE:
            return None
        return nearest

    def frequency_near(self, frequency_hz: float) -> float | None:
        """The commanded frequency [Hz] that a recorded one follows; None if it is beyond the tolerance of all."""
        nearest = min(self.frequencies_hz, key=lambda commanded: abs(frequency_hz / commanded - 1), default=None)
        if nearest is None or abs(frequency_hz / nearest - 1) > FREQUENCY_TOLERANCE:
            return None
        return nearest


MOVING_S = 0.02  # time [s] over which an angle changes measurably where the joint moves
DEAD_BAND = 0.02
"""Share of the largest angle that the angle must reach on both sides of its centre; rests and noise stay below."""


def noise_of(theta: Array) -> float:
    """Standard deviation of the noise of an angle (n,), in its unit, by its second differences; 0 of two samples."""
    return usual_size(np.diff(theta, 2)) / (0.6745 * np.sqrt(6)) if len(theta) > 2 else 0.0


def upward_crossings(time: Array, theta: Array, noise: float | None = None) -> Array:
    """Times [s] at which the angle rises through its centre, from below a dead band to above it. `noise` is that of
    `noise_of`, where it is known already."""
    x = theta - centre_of_motion(time, theta)
    noise = noise_of(theta) if noise is None else noise
    dead = max(DEAD_BAND * max(float(x.max()), -float(x.min())), 5 * noise)
    high, low = run_edges(x > dead), run_edges(x < -dead)
    last_low = np.append(low[:, 1], 0)[np.searchsorted(low[:, 1], high[:, 0], side="right") - 1]  # 0: never yet
    came_up = high[last_low > np.append(0, high[:-1, 1]), 0]
    rises = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
    before = rises[np.searchsorted(rises, came_up) - 1]
    return np.asarray(time[before] - x[before] * (time[before + 1] - time[before]) / (x[before + 1] - x[before]))


def centre_of_motion(time: Array, theta: Array) -> float:
    """The median angle [rad] where the joint moves; it may rest elsewhere, and for longer."""
    apart = max(round(MOVING_S / float(np.median(np.diff(time)))), 1)
    change = np.abs(theta[apart:] - theta[:-apart])
    if not change.size:  # a recording shorter than that
        return float(np.median(theta))
    moving = change > 0.1 * np.quantile(change, 0.95)
    return float(np.median(theta[apart:][moving] if moving.any() else theta))


SAME_FREQUENCY, SAME_AMPLITUDE = 0.05, 0.15  # relative differences of neighbouring cycles that belong to one run
PLATEAU = 0.06
"""Relative difference of a cycle's amplitude from the median of its run; cycles beyond, at its ends, are a ramp."""
NO_SINE = 0.3  # largest misfit of a run, as a share of its amplitude (RMS over RMS of the sine): beyond it is no sine
LEAVES = 0.08
"""Distance between angle and sine, as a share of the amplitude, at which a run has ended; twice the misfit of its
own cycles is added."""
MOST_STEPS, NO_SLIP = 4, 1e-9
"""Largest number of steps to the frequency of a run; cycles over the run by which a step changes it, to be the last."""
SAMPLES_PER_CYCLE = 64  # samples of a cycle from which frequency and amplitude are fitted; more of them add nothing
FEWEST_CYCLES = 3  # smallest number of cycles of a run; what is shorter may be a transient
SEEN_WHOLE = 2  # smallest number of alike cycles between upward crossings; a single one may be a ramp's, or a rest's


@dataclass(frozen=True)
class Run:
    """A stretch of one frequency and amplitude."""

    amplitude: float  # amplitude [rad]
    frequency_hz: float  # frequency [Hz]
    phasor: complex
    """The sine is the real part of phasor exp(2j pi frequency t) about the centre, t the time of the record [s]."""
    centre: float  # angle [rad] about which the sine goes
    start: float  # time [s] at which it begins
    stop: float  # time [s] at which it ends
    misfit: float  # RMS distance [rad] of its angle from the sine: harmonics, a decay, rounding

    @property
    def cycles(self) -> float:
        """Number of cycles, which need not be whole: the ends of a run are known to a few hundredths."""
        return (self.stop - self.start) * self.frequency_hz

    @property
    def whole_cycles(self) -> int:
        """Number of whole cycles, up to a quarter that its ends may lack."""
        return int(self.cycles + 0.25)

    @property
    def amplitude_deg(self) -> float:
        return float(np.rad2deg(self.amplitude))

    def angle(self, time: Array) -> Array:
        """The sine's angle [rad] at times [s]."""
        turn = 2 * np.pi * self.frequency_hz * time + np.angle(self.phasor)
        return np.asarray(self.centre + abs(self.phasor) * np.cos(turn))

    def phase_at(self, time: float) -> float:
        """Phase [rad] at a time [s] of the sine, between -pi and pi; 0 where the angle rises through its centre."""
        return float(np.angle(1j * self.phasor * np.exp(2j * np.pi * self.frequency_hz * time)))

    def __str__(self) -> str:
        return f"{self.amplitude_deg:.2g} deg at {self.frequency_hz:.4g} Hz ({self.cycles:.1f} cycles)"


@dataclass(frozen=True)
class Stretch:
    """Consecutive cycles that are alike, from an upward crossing of the centre to another one."""

    rows: slice  # their rows
    frequency_hz: float  # number of cycles over their duration [Hz]


def find_runs(time: Array, theta: Array, fewest: int = FEWEST_CYCLES, crossings: Array | None = None) -> list[Run]:
    """The runs of `fewest` or more cycles of a joint angle theta [rad] at increasing times [s], shape (n,) each.

    `crossings` [s] are the `upward_crossings` of an angle without gaps, where they are known already.

    Consecutive cycles that are alike make a run. A sine is then fitted to it, which gives its frequency and amplitude.
    The run extends as far as the angle follows this sine; where two runs touch, each sample belongs to the sine that
    is nearer. Rests, ramps and transients lie between the runs.
    """
    if crossings is None:
        seen = np.isfinite(theta)
        time, theta = time[seen], theta[seen]
    if len(theta) < 8 or not np.ptp(theta):
        return []
    stretches = alike_cycles(time, theta, upward_crossings(time, theta) if crossings is None else crossings)
    fitted = [run for stretch in stretches if (run := fit_run(time, theta, stretch)) is not None]
    return [run for run in prolonged_runs(time, theta, joined_runs(time, theta, fitted)) if run.cycles > fewest - 0.25]


def alike_cycles(time: Array, theta: Array, crossings: Array) -> list[Stretch]:
    """Consecutive cycles, each from one upward crossing [s] to the next, that are alike in frequency and amplitude."""
    if len(crossings) < 2:
        return []
    rows = np.searchsorted(time, crossings)
    height = np.maximum.reduceat(theta, rows)[:-1] - np.minimum.reduceat(theta, rows)[:-1]
    frequency = 1 / np.diff(crossings)
    stretches, start = [], 0
    for stop in range(1, len(frequency) + 1):
        recent = slice(max(start, stop - 5), stop)
        if (
            stop == len(frequency)
            or abs(frequency[stop] / median(frequency[recent].tolist()) - 1) > SAME_FREQUENCY
            or abs(height[stop] / median(height[recent].tolist()) - 1) > SAME_AMPLITUDE
        ):
            first, last = (start + end for end in plateau(height[start:stop]))
            rate = (last - first) / float(crossings[last] - crossings[first])
            if last - first >= SEEN_WHOLE:
                stretches.append(Stretch(slice(int(rows[first]), int(rows[last])), rate))
            start = stop
    return stretches


def plateau(height: Array) -> tuple[int, int]:
    """First cycle and the one after the last whose height (n,) is that of the run; a slow ramp stands outside."""
    usual = np.flatnonzero(np.abs(height / np.median(height) - 1) < PLATEAU)
    return (int(usual[0]), int(usual[-1]) + 1) if len(usual) else (0, len(height))


def fit_run(time: Array, theta: Array, stretch: Stretch) -> Run | None:
    """The sine through the rows of a stretch; None where they follow no sine. The phasor of the fitted sine may change
    linearly in time. The growth of its phase corrects the frequency, so that few steps suffice."""
    rows, frequency = stretch.rows, stretch.frequency_hz
    duration = float(time[rows.stop - 1] - time[rows.start])
    every = max(int((rows.stop - rows.start) / (duration * frequency) / SAMPLES_PER_CYCLE), 1)
    t, x = time[rows][::every], theta[rows][::every]
    if len(t) < 8:
        return None
    middle = float(t.mean())
    share, columns = (t - middle) / duration, np.ones((5, len(t)))
    for _ in range(MOST_STEPS):
        turn = 2 * np.pi * frequency * (t - middle)
        np.cos(turn, out=columns[1])
        np.negative(np.sin(turn, out=turn), out=columns[2])
        np.multiply(share, columns[1:3], out=columns[3:])
        found, *_ = np.linalg.lstsq(columns @ columns.T, columns @ x, rcond=None)
        phasor, growth = complex(*found[1:3]), complex(*found[3:])
        slip = (growth / phasor).imag / (2 * np.pi)
        frequency += slip / duration
        if abs(slip) < NO_SLIP:
            break
    misfit, centre = x - found @ columns, found[0]
    if float(np.sqrt(np.mean(misfit**2))) > NO_SINE * abs(phasor) / np.sqrt(2):
        return None
    phasor *= np.exp(-2j * np.pi * frequency * middle)
    start, stop = float(time[rows.start]), float(time[rows.stop - 1])
    run = Run(abs(phasor), frequency, phasor, float(centre), start, stop, 0.0)
    return replace(run, misfit=float(np.sqrt(np.mean((x - run.angle(t)) ** 2))))


def joined_runs(time: Array, theta: Array, runs: Sequence[Run]) -> list[Run]:
    """The runs (n,), two of them as one where the same sine goes on behind a cycle that was disturbed."""
    whole: list[Run] = []
    for run in runs:
        if whole and goes_on(whole[-1], run):
            rows = slice(*np.searchsorted(time, [whole[-1].start, run.stop]))
            again = fit_run(time, theta, Stretch(rows, whole[-1].frequency_hz))
            if again is not None:
                whole[-1] = again
                continue
        whole.append(run)
    return whole


def goes_on(run: Run, following: Run) -> bool:
    """Whether `following` is the same sine: frequency, amplitude and phase, two cycles later at most."""
    middle = (run.stop + following.start) / 2
    slip = np.angle(np.exp(1j * (run.phase_at(middle) - following.phase_at(middle))))
    return (
        (following.start - run.stop) * run.frequency_hz < 2.5
        and abs(following.frequency_hz / run.frequency_hz - 1) < SAME_FREQUENCY
        and abs(following.amplitude / run.amplitude - 1) < PLATEAU
        and abs(float(slip)) < 0.3
    )


def prolonged_runs(time: Array, theta: Array, runs: Sequence[Run]) -> list[Run]:
    """The runs, each as far as the angle follows its sine."""
    if not runs:
        return []
    befores = [float(time[0]), *(run.stop for run in runs[:-1])]
    afters = [*(run.start for run in runs[1:]), float(time[-1])]
    longer = [
        replace(run, start=followed_until(time, theta, run, before), stop=followed_until(time, theta, run, after))
        for run, before, after in zip(runs, befores, afters, strict=True)
    ]
    for k, (run, following) in enumerate(pairwise(longer)):
        if run.stop > following.start:
            border = nearer_until(time, theta, run, following)
            longer[k], longer[k + 1] = replace(run, stop=border), replace(following, start=border)
    return longer


def followed_until(time: Array, theta: Array, run: Run, limit: float) -> float:
    """Time [s] up to which the angle follows the run's sine, from the middle of its end cycle towards `limit` [s]."""
    forwards = limit >= run.stop
    end = run.stop if forwards else run.start
    low, high = np.searchsorted(time, sorted((end, limit)))
    rows = np.arange(low, min(high + 1, len(time)))
    rows = rows if forwards else rows[::-1]
    away = np.abs(theta[rows] - run.angle(time[rows])) > LEAVES * run.amplitude + 2 * run.misfit
    if not away.any():
        return limit
    return float(time[rows[max(int(np.argmax(away)) - 1, 0)]])


def nearer_until(time: Array, theta: Array, run: Run, following: Run) -> float:
    """Time [s] in the overlap of two runs from which the angle is nearer to the sine of the following one."""
    low, high = np.searchsorted(time, [following.start, run.stop])
    t, x = time[low : high + 1], theta[low : high + 1]
    gain = (x - following.angle(t)) ** 2 - (x - run.angle(t)) ** 2
    return float(t[int(np.argmax(np.cumsum(gain)))])
