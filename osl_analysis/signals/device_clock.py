"""The clock of a device: its stamps against the straight line on which even samples would lie."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.signals.sample_count import (
    Line,
    SlowPart,
    in_blocks,
    line_through,
    slow_part,
)
from osl_analysis.signals.stream import SampleCount
from osl_analysis.trial import Array

NORMAL_90 = (
    3.29  # standard deviations between the 5 % and the 95 % quantile of a normal distribution
)
WANDER_SAMPLES = 50  # over which jitter averages out
SETTLING_S = 2.0  # [s] within which latency comes back to its usual value
DECIMALS = range(2, 9)  # of a second, to which stamps may be printed: 10 ms to 10 ns

# Batches
IN_BATCH_STEP = 0.4  # steps within which a sample follows another of its batch
LEAST_FOLLOWING = 0.4  # share of the rows that follow another of their batch

# Blocks in which the signals tell how the stamps scatter
EVIDENCE_BLOCK_S = 0.08
FEWEST_IN_BLOCK = 9
MOST_IN_BLOCK = 24

ONE_SIDED_SKEW = 0.5  # skewness of latency: late, never early
FAR_OFF = 5  # standard deviations beyond which a stamp does not count for the line


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them."""

    stamps: Array  # (n,) [s]
    count: SampleCount  # (n,) place of every sample in the device's count
    counted: bool = False  # whether the device itself counted them

    @cached_property
    def line(self) -> Line:
        """Least-squares line through the stamps."""
        return line_through(self.count, self.stamps)

    @property
    def step(self) -> float:
        """Slope [s] of the line."""
        return self.line.step

    @cached_property
    def residual(self) -> Array:
        """Stamp minus line (n,) [s]."""
        return np.asarray(self.stamps - self.step * self.count - self.line.start)

    @cached_property
    def sd(self) -> float:
        """Standard deviation [s] of the residual."""
        return float(np.std(self.residual))

    @cached_property
    def wander(self) -> float:
        """Standard deviation [s] of the residual averaged over 50 samples. Jitter averages out."""
        blocks = in_blocks(self.residual, WANDER_SAMPLES)
        return float(np.std(blocks.mean(axis=1))) if len(blocks) > 1 else self.sd

    @cached_property
    def slow(self) -> SlowPart:
        """The slow part of the stamps."""
        return slow_part(self.stamps, self.count, self.step)

    @cached_property
    def scatter(self) -> float:
        """Robust standard deviation [s] of the stamps about their slow part, from quantiles: a few
        late stamps do not count."""
        low, high = np.quantile(self.stamps - self.slow.stamps, (0.05, 0.95))
        return float(high - low) / NORMAL_90

    @cached_property
    def decimal(self) -> float:
        """Decimal [s] to which the stamps were printed, 10 ms to 10 ns; 0 if none is seen."""
        since_first = self.stamps - self.stamps[0]
        for decimal in 10.0 ** -np.array(DECIMALS):
            # most stamps are refused by their first hundred
            if is_multiple(since_first[:99], decimal) and is_multiple(since_first, decimal):
                return float(decimal)
        return 0.0

    @cached_property
    def has_prompt_batches(self) -> bool | None:
        """Whether a batch of samples that a host stamps together waits for its last sample only:
        then its size matches the wait before its stamp. None if there are no batches, of which at
        least 40 % of the rows follow within 0.4 steps.

        Stamps rounded to decimals, or to ticks of a slow clock, are no batches: these waits are
        alike, whatever their numbers of samples.
        """
        follows = np.diff(self.stamps) <= IN_BATCH_STEP * self.step
        if np.mean(follows) < LEAST_FOLLOWING or self.decimal > 0.5 * self.step:
            return None
        begins = np.flatnonzero(~np.append(False, follows))
        waits = np.diff(self.stamps[begins]) / self.step
        sizes = np.diff(begins)
        if np.std(waits) <= 0.1 * np.std(sizes):
            return None
        return bool(np.std(waits[:-1] - sizes[1:]) < 0.6 * np.std(waits - sizes))

    @cached_property
    def settles(self) -> bool:
        """Whether the stamps come back to their line, or to the line of each rate, within 2 s, as
        with latency."""
        length = int(np.clip(SETTLING_S / self.step, 51, max(len(self.stamps) // 4, 1)))
        above = self.stamps - self.slow.stamps if self.slow.kinks else self.residual
        sums = np.cumsum(np.append(0.0, above))
        creep = np.abs(sums[length:] - sums[:-length]).max() / length
        return bool(creep <= max(self.step, 2 * self.scatter))

    @property
    def block(self) -> int:
        """Samples per block in `evidence_of`: those of 80 ms, but 9 to 24."""
        return int(np.clip(round(EVIDENCE_BLOCK_S / self.step), FEWEST_IN_BLOCK, MOST_IN_BLOCK))

    @property
    def missing(self) -> int:
        """Number of missing samples: places that the count leaves free."""
        return int(self.count[-1] - self.count[0] + 1 - len(self.count))

    def times(self) -> Array:
        """When the samples were taken, (n,) [s], if the device samples evenly.

        They lie on the least-squares line, without the few stamps that lie far off. If the rest is
        one-sided or in batches, the line is its lower edge instead, because a host's stamp is late
        by the message's wait. A device whose rate changes has a line for each rate.
        """
        base = self.slow.stamps if self.slow.kinks else self.stamps - self.residual
        late = self.stamps - base
        low, middle, high = np.quantile(late, (0.05, 0.5, 0.95))
        spread = (high - low) / NORMAL_90
        no_scatter = 1e-6 * self.step
        is_near = np.abs(late - middle) <= FAR_OFF * spread + no_scatter
        place = self.count[is_near]
        late = late[is_near]
        is_one_sided = spread > no_scatter and scipy.stats.skew(late) > ONE_SIDED_SKEW
        if self.has_prompt_batches is not None or is_one_sided:
            line = lower_edge(place, late)
        else:
            line = line_through(place, late)
        return np.asarray(base + line.step * self.count + line.start, dtype=np.float64)

    def aged(self, age: float) -> Array:
        """When values `age` loops older than their stamps were taken, (n,) [s].

        The times are interpolated between earlier stamps. Behind a gap or a very long loop these do
        not tell; there, `age` usual steps are taken off.
        """
        rows = np.arange(len(self.stamps))
        older = self.stamps - np.interp(rows - age, rows, self.stamps)
        is_behind_gap = np.diff(self.count, prepend=self.count[0]) > 1
        tells_nothing = is_behind_gap | (older > 3 * age * self.step) | (rows < age)
        older = np.where(tells_nothing, age * self.step, older)
        return np.maximum.accumulate(self.stamps - older)


def is_multiple(times: Array, decimal: float) -> bool:
    """Whether all times (n,) are multiples of a decimal [s]."""
    multiples = times / decimal
    return bool(np.max(np.abs(multiples - np.rint(multiples))) < 1e-3)


def lower_edge(place: SampleCount, late: Array) -> Line:
    """Find the highest line below all points (n,).

    The line goes through one point on each side of the mean count. The lowest point below the line
    replaces the point on its side, until none lies below.
    """
    left = 0
    right = len(place) - 1
    middle = float(np.mean(place))
    for _ in range(len(place)):
        step = float((late[right] - late[left]) / (place[right] - place[left]))
        above = late - late[left] - step * (place - place[left])
        lowest = int(np.argmin(above))
        if above[lowest] >= 0 or lowest in (left, right):
            break
        if place[lowest] <= middle:
            left = lowest
        else:
            right = lowest
    return Line(step, float(late[left] - step * place[left]))


def savitzky_golay(
    values: Array, count: SampleCount, window: int, order: int, degree: int = 3
) -> Array:
    """Smooth or differentiate samples by polynomials through their neighbours.

    Parameters
    ----------
    values : Array
        (n,).
    count : SampleCount
        (n,) places of the samples. Missing samples are bridged linearly. A gap is shortened to two
        windows: a clock may jump by years.
    window : int
        Samples of a polynomial, odd.
    order : int
        0 for the value, 1 for the slope per step.
    degree : int
        Of the polynomials.

    Returns
    -------
    Array
        (n,).
    """
    place: SampleCount | slice = slice(None)
    if count[-1] - count[0] != len(values) - 1:
        steps = np.minimum(np.diff(count), 2 * window)
        place = np.concatenate([[0], np.cumsum(steps)])
        values = np.interp(np.arange(place[-1] + 1), place, values)
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    smooth = scipy.signal.savgol_filter(values, window, min(degree, window - 1), order)
    return np.asarray(smooth[place])
