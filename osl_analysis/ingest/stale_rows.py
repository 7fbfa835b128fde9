"""Rows whose stamp is of another time than their neighbours', as of a packet that waited in a
buffer. The clock was not set back: it goes on in the next row."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST_STALE_SHARE = 0.001  # of the rows; more of them, and the clock itself goes back
LONGEST_STALE_RUN = 3  # rows; a clock that was set back stays back for longer


def find_stale_rows(readings: NDArray[Any], least: float = 0.0) -> NDArray[np.int64]:
    """Find few rows without which a clock never goes back.

    Parameters
    ----------
    readings
        Of the clock, shape (n,).
    least
        How far a row must be before the rows ahead of it, or behind those that follow; in the unit
        of the readings.

    Returns
    -------
    Array
        Their places, from 0; empty if the clock goes on, or if leaving out few rows does not mend
        it.
    """
    none = np.zeros(0, np.int64)
    if readings.size < 2 or (readings[1:] >= readings[:-1]).all():
        return none
    latest_before = np.maximum.accumulate(readings)
    earliest_after = np.minimum.accumulate(readings[::-1])[::-1]
    too_early = latest_before - readings > least
    too_late = readings - earliest_after > least
    allowed = max(1, int(LARGEST_STALE_SHARE * readings.size))
    for is_stale in (too_early, too_late):
        places = np.flatnonzero(is_stale)
        if not 0 < places.size <= allowed or longest_run(places) > LONGEST_STALE_RUN:
            continue
        others = readings[~is_stale]
        if (others[1:] >= others[:-1] - least).all():
            return places
    return none


def longest_run(places: NDArray[np.int64]) -> int:
    """Largest number of places (n,), n > 0, that follow one another."""
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return max(run.size for run in runs)
