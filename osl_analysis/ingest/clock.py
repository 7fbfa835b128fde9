"""One recorder's clock fitted to another's, t_master = offset + (1 + drift) * t_slave: by the edges
of a pulse train that both recorded; by a gate that is high while the other one records; or else by
the correlation of a joint's encoder with an angle between markers, whose scale, offset and sign may
differ."""

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
    is_one_level = swing < LEAST_SWING * float(np.abs(level).max(initial=0.0))
    is_noise = certain.size < LEAST_CERTAIN * level.size
    if is_one_level or is_noise or after.size > max(MOST_EDGES * level.size, MINIMUM_EDGES):
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
    for (times, _, _), who in ((slave, "the log"), (master, "motion capture")):
        if times.size < MINIMUM_EDGES:
            raise InputError(
                f"{times.size} sync edges in {who}, at least {MINIMUM_EDGES} are needed; check the"
                " sync cable, or record longer"
            )
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
        f"{best} sync edges agree on one offset and {rival} on another, {MINIMUM_EDGES} and twice"
        " as many are needed; see whether the log is this capture's, let the pulses vary in length,"
        " or record longer"
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
    if used.sum() < MINIMUM_EDGES:
        used[:] = True
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
ONE_SIGNAL = 0.5  # smallest correlation of two recordings of one signal
QUIET_SHARE = 0.05  # of a recording's variance, at least, where it hardly moves: noise would fit
LEAST_OVERLAP = 0.5  # share of the shorter recording
LEAST_ODDS = 1000.0  # of the best place of a shared angle, over any other
MOST_LONGER = 10.0  # times as long a recording, for it to be a remedy
LEAST_MISFIT = 1e-3  # of the angle's SD: no two sensors of it agree better
MEAN_S = 0.05  # a sine of 5 Hz keeps nine tenths of its amplitude
REFINEMENTS = 5  # each leaves a small share of the lag before


def correlate_clocks(slave: Signal, master: Signal) -> ClockFit:
    """Fit a clock by a signal that both recorded, whose scale, offset and sign may differ: the
    highest peak of its correlation, refined by least squares.

    Raises
    ------
    InputError
        A signal is too short or constant, both do not show the same, or another place is not far
        less likely.
    """
    fewest = min(slave[0].size, master[0].size)
    if fewest < FEWEST_SAMPLES or not min(np.ptp(slave[1]), np.ptp(master[1])) > 0:
        raise InputError(
            f"the shared signal of one recorder is constant or has fewer than {FEWEST_SAMPLES}"
            " samples; check the channel and its sensor, or record longer"
        )
    step, limit = sorted(float(np.median(np.diff(time))) for time, _ in (slave, master))
    even = []
    for time, values in (slave, master):  # every `step` from the first sample on, without the mean
        on_grid = np.interp(np.arange(time[0], time[-1] + 1e-6 * step, step), time, values)
        even.append(on_grid - on_grid.mean())
    score = correlation(*even)
    best = int(np.argmax(score))
    if not score[best] >= ONE_SIGNAL:
        raise InputError(
            f"the shared signal of both recorders correlates by {score[best]:.2f} at best,"
            f" {ONE_SIGNAL} is needed; check that both channels show the same thing"
        )
    lag_s = step * (best - even[0].size + 1)
    fit, residual = refined(slave, master, ClockFit(master[0][0] + lag_s - slave[0][0]))
    if fit.residual > limit:
        raise InputError(
            f"the shared signal tells the times to {1e3 * fit.residual:.2f} ms, within"
            f" {1e3 * limit:.2f} ms is needed; check that both channels show the same thing"
        )
    low = np.flatnonzero(score < 0.5 * score[best])
    elsewhere = score.copy()
    elsewhere[low[low < best].max(initial=-1) + 1 : low[low > best].min(initial=score.size)] = 0.0
    second = int(np.argmax(elsewhere))
    misfit, other_misfit = np.sqrt(1 - np.minimum(score[[best, second]], 1.0) ** 2).tolist()
    where = f"{step * (second - best):+.2f} s from the best"
    second_place = likelihood_elsewhere(residual, misfit, other_misfit, where)
    return replace(fit, second_place=second_place)


def correlation(ours: Array, theirs: Array) -> Array:
    """Size of the correlation of two signals at every lag of `theirs` (m,) behind `ours` (n,), from
    1 - n on, over what overlaps; 0 where that is too little."""

    def sums(x: Array, y: Array) -> Array:
        return np.asarray(scipy.signal.fftconvolve(y, x[::-1]))

    one, other = np.ones_like(ours), np.ones_like(theirs)
    count = np.maximum(np.rint(sums(one, other)), 1)
    sum_ours = sums(ours, other)
    sum_theirs = sums(one, theirs)
    scatter_ours = sums(ours**2, other) - sum_ours**2 / count
    scatter_theirs = sums(one, theirs**2) - sum_theirs**2 / count
    product = np.maximum(scatter_ours, QUIET_SHARE * ours @ ours)
    product *= np.maximum(scatter_theirs, QUIET_SHARE * theirs @ theirs)
    score = np.abs(sums(ours, theirs) - sum_ours * sum_theirs / count) / np.sqrt(product)
    return np.where(count >= LEAST_OVERLAP * min(ours.size, theirs.size), score, 0.0)


def refined(slave: Signal, master: Signal, fit: ClockFit) -> tuple[ClockFit, Array]:
    """Refine a clock by least squares: the slave's signal is the master's, scaled and shifted, plus
    its slope times what the clock is late. And what that leaves of the slave's signal."""
    # of a mean, or else noise would be motion where the joint rests
    width = max(round(MEAN_S * master[0].size / np.ptp(master[0])), 1)
    smooth = scipy.ndimage.uniform_filter1d(master[1], width)
    slope_of_master = np.gradient(smooth, master[0])
    variance = float(np.var(slave[1]))
    for _ in range(REFINEMENTS):
        at = fit.to_master(slave[0])
        inside = (at >= master[0][0]) & (at <= master[0][-1])
        time = slave[0][inside] - slave[0][inside].mean()
        signal = np.interp(at[inside], *master)
        slope = np.interp(at[inside], master[0], slope_of_master)
        columns = np.column_stack([signal - signal.mean(), np.ones_like(time), slope, slope * time])
        values = slave[1][inside]
        information = columns.T @ columns
        scale = float(columns[:, 0] @ values) / information[0, 0]
        known = columns.T @ values
        of_crystals = variance / (scale * USUAL_DRIFT) ** 2
        information[3, 3] += of_crystals
        known[3] -= of_crystals * scale * fit.drift
        solution = np.linalg.solve(information, known)
        residual = values - columns @ solution
        variance = float(residual @ residual) / independent_samples(residual)
        late, drift = solution[2:] / scale
        mean = slave[0][inside].mean()
        fit = replace(fit, offset=fit.offset + late - drift * mean, drift=fit.drift + drift)
    errors = variance * np.diag(np.linalg.inv(information))[2:] / scale**2
    return replace(
        fit,
        drift_error=float(np.sqrt(errors[1])),
        residual=float(np.sqrt(errors[0] + errors[1] * np.var(time))),
        method="correlation",
    ), residual


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


def likelihood_elsewhere(residual: Array, misfit: float, other_misfit: float, where: str) -> float:
    """Tell how likely a shared angle is at another place, over that at the best one.

    Parameters
    ----------
    residual
        At the best place (n,).
    misfit, other_misfit
        RMS of the residuals at the best and at the other place, as shares of the angle's SD.
    where
        The other place, for the message.

    Raises
    ------
    InputError
        It is not far less likely.
    """
    ratio = max(other_misfit, LEAST_MISFIT) / max(misfit, LEAST_MISFIT)
    log_odds = max(independent_samples(residual) * float(np.log(ratio)), 0.0)
    needed = float(np.log(LEAST_ODDS))
    if log_odds >= needed:
        return float(np.exp(-log_odds))
    remedy = "add one movement that does not repeat"
    if MOST_LONGER * log_odds > needed:
        remedy = f"record {needed / log_odds:.1f} times as long, or {remedy}"
    raise InputError(
        f"the shared angle fits elsewhere, {where}, {np.exp(-log_odds):.2g} times as likely"
        f" (misfits {other_misfit:.2g} and {misfit:.2g} of its SD); {remedy}"
    )


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
    starts = edges[:-1][is_rising[:-1] & (np.abs(np.diff(edges) - length) <= slack)]
    second_place = 0.0
    if starts.size > 1 and angles is not None:
        starts, second_place = likeliest_start(starts, *angles())
    if starts.size != 1:
        remedy = "align the clocks by an angle that both recorded: `clock: shared`"
        if starts.size:
            remedy = "name the angle that both recorded, `shared` in the capture's source file"
        raise InputError(
            "the sync line of motion capture has no edge: it is a gate, or nothing is connected,"
            f" and {starts.size} pulses of the log are as long as the capture ({length:.3f} s);"
            f" {remedy}"
        )
    residual = float(np.hypot(step, capture_step)) / np.sqrt(12)
    return ClockFit(
        -float(starts[0]), 0.0, residual / length, residual, edges=2, method="gate",
        second_place=second_place,
    )  # fmt: skip


def likeliest_start(starts: Array, ours: Signal, theirs: Signal) -> tuple[Array, float]:
    """Choose the time [s] in the log, of two or more, at which a capture began, (1,), and tell how
    likely the second-best one is, over it.

    It is where the angle of the log, scaled and shifted, is nearest to that of the capture.

    Raises
    ------
    InputError
        Another one is not far less likely.
    """
    time, angle = theirs
    residuals = []
    for start in starts:
        columns = np.column_stack([np.interp(start + time, *ours), np.ones_like(time)])
        residuals.append(angle - columns @ np.linalg.lstsq(columns, angle, rcond=None)[0])
    misfits = np.std(residuals, axis=1) / max(float(np.std(angle)), np.finfo(float).tiny)
    best, second = np.argsort(misfits)[:2].tolist()
    where = f"at {starts[second]:.1f} s of the log in place of {starts[best]:.1f} s"
    likelihood = likelihood_elsewhere(residuals[best], misfits[best], misfits[second], where)
    return starts[[best]], likelihood


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
