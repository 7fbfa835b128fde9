# SPDX-License-Identifier: Apache-2.0
"""Fig. 5: the stiffness and damping that the joint renders, against those that were asked for.

Desired values are few, and many trials have the same one. On a scale their markers would cover one
another. Here each value has a stretch of the axis, and each trial in it a place of its own: first
by controller, then by the other desired value.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import marks, style


class Layout:
    """Places of trials along the axis, and sizes."""

    # distances of the places of two neighbouring trials
    NEXT_TRIAL = 1.0  # of one controller
    NEXT_CONTROLLER = 1.8  # of two controllers
    NEXT_VALUE = 3.2  # of two desired values
    EDGE = 1.2  # free at either end
    # the axis has room for so many, that one trial does not stand in its middle
    FEWEST_PLACES = 8.0
    MARGIN = 0.55  # of a panel, for the labels of its vertical axis [in]
    WIDEST_MARKER = 4.6 / 72  # with its edge [in]
    SMALLEST_SHARE = 0.3  # of a marker's size
    PANEL_HEIGHT = 1.9  # [in]
    LEGEND_HEIGHT = 0.6  # [in]
    # of upright names of trials, where these stand in place of desired values [in]
    NAME_HEIGHT = 0.6
    LONGEST_NAME = 15  # letters of a name, from its end
    BESIDE_TRIALS = 0.8  # by which a desired value's line is longer than its trials on either side
    VISCOUS_SIZE = 3.2  # of this mark [pt]
    LINEAR_PERCENT = 5.0  # of an error, on either side of 0: the margin of a stiffness
    LINEAR_SHARE = 0.6  # of a decade, that is as long as either half of the linear part
    ERROR_TICKS = (-50, -20, -5, 0, 5, 20, 50, 200)  # [%]


OTHER = {"K": "B_d", "B": "K_d"}  # desired value by which trials of one K_d, of one B_d are sorted
CONDITION = ("joint", "side", "K_d", "B_d")
STIFFNESS = ("K", "K_low", "K_high", "K_range_low", "K_range_high")
DESIRED_LINE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8}
# black, because it may stand on a marker
VISCOUS_MARK: dict[str, Any] = {"marker": "x", "mew": 0.8, "color": style.BLACK}


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes. The viscous damping stands where every
    controller of the same condition has one: alone it would compare unlike quantities."""
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    if "B_viscous" not in whole.columns:
        return whole
    known = pl.col("controller").filter(pl.col("B_viscous").is_not_null())
    has_all = known.n_unique() == pl.col("controller").n_unique()
    condition = [name for name in CONDITION if name in whole.columns]
    compared = pl.when(has_all.over(condition)).then("B_viscous")
    return whole.with_columns(B_viscous=compared)


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """Stiffness over desired stiffness with its error in a narrow panel, and damping over desired
    damping, one above the other; several joints stand side by side."""
    parts = style.by_place(table)
    placed = [{symbol: with_places(part, symbol) for symbol in "KB"} for _, part in parts]
    has_error = bool((table["K_d"] > 0).any())
    longest = max(span_of(trials) for of_part in placed for trials in of_part.values())
    width = style.DOUBLE_COLUMN
    if len(parts) == 1 and longest * Layout.WIDEST_MARKER <= style.SINGLE_COLUMN - Layout.MARGIN:
        width = style.SINGLE_COLUMN
    inches = width / len(parts) - Layout.MARGIN
    has_desired = style.has_values(table, "K_d") or style.has_values(table, "B_d")
    panel_height = Layout.PANEL_HEIGHT if has_desired else Layout.PANEL_HEIGHT + Layout.NAME_HEIGHT
    height = Layout.LEGEND_HEIGHT + panel_height * (2 + style.NARROW * has_error)
    titles = [title for title, _ in parts]
    figure, axes = style.panels(
        width, height, 2 + has_error, len(parts), titles=titles, narrow=[1] if has_error else []
    )
    for column, trials in enumerate(placed):
        stiffness, *errors, damping = axes[column :: len(parts)]
        draw_trials(stiffness, "K", trials["K"], inches)
        draw_axis(stiffness, "K", trials["K"], inches, is_labelled=not has_error)
        for error in errors:
            draw_errors(error, trials["K"], inches)
        draw_trials(damping, "B", trials["B"], inches)
        draw_axis(damping, "B", trials["B"], inches)

    keys = marks.estimate_keys(table, "K")
    if has_desired:
        keys.append(marks.key("Desired", **DESIRED_LINE))
    if style.has_values(table, "B_viscous"):
        keys.append(marks.key("Viscous damping", markersize=Layout.VISCOUS_SIZE, **VISCOUS_MARK))
    marks.legend_above(figure, keys)
    return figure


def with_places(trials: pl.DataFrame, symbol: str) -> pl.DataFrame:
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
        The rows in order, with `x`, their places from 0 on. Trials without a desired value stand
        last.
    """
    desired = f"{symbol}_d"
    numbered = [
        rows.with_columns(number=pl.lit(number))
        for number, (_, rows) in enumerate(style.by_controller(trials))
    ]
    rows = pl.concat(numbered).sort(
        desired, "number", OTHER[symbol], nulls_last=True, maintain_order=True
    )

    def is_new(column: str) -> pl.Expr:
        """Whether a trial differs from the one before it."""
        return pl.col(column).ne_missing(pl.col(column).shift())

    of_controllers = (
        pl.when(is_new("number")).then(Layout.NEXT_CONTROLLER).otherwise(Layout.NEXT_TRIAL)
    )
    place = pl.when(is_new(desired)).then(Layout.NEXT_VALUE).otherwise(of_controllers).cum_sum()
    return rows.with_columns(x=place - place.first())


def span_of(placed: pl.DataFrame) -> float:
    """Length of the axis of these trials, in its unit."""
    return max(float(placed["x"][-1]) + 2 * Layout.EDGE, Layout.FEWEST_PLACES)


def draw_trials(ax: Axes, symbol: str, placed: pl.DataFrame, inches: float) -> None:
    """One quantity of the trials at their places `x` on an axis of this length [in]: estimates with
    their bars, the viscous damping beside the damping, and a black line at each desired value."""
    share = marker_share(placed, inches)
    for look, trials in style.by_controller(placed):
        marks.draw_estimates(ax, trials, "x", symbol, replace(look, size=share * look.size))
    if symbol == "B":
        ax.plot(
            placed["x"], placed["B_viscous"],
            linestyle="", markersize=Layout.VISCOUS_SIZE * share, zorder=4, **VISCOUS_MARK,
        )  # fmt: skip
    ax.set_ylabel(style.AXIS_LABELS[symbol])
    for group in placed.partition_by(f"{symbol}_d"):
        value = group[f"{symbol}_d"][0]
        if value is not None:
            ends = (group["x"][0] - Layout.BESIDE_TRIALS, group["x"][-1] + Layout.BESIDE_TRIALS)
            ax.hlines(value, *ends, **DESIRED_LINE)


def marker_share(placed: pl.DataFrame, inches: float) -> float:
    """Size of the markers at which those of neighbours are apart, of the usual one."""
    unit = inches / span_of(placed)
    return max(min(unit / Layout.WIDEST_MARKER, 1.0), Layout.SMALLEST_SHARE)


def draw_errors(ax: Axes, placed: pl.DataFrame, inches: float) -> None:
    """By how many percent the stiffness of the trials differs from the desired one, on an axis that
    is linear about 0 and logarithmic beyond."""
    percent = (pl.col(STIFFNESS) / pl.col("K_d") - 1) * 100
    rows = placed.filter(pl.col("K_d") > 0).with_columns(percent)
    share = marker_share(placed, inches)
    for look, trials in style.by_controller(rows):
        marks.draw_estimates(ax, trials, "x", "K", replace(look, size=share * look.size))
    ax.axhline(0, **DESIRED_LINE)
    ax.set_yscale("symlog", linthresh=Layout.LINEAR_PERCENT, linscale=Layout.LINEAR_SHARE)
    ax.margins(y=0.1)
    low, high = ax.get_ylim()
    ticks = [tick for tick in Layout.ERROR_TICKS if low <= tick <= high]
    ax.set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    ax.set_yticks([], minor=True)
    ax.set_ylabel("Error (%)")
    draw_axis(ax, "K", placed, inches)


def draw_axis(
    ax: Axes, symbol: str, placed: pl.DataFrame, inches: float, is_labelled: bool = True
) -> None:
    """The axis of desired values, or else of trials, with a line between two of them."""
    desired = f"{symbol}_d"
    groups = placed.partition_by(desired)
    for left, right in pairwise(groups):
        ax.axvline((left["x"][-1] + right["x"][0]) / 2, color=style.GRID_GREY, linewidth=0.5)
    free = span_of(placed) - placed["x"][-1]
    ax.set_xlim(-free / 2, span_of(placed) - free / 2)
    ax.tick_params(axis="x", length=0)
    if not is_labelled:
        ax.set_xticks([])
    elif style.has_values(placed, desired):
        ax.set_xlabel(style.AXIS_LABELS[desired])
        values = [group[desired][0] for group in groups]
        labels = [f"{value:g}" if value is not None else "not stated" for value in values]
        label_groups(ax, groups, labels, inches)
    else:
        ax.set_xlabel("Trial")
        groups = placed.partition_by("trial")
        ends_of_names = [
            style.drawn_name(rows["trial"][0][-Layout.LONGEST_NAME :]) for rows in groups
        ]
        label_groups(ax, groups, ends_of_names, inches)


def label_groups(
    ax: Axes, groups: Sequence[pl.DataFrame], labels: Sequence[str], inches: float
) -> None:
    """Write below the middle of each group its label: upright where the axis is too short for all,
    and only some of very many."""
    middles = [group["x"].to_numpy().mean() for group in groups]
    is_long = sum(len(label) + 2 for label in labels) > style.LETTERS_PER_INCH * inches
    every = 1 + int(len(labels) / (style.LETTERS_PER_INCH / 2 * inches)) if is_long else 1
    ax.set_xticks(middles[::every], labels[::every], rotation=90 if is_long else 0)
