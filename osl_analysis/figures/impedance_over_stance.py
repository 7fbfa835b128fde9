"""Impedance over stance: K, B and I of the ankle against the phase of stance, with what the controller commands."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from osl_analysis.figures.fig9 import AXIS_LABELS, ESTIMATES
from osl_analysis.figures.names import UNIT_OF, as_text, count_of, drawn_name, with_interval
from osl_analysis.figures.style import (
    BLACK,
    DASHED,
    DOUBLE_COLUMN,
    ORANGE,
    PURPLE,
    legend_columns,
    legend_entries,
    panels,
    paper_style,
)

COLUMNS = (
    "series", "quantity", "phase", "onset_phase", "end_phase", "estimate", "low", "high", "commanded"
)  # fmt: skip
SERIES_LOOKS = ((PURPLE, "o"), (ORANGE, "D"), ("#3F8FBF", "s"), ("#6B3A0A", "^"))
"""Colours and markers of the series."""
COMMANDED_SERIES = "commanded"  # series of the curve that the controller commands; all other series are estimates
WIDTHS = {"interval": 1.2, "window": 0.6}  # of lines [pt]


def caption(table: pl.DataFrame) -> str:
    said = [
        "Impedance of the ankle over stance: (a) stiffness, (b) damping, (c) inertia. A marker is the fit to the mean "
        "response of a group, at the phase that the fit reads. Upright bars are 95 % intervals, level ones the windows "
        "of the fits."
    ]
    if table["commanded"].count():
        said.append("Dashed, and short black lines at the groups: what the controller commands.")
    estimates = table.filter(pl.col("series") != COMMANDED_SERIES)
    for rows in estimates.sort("phase").partition_by("series", "phase", maintain_order=True):
        told = "; ".join(
            f"${row['quantity']}$ {with_interval(row['estimate'], row['low'], row['high'], UNIT_OF[row['quantity']])}"
            for row in rows.drop_nulls("estimate").iter_rows(named=True)
        )
        counts = rows["n"].drop_nulls() if "n" in rows.columns else rows["phase"].clear()
        of = f", {count_of(int(counts[0]), 'perturbation')}" if len(counts) else ""
        if told:
            said.append(f"{as_text(rows['series'][0])} at {100 * rows['phase'][0]:.0f} % of stance{of}: {told}.")
    return " ".join(said)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: the fit of each group at the phase that it reads, its fitted window as a horizontal bar, its
    95 % interval as a vertical one. The commanded impedance is dashed, and a short line at each group.
    """
    figure, axes = panels(DOUBLE_COLUMN, 2.6, columns=3)
    names = [name for name in table["series"].unique(maintain_order=True) if name != COMMANDED_SERIES]
    for ax, quantity in zip(axes, ESTIMATES, strict=True):
        rows = table.filter(pl.col("quantity") == quantity)
        curve = rows.filter(pl.col("series") == COMMANDED_SERIES)
        if len(curve):
            ax.plot(100 * curve["phase"], curve["commanded"], color=BLACK, linestyle=DASHED, label="Commanded")
        for number, name in enumerate(names):
            label = "Fit of mean response" if len(names) == 1 else drawn_name(name)
            draw_series(ax, rows.filter(pl.col("series") == name), *SERIES_LOOKS[number % len(SERIES_LOOKS)], label)
        ax.axhline(0, color=BLACK, linewidth=0.4, zorder=0)
        ax.set_xlim(0, 100)
        ax.set_xlabel("Stance (%)")
        ax.set_ylabel(AXIS_LABELS[quantity])
    named = legend_entries(axes)
    for marker, width, label in zip("|_", WIDTHS.values(), ("95 % interval", "Fitted window"), strict=True):
        named[label] = Line2D([], [], color=BLACK, linestyle="", marker=marker, markersize=8, mew=width)
    figure.legend(
        named.values(), named.keys(), loc="outside upper center", ncols=legend_columns([*named], DOUBLE_COLUMN, 6)
    )
    return figure


def draw_series(ax: Axes, rows: pl.DataFrame, colour: str, marker: str, label: str) -> None:
    rows = rows.sort("phase")
    x, estimate, low, high = (rows[name].to_numpy() for name in ("phase", "estimate", "low", "high"))
    ends = np.array([rows["phase"] - rows["onset_phase"], rows["end_phase"] - rows["phase"]])
    ax.plot(100 * x, rows["commanded"].to_numpy(), "_", color=BLACK, markersize=9, mew=1.2, zorder=1.5)
    ax.vlines(100 * x, low, high, color=colour, linewidth=WIDTHS["interval"])
    window = {"linewidth": WIDTHS["window"], "capsize": 1.5}
    ax.errorbar(100 * x, estimate, xerr=100 * np.abs(ends), fmt="none", color=colour, **window)  # type: ignore[arg-type]
    ax.plot(100 * x, estimate, marker, color=colour, markersize=3.5, mew=0, label=label)
