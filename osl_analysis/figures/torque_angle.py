"""Torque against angle of every trial, loading and unloading, beside the desired curves; stiffness over angle."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from osl_analysis.figures import style
from osl_analysis.figures.names import (
    PLACE,
    UNIT_OF,
    as_text,
    count_of,
    doubtful_said,
    drawn_name,
    of_place,
    placed_rows,
)

TABLE_COLUMNS = (
    "trial", "branch", "angle_deg", "torque", "stiffness", "stiffness_low", "stiffness_high", "desired_torque",
    "desired",
)  # fmt: skip
"""Columns of `torque_angle_curves.csv` that are drawn."""
COLUMNS = (*PLACE, *TABLE_COLUMNS, "doubtful")
WITH_DESIRED = (style.MAGENTA, style.ORANGE, style.PURPLE, "#6B3A0A")
"""Colours of the desired curves and of the trials that should follow them."""
LIGHTEST = 0.6  # part of the colour map that is used: what is lighter stands out from white by less than three to one
LOADING_WIDTH, UNLOADING_WIDTH = 1.1, 0.6
MOST_CURVES = 16  # largest number of trials of a panel that are named
LONGEST_CURVE_NAME = 18  # letters of such a name


def points(curves: pl.DataFrame, table: pl.DataFrame) -> pl.DataFrame:
    facts = of_place(table).select("trial", *PLACE, "doubtful")
    joined = curves.select(TABLE_COLUMNS).join(facts, on="trial", how="left", maintain_order="left")
    return joined.select(COLUMNS)


def caption(table: pl.DataFrame) -> str:
    said = [
        f"Torque against angle of {count_of(table['trial'].n_unique(), 'trial')}, moved slowly. (a) Torque, thick "
        "while loading and thin while unloading. (b) Slope of torque over angle while loading; shaded: its 95 % "
        "interval."
    ]
    if table["desired_torque"].count():
        said.append("Dashed: the curves that the trials of this colour were designed for.")
    for trial in table.partition_by("trial", maintain_order=True)[:MOST_CURVES]:
        loading = trial.filter(pl.col("branch") == "loading")
        (low, high), slopes = ends_of(loading, "torque"), loading["stiffness"].drop_nulls().to_numpy()
        steepest = f", steepest {np.max(slopes):.4g} {UNIT_OF['K']}" if len(slopes) else ""
        said.append(f"{as_text(trial['trial'][0])}: {low:.3g} to {high:.3g} N·m{steepest}.".replace("-", "−"))
    fits = table.unique("trial", maintain_order=True)
    return " ".join([*said, doubtful_said(fits, "drawn dotted", fit="trial")])


def ends_of(branch: pl.DataFrame, column: str) -> tuple[float, float]:
    ordered = branch.drop_nulls(column).sort("angle_deg")[column]
    return float(ordered[0]), float(ordered[-1])


@style.paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) Torque against angle, desired curves dashed; (b) stiffness while loading with its 95 % interval."""
    parts, colours = placed_rows(table), colours_of(table)
    names = [name for name, _ in parts for _ in range(2)]
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3.0 * len(parts) + 0.3, rows=len(parts), columns=2, names=names)
    for number, (_, part) in enumerate(parts):
        draw_place(axes[2 * number], axes[2 * number + 1], part, colours)
    figure.legend(handles=line_entries(table), loc="outside upper center", ncols=4)
    for number, (_, part) in enumerate(parts):
        for ax, column in zip(axes[2 * number : 2 * number + 2], ("torque", "stiffness"), strict=True):
            name_curves(ax, part, column, colours)
    return figure


def name_curves(ax: Axes, table: pl.DataFrame, column: str, colours: Mapping[str, str]) -> None:
    loading = table.filter(pl.col("branch") == "loading").drop_nulls(column).sort("angle_deg")
    last = loading.unique("trial", keep="last", maintain_order=True)
    if len(last) <= MOST_CURVES:
        names = [drawn_name(name.replace("_", " "), LONGEST_CURVE_NAME) for name in last["trial"]]
        ends = last.select("angle_deg", column).rows()
        style.link_to_trials(style.name_ends(ax, ends, names, [colours[name] for name in last["trial"]]), last["trial"])


def draw_place(left: Axes, right: Axes, table: pl.DataFrame, colours: Mapping[str, str]) -> None:
    for trial in table.partition_by("trial", maintain_order=True):
        draw_trial(left, right, trial, colours[trial["trial"][0]])
    wanted = table.filter(pl.col("desired").is_not_null())
    for curve in wanted.partition_by("desired", maintain_order=True):
        line = curve.drop_nulls("desired_torque").unique("angle_deg").sort("angle_deg")
        colour = colours[curve["trial"][0]]
        left.plot(
            line["angle_deg"], line["desired_torque"], color=colour, linestyle=style.DASHED, linewidth=LOADING_WIDTH
        )
    for ax in (left, right):
        ax.axhline(0, color=style.BLACK, linewidth=0.4)
        ax.axvline(0, color=style.BLACK, linewidth=0.4)
        ax.set_xlabel("Joint angle (deg)")
    left.set_ylabel("Resisting torque (N·m)")
    right.set_ylabel("Stiffness while loading (N·m/rad)")


def colours_of(table: pl.DataFrame) -> Mapping[str, str]:
    """A colour per trial: those with a desired curve share its colour, the others go through a colour map in order."""
    trials = table.select("trial", "desired").unique(maintain_order=True).rows()
    wanted = list(dict.fromkeys(desired for _, desired in trials if desired is not None))
    others = [trial for trial, desired in trials if desired is None]
    shades = mpl.colormaps["viridis"](np.linspace(0, LIGHTEST, max(len(others), 1)))
    plain = {trial: to_hex(shade) for trial, shade in zip(others, shades, strict=False)}
    return {
        trial: plain[trial] if desired is None else WITH_DESIRED[wanted.index(desired) % len(WITH_DESIRED)]
        for trial, desired in trials
    }


def draw_trial(left: Axes, right: Axes, trial: pl.DataFrame, colour: str) -> None:
    dash = style.DOTTED if len(trial.filter(style.DRAWN_OPEN)) else "-"
    for branch, width in (("loading", LOADING_WIDTH), ("unloading", UNLOADING_WIDTH)):
        rows = trial.filter(pl.col("branch") == branch)
        left.plot(rows["angle_deg"], rows["torque"], color=colour, linewidth=width, linestyle=dash)
    rows = trial.filter(pl.col("branch") == "loading").drop_nulls("stiffness")
    right.plot(rows["angle_deg"], rows["stiffness"], color=colour, linewidth=LOADING_WIDTH, linestyle=dash)
    band = rows.drop_nulls(["stiffness_low", "stiffness_high"])
    right.fill_between(
        band["angle_deg"], band["stiffness_low"], band["stiffness_high"], color=colour, alpha=0.25, linewidth=0
    )


def line_entries(table: pl.DataFrame) -> list[Line2D]:
    entries = [
        Line2D([], [], color=style.BLACK, linewidth=LOADING_WIDTH, label="Loading"),
        Line2D([], [], color=style.BLACK, linewidth=UNLOADING_WIDTH, label="Unloading"),
    ]
    if table["desired_torque"].count():
        entries.append(
            Line2D([], [], color=style.BLACK, linewidth=LOADING_WIDTH, linestyle=style.DASHED, label="Desired")
        )
    if len(table.filter(style.DRAWN_OPEN)):
        entries.append(
            Line2D([], [], color=style.BLACK, linewidth=LOADING_WIDTH, linestyle=style.DOTTED, label="Doubtful trial")
        )
    return entries
