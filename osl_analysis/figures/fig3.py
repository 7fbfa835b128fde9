# SPDX-License-Identifier: Apache-2.0
"""Fig. 3: torque against deflection of the belt."""

from collections.abc import Sequence
from typing import Any

import polars as pl
from matplotlib.axes import Axes

from osl_analysis.bench.summaries import PLACE
from osl_analysis.figures import marks, style
from osl_analysis.stats.rounding import written

# name that takes the place of the trial in the two rows that carry the mean slope
MEAN_SLOPE = "mean slope"
IS_MEAN = pl.col("trial") == MEAN_SLOPE
BRANCHES: dict[str, style.Dash] = {"loading": "-", "unloading": (0, (6, 3))}
GREY_TRIAL: dict[str, Any] = {"color": style.LIGHT_GREY, "linewidth": 0.9, "zorder": 1}
DOUBTFUL_TRIAL: dict[str, Any] = {"color": style.BLACK, "linestyle": style.DOTTED, "linewidth": 0.9}
MEAN_LINE: dict[str, Any] = {"color": style.MAGENTA, "linestyle": style.DASHED, "linewidth": 1.3}
LOOP_WIDTH = 0.5  # of lines [pt]
TEXT_MARGIN = 0.2  # of the loops' height, below them for the text


def points(curves: pl.DataFrame, table: pl.DataFrame, summary: pl.DataFrame) -> pl.DataFrame:
    """The numbers of Fig. 3 for each joint and side.

    Parameters
    ----------
    curves
        `belt_curve` of each trial.
    table
        `belt.csv`, of which place and doubts are taken.
    summary
        Its summary.

    Returns
    -------
    DataFrame
        The curves with their `deviation` of torque [N*m] from the mean slope, and why a fit is
        doubtful; the mean slope as two points, from 0 to the largest deflection, with the loops'
        mean area [J]. Where all trials are doubtful, it is that of all, without a number.
    """
    doubts = table.select("trial", *PLACE, "doubtful", slope="K_s")
    joined = curves.join(doubts, "trial", how="left", maintain_order="left")
    numbers: list[str] = []
    for quantity in ("K_s", "hysteresis_area"):
        names = {quantity: "mean", f"{quantity}_low": "low", f"{quantity}_high": "high"}
        means = summary.filter(quantity=quantity).select(*PLACE, **names)
        joined = joined.join(means, PLACE, how="left", nulls_equal=True, maintain_order="left")
        numbers += names
    joined = joined.with_columns(slope=pl.coalesce("K_s", pl.col("slope").mean().over(PLACE)))
    on_slope = pl.col("slope") * pl.col("theta_s_deg").radians()

    largest = joined.sort(pl.col("theta_s_deg").abs()).group_by(PLACE, maintain_order=True).last()
    ends = pl.concat([largest.with_columns(theta_s_deg=0.0), largest])
    lines = ends.with_columns(trial=pl.lit(MEAN_SLOPE), branch=pl.lit("loading"), torque=on_slope)
    lines = lines.drop("doubtful")
    curves = joined.with_columns(deviation=pl.col("torque") - on_slope).drop(numbers)
    return pl.concat([curves, lines], how="diagonal")


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) torque over deflection and the mean slope, (b) torque minus that of the mean slope; the
    panels of several joints stand side by side."""
    parts = style.by_place(table)
    width = style.SINGLE_COLUMN if len(parts) == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(
        width, 4.0, rows=2, columns=len(parts), titles=[title for title, _ in parts], share_x=True
    )
    for column, (_, part) in enumerate(parts):
        trials = part.filter(~IS_MEAN).partition_by("trial")
        mean = part.filter(IS_MEAN)
        draw_belts(axes[column], trials, mean)
        draw_loops(axes[len(parts) + column], trials, mean)

    keys = [marks.key("Trials", **GREY_TRIAL), marks.key("Mean slope while loading", **MEAN_LINE)]
    for branch, dash in BRANCHES.items():
        line = {"color": style.BLACK, "linestyle": dash, "linewidth": LOOP_WIDTH}
        keys.append(marks.key(branch.capitalize(), **line))
    if marks.has_doubtful(table):
        keys.append(marks.key("Doubtful fit", **DOUBTFUL_TRIAL))
    marks.legend_above(figure, keys)
    return figure


def draw_belts(ax: Axes, trials: Sequence[pl.DataFrame], mean: pl.DataFrame) -> None:
    """Torque over deflection of each trial, doubtful ones dotted; the mean slope, and its
    number."""
    for trial in trials:
        look = DOUBTFUL_TRIAL if marks.has_doubtful(trial) else GREY_TRIAL
        ax.plot(trial["theta_s_deg"], trial["torque"], **look)
    ax.plot(mean["theta_s_deg"], mean["torque"], **MEAN_LINE)
    ax.set_ylabel("Joint torque (N·m)")
    K_s = mean.select("K_s", "K_s_low", "K_s_high").row(0)
    n = sum(not marks.has_doubtful(trial) for trial in trials)
    text = (
        rf"$\hat{{K}}_s$ = {written(*K_s)} N·m/rad, $n$ = {n}" if n else "All trials are doubtful"
    )
    ax.text(0.99, 0.04, text, transform=ax.transAxes, ha="right", va="bottom")


def draw_loops(ax: Axes, trials: Sequence[pl.DataFrame], mean: pl.DataFrame) -> None:
    """Every loop; each leads to its trial."""
    ax.axhline(0, **MEAN_LINE)
    ax.margins(y=TEXT_MARGIN)
    for trial in trials:
        for branch, dash in BRANCHES.items():
            # without a line from the end of one cycle to the next
            of_branch = trial.select(pl.when(branch=branch).then("deviation"))
            (line,) = ax.plot(
                trial["theta_s_deg"], of_branch,
                color=style.GREY, linewidth=LOOP_WIDTH, linestyle=dash,
            )  # fmt: skip
            line.set_url(marks.place_in_report(trial["trial"][0]))
    areas = mean.drop_nulls("hysteresis_area")
    if not areas.is_empty():
        area = written(
            *areas.select(f"hysteresis_area{end}" for end in ("", "_low", "_high")).row(0)
        )
        ax.text(0.02, 0.04, f"Mean loop area {area} J", transform=ax.transAxes, va="bottom")
    ax.set_xlabel(r"Belt deflection $\theta_s$ (deg)")
    ax.set_ylabel("Torque minus\nmean slope (N·m)")
