# SPDX-License-Identifier: Apache-2.0
"""Fig. 3: torque against deflection of the belt."""

from typing import Any

import polars as pl
from matplotlib.axes import Axes

from osl_analysis.bench.summaries import PLACE
from osl_analysis.figures import style
from osl_analysis.stats.rounding import written

DASHES = {"loading": "-", "unloading": "--"}
TRIAL: Any = {"color": style.LIGHT_GREY, "zorder": 1, "label": "Trials"}
DOUBTFUL_TRIAL: Any = {"color": style.BLACK, "ls": ":", "label": "Doubtful fit"}
MEAN_LINE: Any = {
    "color": style.MAGENTA,
    "linestyle": "--",
    "label": "Mean slope while loading",
}


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
        The curves with the torque of the mean slope [N*m], which is K_s, or where all trials are
        doubtful the mean slope of all, and why a fit is doubtful.
    """
    of_trials = table.select("trial", *PLACE, "doubtful", slope="K_s")
    of_belts = summary.filter(quantity="K_s").select(
        *PLACE, K_s="mean", K_s_low="low", K_s_high="high"
    )
    joined = curves.join(of_trials, "trial", how="left", maintain_order="left")
    joined = joined.join(of_belts, PLACE, how="left", nulls_equal=True, maintain_order="left")
    slope = pl.coalesce("K_s", pl.col("slope").mean().over(PLACE))
    return joined.with_columns(mean_slope=slope * pl.col("theta_s_deg").radians())


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) torque over deflection and the mean slope, (b) torque minus that of the mean slope; the
    panels of several joints stand side by side."""
    parts = style.by_place(table)
    width = style.SINGLE_COLUMN if len(parts) == 1 else style.DOUBLE_COLUMN
    titles = [title for title, _ in parts]
    figure, axes = style.panels(width, 4, 2, len(parts), titles, sharex="col")
    for column, (_, part) in enumerate(parts):
        draw_belts(axes[column], part)
        draw_loops(axes[len(parts) + column], part)
    style.legend_above(figure, style.labelled(axes))
    return figure


def draw_belts(ax: Axes, part: pl.DataFrame) -> None:
    """Torque over deflection of each trial, doubtful ones dotted; the mean slope, and its
    number."""
    trials = part.partition_by("trial")
    for trial in trials:
        look = DOUBTFUL_TRIAL if style.has_doubtful(trial) else TRIAL
        ax.plot(trial["theta_s_deg"], trial["torque"], **look)
    ends = part.sort("theta_s_deg")[[0, -1]]
    ax.plot(ends["theta_s_deg"], ends["mean_slope"], **MEAN_LINE)
    ax.set_ylabel("Joint torque (N·m)")
    n = sum(not style.has_doubtful(trial) for trial in trials)
    text = "All trials are doubtful"
    if n:
        K_s = written(*part.select("K_s", "K_s_low", "K_s_high").row(0))
        text = rf"$\hat{{K}}_s$ = {K_s} N·m/rad, $n$ = {n}"
    ax.set_title(text, loc="right")


def draw_loops(ax: Axes, part: pl.DataFrame) -> None:
    """Every loop; each leads to its trial."""
    ax.axhline(0, **MEAN_LINE)
    deviation = pl.col("torque") - pl.col("mean_slope")
    for trial in part.partition_by("trial"):
        for branch, dash in DASHES.items():
            # without a line from the end of one cycle to the next
            of_branch = trial.select(pl.when(branch=branch).then(deviation))
            (line,) = ax.plot(
                trial["theta_s_deg"],
                of_branch,
                dash,
                color=style.GREY,
                linewidth=0.5,
                label=branch.capitalize(),
            )
            line.set_url(style.place_in_report(trial["trial"][0]))
    ax.set_xlabel(r"Belt deflection $\theta_s$ (deg)")
    ax.set_ylabel("Torque minus\nmean slope (N·m)")
