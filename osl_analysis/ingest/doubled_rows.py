"""Rows of a table that stand twice, numbered anew or with their stamps.

A row that repeats all values of the row before is no sample where the joint's next step is a usual
one: a recorder that missed a sample and wrote the last one again would go on by two steps."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.ingest.guard import EVEN, USUAL_STEP, are_paced, smallest_motion
from osl_analysis.recording import Rows
from osl_analysis.trial import Array

MOST_DOUBLED = 0.05  # share of the rows; more of them, and a device was read too often
CHANCE = 0.1  # of the rows that repeat all values, as many may do so by chance


def numbered_twice(time: Array, values: pl.DataFrame) -> NDArray[np.intp]:
    """Find rows that stand twice in a table whose stamps were numbered after that.

    Parameters
    ----------
    time : Array
        Stamps [s], (n,).
    values : DataFrame
        All columns but the time, n rows.

    Returns
    -------
    Array
        Their places; empty where no motion tells them from samples that were held.
    """
    none = np.zeros(0, np.intp)
    steps = np.diff(time)
    usual = float(np.median(steps))
    if time.size < 5 or max(steps.max() - usual, usual - steps.min()) > EVEN * usual:
        return none
    repeats = pl.DataFrame([column[1:] == column[:-1] for column in values])
    is_equal = repeats.select(pl.all_horizontal(pl.all().fill_null(False))).to_series().to_numpy()
    if not 0 < is_equal.sum() < MOST_DOUBLED * time.size:
        return none
    places = np.flatnonzero(is_equal) + 1
    if are_paced(places):  # of a slower device (`signals/held_values.py`)
        return none
    inserted = np.zeros(places.size, bool)
    for column in values:
        inserted |= goes_on_by_one(column.to_numpy(), places)
    if not inserted.any():
        return none
    others = repeats.filter(~pl.Series(is_equal))
    by_chance = min(int(column.sum()) for column in others)  # of the noisiest column
    return places if by_chance < CHANCE * places.size else places[inserted]


def goes_on_by_one(values: Array, places: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether a signal (n,), which repeats its value at these places (k,), moves there, and goes on
    by a usual step."""
    steps = np.diff(values)
    least = smallest_motion(values)
    inside = (places > 1) & (places < steps.size - 1)
    at = places[inside]
    before, after, second = steps[at - 2], steps[at], steps[at + 1]
    expected = (before + second) / 2
    told = np.zeros(places.size, bool)
    is_usual = np.abs(after - expected) < USUAL_STEP * np.abs(expected)
    told[inside] = is_usual & (np.abs(expected) > least)
    return told


def stands_before(stamps: NDArray[Any], values: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Whether a row (n,) stands before already, with its stamp and all its numbers (n,)."""
    numbers = {
        column: np.ma.getdata(array)
        for column, array in values.items()
        if array.ndim == 1 and array.dtype.kind in "iuf"
    }
    if not numbers:
        return np.zeros(stamps.size, bool)
    rows = pl.DataFrame(numbers).with_columns(stamp_of_row=pl.Series(stamps))
    is_first: NDArray[np.bool_] = (
        rows.select(pl.struct(pl.all()).is_first_distinct()).to_series().to_numpy()
    )
    return ~is_first


def first_of(places: NDArray[np.intp], rows: Rows) -> str:
    """Rows at these places (k,), for a message."""
    if places.size == 1:
        return f"{rows.place(int(places[0]))} stands twice"
    return f"{places.size} {rows.noun}s stand twice, first {rows.place(int(places[0]))}"
