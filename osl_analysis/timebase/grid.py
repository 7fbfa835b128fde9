"""One uniform grid for all streams of a trial. Filter, differentiate and fit only what stands on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
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
    signals = {name: values for part in parts for name, values in zip(part.names, resampled(part, time), strict=True)}
    farthest = max(float(distances(part.times, time[usable]).max()) for part in parts)
    report = report_of(parts, gaps, time, usable, farthest, limits)
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


def distances(times: Array, at: Array) -> Array:
    """Distance [s] of each of some times (m,) [s] to the nearest of rising times (k,) [s]."""
    behind = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    return np.asarray(np.minimum(np.abs(at - times[behind - 1]), np.abs(times[behind] - at)))


def resampled(part: Samples, time: Array) -> Sequence[Array]:
    """Values (m,) of each signal at the grid's times (m,) [s]: the samples where they lie on it, else a cubic spline.

    Nothing is extrapolated: a last row that rounding put behind the last sample has its value.
    """
    rows = rows_on_grid(part, time)
    if rows is not None:
        return [values[rows] for values in part.values]
    spline = scipy.interpolate.CubicSpline(part.times, np.array(part.values), axis=1)
    return list(spline(np.clip(time, part.times[0], part.times[-1])))


def rows_on_grid(part: Samples, time: Array) -> slice | None:
    """The samples that are the rows of a grid with times (m,) [s]; None where they do not lie on it."""
    row = int(np.searchsorted(part.times, time[0] - ON_GRID * part.step))
    there = part.times[row : row + len(time)]
    apart = ON_GRID * part.step * max(len(time) / ROUNDED, 1.0)  # the rounding of a step adds up
    if len(there) < len(time) or np.max(np.abs(there - time)) >= apart:
        return None
    return slice(row, row + len(time))
