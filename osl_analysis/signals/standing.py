# SPDX-License-Identifier: Apache-2.0
"""Channels that repeat one value: a sensor at an end of its range, and one that stands still."""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.measured import noise_of, spoiled
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import longest_of, run_edges

NO_EXTREME = 0.05  # share of the range: an extreme nearer to zero is an unloaded sensor
MIDDLE = 0.25  # share of the range: a value nearer to the median is no extreme
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
    """Whether a channel (n,) comes to all runs like one of equal values at speed. What comes to
    rest slows down: of its way to there, the last fifth takes more than its share of the time. A
    single value has no duration."""
    length = run.stop - run.start
    if length < 2:
        return True
    distance = np.abs(values - values[run.start])
    steps = np.abs(np.diff(values))
    step = steps[steps > 0].min(initial=np.inf)
    runs = run_edges(distance == 0)
    first = runs[np.diff(runs)[:, 0] > length // 2, 0]
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
    spans = np.maximum.reduceat(smooth, quarter) - np.minimum.reduceat(smooth, quarter)
    noise = noise_of(followed) / np.sqrt(rows)
    return edges[spans[::2] > max(least * np.ptp(followed), NOISE_SDS * noise)]
