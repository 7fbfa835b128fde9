"""One recorder's clock fitted to another's, t_master = offset + (1 + drift) * t_slave: by the edges
of a pulse train that both recorded; by a gate that is high while the other one records; or else by
the correlation of a joint's encoder with an angle between markers, whose scale, offset and sign may
differ."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.conversion import Converted
from osl_analysis.source_file import SharedAngle
from osl_analysis.trial import Array, marker_columns

MINIMUM_EDGES = 6
LARGEST_DRIFT = 500e-6  # between two crystal clocks
USUAL_DRIFT = 100e-6  # standard deviation between two; keeps a short recording plausible
LEAST_CERTAIN = 0.5  # share of samples of a pulse near its two levels; of noise it is a twentieth
LEAST_SWING = 0.05  # of a line's largest level; less is the last bit of one level
MOST_EDGES = 0.2  # per sample; of the last bit of a level near 0 every second sample is one
EDGES_TOGETHER = 40  # few enough that drift does not spread their offsets
GATE_STEPS = 3.0  # sampling intervals by which a gate may be longer or shorter than its capture


@dataclass(frozen=True)
class ClockFit:
    """A slave clock on a master clock."""

    offset: float  # master's time at the slave's time 0 [s]
    drift: float = 0.0  # relative difference of the clocks' rates [1]
    drift_error: float = 0.0  # standard error of the drift [1]
    residual: float = 0.0  # RMS of the residuals [s]; by correlation, standard error of the times
    edges: int = 0  # pairs of edges that were used
    # Edges of the slave, during the time that both recorded, that match no edge of the master.
    excluded_edges: int = 0
    # `edges`, `gate`, `correlation` of a signal, or `common`: the files share one time
    method: str = "edges"
    # Likelihood of the second-best place of a shared angle, over that of the best; 0 for edges
    second_place: float = 0.0

    def to_master(self, time: Array) -> Array:
        """Times [s] of the slave on the master's clock [s]."""
        return self.offset + (1.0 + self.drift) * time


# edges of a pulse train: times (n,) [s], whether the level rises (n,), and the recorder's sampling
# interval [s]
Edges = tuple[Array, NDArray[np.bool_], float]
Signal = tuple[Array, Array]  # rising times [s] and values, (n,) each


def find_edges(time: Array, level: Array) -> Edges:
    """Edges of a two-level signal: times, interpolated, at which it crosses its mid-level. It must
    then pass three quarters of its range, or falling one quarter, so that noise at the mid-level
    makes no edges. A level that has no two values has none, nor one whose last bit changes."""
    swing = float(np.ptp(level))
    middle = float(level.min()) + 0.5 * swing
    certain = np.flatnonzero(abs(level - middle) > 0.25 * swing)
    is_high = level[certain] > middle
    after = certain[1:][is_high[1:] != is_high[:-1]]
    is_pulses = (
        swing >= LEAST_SWING * float(np.abs(level).max(initial=0.0))
        and certain.size >= LEAST_CERTAIN * level.size
        and after.size <= max(MOST_EDGES * level.size, MINIMUM_EDGES)
    )
    if not is_pulses:
        after = after[:0]
    crossings = np.flatnonzero(np.diff(level > middle))
    before = crossings[np.searchsorted(crossings, after) - 1]
    fraction = (middle - level[before]) / (level[before + 1] - level[before])
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    edges = time[before] + fraction * (time[before + 1] - time[before])
    return edges, level[after] > level[before], step


def fit_clock(slave: Edges, master: Edges) -> ClockFit:
    """Match the edges by the pattern of their intervals, and fit offset and drift without outliers.
    An edge has the error of sampling, uniform within one interval."""
    ours, _, step = slave
    theirs, _, their_step = master
    noise = float(np.hypot(step, their_step)) / np.sqrt(12)
    limit = max(step, their_step)
    pairs = first_pairs(slave, master)
    matched = 0
    while pairs[0].size > matched:  # a line through the known pairs reaches further ones
        matched = pairs[0].size
        line, used = robust_line(*pairs, noise)
        pairs = pairs_near(line, pairs[0][used].mean(), slave, master)
    line, _ = robust_line(*pairs, noise)
    if line.residual > limit:
        raise InputError(
            f"the sync edges fit with a residual of {1e3 * line.residual:.2f} ms over"
            f" {line.edges} edges, within {1e3 * limit:.2f} ms is needed; check the sync cable and"
            " both sync channels"
        )
    expected = line.to_master(ours)
    common = (expected >= theirs[0] - limit) & (expected <= theirs[-1] + limit)
    return replace(line, excluded_edges=max(int(common.sum()) - line.edges, 0))


def first_pairs(slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of some edges on both clocks, (n,) each, from the first part of the slave's recording
    that tells the offset. Every pair of edges votes for one."""
    best = rival = 0
    for begin in range(0, slave[0].size, EDGES_TOGETHER):
        part = slice(begin, begin + EDGES_TOGETHER)
        time = slave[0][part]
        offsets = master[0][None, :] - time[:, None]
        is_same = slave[1][part, None] == master[1][None, :]
        width = 2.0 * (slave[2] + master[2]) + LARGEST_DRIFT * np.ptp(time)
        votes = np.sort(offsets[is_same])
        count = np.searchsorted(votes, votes + width, side="right") - np.arange(votes.size)
        best = int(count.max(initial=0))
        if best >= MINIMUM_EDGES:
            peak = votes[np.argmax(count)]
            rival = int(count[abs(votes - peak) > width].max(initial=0))
            if rival <= best // 2:
                agrees = is_same & (offsets >= peak) & (offsets <= peak + width)
                rows, columns = np.nonzero(agrees)
                return time[rows], master[0][columns]
    raise InputError(
        f"{best} sync edges of the log agree with motion capture's on one offset and {rival} on"
        f" another, {MINIMUM_EDGES} and twice as many are needed; check the sync cable and whether"
        " the log is this capture's, let the pulses vary in length, or record longer"
    )


def pairs_near(line: ClockFit, centre: float, slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of edges on both clocks, (n,) each, that lie within twice the sampling intervals of a
    line, and within its error, four standard deviations. Where that is larger, it tells none."""
    sampling = 2.0 * (slave[2] + master[2])
    error = 4.0 * line.drift_error * abs(slave[0] - centre)
    pairs = []
    for is_rising in (True, False):
        reached = (slave[1] == is_rising) & (error <= sampling)
        ours = slave[0][reached]
        theirs = master[0][master[1] == is_rising]
        expected = line.to_master(ours)
        nearest = theirs[np.searchsorted((theirs[1:] + theirs[:-1]) / 2, expected)]
        is_close = abs(nearest - expected) <= sampling + error[reached]
        pairs.append((ours[is_close], nearest[is_close]))
    first, second = (np.concatenate(column) for column in zip(*pairs, strict=True))
    return first, second


def robust_line(first: Array, second: Array, noise: float) -> tuple[ClockFit, NDArray[np.bool_]]:
    """Line through pairs of times (n,), and which of them were used, (n,). `noise` [s] is the
    standard deviation of one pair. The prior of `USUAL_DRIFT` keeps the drift plausible in a short
    recording. In a long one the pairs outweigh it. The differences of the times are fitted, so that
    large times lose no digits. Pairs more than 3.5 standard deviations from the median are
    outliers."""
    if first.size < MINIMUM_EDGES:
        raise InputError(
            f"{first.size} sync edges fit together, at least {MINIMUM_EDGES} are needed; record"
            " longer"
        )
    difference = second - first
    used = abs(difference - np.median(difference)) <= LARGEST_DRIFT * np.ptp(first) + 3.5 * noise
    for _ in range(10):
        centre, level = first[used].mean(), difference[used].mean()
        information = ((first[used] - centre) ** 2).sum() + (noise / USUAL_DRIFT) ** 2
        drift = ((first[used] - centre) * (difference[used] - level)).sum() / information
        residuals = difference - (level + drift * (first - centre))
        spread = 1.4826 * np.median(abs(residuals[used]))
        keep = abs(residuals) <= 3.5 * max(spread, noise)
        if keep.sum() < MINIMUM_EDGES or (keep == used).all():
            break
        used = keep
    line = ClockFit(
        float(level - drift * centre), float(drift), float(noise / np.sqrt(information))
    )
    residual = float(np.sqrt(((second[used] - line.to_master(first[used])) ** 2).mean()))
    return replace(line, residual=residual, edges=int(used.sum())), used


FEWEST_SAMPLES = 48  # of a shared signal
QUIET_SHARE = 0.05  # of a recording's variance, at least, where it hardly moves: noise would fit
LEAST_OVERLAP = 0.5  # share of the shorter recording
MOST_PEAKS = 3  # of the correlation, the highest ones, are compared
LEAST_ODDS = 1000.0  # of the best place of a shared angle, over any other
LEAST_MISFIT = 1e-3  # of the angle's SD: no two sensors of it agree better
MEAN_S = 0.05  # a sine of 5 Hz keeps nine tenths of its amplitude


def correlate_clocks(slave: Signal, master: Signal) -> ClockFit:
    """Fit a clock by a signal that both recorded, whose scale, offset and sign may differ: the
    likeliest peak of its correlation, refined by least squares.

    Raises
    ------
    InputError
        A signal is too short or constant, or another place is not far less likely.
    """
    fewest = min(slave[0].size, master[0].size)
    if fewest < FEWEST_SAMPLES or not min(np.ptp(slave[1]), np.ptp(master[1])) > 0:
        raise InputError(
            f"the shared signal of one recorder is constant or has fewer than {FEWEST_SAMPLES}"
            " samples; check the channel and its sensor, or record longer"
        )
    step = min(float(np.median(np.diff(time))) for time, _ in (slave, master))
    even = []
    for time, values in (slave, master):  # every `step` from the first sample on, without the mean
        on_grid = np.interp(np.arange(time[0], time[-1] + 1e-6 * step, step), time, values)
        even.append(on_grid - on_grid.mean())
    score = correlation(*even)
    peaks, _ = scipy.signal.find_peaks(np.pad(score, 1), prominence=0.5 * score.max())
    highest = peaks[np.argsort(score[peaks - 1])[-MOST_PEAKS:]]
    return likeliest(master[0][0] - slave[0][0] + step * (highest - even[0].size), slave, master)


def correlation(ours: Array, theirs: Array) -> Array:
    """Size of the correlation of two signals at every lag of `theirs` (m,) behind `ours` (n,), from
    1 - n on, over what overlaps; 0 where that is too little."""
    sums = partial(scipy.signal.correlate, method="fft")
    our_rows = np.ones_like(ours)
    their_rows = np.ones_like(theirs)
    power = np.maximum(sums(their_rows, ours**2), QUIET_SHARE * ours @ ours)
    power *= np.maximum(sums(theirs**2, our_rows), QUIET_SHARE * theirs @ theirs)
    overlaps = np.rint(sums(their_rows, our_rows)) >= LEAST_OVERLAP * min(ours.size, theirs.size)
    return np.where(overlaps, np.abs(sums(theirs, ours)) / np.sqrt(power), 0.0)


def likeliest(offsets: Array, slave: Signal, master: Signal) -> ClockFit:
    """Fit the clock at each of some offsets [s], (n,), and choose where the slave's signal is
    nearest to the master's.

    Raises
    ------
    InputError
        Another place, or none, is not far less likely.
    """
    fits = [refined(slave, master, offset) for offset in offsets.tolist()]
    misfits = [max(misfit, LEAST_MISFIT) for _, misfit, _ in fits] + [1.0]  # the last one: nowhere
    order: list[int] = np.argsort(misfits).tolist()
    best, second = order[:2]
    fit, _, independent = fits[best]
    likelihood = float((misfits[best] / misfits[second]) ** independent)
    if likelihood * LEAST_ODDS > 1:
        elsewhere = "nowhere"
        if second < len(offsets):
            elsewhere = f"elsewhere, {offsets[second] - offsets[best]:+.2f} s from the best place"
        raise InputError(
            f"the shared angle fits {elsewhere}, {likelihood:.2g} times as likely; check that both"
            " channels show the same movement, and record longer, with one that does not repeat"
        )
    return replace(fit, second_place=likelihood)


def refined(slave: Signal, master: Signal, offset: float) -> tuple[ClockFit, float, float]:
    """Refine a clock by least squares: the slave's signal is the master's, scaled and shifted, at
    the times of the clock. Both are means, or else noise would be motion where the joint rests.
    And tell what that leaves, as a share of the signal's SD, and its number of independent
    samples."""
    time, values = means_of(*slave)
    theirs = means_of(*master)
    inside = (time + offset >= theirs[0][0]) & (time + offset <= theirs[0][-1])
    time, values = time[inside], values[inside]
    centre = float(time.mean())
    of_crystals = 0.0  # scatter of the signal over that of the drift

    def misfit(unknown: Array) -> Array:
        scale, level, late, drift = unknown
        at = time + offset + late + drift * (time - centre)
        return np.append(values - level - scale * np.interp(at, *theirs), of_crystals * drift)

    line = np.polyfit(np.interp(time + offset, *theirs), values, 1)
    solution = scipy.optimize.least_squares(misfit, [*line, 0.0, 0.0], x_scale="jac")
    residual = solution.fun[:-1]
    independent = independent_samples(residual)
    scatter = float(np.std(residual)) * math.sqrt(time.size / independent)
    of_crystals = scatter / USUAL_DRIFT
    solution = scipy.optimize.least_squares(misfit, solution.x, x_scale="jac")
    jacobian = np.asarray(solution.jac)
    errors = scatter**2 * np.diag(np.linalg.pinv(jacobian.T @ jacobian)).clip(min=0.0)
    late, drift = solution.x[2:].tolist()
    fit = ClockFit(
        offset + late - drift * centre,
        drift,
        drift_error=math.sqrt(errors[3]),
        residual=math.sqrt(errors[2] + errors[3] * float(np.var(time))),
        method="correlation",
    )
    moves = float(np.std(values))
    return fit, float(np.std(residual)) / moves if moves else 1.0, independent


def means_of(time: Array, values: Array) -> Signal:
    """A signal averaged over `MEAN_S`."""
    width = max(round(MEAN_S * time.size / np.ptp(time)), 1)
    weights = np.full(width, 1 / width)
    return np.convolve(time, weights, "valid"), np.convolve(values, weights, "valid")


def independent_samples(residual: Array) -> float:
    """Number of independent samples whose mean square scatters as that of a residual (n,).

    It is n over the sum of the squares of the autocorrelation over all lags, which is that over the
    mean square of the spectrum at a mean of 1. The square of a periodogram is expected to be twice
    the squared spectrum, which the autocorrelation of one record would count as correlation.

    References
    ----------
    Bartlett, J. R. Stat. Soc. Suppl. 8 (1946) 27.
    """
    n = residual.size
    periodogram = np.abs(np.fft.rfft(residual - residual.mean())) ** 2
    inner = periodogram[1 : (n + 1) // 2]  # at frequencies whose real and imaginary parts are free
    mean_square_of_spectrum = float(np.mean(inner**2)) / 2
    if not mean_square_of_spectrum > 0:
        return 1.0
    return float(n * np.mean(inner) ** 2 / mean_square_of_spectrum)


def gate_fit(
    pulses: Edges, time: Array, angles: Callable[[], tuple[Signal, Signal]] | None = None
) -> ClockFit:
    """Fit a clock by a gate, which is high while the other recorder records: the log has a pulse
    that is as long as the capture. The log of a whole session has one for each capture; an angle
    that both recorded tells which is this one's.

    Parameters
    ----------
    pulses
        Edges in the log.
    time
        Of the capture's samples (n,) [s], the first at 0.
    angles
        Reads the angle in the log and in the capture.

    Raises
    ------
    InputError
        No pulse, or several pulses of the log are as long as the capture, and no angle tells which.
    """
    edges, is_rising, step = pulses
    capture_step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    length = float(np.ptp(time)) + capture_step
    slack = GATE_STEPS * max(step, capture_step) + LARGEST_DRIFT * length
    offsets = -edges[:-1][is_rising[:-1] & (np.abs(np.diff(edges) - length) <= slack)]
    residual = float(np.hypot(step, capture_step)) / np.sqrt(12)
    fit = ClockFit(0.0, 0.0, residual / length, residual, edges=2, method="gate")
    if offsets.size > 1 and angles is not None:
        by_angle = likeliest(offsets, *angles())
        fit = replace(fit, second_place=by_angle.second_place)
        offsets = offsets[[np.argmin(np.abs(offsets - by_angle.offset))]]
    if offsets.size != 1:
        raise InputError(
            "the sync line of motion capture has no edge: it is a gate, or nothing is connected,"
            f" and {offsets.size} pulses of the log are as long as the capture ({length:.3f} s);"
            " align the clocks by an angle that both recorded, `shared` in the capture's source"
            " file"
        )
    return replace(fit, offset=float(offsets[0]))


def aligned_clock(
    log: Converted, mocap: Converted, shared: SharedAngle | None, is_common: bool = False
) -> tuple[ClockFit, list[str]]:
    """Fit the log's clock to motion capture's.

    By sync edges; by the one pulse that is as long as the capture, where the capture's own level
    stands still; or else, with a warning, by the correlation of a shared angle.

    Parameters
    ----------
    shared
        What motion capture's source file names under `shared`.
    is_common
        Whether the log has the capture's times (`clock: common`).

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
    if is_common:
        start = log.facts["time"]["start"] - mocap.facts["time"]["start"]
        return ClockFit(start, method="common"), []
    angles = None if shared is None else partial(shared_angles, log, mocap, shared)
    missing = "the clocks cannot be aligned; map the channel in its source file"
    try:
        pulses = find_edges(*values_of(log, "sync", f"log: {missing}"))
        level = values_of(mocap, "sync", f"motion capture: {missing}")
        edges = find_edges(*level)
        fit = fit_clock(pulses, edges) if edges[0].size else gate_fit(pulses, level[0], angles)
        return fit, []
    except InputError as error:
        if angles is None or shared is None:
            raise
        refused = error
    what = f"'{shared.column}' and the angle at marker {shared.markers[1]}"
    try:
        fit = correlate_clocks(*angles())
    except InputError as error:
        raise InputError(
            f"{refused}; cross-correlation of {what} does not align them either: {error}"
        ) from error
    return fit, [
        f"clocks aligned by cross-correlation of {what}, elsewhere {fit.second_place:.1g} times as"
        f" likely, because of the sync edges: {refused}"
    ]


def shared_angles(log: Converted, mocap: Converted, shared: SharedAngle) -> tuple[Signal, Signal]:
    """Times [s] and values of an angle that both recorded: a column of the log, and that at the
    second of three markers, where all are seen."""
    in_log = values_of(log, shared.column, "log; map the channel in its source file")
    columns: list[str] = []
    for label in shared.markers:
        columns += marker_columns(label)
        if columns[-1] not in mocap.samples.columns:
            raise InputError(
                f"no marker '{label}', which `shared` names; correct the source file of motion"
                " capture"
            )
    seen = mocap.samples.select("time", *columns).fill_nan(None).drop_nulls()
    positions = seen.select(columns).to_numpy().reshape(-1, 3, 3)
    return in_log, (seen["time"].to_numpy(), angle_at(*positions.swapaxes(0, 1)))


def angle_at(first: Array, vertex: Array, last: Array) -> Array:
    """Angle (n,) [rad] at the second of three points, (n, 3) each."""
    one = first - vertex
    other = last - vertex
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    return np.asarray(np.arctan2(sine, (one * other).sum(axis=1)))


def values_of(recording: Converted, column: str, advice: str) -> tuple[Array, Array]:
    """Times [s] and values of a column where it was sampled. Raises InputError, with `advice`:
    there is no column."""
    if column not in recording.samples.columns:
        raise InputError(f"no column '{column}' from {advice}")
    rows = recording.samples.select("time", column).drop_nulls()
    return rows["time"].to_numpy(), rows[column].to_numpy()
