# SPDX-License-Identifier: Apache-2.0
"""The walking page: from crossings of the walkway to the responses that Fig. 9 fits."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.base.trial import Array
from osl_analysis.figures import style
from osl_analysis.walking.impedance_fit import ENSEMBLE
from osl_analysis.walking.isolated_response import PHASES, UnperturbedGait
from osl_analysis.walking.walking_settings import TimingSettings

PANELS = {
    "angle": "Ankle angle, dorsiflexion up (deg)",
    "torque": "Ankle torque (N·m)",
    "response angle": "Isolated angle (deg)",
    "response torque": "Isolated torque (N·m)",
}
EACH: Any = {"color": style.LIGHT_GREY, "label": "Each perturbation"}
DOUBTFUL_LINE: Any = {"color": style.BLACK, "linestyle": ":", "label": "Doubtful fit"}
SHADED = "#FBF3D5"  # of the fitted window
HATCHED = "#C4C4C4"  # of the baseline


def walking_page_points(
    gaits: Mapping[str, UnperturbedGait], responses: pl.DataFrame, timing: TimingSettings
) -> pl.DataFrame:
    """Points of the walking page.

    Gaits over stance [%] with their SD; responses over time [ms], with their doubts, and their mean
    with its fit; window and baseline as times from the onset [ms].

    Parameters
    ----------
    responses : DataFrame
        `walking_responses.csv`, with `doubtful` and `is_doubtful` of the fits.
    """
    frames = []
    for name, gait in gaits.items():
        frames.append(gait_points("angle", name, np.rad2deg(gait.theta)))
        frames.append(gait_points("torque", name, gait.torque))

    begin_s = -timing.guard_s - timing.baseline_s
    spans = {"window": [0.0, timing.window_s], "baseline": [begin_s, -timing.guard_s]}
    curve = pl.when(trial=ENSEMBLE).then(pl.lit("mean")).otherwise(pl.lit("each"))
    for panel, column in (("response angle", "theta_deg"), ("response torque", "torque")):
        for name, ends_s in spans.items():
            ends = {"panel": panel, "curve": name, "x": 1000 * np.array(ends_s)}
            frames.append(pl.DataFrame(ends))
        panel_responses = responses.with_columns(x=1000 * pl.col("time"), panel=pl.lit(panel))
        shown = ["panel", "trial", "doubtful", "is_doubtful", "x"]
        frames.append(panel_responses.select(*shown, curve=curve, mean=column))
    fit = panel_responses.filter(trial=ENSEMBLE).drop_nulls("torque_model")
    frames.append(fit.select(*shown, curve=pl.lit("fit"), mean="torque_model"))
    points = pl.concat(frames, how="diagonal")
    return points.with_columns(pl.col("is_doubtful").fill_null(False))


def gait_points(panel: str, name: str, curves: Array) -> pl.DataFrame:
    """Mean and SD of curves (crossings, `PHASES`) over stance, of every fourth phase: a hundred
    points are enough for a curve."""
    drawn = curves[:, ::4]
    return pl.DataFrame(
        {
            "x": 100 * PHASES[::4],
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
    height = 4 * len(groups)
    figure, axes = style.panels(style.DOUBLE_COLUMN, height, 2 * len(groups), 2, titles)
    for number, rows in enumerate(groups):
        for ax, (panel, label) in zip(axes[4 * number :], PANELS.items(), strict=False):
            draw_panel = draw_response if panel.startswith("response") else draw_stance
            draw_panel(ax, rows.filter(panel=panel))
            ax.set_ylabel(label)
            ax.margins(x=0)
    style.legend_above(figure, style.labelled(axes))
    return figure


def draw_stance(ax: Axes, rows: pl.DataFrame) -> None:
    """Mean and SD of unperturbed and of perturbed crossings over stance."""
    for name, colour, dash in (
        ("unperturbed", style.PURPLE, "-"),
        ("perturbed", style.ORANGE, "--"),
    ):
        curve = rows.filter(curve=name)
        mean = curve["mean"]
        ax.fill_between(
            curve["x"],
            mean - curve["sd"],
            mean + curve["sd"],
            color=colour,
            alpha=0.25,
            linewidth=0,
        )
        ax.plot(curve["x"], mean, dash, color=colour, label=name.capitalize())
    ax.set_xlabel("Stance (%)")


def draw_response(ax: Axes, rows: pl.DataFrame) -> None:
    """Every response to the perturbation over time, their mean and its fit."""
    for trial in rows.filter(curve="each").partition_by("trial"):
        look = DOUBTFUL_LINE if style.has_doubtful(trial) else EACH
        (line,) = ax.plot(trial["x"], trial["mean"], linewidth=0.5, **look)
        line.set_url(style.place_in_report(trial["trial"][0]))
    mean = rows.filter(curve="mean")
    ax.plot(mean["x"], mean["mean"], color=style.BLACK, linewidth=2, label="Mean response")
    fit = rows.filter(curve="fit")
    if len(fit):
        label = r"Fit of $K\theta + B\dot\theta + I\ddot\theta$"
        ax.plot(fit["x"], fit["mean"], "--", color=style.COLOURS[2], linewidth=2, label=label)
    baseline = rows.filter(curve="baseline")["x"]
    ax.axvspan(*baseline, fc="none", ec=HATCHED, hatch="////", lw=0, zorder=0, label="Baseline")
    window = rows.filter(curve="window")["x"]
    ax.axvspan(*window, color=SHADED, linewidth=0, zorder=0, label="Fitted window")
    style.draw_zero_lines(ax)
    ax.set_xlabel("Time from the perturbation’s onset (ms)")
