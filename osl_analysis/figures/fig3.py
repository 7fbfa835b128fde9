"""Fig. 3: torque against deflection of the transmission, every trial, and the mean stiffness."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.figures.names import placed_rows
from osl_analysis.figures.style import (
    BLACK,
    DOTTED,
    DOUBLE_COLUMN,
    GREY,
    IS_DOUBTFUL,
    MAGENTA,
    SINGLE_COLUMN,
    panels,
    paper_style,
)

COLUMNS = ("joint", "side", "trial", "branch", "theta_s_deg", "torque", "K_s", "K_s_low", "K_s_high", "doubtful")
MOST_ACROSS = 3
"""Panels side by side."""
MEAN_SLOPE = "mean slope"
"""Name that takes the place of the trial in the two rows that carry the mean slope."""


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """Trials as transparent grey loops, those with a doubtful fit dotted black, the mean slope dashed magenta; a panel
    for each joint and side.

    Rows per trial in order of time: `branch` (loading or unloading), `theta_s_deg` [deg], `torque` [N*m], and why the
    trial's fit is `doubtful`. The two rows of trial `MEAN_SLOPE` are its ends and carry the stiffness `K_s` [N*m/rad]
    with the bounds of its 95 % interval, `K_s_low` and `K_s_high`.
    """
    parts = placed_rows(table)
    across = min(len(parts), MOST_ACROSS)
    rows = -(-len(parts) // MOST_ACROSS)
    width, names = (SINGLE_COLUMN if across == 1 else DOUBLE_COLUMN), [name for name, _ in parts]
    figure, axes = panels(width, 2.4 * rows, rows=rows, columns=across, names=names)
    for ax, (_, part) in zip(axes, parts, strict=False):
        draw_belts(ax, part)
    for ax in axes[len(parts) :]:
        ax.remove()
    return figure


def draw_belts(ax: Axes, table: pl.DataFrame) -> None:
    """The trials and the mean slope of one joint and side."""
    mean = table.filter(pl.col("trial") == MEAN_SLOPE)
    trials = table.filter(pl.col("trial") != MEAN_SLOPE).partition_by("trial", maintain_order=True)
    for number, trial in enumerate(trials):
        name = f"Trials ($n$ = {len(trials)})" if number == 0 else None
        ax.plot(trial["theta_s_deg"], trial["torque"], color=GREY, alpha=0.35, linewidth=0.9, label=name)
    doubtful = [trial for trial in trials if len(trial.filter(IS_DOUBTFUL))]
    for number, trial in enumerate(doubtful):
        name = f"Doubtful fit ($n$ = {len(doubtful)})" if number == 0 else None
        ax.plot(trial["theta_s_deg"], trial["torque"], color=BLACK, linestyle=DOTTED, linewidth=0.9, label=name)
    ax.plot(
        mean["theta_s_deg"],
        mean["torque"],
        color=MAGENTA,
        linestyle=(0, (3, 2)),
        linewidth=1.3,
        label="Mean slope while loading",
    )
    ax.set_xlabel(r"Transmission deflection $\theta_s$ (deg)")
    ax.set_ylabel("Joint torque (N·m)")
    ax.legend(loc="upper left")
    ax.text(0.98, 0.05, stiffness_text(mean), transform=ax.transAxes, ha="right", va="bottom", linespacing=1.4)


def stiffness_text(mean: pl.DataFrame) -> str:
    """The mean stiffness with its interval, as lettered in the figure; empty where the table gives none."""
    if mean.is_empty():
        return ""
    K_s, low, high = (mean[column][0] for column in ("K_s", "K_s_low", "K_s_high"))
    text = rf"$\hat{{K}}_s = {K_s:.1f}$ N·m/rad"
    return text if low is None or high is None else f"{text}\n95 % interval {low:.1f} to {high:.1f}"
