# SPDX-License-Identifier: Apache-2.0
"""Supplement to Fig. 5: the errors of stiffness and damping, beside what the gains render."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from osl_analysis.figures import fig5, style
from osl_analysis.figures.trial_axis import TrialPanel, draw_trial_axis, panels_of_trials

ENDS = ("", "_low", "_high", "_range_low", "_range_high")  # estimate, its interval, its range
CONDITION = ("joint", "side", "K_d", "B_d")
ERROR_LABELS = {
    "K": r"Error of $\hat{K}$ (%)",
    "B": r"Error of $\hat{B}$ (N·m·s/rad)",
}
ZERO_LINE_WIDTH = 0.8  # [pt]


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial that was asked for a stiffness or a damping. The viscous damping stands
    where every controller of the same condition has one: alone it would compare unlike
    quantities."""
    is_asked = pl.col("K_d").is_not_null() | pl.col("B_d").is_not_null()
    whole = fig5.points(impedance).filter(is_asked)
    if "B_viscous" not in whole.columns:
        return whole
    known = pl.col("controller").filter(pl.col("B_viscous").is_not_null())
    has_all = known.n_unique() == pl.col("controller").n_unique()
    condition = [name for name in CONDITION if name in whole.columns]
    compared = pl.when(has_all.over(condition)).then("B_viscous")
    return whole.with_columns(B_viscous=compared)


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) error of the stiffness in percent of K_d, (b) error of the damping, one above the
    other; several joints stand side by side."""
    height = fig5.LEGEND_HEIGHT_IN + 2 * fig5.PANEL_HEIGHT_IN
    layout = panels_of_trials(table, height)
    for panel in layout.panels:
        draw_errors(panel)
        draw_trial_axis(panel, layout.letters)

    keys = [*style.estimate_keys(layout.axes, table), *style.labelled(layout.axes, Line2D)]
    style.legend_above(layout.figure, keys)
    return layout.figure


def draw_errors(panel: TrialPanel) -> None:
    """What the trials render less what was asked for, and the same of what their gains render."""
    symbol = panel.symbol
    errors = errors_of(panel.trials, symbol)
    for look, trials in style.by_controller(errors):
        style.draw_estimates(panel.ax, trials, "x", symbol, look)
    draw_marks(panel.ax, errors, f"{symbol}_d_rendered", "+", "Rendered by the gains")
    if symbol == "B":
        draw_marks(panel.ax, errors, "B_viscous", "x", "Viscous damping")
    panel.ax.axhline(0, color=style.BLACK, linewidth=ZERO_LINE_WIDTH)
    panel.ax.set_ylabel(ERROR_LABELS[symbol])


def errors_of(trials: pl.DataFrame, symbol: str) -> pl.DataFrame:
    """The columns of one quantity less the desired one: of the stiffness in percent of it; of the
    damping, of which often none is asked for, in its unit."""
    columns = [symbol + end for end in ENDS]
    columns.append(f"{symbol}_d_rendered")
    if symbol == "B":
        columns.append("B_viscous")
    desired = pl.col(f"{symbol}_d")
    error = pl.col(columns) - desired
    if symbol == "K":
        asked_for = pl.when(desired != 0).then(desired)
        error = error / asked_for * 100
    return trials.with_columns(error)


def draw_marks(ax: Axes, trials: pl.DataFrame, column: str, marker: str, label: str) -> None:
    """Black marks, since they may stand on a marker of a trial."""
    if style.has_values(trials, column):
        ax.plot(trials["x"], trials[column], marker, color=style.BLACK, zorder=4, label=label)
