"""Figure `torque_angle`: torque against angle of a joint that is moved slowly."""

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from osl_analysis.figures import columns_of, marks, names, style
from osl_analysis.judge.judging import doubts_of_result

FACTS = ("joint", "side", "doubtful")  # of trials, beside their curves
WIDTHS = {"loading": 1.1, "unloading": 0.6}  # of curves [pt]
OF_DESIRED = (style.MAGENTA, style.ORANGE, style.PURPLE, "#6B3A0A")
# share of a colour map from its dark end on: beyond, it stands out from white by less than 3 to 1
DARK_ENOUGH = 0.6
MOST_NAMED = 16  # trials in the legend; of more, none is named


def points(curves: pl.DataFrame, trials: pl.DataFrame) -> pl.DataFrame:
    """The curves, with joint, side and doubts of their trials."""
    facts = trials.select("trial", *(name for name in FACTS if name in trials.columns))
    curves = curves.select(name for name in columns_of("torque_angle") if name not in FACTS)
    return curves.join(facts, on="trial", how="left", maintain_order="left")


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) torque over angle, (b) stiffness while loading; two panels for each joint."""
    parts = names.by_place(table)
    colours = colours_of_trials(table)
    titles = []
    for title, _ in parts:
        titles += [title, title]
    height = 3.0 * len(parts) + 0.3
    figure, axes = style.panels(style.DOUBLE_COLUMN, height, len(parts), 2, titles=titles)
    for number, (_, part) in enumerate(parts):
        torque, stiffness = axes[2 * number : 2 * number + 2]
        draw_torque_curves(torque, part, colours)
        draw_stiffness_curves(stiffness, part, colours)
        for ax in (torque, stiffness):
            ax.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE)
            ax.axvline(0, color=style.BLACK, linewidth=style.HAIRLINE)
            ax.set_xlabel("Joint angle (deg)")
        torque.set_ylabel("Resisting torque (N·m)")
        stiffness.set_ylabel("Stiffness while loading (N·m/rad)")

    keys = [
        marks.key(branch.capitalize(), color=style.BLACK, linewidth=width)
        for branch, width in WIDTHS.items()
    ]
    if names.has_values(table, "desired_torque"):
        keys.append(marks.key("Desired", color=style.BLACK, linestyle=style.DASHED))
    if marks.has_doubtful(table):
        keys.append(marks.key("Doubtful trial", color=style.BLACK, linestyle=style.DOTTED))
    if len(colours) <= MOST_NAMED:
        for trial, colour in colours.items():
            keys.append(marks.key(names.drawn_name(trial), color=colour))
    marks.legend_above(figure, keys)
    figure.align_ylabels()
    return figure


def colours_of_trials(table: pl.DataFrame) -> dict[str, str]:
    """Colours by trial: those with a desired curve share its colour, the others go through a colour
    map in order."""
    trials = table.select("trial", "desired").unique(maintain_order=True)
    wanted = trials["desired"].drop_nulls().unique(maintain_order=True).to_list()
    n_others = trials["desired"].null_count()
    shades = iter(mpl.colormaps["viridis"](np.linspace(0, DARK_ENOUGH, max(n_others, 1))))
    colours = {}
    for trial, desired in trials.iter_rows():
        if desired is None:
            colours[trial] = to_hex(next(shades))
        else:
            colours[trial] = OF_DESIRED[wanted.index(desired) % len(OF_DESIRED)]
    return colours


def draw_torque_curves(ax: Axes, part: pl.DataFrame, colours: dict[str, str]) -> None:
    """Torque of both branches of every trial, and desired torque, over angle."""
    for trial in part.partition_by("trial", maintain_order=True):
        name = trial["trial"][0]
        dash: style.Dash = style.DOTTED if marks.has_doubtful(trial) else "-"
        for branch, width in WIDTHS.items():
            rows = trial.filter(branch=branch)
            (line,) = ax.plot(
                rows["angle_deg"], rows["torque"],
                color=colours[name], linewidth=width, linestyle=dash,
            )  # fmt: skip
            line.set_url(marks.place_in_report(name))
    for curve in part.drop_nulls("desired").partition_by("desired", maintain_order=True):
        desired = curve.drop_nulls("desired_torque").unique("angle_deg").sort("angle_deg")
        ax.plot(
            desired["angle_deg"], desired["desired_torque"],
            color=colours[curve["trial"][0]], linewidth=WIDTHS["loading"], linestyle=style.DASHED,
        )  # fmt: skip


def draw_stiffness_curves(ax: Axes, part: pl.DataFrame, colours: dict[str, str]) -> None:
    """Slope of torque over angle while loading."""
    for trial in part.partition_by("trial", maintain_order=True):
        colour = colours[trial["trial"][0]]
        is_doubtful = bool(doubts_of_result(trial["doubtful"][0] or "", "K"))
        rows = trial.filter(branch="loading").drop_nulls("stiffness")
        ax.plot(
            rows["angle_deg"], rows["stiffness"],
            color=colour, linewidth=WIDTHS["loading"],
            linestyle=style.DOTTED if is_doubtful else "-",
        )  # fmt: skip
