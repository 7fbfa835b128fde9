# SPDX-License-Identifier: Apache-2.0
"""Which samples of a stream are missing: the place of every sample in the device's count.

Without a counter, the place of a sample in the count comes from its stamp. A late sample and a
missing one both leave a long step. After a late sample, the level (stamp - count * step) returns to
its old value. After a missing one, it stays a step higher. Counting by steps fails if a host is
late and loses samples regularly. Then the spectrum of the stamps, |mean exp(2 pi i f t)|, shows the
device's rate: it has a line there, and none at the rate of the samples left.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array

LONG_STEP = 1.5  # a longer step, in usual steps, is a gap
# a step this long may hide a missing sample: the sample before it may have been late, hence not 2
SUSPECT_STEP = 1.3
# samples on either side of a long step whose levels are compared, or three times the step if longer
BESIDE = 100
# fewest samples for a meaningful line through the stamps, or a spline through the values
FEWEST_STAMPS = 20
SHORTEST_STEP_S = 1e-9  # s, where most rows share a stamp with the one before
MOST_LOST = 1000  # places of a count per sample; beyond it the stamps are those of batches
NEAR_WHOLE = 0.3  # distance in steps up to which steps are counted
LEFT_BY_MISSING = 0.7  # share of the squared residual that missing samples leave if there are any
BLOCK = 25  # samples, whose promptest is hardly late; a quarter miss none where 5 % are lost
ROUNDS = 2  # a sample that is found moves the levels of its neighbours
COMPLETE = 0.1  # quantile of the blocks that miss none
LARGEST_SCATTER_S = 5e-3  # s of a host; a larger step of a counted record is a jump of its clock
BINS_PER_STEP = 4  # of the histogram of stamps, whose spectrum is taken
LEAST_LINE = 6.0  # medians of the spectrum; noise reaches 4 at the highest of 100 000
LARGEST_LOSS = 1.1  # of a device's rate over that of the samples left: one in ten is lost
SampleCount = NDArray[np.int64]


def line_through(count: SampleCount, stamps: Array) -> tuple[float, float]:
    """Slope [s] and value [s] at count 0 of the least-squares line through stamps (n,) [s]."""
    x = count - count.mean()
    step = (x @ (stamps - stamps.mean())) / (x @ x)
    return step, stamps.mean() - step * count.mean()


def in_blocks(values: Array | SampleCount, size: int) -> Array:
    """Values (n,) in blocks (n // size, size), without the last few."""
    return np.asarray(values[: len(values) // size * size].reshape(-1, size))


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
        The counter does not rise, or the clock jumps while it runs on.
    """
    goes_back = np.diff(counter) <= 0
    if goes_back.any():
        row = np.argmax(goes_back)
        raise InputError(
            f"{name}: the sample counter goes from {counter[row]} to {counter[row + 1]} at"
            f" {stamps[row + 1]:.6f} s",
            "it must rise: cut the log there, or do not map the counter",
        )
    count = np.asarray(counter - counter[0], dtype=np.int64)

    step, _ = line_through(count, stamps)
    level = stamps - step * count
    row = np.argmax(np.abs(np.diff(level))) + 1
    jump = np.median(level[row : row + BESIDE]) - np.median(level[max(row - BESIDE, 0) : row])
    if abs(jump) > max(LARGEST_SCATTER_S, LONG_STEP * step):
        raise InputError(
            f"{name}: the clock jumps by {jump:.2g} s at {stamps[row]:.6f} s, row {row}, while"
            " the sample counter runs on",
            "cut the log there, or take the device's own clock as time source",
        )
    return count


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
    A sample is missing where the level of the stamps changes by a step for good. Of the counts at
    one rate and at changing rates, that with the smallest residual about the slow part of the
    stamps is taken, if its residual is clearly below that without missing samples. Missing samples
    make the estimate of a changing rate wrong, so it is repeated with those that were found.
    """
    rows = np.arange(len(stamps))
    steps = np.diff(stamps)
    usual = max(np.median(steps), SHORTEST_STEP_S)
    whole = np.maximum(np.rint(steps / usual), 1)
    is_count = whole.sum() < MOST_LOST * len(rows)
    if is_count and np.all(np.abs(steps - whole * usual) < NEAR_WHOLE * usual):
        return np.append(0, np.cumsum(whole.astype(np.int64)))

    def squares(count: SampleCount) -> float:
        step, start = line_through(count, stamps)
        return float(np.sum((stamps - step * count - start) ** 2))

    count = rows + np.cumsum(missing_before_samples(stamps))
    return count if squares(count) < LEFT_BY_MISSING * squares(rows) else rows


def missing_before_samples(stamps: Array) -> SampleCount:
    """Number of samples missing right before each sample, (n,), by the levels beside long steps.

    The level of a stretch is that of its promptest sample. The longest steps come first: else a
    late sample takes the place of one that is missing a few samples later.
    """
    missing = np.zeros(len(stamps), dtype=np.int64)
    step = usual_stamp_step(stamps)
    level = (stamps - stamps[0]) / step - np.arange(len(stamps))
    length = np.diff(stamps, prepend=stamps[0]) / step
    suspects = np.flatnonzero(length > SUSPECT_STEP)
    order = np.argsort(-np.minimum(np.rint(4 * length[suspects]), 8), kind="stable")
    longest_first = suspects[order].tolist()
    for row in ROUNDS * longest_first:
        most = max(round(length[row]) - 1, 1)
        # a burst of delayed samples fills a third of the window at most
        window = max(BESIDE, 3 * most)
        before = level[max(row - window, 0) : row]
        behind = level[row : row + window]
        if min(len(before), len(behind)) >= FEWEST_STAMPS:  # fewer at an end give no level
            rise = round(behind.min() - before.min())
            total = min(max(missing[row] + rise, 0), most)
            level[row:] -= total - missing[row]
            missing[row] = total
    return missing


def usual_stamp_step(stamps: Array) -> float:
    """Find a device's step [s] from its stamps (n,) [s], of which some are late and some missing.

    The promptest sample of each block is hardly late. From block to block its level changes by the
    error of the step. Blocks with missing samples change by whole steps and are left out.
    """
    n = len(stamps)
    block = min(BLOCK, n // 4)

    def changes(step: float) -> Array:
        late = in_blocks(stamps - step * np.arange(n), block)
        return np.diff(late.min(axis=1))

    mean = (stamps[-1] - stamps[0]) / (n - 1)  # too long by what is missing
    step = mean + np.quantile(changes(mean), COMPLETE) / block
    for _ in range(3):
        of_blocks = changes(step)
        is_complete = np.abs(of_blocks) <= 0.5 * step
        if is_complete.any():
            step += np.mean(of_blocks[is_complete]) / block
    return step if step > 0.5 * mean else mean


def missing_by_rhythm(stamps: Array) -> int | None:
    """Count the missing samples of a record by the spectrum of its stamps.

    Parameters
    ----------
    stamps : Array
        (n,) [s].

    Returns
    -------
    int or None
        The device's steps between the promptest samples at both ends, minus the samples between
        them. None if no line stands out of the spectrum.
    """
    n = len(stamps)
    duration = stamps[-1] - stamps[0]
    mean_hz = (n - 1) / duration
    late = in_blocks(stamps - np.arange(n) / mean_hz, BLOCK)
    prompt = stamps[np.arange(len(late)) * BLOCK + late.argmin(axis=1)]

    bins_hz = BINS_PER_STEP * mean_hz
    histogram = np.bincount(((prompt - stamps[0]) * bins_hz).astype(np.intp))
    lowest_hz = mean_hz - 10 / duration  # late stamps at the ends change the mean
    highest_hz = LARGEST_LOSS * mean_hz
    apart_hz = 0.1 / duration  # a tenth of what one missing sample changes
    lines = int((highest_hz - lowest_hz) / apart_hz)
    band = (lowest_hz, lowest_hz + lines * apart_hz)
    height = np.abs(scipy.signal.zoom_fft(histogram, band, lines, fs=bins_hz))
    line = np.argmax(height)
    if height[line] < LEAST_LINE * np.median(height):
        return None
    late = stamps * (lowest_hz + line * apart_hz) - np.arange(n)
    ends = min(2 * BESIDE, n // 4)  # samples, of which the promptest counts
    return max(round(float(late[-ends:].min() - late[:ends].min())), 0)
