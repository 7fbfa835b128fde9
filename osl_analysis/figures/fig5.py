"""Fig. 5: observed stiffness and damping against what was asked for."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.style import BLACK, LOOKS, SINGLE_COLUMN, panels, paper_style

IMPEDANCE = ("trial", "controller", "K_d", "B_d", "amplitude_deg", "K", "K_low", "K_high", "B", "B_low", "B_high")
"""Columns that `points` needs of the impedance table; it takes `K_predicted` and `B_predicted` where they are."""
COLUMNS = (
    "trial", "controller", "K_d", "B_d", "K", "K_low", "K_high", "B", "B_low", "B_high", "K_predicted", "B_predicted",
    "doubtful",
)  # fmt: skip


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit over all amplitudes, with 95 % intervals, and why it is doubtful where it is.

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
    for column in {"K_predicted", "B_predicted"}.difference(table.columns):
        table = table.with_columns(pl.lit(None, pl.Float64).alias(column))
    if "doubtful" not in table.columns:
        table = table.with_columns(doubtful=pl.lit(None, pl.String))
    return table.select(COLUMNS)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: a marker per trial with its 95 % interval, the identity dashed.

    Markers are open, so that trials with equal results show. Where linear theory predicts the result of the
    trial's gains, a dash of the same colour marks the prediction. A dot in the marker: the
    fit is doubtful, and the table says why.
    """
    figure, (stiffness, damping) = panels(SINGLE_COLUMN, 2.3, columns=2)
    draw_panel(stiffness, table, "K")
    draw_panel(damping, table, "B")
    stiffness.set_xlabel("Desired $K_d$ (N·m/rad)")
    stiffness.set_ylabel(r"Stiffness $\hat{K}$ (N·m/rad)")
    damping.set_xlabel("Desired $B_d$ (N·m·s/rad)")
    damping.set_ylabel(r"Damping $\hat{B}$ (N·m·s/rad)")
    figure.legend(*damping.get_legend_handles_labels(), loc="outside upper center", ncols=2, columnspacing=1.5)
    return figure


def draw_panel(ax: Axes, table: pl.DataFrame, symbol: str) -> None:
    """One quantity, `K` or `B`, against its desired value."""
    desired = f"{symbol}_d"
    for controller in ("compensated", "uncompensated"):
        look = LOOKS[controller]
        rows = table.filter(pl.col("controller") == controller)
        ax.vlines(rows[desired], rows[f"{symbol}_low"], rows[f"{symbol}_high"], color=look.colour, linewidth=0.7)
        ax.plot(rows[desired], rows[f"{symbol}_predicted"], "_", color=look.colour, markersize=8, mew=0.6)
        ax.plot(
            rows[desired],
            rows[symbol],
            look.marker,
            color=look.colour,
            mfc="none",
            mew=0.8,
            markersize=look.size,
            label=look.label,
        )
    doubtful = table.filter(pl.col("doubtful").fill_null("") != "")
    if len(doubtful):
        ax.plot(doubtful[desired], doubtful[symbol], ".", color=BLACK, markersize=2.2, label="Doubtful fit")
    ax.axline((0, 0), slope=1, color=BLACK, linestyle=(0, (4, 2)), linewidth=0.7, label="Desired")
    if table[f"{symbol}_predicted"].count():
        ax.plot([], [], "_", color=BLACK, markersize=8, mew=0.6, label="Linear model")
    ax.margins(x=0.1)
    ax.set_xticks(table[desired].unique().sort().to_list())
