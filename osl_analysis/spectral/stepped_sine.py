"""The stepped sine: what was commanded, what the joint did, the fitted cycles, and what is another
motion.

A run is a stretch of one frequency and amplitude. A segment is the whole cycles of a run that
follows a commanded amplitude. Likeness gives the share of a motion that is sines, and of commanded
ones."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from statistics import median
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import usual_size
from osl_analysis.signals import longest_run, run_edges, runs, sampling_rate
from osl_analysis.signals.grid import BRIDGE_MORE
from osl_analysis.stats.regression import FEWEST_CYCLES
from osl_analysis.trial import Array

SAME_FREQUENCY, SAME_AMPLITUDE = 0.05, 0.15
"""Largest relative differences between neighbouring cycles of a run; a bench loses as much
amplitude at 5 Hz."""
ONE_HEIGHT = 0.06
"""Largest relative difference of a cycle's amplitude from its run's median; beyond, cycles at its
ends are a ramp."""


@dataclass(frozen=True)
class SteppedSineProtocol:
    """A stepped sine: each amplitude at every frequency, in any order, with or without rests. An
    empty field was not stated: the recording's own values count."""

    amplitudes: Sequence[float]  # amplitudes [rad]
    frequencies_hz: Sequence[float]  # frequencies [Hz]
    # number of cycles at each frequency: one number for all, or one for each
    cycles: float | Sequence[float]

    @property
    def cycles_at(self) -> tuple[float, ...]:
        """Number of cycles at each frequency; fractional if a time per frequency is commanded."""
        cycles = np.asarray(self.cycles, dtype=float)
        return tuple(
            np.broadcast_to(cycles, len(self.frequencies_hz) if cycles.size else 0).tolist()
        )

    def amplitude_near(self, amplitude: float) -> float | None:
        """The commanded amplitude [rad] within 25 % of a recorded one, of which a dynamometer loses
        some; else None."""
        return followed(amplitude, self.amplitudes, 0.25)

    def frequency_near(self, frequency_hz: float) -> float | None:
        """The commanded frequency [Hz] within 5 % of a recorded one, more than any clock is off;
        else None."""
        return followed(frequency_hz, self.frequencies_hz, 0.05)


def stated_protocol(
    amplitudes_deg: Sequence[float] | None,
    frequencies_hz: Sequence[float] | None,
    cycles: float | Sequence[float] | None,
    seconds: float | None,
) -> SteppedSineProtocol:
    """The protocol that a configuration states, amplitudes in [deg]; `seconds` at each frequency
    replace `cycles`."""
    amplitudes, frequencies = (
        tuple(np.deg2rad(amplitudes_deg or ()).tolist()),
        tuple(frequencies_hz or ()),
    )
    at_each = cycles if seconds is None else tuple(seconds * f for f in frequencies)
    return SteppedSineProtocol(amplitudes, frequencies, () if at_each is None else at_each)


def followed(value: float, commanded: Sequence[float], tolerance: float) -> float | None:
    """The commanded value that is nearest by their ratio; None if they differ by more than the
    tolerance."""
    nearest = min(commanded, key=lambda one: abs(value / one - 1), default=None)
    return nearest if nearest is not None and abs(value / nearest - 1) <= tolerance else None


def noise_of(theta: Array) -> float:
    """Standard deviation of the noise of an angle (n,), in its unit, by its second differences; 0
    of two samples."""
    return usual_size(np.diff(theta, 2)) / (0.6745 * np.sqrt(6)) if len(theta) > 2 else 0.0


def upward_crossings(time: Array, theta: Array) -> Array:
    """Times [s] at which the angle rises through its centre, from below a dead band to above it.
    The band is 2 % of the largest angle, so that rests and noise stay within. The centre is the
    median angle while it changes measurably in 20 ms: it may rest elsewhere, and for longer."""
    apart = max(round(0.02 * (len(time) - 1) / float(time[-1] - time[0])), 1)
    change = np.abs(theta[apart:] - theta[:-apart])
    moving = change > 0.1 * np.quantile(change, 0.95) if change.size else change > 0
    x = theta - np.median(theta[apart:][moving] if moving.any() else theta)
    dead = max(0.02 * max(float(x.max()), -float(x.min())), 5 * noise_of(theta))
    high, low = run_edges(x > dead), run_edges(x < -dead)
    # 0: never yet
    last_low = np.append(low[:, 1], 0)[np.searchsorted(low[:, 1], high[:, 0], side="right") - 1]
    came_up = high[last_low > np.append(0, high[:-1, 1]), 0]
    rises = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
    before = rises[np.searchsorted(rises, came_up) - 1]
    return np.asarray(
        time[before] - x[before] * (time[before + 1] - time[before]) / (x[before + 1] - x[before])
    )


@dataclass(frozen=True)
class Run:
    """A stretch of one frequency and amplitude."""

    amplitude: float  # amplitude [rad]
    frequency_hz: float  # frequency [Hz]
    phasor: complex
    """The sine is the real part of phasor exp(2j pi frequency t) about the centre, t the time of
    the record [s]."""
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
        turn = 2 * np.pi * self.frequency_hz * time + np.angle(self.phasor)
        return np.asarray(self.centre + abs(self.phasor) * np.cos(turn))

    def phase_at(self, time: float) -> float:
        """Phase [rad] at a time [s] of the sine, between -pi and pi; 0 where the angle rises
        through its centre."""
        return float(np.angle(1j * self.phasor * np.exp(2j * np.pi * self.frequency_hz * time)))

    def __str__(self) -> str:
        return (
            f"{np.rad2deg(self.amplitude):.2g} deg at {self.frequency_hz:.4g} Hz ({self.cycles:.1f}"
            " cycles)"
        )


def find_runs(time: Array, theta: Array, crossings: Array, fewest: int) -> list[Run]:
    """The runs of `fewest` or more cycles of a joint angle theta [rad] at increasing times [s],
    shape (n,) each, which rises through its centre at the `crossings` [s]. Consecutive similar
    cycles make a run, whose sine is fitted. Two runs are joined if the same sine continues after a
    disturbed cycle, two cycles later at most. A run extends as far as the angle follows its sine.
    Rests, ramps and transients lie between the runs."""
    whole: list[Run] = []
    for rows, rate in alike_cycles(time, theta, crossings):
        run = fit_run(time, theta, rows, rate)
        if run is None:
            continue
        last = whole[-1] if whole else run
        middle = (last.stop + run.start) / 2
        slip = np.angle(np.exp(1j * (last.phase_at(middle) - run.phase_at(middle))))
        if (
            whole
            and (run.start - last.stop) * last.frequency_hz < 2.5
            and abs(run.frequency_hz / last.frequency_hz - 1) < SAME_FREQUENCY
            and abs(run.amplitude / last.amplitude - 1) < ONE_HEIGHT
            and abs(float(slip)) < 0.3
        ):
            both = slice(*np.searchsorted(time, [last.start, run.stop]))
            if (again := fit_run(time, theta, both, last.frequency_hz)) is not None:
                whole[-1] = again
                continue
        whole.append(run)
    return [run for run in prolonged_runs(time, theta, whole) if run.cycles > fewest - 0.25]


def alike_cycles(time: Array, theta: Array, crossings: Array) -> list[tuple[slice, float]]:
    """Rows and frequency [Hz] of two or more consecutive cycles, each from one upward crossing [s]
    to the next, that are similar in frequency and amplitude; a single one may belong to a ramp or a
    rest."""
    if len(crossings) < 2:
        return []
    rows = np.searchsorted(time, crossings)
    height = np.maximum.reduceat(theta, rows)[:-1] - np.minimum.reduceat(theta, rows)[:-1]
    frequency = 1 / np.diff(crossings)
    stretches, start = list[tuple[slice, float]](), 0
    for stop in range(1, len(frequency) + 1):
        recent = slice(max(start, stop - 5), stop)
        if (
            stop == len(frequency)
            or abs(frequency[stop] / median(frequency[recent].tolist()) - 1) > SAME_FREQUENCY
            or abs(height[stop] / median(height[recent].tolist()) - 1) > SAME_AMPLITUDE
        ):
            own = height[start:stop]
            # a slow ramp stands outside
            usual = np.flatnonzero(np.abs(own / np.median(own) - 1) < ONE_HEIGHT)
            first, last = (int(usual[0]), int(usual[-1]) + 1) if len(usual) else (0, len(own))
            first, last = first + start, last + start
            if last - first >= 2:
                rate = (last - first) / float(crossings[last] - crossings[first])
                stretches.append((slice(int(rows[first]), int(rows[last])), rate))
            start = stop
    return stretches


def fit_run(time: Array, theta: Array, rows: slice, frequency: float) -> Run | None:
    """The sine of about some frequency [Hz] through some rows; None if its misfit exceeds 0.3 of
    its RMS. The phasor may change linearly in time; the growth of its phase corrects the
    frequency."""
    duration = float(time[rows.stop - 1] - time[rows.start])
    # 64 samples of a cycle tell all
    every = max(int((rows.stop - rows.start) / (duration * frequency) / 64), 1)
    t, x = time[rows][::every], theta[rows][::every]
    if len(t) < 8:
        return None
    middle = float(t.mean())
    share = (t - middle) / duration
    for _ in range(4):
        turn = 2 * np.pi * frequency * (t - middle)
        pair = np.array([np.cos(turn), -np.sin(turn)])
        columns = np.concatenate([np.ones((1, len(t))), pair, share * pair])
        found, *_ = np.linalg.lstsq(columns @ columns.T, columns @ x, rcond=None)
        phasor, growth = complex(*found[1:3]), complex(*found[3:])
        slip = (growth / phasor).imag / (2 * np.pi)
        frequency += slip / duration
        if abs(slip) < 1e-9:  # cycles over the run
            break
    if float(np.sqrt(np.mean((x - found @ columns) ** 2))) > 0.3 * abs(phasor) / np.sqrt(2):
        return None
    phasor *= np.exp(-2j * np.pi * frequency * middle)
    start, stop = float(time[rows.start]), float(time[rows.stop - 1])
    run = Run(abs(phasor), frequency, phasor, float(found[0]), start, stop, 0.0)
    return replace(run, misfit=float(np.sqrt(np.mean((x - run.angle(t)) ** 2))))


def prolonged_runs(time: Array, theta: Array, runs: Sequence[Run]) -> list[Run]:
    """The runs, each as far as the angle follows its sine."""

    def followed_until(run: Run, limit: float) -> float:
        """Time [s] up to which the angle follows the sine, from the middle of its end cycle towards
        `limit` [s]. It has left the sine when it deviates by 8 % of the amplitude plus twice the
        misfit of its own cycles."""
        forwards = limit >= run.stop
        low, high = np.searchsorted(time, sorted((run.stop if forwards else run.start, limit)))
        rows = np.arange(low, min(high + 1, len(time)))
        rows = rows if forwards else rows[::-1]
        away = np.abs(theta[rows] - run.angle(time[rows])) > 0.08 * run.amplitude + 2 * run.misfit
        return float(time[rows[max(int(np.argmax(away)) - 1, 0)]]) if away.any() else limit

    if not runs:
        return []
    befores = [float(time[0]), *(run.stop for run in runs[:-1])]
    afters = [*(run.start for run in runs[1:]), float(time[-1])]
    longer = [
        replace(run, start=followed_until(run, before), stop=followed_until(run, after))
        for run, before, after in zip(runs, befores, afters, strict=True)
    ]
    for k, (run, following) in enumerate(pairwise(longer)):
        if run.stop > following.start:  # each sample belongs to the nearer sine
            low, high = np.searchsorted(time, [following.start, run.stop])
            t, x = time[low : high + 1], theta[low : high + 1]
            gain = (x - following.angle(t)) ** 2 - (x - run.angle(t)) ** 2
            border = float(t[int(np.argmax(np.cumsum(gain)))])
            longer[k], longer[k + 1] = replace(run, stop=border), replace(following, start=border)
    return longer


@dataclass(frozen=True)
class Segment:
    """Whole cycles of one amplitude at one frequency. Rows are those of the record, and may be
    fractional."""

    amplitude: float  # measured amplitude [rad]
    # frequency [Hz]; the commanded one if the recorded one does not differ measurably
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
    """Rows at which the fitted cycles of a segment begin and end, (k, 2). The first `settle_cycles`
    contain the transient, and into the last one the zero-phase filter smears the next frequency:
    they are left out, but one cycle is kept. Cycles with a row that is not `usable` (n,) are left
    out. So are stretches between them with too few cycles for an interval, if there is a longer
    one. The first edge is a whole row; the others are not rounded: a cycle with an extra fraction
    of a row has another mean than the rest (at 250 and 3 Hz the error of B was 5.8 times too
    large)."""
    before = min(settle_cycles, segment.cycles - 1)
    after = min(1, segment.cycles - before - 1)
    period = (segment.stop - segment.start) / segment.cycles
    first = np.rint(segment.start + before * period) + period * np.arange(
        segment.cycles - before - after
    )
    edges = np.stack([first, first + period], axis=1)
    whole = np.array([bool(usable[whole_rows(a, b)].all()) for a, b in edges.tolist()])
    if not whole.any():
        raise InputError(
            f"no cycle of {np.rad2deg(segment.amplitude):.3g} deg at {segment.frequency_hz:g} Hz is"
            f" free of rows near a gap that is too long to be bridged; {BRIDGE_MORE}"
        )
    longest = longest_run(whole)
    fewest = min(longest.stop - longest.start, FEWEST_CYCLES)
    return np.concatenate([edges[run] for run in runs(whole) if run.stop - run.start >= fewest])


def labels_deg(segments: Sequence[Segment]) -> list[float]:
    """The measured amplitude [deg] that names each segment, to three digits: the median of all that
    follow one commanded amplitude without a gap in size between them."""
    size, commanded = np.array([(one.amplitude, one.commanded or 0.0) for one in segments]).T
    order = np.lexsort((size, commanded))
    apart = (np.diff(commanded[order]) > 0) | (
        size[order][1:] > (1 + SAME_AMPLITUDE) * size[order][:-1]
    )
    number = np.empty_like(order)
    number[order] = np.concatenate([[0], np.cumsum(apart)])
    return [float(f"{np.rad2deg(np.median(size[number == own])):.3g}") for own in number]


def find_segments(known: "Likeness") -> list[Segment]:
    """The segments of a joint angle at uniform times, in order of time. Frequencies, rests, ramps
    and numbers of cycles are as recorded; the protocol tells which amplitudes are meant."""
    theta, rate, meant = known.theta, sampling_rate(known.recorded), meant_runs(known)
    frequencies = common_frequencies([run for run, _ in meant], known.protocol)
    # of one amplitude, without a rest of 0.3 cycles or more
    groups: list[list[tuple[Run, Segment]]] = []
    for (run, amplitude), frequency in zip(meant, frequencies, strict=True):
        count = int(run.cycles + 0.25)  # whole ones; the ends may lack a quarter
        length = count / frequency
        # the whole cycles, in the middle of the run
        start = max((run.start + run.stop - length) / 2, 0.0)
        segment = Segment(
            run.amplitude, frequency, start * rate, (start + length) * rate, count, amplitude
        )
        before, its = groups[-1][-1] if groups else (run, segment)
        gap = (run.start - before.stop) * max(before.frequency_hz, run.frequency_hz)
        if groups and gap < 0.3 and its.commanded == amplitude:
            groups[-1].append((run, segment))
        else:
            groups.append([(run, segment)])
    deviation, aligned = theta - np.mean(theta), list[Segment]()
    for group in groups:
        alike = [segment for _, segment in group]
        # whole cycles of sines that begin at their centre and rise: where the angle agrees best
        # with all of them
        if all(
            abs(run.cycles - its.cycles) < 0.15 and abs(run.phase_at(run.start)) < 0.5
            for run, its in group
        ):
            template = unit_sines([(s.frequency_hz, s.cycles) for s in alike], rate)
            reach = int(rate / max(s.frequency_hz for s in alike) / 2)
            low, begin = max(round(alike[0].start) - reach, 0), alike[0].start
            near = deviation[low : round(alike[0].start) + reach + len(template)]
            if len(near) >= len(template):
                begin = float(low + np.argmax(np.correlate(near, template, "valid")))
            edges_of = begin + np.cumsum(
                [0.0, *(segment.stop - segment.start for segment in alike)]
            )
            places = zip(alike, pairwise(edges_of.tolist()), strict=True)
            alike = [replace(segment, start=a, stop=b) for segment, (a, b) in places]
        aligned += alike
    return aligned


def meant_runs(known: "Likeness") -> list[tuple[Run, float]]:
    """The runs that follow a commanded amplitude [rad], with it. If not all commanded amplitudes
    were recorded, the protocol may have been another: other runs then count, too, with their own
    amplitude to a tenth of a degree. An angle without a sine is refused, and so is an amplitude ten
    times larger or smaller than all commanded ones."""
    followed_by = [(run, known.protocol.amplitude_near(run.amplitude)) for run in known.runs]
    amplitudes, own = known.protocol.amplitudes, list[float]()
    commanded = ", ".join(f"{np.rad2deg(a):g}" for a in amplitudes)
    if not followed_by:
        says = f", the protocol says sines of {commanded} deg" if amplitudes else ""
        raise InputError(
            f"no sine was found: the joint angle moves by {np.rad2deg(np.ptp(known.theta)):.3g} deg"
            f" in all{says}; check the channel and the unit of theta in the source file, and that"
            " the trial is a stepped sine"
        )
    all_recorded = bool(amplitudes) and {*amplitudes} <= {amplitude for _, amplitude in followed_by}
    low, high = (min(amplitudes) / 10, max(amplitudes) * 10) if amplitudes else (0.0, np.inf)
    others = [] if all_recorded else [run for run, amplitude in followed_by if amplitude is None]
    if run := next((run for run in others if not low < run.amplitude < high), None):
        raise InputError(
            f"the sine of {run.frequency_hz:.4g} Hz at {run.start + float(known.recorded[0]):.1f} s"
            f" has an amplitude of {np.rad2deg(run.amplitude):.2f} deg, the protocol says"
            f" {commanded} deg; correct `amplitudes_deg` in the configuration, or the angle's unit"
            " in the source file"
        )
    # a bench loses some of one
    for size in sorted((run.amplitude for run in others), reverse=True):
        own += [float(np.deg2rad(round(np.rad2deg(size), 1)))] * (followed(size, own, 0.25) is None)
    meant = [
        (run, amplitude or followed(run.amplitude, own, 0.25)) for run, amplitude in followed_by
    ]
    return [(run, amplitude) for run, amplitude in meant if amplitude is not None]


def common_frequencies(found: Sequence[Run], protocol: SteppedSineProtocol) -> list[float]:
    """The frequency [Hz] of each run, one for all runs that agree to 0.1 %. It is the commanded
    one, or a round one if no protocol is stated, provided that no run slips against it by 0.2 % of
    a cycle. Else it is their mean, as when the clock of the bench is off."""
    frequencies = []
    for run in found:
        alike = [other for other in found if abs(other.frequency_hz / run.frequency_hz - 1) < 1e-3]
        mean = float(
            np.average([r.frequency_hz for r in alike], weights=[r.cycles**2 for r in alike])
        )
        commanded = protocol.frequency_near(mean) or float(f"{mean:.3g}")
        slip = abs(mean / commanded - 1) * max(r.cycles for r in alike)
        frequencies.append(float(commanded) if slip < 2e-3 else float(f"{mean:.6g}"))
    return frequencies


def unit_sines(sines: Sequence[tuple[float, float]], rate: float) -> Array:
    """Sines of unit amplitude, one after the other: frequency [Hz] and number of cycles of each, at
    `rate` [Hz]."""
    pieces = [
        np.sin(2 * np.pi * f * np.arange(round(cycles / f * rate)) / rate) for f, cycles in sines
    ]
    return np.concatenate(pieces)


BIN_S = 0.25  # time [s] within which a moving joint turns measurably
MOVING_SHARE = 0.02  # smallest share of its range by which it then turns
HARDLY = 0.25  # share of sines in the moving time: below, no stepped sine; above 0.5, one


@dataclass(frozen=True)
class Likeness:
    recorded: Array  # uniform times (n,) [s]
    theta: Array  # joint angle (n,) [rad]
    protocol: SteppedSineProtocol  # what was commanded

    @cached_property
    def time(self) -> Array:
        return np.asarray(self.recorded - self.recorded[0])

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        return moving_bins(self.time, self.theta)

    @property
    def moves(self) -> bool:
        return bool(self.moving.any())

    @cached_property
    def crossings(self) -> Array:
        """Times [s] at which the angle rises through its centre."""
        return upward_crossings(self.time, self.theta)

    @cached_property
    def runs(self) -> list[Run]:
        """Runs of three cycles, since fewer may be a transient, or of as few as were commanded."""
        return find_runs(
            self.time,
            self.theta,
            self.crossings,
            min(3, int(min(self.protocol.cycles_at, default=3))),
        )

    @cached_property
    def sines(self) -> float:
        """Share of the moving time in commanded runs, and in pure sines, whose misfit is at most
        0.08 of their RMS; a triangle's is 0.12."""
        inside = np.zeros_like(self.moving)
        for run in self.runs:
            commanded = self.protocol.frequency_near(
                run.frequency_hz
            ) and self.protocol.amplitude_near(run.amplitude)
            if self.is_steady(run) and (
                commanded or run.misfit < 0.08 * run.amplitude / np.sqrt(2)
            ):
                inside[slice(*np.searchsorted(self.time, (run.start, run.stop)))] = True
        return float(
            np.count_nonzero(inside & self.moving) / max(int(np.count_nonzero(self.moving)), 1)
        )

    def is_steady(self, run: Run) -> bool:
        """Whether both halves of a run agree in frequency to 1 %; those of a sweep do not."""
        margin = 0.1 / run.frequency_hz
        own = self.crossings[
            (self.crossings > run.start - margin) & (self.crossings < run.stop + margin)
        ]
        middle = len(own) // 2
        if middle < 2:
            return True
        periods = (own[middle] - own[0]) / middle, (own[-1] - own[middle]) / (len(own) - 1 - middle)
        return bool(max(periods) / min(periods) - 1 < 0.01)

    def one_line(self) -> float:
        """Power at one commanded frequency at a time, as a share of that in their band: the mean
        over pieces of 4 s of the largest share. 0 if fewer than 0.6 of the commanded frequencies
        have a share above 0.6 in some piece."""
        time, theta, commanded = self.time, self.theta, np.unique(self.protocol.frequencies_hz)
        if not commanded.size:
            return 0.0
        rate = (len(time) - 1) / float(time[-1])
        n = round(4.0 * rate)
        f = np.fft.rfftfreq(n, 1 / rate)
        band = (f >= 0.6 * commanded[0]) & (f <= 1.5 * commanded[-1])
        near = np.abs(f[:, None] - commanded) <= np.maximum(0.05 * commanded, 1.01 / 4.0)
        shares, most = [], MOVING_SHARE * float(np.ptp(theta))
        for start in range(0, len(theta) - n + 1, n // 2):
            piece = theta[start : start + n]
            power = np.abs(np.fft.rfft(np.hanning(n) * (piece - piece.mean()))) ** 2
            if np.ptp(piece) > most and power[band].sum() > 0:
                shares.append((power[:, None] * near).sum(axis=0) / power[band].sum())
        if not shares or np.count_nonzero((np.array(shares) > 0.6).any(axis=0)) < 0.6 * len(
            commanded
        ):
            return 0.0
        return float(np.max(shares, axis=1).mean())

    @property
    def kind(self) -> Literal["stepped sine", "unclear", "other"]:
        """`stepped sine`; `unclear` if a part has sines or commanded frequencies, or if nothing
        moves; else `other`. A stepped sine has 0.87 or more of one line, even with spikes, hum and
        a wandering angle; a sweep has 0.8."""
        if self.sines > 0.5:
            return "stepped sine"
        return (
            "unclear"
            if not self.moves or self.sines > HARDLY or self.one_line() > 0.85
            else "other"
        )


def moving_bins(time: Array, theta: Array) -> NDArray[np.bool_]:
    """Rows (n,) of a joint angle theta [rad] at times [s] in which the joint moves, in bins of
    `BIN_S`. A bin with only rounding or noise of a sensor at rest does not count."""
    bins = np.floor((time - time[0]) / BIN_S)
    first = np.flatnonzero(np.concatenate([[True], bins[1:] != bins[:-1]]))
    turn = np.maximum.reduceat(theta, first) - np.minimum.reduceat(theta, first)
    moves = turn > max(MOVING_SHARE * float(np.ptp(theta)), 12 * noise_of(theta))
    return np.asarray(np.repeat(moves, np.diff(np.append(first, len(theta)))))
