"""The stepped sine: what was commanded, what the joint did, the fitted cycles, and what is another
motion.

A run (`sine_runs`) is a stretch of one frequency and amplitude. A segment is the whole cycles of a
run that follows a commanded amplitude. Likeness gives the share of a motion that is sines, and of
commanded ones.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import Change, InputError
from osl_analysis.signals import longest_run, runs, sampling_rate
from osl_analysis.signals.grid import BRIDGE_MORE
from osl_analysis.spectral.sine_runs import (
    MISSING_CYCLE,
    SAME_AMPLITUDE,
    Run,
    find_runs,
    upward_crossings,
)
from osl_analysis.spectral.sine_runs import noise_of as noise_of
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.trial import Array

# Relative differences of a recorded sine from the commanded one
LOST_AMPLITUDE = 0.25  # a dynamometer loses some of it
CLOCK_ERROR = 0.05  # of a frequency; more than any clock is off
SAME_RATE = 1e-3  # of two frequencies; runs that agree so well share one
LARGEST_SLIP = 2e-3  # cycles by which a run may slip against the commanded frequency
OTHER_UNIT = 10  # an amplitude so many times larger or smaller is in another unit

LONGEST_REST = 0.3  # cycles between two runs of one amplitude that follow each other
COARSE_PLACES = 12  # in half a period of the fastest sine, which has one place that agrees best
# A run of whole cycles that begins at its centre and rises
WHOLE_CYCLES = 0.15  # cycles that it may differ from a whole number
BEGINS_AT_CENTRE = 0.5  # rad of its phase at the start

BIN_S = 0.25  # time [s] within which a moving joint turns measurably
MOVING_SHARE = 0.02  # smallest share of its range by which it then turns
MOVING_NOISES = 12  # standard deviations of the noise; a sensor at rest turns by less
FEWEST_RUN_CYCLES = 3  # fewer may be a transient
PURE_SINE = 0.08  # misfit of a pure sine, of its RMS; a triangle's is 0.12
STEADY = 0.01  # relative difference of a frequency between the halves of a run; a sweep's is more

# Share of sines in the moving time
HARDLY = 0.25  # below, no stepped sine
MOSTLY = 0.5  # above, a stepped sine

# Share of the power at one commanded frequency at a time
PIECE_S = 4.0
ONE_LINE = 0.85  # a stepped sine has 0.87 even with spikes, hum and a wandering angle; a sweep 0.8
LEAST_LINE = 0.6  # of a piece's power at a commanded frequency that was recorded
LEAST_RECORDED = 0.6  # of the commanded frequencies


@dataclass(frozen=True)
class SteppedSineProtocol:
    """A stepped sine: each amplitude at every frequency, in any order, with or without rests.

    An empty field was not stated: the recording's own values count.
    """

    amplitudes: Sequence[float]  # [rad]
    frequencies_hz: Sequence[float]
    # number of cycles at each frequency: one number for all, or one for each
    cycles: float | Sequence[float]

    @property
    def cycles_at(self) -> tuple[float, ...]:
        """Number of cycles at each frequency; fractional if a time per frequency is commanded."""
        cycles = np.asarray(self.cycles, dtype=float)
        if not cycles.size:
            return ()
        return tuple(np.broadcast_to(cycles, len(self.frequencies_hz)).tolist())

    def amplitude_near(self, amplitude: float) -> float | None:
        """The commanded amplitude [rad] within 25 % of a recorded one; else None."""
        return followed(amplitude, self.amplitudes, LOST_AMPLITUDE)

    def frequency_near(self, frequency_hz: float) -> float | None:
        """The commanded frequency [Hz] within 5 % of a recorded one; else None."""
        return followed(frequency_hz, self.frequencies_hz, CLOCK_ERROR)


def stated_protocol(
    amplitudes_deg: Sequence[float] | None,
    frequencies_hz: Sequence[float] | None,
    cycles: float | Sequence[float] | None,
) -> SteppedSineProtocol:
    """Make the protocol that a configuration states.

    Parameters
    ----------
    amplitudes_deg, frequencies_hz : Sequence of float or None
        [deg] and [Hz]; None: not stated.
    cycles : float, Sequence of float or None
        At each frequency.
    """
    frequencies = tuple(frequencies_hz or ())
    cycles_at_each: float | Sequence[float] = () if cycles is None else cycles
    amplitudes = tuple(np.deg2rad(amplitudes_deg or ()).tolist())
    return SteppedSineProtocol(amplitudes, frequencies, cycles_at_each)


def followed(value: float, commanded: Sequence[float], tolerance: float) -> float | None:
    """The commanded value that is nearest by their ratio; None if they differ by more than the
    tolerance."""
    if not commanded:
        return None
    nearest = min(commanded, key=lambda target: abs(value / target - 1))
    return nearest if abs(value / nearest - 1) <= tolerance else None


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
    commanded: float | None = None  # amplitude [rad] in the protocol

    @property
    def rows(self) -> slice:
        """Its rows, transient included."""
        return slice(round(self.start), round(self.stop))


def whole_rows(start: float, stop: float) -> slice:
    """The rows that lie at least partly between two edges, up to rounding errors."""
    return slice(math.floor(start + 1e-6), math.ceil(stop - 1e-6))


def settled_cycles(segment: Segment, settle_cycles: int, usable: NDArray[np.bool_]) -> Array:
    """Choose the cycles of a segment that are fitted.

    Parameters
    ----------
    segment : Segment
    settle_cycles : int
        First cycles, which contain the transient.
    usable : Array
        (n,) rows that are not near a gap.

    Returns
    -------
    Array
        Rows (k, 2) at which the cycles begin and end. The first edge is a whole row; the others are
        not rounded: a cycle with an extra fraction of a row has another mean than the rest (at 250
        and 3 Hz the error of B was 5.8 times too large).

    Raises
    ------
    InputError
        No cycle is free of gaps.

    Notes
    -----
    The last cycle is left out, too: into it the zero-phase filter smears the next frequency. One
    cycle is kept in any case. Cycles with a row that is not usable are left out. So are stretches
    between them with too few cycles for an interval, if there is a longer one.
    """
    before = min(settle_cycles, segment.cycles - 1)
    after = min(1, segment.cycles - before - 1)
    period = (segment.stop - segment.start) / segment.cycles
    number = np.arange(segment.cycles - before - after)
    first = np.rint(segment.start + before * period) + period * number
    edges = np.stack([first, first + period], axis=1)
    is_free = np.ones(len(edges), np.bool_)
    if not usable.all():
        is_free = np.array([bool(usable[whole_rows(a, b)].all()) for a, b in edges.tolist()])
    if not is_free.any():
        raise InputError(
            f"no cycle of {np.rad2deg(segment.amplitude):.3g} deg at {segment.frequency_hz:g} Hz is"
            f" free of rows near a gap that is too long to be bridged; {BRIDGE_MORE}"
        )
    longest = longest_run(is_free)
    fewest = min(longest.stop - longest.start, FEWEST_CYCLES)
    return np.concatenate([edges[run] for run in runs(is_free) if run.stop - run.start >= fewest])


def labels_deg(segments: Sequence[Segment]) -> list[float]:
    """Find the measured amplitude [deg] that names each segment, to three digits.

    It is the median of all that follow one commanded amplitude without a gap in size between them.
    """
    amplitude = np.array([segment.amplitude for segment in segments])
    commanded = np.array([segment.commanded or 0.0 for segment in segments])
    order = np.lexsort((amplitude, commanded))
    sorted_amplitude = amplitude[order]
    is_other_command = np.diff(commanded[order]) > 0
    is_gap = sorted_amplitude[1:] > (1 + SAME_AMPLITUDE) * sorted_amplitude[:-1]
    number = np.empty_like(order)
    number[order] = np.concatenate([[0], np.cumsum(is_other_command | is_gap)])
    medians = [np.median(amplitude[number == own_number]) for own_number in number]
    return [float(f"{np.rad2deg(size):.3g}") for size in medians]


def find_segments(likeness: "Likeness") -> list[Segment]:
    """Find the segments of a joint angle at uniform times.

    Frequencies, rests, ramps and numbers of cycles are as recorded; the protocol tells which
    amplitudes are meant.

    Parameters
    ----------
    likeness : Likeness
        Of the angle to the protocol.

    Returns
    -------
    list of Segment
        In order of time.

    Raises
    ------
    InputError
        As `meant_runs`.
    """
    rate = sampling_rate(likeness.recorded)
    meant = meant_runs(likeness)
    frequencies = common_frequencies([run for run, _ in meant], likeness.protocol)

    # of one amplitude, without a rest
    groups: list[list[tuple[Run, Segment]]] = []
    for (run, amplitude), frequency in zip(meant, frequencies, strict=True):
        segment = whole_cycles_of(run, amplitude, frequency, rate)
        if groups:
            run_before, segment_before = groups[-1][-1]
            rest = run.start - run_before.stop
            rest_cycles = rest * max(run_before.frequency_hz, run.frequency_hz)
            if rest_cycles < LONGEST_REST and segment_before.commanded == amplitude:
                groups[-1].append((run, segment))
                continue
        groups.append([(run, segment)])

    deviation = likeness.theta - np.mean(likeness.theta)
    segments = list[Segment]()
    for group in groups:
        of_group = [segment for _, segment in group]
        if all(is_of_whole_cycles(run, segment) for run, segment in group):
            of_group = aligned_segments(of_group, deviation, rate)
        segments.extend(of_group)
    return segments


def whole_cycles_of(run: Run, amplitude: float, frequency_hz: float, rate_hz: float) -> Segment:
    """The whole cycles in the middle of a run; its ends may lack a quarter."""
    cycles = int(run.cycles + MISSING_CYCLE)
    length = cycles / frequency_hz
    start = max((run.start + run.stop - length) / 2, 0.0)
    return Segment(
        amplitude=run.amplitude,
        frequency_hz=frequency_hz,
        start=start * rate_hz,
        stop=(start + length) * rate_hz,
        cycles=cycles,
        commanded=amplitude,
    )


def is_of_whole_cycles(run: Run, segment: Segment) -> bool:
    """Whether a run has whole cycles of a sine that begins at its centre and rises."""
    begins_at_centre = abs(run.phase_at(run.start)) < BEGINS_AT_CENTRE
    return abs(run.cycles - segment.cycles) < WHOLE_CYCLES and begins_at_centre


def aligned_segments(
    segments: Sequence[Segment], deviation: Array, rate_hz: float
) -> list[Segment]:
    """Move consecutive segments to where the angle's deviation (n,) agrees best with all their
    sines."""
    template = unit_sines([(s.frequency_hz, s.cycles) for s in segments], rate_hz)
    begin = segments[0].start
    reach = int(rate_hz / max(segment.frequency_hz for segment in segments) / 2)
    low = max(round(begin) - reach, 0)
    near = deviation[low : round(begin) + reach + len(template)]
    if len(near) >= len(template):
        begin = float(low + best_place(near, template, max(reach // COARSE_PLACES, 1)))
    lengths = [segment.stop - segment.start for segment in segments]
    edges = (begin + np.cumsum([0.0, *lengths])).tolist()
    return [
        replace(segment, start=start, stop=stop)
        for segment, (start, stop) in zip(segments, pairwise(edges), strict=True)
    ]


def best_place(signal: Array, template: Array, stride: int) -> int:
    """Row of a signal (n,) from which it agrees best with a template (k,): first of every few rows,
    then of those about the best one."""

    def agreement(row: int) -> float:
        return float(signal[row : row + len(template)] @ template)

    rows = range(len(signal) - len(template) + 1)
    best = max(rows[::stride], key=agreement)
    return max(rows[max(best - stride, 0) : best + stride + 1], key=agreement)


def meant_runs(likeness: "Likeness") -> list[tuple[Run, float]]:
    """Choose the runs that follow a commanded amplitude, each with the amplitude [rad] that it was
    to have.

    If not all commanded amplitudes were recorded, the protocol may have been another: other runs
    then count, too, with their own amplitude to a tenth of a degree. An angle without a sine is
    refused, and so is an amplitude ten times larger or smaller than all commanded ones.
    """
    protocol = likeness.protocol
    if not likeness.runs:
        raise InputError(no_sine(likeness))
    commanded = [protocol.amplitude_near(run.amplitude) for run in likeness.runs]
    all_recorded = bool(protocol.amplitudes) and set(protocol.amplitudes) <= set(commanded)

    uncommanded: list[float] = []  # amplitudes [rad]
    if not all_recorded:
        others = [
            run
            for run, amplitude in zip(likeness.runs, commanded, strict=True)
            if amplitude is None
        ]
        check_unit_of_amplitudes(others, likeness)
        # the largest first: a bench loses some of an amplitude
        for size in sorted((run.amplitude for run in others), reverse=True):
            if followed(size, uncommanded, LOST_AMPLITUDE) is None:
                uncommanded.append(float(np.deg2rad(round(np.rad2deg(size), 1))))

    meant = []
    for run, amplitude in zip(likeness.runs, commanded, strict=True):
        of_run = amplitude or followed(run.amplitude, uncommanded, LOST_AMPLITUDE)
        if of_run is not None:
            meant.append((run, of_run))
    return meant


def no_sine(likeness: "Likeness") -> str:
    """The message that an angle has no sine."""
    commanded = listed_deg(likeness.protocol.amplitudes)
    protocol = f", the protocol says sines of {commanded} deg" if commanded else ""
    return (
        f"no sine was found: the joint angle moves by {np.rad2deg(np.ptp(likeness.theta)):.3g} deg"
        f" in all{protocol}; check the channel and the unit of theta in the source file, and that"
        " the trial is a stepped sine"
    )


def check_unit_of_amplitudes(runs: Sequence[Run], likeness: "Likeness") -> None:
    """Refuse an amplitude ten times larger or smaller than all commanded ones."""
    amplitudes = likeness.protocol.amplitudes
    if not amplitudes:
        return
    low = min(amplitudes) / OTHER_UNIT
    high = max(amplitudes) * OTHER_UNIT
    for run in runs:
        if not low < run.amplitude < high:
            start = run.start + float(likeness.recorded[0])
            raise InputError(
                f"the sine of {run.frequency_hz:.4g} Hz at {start:.1f} s has an amplitude of"
                f" {np.rad2deg(run.amplitude):.2f} deg, the protocol says"
                f" {listed_deg(amplitudes)} deg; correct `amplitudes_deg` in the configuration, or"
                " the angle's unit in the source file",
                [Change("", other_unit_of="theta")],
            )


def listed_deg(amplitudes: Sequence[float]) -> str:
    return ", ".join(f"{np.rad2deg(amplitude):g}" for amplitude in amplitudes)


def common_frequencies(runs: Sequence[Run], protocol: SteppedSineProtocol) -> list[float]:
    """The frequency [Hz] of each run, one for all runs that agree to 0.1 %.

    It is the commanded one, or a round one if no protocol is stated, provided that no run slips
    against it by 0.2 % of a cycle. Else it is their mean, as when the clock of the bench is off.
    """
    frequencies = []
    for run in runs:
        similar = [
            other for other in runs if abs(other.frequency_hz / run.frequency_hz - 1) < SAME_RATE
        ]
        recorded = [other.frequency_hz for other in similar]
        mean = float(np.average(recorded, weights=[other.cycles**2 for other in similar]))
        commanded = protocol.frequency_near(mean) or float(f"{mean:.3g}")
        slip = abs(mean / commanded - 1) * max(other.cycles for other in similar)
        frequencies.append(float(commanded) if slip < LARGEST_SLIP else float(f"{mean:.6g}"))
    return frequencies


def unit_sines(sines: Sequence[tuple[float, float]], rate_hz: float) -> Array:
    """Sines of unit amplitude, one after the other: frequency [Hz] and number of cycles of each."""
    pieces = []
    for frequency, cycles in sines:
        rows = np.arange(round(cycles / frequency * rate_hz))
        pieces.append(np.sin(2 * np.pi * frequency * rows / rate_hz))
    return np.concatenate(pieces)


@dataclass(frozen=True)
class Likeness:
    """How much of a motion is a stepped sine, and the commanded one."""

    recorded: Array  # uniform times (n,) [s]
    theta: Array  # joint angle (n,) [rad]
    protocol: SteppedSineProtocol  # what was commanded

    @cached_property
    def time(self) -> Array:
        """Times (n,) [s] from the first row."""
        return np.asarray(self.recorded - self.recorded[0])

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the angle's noise [rad]."""
        return noise_of(self.theta)

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """Rows (n,) in which the joint moves."""
        return moving_bins(self.time, self.theta, self.noise)

    @property
    def moves(self) -> bool:
        return bool(self.moving.any())

    @cached_property
    def crossings(self) -> Array:
        """Times [s] at which the angle rises through its centre."""
        return upward_crossings(self.time, self.theta, self.noise)

    @cached_property
    def runs(self) -> list[Run]:
        """Runs of three cycles, or of as few as were commanded."""
        commanded = int(min(self.protocol.cycles_at, default=FEWEST_RUN_CYCLES))
        fewest = min(FEWEST_RUN_CYCLES, commanded)
        return find_runs(self.time, self.theta, self.crossings, fewest)

    @cached_property
    def sines(self) -> float:
        """Share of the moving time in commanded runs, and in pure sines."""
        inside = np.zeros_like(self.moving)
        for run in self.runs:
            is_pure = run.misfit < PURE_SINE * run.amplitude / math.sqrt(2)
            if self.is_steady(run) and (self.is_commanded(run) or is_pure):
                first, stop = np.searchsorted(self.time, (run.start, run.stop))
                inside[first:stop] = True
        moving = max(int(np.count_nonzero(self.moving)), 1)
        return float(np.count_nonzero(inside & self.moving) / moving)

    def is_commanded(self, run: Run) -> bool:
        """Whether a run has a commanded frequency and a commanded amplitude."""
        has_frequency = self.protocol.frequency_near(run.frequency_hz) is not None
        return has_frequency and self.protocol.amplitude_near(run.amplitude) is not None

    def is_steady(self, run: Run) -> bool:
        """Whether both halves of a run agree in frequency to 1 %; those of a sweep do not."""
        margin = 0.1 / run.frequency_hz
        is_inside = (self.crossings > run.start - margin) & (self.crossings < run.stop + margin)
        crossings = self.crossings[is_inside]
        middle = len(crossings) // 2
        if middle < 2:
            return True
        first_half = (crossings[middle] - crossings[0]) / middle
        second_half = (crossings[-1] - crossings[middle]) / (len(crossings) - 1 - middle)
        longer = max(first_half, second_half)
        shorter = min(first_half, second_half)
        return bool(longer / shorter - 1 < STEADY)

    def one_line(self) -> float:
        """Power at one commanded frequency at a time, as a share of that in their band.

        It is the mean over pieces of 4 s of the largest share; 0 if fewer than 0.6 of the commanded
        frequencies have a share above 0.6 in some piece.
        """
        commanded = np.unique(self.protocol.frequencies_hz)
        if not commanded.size:
            return 0.0
        rate = (len(self.time) - 1) / float(self.time[-1])
        n = round(PIECE_S * rate)
        f = np.fft.rfftfreq(n, 1 / rate)
        in_band = (f >= 0.6 * commanded[0]) & (f <= 1.5 * commanded[-1])
        width = np.maximum(CLOCK_ERROR * commanded, 1.01 / PIECE_S)
        is_near = np.abs(f[:, None] - commanded) <= width
        smallest_range = MOVING_SHARE * float(np.ptp(self.theta))
        shares = []
        for start in range(0, len(self.theta) - n + 1, n // 2):
            piece = self.theta[start : start + n]
            power = np.abs(np.fft.rfft(np.hanning(n) * (piece - piece.mean()))) ** 2
            if np.ptp(piece) > smallest_range and power[in_band].sum() > 0:
                shares.append((power[:, None] * is_near).sum(axis=0) / power[in_band].sum())
        if not shares:
            return 0.0
        is_recorded = (np.array(shares) > LEAST_LINE).any(axis=0)
        if np.count_nonzero(is_recorded) < LEAST_RECORDED * len(commanded):
            return 0.0
        return float(np.max(shares, axis=1).mean())

    @property
    def kind(self) -> Literal["stepped sine", "unclear", "other"]:
        """`stepped sine`; `unclear` if a part has sines or commanded frequencies, or if nothing
        moves; else `other`."""
        if self.sines > MOSTLY:
            return "stepped sine"
        if not self.moves or self.sines > HARDLY or self.one_line() > ONE_LINE:
            return "unclear"
        return "other"


def moving_bins(time: Array, theta: Array, noise: float | None = None) -> NDArray[np.bool_]:
    """Find the rows in which a joint moves, in bins of `BIN_S`.

    Parameters
    ----------
    time, theta : Array
        (n,) [s] and (n,) [rad].
    noise : float, optional
        `noise_of` the angle [rad], where it is known.

    Returns
    -------
    Array
        Mask (n,). A bin with only rounding or noise of a sensor at rest does not count.
    """
    bins = np.floor((time - time[0]) / BIN_S)
    first_rows = np.flatnonzero(np.concatenate([[True], bins[1:] != bins[:-1]]))
    turn = np.maximum.reduceat(theta, first_rows) - np.minimum.reduceat(theta, first_rows)
    noise = noise_of(theta) if noise is None else noise
    moves = turn > max(MOVING_SHARE * float(np.ptp(theta)), MOVING_NOISES * noise)
    return np.asarray(np.repeat(moves, np.diff(np.append(first_rows, len(theta)))))
