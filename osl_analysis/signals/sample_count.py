# SPDX-License-Identifier: Apache-2.0
"""Which samples of a stream are missing: the place of every sample in the device's count.

Without a counter, the place of a sample in the count comes from its stamp. A late sample and a
missing one both leave a long step. After a late sample, the level (stamp - count * step) returns to
its old value. After a missing one, it stays a step higher.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array

LONG_STEP = 1.5  # a longer step, in usual steps, is a gap
# fewest samples for a meaningful line through the stamps, or a spline through the values
FEWEST_STAMPS = 20
STEP_ROUNDING = 1e-9  # s, where most rows share a stamp with the one before
MOST_LOST = 1000  # places of a count per sample; beyond it the stamps are those of batches
NEAR_WHOLE = 0.3  # distance in steps up to which steps are counted
LEFT_BY_MISSING = 0.7  # share of the squared residual that missing samples leave if there are any
STEPS = 5  # whose median gives the first guess of a step: most miss none where 5 % are lost
LARGEST_LOSS = 0.1  # of samples over those that are left
BEHIND = 25  # samples, of which the promptest is hardly late
# of the loop that follows the level: it settles within 1/GAIN rows, which waits of half a step and
# an error of the first guess of 1 % allow; critically damped
GAIN = 0.05
SLOPE_GAIN = GAIN**2 / 4
SampleCount = NDArray[np.int64]


def line_through(count: SampleCount, stamps: Array) -> tuple[float, float]:
    """Slope [s] and value [s] at count 0 of the least-squares line through stamps (n,) [s]."""
    x = count - count.mean()
    step = (x @ (stamps - stamps.mean())) / (x @ x)
    return step, stamps.mean() - step * count.mean()


def count_of_device(stamps: Array, counter: SampleCount, name: str) -> SampleCount:
    """The place of every sample in the count that the device writes.

    Parameters
    ----------
    stamps : Array
        (n,) [s].
    counter : SampleCount
        (n,) the device's own count.
    name : str
        Of the device, for messages.

    Returns
    -------
    SampleCount
        (n,) from 0. Missing samples leave places free.

    Raises
    ------
    InputError
        The counter does not rise.
    """
    goes_back = np.diff(counter) <= 0
    if goes_back.any():
        row = np.argmax(goes_back)
        raise InputError(
            f"{name}: the sample counter goes from {counter[row]} to {counter[row + 1]} at"
            f" {stamps[row + 1]:.6f} s",
            "it must rise: cut the log there, or do not map the counter",
        )
    return counter - counter[0]


def count_from_stamps(stamps: Array) -> SampleCount:
    """Find the place of every sample in the count from the stamps alone.

    Parameters
    ----------
    stamps : Array
        (n,) [s].

    Returns
    -------
    SampleCount
        (n,) from 0.

    Notes
    -----
    A sample is missing where the level of the stamps rises by a step for good. This count is taken
    if its squared residual about a line is clearly below that without missing samples.
    """
    rows = np.arange(len(stamps))
    steps = np.diff(stamps)
    usual = max(np.median(steps), STEP_ROUNDING)
    whole = np.maximum(np.rint(steps / usual), 1)
    is_count = whole.sum() < MOST_LOST * len(rows)
    if is_count and np.all(np.abs(steps - whole * usual) < NEAR_WHOLE * usual):
        return np.append(0, np.cumsum(whole.astype(np.int64)))

    def squares(count: SampleCount) -> float:
        step, start = line_through(count, stamps)
        return float(np.sum((stamps - step * count - start) ** 2))

    count = rows + missing_so_far(stamps)
    return count if squares(count) < LEFT_BY_MISSING * squares(rows) else rows


def missing_so_far(stamps: Array) -> SampleCount:
    """Number of samples missing before each sample, (n,), by the level of prompt stamps.

    No sample is later than those behind it allow: its level is the lowest of the next 25. A
    phase-locked loop follows this level as clocks creep; it rises for good where a sample is
    missing.
    """
    mean_step = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    step = float(np.median(stamps[STEPS:] - stamps[:-STEPS])) / STEPS
    if step < mean_step / (1 + LARGEST_LOSS):  # the stamps are those of batches
        step = mean_step
    level = (stamps - stamps[0]) / step - np.arange(len(stamps))
    prompt = scipy.ndimage.minimum_filter1d(level, BEHIND, origin=-(BEHIND // 2), mode="nearest")
    missing = np.zeros(len(stamps), dtype=np.int64)
    total = 0
    slope = 0.0
    followed = prompt[0]
    for row, place in enumerate(prompt.tolist()):
        total += round(place - followed - total)
        error = place - followed - total
        slope += SLOPE_GAIN * error
        followed += slope + GAIN * error
        missing[row] = total
    # a rise that comes back was one of samples that were all late
    missing = np.minimum.accumulate(missing[::-1])[::-1]
    return missing - missing[0]
