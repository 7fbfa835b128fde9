"""The validation study: bias, error over the Cramer-Rao bound, and coverage, per experiment and estimator."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, GREY, ORANGE, PURPLE, panels, paper_style

COLUMNS = (
    "experiment", "estimator", "interval_method", "quantity", "bias", "bias_mc", "rmse_over_bound",
    "rmse_over_bound_mc", "coverage", "coverage_mc",
)  # fmt: skip
LOOKS = {"K": (ORANGE, "o"), "B": (PURPLE, "D"), "I": (BLACK, "s"), "f_C": (GREY, "^"), "f_G": (GREY, "v")}
SAME_AS = {"K_s": "K", "B_j": "B", "J_j": "I", "k_tau_n_m": "K", "B_m": "B", "J_m": "I"}
SAME_AS |= {"magnitude": "K", "phase": "B"}
PLACES = {"K": -0.22, "B": 0.0, "I": 0.22, "f_C": -0.11, "f_G": 0.11}
"""How far below its row's line each marker stands."""
LIMITS = {"bias": (-1.2, 1.2), "rmse_over_bound": (0.8, 1.6), "coverage": (80.0, 101.0)}
AIMS = {"bias": (-0.2, 0.2), "rmse_over_bound": (0.0, 1.15), "coverage": (93.0, 97.0)}
LABELS = {
    "bias": "Bias (standard deviations)",
    "rmse_over_bound": "RMSE / Cramér–Rao bound",
    "coverage": "Coverage of 95 % intervals (%)",
}


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A row per experiment, estimator and interval, a marker per quantity with two Monte Carlo errors either way.

    Stiffnesses look alike, dampings and inertias too; the torque constant and the magnitude of a response look like a
    stiffness, its phase like a damping. The aim is shaded; what lies outside a panel stands open at its edge.
    """
    rows = table.select("experiment", "estimator", "interval_method").unique(maintain_order=True)
    figure, axes = panels(DOUBLE_COLUMN, 0.9 + 0.155 * len(rows), columns=3)
    table = table.with_columns(pl.col("coverage") * 100, pl.col("coverage_mc") * 100)
    for ax, column in zip(axes, LABELS, strict=True):
        draw_panel(ax, table, rows, column)
    labels = [f"{name}, {method}" for name, method in rows.select("estimator", "interval_method").rows()]
    axes[0].set_yticks(range(len(rows)), labels)
    for ax in axes[1:]:
        ax.set_yticks(range(len(rows)), [])
    name_experiments(axes[0], rows["experiment"].to_list())
    handles = [Line2D([], [], color=c, marker=m, linestyle="", label=f"${q}$") for q, (c, m) in LOOKS.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(LOOKS))
    return figure


def draw_panel(ax: Axes, table: pl.DataFrame, rows: pl.DataFrame, column: str) -> None:
    """One measure of all rows."""
    low, high = LIMITS[column]
    ax.axvspan(max(AIMS[column][0], low), AIMS[column][1], color="#E8E8E8", linewidth=0)
    keys = {key: place for place, key in enumerate(rows.rows())}
    for row in table.drop_nulls(column).iter_rows(named=True):
        quantity = row["quantity"].partition(",")[0]
        quantity = SAME_AS.get(quantity, quantity)
        colour, marker = LOOKS[quantity]
        place = keys[row["experiment"], row["estimator"], row["interval_method"]] + PLACES[quantity]
        value, half = float(np.clip(row[column], low, high)), 2 * row[f"{column}_mc"]
        inside = value == row[column]
        if inside:
            ax.hlines(place, max(value - half, low), min(value + half, high), color=colour, linewidth=0.6)
        ax.plot(
            value,
            place,
            marker,
            color=colour,
            markersize=2.6,
            mfc=colour if inside else "white",
            mew=0.6,
            clip_on=False,
        )
    names = rows["experiment"].to_list()
    for place in (i for i in range(1, len(names)) if names[i] != names[i - 1]):
        ax.axhline(place - 0.5, color=GREY, linewidth=0.4)
    ax.set_xlim(low, high)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel(LABELS[column])


def name_experiments(ax: Axes, names: list[str]) -> None:
    """Each experiment's name beside its first row, left of the estimators."""
    for place, name in enumerate(names):
        if place == 0 or names[place - 1] != name:
            ax.annotate(
                name, (-1.18, place), xycoords=("axes fraction", "data"), va="center", ha="left",
                fontweight="bold", annotation_clip=False,
            )  # fmt: skip
