"""Values that a log repeats, because their source is slower than the log."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.signals.sample_count import line_through
from osl_analysis.signals.stream import FEWEST_STAMPS
from osl_analysis.trial import Array

LONGEST_HOLD_S = 0.1  # [s] a source slower than 10 Hz is taken for a coarse signal
# smallest changes; a slow signal of coarse resolution hardly changes by more from value to value
DECISIVE_CHANGE = 2.5
KEEPS_PACE = 0.95  # share of the repetitions that must fit the source's pace
WITHIN_A_ROW = 1.2  # range of rows about even places, of a source hardly slower than the log
PAUSE = 50  # periods; a longer repetition is a standing signal, which does not tell the pace


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
        return hardly_slower_source(signal, first_rows)
    if not FEWEST_STAMPS < len(first_rows) < 0.6 * len(signal):
        return None
    period = rows_per_value(signal, first_rows, step)
    if period is None:
        return None
    return values_at_pace(signal, first_rows, period)


def hardly_slower_source(signal: Array, first_rows: NDArray[np.intp]) -> HeldValues | None:
    """The values of a source that is hardly slower than the log: all are evenly spaced to within a
    row, which is no chance. None if they are not."""
    number = np.arange(len(first_rows))
    rows = first_rows.astype(np.float64)
    period = line_through(number, rows).step
    is_even = np.ptp(rows - period * number) < WITHIN_A_ROW
    if not is_even or len(rows) * period <= len(signal) - 3:
        return None
    return HeldValues(rows, signal[first_rows], period)


def rows_per_value(signal: Array, first_rows: NDArray[np.intp], step: float) -> float | None:
    """Usual rows per value of a signal (n,) that changes at these rows; None if it has no pace."""
    changes = np.abs(signal[first_rows] - signal[first_rows - 1])
    repeated = np.diff(first_rows)
    decisive = repeated[changes[:-1] > DECISIVE_CHANGE * changes.min()]
    if len(decisive) <= FEWEST_STAMPS:
        return None
    usual = float(np.median(decisive))
    if not 2 <= usual <= LONGEST_HOLD_S / step:
        return None

    periods = decisive / usual
    whole = np.maximum(np.rint(periods), 1)
    keeps_pace = np.abs(periods - whole) * usual <= 1 + 0.1 * usual
    if np.mean(keeps_pace) < KEEPS_PACE:
        return None

    period = float(np.mean(decisive[(periods > 0.5) & (periods < 1.75)]))
    short = repeated[repeated < PAUSE * period]
    return float(short.sum() / np.maximum(np.rint(short / period), 1).sum())


def values_at_pace(signal: Array, first_rows: NDArray[np.intp], period: float) -> HeldValues:
    """One value per period of the source, of a signal (n,) that changes at these rows, from the
    first to the last change.

    A value that equals the one before shows no change: its row is interpolated.
    """
    periods = np.maximum(np.rint(np.diff(first_rows) / period), 1).astype(np.intp)
    count = np.append(0, np.cumsum(periods))
    place = np.arange(count[-1] + 1)
    rows = np.interp(place, count, first_rows)
    shown_at = first_rows[np.searchsorted(count, place, "right") - 1]
    return HeldValues(rows, signal[shown_at], period)
