"""Fig. 5: estimated stiffness and damping against the desired ones."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.style import (
    BLACK,
    IS_DOUBTFUL,
    LOOKS,
    SINGLE_COLUMN,
    draw_spread,
    panels,
    paper_style,
    spread_entries,
)

TABLE_COLUMNS = ("trial", "controller", "K_d", "B_d", "amplitude_deg", "K", "K_low", "K_high", "B", "B_low", "B_high")
"""Columns that `points` needs of the impedance table."""
WHERE_THEY_ARE = (
    "K_amplitudes_low", "K_amplitudes_high", "B_amplitudes_low", "B_amplitudes_high", "K_predicted", "B_predicted",
)  # fmt: skip
"""Columns that `points` takes if the table has them; they are null if not."""
COLUMNS = (
    "trial", "controller", "K_d", "B_d", "K", "K_low", "K_high", "B", "B_low", "B_high", *WHERE_THEY_ARE, "doubtful",
)  # fmt: skip

BESIDE = 0.022
"""Distance between trials of one desired value, as a share of the axis: their bars do not overlap."""


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes, with 95 % intervals and the range over single amplitudes.

    `doubtful` says why the fit is doubtful.

    Raises
    ------
    InputError
        No trial has a fit over all amplitudes (a row without `amplitude_deg`).
    """
    table = impedance.filter(pl.col("amplitude_deg").is_null())
    if table.is_empty():
        raise InputError(
            "the impedance table has no fit over all amplitudes (a row with empty amplitude_deg), "
            "which Fig. 5 draws; fit the trials again"
        )
    absent = [pl.lit(None, pl.Float64).alias(column) for column in WHERE_THEY_ARE if column not in table.columns]
    table = table.with_columns(absent)
    if "doubtful" not in table.columns:
        table = table.with_columns(doubtful=pl.lit(None, pl.String))
    return table.select(COLUMNS)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: a marker per trial's fit to all amplitudes, the identity dashed.

    A thin bar is the range of the fits to single amplitudes, a thick bar the 95 % interval of noise. The legend names
    the bars, or says that the markers hide them. Markers are open, and trials of one desired value stand side by side,
    less than a marker apart, so that equal results can be seen. A dash of the same colour is the prediction of linear
    theory for the trial's gains. A dot in the marker marks a doubtful fit.
    """
    figure, (stiffness, damping) = panels(SINGLE_COLUMN, 2.5, columns=2)
    draw_quantity(stiffness, table, "K")
    draw_quantity(damping, table, "B")
    stiffness.set_xlabel("Desired $K_d$ (N·m/rad)")
    stiffness.set_ylabel(r"Stiffness $\hat{K}$ (N·m/rad)")
    damping.set_xlabel("Desired $B_d$ (N·m·s/rad)")
    damping.set_ylabel(r"Damping $\hat{B}$ (N·m·s/rad)")
    bars, remark = spread_entries({stiffness: "K", damping: "B"}, table)
    handles = [*damping.get_legend_handles_labels()[0], *bars]
    figure.legend(handles=handles, loc="outside upper center", ncols=2, columnspacing=1.5)
    figure.supxlabel(remark, fontsize=8)
    return figure


def draw_quantity(ax: Axes, table: pl.DataFrame, symbol: str) -> None:
    """One quantity, `K` or `B`, against its desired value."""
    desired = f"{symbol}_d"
    table = table.with_columns(x=side_by_side(table, desired, "B_d" if symbol == "K" else "K_d"))
    for controller in ("compensated", "uncompensated"):
        look = LOOKS[controller]
        rows = table.filter(pl.col("controller") == controller)
        draw_spread(ax, rows, "x", symbol, look.colour)
        ax.plot(rows["x"], rows[f"{symbol}_predicted"], "_", color=look.colour, markersize=8, mew=0.6)
        ax.plot(
            rows["x"],
            rows[symbol],
            look.marker,
            color=look.colour,
            mfc="none",
            mew=0.8,
            markersize=look.size,
            label=look.label,
        )
    doubtful = table.filter(IS_DOUBTFUL)
    if len(doubtful):
        ax.plot(doubtful["x"], doubtful[symbol], ".", color=BLACK, markersize=3.4, mew=0, label="Doubtful fit")
    ax.axline((0, 0), slope=1, color=BLACK, linestyle=(0, (4, 2)), linewidth=0.7, label="Desired")
    if table[f"{symbol}_predicted"].count():
        ax.plot([], [], "_", color=BLACK, markersize=8, mew=0.6, label="Linear model")
    ax.margins(x=0.1)
    ax.set_xticks(table[desired].unique().sort().to_list())


def side_by_side(table: pl.DataFrame, desired: str, other: str) -> pl.Series:
    """Places of the trials on the axis of one desired value; trials that share it stand in the order of the other."""
    levels = table[other].unique().sort().to_list()
    place = np.array([levels.index(value) for value in table[other]]) - (len(levels) - 1) / 2
    values = table[desired].to_numpy()
    return pl.Series(values + BESIDE * np.ptp(values) * place)
