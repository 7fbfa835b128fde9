"""One recorder's clock from another's, by the edges of a pulse train that both recorded.

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
STRETCH = 40  # edges that are matched at once to begin with
REJECT = 3.5  # standard deviations beyond which an edge is an outlier


@dataclass(frozen=True)
class ClockFit:
    """Offset [s] and drift (1) of a slave clock, standard error of the drift (1), RMS of the residuals [s].

    `edges` pairs were used; `left_out` edges of the slave, in the time common to both, fit none of the master's.
    `method` says what was matched: the edges of a pulse train, or by `correlation` the course of a shared signal.
    """

    offset: float
    drift: float
    drift_error: float
    residual: float
    edges: int
    left_out: int
    method: str = "edges"

    def to_master(self, time: Array) -> Array:
        """Times [s] of the slave on the master's clock [s]."""
        return self.offset + (1.0 + self.drift) * time


@dataclass(frozen=True)
class Edges:
    """Times [s] of the level changes of a pulse train and whether they rise, (n,) each; `step` [s] is the sampling."""

    time: Array
    rising: NDArray[np.bool_]
    step: float


def find_edges(time: Array, level: Array) -> Edges:
    """Edges of a two-level signal, at the crossing of its mid-level between two samples.

    A change counts once the signal has passed three quarters of its range (a quarter, falling), so that noise at
    the mid-level does not.
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
    """A straight line from the slave's time to the master's, see `ClockFit`."""

    offset: float
    drift: float
    drift_error: float

    def at(self, time: Array) -> Array:
        return self.offset + (1.0 + self.drift) * time


def fit_clock(slave: Edges, master: Edges) -> ClockFit:
    """Match the edges by the pattern of their intervals and fit offset and drift, without outliers.

    The noise of an edge is its sampling, uniform within a step. A drift beyond what crystals do is held back by a
    prior of `TYPICAL_DRIFT`, which a long recording overrules and a few edges in a short one cannot.

    Raises
    ------
    InputError
        Fewer than six common edges, a pattern that fits in more than one place (pulses of one period do), or a
        residual above the coarser recorder's sampling interval.
    """
    for edges, who in ((slave, "the log"), (master, "motion capture")):
        if edges.time.size < MINIMUM_EDGES:
            raise InputError(
                f"{edges.time.size} sync edges in {who}, at least {MINIMUM_EDGES} are needed; check the sync cable, "
                "or record longer"
            )
    noise = float(np.hypot(slave.step, master.step)) / np.sqrt(12)
    first, second = extended(slave, master, *common_stretch(slave, master), noise)
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
    left_out = max(int(common.sum() - used.sum()), 0)
    return ClockFit(line.offset, line.drift, line.drift_error, rms, int(used.sum()), left_out)


def common_stretch(slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of some edges on both clocks, (n,) each: the stretch of the slave's that fits best into the master's.

    Every pair of edges votes for an offset; in a stretch this short, drift does not smear the votes.
    """
    best, rival, chosen = 0, 0, (slave.time[:0], master.time[:0])
    for begin in range(0, slave.time.size, STRETCH):
        time, rising = slave.time[begin : begin + STRETCH], slave.rising[begin : begin + STRETCH]
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
    """Pairs of edges over the whole recording, (n,) each, from those of a stretch: fit, reach twice as far, repeat."""
    whole, reach = np.ptp(slave.time), max(np.ptp(first), slave.step)
    while True:
        line, used = robust_line(first, second, noise)
        reach *= 2
        near = abs(slave.time - first[used].mean()) <= reach
        tolerance = 2.0 * (slave.step + master.step) + 4.0 * line.drift_error * reach
        pairs = [
            nearest(line, slave.time[near & (slave.rising == up)], master.time[master.rising == up], tolerance)
            for up in (True, False)
        ]
        first, second = (np.concatenate(column) for column in zip(*pairs, strict=True))
        if reach > 2 * whole:
            return first, second


def nearest(line: Line, slave: Array, master: Array, tolerance: float) -> tuple[Array, Array]:
    """Slave times and the master's nearest to where the line puts them, where these are within the tolerance [s]."""
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

    `noise` [s] is one pair's standard deviation. The differences are fitted, so that large times cost no digits;
    outliers go by their distance from the median.
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
