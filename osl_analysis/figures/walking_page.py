# SPDX-License-Identifier: Apache-2.0
"""The walking page: from crossings of the walkway to the responses that Fig. 9 fits."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import marks, style
from osl_analysis.trial import Array
from osl_analysis.walking.isolated_response import PHASES, UnperturbedGait
from osl_analysis.walking.tables import ENSEMBLE
from osl_analysis.walking.walking_settings import TimingSettings

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


DRAWN_STEP = 4  # a hundred points of stance are enough for a curve


def walking_page_points(
    gaits: Mapping[str, UnperturbedGait], responses: pl.DataFrame, timing: TimingSettings
) -> pl.DataFrame:
    """Points of the walking page.

    Gaits over stance [%] with their SD; responses over time [ms], with the column `doubtful`, and
    their mean with its fit; window and baseline as times from the onset [ms].

    Parameters
    ----------
    responses : DataFrame
        `walking_responses.csv`.
    """
    frames = []
    for name, gait in gaits.items():
        frames.append(gait_points("angle", name, np.rad2deg(gait.theta)))
        frames.append(gait_points("torque", name, gait.torque))

    spans = {
        "window": (0.0, timing.window_s),
        "baseline": (-timing.guard_s - timing.baseline_s, -timing.guard_s),
    }
    for name, bounds in spans.items():
        ends = {"panel": "response angle", "curve": name, "x": 1e3 * np.array(bounds)}
        frames.append(pl.DataFrame(ends))

    is_mean = pl.col("trial") == ENSEMBLE
    curve = pl.when(is_mean).then(pl.lit("mean")).otherwise(pl.lit("each")).alias("curve")
    time_ms = (1e3 * pl.col("time")).alias("x")
    for panel, column in (("response angle", "theta_deg"), ("response torque", "torque")):
        frames.append(
            responses.select("trial", "doubtful", time_ms, curve, mean=column, panel=pl.lit(panel))
        )
    fit = responses.filter(is_mean).drop_nulls("torque_model")
    frames.append(
        fit.select(
            "trial",
            time_ms,
            curve=pl.lit("fit"),
            mean="torque_model",
            panel=pl.lit("response torque"),
        )
    )
    return pl.concat(frames, how="diagonal")


def gait_points(panel: str, name: str, curves: Array) -> pl.DataFrame:
    """Mean and SD of curves (crossings, `PHASES`) over stance."""
    drawn = curves[:, ::DRAWN_STEP]
    return pl.DataFrame(
        {
            "x": 100 * PHASES[::DRAWN_STEP],
            "mean": drawn.mean(axis=0),
            "sd": drawn.std(axis=0, ddof=1) if len(drawn) > 1 else None,
            "panel": panel,
            "curve": name,
            "n": len(curves),
        },
        schema_overrides={"sd": pl.Float64},
    )


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
