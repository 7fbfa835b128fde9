# SPDX-License-Identifier: Apache-2.0
"""An axis on which every trial has a place of its own.

Desired values are few, and many trials share one: on a scale their markers would cover one another.
Here each value has a stretch of the axis, and each trial a place in it, sorted by controller and by
the other desired value.
"""

from dataclasses import dataclass
from itertools import pairwise

import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import style

SYMBOLS = ("K", "B")
OTHER_DESIRED = {"K": "B_d", "B": "K_d"}  # by which trials of one K_d, of one B_d are sorted
# markers side by side, or letters of labels, on the axis of a single column
SINGLE_COLUMN_LETTERS = 50
MARGIN = 2  # from the first and the last trial to the ends of the axis, in places of trials


@dataclass(frozen=True)
class TrialPanel:
    """One quantity of one joint and side."""

    ax: Axes
    symbol: str  # `K` or `B`
    trials: pl.DataFrame  # a row per trial with its place `x`, in order


@dataclass(frozen=True)
class TrialLayout:
    """A figure of such panels, those of K above those of B, a column per joint and side."""

    figure: style.PaperFigure
    axes: list[Axes]
    panels: list[TrialPanel]
    letters: float  # of labels that have room on the axis of one panel


def panels_of_trials(table: pl.DataFrame, height: float) -> TrialLayout:
    """Make the panels of K and B, and give every trial its place in both.

    Parameters
    ----------
    table : DataFrame
        A row per trial, with `joint`, `side`, `controller`, `look`, `K_d` and `B_d`.
    height : float
        Of the figure [in].

    Returns
    -------
    TrialLayout
    """
    parts = style.by_place(table)
    placed = {symbol: [placed_on_axis(part, symbol) for _, part in parts] for symbol in SYMBOLS}
    longest = max(
        trials["x"][-1] for parts_of_symbol in placed.values() for trials in parts_of_symbol
    )
    is_single_column = len(parts) == 1 and longest <= SINGLE_COLUMN_LETTERS
    width = style.SINGLE_COLUMN if is_single_column else style.DOUBLE_COLUMN
    letters = SINGLE_COLUMN_LETTERS if is_single_column else 2 * SINGLE_COLUMN_LETTERS

    titles = [title for title, _ in parts]
    figure, axes = style.panels(width, height, len(SYMBOLS), len(parts), titles)
    panels = []
    for row, symbol in enumerate(SYMBOLS):
        for column, trials in enumerate(placed[symbol]):
            panels.append(TrialPanel(axes[row * len(parts) + column], symbol, trials))
    return TrialLayout(figure, axes, panels, letters / len(parts))


def placed_on_axis(trials: pl.DataFrame, symbol: str) -> pl.DataFrame:
    """Sort trials along the axis of K_d or B_d, and give each its place.

    Parameters
    ----------
    trials : DataFrame
        A row per trial, with `controller`, `look`, `K_d` and `B_d`.
    symbol : str
        `K`: the axis is of K_d; `B`: of B_d.

    Returns
    -------
    DataFrame
        The rows in order, with `x`, their places from 0 on: the next trial of a controller stands
        at a distance of 1, that of another one of 2, that of another value of 3. Trials without
        a desired value stand last.
    """
    desired = f"{symbol}_d"
    order = [desired, "look", "controller", OTHER_DESIRED[symbol]]
    rows = trials.sort(order, nulls_last=True, maintain_order=True)
    gaps = pl.col(desired).rle_id() + pl.struct(desired, "look").rle_id()
    place = pl.int_range(pl.len()) + gaps
    return rows.with_columns(x=place.cast(pl.Float64))


def draw_trial_axis(panel: TrialPanel, letters: float) -> None:
    """The axis of desired values, or else of trials, with a line between two of them.

    Labels stand below the middle of their trials: upright where the axis has room for fewer than
    all `letters`, and only some of very many.
    """
    ax, trials = panel.ax, panel.trials
    desired = f"{panel.symbol}_d"
    column = desired if style.has_values(trials, desired) else "trial"
    groups = trials.partition_by(column)
    for left, right in pairwise(groups):
        middle = (left["x"][-1] + right["x"][0]) / 2
        ax.axvline(middle, color=style.GRID_GREY, linewidth=0.5)
    ax.set_xlim(-MARGIN, trials["x"][-1] + MARGIN)
    ax.tick_params(axis="x", length=0)
    ax.set_xlabel(style.AXIS_LABELS.get(column, "Trial"))

    values = [rows[column][0] for rows in groups]
    if column == "trial":
        labels = [style.drawn_name(value) for value in values]
    else:
        labels = ["not stated" if value is None else f"{value:g}" for value in values]
    middles = [rows["x"].to_numpy().mean() for rows in groups]
    needed_letters = sum(len(label) + 2 for label in labels)
    is_upright = needed_letters > letters
    every = 1 + int(2 * len(labels) / letters) if is_upright else 1
    ax.set_xticks(middles[::every], labels[::every], rotation=90 if is_upright else 0)
