# SPDX-License-Identifier: Apache-2.0
"""One recorder's clock fitted to another's, t_master = offset + (1 + drift) * t_slave: by the edges
of a pulse train that both recorded; by a gate that is high while the other one records; or else by
a signal of both, as a joint's encoder and an angle between markers, whose scale, level and sign may
differ."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.measured import UNIFORM_WIDTH, usual_step
from osl_analysis.base.source_file import SharedAngle
from osl_analysis.base.trial import Array, marker_columns
from osl_analysis.ingest.conversion import Converted
from osl_analysis.signals.plateaus import means_from
from osl_analysis.stats.linear_fit import linear_fit


@dataclass(frozen=True)
class ClockFit:
    """A slave clock on a master clock."""

    offset: float  # master's time at the slave's time 0 [s]
    drift: float = 0.0  # relative difference of the clocks' rates [1]
    residual: float = 0.0  # RMS of the residuals [s]; by correlation, standard error of the times
    edges: int = 0  # pairs of edges that were used
    # `edges`, `gate`, `correlation` of a signal, or what is stated: `common`, `start`
    method: str = "edges"
    drift_error: float | None = None  # standard error of the drift; None: no signal tells it

    def to_master(self, time: Array) -> Array:
        """Times [s] of the slave on the master's clock [s]."""
        return self.offset + (1.0 + self.drift) * time


@dataclass(frozen=True)
class PulseLimits:
    """What makes a level a pulse train, and two pulse trains one."""

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
    of_master = scipy.spatial.KDTree(intervals_behind(master))
    apart, row = of_master.query(intervals_behind(slave), p=np.inf, distance_upper_bound=sampling)
    is_alike = np.isfinite(apart)
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
            "align the clocks by an angle that both recorded, `shared` in the capture's source"
            " file",
        )
    uniform = np.hypot(step, capture_step) / UNIFORM_WIDTH
    return ClockFit(-starts[0], residual=uniform, edges=2, method="gate")


@dataclass(frozen=True)
class SharedAngleLimits:
    """What tells a lag by an angle that two recorders share."""

    fewest_samples: int = 48  # samples; fewer fit anywhere
    # of a recording's variance, at least, where it hardly moves: noise would fit
    quiet_share: float = 0.05
    least_overlap: float = 0.5  # share of the shorter recording
    # lack of fit at the best lag over that at any other, or over 1, that of no signal
    most_alike: float = 0.85
    steps: int = 6  # Gauss-Newton steps to offset and drift, each a tenth of the one before or less
    # [s] of a mean: a spline through means is right to 0.001 of a sine of 6 Hz
    short_mean_s: float = 0.02


SHARED_ANGLE = SharedAngleLimits()


def correlate_clocks(slave: Signal, master: Signal) -> ClockFit:
    """Fit offset and drift by a signal that both recorded, whose scale, level and sign may differ:
    from the lag that correlates best, by Gauss-Newton steps on short means.

    Raises
    ------
    InputError
        A signal is too short or constant, or another lag fits about as well.
    """
    clock = ClockFit(likely_offset(slave, master), method="correlation")
    time, values = short_means(slave)
    master_time, master_values = short_means(master)
    spline = scipy.interpolate.CubicSpline(master_time, master_values)
    for _ in range(SHARED_ANGLE.steps):
        at = clock.to_master(time)
        inside = (at >= master_time[0]) & (at <= master_time[-1])
        middle = time[inside].mean()
        slope = spline(at[inside], 1)
        columns = {
            "gain": spline(at[inside]),
            "level": np.ones_like(slope),
            "late": slope,
            "drift": slope * (time[inside] - middle),
        }
        fit = linear_fit(values[inside], columns)
        drift = fit["drift"] / fit["gain"]
        late_s = fit["late"] / fit["gain"] - drift * middle
        clock = replace(clock, offset=clock.offset + late_s, drift=clock.drift + drift)
    late_error, drift_error = (fit.se(name) / abs(fit["gain"]) for name in ("late", "drift"))
    return replace(clock, residual=late_error, drift_error=drift_error)


def short_means(signal: Signal) -> Signal:
    """Means of times and values over `short_mean_s`."""
    rows = max(round(SHARED_ANGLE.short_mean_s / usual_step(signal[0])), 1)
    begins = np.arange(0, signal[0].size, rows)
    time, values = (means_from(begins, each) for each in signal)
    return time, values


def likely_offset(slave: Signal, master: Signal) -> float:
    """The offset [s] at which a straight line through one signal's means leaves least of the
    other's SD, its lack of fit; errors as `correlate_clocks`."""
    step = SHARED_ANGLE.short_mean_s
    means = []  # of both, every `step` from the first sample on
    for time, values in (slave, master):
        if time.size < SHARED_ANGLE.fewest_samples or np.ptp(values) == 0:
            raise InputError(
                "the shared signal of one recorder is constant or has fewer than"
                f" {SHARED_ANGLE.fewest_samples} samples",
                "check the channel and its sensor, or record longer",
            )
        on_grid = np.interp(np.arange(time[0], time[-1], step), *short_means((time, values)))
        means.append(on_grid - on_grid.mean())
    shared = shared_variance(*means)
    peaks = scipy.signal.find_peaks(np.pad(shared, 1), prominence=0.5 * shared.max())[0] - 1
    best, *others = peaks[np.argsort(-shared[peaks])].tolist()
    offset = master[0][0] - slave[0][0] + step * (best + 1 - means[0].size)
    lack_of_fit = np.sqrt(1 - min(shared[best], 1.0))
    elsewhere = np.sqrt(1 - shared[others].max(initial=0.0))
    if lack_of_fit > SHARED_ANGLE.most_alike * elsewhere:
        raise InputError(
            f"the shared signal fits at a lag of {offset:.2f} s, where {lack_of_fit:.2g} of its SD"
            f" is left, hardly better than elsewhere, {elsewhere:.2g}",
            "check that both channels show the same movement, and record longer, with one that"
            " does not repeat",
        )
    return float(offset)


def shared_variance(ours: Array, theirs: Array) -> Array:
    """Squared correlation of two signals at every lag of `theirs` (m,) behind `ours` (n,), from
    1 - n on, over what overlaps; 0 where that is too little. Where one hardly moves, noise would
    fit: its variance counts as a share of that of the whole, at least."""
    sums = partial(scipy.signal.correlate, method="fft")
    our_rows = np.ones_like(ours)
    their_rows = np.ones_like(theirs)
    count = np.rint(sums(their_rows, our_rows))
    our_sum = sums(their_rows, ours)
    their_sum = sums(theirs, our_rows)
    quiet = SHARED_ANGLE.quiet_share * count**2
    our_power = np.maximum(count * sums(their_rows, ours**2) - our_sum**2, quiet * ours.var())
    their_power = np.maximum(count * sums(theirs**2, our_rows) - their_sum**2, quiet * theirs.var())
    covariance = count * sums(theirs, ours) - our_sum * their_sum
    overlaps = count >= SHARED_ANGLE.least_overlap * min(ours.size, theirs.size)
    return np.where(overlaps, covariance**2 / (our_power * their_power), 0.0)


def aligned_clock(
    log: Converted, mocap: Converted, shared: SharedAngle | None
) -> tuple[ClockFit, list[str]]:
    """Fit the log's clock to motion capture's.

    By sync edges; by the one pulse that is as long as the capture, where the capture's own level
    stands still; or else, with a warning, by the lag of a shared angle.

    Parameters
    ----------
    shared
        What motion capture's source file names under `shared`.

    Returns
    -------
    fit : ClockFit
    warnings : list
        A sentence each.

    Raises
    ------
    InputError
        Neither edges nor a shared angle align the clocks.
    """

    missing = "the clocks cannot be aligned; map the channel in its source file"
    try:
        pulses = find_edges(*values_of(log, f"log: {missing}", "sync"))
        time, level = values_of(mocap, f"motion capture: {missing}", "sync")
        edges = find_edges(time, level)
        return fit_clock(pulses, edges) if edges.time.size else gate_fit(pulses, time), []
    except InputError as error:
        if shared is None:
            raise
        refused = error
    what = f"'{shared.column}' and the angle at marker {shared.markers[1]}"
    with naming(f"{refused}; cross-correlation of {what} does not align them either"):
        in_log = values_of(log, "log; map the channel in its source file", shared.column)
        fit = correlate_clocks(in_log, angle_between(mocap, shared.markers))
    return fit, [
        f"clocks aligned by cross-correlation of {what}, because of the sync edges: {refused}"
    ]


def angle_between(mocap: Converted, markers: Sequence[str]) -> Signal:
    """Times [s] and angle at the second of three markers, where all are seen."""
    columns = [column for label in markers for column in marker_columns(label)]
    time, positions = values_of(
        mocap, "motion capture; correct `shared` in its source file", *columns
    )
    first, vertex, last = positions.reshape(-1, 3, 3).swapaxes(0, 1)
    sine = np.linalg.norm(np.cross(first - vertex, last - vertex), axis=1)
    cosine = ((first - vertex) * (last - vertex)).sum(axis=1)
    return time, np.arctan2(sine, cosine)


def values_of(recording: Converted, advice: str, *columns: str) -> Signal:
    """Times [s] and values of columns where all were sampled, (n,) of one and else (n, columns).
    Raises InputError, with `advice`: there is no such column."""
    for column in columns:
        if column not in recording.samples.columns:
            raise InputError(f"no column '{column}' from {advice}")
    rows = recording.samples.select("time", *columns).fill_nan(None).drop_nulls()
    return rows["time"].to_numpy(), rows.drop("time").to_numpy().squeeze()
