# SPDX-License-Identifier: Apache-2.0
"""Which samples of a stream are missing: the place of every sample in the device's count.

Without a counter, the place of a sample in the count comes from its stamp. A late sample and a
missing one both leave a long step. After a late sample, the level (stamp - count * step) returns to
its old value. After a missing one, it stays a step higher. Counting by steps fails if a host is
late and loses samples regularly. Then the spectrum of the stamps, |mean exp(2 pi i f t)|, shows the
device's rate: it has a line there, and none at the rate of the samples left.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

LONG_STEP = 1.5  # a longer step, in usual steps, is a gap
# a step this long may hide a missing sample: the sample before it may have been late, hence not 2
SUSPECT_STEP = 1.3
# samples on either side of a long step whose levels are compared, or three times the step if longer
BESIDE = 100
# fewest samples for a meaningful line through the stamps, or a spline through the values
FEWEST_STAMPS = 20
SampleCount = NDArray[np.int64]


class SlowPart(NamedTuple):
    """The slow part of stamps, and at how many places their rate changes for good."""

    stamps: Array  # (n,) [s]
    kinks: int


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
            f" {stamps[row + 1]:.6f} s; it must rise: cut the log there, or do not map the counter"
        )
    count = np.asarray(counter - counter[0], dtype=np.int64)

    step, _ = line_through(count, stamps)
    level = stamps - step * count
    row = np.argmax(np.abs(np.diff(level))) + 1
    jump = np.median(level[row : row + BESIDE]) - np.median(level[max(row - BESIDE, 0) : row])
    largest_scatter_s = 5e-3  # of a host
    if abs(jump) > max(largest_scatter_s, LONG_STEP * step):
        raise InputError(
            f"{name}: the clock jumps by {jump:.2g} s at {stamps[row]:.6f} s, row {row}, while the"
            " sample counter runs on; cut the log there, or take the device's own clock as time"
            " source"
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
    tidy_steps = 0.2  # spread in mean steps; a missing sample makes one step of two
    if np.ptp(steps) < tidy_steps * np.mean(steps):
        return rows

    usual = usual_length(steps)
    whole = np.maximum(np.rint(steps / usual), 1)
    near_whole = 0.3  # distance in steps up to which steps are counted
    most_lost = 1000  # places of a count per sample; beyond it the stamps are those of batches
    is_count = whole.sum() < most_lost * len(rows)
    if is_count and np.all(np.abs(steps - whole * usual) < near_whole * usual):
        return np.append(0, np.cumsum(whole.astype(np.int64)))

    def squares(count: SampleCount) -> float:
        return np.sum((stamps - slow_part(stamps, count).stamps) ** 2)

    counts = [rows, rows + np.cumsum(missing_before_samples(stamps))]
    even_stamps = without_rate_changes(stamps, rows)
    if even_stamps is not stamps:
        rough = rows + np.cumsum(lasting_jumps(even_stamps))
        even_stamps = without_rate_changes(stamps, min(rows, rough, key=squares))
        counts.append(rows + np.cumsum(missing_before_samples(even_stamps)))
    counts = [count for count in counts if count[-1] < most_lost * len(rows)]
    best = min(counts, key=squares)
    left = 0.7  # share of the squared residual that missing samples leave if there are any
    return best if squares(best) < left * squares(rows) else rows


def lasting_jumps(stamps: Array) -> SampleCount:
    """Samples (n,) that seem to be missing before each by a median over nine samples."""
    steps = np.diff(stamps, prepend=stamps[0])
    usual = usual_length(steps)
    level = scipy.ndimage.median_filter(stamps / usual - np.arange(len(stamps)), 9)
    # entry k + 5 is the level of row k: row k + 4 is compared with row k - 5
    padded = np.pad(level, 5, mode="edge")
    rise = np.rint(padded[9:-1] - padded[:-10])
    return np.where(steps > SUSPECT_STEP * usual, np.maximum(rise, 0), 0).astype(np.int64)


def without_rate_changes(stamps: Array, count: SampleCount) -> Array:
    """Stamps (n,) [s] as if their rate did not change for good."""
    slow = slow_part(stamps, count)
    slow_step = np.diff(slow.stamps) / np.diff(count)
    mean_step = np.mean(slow_step)
    same_rate = 0.01  # relative change of a rate that does not matter for the count
    if not slow.kinks or np.ptp(slow_step) < same_rate * mean_step:
        return stamps
    local_step = np.maximum(slow_step, 0.1 * mean_step)
    steps = np.diff(stamps) / local_step * np.min(slow_step)
    return np.append(0.0, np.cumsum(steps))


def usual_length(steps: Array) -> float:
    """Median step [s]; above 0 where most rows share a stamp with the one before."""
    return max(np.median(steps), 1e-9)


def missing_before_samples(stamps: Array) -> SampleCount:
    """Number of samples missing right before each sample, (n,), by the levels beside long steps."""
    missing = np.zeros(len(stamps), dtype=np.int64)
    step = usual_step(stamps)
    level = (stamps - stamps[0]) / step - np.arange(len(stamps))
    length = np.diff(stamps, prepend=stamps[0]) / step
    # the sample before may have been late
    most = np.maximum(np.rint(length + 0.2).astype(np.int64) - 1, 1)
    fewest = 20  # samples; fewer at an end of the record give no level
    levels_differ = 0.3  # steps between two rough levels that call for a closer look
    rounds = 4  # a sample that is found moves the levels of its neighbours
    for _ in range(rounds):
        # where the level of the promptest few samples changes nearby
        prompt = scipy.ndimage.minimum_filter1d(level, BESIDE, mode="nearest")
        padded = np.pad(prompt, BESIDE // 2, mode="edge")
        rises = np.abs(padded[BESIDE:] - padded[:-BESIDE]) > levels_differ
        rows = np.flatnonzero(
            (length > SUSPECT_STEP) & (rises[: len(length)] | (most > BESIDE / 3))
        )
        # The longest steps first: else a late sample takes the place of one that is missing a few
        # samples later. Lengths are compared in quarters of a step, up to two steps.
        order = np.argsort(-np.minimum(np.rint(4 * length[rows]), 8), kind="stable")
        for row in rows[order].tolist():
            # a burst of delayed samples fills a third of the window at most
            window = max(BESIDE, 3 * int(most[row]))
            before = level[max(row - window, 0) : row]
            behind = level[row : row + window]
            if min(len(before), len(behind)) < fewest:
                continue
            rise = of_the_promptest(behind) - of_the_promptest(before)
            total = min(max(int(missing[row]) + round(rise), 0), int(most[row]))
            if total != missing[row]:
                level[row:] -= total - missing[row]
                missing[row] = total
    return missing


def of_the_promptest(level: Array) -> float:
    """The value (n,) below which 3 % of the others lie: stamps may be late, seldom early."""
    rank = len(level) // 33
    return float(np.partition(level, rank)[rank])


def slow_part(stamps: Array, count: SampleCount) -> SlowPart:
    """Find the slow part of stamps: a straight line, or lines of several rates that meet at kinks.

    Parameters
    ----------
    stamps : Array
        (n,) [s].
    count : SampleCount
        (n,) their places.

    Returns
    -------
    SlowPart
        With up to six kinks. A kink is set only if the stamps do not come back to the line, by the
        medians of 400 blocks.
    """
    blocks = 400  # whose medians show the slow part
    most_kinks = 6
    shortest_between_kinks_s = 2.0
    worth_a_kink = 0.7  # share of the residual that is left by a kink that is set
    step, _ = line_through(count, stamps)
    size = max(len(stamps) // blocks, 1)
    place = in_blocks(count, size).mean(axis=1)
    level = np.median(in_blocks(stamps - step * count, size), axis=1)
    changes = np.diff(level)
    # 1.48 median deviations are a standard deviation; a difference has that of two levels
    noise = 1.48 * np.median(np.abs(changes - np.median(changes))) / np.sqrt(2)

    def residual_with(knot: float) -> float:
        return float(robust_polyline(place, level, sorted([*knots, knot]))[1].sum())

    knots = [count[0], count[-1]]
    while True:
        levels, residual = robust_polyline(place, level, knots)
        is_straight = np.percentile(residual, 95) <= max(0.3 * step, 4 * noise)
        if is_straight or len(knots) == most_kinks + 2:
            break
        candidates = [
            candidate
            for candidate in place[4:-4:4].tolist()
            if min(abs(candidate - knot) for knot in knots) * step >= shortest_between_kinks_s
        ]
        best = min(candidates, key=residual_with, default=None)
        if best is None or residual_with(best) > worth_a_kink * residual.sum():
            break
        bounds = (max(best - 16 * size, place[0] + size), min(best + 16 * size, place[-1] - size))
        refined = scipy.optimize.minimize_scalar(
            residual_with, bounds=bounds, method="bounded", options={"xatol": size / 20}
        )
        knots = sorted([*knots, refined.x])

    slow = step * count + np.interp(count, knots, levels)
    return SlowPart(slow, len(knots) - 2)


def robust_polyline(place: Array, level: Array, knots: Sequence[float]) -> tuple[Array, Array]:
    """Levels at the knots (k,) of the polyline through points (n,), with Huber's weights, and the
    size of its residual (n,)."""
    columns = np.stack([np.interp(place, knots, unit) for unit in np.eye(len(knots))], axis=1)
    weights = np.ones(len(place))
    median_residuals = 2.96  # Huber's limit: 2 standard deviations of a normal distribution
    rounds = 5
    for _ in range(rounds):
        levels = np.linalg.lstsq(columns * weights[:, None], level * weights)[0]
        residual = np.abs(level - columns @ levels)
        limit = median_residuals * np.median(residual) + 1e-12
        weights = np.sqrt(1 / np.maximum(1, residual / limit))
    return np.asarray(levels, dtype=float), residual


def usual_step(stamps: Array) -> float:
    """Find a device's step [s] from its stamps (n,) [s], of which some are late and some missing.

    The promptest sample of each block is hardly late. From block to block its level changes by the
    error of the step. Blocks with missing samples change by whole steps and are left out.
    """
    n = len(stamps)
    mean = (stamps[-1] - stamps[0]) / (n - 1)
    median = np.median(np.diff(stamps))
    # the shorter of the two: steps are found too long
    step = min(mean, median) if median > 0.8 * mean else mean
    block_lengths = (25, 25, 25, 100, 100)  # the first are so short that most miss no sample
    for number, length in enumerate(block_lengths):
        block = min(length, n // 4)
        late = in_blocks(stamps - step * np.arange(n), block)
        changes = np.diff(late.min(axis=1))
        usual = np.quantile(changes, 0.25) if number == 0 else 0.0
        is_complete = np.abs(changes - usual) <= 0.5 * step
        if np.mean(is_complete) > 0.05:
            step += np.mean(changes[is_complete]) / block
    # after waits of many steps, stamps come in clusters of far too short steps: a tenth of the
    # record averages these
    far = max(n // 10, 1)
    usual = np.median(stamps[far:] - stamps[:-far]) / far
    return step if step > 0.5 * usual else usual


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
    promptest_of = 16  # rows, of which only the promptest sample shows the rhythm
    fewest_prompt_samples = 60
    bins_per_step = 4  # of the histogram of stamps, whose spectrum is taken
    least_line = 6.0  # medians of the spectrum; noise reaches 4 at the highest of 100 000
    n = len(stamps)
    duration = stamps[-1] - stamps[0]
    mean_hz = (n - 1) / duration
    late = in_blocks(stamps - np.arange(n) / mean_hz, promptest_of)
    if len(late) < fewest_prompt_samples:
        return None
    prompt = stamps[np.arange(len(late)) * promptest_of + late.argmin(axis=1)]

    bins_hz = bins_per_step * mean_hz
    histogram = np.bincount(((prompt - stamps[0]) * bins_hz).astype(np.intp))
    smallest_rate, largest_rate = 0.998, 1.1  # of the samples left: up to one in ten is lost
    lowest_hz = smallest_rate * mean_hz
    highest_hz = largest_rate * mean_hz
    cycles_apart = 0.1  # between frequencies, over the record: a sample missing is one cycle
    apart_hz = cycles_apart / duration
    lines = int((highest_hz - lowest_hz) / apart_hz)
    band = (lowest_hz, lowest_hz + lines * apart_hz)
    height = np.abs(scipy.signal.zoom_fft(histogram, band, lines, fs=bins_hz))
    line = np.argmax(height)
    if height[line] < least_line * np.median(height):
        return None
    late = stamps * (lowest_hz + line * apart_hz) - np.arange(n)
    most_at_ends = 200  # samples at either end, of which the promptest counts
    ends = min(most_at_ends, n // 4)
    return max(round(float(late[-ends:].min() - late[:ends].min())), 0)
