"""One uniform grid for all streams of a trial. Filter, differentiate and fit only what stands on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.pieces import pieces
from osl_analysis.timebase.cubic import cubic_between
from osl_analysis.timebase.gaps import BRIDGE_MORE, GapLimits, gaps_of, usable_rows
from osl_analysis.timebase.report import TimebaseReport, report_of
from osl_analysis.timebase.samples import Samples, Taken, take
from osl_analysis.timebase.stream import FEWEST_SAMPLES, Stream
from osl_analysis.trial import Array

ON_GRID = 1e-6
"""Distance, in steps, at which a sample counts as lying on the grid."""
ROUNDED = 1e6
"""Rows of a grid from which that distance grows with their number: a step is known to 1e-13 of itself."""


@dataclass(frozen=True)
class UniformGrid:
    """Signals of all streams at uniform times.

    time: (m,) [s]. rate_hz: [Hz]. signals: name -> (m,), in the units of the streams, without the silent ones.
    usable: (m,) false where a row lies in or near a marked gap. Filter and differentiate all rows, then drop these.
    report: what was done, for provenance.
    """

    time: Array
    rate_hz: float
    signals: Mapping[str, Array]
    usable: NDArray[np.bool_]
    report: TimebaseReport
    taken: tuple[Taken, ...]
    limits: GapLimits

    def silent(self, name: str) -> Array | None:
        """A signal (m,) that says nothing about the stamps, as a command: brought on the grid when it is asked for."""
        part = next((t for t in self.taken if name in t.stream.silent and name in t.stream.signals), None)
        return None if part is None else resampled(Nearest(part.samples(name), self.usable), self.time)[0]

    def other_hypothesis(self, *, firm_too: bool = False) -> "UniformGrid | None":
        """The grid with every undecided stream taken the other way: true stamps as even, even ones as true.

        None where no stream is undecided. The difference of the two fits is what the missing decision costs. With
        `firm_too` the streams that the signals decided are also taken the other way.
        """
        turned = [t.decision.matters and (firm_too or not t.decision.firm) for t in self.taken]
        if not any(turned):
            return None
        return on_one_grid([t.other() if turn else t for t, turn in zip(self.taken, turned, strict=True)], self.limits)


def one_time_base(streams: Sequence[Stream], limits: GapLimits | None = None) -> UniformGrid:
    """All signals of a trial on one uniform grid at the fastest stream's rate, over what all streams cover.

    True stamps: cubic spline through the samples at their stamps. Even device: the same at the times of its own clock;
    where these are the grid, the samples themselves. Nothing is extrapolated.

    Raises
    ------
    InputError
        As `Stream` and `take`; the streams do not overlap; a gap is too long; no row is usable.
    """
    return on_one_grid(take(streams), limits or GapLimits())


def on_one_grid(taken: Sequence[Taken], limits: GapLimits) -> UniformGrid:
    """The grid for streams whose decisions stand."""
    parts = [t.samples() for t in taken]
    first, last, step = overlap(parts)
    gaps = [gaps_of(part, first, last, limits) for part in parts]
    time, rate = step * np.arange(whole_steps(first, last, step) + 1, dtype=np.float64), 1 / step
    time += first
    usable = usable_rows(time, np.concatenate([g.marked for g in gaps]), limits.margin_s)
    if not usable.any():
        raise InputError(
            f"{parts[0].name}: every row from {round(time[0], 4) + 0.0:.4f} s to "
            f"{time[-1]:.4f} s lies within {limits.margin_s:.2f} s of a gap longer than "
            f"{limits.bridged_s * 1e3:g} ms; {BRIDGE_MORE}"
        )
    nearest = [Nearest(part, usable) for part in parts]
    signals = {
        name: values for one in nearest for name, values in zip(one.samples.names, resampled(one, time), strict=True)
    }
    report = report_of(parts, gaps, time, usable, max(one.farthest for one in nearest), limits)
    return UniformGrid(time, rate, signals, usable, report, tuple(taken), limits)


def overlap(parts: Sequence[Samples]) -> tuple[float, float, float]:
    """First and last time [s] that all streams cover, and the step [s] of the fastest of them."""
    late = max(parts, key=lambda part: part.times[0])
    early = min(parts, key=lambda part: part.times[-1])
    first, last, step = float(late.times[0]), float(early.times[-1]), min(part.step for part in parts)
    rows = whole_steps(first, last, step) + 1
    if rows < FEWEST_SAMPLES:
        raise InputError(
            f"{late.name} begins at {first:.4f} s and {early.name} ends at {last:.4f} s: they "
            f"overlap in {max(rows, 0)} rows, at least {FEWEST_SAMPLES} are needed; "
            "check that both clocks count from the same time"
        )
    return first, last, step


def whole_steps(first: float, last: float, step: float) -> int:
    """Steps [s] between two times [s]; a last one that rounding shortened counts."""
    return int(np.floor((last - first) / step + ON_GRID))


@dataclass
class Nearest:
    """The samples before and behind the rows of a grid, which are asked for in their order."""

    samples: Samples
    usable: NDArray[np.bool_]
    """Usable rows (m,) of the grid."""
    row: int = 0
    """The first row that was not yet asked for."""
    farthest: float = 0.0
    """Largest distance [s] of a usable row so far to the nearest sample."""

    def measure(self, distance: Array) -> None:
        """Note the distances (k,) [s] of the next rows to their nearest samples."""
        near = np.where(self.usable[self.row : self.row + len(distance)], distance, 0.0)
        self.farthest, self.row = max(self.farthest, float(near.max())), self.row + len(distance)


def resampled(nearest: Nearest, time: Array) -> Sequence[Array]:
    """Values (m,) of each signal at the grid's times (m,) [s]: the samples where they lie on it, else a cubic."""
    part = nearest.samples
    rows = rows_on_grid(part, time)
    if rows is None:
        return cubic_between(part.times, part.values, time, part.before, nearest.measure)
    for piece in pieces(len(time)):
        nearest.measure(np.abs(part.times[rows][piece] - time[piece]))
    return [values[rows] for values in part.values]


def rows_on_grid(part: Samples, time: Array) -> slice | None:
    """The samples that are the rows of a grid with times (m,) [s]; None where they do not lie on it."""
    row = int(np.searchsorted(part.times, time[0] - ON_GRID * part.step))
    there = part.times[row : row + len(time)]
    apart = ON_GRID * part.step * max(len(time) / ROUNDED, 1.0)  # the rounding of a step adds up
    if len(there) < len(time) or any(np.max(np.abs(there[r] - time[r])) >= apart for r in pieces(len(time))):
        return None
    return slice(row, row + len(time))
