"""One recorder's clock fitted to another's, t_master = offset + (1 + drift) * t_slave: by the edges
of a pulse train that both recorded; or else by the correlation of a joint's encoder with an angle
between markers, whose scale, offset and sign may differ."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.conversion import Converted
from osl_analysis.source_file import SharedAngle
from osl_analysis.trial import Array, marker_columns

MINIMUM_EDGES = 6
LARGEST_DRIFT = 500e-6  # between two crystal clocks
LEAST_CERTAIN = 0.5  # share of samples of a pulse near its two levels; of noise it is a twentieth
LEAST_SWING = 0.05  # of a line's largest level; less is the last bit of one level
MOST_EDGES = 0.2  # per sample; of the last bit of a level near 0 every second sample is one
LEAST_ODDS = 1000.0  # of the best place of a shared angle, over any other
MOST_LONGER = 10.0  # times as long a recording, for it to be a remedy
LEAST_MISFIT = 1e-3  # of the angle's SD: no two sensors of it agree better
GATE_STEPS = 3.0  # sampling intervals by which a gate may be longer or shorter than its capture


@dataclass(frozen=True)
class ClockFit:
    """A slave clock on a master clock."""

    offset: float  # master's time at the slave's time 0 [s]
    drift: float = 0.0  # relative difference of the clocks' rates [1]
    drift_error: float = 0.0  # standard error of the drift [1]
    residual: float = 0.0  # RMS of the residuals [s]
    edges: int = 0  # pairs of edges that were used; by correlation, sections of the recording
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
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    none = np.zeros(0), np.zeros(0, bool), step
    certain = np.flatnonzero(abs(level - middle) > 0.25 * swing)
    is_one_level = swing < LEAST_SWING * float(np.abs(level).max(initial=0.0))
    if is_one_level or certain.size < LEAST_CERTAIN * level.size:
        return none
    state = level[certain] > middle
    after = certain[1:][state[1:] != state[:-1]]
    if after.size > max(MOST_EDGES * level.size, MINIMUM_EDGES):
        return none
    crossings = np.flatnonzero(np.diff(level > middle))
    before = crossings[np.searchsorted(crossings, after) - 1]
    fraction = (middle - level[before]) / (level[before + 1] - level[before])
    return (
        time[before] + fraction * (time[before + 1] - time[before]),
        level[after] > level[before],
        step,
    )


def fit_clock(slave: Edges, master: Edges) -> ClockFit:
    """Match the edges by the pattern of their intervals, and fit offset and drift without outliers.
    An edge has the error of sampling, uniform within one interval."""
    for (times, _, _), who in ((slave, "the log"), (master, "motion capture")):
        if times.size < MINIMUM_EDGES:
            said = f"{times.size} sync edges in {who}, at least {MINIMUM_EDGES} are needed"
            raise InputError(f"{said}; check the sync cable, or record longer")
    (ours, rising, step), (theirs, theirs_rising, their_step) = slave, master
    noise, limit = float(np.hypot(step, their_step)) / np.sqrt(12), max(step, their_step)
    first, second = first_pairs(slave, master)
    reach = max(np.ptp(first), step)
    while reach <= 2 * np.ptp(ours):  # fit a line to the known pairs, reach twice as far, repeat
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
        said = (
            f"the sync edges fit with a residual of {1e3 * line.residual:.2f} ms over {used.sum()}"
            " edges"
        )
        raise InputError(
            f"{said}, within {1e3 * limit:.2f} ms is needed; check the sync cable and both sync"
            " channels"
        )
    expected = line.to_master(ours)
    common = (expected >= theirs[0] - limit) & (expected <= theirs[-1] + limit)
    return replace(line, excluded_edges=max(int(common.sum() - used.sum()), 0))


def first_pairs(slave: Edges, master: Edges) -> tuple[Array, Array]:
    """Times of some edges on both clocks, (n,) each, from the part of the slave's recording that
    fits best. Every pair of edges votes for an offset. The part is short enough that drift does not
    spread the votes."""
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
            f"{best} sync edges agree on one offset and {rival} on another, {MINIMUM_EDGES} and"
            " twice as many are needed; see whether the log is this capture's, let the pulses vary"
            " in length, or record longer"
        )
    return chosen


def robust_line(first: Array, second: Array, noise: float) -> tuple[ClockFit, NDArray[np.bool_]]:
    """Line through pairs of times (n,), and which of them were used, (n,). `noise` [s] is the
    standard deviation of one pair. A prior of 100 ppm, as between two crystal clocks, keeps the
    drift plausible in a short recording. In a long one the pairs outweigh it. The differences of
    the times are fitted, so that large times lose no digits. Pairs more than 3.5 standard
    deviations from the median are outliers."""
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
        information = ((first[used] - centre) ** 2).sum() + (noise / 100e-6) ** 2
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


SECTIONS = 12  # sections of the recording; their lags give the drift
ONE_SIGNAL = 0.5  # smallest correlation of two recordings of one signal
QUIET_SHARE = 0.05  # share of the recording's variance below which a section is not used


def correlate_clocks(slave: Signal, master: Signal) -> ClockFit:
    """Offset from the highest peak of the correlation of a signal; drift from the lags of twelve
    sections of the recording. In the result, `edges` counts the used sections, `excluded_edges`
    those that were quiet or did not fit."""
    if min(slave[0].size, master[0].size) < 4 * SECTIONS:
        raise InputError(f"fewer than {4 * SECTIONS} samples of the shared signal; record longer")
    step, limit = sorted(float(np.median(np.diff(time))) for time, _ in (slave, master))
    even = []
    for time, values in (slave, master):  # every `step` from the first sample on, without the mean
        on_grid = np.interp(np.arange(time[0], time[-1] + 1e-6 * step, step), time, values)
        even.append(on_grid - on_grid.mean())
    ours, theirs = even
    if not min(np.ptp(ours), np.ptp(theirs)) > 0:
        raise InputError(
            "the shared signal of one recorder is constant; check the channel and its sensor"
        )
    lag, second_place = whole_lag(ours, theirs, step)
    first, second = section_lags(ours, theirs, lag)
    if first.size < MINIMUM_EDGES:
        said = f"the shared signal moves in {first.size} of {SECTIONS} sections of the recording"
        raise InputError(f"{said}, at least {MINIMUM_EDGES} are needed; move the joint throughout")
    first, second, noise = slave[0][0] + step * first, master[0][0] + step * second, step
    for _ in range(3):  # the residual of the fit before is the noise of the next
        line, _ = robust_line(first, second, max(noise, 0.01 * step))
        noise = line.residual
    if noise > limit:
        said = (
            f"the lags of the shared signal scatter by {1e3 * noise:.2f} ms, within"
            f" {1e3 * limit:.2f} ms is needed"
        )
        raise InputError(f"{said}; check that both channels show the same thing")
    return replace(
        line,
        excluded_edges=SECTIONS - line.edges,
        method="correlation",
        second_place=second_place,
    )


def whole_lag(ours: Array, theirs: Array, step: float) -> tuple[int, float]:
    """Samples, `step` [s] apart, by which `theirs` (m,) lags `ours` (n,): at the highest absolute
    correlation with enough overlap. And the likelihood of the second-best place, over that."""
    from scipy.signal import fftconvolve  # half a second, which other trials need not wait for

    def over_overlap(x: Array, y: Array) -> Array:
        """Sums over the overlap at every lag of y (m,) behind x (n,)."""
        return np.asarray(fftconvolve(y, x[::-1]))

    one, other = np.ones(ours.size), np.ones(theirs.size)
    overlap = np.maximum(np.rint(over_overlap(one, other)), 1)
    sum_ours, sum_theirs = over_overlap(ours, other), over_overlap(one, theirs)
    covariance = over_overlap(ours, theirs) - sum_ours * sum_theirs / overlap
    # over a quiet overlap the coefficient would be noise: so its variance is taken as at least
    # QUIET_SHARE of the whole
    scatter_ours = np.maximum(
        over_overlap(ours**2, other) - sum_ours**2 / overlap, QUIET_SHARE * ours @ ours
    )
    scatter_theirs = np.maximum(
        over_overlap(one, theirs**2) - sum_theirs**2 / overlap, QUIET_SHARE * theirs @ theirs
    )
    enough = overlap >= 0.5 * min(ours.size, theirs.size)
    score = (abs(covariance) / np.sqrt(scatter_ours * scatter_theirs))[enough]
    best = int(np.argmax(score))
    if not score[best] >= ONE_SIGNAL:
        said = (
            f"the shared signal of both recorders correlates by {score[best]:.2f} at best,"
            f" {ONE_SIGNAL} is needed"
        )
        raise InputError(f"{said}; check that both channels show the same thing")
    lags = np.flatnonzero(enough) - (ours.size - 1)
    lag = int(lags[best])
    low = np.flatnonzero(score < 0.5 * score[best])
    before, after = low[low < best].max(initial=-1), low[low > best].min(initial=score.size)
    elsewhere = score.copy()
    elsewhere[before + 1 : after] = 0.0
    second = int(np.argmax(elsewhere))
    second_place = 0.0
    if elsewhere[second] > 0:
        best_misfit, second_misfit = np.sqrt(1 - np.minimum(score[[best, second]], 1.0) ** 2)
        where = f"{step * (lags[second] - lag):+.2f} s from the best"
        residual = residual_at(lag, ours, theirs)
        second_place = likelihood_elsewhere(residual, best_misfit, second_misfit, where)
    return lag, second_place


def residual_at(lag: int, ours: Array, theirs: Array) -> Array:
    """What a line through `theirs` (m,), that many samples behind, leaves of `ours` (n,)."""
    begin = max(0, -lag)
    end = min(ours.size, theirs.size - lag)
    return without_line(ours[begin:end], theirs[begin + lag : end + lag])


def without_line(angle: Array, other: Array) -> Array:
    """What another angle (n,), scaled and shifted, leaves of an angle (n,)."""
    columns = np.column_stack([other, np.ones_like(other)])
    return np.asarray(angle - columns @ np.linalg.lstsq(columns, angle, rcond=None)[0])


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
    log_odds = independent_samples(residual) * float(np.log(ratio))
    likelihood = float(np.exp(-max(log_odds, 0.0)))
    if likelihood <= 1 / LEAST_ODDS:
        return likelihood
    remedy = "add one movement that does not repeat"
    longer = float(np.log(LEAST_ODDS)) / log_odds if log_odds > 0 else np.inf
    if longer < MOST_LONGER:
        remedy = f"record {longer:.1f} times as long, or {remedy}"
    raise InputError(
        f"the shared angle fits elsewhere, {where}, {likelihood:.2g} times as likely (misfits"
        f" {other_misfit:.2g} and {misfit:.2g} of its SD); {remedy}"
    )


def section_lags(ours: Array, theirs: Array, lag: int) -> tuple[Array, Array]:
    """Middles of the sections of `ours`, and where they are in `theirs` [samples], (sections,)
    each, by a parabola through three samples. A section that is quiet, or fits best at an end of
    its range, is not used."""
    begin, end = max(0, -lag), min(ours.size, theirs.size - lag)
    length = (end - begin) // SECTIONS
    reach = int(np.ceil(LARGEST_DRIFT * ours.size)) + 8
    found = []
    for start in range(begin, begin + length * SECTIONS, length):
        part = ours[start : start + length]
        low, high = start + lag - reach, start + lag + length + reach
        if low < 0 or high > theirs.size or part.var() < QUIET_SHARE * ours.var():
            continue
        windows = np.lib.stride_tricks.sliding_window_view(theirs[low:high], part.size)
        scatter = np.maximum(windows.std(axis=1), np.finfo(float).tiny)
        score = abs(windows @ (part - part.mean())) / (scatter * part.std() * part.size)
        best = int(np.argmax(score))
        if best not in (0, score.size - 1) and score[best] >= ONE_SIGNAL:
            left, middle, right = score[best - 1 : best + 2]
            shift = best + 0.5 * (left - right) / (left - 2 * middle + right)
            found.append((start + length / 2, low + shift + length / 2))
    first, second = np.reshape(found, (-1, 2)).T
    return first, second


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
    missing = "the clocks cannot be aligned; map the channel in its source file"
    try:
        pulses = values_of(log, "sync", f"log: {missing}")
        level = values_of(mocap, "sync", f"motion capture: {missing}")
        edges = find_edges(*level)
        if edges[0].size:
            return fit_clock(find_edges(*pulses), edges), []
        angles = None if shared is None else partial(shared_angles, log, mocap, shared)
        return gate_fit(find_edges(*pulses), level[0], angles), []
    except InputError as error:
        if shared is None:
            raise
        refused = error
    what = f"'{shared.column}' and the angle at marker {shared.markers[1]}"
    try:
        fit = correlate_clocks(*shared_angles(log, mocap, shared))
    except InputError as error:
        raise InputError(
            f"{refused}; cross-correlation of {what} does not align them either: {error}"
        ) from error
    return fit, [
        f"clocks aligned by cross-correlation of {what}, elsewhere {fit.second_place:.1g} times as"
        f" likely, because of the sync edges: {refused}"
    ]


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
    edges, rising, step = pulses
    capture_step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    length = float(np.ptp(time)) + capture_step
    slack = GATE_STEPS * max(step, capture_step) + LARGEST_DRIFT * length
    starts: list[float] = []
    for begin, end, is_rise in zip(edges[:-1], edges[1:], rising[:-1], strict=True):
        if is_rise and abs(end - begin - length) <= slack:
            starts.append(float(begin))
    second_place = 0.0
    if len(starts) > 1 and angles is not None:
        start, second_place = likeliest_start(starts, *angles())
        starts = [start]
    if len(starts) != 1:
        remedy = "align the clocks by an angle that both recorded: `clock: shared`"
        if starts:
            remedy = "name the angle that both recorded, `shared` in the capture's source file"
        raise InputError(
            "the sync line of motion capture has no edge: it is a gate, or nothing is connected,"
            f" and {len(starts)} pulses of the log are as long as the capture ({length:.3f} s);"
            f" {remedy}"
        )
    residual = float(np.hypot(step, capture_step)) / np.sqrt(12)
    return ClockFit(
        -starts[0], 0.0, residual / length, residual, edges=2, method="gate",
        second_place=second_place,
    )  # fmt: skip


def likeliest_start(starts: Sequence[float], ours: Signal, theirs: Signal) -> tuple[float, float]:
    """Choose the time [s] in the log, of two or more, at which a capture began, and tell how likely
    the second-best one is, over it.

    It is where the angle of the log, scaled and shifted, is nearest to that of the capture.

    Raises
    ------
    InputError
        Another one is not far less likely.
    """
    time, angle = theirs
    residuals = [without_line(angle, np.interp(start + time, *ours)) for start in starts]
    misfits = np.std(residuals, axis=1) / max(float(np.std(angle)), np.finfo(float).tiny)
    best, second = np.argsort(misfits)[:2].tolist()
    where = f"at {starts[second]:.1f} s of the log in place of {starts[best]:.1f} s"
    second_place = likelihood_elsewhere(residuals[best], misfits[best], misfits[second], where)
    return float(starts[best]), second_place


def shared_angles(log: Converted, mocap: Converted, shared: SharedAngle) -> tuple[Signal, Signal]:
    """The angle that both recorded, in the log and in the capture."""
    in_log = values_of(log, shared.column, "log; map the channel in its source file")
    return in_log, marker_angle(mocap, shared)


def marker_angle(mocap: Converted, shared: SharedAngle) -> Signal:
    """Times [s] and the angle [rad] at the second of three markers, (n,) each, where all are
    seen."""
    columns: list[str] = []
    for label in shared.markers:
        names = marker_columns(label)
        if names[0] not in mocap.samples.columns:
            raise InputError(
                f"no marker '{label}', which `shared` names; correct the source file of motion"
                " capture"
            )
        columns += names
    seen = mocap.samples.select("time", *columns).fill_nan(None).drop_nulls()
    return seen["time"].to_numpy(), angle_at(
        *seen.select(columns).to_numpy().reshape(-1, 3, 3).swapaxes(0, 1)
    )


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
