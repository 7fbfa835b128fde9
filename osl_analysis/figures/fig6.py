"""Fig. 6: variance accounted for by a second-order system, one point per trial and amplitude."""

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.style import (
    BLACK,
    IS_DOUBTFUL,
    LIGHT_DOT,
    LOOKS,
    SINGLE_COLUMN,
    light_dots,
    paper_style,
)
from osl_analysis.trial import Array

TABLE_COLUMNS = ("trial", "controller", "K_d", "B_d", "amplitude_deg", "VAF")
COLUMNS = (*TABLE_COLUMNS, "x", "x_centre", "median_VAF", "doubtful")

HEIGHT = 2.4
PANEL = (0.52, 0.26, 2.92, 2.08)
"""Left, bottom, width and height [in] of the panel: fixed, because the swarm's positions depend on its size."""
DIAMETER = 4.9 / 72
"""Diameter [in] of each point in the swarm: the marker and a small gap."""
CENTRES = {"compensated": 0.23, "uncompensated": 0.69}
"""Centre of each swarm, as a fraction of the panel's width."""
HALF_WIDTH = 0.2
LARGEST_VAF = 99.9999
TICKS = (-900, 0, 50, 80, 90, 95, 98, 99, 99.5, 99.8, 99.9, 99.95, 99.98, 99.99, 99.999)


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

    A trial that no stepped sine moved has no amplitudes, and one row.

    `x_centre` is the middle of the controller's swarm, `median_VAF` [percent] its median. Fits without a VAF
    (a constant torque) have no row.

    Raises
    ------
    InputError
        No fit of a single amplitude has a VAF.
    """
    single = impedance.filter(
        (pl.col("amplitude_deg").is_not_null() | (pl.len().over("trial") == 1)) & pl.col("VAF").is_finite()
    )
    reasons = pl.col("doubtful") if "doubtful" in impedance.columns else pl.lit(None, pl.String).alias("doubtful")
    table = single.select(*TABLE_COLUMNS, reasons)
    if table.is_empty():
        raise InputError(
            "the impedance table has no VAF of a single amplitude, which Fig. 6 draws; fit the trials again"
        )
    low, high = axis_limits(table["VAF"].to_numpy())
    swarms = []
    for controller, centre in CENTRES.items():
        rows = table.filter(pl.col("controller") == controller)
        inches = (vaf_scale(rows["VAF"].to_numpy()) - low) / (high - low) * PANEL[3]
        offsets = swarm_positions(inches, DIAMETER) / PANEL[2]
        squeeze = min(1.0, HALF_WIDTH / max(float(np.max(np.abs(offsets), initial=0)), 1e-9))
        swarms.append(
            rows.with_columns(x=centre + squeeze * offsets, x_centre=pl.lit(centre), median_VAF=pl.col("VAF").median())
        )
    return pl.concat(swarms)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A swarm per controller with its median as a black bar.

    The axis is logarithmic in the variance that the fit does not explain. A light dot in the marker marks a doubtful
    fit.
    """
    figure = Figure(figsize=(SINGLE_COLUMN, HEIGHT))
    left, bottom, width, height = PANEL
    ax = figure.add_axes((left / SINGLE_COLUMN, bottom / HEIGHT, width / SINGLE_COLUMN, height / HEIGHT))
    ax.set_yscale("function", functions=(vaf_scale, vaf_from_scale))
    swarms = {
        str(c): rows for (c,), rows in table.partition_by("controller", as_dict=True, maintain_order=True).items()
    }
    for controller, rows in swarms.items():
        look = LOOKS[controller]
        ax.plot(rows["x"], rows["VAF"], look.marker, color=look.colour, markersize=look.size, mew=0, label=look.label)
        centre, median = rows["x_centre"][0], rows["median_VAF"][0]
        ax.hlines(median, centre - 0.15, centre + 0.15, color=BLACK, linewidth=1.2)
        ax.annotate(f"median\n{median:.2f} %", (centre + 0.16, median), va="center")
    doubtful = table.filter(IS_DOUBTFUL)
    light_dots(ax, doubtful["x"], doubtful["VAF"])
    if len(doubtful):
        ax.legend(handles=[LIGHT_DOT], loc="lower left")
    low, high = axis_limits(table["VAF"].to_numpy())
    ax.set_ylim(float(vaf_from_scale(np.array(low))), float(vaf_from_scale(np.array(high))))
    ax.set_yticks([t for t in TICKS if low <= vaf_scale(np.array(t)) <= high], minor=False)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.set_xlim(0, 1)
    ax.set_xticks([rows["x_centre"][0] for rows in swarms.values()], [LOOKS[c].label for c in swarms])
    ax.set_ylabel("Variance accounted for (%)")
    return figure
