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


OTHER = {"K": "B_d", "B": "K_d"}  # desired value by which trials of one K_d, of one B_d are sorted
DESIRED_LINE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8}
# black, because it may stand on a marker
VISCOUS_MARK: dict[str, Any] = {"marker": "x", "mew": 0.8, "color": style.BLACK}


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes."""
    return impedance.filter(pl.col("amplitude_deg").is_null())


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """Stiffness over desired stiffness, and damping over desired damping: one above the other, and
    of several joints side by side."""
    shown = [
        (title, symbol, with_places(part, symbol))
        for title, part in style.by_place(table)
        for symbol in "KB"
    ]
    across = 1 if len(shown) == 2 else 2
    width, inches = style.DOUBLE_COLUMN, style.DOUBLE_COLUMN / across - Layout.MARGIN
    longest = max(span_of(trials) for _, _, trials in shown)
    if across == 1 and longest * Layout.WIDEST_MARKER <= style.SINGLE_COLUMN - Layout.MARGIN:
        width, inches = style.SINGLE_COLUMN, style.SINGLE_COLUMN - Layout.MARGIN
    down = len(shown) // across
    has_desired = style.has_values(table, "K_d") or style.has_values(table, "B_d")
    panel_height = Layout.PANEL_HEIGHT if has_desired else Layout.PANEL_HEIGHT + Layout.NAME_HEIGHT
    height = min(Layout.LEGEND_HEIGHT + panel_height * down, style.TALLEST)
    titles = [title for title, _, _ in shown]
    figure, axes = style.panels(width, height, down, across, titles=titles)
    for ax, (_, symbol, trials) in zip(axes, shown, strict=True):
        draw_trials(ax, symbol, trials, inches)

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
    unit = inches / span_of(placed)
    share = max(
        min(unit / Layout.WIDEST_MARKER, 1.0), Layout.SMALLEST_SHARE
    )  # markers of neighbours are apart
    for look, trials in style.by_controller(placed):
        marks.draw_estimates(ax, trials, "x", symbol, replace(look, size=share * look.size))
    if symbol == "B":
        ax.plot(
            placed["x"], placed["B_viscous"],
            linestyle="", markersize=Layout.VISCOUS_SIZE * share, zorder=4, **VISCOUS_MARK,
        )  # fmt: skip
    ax.set_ylabel(style.AXIS_LABELS[symbol])

    desired = f"{symbol}_d"
    groups = placed.partition_by(desired)
    values = [group[desired][0] for group in groups]
    for value, group in zip(values, groups, strict=True):
        if value is not None:
            ends = (group["x"][0] - Layout.BESIDE_TRIALS, group["x"][-1] + Layout.BESIDE_TRIALS)
            ax.hlines(value, *ends, **DESIRED_LINE)
    for left, right in pairwise(groups):
        ax.axvline((left["x"][-1] + right["x"][0]) / 2, color=style.GRID_GREY, linewidth=0.5)

    free = span_of(placed) - placed["x"][-1]
    ax.set_xlim(-free / 2, span_of(placed) - free / 2)
    ax.tick_params(axis="x", length=0)
    if style.has_values(placed, desired):
        ax.set_xlabel(style.AXIS_LABELS[desired])
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
