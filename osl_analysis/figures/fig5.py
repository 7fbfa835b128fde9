# SPDX-License-Identifier: Apache-2.0
"""Fig. 5: the stiffness and damping that the joint renders, against those that were asked for."""

from typing import Any

import polars as pl
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from osl_analysis.figures import style
from osl_analysis.figures.trial_axis import SYMBOLS, draw_trial_axis, panels_of_trials

DESIRED_LINE: Any = {"color": style.BLACK, "label": "Desired"}
PANEL_HEIGHT_IN = 2.0
LEGEND_HEIGHT_IN = 0.3


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes."""
    return impedance.filter(pl.col("amplitude_deg").is_null())


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) stiffness over desired stiffness, (b) damping over desired damping, one above the other;
    several joints stand side by side."""
    height = LEGEND_HEIGHT_IN + PANEL_HEIGHT_IN * len(SYMBOLS)
    layout = panels_of_trials(table, height)
    for panel in layout.panels:
        for look, trials in style.by_controller(panel.trials):
            style.draw_estimates(panel.ax, trials, "x", panel.symbol, look)
        draw_desired(panel.ax, panel.symbol, panel.trials)
        draw_trial_axis(panel, layout.letters)
        panel.ax.set_ylabel(style.AXIS_LABELS[panel.symbol])

    keys = [*style.estimate_keys(layout.axes, table), *style.labelled(layout.axes, Line2D)]
    style.legend_above(layout.figure, keys)
    return layout.figure


def draw_desired(ax: Axes, symbol: str, trials: pl.DataFrame) -> None:
    """A black line at each desired value, as long as its trials stand side by side."""
    desired = f"{symbol}_d"
    for group in trials.drop_nulls(desired).partition_by(desired):
        ends = [group["x"][0] - 1, group["x"][-1] + 1]
        value = group[desired][0]
        ax.plot(ends, [value, value], **DESIRED_LINE)
