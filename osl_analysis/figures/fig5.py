# SPDX-License-Identifier: Apache-2.0
"""Fig. 5: the stiffness and damping that the joint renders, against those that were asked for.

Desired values are few, and many trials have the same one. On a scale their markers would cover one
another. Here each value has a stretch of the axis, and each trial in it a place of its own: first
by controller, then by the other desired value.
"""

from itertools import pairwise

import polars as pl
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from osl_analysis.figures import style

MOST_IN_COLUMN = 50  # markers side by side, or letters of labels, on the axis of a single column
OTHER = {"K": "B_d", "B": "K_d"}  # desired value by which trials of one K_d, of one B_d are sorted
ASKED_FOR = ("joint", "side", "K_d", "B_d")
DRAWN = ("", "_low", "_high", "_range_low", "_range_high")  # estimate, its interval and its range


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes. The viscous damping stands where every
    controller of the same condition has one: alone it would compare unlike quantities."""
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    if "B_viscous" not in whole.columns:
        return whole
    known = pl.col("controller").filter(pl.col("B_viscous").is_not_null())
    has_all = known.n_unique() == pl.col("controller").n_unique()
    condition = [name for name in ASKED_FOR if name in whole.columns]
    compared = pl.when(has_all.over(condition)).then("B_viscous")
    return whole.with_columns(B_viscous=compared)


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) stiffness over desired stiffness and (b) its error in a narrow panel, (c) damping over
    desired damping and (d) its error, one above the other; several joints stand side by side."""
    parts = style.by_place(table)
    is_asked = (table["K_d"] > 0).any()  # for a stiffness
    heights = [1, 0.5, 1, 0.5] if is_asked else [1, 1]
    placed = [[placed_on_axis(part, symbol) for symbol in "KB"] for _, part in parts]
    longest = max(trials["x"][-1] for of_part in placed for trials in of_part)
    is_single = len(parts) == 1 and longest <= MOST_IN_COLUMN
    width = style.SINGLE_COLUMN if is_single else style.DOUBLE_COLUMN
    most = MOST_IN_COLUMN * (1 if is_single else 2) / len(parts)
    figure, axes = style.panels(
        width,
        0.5 + 2 * sum(heights),
        len(heights),
        len(parts),
        [title for title, _ in parts],
        height_ratios=heights,
    )
    for column, of_part in enumerate(placed):
        of_column = iter(axes[column :: len(parts)])
        for symbol, trials in zip("KB", of_part, strict=True):
            values = next(of_column)
            draw_trials(values, symbol, trials, most)
            if is_asked:
                values.set_xlabel("")
                values.set_xticks([])
                draw_errors(next(of_column), symbol, trials, most)

    keys = [*style.estimate_keys(axes, table), *style.labelled(axes, Line2D)]
    style.legend_above(figure, keys)
    return figure


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
    rows = trials.sort(
        desired, "look", "controller", OTHER[symbol], nulls_last=True, maintain_order=True
    )
    steps = pl.int_range(pl.len()) + pl.col(desired).rle_id() + pl.struct(desired, "look").rle_id()
    return rows.with_columns(x=steps.cast(pl.Float64))


def draw_trials(ax: Axes, symbol: str, placed: pl.DataFrame, most: float) -> None:
    """One quantity of the trials at their places `x`: estimates with their bars, what the gains
    render, the viscous damping beside the damping, and a black line at each desired value."""
    for look, trials in style.by_controller(placed):
        style.draw_estimates(ax, trials, "x", symbol, look)
    of_panel = {f"{symbol}_d_rendered": ("+", "Rendered by the gains")}
    if symbol == "B":
        of_panel["B_viscous"] = ("x", "Viscous damping")
    for column, (marker, label) in of_panel.items():
        if style.has_values(placed, column):
            # black, because it may stand on a marker
            ax.plot(placed["x"], placed[column], marker, color=style.BLACK, zorder=4, label=label)
    ax.set_ylabel(style.AXIS_LABELS[symbol])
    for group in placed.drop_nulls(f"{symbol}_d").partition_by(f"{symbol}_d"):
        ends = [group["x"][0] - 1, group["x"][-1] + 1]
        ax.plot(ends, group[f"{symbol}_d"][[0, 0]], color=style.BLACK, label="Desired")
    draw_axis(ax, symbol, placed, most)


def draw_errors(ax: Axes, symbol: str, placed: pl.DataFrame, most: float) -> None:
    """What the trials render less what was asked for: of stiffness in percent of it; of damping,
    of which often none is asked for, in its unit."""
    desired = pl.col(f"{symbol}_d")
    error = pl.col([symbol + end for end in DRAWN]) - desired
    label = "Error (N·m·s/rad)"
    if symbol == "K":
        error = error / desired.replace(0, None) * 100
        label = "Error (%)"
    for look, trials in style.by_controller(placed.with_columns(error)):
        style.draw_estimates(ax, trials, "x", symbol, look)
    draw_axis(ax, symbol, placed, most)
    ax.axhline(0, color=style.BLACK)
    ax.set_ylabel(label)


def draw_axis(ax: Axes, symbol: str, placed: pl.DataFrame, most: float) -> None:
    """The axis of desired values, or else of trials, with a line between two of them. Labels stand
    below the middle of their trials: upright where the axis is too short for all, and only some of
    very many."""
    column = f"{symbol}_d" if style.has_values(placed, f"{symbol}_d") else "trial"
    groups = placed.partition_by(column)
    for left, right in pairwise(groups):
        ax.axvline((left["x"][-1] + right["x"][0]) / 2, color=style.GRID_GREY, linewidth=0.5)
    ax.set_xlim(-2, placed["x"][-1] + 2)
    ax.tick_params(axis="x", length=0)
    ax.set_xlabel(style.AXIS_LABELS.get(column, "Trial"))
    values = [rows[column][0] for rows in groups]
    if column == "trial":
        labels = list(map(style.drawn_name, values))
    else:
        labels = ["not stated" if value is None else f"{value:g}" for value in values]
    middles = [rows["x"].to_numpy().mean() for rows in groups]
    is_long = sum(len(label) + 2 for label in labels) > most
    every = 1 + int(2 * len(labels) / most) if is_long else 1
    ax.set_xticks(middles[::every], labels[::every], rotation=90 if is_long else 0)
