"""Rows whose stamp is of another time than their neighbours', as of a packet that waited in a
buffer. The clock was not set back: it goes on in the next row."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST_STALE_SHARE = 0.001  # of the rows; more of them, and the clock itself goes back
LONGEST_STALE_RUN = 3  # rows; a clock that was set back stays back for longer
FAR_STEPS = 50.0  # usual steps between the first row and the others, if it waited since before
FEWEST_ROWS = 100  # that tell the usual step


def find_stale_rows(readings: NDArray[Any], least: float = 0.0) -> NDArray[np.int64]:
    """Find few rows without which a clock never goes back, and begins with the recording.

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
    if readings.size < 2:
        return none
    allowed = max(1, int(LARGEST_STALE_SHARE * readings.size))
    if (readings[1:] >= readings[:-1]).all():
        return _before_the_recording(readings, least)
    goes_back = np.flatnonzero(readings[:-1] - readings[1:] > least) + 1
    if not 0 < goes_back.size <= 2 * allowed:
        return none
    is_stale = np.zeros(readings.size, bool)
    for place in goes_back.tolist():
        if is_stale[place]:
            continue
        run = _stale_run(readings, place, least)
        if run is None:
            return none
        is_stale[run] = True
    others = readings[~is_stale]
    if is_stale.sum() > allowed or (others[:-1] - others[1:] > least).any():
        return none
    places = np.flatnonzero(is_stale)
    before = _before_the_recording(others, least)
    return np.union1d(np.flatnonzero(~is_stale)[before], places)


def _stale_run(readings: NDArray[Any], place: int, least: float) -> slice | None:
    """The shortest run of rows about a place where a clock goes back, without which it does not:
    those from there on are too early, or those before it are too late; None if it is too long."""
    last = readings[place - 1]
    for length in range(1, LONGEST_STALE_RUN + 1):
        following = place + length
        if following >= readings.size or last - readings[following] <= least:
            return slice(place, following)
        preceding = place - 1 - length
        if preceding < 0 or readings[preceding] - readings[place] <= least:
            return slice(preceding + 1, place)
    return None


def _before_the_recording(readings: NDArray[Any], least: float) -> NDArray[np.int64]:
    """The first rows of a clock that goes on (n,), where they are far from the others."""
    if readings.size < FEWEST_ROWS:
        return np.zeros(0, np.int64)
    steps = np.diff(readings)
    longest = float(steps[:LONGEST_STALE_RUN].max())
    # counted, since the median of an hour takes ten times as long
    if 2 * np.count_nonzero(steps < longest / FAR_STEPS) < steps.size:
        return np.zeros(0, np.int64)
    far = max(least, FAR_STEPS * float(np.median(steps)))
    is_far = steps[:LONGEST_STALE_RUN] > far
    if not far > 0 or not is_far.any():
        return np.zeros(0, np.int64)
    return np.arange(int(np.flatnonzero(is_far)[-1]) + 1)
