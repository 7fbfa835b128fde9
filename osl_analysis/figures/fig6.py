"""Fig. 6: variance accounted for by a second-order system, one point per trial and amplitude."""

import textwrap

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.names import PLACE, look_numbers, looks_in, of_place, place_name
from osl_analysis.figures.style import (
    BLACK,
    DOUBLE_COLUMN,
    IS_DOUBTFUL,
    LIGHT_DOT,
    SINGLE_COLUMN,
    light_dots,
    paper_style,
)
from osl_analysis.trial import Array

TABLE_COLUMNS = ("trial", "controller", "K_d", "B_d", "amplitude_deg", "VAF")
COLUMNS = (*TABLE_COLUMNS, *PLACE, "look", "x", "x_centre", "median_VAF", "doubtful")

HEIGHT = 2.4
LEFT, RIGHT, BOTTOM, PANEL_HEIGHT = 0.56, 0.06, 0.26, 2.08
"""Margins and height [in] of the panel: fixed, because the swarm's positions depend on its size."""
LETTERS_PER_INCH = 17
LINE = 0.17
"""Height [in] of a further line of the names below the panel."""
DIAMETER = 4.9 / 72
"""Diameter [in] of each point in the swarm: the marker and a small gap."""
BESIDE = 2
"""Swarms up to which the median stands beside each, in a single column; of more it stands below each."""
LARGEST_VAF = 99.9999
TICKS = (-900, 0, 50, 80, 90, 95, 98, 99, 99.5, 99.8, 99.9, 99.95, 99.98, 99.99, 99.999, 99.9999)


def vaf_scale(vaf: Array) -> Array:
    """Height of a VAF [percent] on the axis: minus the logarithm of the variance that the fit does not explain."""
    return np.asarray(-np.log10(100 - np.minimum(vaf, LARGEST_VAF)))


def vaf_from_scale(height: Array) -> Array:
    """The VAF [percent] at a height; inverse of `vaf_scale`."""
    return np.asarray(100 - 10.0 ** -np.asarray(height))


def axis_limits(vaf: Array) -> tuple[float, float]:
    """Ends of the axis, in heights of `vaf_scale`, with room of 5 % at both sides."""
    heights = vaf_scale(vaf)
    room = max(0.05 * float(np.ptp(heights)), 0.05)
    return float(np.min(heights)) - room, float(np.max(heights)) + room


def swarm_positions(values: Array, width: float) -> Array:
    """Sideways offsets (n,) at which points of diameter `width` at heights `values` (n,) do not overlap; in one unit.

    From the lowest value up, each point takes the free place that is nearest to the middle. Of two equally near places
    it takes the right and the left one in turn.
    """
    offsets = np.zeros(len(values))
    order = np.argsort(values, kind="stable")
    for rank, point in enumerate(order):
        below = order[:rank][np.abs(values[order[:rank]] - values[point]) < width]
        reach = np.sqrt(width**2 - (values[below] - values[point]) ** 2) * (1 + 1e-9)
        candidates = np.concatenate([[0.0], offsets[below] - reach, offsets[below] + reach])
        free = [c for c in candidates if (np.abs(c - offsets[below]) >= reach * (1 - 1e-9)).all()]
        side = 1 if rank % 2 else -1
        offsets[point] = min(free, key=lambda c: (round(abs(c) / width, 6), side * c))
    return offsets


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial and amplitude, with its place `x` in the swarm, 0 to 1 across the panel.

    A trial that no stepped sine moved has no amplitudes, and one row. Each controller of each joint and side has a
    swarm. `x_centre` is its middle, `median_VAF` [percent] its median. Fits without a VAF (a constant torque) have no
    row.

    Raises
    ------
    InputError
        No fit of a single amplitude has a VAF.
    """
    single = impedance.filter(
        (pl.col("amplitude_deg").is_not_null() | (pl.len().over("trial") == 1)) & pl.col("VAF").is_finite()
    )
    reasons = pl.col("doubtful") if "doubtful" in impedance.columns else pl.lit(None, pl.String).alias("doubtful")
    table = of_place(single).select(*TABLE_COLUMNS, *PLACE, reasons)
    if table.is_empty():
        raise InputError(
            "the impedance table has no VAF of a single amplitude, which Fig. 6 draws; fit the trials again"
        )
    table = table.with_columns(look_numbers(table["controller"]))
    low, high = axis_limits(table["VAF"].to_numpy())
    groups = swarms_of(table)
    width, pitch = panel_width(len(groups)), 1 / len(groups)
    swarms = []
    for number, rows in enumerate(groups):
        inches = (vaf_scale(rows["VAF"].to_numpy()) - low) / (high - low) * PANEL_HEIGHT
        offsets = swarm_positions(inches, DIAMETER) / width
        squeeze = min(1.0, 0.4 * pitch / max(float(np.max(np.abs(offsets), initial=0)), 1e-9))
        centre = pitch * (0.92 * number + 0.46 if len(groups) <= BESIDE else number + 0.5)
        swarms.append(
            rows.with_columns(x=centre + squeeze * offsets, x_centre=pl.lit(centre), median_VAF=pl.col("VAF").median())
        )
    return pl.concat(swarms)


def swarms_of(table: pl.DataFrame) -> list[pl.DataFrame]:
    """The rows of each joint, side and controller."""
    return [
        rows
        for part in table.partition_by(PLACE, maintain_order=True)
        for controller in looks_in(part)
        if len(rows := part.filter(pl.col("controller").eq_missing(pl.lit(controller))))
    ]


def panel_width(swarms: int) -> float:
    """Width [in] of the panel with so many swarms."""
    return (SINGLE_COLUMN if swarms <= BESIDE else DOUBLE_COLUMN) - LEFT - RIGHT


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A swarm per controller, of each joint and side, with its median as a black bar.

    The axis is logarithmic in the variance that the fit does not explain. A light dot in the marker marks a doubtful
    fit.
    """
    swarms, looks = swarms_of(table), looks_in(table)
    several = len(table.select(PLACE).unique()) > 1
    lines = [swarm_name(rows, looks[rows["controller"][0]].label, several, len(swarms)) for rows in swarms]
    below = LINE * max(line.count("\n") for line in lines)
    width, height = panel_width(len(swarms)) + LEFT + RIGHT, HEIGHT + below
    figure = Figure(figsize=(width, height))
    place = (LEFT, BOTTOM + below, width - LEFT - RIGHT, PANEL_HEIGHT)
    ax = figure.add_axes((place[0] / width, place[1] / height, place[2] / width, place[3] / height))
    ax.set_yscale("function", functions=(vaf_scale, vaf_from_scale))
    pitch = 1 / len(swarms)
    for rows in swarms:
        look = looks[rows["controller"][0]]
        ax.plot(rows["x"], rows["VAF"], look.marker, color=look.colour, markersize=look.size, mew=0, label=look.label)
        centre, median = rows["x_centre"][0], rows["median_VAF"][0]
        ax.hlines(median, centre - 0.3 * pitch, centre + 0.3 * pitch, color=BLACK, linewidth=1.2)
        if len(swarms) <= BESIDE:
            ax.annotate(f"median\n{median:.2f} %", (centre + 0.32 * pitch, median), va="center")
    doubtful = table.filter(IS_DOUBTFUL)
    light_dots(ax, doubtful["x"], doubtful["VAF"])
    if len(doubtful):
        ax.legend(handles=[LIGHT_DOT], loc="lower left")
    low, high = axis_limits(table["VAF"].to_numpy())
    ax.set_ylim(float(vaf_from_scale(np.array(low))), float(vaf_from_scale(np.array(high))))
    ax.set_yticks([t for t in TICKS if low <= vaf_scale(np.array(t)) <= high], minor=False)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.set_xlim(0, 1)
    ax.set_xticks([rows["x_centre"][0] for rows in swarms], lines)
    ax.set_ylabel("Variance accounted for (%)")
    return figure


def swarm_name(rows: pl.DataFrame, controller: str, several: bool, swarms: int) -> str:
    """What stands below a swarm: its controller, its joint and side where there are `several`, its median where this
    does not stand beside it. Long lines are broken to the width that each of so many swarms has."""
    place = place_name(rows["joint"][0], rows["side"][0]) if several or swarms > BESIDE else ""
    median = f"median {rows['median_VAF'][0]:.2f} %" if swarms > BESIDE else ""
    letters = max(int(LETTERS_PER_INCH * panel_width(swarms) / swarms), 6)
    lines = [part for line in (controller.strip(), place, median) if line for part in textwrap.wrap(line, letters)]
    return "\n".join(lines)
