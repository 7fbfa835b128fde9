"""Segments and blocks of a stepped sine, their cycles and rows, without transients and gaps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.signals import longest_run, runs
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.stats.cycle_sums import Cycles
from osl_analysis.timebase.gaps import BRIDGE_MORE
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Segment:
    """Whole cycles of one amplitude at one frequency. Rows are counted in the record; they need not be whole."""

    amplitude: float
    """Commanded amplitude [rad]."""
    frequency_hz: float
    """Frequency [Hz], the commanded one where the recorded one cannot be told from it."""
    start: float
    """Row at which the first cycle begins."""
    stop: float
    """Row at which the last one ends."""
    cycles: int
    """Number of cycles in between."""
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
        """Numbers of the cycles that are used."""
        return np.array([k for k in range(self.cycles) if k not in self.excluded_cycles], dtype=np.intp)

    @cached_property
    def pieces(self) -> tuple[slice, ...]:
        """Rows of each stretch of consecutive cycles that are used."""
        used, edges = np.isin(np.arange(self.cycles), self.used), self.edges
        return tuple(whole_rows(edges[run.start], edges[run.stop]) for run in runs(used))

    @property
    def rows(self) -> NDArray[np.intp]:
        """The rows of the cycles that are used."""
        return np.concatenate([np.r_[piece] for piece in self.pieces])

    @cached_property
    def size(self) -> int:
        """Number of these rows."""
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

    amplitude: float
    """Commanded amplitude [rad]."""
    segments: tuple[Segment, ...]
    """One segment per run of this amplitude, in the order of time."""

    @property
    def amplitude_deg(self) -> float:
        """Commanded amplitude [deg] as tables show it."""
        return self.segments[0].amplitude_deg

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Rows of each stretch of segments that touch, transients and gaps included, in the order of time.

        A rest lies between two stretches, or segments of another amplitude, where the protocol goes through all
        amplitudes at one frequency before it goes to the next.
        """
        ends = [(int(np.rint(s.start)), int(np.rint(s.stop))) for s in self.segments]
        first = [start for k, (start, _) in enumerate(ends) if k == 0 or start > ends[k - 1][1] + 1]
        last = [stop for k, (_, stop) in enumerate(ends) if k + 1 == len(ends) or ends[k + 1][0] > stop + 1]
        return tuple(slice(a, b) for a, b in zip(first, last, strict=True))


def settled(
    blocks: Sequence[Block], settle_cycles: int, usable: NDArray[np.bool_] | None = None
) -> tuple[Segment, ...]:
    """All segments without their first `settle_cycles` cycles and without their last one; one cycle at least is kept.

    The first cycles still contain the transient. Into the last one the zero-phase filter smears the beginning of the
    next frequency. Cycles with a row that is not `usable` (n,) are not fitted.

    Raises
    ------
    InputError
        No cycle of an amplitude at one frequency is usable.
    """
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
    """The segment without the cycles in which a row is not usable (n,); raises as `settled`.

    Of the stretches between, those with too few cycles for an interval are not used where there is a longer one.
    """
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
    """Rows of the segments, one after the other."""
    return np.concatenate([segment.rows for segment in segments])


def repeated_cycles(segments: Sequence[Segment], every: int = 1, skip: int = 0) -> Cycles | None:
    """The `cycles_among` the rows of the segments; None if a segment has fewer than five."""
    enough = min(len(segment.used) for segment in segments) >= FEWEST_CYCLES
    return cycles_among(segments, every, skip) if enough else None


def cycles_among(segments: Sequence[Segment], every: int = 1, skip: int = 0) -> Cycles:
    """The cycles among the rows of the segments (`rows_of`).

    Of each piece of a segment only every `every`-th row counts, and of these not the first `skip`. This serves signals
    that were thinned and then lost samples at the start to a filter.
    """
    first, stop, offset = [], [], 0
    for segment in segments:
        edges = segment.edges
        for piece in segment.pieces:
            kept = -(-(piece.stop - piece.start) // every) - skip
            inside = [k for k in segment.used if piece.start - 1 < edges[k] and edges[k + 1] < piece.stop + 1]
            places = np.clip((edges[[*inside, inside[-1] + 1]] - piece.start) / every - skip, 0, kept)
            first.append(offset + places[:-1])
            stop.append(offset + places[1:])
            offset += kept
    stratum = np.repeat(np.arange(len(segments)), [len(segment.used) for segment in segments])
    return Cycles(np.concatenate(first), np.concatenate(stop), stratum)
