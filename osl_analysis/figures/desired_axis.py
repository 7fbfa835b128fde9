"""The axis of Fig. 5 and of those like it: trials side by side above each desired value.

Desired values are few, and many trials have the same one. On a scale their markers would cover one
another. Here each value has a stretch of the axis, and each trial in it a place of its own: first
by controller, then by the other desired value.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import names
from osl_analysis.figures.style import (
    DOUBLE_COLUMN,
    GRID_GREY,
    LETTERS_PER_INCH,
    SINGLE_COLUMN,
)

# distances of the places of two neighbouring trials
NEXT_TRIAL = 1.0  # of one controller
NEXT_CONTROLLER = 1.8  # of two controllers
NEXT_VALUE = 3.2  # of two desired values
EDGE = 1.2  # free at either end
FEWEST_PLACES = 8.0  # the axis has room for so many, that one trial does not stand in its middle

MARGIN = 0.55  # of a panel, for the labels of its vertical axis [in]
WIDEST_MARKER = 4.6 / 72  # with its edge [in]
SMALLEST_SHARE = 0.3  # of a marker's size

OTHER = {"K": "B_d", "B": "K_d"}  # desired value by which trials of one K_d, of one B_d are sorted


def with_places(trials: pl.DataFrame, symbol: str) -> pl.DataFrame:
    """Sort trials along the axis of a desired value, and give each its place.

    Parameters
    ----------
    trials : DataFrame
        A row per trial, with `controller`, `look`, `K_d` and `B_d`.
    symbol : str
        `K`: the axis is of K_d; `B`: of B_d.

    Returns
    -------
    DataFrame
        The rows in order, with `x`, their places from 0 on. Trials without a desired value stand
        last.
    """
    desired = f"{symbol}_d"
    order = {controller: number for number, controller in enumerate(names.looks_in(trials))}
    numbers = pl.Series("number", [order[controller] for controller in trials["controller"]])
    rows = trials.with_columns(numbers).sort(
        desired, "number", OTHER[symbol], nulls_last=True, maintain_order=True
    )

    places = [0.0]
    conditions = rows.select(desired, "number").rows()
    for (value, number), (next_value, next_number) in pairwise(conditions):
        if value != next_value:
            distance = NEXT_VALUE
        elif number != next_number:
            distance = NEXT_CONTROLLER
        else:
            distance = NEXT_TRIAL
        places.append(places[-1] + distance)
    return rows.with_columns(x=pl.Series(places[: len(rows)], dtype=pl.Float64))


def panel_inches(width: float, columns: int = 1) -> float:
    """Length of the horizontal axis [in] of a figure of this width [in]."""
    return width / columns - MARGIN


def fitting_width(placed: Sequence[pl.DataFrame]) -> float:
    """The width [in] of a figure of panels one above the other: one column of the page, if the
    markers of all trials have room there, else two."""
    longest = max(float(rows["x"][-1]) for rows in placed) + 2 * EDGE
    is_enough = longest * WIDEST_MARKER <= panel_inches(SINGLE_COLUMN)
    return SINGLE_COLUMN if is_enough else DOUBLE_COLUMN


def marker_share(placed: pl.DataFrame, inches: float) -> float:
    """The share of their usual size at which markers of neighbours do not touch on an axis of this
    length [in]."""
    unit = inches / (float(placed["x"][-1]) + 2 * EDGE)
    return float(np.clip(unit / WIDEST_MARKER, SMALLEST_SHARE, 1.0))


def label_desired_axis(ax: Axes, placed: pl.DataFrame, symbol: str, inches: float) -> None:
    """Write below each group of trials its desired value, and part the groups by lines.

    Parameters
    ----------
    ax : Axes
    placed : DataFrame
        By `with_places`.
    symbol : str
        As there.
    inches : float
        Length of the axis. Where it is too short for all values, some are left out.
    """
    desired = f"{symbol}_d"
    last = float(placed["x"][-1])
    edge = max(EDGE, (FEWEST_PLACES - last) / 2)
    ax.set_xlim(-edge, last + edge)
    ax.tick_params(axis="x", length=0)
    if placed[desired].count() == 0:
        name_trials(ax, placed, inches)
        return

    groups = placed.partition_by(desired, maintain_order=True)
    for left, right in pairwise(groups):
        middle = (left["x"][-1] + right["x"][0]) / 2
        ax.axvline(middle, color=GRID_GREY, linewidth=0.5, zorder=-1)

    unit = inches / (last + 2 * edge)
    places, labels = [], []
    free_from = -np.inf
    for group in groups:
        value, place = group[desired][0], float(group["x"].to_numpy().mean())
        label = "not stated" if value is None else f"{value:g}"
        half_length = len(label) / LETTERS_PER_INCH / 2 / unit
        if place - half_length >= free_from:
            places.append(place)
            labels.append(label)
            free_from = place + half_length + NEXT_TRIAL / 2
    ax.set_xticks(places, labels)
    ax.set_xlabel(names.AXIS_LABELS[desired])


def name_trials(ax: Axes, placed: pl.DataFrame, inches: float) -> None:
    """Write below each trial its name, if all have room: nothing was asked of them."""
    letters = int(LETTERS_PER_INCH * inches / max(len(placed), FEWEST_PLACES))
    if letters < 4:
        ax.set_xticks([])
        ax.set_xlabel("Trials")
        return
    ax.set_xticks(placed["x"].to_list(), [names.drawn_name(t, letters) for t in placed["trial"]])
    ax.set_xlabel("Trial")
