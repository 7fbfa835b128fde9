# SPDX-License-Identifier: Apache-2.0
"""Samples that leap off the curve of their neighbours. A flipped bit, a lost or an exchanged block
of a file, and a sensor that fails look alike in them."""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.measured import spoiled
from osl_analysis.base.trial import Array

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
LONGEST_SPAN = 1.17  # of a third difference, in usual ones: over a longer one rows are missing
# s, of a leap, where a joint turns: half a period of 5 Hz
AROUND_TURN_S = 0.1
EVEN_TURN = 0.5  # least share of the longer of both ways, which are as long where a joint turns
STEP_ROWS = 5  # around a leap, over which friction changes the torque


def find_leaps(time: Array, values: Array) -> Array:
    """Find the samples of a channel that leap off the curve of their neighbours.

    The curve is told by third differences, which a smooth motion hardly has. They are compared
    with the channel's own usual one, so that neither noise nor a coarse sensor is accused. Samples
    that leap there and back alone are told before (`measured.spoiled`).

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
    bends = np.diff(values[~is_spoiled], 3)
    if single.size:
        rows = np.flatnonzero(~is_spoiled)
        time, values = time[rows], values[rows]
        bends[rows[3:] - rows[:-3] > 3] = 0.0
    spans = time[3:] - time[:-3]
    is_gap = spans > LONGEST_SPAN * np.median(spans)
    bends[is_gap] = 0.0
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


def steps_by_friction(
    leaps: Array, angle: tuple[Array, Array], torque: tuple[Array, Array]
) -> NDArray[np.bool_]:
    """Whether a torque leaps as by friction at times (k,) [s]: the joint turns there, and the
    torque steps in the direction of the new motion. `angle` and `torque` are times [s] and
    values."""
    before = np.interp(leaps, *angle) - np.interp(leaps - AROUND_TURN_S, *angle)
    behind = np.interp(leaps, *angle) - np.interp(leaps + AROUND_TURN_S, *angle)
    ways = np.array([before, behind])
    lower, higher = np.sort(np.abs(ways), axis=0)
    is_turn = lower > EVEN_TURN * higher
    time, values = torque
    rows = np.searchsorted(time, leaps)[:, None] + np.arange(-STEP_ROWS, STEP_ROWS)
    beside = values[np.clip(rows, 0, values.size - 1)]
    step = beside[:, -1] - beside[:, 0]
    is_step = 2 * np.abs(step) > np.ptp(beside, axis=1)  # a wrong number comes back
    is_along = (ways * step < 0).all(axis=0)  # up in a trough, down at a peak
    return is_step & is_turn & is_along
