"""Samples of a channel that leap off the curve of their neighbours.

A flipped bit, a lost or an exchanged block of a file without checksums, and a sensor that fails
look alike in the samples. What did it, no file tells; so this only says where to look."""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.ingest import LIMITS
from osl_analysis.trial import Array


def find_leaps(time: Array, values: Array) -> Array:
    """Find the samples of a channel that leap off the curve of their neighbours.

    The curve is told by third differences, which a smooth motion hardly has. They are compared
    with the channel's own usual one, so that neither noise nor a coarse sensor is accused; and with
    that of three quarters of the samples, where samples that leap there and back alone make most of
    the large ones.

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
    if values.size < LIMITS.fewest_samples:
        return time[:0]

    bends = np.diff(values, 3)
    bends[spans_a_gap(time)] = 0.0
    sizes = np.abs(bends)
    sound, usual = np.quantile(sizes, (LIMITS.sound_bend, LIMITS.usual_bend))
    if usual == 0.0:
        return time[:0]
    far = np.flatnonzero(sizes > LIMITS.largest_bend * sound)
    five_around = np.pad(bends, 2)[far[:, None] + np.arange(5)]
    turns = np.cumsum(five_around, axis=1).sum(axis=1)  # change of slope over five samples
    is_straight_on = np.abs(turns) < LIMITS.largest_turn * sizes[far]
    is_middle = sizes[far] == np.abs(five_around).max(axis=1)  # others are of the same leap
    is_leap = is_straight_on & is_middle

    opposite = -np.sign(bends[far])[:, None] * five_around[:, [1, 3]]
    is_single = is_leap & (opposite.max(axis=1) > LIMITS.both_ways * sizes[far])
    spoiled = LIMITS.spoiled * np.count_nonzero(is_single)
    are_usual = spoiled > max(LIMITS.most_of_large * far.size, (1 - LIMITS.usual_bend) * sizes.size)
    if sound == 0.0 or not are_usual:
        limit = max(LIMITS.largest_bend * usual, LIMITS.smallest_bend * np.ptp(values))
        is_leap &= sizes[far] > limit
    # of the samples k to k + 3 of the largest third difference, k + 2 leaps, or the one before
    return np.asarray(time[far[is_leap] + 2])


def spans_a_gap(time: Array) -> NDArray[np.bool_]:
    """Whether rows are missing among the four samples of each third difference, shape (n - 3,), of
    times (n,) [s]. Stamps that scatter tell no gaps."""
    steps = np.diff(time)
    is_gap: NDArray[np.bool_] = steps > LIMITS.longest_step * np.median(steps)
    if np.mean(is_gap) > LIMITS.most_gaps:
        is_gap[:] = False
    return is_gap[:-2] | is_gap[1:-1] | is_gap[2:]
