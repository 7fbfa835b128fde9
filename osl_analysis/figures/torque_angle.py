# SPDX-License-Identifier: Apache-2.0
"""Figure `torque_angle`: torque against angle of a joint that is moved slowly."""

from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl

from osl_analysis.figures import style
from osl_analysis.stats.doubts import is_doubtful

WIDTHS = {"loading": 1.0, "unloading": 0.5}  # of curves [pt]
DESIRED_LINE: Any = {"color": style.MAGENTA, "linestyle": "--", "label": "Desired"}
MOST_CURVES = 16  # curves in the legend; of more, none is named


def points(curves: pl.DataFrame, trials: pl.DataFrame) -> pl.DataFrame:
    """The curves, with the doubts of their trials."""
    doubts = trials.select("trial", "doubtful", is_doubtful=is_doubtful(trials))
    return curves.join(doubts, on="trial", how="left", maintain_order="left")


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) torque over angle, (b) stiffness while loading; two panels for each joint."""
    parts = style.by_place(table)
    titles = np.repeat([title for title, _ in parts], 2).tolist()
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3 * len(parts), len(parts), 2, titles)
    trials = table["trial"].unique(maintain_order=True)
    # the dark half of a colour map: the other stands out from white by less than 3 to 1
    shades = mpl.colormaps["viridis"](np.linspace(0, 0.5, len(trials)))
    colours = dict(zip(trials, shades, strict=True))
    for (_, part), torque, stiffness in zip(parts, axes[::2], axes[1::2], strict=True):
        curves_by_branch = part.partition_by("trial", "branch", as_dict=True)
        for (trial, branch), curve in curves_by_branch.items():
            look: dict[str, Any] = {
                "color": colours[trial],
                "linewidth": WIDTHS[branch],
                "linestyle": ":" if style.has_doubtful(curve) else "-",
                "url": style.place_in_report(trial),
                "label": style.drawn_name(trial),
            }
            torque.plot(curve["angle_deg"], curve["torque"], **look)
            if branch == "loading":
                known = curve.drop_nulls("stiffness")
                stiffness.plot(known["angle_deg"], known["stiffness"], **look)
        desired = part.drop_nulls("desired_torque").unique(["desired", "angle_deg"])
        for curve in desired.sort("angle_deg").partition_by("desired"):
            torque.plot(curve["angle_deg"], curve["desired_torque"], **DESIRED_LINE)
        torque.set_ylabel("Resisting torque (N·m)")
        stiffness.set_ylabel("Stiffness while loading (N·m/rad)")
    for ax in axes:
        style.draw_zero_lines(ax)
        ax.set_xlabel("Joint angle (deg)")

    keys = [
        style.key(branch.capitalize(), color=style.BLACK, linewidth=width)
        for branch, width in WIDTHS.items()
    ]
    named = style.labelled(axes)
    style.legend_above(figure, keys + named if len(named) <= MOST_CURVES else keys)
    return figure
