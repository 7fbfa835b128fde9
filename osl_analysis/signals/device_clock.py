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
# smallest changes; a slow signal of coarse resolution hardly changes by more from one value
DECISIVE_CHANGE = 2.5
LONGEST_HOLD_S = 0.1  # s; a source slower than 10 Hz is taken for a coarse signal
LEAST_IN_PACE = 0.95  # share of the repetitions that must fit the source's pace


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
        period, _ = line_through(number, rows)
        is_even = np.ptp(rows - period * number) < WITHIN_A_ROW
        is_seldom = len(rows) * period <= len(signal) - 3
        if is_seldom or not is_even:
            return None
        return HeldValues(rows, signal[first_rows], period)
    if not FEWEST_STAMPS < len(first_rows) < 0.6 * len(signal):
        return None
    usual = rows_per_value(signal, first_rows, step)
    if usual is None:
        return None
    # a value that equals the one before shows no change: its row is interpolated
    periods = np.maximum(np.rint(np.diff(first_rows) / usual), 1).astype(np.intp)
    count = np.append(0, np.cumsum(periods))
    place = np.arange(count[-1] + 1)
    shown_at = first_rows[np.searchsorted(count, place, "right") - 1]
    return HeldValues(np.interp(place, count, first_rows), signal[shown_at], usual)


def rows_per_value(signal: Array, first_rows: NDArray[np.intp], step: float) -> float | None:
    """Usual rows per value of a signal (n,) that changes at these rows; None if it has no pace."""
    changes = np.abs(signal[first_rows] - signal[first_rows - 1])
    repeated = np.diff(first_rows)
    decisive = repeated[changes[:-1] > DECISIVE_CHANGE * changes.min()]
    if len(decisive) <= FEWEST_STAMPS:
        return None
    usual = np.median(decisive)
    periods = decisive / usual
    from_whole = np.abs(periods - np.maximum(np.rint(periods), 1)) * usual
    keeps_pace = from_whole <= 1 + 0.1 * usual
    if not 2 <= usual <= LONGEST_HOLD_S / step or np.mean(keeps_pace) < LEAST_IN_PACE:
        return None

    return float(repeated.sum() / np.maximum(np.rint(repeated / usual), 1).sum())
