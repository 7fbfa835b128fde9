"""The Monte Carlo study: bias, error over the Cramer-Rao bound, and coverage, per experiment and estimator."""

from collections.abc import Sequence

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
"""Distance of each marker below the line of its row."""
SYMBOLS = {
    "K": r"$K$, $K_s$, $|Y|$, $k_\tau n_m$", "B": r"$B$, $B_j$, $B_m$, arg $Y$", "I": "$I$, $J_j$, $J_m$",
    "f_C": "$f_C$", "f_G": "$f_G$",
}  # fmt: skip
"""What each marker stands for."""
LIMITS = {"bias": (-1.2, 1.2), "rmse_over_bound": (0.8, 1.6), "coverage": (80.0, 101.0)}
BEYOND = (">", "<")
"""Arrows for values above and below the limits."""
MOST = {"bias": np.inf, "rmse_over_bound": np.inf, "coverage": 100.0}
"""Values beyond which nothing can be."""
AIMS = {"bias": (-0.2, 0.2), "rmse_over_bound": (0.0, 1.15), "coverage": (93.0, 97.0)}
LABELS = {
    "bias": "Bias (standard deviations)",
    "rmse_over_bound": "RMSE / Cramér–Rao bound",
    "coverage": "Coverage of 95 % intervals (%)",
}
SHORT = {"unperturbed crossings": "gait", "unperturbed crossings + plate trials": "gait + plate"}
"""Short names of long kinds of interval, for the margin."""
Key = tuple[str, ...]


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A row per experiment, estimator and interval, a marker per quantity with two Monte Carlo errors on either side.

    All stiffnesses have one marker, and so have dampings and inertias. The torque constant and the magnitude of a
    response have that of a stiffness, the phase that of a damping. The aim is shaded. An arrow at the edge of a panel
    stands for a value beyond it.
    """
    keys = headed(table.select("experiment", "estimator", "interval_method").unique(maintain_order=True))
    figure, axes = panels(DOUBLE_COLUMN, 0.9 + 0.155 * len(keys), columns=3)
    table = table.with_columns(pl.col("coverage") * 100, pl.col("coverage_mc") * 100)
    for ax, column in zip(axes, LABELS, strict=True):
        draw_measure(ax, table, keys, column)
        ax.set_yticks(range(len(keys)), [])
    axes[0].set_yticklabels([label(key) for key in keys])
    for text, key in zip(axes[0].get_yticklabels(), keys, strict=True):
        text.set_fontweight("bold" if len(key) == 1 else "normal")
    seen = {SAME_AS.get(name, name) for name in (q.partition(",")[0] for q in table["quantity"])}
    handles = [
        Line2D([], [], color=c, marker=m, linestyle="", label=SYMBOLS[q]) for q, (c, m) in LOOKS.items() if q in seen
    ]
    handles.append(Line2D([], [], color=GREY, marker=BEYOND[0], markersize=3, linestyle="", label="Beyond the panel"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def headed(rows: pl.DataFrame) -> list[Key]:
    """Experiment, estimator and interval of each row. Before the first row of an experiment there is a row with its
    name."""
    keys: list[Key] = []
    for key in rows.rows():
        if not keys or keys[-1][0] != key[0]:
            keys.append(key[:1])
        keys.append(key)
    return keys


def label(key: Key) -> str:
    """Text in the margin beside a row."""
    return key[0].replace(" us", " µs") if len(key) == 1 else f"{key[1]}, {SHORT.get(key[2], key[2])}"


def draw_measure(ax: Axes, table: pl.DataFrame, keys: Sequence[Key], column: str) -> None:
    """One measure, for all rows."""
    low, high = LIMITS[column]
    ax.axvspan(max(AIMS[column][0], low), AIMS[column][1], color="#E8E8E8", linewidth=0)
    places = {key: place for place, key in enumerate(keys)}
    for row in table.drop_nulls(column).iter_rows(named=True):
        quantity = row["quantity"].partition(",")[0]
        quantity = SAME_AS.get(quantity, quantity)
        colour, marker = LOOKS[quantity]
        place = places[row["experiment"], row["estimator"], row["interval_method"]] + PLACES[quantity]
        value, half = float(np.clip(row[column], low, high)), 2 * row[f"{column}_mc"]
        if value == row[column]:
            ends = max(value - half, low), min(value + half, high, MOST[column])
            ax.hlines(place, *ends, color=colour, linewidth=0.6)
        else:
            marker = BEYOND[value > row[column]]
        ax.plot(value, place, marker, color=colour, markersize=2.6, mew=0.6, clip_on=False)
    for place in (place for place, key in enumerate(keys) if len(key) == 1 and place):
        ax.axhline(place - 0.5, color=GREY, linewidth=0.4)
    ax.set_xlim(low, high)
    ax.set_ylim(len(keys) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel(LABELS[column])
