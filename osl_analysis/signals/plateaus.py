# SPDX-License-Identifier: Apache-2.0
"""Plateaus of a stepped current, and whether the shaft stands meanwhile: a clamped actuator."""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.measured import noise_of, spoiled
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import longest_of, run_edges, runs

AVERAGED_S = 0.05  # s; averaging time in the search for plateaus
LEVEL_CHANGE = 0.02  # of the current's range, by which means of a plateau differ at most
SHORTEST_LEVEL = 5  # changes between such means: a plateau of 0.3 s
SETTLING, ENDING = 3, 1  # means left out: the torque settles, and the filter spreads the next step
FEWEST_PARTS = 8  # of a recording, whose scatter, one left out at a time, gives an interval
LEAST_SPAN = 0.5  # of the current's range between plateaus; less are rests between two motions


def plateaus_of(time: Array, current: Array) -> list[slice]:
    """Find the plateaus of a stepped current.

    Parameters
    ----------
    time : Array
        Rising (n,) [s]; a bin of `AVERAGED_S` without a row ends a plateau.
    current : Array
        (n,) [A].

    Returns
    -------
    list of slice
        Rows in which means over `AVERAGED_S` change by less than 2 % of their range for 0.3 s or
        more. The first 0.15 s and the last 0.1 s are left out.
    """
    begins, number = bins_of(time)
    if len(begins) <= SHORTEST_LEVEL:
        return []
    stops = np.append(begins[1:], len(time))
    means = means_from(begins, current)
    span = np.ptp(means)
    is_steady = (np.abs(np.diff(means)) < LEVEL_CHANGE * span) & (np.diff(number) == 1)

    plateaus = []
    for run in runs(is_steady):
        if run.stop - run.start >= SHORTEST_LEVEL:
            last = run.stop - 1 - ENDING  # the last mean of the run is number run.stop
            plateaus.append(slice(begins[run.start + SETTLING], stops[last]))
    return plateaus


def bins_of(time: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First rows (k,) of the bins of rising times (n,) [s], and their numbers."""
    usual_step = np.median(np.diff(time)) if len(time) > 1 else 0.0
    # a hundredth of a step, so that rounding does not move rows to the bin before
    number = np.floor((time - time[0] + 0.01 * usual_step) / AVERAGED_S).astype(np.intp)
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    return begins, number[begins]


def means_from(begins: NDArray[np.intp], values: Array) -> Array:
    """Means (k,) of values (n,) over bins that begin at these rows (k,)."""
    rows = np.diff(np.append(begins, len(values)))
    return np.add.reduceat(values, begins) / rows


def is_clamped(
    time: Array,
    current: Array,
    plateaus: Sequence[slice],
    motion: Array | None,
    is_angle: bool,
    slowest: float,
) -> bool:
    """Whether a shaft stands at the plateaus of its current; it may twitch between them.

    Parameters
    ----------
    time, current : Array
        (n,) [s], [A].
    plateaus : sequence of slice
        Of the current (`plateaus_of`).
    motion : Array or None
        Angle (n,) [rad] or velocity [rad/s] of the shaft, which may be noisy; None: not recorded.
    is_angle : bool
        Which of the two it is.
    slowest : float
        Velocity [rad/s] below which the shaft stands.
    """
    if len(plateaus) < FEWEST_PARTS:
        return False
    begins, _ = bins_of(time)
    levels = [current[level].mean() for level in plateaus]
    if np.ptp(levels) < LEAST_SPAN * np.ptp(means_from(begins, current)):
        return False
    if motion is None:
        return True
    speeds = [motion[level].mean() for level in plateaus]
    if is_angle:
        speeds = [np.polyfit(time[level], motion[level], 1)[0] for level in plateaus]
    return bool(np.median(np.abs(speeds)) < slowest)


# Samples that leap off the curve of their neighbours. A flipped bit, a lost or an exchanged block
# of a file, and a sensor that fails look alike in them.

# Of third differences of a channel, which a smooth motion hardly has: usual ones, of a sound
# channel. Sound benches, walking ankles and prosthetic feet reach 5.0; a block of a file that was
# lost or exchanged usually passes it.
LARGEST_BEND = 10.0
# The quantile that counts as the usual one. The median would be zero for a channel that mostly
# rests, or is coarse. What leaps more often is the channel's own, as a stepper's steps.
USUAL_BEND = 0.99
# Change of the slope at a leap, in units of the third difference. A leap leaves the slope as it
# was. A corner of a sound curve changes it by the largest of its third differences or more.
LARGEST_TURN = 0.5
FEWEST_SAMPLES = 400  # of fewer, the third differences of one leap would be usual ones
# quantiles of a channel between which its range is taken, without what leaps
MOST_OF_RANGE = (0.005, 0.995)
MOVES_S = 0.1  # s, within which a channel moves by more than it creeps (`LEAST_CHANGE`), or rests
LONGEST_SPAN = 1.17  # of a third difference, in usual ones: over a longer one rows are missing
# s, of a leap, where a joint turns: half a period of 5 Hz, and less where a motion begins or ends
AROUND_TURN_S = np.array([[0.1], [0.05], [0.025]])
EVEN_TURN = 0.5  # least share of the longer of both ways, which are as long where a joint turns
STEP_ROWS = 5  # around a leap, over which friction changes the torque


def find_leaps(time: Array, values: Array) -> Array:
    """Find the samples of a channel that leap off the curve of their neighbours.

    The curve is told by third differences, which a smooth motion hardly has. They are compared
    with the channel's own usual one where it moves, so that neither noise nor a coarse sensor nor a
    motion before a long rest is accused. Samples that leap there and back alone are told before
    (`measured.spoiled`).

    Parameters
    ----------
    time : Array
        Times of the samples [s], shape (n,).
    values : Array
        The samples in any unit, shape (n,). NaN is left out.

    Returns
    -------
    Array
        Times of the leaps [s]: a single wrong number is one, a block of them two. None if the
        channel is short or hardly ever moves.
    """
    seen = np.isfinite(values)
    time, values = time[seen], values[seen]
    if values.size < FEWEST_SAMPLES:
        return time[:0]

    is_spoiled = spoiled(values)
    single = time[is_spoiled]
    time, values = time[~is_spoiled], values[~is_spoiled]
    is_moving = moving(time, values)
    if is_moving.sum() >= FEWEST_SAMPLES:
        time, values = time[is_moving], values[is_moving]
    bends = np.diff(values, 3)
    spans = time[3:] - time[:-3]
    bends[spans > LONGEST_SPAN * np.median(spans)] = 0.0
    sizes = np.abs(bends)
    usual = np.quantile(sizes, USUAL_BEND)
    if usual == 0.0:
        return single
    far = np.flatnonzero(sizes > LARGEST_BEND * usual)
    five_around = np.pad(bends, 2)[far[:, None] + np.arange(5)]
    turns = np.cumsum(five_around, axis=1).sum(axis=1)  # change of slope over five samples
    is_straight_on = np.abs(turns) < LARGEST_TURN * sizes[far]
    is_middle = sizes[far] == np.abs(five_around).max(axis=1)  # others are of the same leap
    # of the samples k to k + 3 of the largest third difference, k + 2 leaps, or the one before
    return np.sort(np.append(single, time[far[is_straight_on & is_middle] + 2]))


def moving(time: Array, values: Array) -> NDArray[np.bool_]:
    """Where a channel (n,) moves: its range within `MOVES_S` is more than it creeps by at rest."""
    rows = max(round(MOVES_S * time.size / np.ptp(time)), 3)
    ranges = scipy.ndimage.maximum_filter1d(values, rows) - scipy.ndimage.minimum_filter1d(
        values, rows
    )
    creeping = LEAST_CHANGE * np.ptp(np.quantile(values, MOST_OF_RANGE))
    is_moving: NDArray[np.bool_] = ranges > creeping
    return is_moving


def steps_by_friction(
    leaps: Array, angle: tuple[Array, Array], torque: tuple[Array, Array]
) -> NDArray[np.bool_]:
    """Whether a torque leaps as by friction at times (k,) [s]: the joint turns there, and the
    torque steps in the direction of the new motion. `angle` and `torque` are times [s] and
    values."""
    before = np.interp(leaps, *angle) - np.interp(leaps - AROUND_TURN_S, *angle)
    behind = np.interp(leaps, *angle) - np.interp(leaps + AROUND_TURN_S, *angle)
    ways = np.array([before, behind])  # (2, 3, k): before and behind, at each distance
    lower, higher = np.sort(np.abs(ways), axis=0)
    is_turn = lower > EVEN_TURN * higher
    time, values = torque
    rows = np.searchsorted(time, leaps)[:, None] + np.arange(-STEP_ROWS, STEP_ROWS)
    neighbours = values[np.clip(rows, 0, values.size - 1)]
    step = neighbours[:, -1] - neighbours[:, 0]
    is_step = 2 * np.abs(step) > np.ptp(neighbours, axis=1)  # a wrong number comes back
    is_along = (ways * step < 0).all(axis=0)  # up in a trough, down at a peak
    return is_step & (is_turn & is_along).any(axis=0)


# Channels that repeat one value: a sensor at an end of its range, and one that stands still.

NO_EXTREME = 0.05  # share of the range: an extreme nearer to zero is an unloaded sensor
MIDDLE = 0.25  # share of the range: a value nearer to the median is no extreme
# steps: what is within one of a parabola's peak has fallen by four when it is twice as far from the
# peak; one more for rounding
PEAK_STEPS = 5.0
APPROACH_STEPS = (5.0, 25.0)  # the last fifth of a channel's way to where it stands, and all of it
# Of the time for this way: the last fifth takes 0.2 at an even speed, 0.29 to a rail five steps
# below a peak, and 0.36 or more where the channel slows down to rest.
LAST_SHARE = 0.33
LEAST_CHANGE = 0.005  # share of a reference's range; one at rest creeps by less
LEAST_STANDING = 5  # samples; a peak may have as many
MEAN_S = 0.05  # s of means of a reference; a sine of 5 Hz keeps nine tenths of its amplitude
NOISE_SDS = 8.0  # of such a mean, that are a change
MOST_REPEATED = 0.3  # share of a channel's samples; a command, whose levels have no noise, has more


def repeats(values: Array) -> NDArray[np.intp]:
    """First row and row after the last, (k, 2), of each run of two or more equal values (n,)."""
    edges = run_edges(np.diff(values) == 0)
    edges[:, 1] += 1
    return edges


def has_levels(values: Array) -> bool:
    """Whether a channel (n,) has levels without noise, apart from its longest run."""
    lengths = np.diff(repeats(values)) - 1
    return bool(lengths.sum() - lengths.max(initial=0) > MOST_REPEATED * values.size)


def run_at_extreme(values: Array, standing: NDArray[np.intp] | None = None) -> slice:
    """Find the longest run of a channel at its lowest or highest value.

    It is one sample, or many if the channel is clipped. Values near zero (an unloaded sensor) or
    near the median do not count, nor the peak of a slow signal, which repeats a value, too.

    Parameters
    ----------
    values : Array
        (n,).
    standing : Array, optional
        (k, 2), the only runs that count (`standing_runs`), of a channel without noise.

    Returns
    -------
    slice
        Rows of the run; empty if there is none, or if a value is not finite.
    """
    longest = slice(0, 0)
    span = np.ptp(values)
    middle = np.median(values)
    for end in (values.min(), values.max()):
        if abs(end) > NO_EXTREME * span and abs(end - middle) > MIDDLE * span:
            runs = run_edges(values == end)
            if standing is not None:
                runs = standing[values[standing[:, 0]] == end]
            run = longest_of(runs)
            if values[run].size > values[longest].size and has_corners(values, run):
                longest = run
    return longest


def has_corners(values: Array, run: slice) -> bool:
    """Whether a channel (n,) is far from a run of equal values, half as long before and after, and
    comes to all such runs at speed. What comes to rest slows down: of its way to there, the last
    fifth takes more than its share of the time. A single value has no duration."""
    half = (run.stop - run.start) // 2
    if half == 0:
        return True
    distance = np.abs(values - values[run.start])
    steps = np.abs(np.diff(values))
    step = steps[steps > 0].min(initial=np.inf)
    around = np.pad(distance, half, constant_values=np.inf)
    if around[[run.start, run.stop - 1 + 2 * half]].min() <= PEAK_STEPS * step:
        return False
    runs = run_edges(distance == 0)
    first = runs[np.diff(runs)[:, 0] > half, 0]
    rows_of_ways = []  # of its last fifth, and of all of it
    for way in APPROACH_STEPS:
        away = np.append(-1, np.flatnonzero(distance > way * step))
        last_away = away[np.searchsorted(away, first) - 1]
        rows_of_ways.append(np.sum(first - 1 - last_away))
    last_fifth, whole_way = rows_of_ways
    return bool(last_fifth <= LAST_SHARE * whole_way + 1)


def standing_runs(
    time: Array, values: Array, reference: tuple[Array, Array], least: float = LEAST_CHANGE
) -> NDArray[np.intp]:
    """Find where a channel repeats one value although a reference changes.

    Parameters
    ----------
    time : Array
        (n,) [s].
    values : Array
        (n,).
    reference : (Array, Array)
        Times [s] and values of another channel.
    least : float
        By which share of its range the reference changes.

    Returns
    -------
    Array
        First row and row after the last of each run, (k, 2). The reference changes in the third
        quarter of it: at rest it settles, and it may be earlier or later at both ends.
    """
    every = repeats(values)
    edges: NDArray[np.intp] = every[np.diff(every)[:, 0] > LEAST_STANDING]
    if not edges.size or time[0] == time[-1]:
        return edges[:0]
    is_sound = ~spoiled(reference[1])
    followed = np.interp(time, reference[0][is_sound], reference[1][is_sound])
    rows = max(round(MEAN_S * time.size / np.ptp(time)), 1)
    smooth = scipy.ndimage.uniform_filter1d(followed, rows)
    quarter = np.rint(edges[:, :1] + np.diff(edges) * [0.5, 0.75]).astype(np.intp).ravel()
    spans = (np.maximum.reduceat(smooth, quarter) - np.minimum.reduceat(smooth, quarter))[::2]
    changes = spans > least * np.ptp(followed)
    if changes.any():
        changes &= spans > NOISE_SDS * noise_of(followed) / np.sqrt(rows)
    return edges[changes]
