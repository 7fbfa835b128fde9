"""The walking page: how the responses of Fig. 9 follow from perturbed and unperturbed crossings."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from osl_analysis.figures import style
from osl_analysis.figures.names import as_text, count_of, decimals_of, doubtful_said, drawn_name, rounded_number

COLUMNS = ("group", "panel", "curve", "trial", "x", "mean", "sd", "doubtful")
GAIT = {"unperturbed": (style.PURPLE, "-", "Unperturbed"), "perturbed": (style.ORANGE, (0, (5, 1.5)), "Perturbed")}
RESPONSES = {"response angle": "deg", "response torque": "N·m"}


@style.paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """Over stance (a) angle and (b) torque, over time (c) isolated angle and (d) isolated torque, for each group."""
    groups = table.partition_by("group", maintain_order=True)
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 4.4 * len(groups)), layout="constrained")
    parts = figure.subfigures(len(groups), 1, squeeze=False)[:, 0]
    for part, rows in zip(parts, groups, strict=True):
        if len(groups) > 1:
            part.suptitle(drawn_name(rows["group"][0], 60), fontsize=8)
        axes = part.subplots(2, 2)
        draw_panels(axes, rows)
        found = style.legend_entries((axes[0, 1], axes[1, 1]))
        part.legend(list(found.values()), list(found), loc="outside upper center", ncols=4)
    return figure


def draw_panels(axes: NDArray[np.object_], table: pl.DataFrame) -> None:
    for ax, letter in zip(axes.ravel(), "abcd", strict=True):
        ax.set_title(f"({letter})", loc="left")
    for ax, panel in zip(axes[0], ("angle", "torque"), strict=True):
        draw_intervals(ax, table, "angle")
        draw_gait(ax, table.filter(pl.col("panel") == panel))
    for ax, panel in zip(axes[1], RESPONSES, strict=True):
        draw_intervals(ax, table, "response angle")
        draw_response(ax, table, panel)
    axes[0, 0].set_ylabel("Ankle angle, dorsiflexion up (deg)")
    axes[0, 1].set_ylabel("Ankle torque (N·m)")
    axes[1, 0].set_ylabel("Isolated angle (deg)")
    axes[1, 1].set_ylabel("Isolated torque (N·m)")


def curve(table: pl.DataFrame, panel: str, name: str) -> pl.DataFrame:
    return table.filter((pl.col("panel") == panel) & (pl.col("curve") == name))


def draw_intervals(ax: Axes, table: pl.DataFrame, panel: str) -> None:
    looks: dict[str, dict[str, Any]] = {
        "baseline": {"facecolor": "none", "edgecolor": "#C4C4C4", "hatch": "////", "label": "Baseline"},
        "window": {"color": style.PALE_ORANGE, "alpha": 0.5, "label": "Fitted window"},
    }
    for name, look in looks.items():
        ends = curve(table, panel, name)["x"]
        if len(ends):
            ax.axvspan(float(ends[0]), float(ends[1]), linewidth=0, zorder=0, **look)


def draw_gait(ax: Axes, rows: pl.DataFrame) -> None:
    for name, (colour, dashes, label) in GAIT.items():
        one = rows.filter(pl.col("curve") == name)
        x, mean, sd = (one[column].to_numpy() for column in ("x", "mean", "sd"))
        ax.fill_between(x, mean - sd, mean + sd, color=colour, alpha=0.25, linewidth=0)
        ax.plot(x, mean, color=colour, linestyle=dashes, label=f"{label} ($n$ = {int(one['n'][0])})")
    ax.set_xlim(0, 100)
    ax.set_xlabel("Stance (%)")


def draw_response(ax: Axes, table: pl.DataFrame, panel: str) -> None:
    """Every perturbation thin, their mean, and the fit."""
    every = curve(table, panel, "each")
    trials = every.partition_by("trial", maintain_order=True)
    doubtful = [one for one in trials if len(one.filter(style.DRAWN_OPEN))]
    looks: list[tuple[list[pl.DataFrame], str, dict[str, Any]]] = [
        (trials, "Each perturbation", {"color": style.GREY, "alpha": 0.45, "linewidth": 0.5}),
        (
            doubtful,
            f"Doubtful fit ($n$ = {len(doubtful)})",
            {"color": style.BLACK, "linewidth": 0.7, "linestyle": style.DOTTED},
        ),
    ]
    for drawn, label, look in looks:
        for place, one in enumerate(drawn):
            (line,) = ax.plot(one["x"], one["mean"], label=None if place else label, **look)
            line.set_url(style.place_in_report(one["trial"][0]))
    mean, fit = curve(table, panel, "mean"), curve(table, panel, "fit")
    ax.plot(mean["x"], mean["mean"], color=style.BLACK, linewidth=1.4, label="Mean")
    if not fit.is_empty():
        label = r"Fit of $K\theta + B\dot\theta + I\ddot\theta$"
        ax.plot(fit["x"], fit["mean"], color=style.ORANGE, linewidth=1.4, linestyle=style.DASHED, label=label)
    ax.axhline(0, color=style.BLACK, linewidth=0.4)
    ax.axvline(0, color=style.BLACK, linewidth=0.4)
    ax.set_xlim(float(every["x"].min()), float(every["x"].max()))  # type: ignore[arg-type]
    ax.set_xlabel("Time from the platform’s onset (ms)")


def caption(table: pl.DataFrame) -> str:
    groups = table.partition_by("group", maintain_order=True)
    said = [
        "From crossings to the responses that Fig. 9 fits. (a) Ankle angle and (b) ankle torque over stance, mean ± SD "
        "of unperturbed and perturbed crossings. (c) Isolated angle and (d) isolated torque: every perturbed crossing "
        "minus the mean unperturbed gait at the same phase of stance, their mean, and the fit of Eq. 15 to it in the "
        "shaded window."
    ]
    if len(ends := curve(groups[0], "response angle", "baseline")["x"]):
        said.append(
            f"Each response is zero on average over the hatched baseline, {rounded_number(ends[0], 0)} to "
            f"{rounded_number(ends[1], 0)} ms from the onset, and not at the onset: in between, a crossing's own gait "
            "departs from the mean one, and the zero-phase filter spreads the platform's motion to times before the "
            "onset. The fit has no offset, so that both are in it."
        )
    most = 4
    for rows in groups[:most]:
        name = f"{as_text(rows['group'][0])}: " if len(groups) > 1 else ""
        counts = {name: int(curve(rows, "angle", name)["n"][0]) for name in GAIT}
        crossings = f"{count_of(counts['unperturbed'], 'unperturbed crossing')} and {counts['perturbed']} perturbed"
        said.append(f"{name}{crossings}; {onset_said(rows)}.")
    if len(groups) > most:
        said.append(f"The numbers of {len(groups) - most} more groups stand in walking_page.csv.")
    fits = table.filter(pl.col("curve") == "each").unique("trial", maintain_order=True)
    return " ".join([*said, doubtful_said(fits, "dotted")])


def onset_said(rows: pl.DataFrame) -> str:

    def at_onset(of: pl.DataFrame) -> pl.Series:
        nearest = of.sort(pl.col("x").abs(), maintain_order=True).group_by("trial", maintain_order=True).first()
        return nearest["mean"]

    said = []
    for panel, unit in RESPONSES.items():
        mean, each = (at_onset(curve(rows, panel, name)) for name in ("mean", "each"))
        sd = float(each.std()) if len(each) > 1 else 0.0  # type: ignore[arg-type]
        digits = decimals_of(sd or 0.1 * float(mean[0]))
        said.append(
            f"{rounded_number(float(mean[0]), digits)} {unit}" + (f" (SD {rounded_number(sd, digits)})" if sd else "")
        )
    return f"at the onset the mean response is {' and '.join(said)}"
