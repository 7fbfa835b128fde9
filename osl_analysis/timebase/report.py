"""What the time base did to a trial, for its provenance."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.timebase.gaps import GapLimits, Gaps
from osl_analysis.timebase.samples import Samples
from osl_analysis.trial import Array

NOMINALLY_EQUAL = 1e-3
"""Difference of two rates below which it is the clocks' and not the devices' intention."""


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

    2.5e-5 of 5 Hz at 100 Hz. The same holds within a single gap of length `step`.
    """
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
