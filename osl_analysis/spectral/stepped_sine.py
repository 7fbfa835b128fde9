# SPDX-License-Identifier: Apache-2.0
"""The stepped sine: what was commanded, the sines that the joint did, and the cycles of them that
are fitted.

A run is a stretch of one frequency and amplitude, whoever commanded it. A segment is the whole
cycles of a run that follows a commanded amplitude.
"""

import cmath
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.errors import Change, InputError
from osl_analysis.base.trial import Array

# Relative differences of a recorded sine from the commanded one
LOST_AMPLITUDE = 0.25  # a dynamometer loses some of it
SAME_RATE = 1e-3  # of two frequencies; runs that agree so well share one
LARGEST_SLIP = 2e-3  # cycles by which a run may slip against the commanded frequency
OTHER_UNIT = 1.0  # decades by which an amplitude in another unit is larger or smaller at least

# Largest relative differences between neighbouring cycles of a run
SAME_FREQUENCY = 0.05  # also from the commanded one; more than any clock is off
SAME_AMPLITUDE = 0.15  # a bench loses as much at 5 Hz
# Largest relative difference of a cycle's amplitude from its run's median; beyond, cycles at its
# ends are a ramp.
ONE_HEIGHT = 0.06
RECENT_CYCLES = 5  # with whose mean the next cycle is compared
FEWEST_RUN_CYCLES = 3  # fewer may be a transient
MISSING_CYCLE = 0.25  # cycles that may be missing at the ends of a run
BEGINS_AT_CENTRE = 0.5  # rad of the phase of a run that begins at its centre and rises

BIN_S = 0.25  # time [s] within which a moving joint turns measurably
MOVING_SHARE = 0.02  # smallest share of its range by which it then turns; rests stay within
# standard deviations of the noise, within which the turn and the angle of a sensor at rest stay
MOVING_NOISES = 12
DEAD_BAND_NOISES = 5

SAMPLES_PER_CYCLE = 64  # tell all of a sine
SINE_ROUNDS = 6  # of Gauss-Newton at most
# cycles over the run by which a round changes the sine, after which it is found: the next round
# changes it by a thousandth of that
SINE_ROUNDING = 1e-5
LARGEST_LACK_OF_FIT = 0.3  # of the sine's RMS
PURE_SINE = 0.08
"""Lack of fit of a pure sine, of its RMS; a triangle's is 0.12. An angle that deviates by so much
of the amplitude, and twice the lack of fit, has left its sine."""
STEADY = 0.01  # relative difference of a frequency between the halves of a run; a sweep's is more
LEAST_SINES = 0.5  # of the moving time: most; whole stepped sines have 0.98, clipped ones 0.7


@dataclass(frozen=True)
class SteppedSineProtocol:
    """A stepped sine: each amplitude at every frequency, in any order, with or without rests.

    An empty field was not stated: the recording's own values count.
    """

    amplitudes: Sequence[float]  # [rad]
    frequencies_hz: Sequence[float]
    # number of cycles at each frequency: one number for all, or one for each; fractional if a time
    # per frequency is commanded
    cycles: float | Sequence[float] | None = None

    def command_of(self, run: "Run") -> tuple[float, float] | None:
        """The commanded amplitude [rad] within 25 % of a recorded one, and the frequency [Hz]
        within 5 %; None if one of them was not commanded."""
        amplitude = followed(run.amplitude, self.amplitudes, LOST_AMPLITUDE)
        frequency_hz = followed(run.frequency_hz, self.frequencies_hz, SAME_FREQUENCY)
        return (amplitude, frequency_hz) if amplitude and frequency_hz else None


def followed(value: float, commanded: Sequence[float], tolerance: float) -> float | None:
    """The commanded value that is nearest by their ratio; None if they differ by more than the
    tolerance."""
    near = [target for target in commanded if abs(value / target - 1) <= tolerance]
    return min(near, key=lambda target: abs(value / target - 1), default=None)


# ---- What the joint did


@dataclass(frozen=True)
class Run:
    """A stretch of one frequency and amplitude."""

    frequency_hz: float
    amplitude: float  # [rad]
    phase: float  # of the cosine at the first row of the record [rad]
    start: int  # row at which it begins
    stop: int  # row at which it ends
    cycles: float  # not rounded: the ends of a run are known to a few hundredths
    # RMS of what the sine leaves, over its own, but of the first and the last cycle, in which a
    # bench starts and stops: harmonics, decay, rounding
    lack_of_fit: float
    is_steady: bool  # whether both halves have one frequency; those of a sweep do not

    def __str__(self) -> str:
        return (
            f"{np.rad2deg(self.amplitude):.3g} deg at {self.frequency_hz:.4g} Hz ({self.cycles:.1f}"
            " cycles)"
        )


def find_sines(
    theta: Array,
    rate_hz: float,
    noise: float,
    moving: NDArray[np.bool_],
    protocol: SteppedSineProtocol,
) -> tuple[list[Run], bool]:
    """Find the sines in a joint angle.

    Parameters
    ----------
    theta : Array
        Angles (n,) [rad].
    rate_hz : float
        Their rate.
    noise : float
        Standard deviation of their noise [rad].
    moving : Array
        Rows (n,) in which the joint moves (`moving_bins`).
    protocol : SteppedSineProtocol
        What was commanded.

    Returns
    -------
    runs : list of Run
        In order of time.
    is_stepped : bool
        Whether the motion is a stepped sine, and no other one: of the moving time at least
        `LEAST_SINES` is in runs that are commanded, or pure sines.

    Notes
    -----
    Consecutive similar cycles, each from one upward crossing of the centre to the next, make a run,
    whose sine is fitted. A run extends as far as the angle follows its sine, and no other run has
    begun. Rests, ramps, transients and disturbed cycles lie between the runs.
    """
    stretches = [*similar_cycles(theta, noise, moving), np.array([len(theta) - 1.0])]
    fewest = min(np.min(protocol.cycles or FEWEST_RUN_CYCLES), FEWEST_RUN_CYCLES)
    sines = []
    sine_motion = 0.0
    earliest = 0
    for crossings, following in pairwise(stretches):
        run = fit_run(theta, rate_hz, crossings, earliest, int(following[0]))
        if run is None or run.cycles <= fewest - MISSING_CYCLE:
            continue
        sines.append(run)
        earliest = run.stop
        if run.is_steady and (run.lack_of_fit < PURE_SINE or protocol.command_of(run)):
            sine_motion += moving[run.start : run.stop].sum()
    return sines, bool(sine_motion >= LEAST_SINES * moving.sum())


def moving_bins(theta: Array, rate_hz: float, noise: float) -> NDArray[np.bool_]:
    """Find the rows in which a joint moves, in bins of `BIN_S`.

    Parameters
    ----------
    theta : Array
        (n,) [rad].
    rate_hz : float
    noise : float
        Standard deviation of its noise [rad].

    Returns
    -------
    Array
        Mask (n,). A bin with only rounding or noise of a sensor at rest does not count.
    """
    rows = max(BIN_S * rate_hz, 1.0)
    first_rows = np.ceil(np.arange(0, len(theta) - 1, rows)).astype(np.intp)
    turn = np.maximum.reduceat(theta, first_rows) - np.minimum.reduceat(theta, first_rows)
    moves = turn > max(MOVING_SHARE * np.ptp(theta), MOVING_NOISES * noise)
    return np.repeat(moves, np.diff(first_rows, append=len(theta)))


def similar_cycles(theta: Array, noise: float, moving: NDArray[np.bool_]) -> Iterator[Array]:
    """Find stretches of two or more consecutive cycles that are similar in frequency and amplitude;
    a single one may belong to a ramp or a rest.

    A cycle begins where the angle (n,) rises through its centre, from below a dead band to above
    it. The band is 2 % of the largest angle, or five noises where these are more, so that rests and
    noise stay within. The centre is the
    median angle while the joint moves: it may rest elsewhere, and for longer.

    Yields
    ------
    Array
        Rows, not rounded, at which the cycles of a stretch begin and the last one ends.
    """
    x = theta - np.median(theta[moving] if moving.any() else theta)
    dead_band = max(MOVING_SHARE * np.abs(x).max(), DEAD_BAND_NOISES * noise)
    beyond = np.flatnonzero(np.abs(x) > dead_band)
    came_up = beyond[1:][np.diff(np.sign(x[beyond])) > 0]
    rises = np.flatnonzero(np.diff(x > 0) & (x[1:] > 0))
    before = rises[np.searchsorted(rises, came_up) - 1]
    crossings = before - x[before] / (x[before + 1] - x[before])
    if len(crossings) < 2:
        return
    rows = np.ceil(crossings).astype(np.intp)
    height = (np.maximum.reduceat(theta, rows) - np.minimum.reduceat(theta, rows))[:-1]
    lengths = np.diff(crossings).tolist()
    sizes = height.tolist()
    begins = [0]
    for number in range(1, len(sizes)):
        recent = slice(max(begins[-1], number - RECENT_CYCLES), number)
        recent_cycles = recent.stop - recent.start
        usual_length = sum(lengths[recent]) / recent_cycles
        usual_size = sum(sizes[recent]) / recent_cycles
        is_alike = abs(lengths[number] / usual_length - 1) <= SAME_FREQUENCY
        if not is_alike or abs(sizes[number] / usual_size - 1) > SAME_AMPLITUDE:
            begins.append(number)
    for first, stop in pairwise([*begins, len(sizes)]):
        if stop - first < 2:
            continue
        relative_height = height[first:stop] / np.median(height[first:stop])
        usual = first + np.flatnonzero(
            np.abs(relative_height - 1) < ONE_HEIGHT
        )  # outside: a slow ramp
        if len(usual) > 1:
            yield crossings[usual[0] : usual[-1] + 2]


def fit_run(
    theta: Array, rate_hz: float, crossings: Array, earliest: int, latest: int
) -> Run | None:
    """Fit a sine to the angle (n,) between the first and the last crossing [rows], and prolong it
    as far as the angle follows it, between two rows. None if its lack of fit exceeds 0.3 of its
    RMS."""
    first, last = np.ceil(crossings[[0, -1]]).astype(np.intp)
    periods = np.diff(crossings)
    early, late = np.array_split(periods, 2)
    stride = max((last - first) // (SAMPLES_PER_CYCLE * len(periods)), 1)
    rows = np.arange(first, last, stride)
    frequency = 1 / periods.mean()  # per row
    sine = 0j
    # the fit of four parameters of IEEE 1057; without a sine yet, the first round leaves it
    for rounds in range(SINE_ROUNDS):
        turned = np.exp(2j * np.pi * frequency * rows)
        slope = (2j * np.pi * rows * sine * turned).real
        columns = np.column_stack([turned.real, -turned.imag, np.ones(len(rows)), slope])
        real, imaginary, centre, change = np.linalg.lstsq(columns, theta[rows])[0].tolist()
        sine = complex(real, imaginary)
        frequency += change
        if rounds and abs(change) * (last - first) < SINE_ROUNDING:
            break

    outside = np.r_[earliest:first, last - 1 : latest + 1]
    tested = np.append(rows, outside)
    amplitude, phase = abs(sine), cmath.phase(sine)
    deviation = theta[tested] - centre - amplitude * np.cos(2 * np.pi * frequency * tested + phase)
    lack_of_fit = np.std(deviation[: len(rows)]) / amplitude * np.sqrt(2)
    if lack_of_fit > LARGEST_LACK_OF_FIT:
        return None
    settled = crossings[1:-1] if len(crossings) > 3 else crossings
    is_settled = (rows >= settled[0]) & (rows < settled[-1])
    has_left = np.abs(deviation[len(rows) :]) > (PURE_SINE + np.sqrt(2) * lack_of_fit) * amplitude
    left = outside[has_left]
    start = int(left[left < first].max(initial=earliest - 1)) + 1
    stop = int(left[left >= last - 1].min(initial=latest + 1)) - 1
    return Run(
        frequency_hz=frequency * rate_hz,
        amplitude=amplitude,
        phase=phase,
        start=start,
        stop=stop,
        cycles=frequency * (stop - start),
        lack_of_fit=np.std(deviation[: len(rows)][is_settled]) / amplitude * np.sqrt(2),
        is_steady=abs(early.mean() / late.mean() - 1) < STEADY,
    )


# ---- What of it is fitted


@dataclass(frozen=True)
class Segment:
    """Whole cycles of one amplitude at one frequency. Rows are those of the record, and may be
    fractional."""

    amplitude: float  # measured amplitude [rad]
    # the commanded one [Hz] if the recorded one does not differ measurably
    frequency_hz: float
    start: float  # row at which the first cycle begins
    stop: float  # row at which the last one ends
    cycles: int  # number of cycles in between
    commanded: float  # amplitude [rad] in the protocol, or a round one


def find_segments(
    theta: Array, rate_hz: float, runs: Sequence[Run], protocol: SteppedSineProtocol
) -> list[Segment]:
    """Find the segments of a joint angle.

    Rests, ramps and numbers of cycles are as recorded; the protocol tells which amplitudes are
    meant. Runs whose frequencies agree to 0.1 % have one. It is the commanded one, or a round one
    if no protocol is stated, provided that no run slips against it by 0.2 % of a cycle. Else it is
    their mean, as when the clock of the bench is off.

    Parameters
    ----------
    theta : Array
        Angles (n,) [rad].
    rate_hz : float
        Their rate.
    runs : sequence of Run
        What `find_sines` has found in them.
    protocol : SteppedSineProtocol
        What was commanded.

    Returns
    -------
    list of Segment
        In order of time.

    Raises
    ------
    InputError
        There is no sine, or an amplitude is ten times larger or smaller than all commanded ones.
    """
    if not runs:
        raise InputError(
            f"no sine was found: the joint angle moves by {np.rad2deg(np.ptp(theta)):.3g} deg in"
            " all",
            "check the channel and the unit of theta in the source file, and that the trial is a"
            " stepped sine",
        )
    sizes = meant_amplitudes(runs, protocol.amplitudes, rate_hz)
    recorded_hz, recorded_cycles = np.transpose([(run.frequency_hz, run.cycles) for run in runs])
    segments = []
    for run in runs:
        size = followed(run.amplitude, sizes, LOST_AMPLITUDE)
        if size is None:
            continue
        similar = np.abs(recorded_hz / run.frequency_hz - 1) < SAME_RATE
        weights = recorded_cycles[similar] ** 2
        mean_hz = np.average(recorded_hz[similar], weights=weights)
        commanded_hz = followed(mean_hz, protocol.frequencies_hz, SAME_FREQUENCY)
        frequency_hz = commanded_hz or float(f"{mean_hz:.3g}")
        if abs(mean_hz / frequency_hz - 1) * np.sqrt(weights.max()) >= LARGEST_SLIP:
            frequency_hz = float(f"{mean_hz:.6g}")

        # in the middle: the ends of a run may lack a quarter of a cycle
        cycles = int(run.cycles + MISSING_CYCLE)
        period = rate_hz / frequency_hz
        length = cycles * period
        start = (run.start + run.stop - length) / 2
        turned = run.phase + 2 * np.pi * run.frequency_hz / rate_hz * start
        phase = cmath.phase(1j * np.exp(1j * turned))
        if abs(phase) < BEGINS_AT_CENTRE:
            start -= phase / (2 * np.pi) * period
        start = max(start, 0.0)
        segments.append(
            Segment(
                amplitude=run.amplitude,
                frequency_hz=frequency_hz,
                start=start,
                stop=start + length,
                cycles=cycles,
                commanded=size,
            )
        )
    return segments


def meant_amplitudes(
    runs: Sequence[Run], commanded: Sequence[float], rate_hz: float
) -> list[float]:
    """The amplitudes [rad] that runs were to have; one far from all of them is a warm-up.

    If not all commanded amplitudes were recorded, the protocol may have been another: other runs
    then have their own amplitude to a tenth of a degree, below one degree to a hundredth. A bench
    loses some of an amplitude: those up to 25 % below a larger one share its. Raises as
    `find_segments`.
    """
    sizes = list(commanded)
    recorded = {followed(run.amplitude, commanded, LOST_AMPLITUDE) for run in runs}
    if sizes and recorded.issuperset(sizes):
        return sizes
    for run in sorted(runs, key=lambda run: -run.amplitude):
        if followed(run.amplitude, sizes, LOST_AMPLITUDE):
            continue
        decades = np.abs(np.log10(np.divide(run.amplitude, commanded)))
        if commanded and decades.min() > OTHER_UNIT:
            commanded_deg = ", ".join(f"{size:.3g}" for size in np.rad2deg(commanded))
            raise InputError(
                f"the sine of {run} at {run.start / rate_hz:.1f} s has another amplitude than"
                f" the protocol's {commanded_deg} deg",
                "correct `amplitudes_deg` in the configuration, or the angle's unit in the"
                " source file",
                changes=[Change("", other_unit_of="theta")],
            )
        size_deg = np.rad2deg(run.amplitude)
        digits = 1 if size_deg >= 1 else 2
        sizes.append(np.deg2rad(np.round(size_deg, digits)))
    return sizes
