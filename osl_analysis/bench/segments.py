"""The segments of a stepped sine that the fits use: what the joint really did, in whole cycles."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.protocol.likeness import Likeness
from osl_analysis.protocol.runs import Run, SteppedSineProtocol
from osl_analysis.signals import longest_run, runs, sampling_rate
from osl_analysis.stats.covariance import FEWEST_CYCLES, Cycles
from osl_analysis.stats.sinusoid import waves
from osl_analysis.timebase.grid import BRIDGE_MORE
from osl_analysis.trial import Array

SAME_FREQUENCY = 1e-3  # relative difference of frequencies that are one
SAME_PHASE = 2e-3  # part of a cycle by which a run may slip against a frequency that is taken for its own
TOUCHING = 0.3  # largest part of a cycle between two runs that follow one another without a rest
WHOLE, UPWARD = 0.15, 0.5
"""Deviation of a run from whole cycles, and of its phase [rad] at its start from 0, with which it is a plain sine."""


@dataclass(frozen=True)
class Segment:
    """Whole cycles of one amplitude at one frequency. Rows are counted in the record; they need not be whole."""

    amplitude: float  # commanded amplitude [rad]
    frequency_hz: float  # frequency [Hz], the commanded one where the recorded one cannot be told from it
    start: float  # row at which the first cycle begins
    stop: float  # row at which the last one ends
    cycles: int  # number of cycles in between
    excluded_cycles: frozenset[int] = frozenset()
    """Cycles, counted from 0, that are not used: they contain rows without a measurement."""

    @property
    def amplitude_deg(self) -> float:
        """Commanded amplitude [deg] as tables show it: 6 and not 6.000000000000001."""
        return round(float(np.rad2deg(self.amplitude)), 9)

    @cached_property
    def edges(self) -> Array:
        """Where each cycle begins and the last one ends, shape (cycles + 1,). The first edge is a whole row.

        The others are not rounded: a cycle with a fraction of a row too many has a mean, and products of sine and
        cosine, that no other cycle has. At 250 Hz and 3 Hz the stated error of B was 5.8 times too large.
        """
        period = (self.stop - self.start) / self.cycles
        return np.asarray(np.rint(self.start) + period * np.arange(self.cycles + 1))

    @cached_property
    def used(self) -> NDArray[np.intp]:
        return np.array([k for k in range(self.cycles) if k not in self.excluded_cycles], dtype=np.intp)

    @cached_property
    def pieces(self) -> tuple[slice, ...]:
        """Rows of each stretch of consecutive cycles that are used."""
        used, edges = np.isin(np.arange(self.cycles), self.used), self.edges
        return tuple(whole_rows(edges[run.start], edges[run.stop]) for run in runs(used))

    @property
    def rows(self) -> NDArray[np.intp]:
        return np.concatenate([np.r_[piece] for piece in self.pieces])

    @cached_property
    def size(self) -> int:
        return sum(piece.stop - piece.start for piece in self.pieces)

    @cached_property
    def repeated(self) -> Cycles | None:
        """Its cycles among `rows`; None if it has fewer than five."""
        return repeated_cycles([self])

    def part(self, signal: Array) -> Array:
        """A signal (n,) in these rows; a view where they follow one another."""
        parts = [signal[piece] for piece in self.pieces]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


def whole_rows(start: float, stop: float) -> slice:
    """The rows that lie between two edges at least in part, but for errors of rounding."""
    return slice(int(np.floor(start + 1e-6)), int(np.ceil(stop - 1e-6)))


@dataclass(frozen=True)
class Block:
    """The segments of one amplitude."""

    amplitude: float  # commanded amplitude [rad]
    segments: tuple[Segment, ...]  # one segment per run of this amplitude, in the order of time

    @property
    def amplitude_deg(self) -> float:
        """Commanded amplitude [deg] as tables show it."""
        return self.segments[0].amplitude_deg

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Rows of each stretch of segments that touch, transients and gaps included, in the order of time. A rest lies
        between two stretches, or segments of another amplitude, where the protocol goes through all amplitudes at one
        frequency before it goes to the next."""
        ends = [(int(np.rint(s.start)), int(np.rint(s.stop))) for s in self.segments]
        first = [start for k, (start, _) in enumerate(ends) if k == 0 or start > ends[k - 1][1] + 1]
        last = [stop for k, (_, stop) in enumerate(ends) if k + 1 == len(ends) or ends[k + 1][0] > stop + 1]
        return tuple(slice(a, b) for a, b in zip(first, last, strict=True))


def settled(
    blocks: Sequence[Block], settle_cycles: int, usable: NDArray[np.bool_] | None = None
) -> tuple[Segment, ...]:
    """All segments without their first `settle_cycles` cycles and without their last one; one cycle at least is kept.
    The first cycles still contain the transient. Into the last one the zero-phase filter smears the beginning of the
    next frequency. Cycles with a row that is not `usable` (n,) are not fitted."""
    segments = (s for block in blocks for s in block.segments)
    trimmed = (trimmed_segment(s, min(settle_cycles, s.cycles - 1), 1) for s in segments)
    return tuple(trimmed) if usable is None or usable.all() else tuple(without_gaps(s, usable) for s in trimmed)


def trimmed_segment(segment: Segment, before: int, after: int) -> Segment:
    """The segment without its first `before` and, where more than one cycle is left, its last `after` cycles."""
    after = min(after, segment.cycles - before - 1)
    period = (segment.stop - segment.start) / segment.cycles
    kept = segment.cycles - before - after
    start = segment.start + before * period
    return replace(segment, start=start, stop=start + kept * period, cycles=kept)


def without_gaps(segment: Segment, usable: NDArray[np.bool_]) -> Segment:
    """The segment without the cycles in which a row is not usable (n,); raises as `settled`. Of the stretches between,
    those with too few cycles for an interval are not used where there is a longer one."""
    whole = np.array([bool(usable[whole_rows(a, b)].all()) for a, b in pairwise(segment.edges)])
    if not whole.any():
        raise InputError(
            f"no cycle of {segment.amplitude_deg:g} deg at {segment.frequency_hz:g} Hz is free of rows near a gap that "
            f"is too long to be bridged; {BRIDGE_MORE}"
        )
    longest = longest_run(whole)
    fewest = min(longest.stop - longest.start, FEWEST_CYCLES)
    used = {k for run in runs(whole) if run.stop - run.start >= fewest for k in range(run.start, run.stop)}
    return replace(segment, excluded_cycles=frozenset(range(segment.cycles)) - used)


def rows_of(segments: Sequence[Segment]) -> NDArray[np.intp]:
    return np.concatenate([segment.rows for segment in segments])


def repeated_cycles(segments: Sequence[Segment]) -> Cycles | None:
    """The `cycles_among` the rows of the segments; None if a segment has fewer than five."""
    return cycles_among(segments) if min(len(segment.used) for segment in segments) >= FEWEST_CYCLES else None


def cycles_among(segments: Sequence[Segment]) -> Cycles:
    """The cycles among the rows of the segments (`rows_of`)."""
    first, stop, offset = [], [], 0
    for segment in segments:
        edges = segment.edges
        for piece in segment.pieces:
            rows = piece.stop - piece.start
            inside = [k for k in segment.used if piece.start - 1 < edges[k] and edges[k + 1] < piece.stop + 1]
            places = np.clip(edges[[*inside, inside[-1] + 1]] - piece.start, 0, rows)
            first.append(offset + places[:-1])
            stop.append(offset + places[1:])
            offset += rows
    stratum = np.repeat(np.arange(len(segments)), [len(segment.used) for segment in segments])
    return Cycles(np.concatenate(first), np.concatenate(stop), stratum)


def find_blocks(
    time: Array, theta: Array, protocol: SteppedSineProtocol, known: Sequence[Run] | None = None
) -> tuple[Block, ...]:
    """The blocks of a joint angle theta [rad] at uniform times [s], shape (n,) each: what the joint really did.

    `known` are the runs of its `likeness`, where they are known already.

    Frequencies, their order, rests, ramps and numbers of cycles are as recorded. The protocol says which amplitudes
    are meant. A run of another amplitude is not used if all of the commanded ones were recorded.
    """
    rate = sampling_rate(time)
    found = Likeness(time, theta, protocol).runs if known is None else known
    check_amplitudes(theta, found, protocol, float(time[0]))
    followed = [(run, a) for run in found if (a := protocol.amplitude_near(run.amplitude)) is not None]
    frequencies = common_frequencies([run for run, _ in followed], protocol)
    segments = [
        Segment(amplitude, frequency, *placed(run, frequency, rate), run.whole_cycles)
        for (run, amplitude), frequency in zip(followed, frequencies, strict=True)
    ]
    deviation = theta - np.mean(theta)
    aligned: list[Segment] = []
    for group in without_a_rest([run for run, _ in followed], segments):
        plain = all(is_plain(run) for run, _ in group)
        alike = [segment for _, segment in group]
        aligned += shifted(alike, best_start(deviation, alike, rate)) if plain else alike
    amplitudes = dict.fromkeys(segment.amplitude for segment in aligned)
    return tuple(Block(a, tuple(s for s in aligned if s.amplitude == a)) for a in amplitudes)


def check_amplitudes(theta: Array, found: Sequence[Run], protocol: SteppedSineProtocol, begin: float) -> None:
    """Refuse an angle (n,) [rad] without a sine, and runs of another amplitude than a commanded one. `begin` is the
    time [s] of the first row."""
    commanded = ", ".join(f"{np.rad2deg(a):g}" for a in protocol.amplitudes)
    if not found:
        raise InputError(
            f"no sine was found: the joint angle moves by {np.rad2deg(np.ptp(theta)):.3g} deg in all, the protocol "
            f"says sines of {commanded} deg; check the channel and the unit of theta in the source file, and that "
            "the trial is a stepped sine"
        )
    others = [run for run in found if protocol.amplitude_near(run.amplitude) is None]
    recorded = {protocol.amplitude_near(run.amplitude) for run in found}
    if others and any(amplitude not in recorded for amplitude in protocol.amplitudes):
        run = others[0]
        raise InputError(
            f"the sine of {run.frequency_hz:.4g} Hz at {run.start + begin:.1f} s has an amplitude of "
            f"{run.amplitude_deg:.2f} deg, the protocol says {commanded} deg; correct `amplitudes_deg` in the "
            "configuration, or the angle's unit in the source file"
        )


def common_frequencies(found: Sequence[Run], protocol: SteppedSineProtocol) -> list[float]:
    """The frequency [Hz] of each run, the same for all runs that are alike.

    It is the commanded one where none of them slips against it, else the mean of those found: where the clock of the
    bench is off, the recorded frequency counts.
    """
    frequencies = []
    for run in found:
        alike = [other for other in found if abs(other.frequency_hz / run.frequency_hz - 1) < SAME_FREQUENCY]
        mean = float(np.average([r.frequency_hz for r in alike], weights=[r.cycles**2 for r in alike]))
        commanded = protocol.frequency_near(mean)
        slip = np.inf if commanded is None else abs(mean / commanded - 1) * max(r.cycles for r in alike)
        frequencies.append(float(commanded) if commanded is not None and slip < SAME_PHASE else float(f"{mean:.6g}"))
    return frequencies


def placed(run: Run, frequency_hz: float, rate: float) -> tuple[float, float]:
    """First and last edge, in rows at `rate` [Hz], of the whole cycles of a run, in the middle of the run."""
    length = run.whole_cycles / frequency_hz
    start = max((run.start + run.stop - length) / 2, 0.0)
    return start * rate, (start + length) * rate


def is_plain(run: Run) -> bool:
    """Whether a run is whole cycles of a sine that begins at its centre and rises."""
    return abs(run.cycles - run.whole_cycles) < WHOLE and abs(run.phase_at(run.start)) < UPWARD


def without_a_rest(found: Sequence[Run], segments: Sequence[Segment]) -> list[list[tuple[Run, Segment]]]:
    """Runs of one amplitude, with their segments, that follow one another without a rest, group by group."""
    pairs = list(zip(found, segments, strict=True))
    groups = [pairs[:1]]
    for (run, segment), (following, its) in pairwise(pairs):
        gap = (following.start - run.stop) * max(run.frequency_hz, following.frequency_hz)
        if gap < TOUCHING and segment.amplitude == its.amplitude:
            groups[-1].append((following, its))
        else:
            groups.append([(following, its)])
    return groups


def best_start(theta: Array, group: Sequence[Segment], rate: float) -> float:
    """Row at which a group of plain sines begins: there the angle (n,) [rad] agrees best with them."""
    template = unit_sines([(s.frequency_hz, s.cycles) for s in group], rate)
    reach = int(rate / max(s.frequency_hz for s in group) / 2)
    low = max(round(group[0].start) - reach, 0)
    near = theta[low : round(group[0].start) + reach + len(template)]
    if len(near) < len(template):
        return group[0].start
    return float(low + np.argmax(np.correlate(near, template, "valid")))


def shifted(group: Sequence[Segment], start: float) -> list[Segment]:
    """The segments of a group, one after the other from row `start` on."""
    lengths = [segment.stop - segment.start for segment in group]
    edges = start + np.cumsum([0.0, *lengths])
    return [replace(s, start=float(a), stop=float(b)) for s, a, b in zip(group, edges, edges[1:], strict=False)]


def unit_sines(sines: Sequence[tuple[float, float]], rate: float) -> Array:
    """Sines of unit amplitude, one after the other: frequency [Hz] and number of cycles of each, at `rate` [Hz]."""
    pieces = [waves(np.arange(round(cycles / f * rate)) / rate, f)[1] for f, cycles in sines]
    return np.concatenate(pieces)
