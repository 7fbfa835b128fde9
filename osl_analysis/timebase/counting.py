"""Which samples are missing: the place of every sample in the device's own count, from its stamps.

A late sample and a missing one both leave a long step. After a late sample the next ones return to the old level of
(stamp - count * step); after a missing one they stay a whole step higher. Only the level decides.

Where a host stamps late and loses samples at regular intervals, counting by steps fails. The stamp of sample k is
t = start + k step + wait: the spectrum of the stamps, |mean exp(2 pi i f t)|, has a line at the device's own rate
1/step, and none at the rate of the samples that are left.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.timebase.stream import Stream
from osl_analysis.trial import Array

Counts = NDArray[np.int64]
EVENLY = 0.2  # range of the steps, in mean steps, below which none is missing: a missing sample makes one step of two
LONG_STEP = 1.5  # step, in usual steps, from which it counts as a gap
SUSPECT = 1.3  # step from which a sample may be missing before it: the sample before the missing one may have been late
BURST = 10  # step from which samples are missing in a burst
BLOCKS = (25, 25, 25, 100, 100)
"""Samples among which the promptest is sought, to find the usual step: first so few that most blocks miss none."""
FEWEST_WHOLE = 0.05  # share of the blocks that must lack no sample if the step is to be taken from them
WINDOW = 100  # samples on either side of a long step whose levels are compared; three times the step if that is longer
FEW, TIDY = 20, 0.1
"""Samples below which the level of an end of the record is believed only if stamps scatter by less than TIDY steps."""
LATE_SHARE, EVEN_SHARE = 0.03, 0.2
"""Share of the window below its level: the promptest few where stamps are late, never early; else the lowest fifth."""
LATE_RATIO = 0.7
"""Distance of the lowest of 20 stamps to their median over that of the highest, below which all are late."""
NOTICED = 0.3  # change of the level, in steps, below which a count stands without a closer look
PASSES = 4
CLOCK_JUMP_S = 5e-3  # change of the level that a counter does not confirm, from which the clock is said to jump


def counted(stream: Stream) -> Counts:
    """Count of every sample, (n,), from 0, with what is missing left free; the device's counter where there is one.

    Raises InputError: The counter does not rise, or the clock jumps where the counter says that no sample is missing.
    """
    if stream.counter is None:
        return count_from_stamps(stream.stamps)
    check_counter(stream, stream.counter)
    count = np.asarray(stream.counter - stream.counter[0], dtype=np.int64)
    check_clock_against_counter(stream, count)
    return count


def count_from_stamps(stamps: Array) -> Counts:
    """Count of every sample, (n,), from its stamp (n,) [s]. A sample is missing where the level of the stamps changes
    by a step for good, and only if that lowers the residual of the line through all of them. Every change moves the
    levels behind it, so that a few passes are made."""
    place, steps = np.arange(len(stamps)), np.diff(stamps)
    if np.ptp(steps) < EVENLY * float(np.mean(steps)):
        return place
    step = usual_step(stamps)
    rows = np.flatnonzero(steps > SUSPECT * step) + 1
    if not len(rows):
        return place
    long = LongSteps(rows, steps[rows - 1] / step)
    level, missing = (stamps - stamps[0]) / step - place, np.zeros_like(rows)
    share = LATE_SHARE if one_sided(level) else EVEN_SHARE
    for _ in range(PASSES):
        if not settle(level, long, missing, share):
            break
    extra = np.zeros_like(place)
    extra[rows] = missing
    return min(place, place + np.cumsum(extra), key=lambda count: spread(stamps, count))


@dataclass(frozen=True)
class LongSteps:
    """Steps after which samples may be missing: row of the sample behind each, and length in usual steps."""

    rows: Counts
    length: Array

    @property
    def most(self) -> Counts:
        """The most samples that may be missing, at least one; before a burst one may have been late by 0.8 steps."""
        burst = np.where(self.length > BURST, np.floor(self.length - 0.2), np.rint(self.length) - 1)
        return np.maximum(burst.astype(np.int64), 1)

    @property
    def windows(self) -> Counts:
        """Samples on either side whose levels are compared: a burst of held samples fills a third at most."""
        return np.maximum(WINDOW, 3 * self.most)

    @property
    def likely_first(self) -> Counts:
        """Order of examination: longest first, lest a late sample takes what is missing a few samples further. Lengths
        are told apart by a quarter of a step, up to two steps; what is as long keeps its order in time."""
        return np.argsort(-np.minimum(np.rint(4 * self.length), 8), kind="stable")


def settle(level: Array, long: LongSteps, missing: Counts, share: float) -> bool:
    """Correct `missing` (steps,) and `level` (n,) [steps] in place until no long step changes the level. Returns
    whether anything changed."""
    changed, most, windows, order = False, long.most, long.windows, long.likely_first
    for k in order[suspicious(level, long, share)[order]]:
        row, window = int(long.rows[k]), int(windows[k])
        change = level_change(level[max(row - window, 0) : row], level[row : row + window], share)
        more = min(max(int(missing[k]) + change, 0), int(most[k])) - int(missing[k])
        if more:
            level[row:] -= more
            missing[k] += more
            changed = True
    return changed


def suspicious(level: Array, long: LongSteps, share: float) -> NDArray[np.bool_]:
    """Long steps (steps,) that deserve a closer look: a rough level, the lowest or the mean, changes over them."""
    if share == LATE_SHARE:
        smooth = scipy.ndimage.minimum_filter1d(level, WINDOW, mode="nearest")
    else:
        smooth = scipy.ndimage.uniform_filter1d(level, WINDOW, mode="nearest")
    half, last = WINDOW // 2, len(level) - 1
    after, before = np.minimum(long.rows + half, last), np.maximum(long.rows - half, 0)
    near_an_end = (long.rows < WINDOW) | (long.rows > last - WINDOW)
    return (np.abs(smooth[after] - smooth[before]) > NOTICED) | (3 * long.most > WINDOW) | near_an_end


def level_change(before: Array, after: Array, share: float) -> int:
    """Whole steps by which the level (window,) changes; none at an end of the record with too few untidy samples."""
    low, high = lowest(before, share), lowest(after, share)
    longer, its_level = (before, low) if len(before) > len(after) else (after, high)
    if min(len(before), len(after)) < FEW and float(np.median(longer)) - its_level > TIDY:
        return 0
    return round(high - low)


def lowest(level: Array, share: float) -> float:
    """The level that the given share of the samples lies below."""
    place = int(share * len(level))
    return float(np.partition(level, place)[place])


def one_sided(level: Array) -> bool:
    """Whether samples are late and never early: within most blocks the lowest level is nearer to the median."""
    blocks = level[: len(level) // FEW * FEW].reshape(-1, FEW)
    low, middle, high = np.min(blocks, axis=1), np.median(blocks, axis=1), np.max(blocks, axis=1)
    return bool(np.median(middle - low) < LATE_RATIO * np.median(high - middle))


def usual_step(stamps: Array) -> float:
    """Step [s] of a device from its stamps (n,), late and missing samples apart. The promptest sample of each block is
    hardly late; from block to block its level changes by the error of the step, and by whole steps where samples are
    missing, which are left out."""
    n = len(stamps)
    mean, median = float(stamps[-1] - stamps[0]) / (n - 1), float(np.median(np.diff(stamps)))
    step = min(mean, median) if median > 0.8 * mean else mean  # rather too short than too long
    for k, block in enumerate(min(size, n // 4) for size in BLOCKS):
        change = np.diff(promptest_levels(stamps, step, block))
        usual = 0.0 if k else float(np.quantile(change, 0.25))
        whole = np.abs(change - usual) <= 0.5 * step
        step += float(np.mean(change[whole])) / block if np.mean(whole) > FEWEST_WHOLE else 0.0
    return step if step > 0 else mean


def promptest_levels(stamps: Array, step: float, block: int) -> Array:
    """The lowest of (stamp - count * step) [s] in each whole block of stamps (n,), shape (n // block,)."""
    late = (stamps - step * np.arange(len(stamps)))[: len(stamps) // block * block]
    return np.asarray(late.reshape(-1, block).min(axis=1))


def line_slope(count: Counts, stamps: Array) -> float:
    """Step [s] of the least-squares line through stamps (n,) over their count."""
    along, across, _ = moments(count, stamps)
    return across / along


def spread(stamps: Array, count: Counts) -> float:
    """Sum of squares [s^2] of what the line leaves of the stamps (n,)."""
    along, across, varied = moments(count, stamps)
    return varied - across**2 / along


def moments(count: Counts, stamps: Array) -> tuple[float, float, float]:
    """Sums of squares and products of counts and stamps (n,) about their means: both counts, one of each, stamps."""
    x, y = count - count.mean(), stamps - stamps.mean()
    return float(x @ x), float(x @ y), float(y @ y)


def check_counter(stream: Stream, counter: Counts) -> None:
    """Refuse a counter that stands still or runs backwards."""
    step = np.diff(counter)
    if (step <= 0).any():
        row = int(np.argmax(step <= 0))
        raise InputError(
            f"{stream.name}: the sample counter goes from {counter[row]} to {counter[row + 1]} "
            f"at {stream.stamps[row + 1]:.6f} s; it must rise: cut the log there, or do not map the counter"
        )


def check_clock_against_counter(stream: Stream, count: Counts) -> None:
    """Refuse a clock that jumps while the counter runs on."""
    step = line_slope(count, stream.stamps)
    level = stream.stamps - stream.stamps[0] - step * count
    rows = np.flatnonzero(np.abs(np.diff(level)) > max(CLOCK_JUMP_S, LONG_STEP * step)) + 1
    for row in rows:
        jump = np.median(level[row : row + WINDOW]) - np.median(level[max(row - WINDOW, 0) : row])
        if abs(jump) > max(CLOCK_JUMP_S, LONG_STEP * step):
            raise InputError(
                f"{stream.name}: the clock jumps by {jump:.2g} s at {stream.stamps[row]:.6f} s, row {row}, "
                "while the sample counter runs on; cut the log there, or take the device's own clock as time source"
            )


PROMPT_BLOCKS = (16, 128)
"""Samples of which only the promptest is used: it waited least. The longer blocks are for waits of several steps."""
FEWEST_PROMPT = 60  # promptest samples below which no line stands out
LOWEST, HIGHEST = 0.998, 1.1
"""Where the line is sought, in rates of the samples that are left: up to one sample in ten is lost."""
BINS = 6  # bins per step into which stamps are sorted for the spectrum; the line is refined from the stamps themselves
STANDS_OUT = 6.0
"""Height of the line over the median of the spectrum. Of 100 000 frequencies of noise the highest reaches 4."""
REFINED = (0.5, 0.1, 0.02)  # half-widths of three searches around the line, in cycles over the record
ENDS = 200  # samples at either end of the record whose promptest shows how many ticks have passed


def missing_by_rhythm(stamps: Array) -> int | None:
    """Samples missing between the ends of a record, by its stamps (n,) [s]; None where no line stands out. Steps of the
    device between the promptest samples at both ends, less the samples between them."""
    step = next(filter(None, (device_step(stamps, block) for block in PROMPT_BLOCKS)), None)
    if step is None:
        return None
    late = stamps / step - np.arange(len(stamps))
    ends = min(ENDS, len(stamps) // 4)
    return max(round(float(late[-ends:].min() - late[:ends].min())), 0)


def device_step(stamps: Array, block: int) -> float | None:
    """Step [s] of the device, by the promptest stamp of each `block` of them; None where no line stands out."""
    duration = float(stamps[-1] - stamps[0])
    prompt = stamps[promptest(stamps, block)] - stamps[0]
    if len(prompt) < FEWEST_PROMPT:
        return None
    rate = (len(stamps) - 1) / duration
    size = scipy.fft.next_fast_len(int(2 * duration * rate * BINS) + 2)
    histogram = np.bincount((prompt * rate * BINS).astype(np.intp), minlength=size)
    frequency = np.arange(size // 2 + 1) * BINS * rate / size
    near = (frequency > LOWEST * rate) & (frequency < HIGHEST * rate)
    height = np.abs(scipy.fft.rfft(histogram.astype(np.float64)))[near]
    if height.max() < STANDS_OUT * float(np.median(height)):
        return None
    line = float(frequency[near][np.argmax(height)])
    for width in REFINED:
        tried = line + width / duration * np.linspace(-1, 1, 11)
        line = float(tried[np.argmax([abs(np.exp(2j * np.pi * f * prompt).sum()) for f in tried])])
    return 1 / line


def promptest(stamps: Array, block: int) -> NDArray[np.intp]:
    """Row of the sample in each block that lies lowest over the mean line of the stamps (n,) [s]."""
    blocks, n = len(stamps) // block, len(stamps)
    line = (stamps[-1] - stamps[0]) / (n - 1) * np.arange(blocks * block)
    lowest = (stamps[: blocks * block] - line).reshape(blocks, block).argmin(axis=1)
    return np.asarray(np.arange(blocks) * block + lowest)
