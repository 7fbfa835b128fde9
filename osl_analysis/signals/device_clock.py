# SPDX-License-Identifier: Apache-2.0
"""The clock of a device: its stamps against the straight line on which even samples would lie, and
the rows in which a log shows the values of a slower source."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.trial import Array
from osl_analysis.signals.sample_count import (
    FEWEST_STAMPS,
    SampleCount,
    line_through,
)

# standard deviations between the 5 % and the 95 % quantile of a normal distribution
NORMAL_90 = 3.29
SETTLING_S = 2.0  # s within which latency comes back to its usual value
OUTLYING_SDS = 5  # standard deviations beyond which a stamp does not count for the line
DIGIT_ROUNDING = 1e-3  # of a decimal, by which printed stamps may miss it by rounding
ONE_SIDED = 0.5  # skewness of latency: late, never early
# steps within which a sample follows another of its batch; also the share of rows that do
IN_BATCH = 0.4


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them."""

    stamps: Array  # (n,) [s]
    count: SampleCount  # (n,) place of every sample in the device's count
    counted: bool = False  # whether the device itself counted them

    @cached_property
    def step(self) -> float:
        """Slope [s] of the least-squares line through the stamps."""
        return line_through(self.count, self.stamps)[0]

    @cached_property
    def residual(self) -> Array:
        """Stamp minus line (n,) [s]."""
        step, start = line_through(self.count, self.stamps)
        return self.stamps - step * self.count - start

    @cached_property
    def creep(self) -> Array:
        """The residual averaged over 2 s, (n,) [s], in which jitter and latency average out."""
        rows = int(np.clip(SETTLING_S / self.step, 1, len(self.stamps)))
        return scipy.ndimage.uniform_filter1d(self.residual, rows, mode="nearest")

    @cached_property
    def scatter(self) -> float:
        """Robust standard deviation [s] of the stamps about their creep, from quantiles: a few late
        stamps do not count."""
        return spread_of(self.residual - self.creep)

    @cached_property
    def decimal(self) -> float:
        """Decimal [s] to which the stamps were printed, 10 ms to 10 ns; 0 if none is seen."""
        since_first = self.stamps - self.stamps[0]
        for digits in range(2, 9):
            decimal = 10.0**-digits
            rounded = np.round(since_first, digits)
            if np.abs(since_first - rounded).max() < DIGIT_ROUNDING * decimal:
                return decimal
        return 0.0

    @property
    def is_in_batches(self) -> bool:
        """Whether samples are stamped together: at least 40 % of the rows follow within 0.4 steps,
        and not because stamps are rounded to a decimal."""
        follows = np.diff(self.stamps) <= IN_BATCH * self.step
        return bool(np.mean(follows) >= IN_BATCH) and self.decimal <= 0.5 * self.step

    @cached_property
    def settles(self) -> bool:
        """Whether the stamps come back to their line within 2 s, as with latency."""
        return bool(np.abs(self.creep).max() <= max(self.step, 2 * self.scatter))

    @property
    def missing(self) -> int:
        """Number of missing samples: places that the count leaves free."""
        return int(self.count[-1] - self.count[0] + 1 - len(self.count))

    def times(self) -> Array:
        """When the samples were taken, (n,) [s], if the device samples evenly.

        They lie on the least-squares line, without the few stamps that lie far off. If the rest is
        one-sided or in batches, the line is moved to its promptest stamp.
        """
        no_scatter = 1e-6 * self.step
        line = self.stamps - self.residual
        if np.ptp(self.residual) < no_scatter:
            return line
        spread = spread_of(self.residual)
        is_near = (
            np.abs(self.residual - np.median(self.residual)) <= OUTLYING_SDS * spread + no_scatter
        )
        late = self.residual[is_near]
        step, start = line_through(self.count[is_near], late)
        times = line + step * self.count + start
        is_one_sided = spread > no_scatter and scipy.stats.skew(late) > ONE_SIDED
        if self.is_in_batches or is_one_sided:
            times += np.min((self.stamps - times)[is_near])
        return times


def spread_of(values: Array) -> float:
    """Robust standard deviation of values (n,), by their 5 and 95 % quantiles."""
    low, high = np.quantile(values, (0.05, 0.95))
    return float(high - low) / NORMAL_90


# of values that a log repeats, because their source is slower than the log
WITHIN_A_ROW = 1.2  # range of rows about even places, which is no chance
# range of rows about even places of a source whose own jitter adds to the row that the log adds;
# what has no pace walks off by a row in every few values
WITHIN_TWO_ROWS = 2.0
NEARLY_ALL = (0.02, 0.98)  # quantiles between which this range is taken: a row may be late
LINE_PADDING = 4  # times the rows, over which a spectrum's line is seen to a quarter of its width
# smallest changes; a slow signal of coarse resolution hardly changes by more from one value
DECISIVE_CHANGE = 2.5
LONGEST_HOLD_S = 0.1  # s; a source slower than 10 Hz is taken for a coarse signal
LEAST_IN_PACE = 0.95  # share of the repetitions that must fit the source's pace
# rows by which an uneven source may miss its pace: one that the log adds, and a tenth of the pace
MOST_OFF_PACE = (1.0, 0.1)
# usual rows per value, below which every whole number is within a row of a multiple, so that a pace
# tells nothing and a source must be even
FEWEST_ROWS_OF_PACE = 4


@dataclass(frozen=True)
class HeldValues:
    """The values of a source that is slower than the log, which repeats each of them.

    A value was taken at its first row, or up to one step of the log before.
    """

    rows: Array  # (k,) first row of each value; interpolated if it equals the value before
    values: Array  # (k,)
    period: float  # usual rows per value


def held_values(signal: Array, step: float) -> HeldValues | None:
    """Find the values that a signal repeats at a pace of its own.

    Parameters
    ----------
    signal : Array
        (n,) without NaN.
    step : float
        Of the log [s].

    Returns
    -------
    HeldValues or None
        None if the signal does not repeat its values, or for more than 0.1 s.

    Notes
    -----
    A slow signal of coarse resolution also repeats values, but hardly right after a change by three
    of its smallest steps. So the repetitions after such changes decide.
    """
    first_rows = np.flatnonzero(signal[1:] != signal[:-1]) + 1
    repetitions = len(signal) - len(first_rows)
    if FEWEST_STAMPS < repetitions < 0.5 * len(signal):
        # a source that is hardly slower than the log: its values are evenly spaced to within a row
        rows = first_rows.astype(float)
        number = np.arange(len(rows))
        slope, _ = line_through(number, rows)
        is_even = np.ptp(rows - slope * number) < WITHIN_A_ROW
        is_seldom = len(rows) * slope <= len(signal) - 3
        if is_seldom or not is_even:
            return None
        return HeldValues(rows, signal[first_rows], slope)
    if not FEWEST_STAMPS < len(first_rows) < 0.6 * len(signal):
        return None
    usual = rows_per_value(signal, first_rows, step)
    if usual is None:
        return None
    period = even_period(first_rows, len(signal), usual)
    if period is None:
        if usual < FEWEST_ROWS_OF_PACE:
            return None
        repeated = np.diff(first_rows)
        period = float(repeated.sum() / values_between(first_rows, usual).sum())
    # a value that equals the one before shows no change: its row is interpolated
    count = np.append(0, np.cumsum(values_between(first_rows, period)))
    place = np.arange(count[-1] + 1)
    shown_at = first_rows[np.searchsorted(count, place, "right") - 1]
    return HeldValues(np.interp(place, count, first_rows), signal[shown_at], period)


def values_between(first_rows: NDArray[np.intp], period: float) -> NDArray[np.intp]:
    """How many values (k - 1,) of a source lie between rows (k,) at which its value changes."""
    return np.maximum(np.rint(np.diff(first_rows) / period), 1).astype(np.intp)


def even_period(first_rows: NDArray[np.intp], rows: int, usual: float) -> float | None:
    """Rows per value of a source that samples evenly, near a `usual` number of them; None where the
    changes, at rows (k,) of so many `rows`, are those of no even source.

    Changes at even times are a line in the spectrum of the rows that change. The changes of an even
    source stay within a row of even places over the whole recording; those of a signal of coarse
    resolution walk off.
    """
    has_change = np.zeros(rows)
    has_change[first_rows] = 1.0
    padded = scipy.fft.next_fast_len(LINE_PADDING * rows, real=True)
    lines = np.abs(scipy.fft.rfft(has_change - has_change.mean(), padded))
    # no value is shorter than a row, and the usual one is within a row of the mean
    slowest = int(padded / (usual + 1)) + 1
    fastest = int(min(padded / (usual - 1), padded / 2))
    strongest = slowest + int(np.argmax(lines[slowest : fastest + 1]))
    guess = padded / strongest

    count = np.append(0, np.cumsum(values_between(first_rows, guess)))
    period, start = line_through(count, first_rows.astype(float))
    off_even = first_rows - (start + period * count)
    is_even = np.ptp(np.quantile(off_even, NEARLY_ALL)) <= WITHIN_TWO_ROWS
    return float(period) if is_even else None


def rows_per_value(signal: Array, first_rows: NDArray[np.intp], step: float) -> float | None:
    """The usual number of rows per value of a signal (n,) that changes at these rows; None if it
    has no pace."""
    changes = np.abs(signal[first_rows] - signal[first_rows - 1])
    repeated = np.diff(first_rows)
    decisive = repeated[changes[:-1] > DECISIVE_CHANGE * changes.min()]
    if len(decisive) <= FEWEST_STAMPS:
        return None
    usual = float(np.median(decisive))
    off_pace = np.abs(decisive - usual * np.maximum(np.rint(decisive / usual), 1))
    keeps_pace = off_pace <= MOST_OFF_PACE[0] + MOST_OFF_PACE[1] * usual
    is_of_source = 2 <= usual <= LONGEST_HOLD_S / step
    return usual if is_of_source and np.mean(keeps_pace) >= LEAST_IN_PACE else None
