# SPDX-License-Identifier: Apache-2.0
"""Fig. 3: torque against deflection of the belt."""

from collections.abc import Sequence
from typing import Any

import polars as pl
from matplotlib.axes import Axes

from osl_analysis.bench.summaries import PLACE
from osl_analysis.figures import style
from osl_analysis.stats.doubts import is_doubtful
from osl_analysis.stats.rounding import written

DASHES = {"loading": "-", "unloading": "--"}
TRIAL_WIDTH = 0.4  # of the line of a trial [pt]; ten trials of one belt nearly coincide
TRIAL: Any = {
    "color": style.GREY,
    "linewidth": TRIAL_WIDTH,
    "alpha": 0.6,
    "zorder": 1,
    "label": "Trials",
}
DOUBTFUL_TRIAL: Any = {"color": style.BLACK, "ls": ":", "label": "Doubtful fit"}
MEAN_LINE: Any = {
    "color": style.MAGENTA,
    "linestyle": "--",
    "label": "Mean slope while loading",
}
LOOP_COLOURS: Any = {"loading": style.BLACK, "unloading": style.GREY}
MOST_NAMED = 12  # loops whose names have room beside (b); of more, every second, third ...
NAME_LETTERS = 12


DEVIATION = pl.col("torque") - pl.col("mean_slope")  # [N*m]


def points(curves: pl.DataFrame, table: pl.DataFrame, summary: pl.DataFrame) -> pl.DataFrame:
    """The plotted numbers of Fig. 3 for each joint and side.

    Parameters
    ----------
    curves
        `belt_curve` of each trial.
    table
        `belt.csv` with its doubts; place and doubts are used.
    summary
        `belt_summary.csv`.

    Returns
    -------
    DataFrame
        The curves with the torque of the mean slope [N*m], the shift of each trial's loop in (b)
        [N*m], and the doubts about its fit. The mean slope is K_s, or that of all trials where all
        are doubtful.
    """
    trial_facts = table.select(
        "trial", *PLACE, "doubtful", slope="K_s", is_doubtful=is_doubtful(table)
    )
    mean_slopes = summary.filter(quantity="K_s").select(
        *PLACE, K_s="mean", K_s_low="low", K_s_high="high"
    )
    joined = curves.join(trial_facts, "trial", how="left", maintain_order="left")
    joined = joined.join(mean_slopes, PLACE, how="left", nulls_equal=True, maintain_order="left")
    slope = pl.coalesce("K_s", pl.col("slope").mean().over(PLACE))
    joined = joined.with_columns(mean_slope=slope * pl.col("theta_s_deg").radians())
    return joined.with_columns(loop_shift=loop_shift().over(PLACE))


def loop_shift() -> pl.Expr:
    """The shift of each trial's loop [N*m], which keeps loops from covering one another.

    It is one step for each trial with a smaller slope. A step is the median height of a loop,
    rounded up to 0.1 N*m.
    """
    deviation = DEVIATION
    height = (deviation.max() - deviation.min()).over("trial")
    step = (height.median() * 10).ceil() / 10
    rank = pl.col("slope").rank("dense") - 1
    return rank * step


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) torque over deflection and the mean slope, (b) torque minus that of the mean slope, a
    loop per trial; the panels of several joints stand side by side."""
    parts = style.by_place(table)
    width = style.SINGLE_COLUMN if len(parts) == 1 else style.DOUBLE_COLUMN
    titles = [title for title, _ in parts]
    heights = [1, 1.5]
    figure, axes = style.panels(
        width, 5, 2, len(parts), titles, sharex="col", height_ratios=heights
    )
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
    """Every loop above those of smaller slopes, around a line at its own zero, which has the name
    of the trial; a loop leads to its trial."""
    trials = part.sort("loop_shift", maintain_order=True).partition_by("trial")
    for trial in trials:
        shift = trial["loop_shift"][0]
        ax.axhline(shift, color=style.GRID_GREY, linewidth=0.5, zorder=0)
        for branch, dash in DASHES.items():
            # without a line from the end of one cycle to the next
            shifted = pl.when(branch=branch).then(DEVIATION + pl.col("loop_shift"))
            (line,) = ax.plot(
                trial["theta_s_deg"],
                trial.select(shifted),
                dash,
                color=LOOP_COLOURS[branch],
                linewidth=0.6,
                label=branch.capitalize(),
            )
            line.set_url(style.place_in_report(trial["trial"][0]))

    every = 1 + (len(trials) - 1) // MOST_NAMED
    zeros = [trial["loop_shift"][0] for trial in trials[::every]]
    names = [style.drawn_name(trial["trial"][0], NAME_LETTERS) for trial in trials[::every]]
    ax.set_yticks(zeros, names)
    ax.tick_params(axis="y", length=0)
    draw_scale(ax, trials)
    ax.set_xlabel(r"Belt deflection $\theta_s$ (deg)")
    ax.set_ylabel("Torque minus mean slope")


def draw_scale(ax: Axes, trials: Sequence[pl.DataFrame]) -> None:
    """A bar of one step between loops, in place of an axis of torque."""
    shifts = sorted({trial["loop_shift"][0] for trial in trials})
    step = shifts[1] - shifts[0] if len(shifts) > 1 else 1.0
    bar = ax.errorbar(
        1.02,
        shifts[0] + step / 2,
        yerr=step / 2,
        color=style.BLACK,
        transform=ax.get_yaxis_transform(),
        clip_on=False,
    )
    bar.lines[2][0].set_clip_on(False)
    ax.text(
        1.04,
        shifts[0] + step / 2,
        f"{step:g} N·m",
        rotation=90,
        va="center",
        transform=ax.get_yaxis_transform(),
    )
