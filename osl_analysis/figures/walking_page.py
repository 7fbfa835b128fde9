"""The walking page: how the responses of Fig. 9 follow from perturbed and unperturbed crossings."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from osl_analysis.figures.style import (
    BLACK,
    DOTTED,
    DOUBLE_COLUMN,
    GREY,
    IS_DOUBTFUL,
    ORANGE,
    PALE_ORANGE,
    PURPLE,
    paper_style,
)

COLUMNS = ("group", "panel", "curve", "trial", "x", "mean", "sd", "doubtful")
GAIT = {"unperturbed": (PURPLE, "Unperturbed"), "perturbed": (ORANGE, "Perturbed")}
STANCE = "Stance (%)"
AFTER_ONSET = "Time from the platform’s onset (ms)"


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """Over stance (a) angle and (b) torque, over time (c) isolated angle and (d) isolated torque, for each group.

    (a) and (b) show mean and SD of unperturbed and perturbed crossings, (c) and (d) every perturbation, their mean, and
    the fit of Eq. 15 to the mean. The fitted window is shaded. Perturbations with a doubtful fit are dotted.
    """
    groups = table.partition_by("group", maintain_order=True)
    figure = Figure(figsize=(DOUBLE_COLUMN, 4.4 * len(groups)), layout="constrained")
    parts = figure.subfigures(len(groups), 1, squeeze=False)[:, 0]
    for part, rows in zip(parts, groups, strict=True):
        if len(groups) > 1:
            part.suptitle(rows["group"][0], fontsize=9)
        draw_group(part.subplots(2, 2), rows)
    return figure


def draw_group(axes: NDArray[np.object_], table: pl.DataFrame) -> None:
    """The four panels (2, 2) of one group."""
    for ax, letter in zip(axes.ravel(), "abcd", strict=True):
        ax.set_title(f"({letter})", loc="left")
    window = curve(table, "angle", "window")["x"]
    for ax, panel in zip(axes[0], ("angle", "torque"), strict=True):
        draw_gait(ax, table.filter(pl.col("panel") == panel), float(window[0]), float(window[1]))
    for ax, panel in zip(axes[1], ("response angle", "response torque"), strict=True):
        draw_response(ax, table, panel)
    axes[0, 0].set_ylabel("Ankle angle, dorsiflexion up (deg)")
    axes[0, 1].set_ylabel("Ankle torque (N·m)")
    axes[1, 0].set_ylabel("Isolated angle (deg)")
    axes[1, 1].set_ylabel("Isolated torque (N·m)")
    axes[0, 1].legend(loc="upper left", handlelength=1.1, handletextpad=0.5)
    axes[1, 1].legend(loc="upper left")


def curve(table: pl.DataFrame, panel: str, name: str) -> pl.DataFrame:
    """The rows of one curve of one panel."""
    return table.filter((pl.col("panel") == panel) & (pl.col("curve") == name))


def draw_gait(ax: Axes, rows: pl.DataFrame, start: float, end: float) -> None:
    """Mean and one SD on either side, over stance, with the fitted window from `start` to `end` [%]."""
    ax.axvspan(start, end, color=PALE_ORANGE, alpha=0.5, linewidth=0, label="Fitted window")
    for name, (colour, label) in GAIT.items():
        one = rows.filter(pl.col("curve") == name)
        x, mean, sd = (one[column].to_numpy() for column in ("x", "mean", "sd"))
        ax.fill_between(x, mean - sd, mean + sd, color=colour, alpha=0.25, linewidth=0)
        ax.plot(x, mean, color=colour, label=f"{label} ($n$ = {int(one['n'][0])})")
    ax.set_xlim(0, 100)
    ax.set_xlabel(STANCE)


def draw_response(ax: Axes, table: pl.DataFrame, panel: str) -> None:
    """Every perturbation thin, their mean, and where the table has one its fit, with the fitted window shaded."""
    every = curve(table, panel, "each")
    fitted = curve(table, "response torque", "fit")["x"]
    ax.axvspan(float(fitted[0]), float(fitted[-1]), color=PALE_ORANGE, alpha=0.5, linewidth=0)
    trials = every.partition_by("trial", maintain_order=True)
    for number, one in enumerate(trials):
        ax.plot(
            one["x"], one["mean"], color=GREY, alpha=0.45, linewidth=0.5, label=None if number else "Each perturbation"
        )
    doubtful = [one for one in trials if len(one.filter(IS_DOUBTFUL))]
    for number, one in enumerate(doubtful):
        label = None if number else f"Doubtful fit ($n$ = {len(doubtful)})"
        ax.plot(one["x"], one["mean"], color=BLACK, linewidth=0.7, linestyle=DOTTED, label=label)
    mean, fit = curve(table, panel, "mean"), curve(table, panel, "fit")
    ax.plot(mean["x"], mean["mean"], color=BLACK, linewidth=1.4, label="Mean")
    if not fit.is_empty():
        label = r"Fit of $K\theta + B\dot\theta + I\ddot\theta$"
        ax.plot(fit["x"], fit["mean"], color=ORANGE, linewidth=1.4, linestyle=(0, (3, 2)), label=label)
    ax.axhline(0, color=BLACK, linewidth=0.4)
    ax.set_xlim(float(every["x"].min()), float(every["x"].max()))  # type: ignore[arg-type]
    ax.set_xlabel(AFTER_ONSET)
