# SPDX-License-Identifier: Apache-2.0
"""Fit one recorder's clock to another's.

    t_master = offset + (1 + drift) * t_slave

The edges of a pulse train that both recorded tell offset and drift; a gate, which is high while the
other one records, tells the offset alone. Example: 40 edges at 1000 and 250 Hz tell the offset to
0.2 ms.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError
from osl_analysis.base.measured import UNIFORM_WIDTH, usual_step
from osl_analysis.base.trial import Array
from osl_analysis.ingest.conversion import Converted


@dataclass(frozen=True)
class ClockFit:
    """A slave clock on a master clock."""

    offset: float  # master's time at the slave's time 0 [s]
    drift: float = 0.0  # relative difference of the clocks' rates [1]
    residual: float = 0.0  # RMS of the residuals [s]
    edges: int = 0  # pairs of edges that were used
    # `edges` or `gate` of a sync line, or what is stated: `common`, `start`
    method: str = "edges"
    drift_error: float | None = None  # standard error of the drift; None: no signal tells it

    def to_master(self, time: Array) -> Array:
        """Times [s] of the slave on the master's clock [s]."""
        return self.offset + (1.0 + self.drift) * time


@dataclass(frozen=True)
class PulseLimits:
    """Limits by which a level is a pulse train, and two pulse trains are one."""

    largest_drift: float = 5e-4  # [s/s] between two crystal clocks
    # [s/s] standard deviation between two; keeps a short recording plausible
    usual_drift: float = 1e-4
    # share of a pulse train's samples near its two levels; of noise it is a twentieth
    least_certain: float = 0.5
    least_swing: float = 0.05  # of a line's largest level; less is the last bit of one level
    # per sample; of the last bit of a level near 0 every second sample is one
    most_edges: float = 0.2
    fewest_alike: int = 4  # runs of three edges, which have six edges together
    outlier: float = 3.5  # standard deviations from the line
    outlier_rounds: int = 10  # of a search for outliers, which ends where none comes or goes
    # sampling intervals by which a gate may be longer or shorter than its capture
    gate_steps: float = 3.0


PULSES = PulseLimits()


class Edges(NamedTuple):
    """Edges of a pulse train."""

    time: Array  # (n,) [s]
    is_rising: NDArray[np.bool_]  # (n,)
    step: float  # sampling interval [s] of the recorder


Signal = tuple[Array, Array]  # rising times [s] and values, (n,) each


def find_edges(time: Array, level: Array) -> Edges:
    """Edges of a two-level signal: times at which it crosses its mid-level, interpolated between
    samples that pass three quarters of its range and one quarter, so that noise at the mid-level
    makes no edges. A level that has no two values has none, nor one whose last bit changes."""
    swing = np.ptp(level)
    middle = level.min() + 0.5 * swing
    certain = np.flatnonzero(abs(level - middle) > 0.25 * swing)
    is_high = level[certain] > middle
    turns = np.flatnonzero(np.diff(is_high))
    is_pulses = (
        swing >= PULSES.least_swing * np.abs(level).max()
        and certain.size >= PULSES.least_certain * level.size
        and turns.size <= PULSES.most_edges * level.size
    )
    if not is_pulses:
        turns = turns[:0]
    before = certain[turns]
    after = certain[turns + 1]
    fraction = (middle - level[before]) / (level[after] - level[before])
    edges = time[before] + fraction * (time[after] - time[before])
    return Edges(edges, is_high[turns + 1], usual_step(time))


def fit_clock(slave: Edges, master: Edges) -> ClockFit:
    """Match the edges by the pattern of their intervals, and fit offset and drift without outliers.
    An edge has the error of sampling, uniform within one interval."""
    noise = np.hypot(slave.step, master.step) / UNIFORM_WIDTH
    limit = max(slave.step, master.step)
    rough = robust_line(*pairs_alike(slave, master), noise)
    line = robust_line(*pairs_near(rough, slave, master), noise)
    if line.residual > limit:
        raise InputError(
            f"the sync edges fit with a residual of {1e3 * line.residual:.2f} ms over"
            f" {line.edges} edges, within {1e3 * limit:.2f} ms is needed",
            "check the sync cable and both sync channels",
        )
    return line


def pairs_alike(slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of edges on both clocks, (n,) each, behind which the next two intervals are alike, and
    that agree on one offset.

    Raises
    ------
    InputError
        Too few agree, or half as many on another offset.
    """
    sampling = 2.0 * (slave.step + master.step)
    master_tree = scipy.spatial.KDTree(intervals_behind(master))
    distance, row = master_tree.query(
        intervals_behind(slave), p=np.inf, distance_upper_bound=sampling
    )
    is_alike = np.isfinite(distance)
    ours = slave.time[:-2][is_alike]
    theirs = master.time[np.asarray(row)[is_alike]]
    offsets = theirs - ours
    width = sampling + PULSES.largest_drift * np.ptp(master.time)
    votes = np.sort(offsets)
    count = np.searchsorted(votes, votes + width, side="right") - np.arange(votes.size)
    best = count.max(initial=0)
    peak = votes[count == best].min(initial=np.inf)
    runner_up = count[abs(votes - peak) > width].max(initial=0)
    if best < PULSES.fewest_alike or runner_up > best // 2:
        raise InputError(
            f"{best} runs of three sync edges agree with the other recorder's on one offset and"
            f" {runner_up} on another, {PULSES.fewest_alike} and twice as many are needed",
            "check the sync cable and whether both files are of one trial, let the pulses vary,"
            " or record longer",
        )
    agrees = (offsets >= peak) & (offsets <= peak + width)
    return ours[agrees], theirs[agrees]


def intervals_behind(edges: Edges) -> Array:
    """The two intervals [s] behind each edge, and whether it rises, (n - 2, 3)."""
    intervals = np.diff(edges.time)
    return np.column_stack([intervals[:-1], intervals[1:], edges.is_rising[:-2]])


def pairs_near(line: ClockFit, slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of edges on both clocks, (n,) each, that rise or fall alike within twice the sampling
    intervals of a line."""
    theirs = master.time
    expected = line.to_master(slave.time)
    nearest = np.searchsorted((theirs[1:] + theirs[:-1]) / 2, expected)
    is_close = abs(theirs[nearest] - expected) <= 2.0 * (slave.step + master.step)
    rows = np.flatnonzero(is_close & (slave.is_rising == master.is_rising[nearest]))
    # the rising ones first: the last bits of the line depend on the order of its sums
    rows = rows[np.argsort(~slave.is_rising[rows], kind="stable")]
    return slave.time[rows], theirs[nearest[rows]]


def robust_line(first: Array, second: Array, noise: float) -> ClockFit:
    """Line through pairs of times (n,), of which one has the standard deviation `noise` [s]. The
    prior of the usual drift keeps that of a short recording plausible. In a long one the pairs
    outweigh it. The differences of the times are fitted, so that large times lose no digits."""
    difference = second - first
    used = np.ones(first.size, dtype=bool)
    for _ in range(PULSES.outlier_rounds):
        centre, level = first[used].mean(), difference[used].mean()
        information = ((first[used] - centre) ** 2).sum() + (noise / PULSES.usual_drift) ** 2
        drift = ((first[used] - centre) * (difference[used] - level)).sum() / information
        residuals = difference - (level + drift * (first - centre))
        spread = scipy.stats.median_abs_deviation(residuals[used], scale="normal")
        is_near = abs(residuals) <= PULSES.outlier * max(spread, noise)
        if (is_near == used).all():
            break
        used = is_near
    return ClockFit(
        level - drift * centre,
        drift,
        residual=np.sqrt((residuals[used] ** 2).mean()),
        edges=int(used.sum()),
        drift_error=noise / np.sqrt(information),
    )


def gate_fit(pulses: Edges, time: Array) -> ClockFit:
    """Fit a clock by a gate, which is high while the other recorder records: the log has a pulse
    that is as long as the capture.

    Parameters
    ----------
    pulses
        Edges in the log.
    time
        Of the capture's samples (n,) [s], the first at 0.

    Raises
    ------
    InputError
        No pulse, or several pulses of the log are as long as the capture.
    """
    edges, is_rising, step = pulses
    capture_step = usual_step(time)
    length = np.ptp(time) + capture_step
    slack = PULSES.gate_steps * max(step, capture_step) + PULSES.largest_drift * length
    starts = edges[:-1][is_rising[:-1] & (np.abs(np.diff(edges) - length) <= slack)]
    if starts.size != 1:
        raise InputError(
            "the sync line of motion capture has no edge: it is a gate, or nothing is connected,"
            f" and {starts.size} pulses of the log are as long as the capture ({length:.3f} s)",
            "cut the log around this capture, or record a sync line with pulses of changing length"
            " in both",
        )
    uniform = np.hypot(step, capture_step) / UNIFORM_WIDTH
    return ClockFit(-starts[0], residual=uniform, edges=2, method="gate")


def aligned_clock(log: Converted, mocap: Converted) -> ClockFit:
    """Fit the log's clock to motion capture's.

    The edges of the line `sync` align them, or the one pulse of the log that is as long as the
    capture, where the capture's own level stands still.

    Raises
    ------
    InputError
        A recording has no column `sync`, or its edges do not align the clocks.
    """
    missing = "the clocks cannot be aligned; map the channel in its source file"
    pulses = find_edges(*values_of(log, f"log: {missing}", "sync"))
    time, level = values_of(mocap, f"motion capture: {missing}", "sync")
    edges = find_edges(time, level)
    return fit_clock(pulses, edges) if edges.time.size else gate_fit(pulses, time)


def values_of(recording: Converted, advice: str, *columns: str) -> Signal:
    """Times [s] and values of columns where all were sampled, (n,) of one and else (n, columns).
    Raises InputError, with `advice`: there is no such column."""
    for column in columns:
        if column not in recording.samples.columns:
            raise InputError(f"no column '{column}' from {advice}")
    rows = recording.samples.select("time", *columns).fill_nan(None).drop_nulls()
    return rows["time"].to_numpy(), rows.drop("time").to_numpy().squeeze()
