"""The walking page: from crossings of the walkway to the responses that Fig. 9 fits."""

from typing import Any

import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import marks, style

GAIT: dict[str, tuple[str, style.Dash]] = {  # colour and line style of a mean
    "unperturbed": (style.PURPLE, "-"),
    "perturbed": (style.ORANGE, (0, (5.0, 1.5))),
}
SHADED: dict[str, dict[str, Any]] = {  # intervals of time
    "baseline": {
        "facecolor": "none", "edgecolor": "#C4C4C4", "hatch": "////", "label": "Baseline",
    },
    "window": {"color": "#F5C09A", "alpha": 0.5, "label": "Fitted window"},
}  # fmt: skip
ISOLATED: dict[str, dict[str, Any]] = {  # lines over time
    "mean": {"color": style.BLACK, "label": "Mean response"},
    "fit": {
        "color": style.ORANGE, "linestyle": style.DASHED,
        "label": r"Fit of $K\theta + B\dot\theta + I\ddot\theta$",
    },
}  # fmt: skip
EACH_LINE: dict[str, Any] = {"color": style.GREY, "alpha": 0.45, "linewidth": 0.5}
DOUBTFUL_LINE: dict[str, Any] = {"color": style.BLACK, "linestyle": style.DOTTED, "linewidth": 0.7}
PANELS = {
    "angle": "Ankle angle, dorsiflexion up (deg)",
    "torque": "Ankle torque (N·m)",
    "response angle": "Isolated angle (deg)",
    "response torque": "Isolated torque (N·m)",
}
PAGE_HEIGHT = 4.4  # of a group [in]


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """Over stance (a) angle and (b) torque, over time (c) isolated angle and (d) isolated torque;
    four panels for each group."""
    groups = table.partition_by("group")
    titles = []
    for rows in groups:
        name = style.drawn_name(rows["group"][0], 60) if len(groups) > 1 else ""
        titles += [name, "", "", ""]
    height = PAGE_HEIGHT * len(groups)
    figure, axes = style.panels(style.DOUBLE_COLUMN, height, 2 * len(groups), 2, titles=titles)
    for number, rows in enumerate(groups):
        for ax, panel in zip(axes[4 * number :], PANELS, strict=False):
            draw_panel(ax, rows, panel)
    marks.legend_above(figure, marks.labelled(axes))
    return figure


def draw_panel(ax: Axes, rows: pl.DataFrame, panel: str) -> None:
    """One panel of a group."""

    def curve(name: str) -> pl.DataFrame:
        """The points of one curve of a panel."""
        return rows.filter(panel=panel, curve=name)

    for name, (colour, dash) in GAIT.items():
        points = curve(name)
        if points.is_empty():
            continue
        mean, sd = points["mean"], points["sd"]
        ax.fill_between(
            points["x"], mean - sd, mean + sd, color=colour, alpha=style.BAND_ALPHA, linewidth=0,
            label="± SD of crossings",
        )  # fmt: skip
        ax.plot(points["x"], mean, color=colour, linestyle=dash, label=name.capitalize())
    for trial in curve("each").partition_by("trial"):
        is_doubtful = marks.has_doubtful(trial)
        look = DOUBTFUL_LINE if is_doubtful else EACH_LINE
        label = "Doubtful fit" if is_doubtful else "Each perturbation"
        (line,) = ax.plot(trial["x"], trial["mean"], label=label, **look)
        line.set_url(marks.place_in_report(trial["trial"][0]))
    for name, look in ISOLATED.items():
        if not curve(name).is_empty():
            ax.plot(curve(name)["x"], curve(name)["mean"], linewidth=1.4, **look)

    ax.set_ylabel(PANELS[panel])
    ax.margins(x=0)
    if panel.startswith("response"):
        for name, look in SHADED.items():
            ends = rows.filter(panel="response angle", curve=name)["x"]
            ax.axvspan(ends[0], ends[1], linewidth=0, zorder=0, **look)
        marks.draw_zero_lines(ax)
        ax.set_xlabel("Time from the perturbation’s onset (ms)")
    else:
        ax.set_xlabel("Stance (%)")
