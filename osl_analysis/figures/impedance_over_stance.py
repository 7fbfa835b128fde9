"""Impedance over stance: K, B and I of the ankle against the phase of stance, with what the controller commands."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.figures.fig9 import LABELS, QUANTITIES
from osl_analysis.figures.names import drawn_name
from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, GREY, MAGENTA, ORANGE, PURPLE, panels, paper_style

COLUMNS = (
    "series", "quantity", "phase", "onset_phase", "end_phase", "estimate", "low", "high", "commanded"
)  # fmt: skip
COLOURS = (PURPLE, ORANGE, MAGENTA, GREY)
COMMANDED = "commanded"
"""Series of the curve that the controller commands; all other series are estimates."""
UNITS = "Stance (%)"


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: the fit of each group at the phase that it reads, its fitted window as a horizontal bar, its
    95 % interval as a vertical one and as a band from timing to timing. The commanded impedance is dashed.
    """
    figure, axes = panels(DOUBLE_COLUMN, 2.6, columns=3)
    names = [name for name in table["series"].unique(maintain_order=True) if name != COMMANDED]
    for ax, quantity in zip(axes, QUANTITIES, strict=True):
        rows = table.filter(pl.col("quantity") == quantity)
        curve = rows.filter(pl.col("series") == COMMANDED)
        if len(curve):
            ax.plot(100 * curve["phase"], curve["commanded"], color=BLACK, linestyle=(0, (3, 2)), label="Commanded")
        for number, name in enumerate(names):
            label = "Fit of mean response, 95 %" if len(names) == 1 else drawn_name(name)
            draw_series(ax, rows.filter(pl.col("series") == name), COLOURS[number % len(COLOURS)], label)
        ax.axhline(0, color=BLACK, linewidth=0.4)
        ax.set_xlim(0, 100)
        ax.set_xlabel(UNITS)
        ax.set_ylabel(LABELS[quantity])
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def draw_series(ax: Axes, rows: pl.DataFrame, colour: str, label: str) -> None:
    """The groups of one series, in the order of phase, with windows, intervals and band."""
    rows = rows.sort("phase")
    x, estimate, low, high = (rows[name].to_numpy() for name in ("phase", "estimate", "low", "high"))
    ends = np.array([rows["phase"] - rows["onset_phase"], rows["end_phase"] - rows["phase"]])
    if len(rows) > 1:
        ax.fill_between(100 * x, low, high, color=colour, alpha=0.2, linewidth=0)
        ax.plot(100 * x, estimate, color=colour, linewidth=0.8)
    ax.vlines(100 * x, low, high, color=colour, linewidth=1.2)
    ax.errorbar(100 * x, estimate, xerr=100 * np.abs(ends), fmt="none", color=colour, linewidth=0.6, capsize=1.5)
    ax.plot(100 * x, estimate, "o", color=colour, markersize=3, label=label)
    commanded = rows["commanded"].to_numpy()
    ax.plot(100 * x, commanded, "_", color=BLACK, markersize=9, mew=1.2)
