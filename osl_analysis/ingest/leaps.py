"""Samples of a channel that leap off the curve of their neighbours.

A flipped bit, a lost or an exchanged block of a file without checksums, and a sensor that fails
look alike in the samples. What did it, no file tells; so this only says where to look."""

import numpy as np

from osl_analysis.trial import Array

LARGEST_BEND = 10.0
"""Largest third difference of a sound channel, in units of its usual one. Sound benches, walking
ankles and prosthetic feet reach 5.0; a block of a file that was lost or exchanged usually passes
it."""

USUAL_BEND = 0.99
"""The quantile of a channel's third differences that counts as the usual one. The median would be
zero for a channel that mostly rests, or is coarse. What leaps more often is the channel's own, as a
stepper's steps."""

SOUND_BEND = 0.75
"""The quantile that wrong samples do not reach."""

SPOILED = 4  # third differences by a wrong sample

BOTH_WAYS = 0.75
"""Least size of a neighbouring third difference, in units of the largest, where one sample alone
is wrong: it leaps there and back. It is 1, and 0.5 where the channel stays on another level."""

MOST_OF_LARGE = 0.5  # of the large third differences: if more are of single samples, none is usual

SMALLEST_BEND = 1e-3
"""Smallest third difference of a leap, in units of the channel's range. Smaller ones change no K.
Without noise, as in a simulation, the usual third difference may be that of rounding, and each turn
of a slow ramp would pass for a leap."""

LARGEST_TURN = 0.5
"""Largest change of the slope at a leap, in units of the third difference. A leap leaves the slope
as it was. A corner of a sound curve, as where a motion begins or a foot hits, changes it by the
largest of its third differences or more."""

FEWEST_SAMPLES = 400  # of fewer, the third differences of one leap would be usual ones

LONGEST_STEP = 1.5  # of time, in usual steps: over a longer one rows are missing, a leap is due

MOST_GAPS = 0.01  # share of the steps that may be longer; if more are, the stamps scatter


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
    if values.size < FEWEST_SAMPLES:
        return time[:0]

    bends = np.diff(values, 3)
    bends[spans_a_gap(time)] = 0.0
    sizes = np.abs(bends)
    sound, usual = np.quantile(sizes, (SOUND_BEND, USUAL_BEND))
    if usual == 0.0:
        return time[:0]
    far = np.flatnonzero(sizes > LARGEST_BEND * sound)
    five_around = np.pad(bends, 2)[far[:, None] + np.arange(5)]
    turns = np.cumsum(five_around, axis=1).sum(axis=1)  # change of slope over five samples
    is_straight_on = np.abs(turns) < LARGEST_TURN * sizes[far]
    is_middle = sizes[far] == np.abs(five_around).max(axis=1)  # others are of the same leap
    is_leap = is_straight_on & is_middle

    opposite = -np.sign(bends[far])[:, None] * five_around[:, [1, 3]]
    is_single = is_leap & (opposite.max(axis=1) > BOTH_WAYS * sizes[far])
    spoiled = SPOILED * np.count_nonzero(is_single)
    are_usual = spoiled > max(MOST_OF_LARGE * far.size, (1 - USUAL_BEND) * sizes.size)
    if sound == 0.0 or not are_usual:
        limit = max(LARGEST_BEND * usual, SMALLEST_BEND * np.ptp(values))
        is_leap &= sizes[far] > limit
    # of the samples k to k + 3 of the largest third difference, k + 2 leaps, or the one before
    return np.asarray(time[far[is_leap] + 2])


def spans_a_gap(time: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether rows are missing among the four samples of each third difference, shape (n - 3,), of
    times (n,) [s]. Stamps that scatter tell no gaps."""
    steps = np.diff(time)
    is_gap = steps > LONGEST_STEP * np.median(steps)
    if np.mean(is_gap) > MOST_GAPS:
        is_gap[:] = False
    return is_gap[:-2] | is_gap[1:-1] | is_gap[2:]
