"""Rows or messages whose stamp is of another time than their neighbours', as of a packet that
waited in a buffer. The clock was not set back: it goes on in the next row."""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import listing
from osl_analysis.ingest import LIMITS
from osl_analysis.recording import Rows


def find_stale_rows(stamps: NDArray[Any], least: float = 0.0) -> NDArray[np.int64]:
    """Find few rows that are far from the running median of the stamps. A gap moves the median,
    too: the rows beside it are near to it.

    Parameters
    ----------
    stamps
        Readings of the clock, shape (n,).
    least
        How far a row must be off at least; in the unit of the stamps.

    Returns
    -------
    Array
        Their places, from 0; empty if no row is, or more than `largest_stale_share` of them.
    """
    none = np.zeros(0, np.int64)
    if LIMITS.largest_stale_share * stamps.size < 1:
        return none
    since_first = (stamps - stamps[0]).astype(np.float64)
    steps = np.abs(np.diff(since_first))
    far = max(least, LIMITS.far_steps * float(np.median(steps)))
    if not (steps > far).any():
        return none
    usual = scipy.ndimage.median_filter(since_first, LIMITS.median_rows, mode="mirror")
    places = np.flatnonzero(np.abs(since_first - usual) > far)
    return places if places.size <= LIMITS.largest_stale_share * stamps.size else none


def remarks_on_stale_rows(
    rows: Rows, stamps: NDArray[Any], stale: NDArray[np.int64], to_seconds: float
) -> list[str]:
    """Name the rows that are left out, and how far their stamps (n,) are off the ones beside.

    `to_seconds` is the factor from the unit of the stamps to seconds.
    """
    if not stale.size:
        return []
    off = np.abs(stamps[stale] - stamps[np.abs(stale - 1)]).max() * to_seconds
    named = listing([rows.place(row) for row in stale.tolist()], LIMITS.most_named)
    return [
        f"left out: {named}, whose stamp is up to {off:.4g} s off those beside it, as of a packet"
        " that waited in a buffer"
    ]
