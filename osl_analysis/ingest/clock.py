"""One recorder's clock fitted to another's, t_master = offset + (1 + drift) * t_slave, by the edges of a pulse train
that both recorded."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.source import Recording
from osl_analysis.trial import Array

MINIMUM_EDGES = 6
LARGEST_DRIFT = 500e-6  # of two crystal clocks


@dataclass(frozen=True)
class ClockFit:
    """A slave clock on a master clock."""

    offset: float  # master's time at the slave's time 0 [s]
    drift: float = 0.0  # relative difference of the clocks' rates [1]
    drift_error: float = 0.0  # standard error of the drift [1]
    residual: float = 0.0  # RMS of the residuals [s]
    edges: int = 0  # pairs of edges that were used
    excluded_edges: int = 0  # Edges of the slave, during the time that both recorded, that match no edge of the master.
    method: str = "edges"  # what was matched: edges; nothing where the files have `common` times

    def to_master(self, time: Array) -> Array:
        """Times [s] of the slave on the master's clock [s]."""
        return self.offset + (1.0 + self.drift) * time


# of a pulse train: times [s], (n,), whether the level rises, (n,), and the sampling interval of the recorder [s]
Edges = tuple[Array, NDArray[np.bool_], float]


def find_edges(time: Array, level: Array) -> Edges:
    """Edges of a two-level signal: where it crosses its mid-level, interpolated between two samples. A rising edge
    counts only if the signal then passes three quarters of its range, a falling one if it passes one quarter, so that
    noise at the mid-level makes no edges."""
    low, swing = float(level.min()), float(np.ptp(level))
    step, middle = float(np.median(np.diff(time))) if time.size > 1 else 0.0, low + 0.5 * swing
    certain = np.flatnonzero(abs(level - middle) > 0.25 * swing)
    state = level[certain] > middle
    after = certain[1:][state[1:] != state[:-1]]
    crossings = np.flatnonzero(np.diff(level > middle))
    before = crossings[np.searchsorted(crossings, after) - 1]
    fraction = (middle - level[before]) / (level[before + 1] - level[before])
    return time[before] + fraction * (time[before + 1] - time[before]), level[after] > level[before], step


def fit_clock(slave: Edges, master: Edges) -> ClockFit:
    """Match the edges by the pattern of their intervals, and fit offset and drift without outliers. The error of an
    edge is that of sampling, uniform within one interval."""
    for (times, _, _), who in ((slave, "the log"), (master, "motion capture")):
        if times.size < MINIMUM_EDGES:
            raise InputError(
                f"{times.size} sync edges in {who}, at least {MINIMUM_EDGES} are needed; check the sync cable, or "
                "record longer"
            )
    (ours, rising, step), (theirs, theirs_rising, their_step) = slave, master
    noise, limit = float(np.hypot(step, their_step)) / np.sqrt(12), max(step, their_step)
    first, second = first_pairs(slave, master)
    reach = max(np.ptp(first), step)
    while reach <= 2 * np.ptp(ours):  # fit a line to the pairs known, reach twice as far, repeat
        line, used = robust_line(first, second, noise)
        reach *= 2
        near = abs(ours - first[used].mean()) <= reach
        tolerance = 2.0 * (step + their_step) + 4.0 * line.drift_error * reach
        pairs = []
        for up in (True, False):
            own, others = ours[near & (rising == up)], theirs[theirs_rising == up]
            if others.size:
                expected = line.to_master(own)
                nearest = others[np.searchsorted((others[1:] + others[:-1]) / 2, expected)]
                close = abs(nearest - expected) <= tolerance
                pairs.append((own[close], nearest[close]))
        first, second = (np.concatenate(column) for column in zip(*pairs, strict=True))
    line, used = robust_line(first, second, noise)
    if line.residual > limit:
        raise InputError(
            f"the sync edges fit with a residual of {1e3 * line.residual:.2f} ms over {used.sum()} edges, within "
            f"{1e3 * limit:.2f} ms is needed; check the sync cable and both sync channels"
        )
    expected = line.to_master(ours)
    common = (expected >= theirs[0] - limit) & (expected <= theirs[-1] + limit)
    return replace(line, excluded_edges=max(int(common.sum() - used.sum()), 0))


def first_pairs(slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of some edges on both clocks, (n,) each, from the part of the slave's recording that fits best. Every pair
    of edges votes for an offset. The part is short enough that drift does not spread the votes."""
    best, rival, chosen = 0, 0, (slave[0][:0], master[0][:0])
    for begin in range(0, slave[0].size, 40):
        time, rising = slave[0][begin : begin + 40], slave[1][begin : begin + 40]
        difference, same = master[0][None, :] - time[:, None], rising[:, None] == master[1][None, :]
        width = 2.0 * (slave[2] + master[2]) + LARGEST_DRIFT * np.ptp(time)
        votes = np.sort(difference[same])
        count = np.searchsorted(votes, votes + width, side="right") - np.arange(votes.size)
        if count.max(initial=0) > best:
            peak, best = votes[np.argmax(count)], int(count.max())
            rival = int(count[abs(votes - peak) > width].max(initial=0))
            rows, columns = np.nonzero(same & (difference >= peak) & (difference <= peak + width))
            chosen = time[rows], master[0][columns]
    if best < MINIMUM_EDGES or rival > best // 2:
        raise InputError(
            f"{best} sync edges agree on one offset between the clocks and {rival} on another; at least "
            f"{MINIMUM_EDGES} and twice as many are needed: let the pulses vary in length, or record longer"
        )
    return chosen


def robust_line(first: Array, second: Array, noise: float) -> tuple[ClockFit, NDArray[np.bool_]]:
    """Line through pairs of times (n,), and which of them were used, (n,). `noise` [s] is the standard deviation of one
    pair. A prior of that of two crystal clocks, 100 ppm, keeps the drift plausible in a short recording; in a long one
    the pairs outweigh it. The differences of the times are fitted, so that large times lose no digits. Outliers, beyond
    3.5 standard deviations, are found by their distance from the median."""
    if first.size < MINIMUM_EDGES:
        raise InputError(f"{first.size} sync edges fit together, at least {MINIMUM_EDGES} are needed; record longer")
    difference = second - first
    used = abs(difference - np.median(difference)) <= LARGEST_DRIFT * np.ptp(first) + 3.5 * noise
    if used.sum() < MINIMUM_EDGES:
        used[:] = True
    for _ in range(10):
        centre, level = first[used].mean(), difference[used].mean()
        information = ((first[used] - centre) ** 2).sum() + (noise / 100e-6) ** 2
        drift = ((first[used] - centre) * (difference[used] - level)).sum() / information
        residuals = difference - (level + drift * (first - centre))
        spread = 1.4826 * np.median(abs(residuals[used]))
        keep = abs(residuals) <= 3.5 * max(spread, noise)
        if keep.sum() < MINIMUM_EDGES or (keep == used).all():
            break
        used = keep
    line = ClockFit(float(level - drift * centre), float(drift), float(noise / np.sqrt(information)))
    residual = float(np.sqrt(((second[used] - line.to_master(first[used])) ** 2).mean()))
    return replace(line, residual=residual, edges=int(used.sum())), used


def aligned_clock(log: Recording, mocap: Recording) -> ClockFit:
    """The log's clock by the edges of both sync channels. A log that says `clock: common` has the capture's times."""
    pair = (log, "log"), (mocap, "motion capture")
    if log.facts.get("clock") == "common":
        starts = [one.facts.get("time", {}).get("start") for one, _ in pair]
        if None in starts:
            raise InputError(
                "the log says `clock: common`, but the capture's file states no times, as only TRC does; write `clock: "
                "sync` and map the column sync"
            )
        return ClockFit(starts[0] - starts[1], method="common")
    edges = list[Edges]()
    for one, who in pair:
        if "sync" not in one.samples.columns:
            raise InputError(
                f"no column 'sync' from {who}: the clocks cannot be aligned; map the channel in its source file"
            )
        rows = one.samples.select("time", "sync").drop_nulls()
        edges.append(find_edges(rows["time"].to_numpy(), rows["sync"].to_numpy()))
    return fit_clock(*edges)
