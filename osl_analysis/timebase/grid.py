"""One uniform grid for all streams of a trial, with the report of what was done.

Filter, differentiate and fit only what stands on it. Short gaps are bridged, longer ones marked so that fits leave
their rows out, long ones refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.timebase.counting import LONG_STEP
from osl_analysis.timebase.samples import Samples, Taken, take
from osl_analysis.timebase.stream import FEWEST_SAMPLES, Stream
from osl_analysis.trial import Array

BRIDGE_MORE = (
    "record again with fewer lost samples, or lower time_base.highest_hz, which bridges gaps up to 0.1/highest_hz: "
    "50 ms bridged in every cycle change I by about 1 %"
)
"""What the user may do where gaps leave nothing to fit."""
ROUNDING = 0.1  # steps by which jitter may lengthen a gap that is still bridged


@dataclass(frozen=True)
class GapLimits:
    """Which gaps do what.

    highest_hz: [Hz] fastest motion that the fits use.
    cutoff_hz: [Hz] of the filter that the signals pass afterwards.
    longest_s: [s] longest gap that is not refused.

    A gap is as long as its missing samples: 20 of them at 1 kHz are 20 ms, and the samples beside it lie 21 ms apart.
    """

    highest_hz: float = 5.0
    cutoff_hz: float = 15.0
    longest_s: float = 0.5

    @property
    def bridged_s(self) -> float:
        """Longest gap [s] that counts as data: a tenth of a period, of which the cubic loses 5e-4."""
        return 0.1 / self.highest_hz

    @property
    def margin_s(self) -> float:
        """Rows [s] to either side of a marked gap that the filter fills from it."""
        return 3 / self.cutoff_hz


@dataclass(frozen=True)
class Gaps:
    """Gaps of one stream within the overlap, bridged and marked ones: begin and end of each, (gaps, 2) [s]."""

    bridged: Array
    marked: Array

    @property
    def longest_bridged(self) -> float:
        """Length [s] of the longest bridged gap; 0 where there is none."""
        return float(np.max(self.bridged[:, 1] - self.bridged[:, 0], initial=0.0))


def gaps_of(samples: Samples, first: float, last: float, limits: GapLimits) -> Gaps:
    """Gaps of a stream between two times [s]."""
    times = samples.times
    row = np.flatnonzero(np.diff(times) > LONG_STEP * samples.step)
    ends = np.stack([times[row], times[row + 1]], axis=1)
    ends = ends[(ends[:, 1] > first) & (ends[:, 0] < last)]
    length = ends[:, 1] - ends[:, 0] - (1 + ROUNDING) * samples.step
    if (length > limits.longest_s).any():
        refuse_gap(samples, ends[np.argmax(length)], limits)
    return Gaps(ends[length <= limits.bridged_s], ends[length > limits.bridged_s])


def refuse_gap(samples: Samples, ends: Array, limits: GapLimits) -> None:
    """Say where a stream lacks data for too long."""
    names = ", ".join(samples.taken.decision.signals)
    raise InputError(
        f"{samples.name}: {names} has no sample from {ends[0]:.4f} s to {ends[1]:.4f} s, "
        f"{ends[1] - ends[0]:.3f} s long; "
        f"gaps up to {limits.longest_s:g} s are bridged: cut the log there, or see whether the recorder's clock jumped"
    )


def usable_rows(time: Array, marked: Array, margin: float) -> NDArray[np.bool_]:
    """Rows of a rising time (m,) [s] that lie outside all marked gaps (gaps, 2) [s] and their margins [s]."""
    first = np.searchsorted(time, marked[:, 0] - margin, side="left")
    last = np.searchsorted(time, marked[:, 1] + margin, side="right")
    usable = np.ones(len(time), dtype=bool)
    for start, stop in zip(first, last, strict=True):
        usable[start:stop] = False
    return usable


NOMINALLY_EQUAL = 1e-3  # difference of two rates below which it is the clocks' and not the devices' intention


@dataclass(frozen=True)
class StreamReport:
    """What was found and done in one stream.

    name, signals: the stream and its signals.
    rate_hz: [Hz] samples per second by the line through its stamps.
    ppm: rate against that of the fastest stream where the two are nominally equal (within 0.1 %), else None.
    even: the device was taken to sample evenly; else its stamps were taken as true.
    firm: stated or seen in the signals; else the other hypothesis may be right.
    why: the decision in words.
    g, g_se: signal -> slope of the sixth differences (1 true, 0 even) and its standard error, where it was sought;
        the error is None where the signal says nothing.
    residual_sd_s, wander_s, skew: residual of the stamps to the line: SD [s], SD of its slow part [s], skewness.
    missing, empty: samples that the device took and the log lacks; rows of the log in which these signals lack a value.
    repeated, merged: rows written twice; samples averaged.
    bridged, marked: gaps filled as data; gaps whose rows are not usable.
    interpolation: how values came to the grid.
    delay_s: stated delay [s] of the samples, which was taken out.
    error: largest error of a sine at the fastest motion, as a share of its amplitude.
    bridge_error: the same within the longest bridged gap.
    """

    name: str
    signals: tuple[str, ...]
    rate_hz: float
    ppm: float | None
    even: bool
    firm: bool
    why: str
    g: Mapping[str, float]
    g_se: Mapping[str, float | None]
    residual_sd_s: float
    wander_s: float
    skew: float
    missing: int
    empty: int
    repeated: int
    merged: int
    bridged: int
    marked: int
    interpolation: str
    delay_s: float
    error: float
    bridge_error: float


@dataclass(frozen=True)
class TimebaseReport:
    """The grid and its streams.

    rate_hz: [Hz]. first_s, last_s: [s] the overlap. rows, masked: rows of the grid, rows that are not usable.
    farthest_s: [s] largest distance of a usable row to the nearest sample of any stream.
    highest_hz: [Hz] the motion for which the errors of the interpolation are stated.
    """

    rate_hz: float
    first_s: float
    last_s: float
    rows: int
    masked: int
    farthest_s: float
    highest_hz: float
    streams: tuple[StreamReport, ...]

    @property
    def firm(self) -> bool:
        """No decision is open."""
        return all(stream.firm for stream in self.streams)

    def provenance(self) -> dict[str, Any]:
        """Plain numbers, words and lists, fit for JSON."""
        return asdict(self) | {"streams": [asdict(stream) for stream in self.streams]}


def cubic_error(frequency_hz: float, step: float) -> float:
    """Largest error of a cubic through a sine sampled at `step` [s], as a share of its amplitude: (2 pi f h)^4 / 384.
    2.5e-5 of 5 Hz at 100 Hz. The same holds within a single gap of length `step`."""
    return float((2 * np.pi * frequency_hz * step) ** 4 / 384)


def report_of(
    parts: Sequence[Samples],
    gaps: Sequence[Gaps],
    time: Array,
    usable: NDArray[np.bool_],
    farthest: float,
    limits: GapLimits,
) -> TimebaseReport:
    """Everything that provenance states about the grid with times (m,) [s], its rows `farthest` [s] from a sample."""
    rate = (len(time) - 1) / float(time[-1] - time[0])
    streams = tuple(stream_report(part, found, rate, limits) for part, found in zip(parts, gaps, strict=True))
    masked = int(np.count_nonzero(~usable))
    return TimebaseReport(
        rate, float(time[0]), float(time[-1]), len(time), masked, farthest, limits.highest_hz, streams
    )


def stream_report(part: Samples, gaps: Gaps, rate_hz: float, limits: GapLimits) -> StreamReport:
    """What was found and done in one stream, beside a grid of the given rate [Hz]."""
    clock, decision = part.taken.clock, part.taken.decision
    ratio = clock.rate_hz / rate_hz - 1
    return StreamReport(
        name=part.name,
        signals=decision.signals,
        rate_hz=clock.rate_hz,
        ppm=1e6 * ratio if abs(ratio) < NOMINALLY_EQUAL else None,
        even=decision.even,
        firm=decision.firm,
        why=decision.why,
        g={name: e.g for name, e in decision.evidence.items()},
        g_se={name: e.se if np.isfinite(e.se) else None for name, e in decision.evidence.items()},
        residual_sd_s=clock.sd,
        wander_s=clock.wander,
        skew=clock.skew,
        missing=clock.missing,
        empty=part.taken.empty,
        repeated=part.taken.repeated,
        merged=part.merged,
        bridged=len(gaps.bridged),
        marked=len(gaps.marked),
        interpolation="cubic spline at true stamps" if not decision.even else "cubic spline on the device's even clock",
        delay_s=part.taken.delay,
        error=cubic_error(limits.highest_hz, part.step),
        bridge_error=cubic_error(limits.highest_hz, gaps.longest_bridged),
    )


ON_GRID = 1e-6  # distance, in steps, at which a sample counts as lying on the grid
ROUNDED = 1e6  # rows of a grid from which that distance grows with their number: a step is known to 1e-13 of itself


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
        """The grid with every undecided stream taken the other way: true stamps as even, even ones as true. None where
        no stream is undecided. The difference of the two fits is what the missing decision costs. With `firm_too` the
        streams that the signals decided are also taken the other way."""
        turned = [t.decision.matters and (firm_too or not t.decision.firm) for t in self.taken]
        if not any(turned):
            return None
        return on_one_grid([t.other() if turn else t for t, turn in zip(self.taken, turned, strict=True)], self.limits)


def one_time_base(streams: Sequence[Stream], limits: GapLimits | None = None) -> UniformGrid:
    """All signals of a trial on one uniform grid at the fastest stream's rate, over what all streams cover.

    True stamps: cubic spline through the samples at their stamps. Even device: the same at the times of its own clock;
    where these are the grid, the samples themselves. Nothing is extrapolated.

    Raises InputError: As `Stream` and `take`; the streams do not overlap; a gap is too long; no row is usable.
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
