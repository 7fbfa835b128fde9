"""One recorder's clock fitted to another's, by the edges of a pulse train that both recorded.

t_master = offset + (1 + drift) * t_slave
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

MINIMUM_EDGES = 6
TYPICAL_DRIFT = 100e-6  # two crystal clocks against each other, one standard deviation
LARGEST_DRIFT = 500e-6
FIRST_EDGES = 40  # edges in the first match
REJECT = 3.5  # standard deviations beyond which an edge is an outlier


@dataclass(frozen=True)
class ClockFit:
    """A slave clock on a master clock."""

    offset: float
    """Master's time at the slave's time 0 [s]."""
    drift: float
    """Relative difference of the clocks' rates [1]."""
    drift_error: float
    """Standard error of the drift [1]."""
    residual: float
    """RMS of the residuals [s]."""
    edges: int
    """Pairs of edges that were used; by correlation, sections of the recording."""
    excluded_edges: int
    """Edges of the slave, during the time that both recorded, that match no edge of the master."""
    method: str = "edges"
    """What was matched: `edges` of a pulse train, or by `correlation` a signal that both recorded; nothing where both
    files have `common` times."""

    def to_master(self, time: Array) -> Array:
        """Times [s] of the slave on the master's clock [s]."""
        return self.offset + (1.0 + self.drift) * time


@dataclass(frozen=True)
class Edges:
    """The edges of a pulse train."""

    time: Array
    """Times of the edges, (n,) [s]."""
    rising: NDArray[np.bool_]
    """Whether the level rises, (n,)."""
    step: float
    """Sampling interval of the recorder [s]."""


def find_edges(time: Array, level: Array) -> Edges:
    """Edges of a two-level signal: where it crosses its mid-level, interpolated between two samples.

    A rising edge counts only if the signal then passes three quarters of its range, a falling one if it passes one
    quarter, so that noise at the mid-level makes no edges.
    """
    low, high = float(level.min()), float(level.max())
    swing = high - low
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    certain = np.flatnonzero((level > low + 0.75 * swing) | (level < low + 0.25 * swing)) if swing else np.zeros(0, int)
    state = level[certain] > low + 0.5 * swing
    after = certain[1:][state[1:] != state[:-1]]
    crossings = np.flatnonzero(np.diff(level > low + 0.5 * swing))
    before = crossings[np.searchsorted(crossings, after) - 1]
    fraction = (low + 0.5 * swing - level[before]) / (level[before + 1] - level[before])
    return Edges(time[before] + fraction * (time[before + 1] - time[before]), level[after] > level[before], step)


@dataclass(frozen=True)
class Line:
    """A straight line from the slave's time to the master's; its fields are those of `ClockFit`."""

    offset: float
    """[s]."""
    drift: float
    """[1]."""
    drift_error: float
    """[1]."""

    def at(self, time: Array) -> Array:
        """Times of the slave [s] on the master's clock [s]."""
        return self.offset + (1.0 + self.drift) * time


def fit_clock(slave: Edges, master: Edges) -> ClockFit:
    """Match the edges by the pattern of their intervals, and fit offset and drift without outliers.

    The error of an edge is that of sampling, uniform within one interval. A prior of standard deviation `TYPICAL_DRIFT`
    keeps the drift plausible in a short recording. In a long recording the edges outweigh it.

    Raises
    ------
    InputError
        There are fewer than six common edges, the pattern fits in more than one place (as equal pulses do), or the
        residual exceeds the sampling interval of the slower recorder.
    """
    for edges, who in ((slave, "the log"), (master, "motion capture")):
        if edges.time.size < MINIMUM_EDGES:
            raise InputError(
                f"{edges.time.size} sync edges in {who}, at least {MINIMUM_EDGES} are needed; check the sync cable, "
                "or record longer"
            )
    noise = float(np.hypot(slave.step, master.step)) / np.sqrt(12)
    first, second = extended(slave, master, *first_pairs(slave, master), noise)
    line, used = robust_line(first, second, noise)
    rms = float(np.sqrt(((second - line.at(first))[used] ** 2).mean()))
    limit = max(slave.step, master.step)
    if rms > limit:
        raise InputError(
            f"the sync edges fit with a residual of {1e3 * rms:.2f} ms over {used.sum()} edges, within "
            f"{1e3 * limit:.2f} ms is needed; check the sync cable and both sync channels"
        )
    expected = line.at(slave.time)
    common = (expected >= master.time[0] - limit) & (expected <= master.time[-1] + limit)
    excluded_edges = max(int(common.sum() - used.sum()), 0)
    return ClockFit(line.offset, line.drift, line.drift_error, rms, int(used.sum()), excluded_edges)


def first_pairs(slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of some edges on both clocks, (n,) each, from the part of the slave's recording that fits best.

    Every pair of edges votes for an offset. The part is short enough that drift does not spread the votes.
    """
    best, rival, chosen = 0, 0, (slave.time[:0], master.time[:0])
    for begin in range(0, slave.time.size, FIRST_EDGES):
        time, rising = slave.time[begin : begin + FIRST_EDGES], slave.rising[begin : begin + FIRST_EDGES]
        difference = master.time[None, :] - time[:, None]
        same = rising[:, None] == master.rising[None, :]
        width = 2.0 * (slave.step + master.step) + LARGEST_DRIFT * np.ptp(time)
        votes = np.sort(difference[same])
        count = np.searchsorted(votes, votes + width, side="right") - np.arange(votes.size)
        if count.max(initial=0) > best:
            peak = votes[np.argmax(count)]
            best = int(count.max())
            rival = int(count[abs(votes - peak) > width].max(initial=0))
            rows, columns = np.nonzero(same & (difference >= peak) & (difference <= peak + width))
            chosen = time[rows], master.time[columns]
    if best < MINIMUM_EDGES or rival > best // 2:
        raise InputError(
            f"{best} sync edges agree on one offset between the clocks and {rival} on another; at least "
            f"{MINIMUM_EDGES} and twice as many are needed: let the pulses vary in length, or record longer"
        )
    return chosen


def extended(slave: Edges, master: Edges, first: Array, second: Array, noise: float) -> tuple[Array, Array]:
    """Pairs of edges over the whole recording, (n,) each: fit a line to those known, reach twice as far, repeat."""
    whole, reach = np.ptp(slave.time), max(np.ptp(first), slave.step)
    while True:
        line, used = robust_line(first, second, noise)
        reach *= 2
        near = abs(slave.time - first[used].mean()) <= reach
        tolerance = 2.0 * (slave.step + master.step) + 4.0 * line.drift_error * reach
        pairs = [
            nearest_edges(line, slave.time[near & (slave.rising == up)], master.time[master.rising == up], tolerance)
            for up in (True, False)
        ]
        first, second = (np.concatenate(column) for column in zip(*pairs, strict=True))
        if reach > 2 * whole:
            return first, second


def nearest_edges(line: Line, slave: Array, master: Array, tolerance: float) -> tuple[Array, Array]:
    """Slave times, and the master times nearest to the line's, where they differ by less than the tolerance [s]."""
    if not master.size:
        return slave[:0], master
    expected = line.at(slave)
    right = np.minimum(np.searchsorted(master, expected), master.size - 1)
    left = np.maximum(right - 1, 0)
    closer = np.where(abs(master[left] - expected) < abs(master[right] - expected), left, right)
    close = abs(master[closer] - expected) <= tolerance
    return slave[close], master[closer[close]]


def robust_line(first: Array, second: Array, noise: float) -> tuple[Line, NDArray[np.bool_]]:
    """Line through pairs of times (n,), and which of them were used, (n,).

    `noise` [s] is the standard deviation of one pair. The differences of the times are fitted, so that large times lose
    no digits. Outliers are found by their distance from the median.
    """
    if first.size < MINIMUM_EDGES:
        raise InputError(f"{first.size} sync edges fit together, at least {MINIMUM_EDGES} are needed; record longer")
    difference = second - first
    used = abs(difference - np.median(difference)) <= LARGEST_DRIFT * np.ptp(first) + REJECT * noise
    if used.sum() < MINIMUM_EDGES:
        used[:] = True
    for _ in range(10):
        centre, level = first[used].mean(), difference[used].mean()
        information = ((first[used] - centre) ** 2).sum() + (noise / TYPICAL_DRIFT) ** 2
        drift = ((first[used] - centre) * (difference[used] - level)).sum() / information
        residuals = difference - (level + drift * (first - centre))
        spread = 1.4826 * np.median(abs(residuals[used]))
        keep = abs(residuals) <= REJECT * max(spread, noise)
        if keep.sum() < MINIMUM_EDGES or (keep == used).all():
            break
        used = keep
    return Line(float(level - drift * centre), float(drift), float(noise / np.sqrt(information))), used
