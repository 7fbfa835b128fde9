"""Gaps in a stream: short ones are bridged, longer ones marked so that fits leave their rows out, long ones refused."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.timebase.counting import LONG_STEP
from osl_analysis.timebase.samples import Samples
from osl_analysis.trial import Array

BRIDGE_MORE = (
    "record again with fewer lost samples, or lower time_base.highest_hz, which bridges gaps up to 0.1/highest_hz: "
    "50 ms bridged in every cycle change I by about 1 %"
)
"""What the user may do where gaps leave nothing to fit."""
ROUNDING = 0.1
"""Steps by which jitter may lengthen a gap that is still bridged."""


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
    """Gaps of a stream between two times [s].

    Raises
    ------
    InputError
        A gap is longer than `limits.longest_s`.
    """
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
