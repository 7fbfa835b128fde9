"""Fig. 6: variance accounted for by a second-order system, one point per trial and amplitude."""

import textwrap
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import style
from osl_analysis.figures.names import (
    NO_CONTROLLER,
    PLACE,
    as_text,
    count_of,
    decimals_of,
    doubtful_said,
    look_numbers,
    looks_in,
    of_controller,
    of_place,
    place_name,
    rounded_number,
)
from osl_analysis.trial import Array

TABLE_COLUMNS = ("trial", "controller", "K_d", "B_d", "amplitude_deg", "VAF")
COLUMNS = (*TABLE_COLUMNS, *PLACE, "look", "x", "x_centre", "median_VAF", "doubtful")

MARGIN_LEFT, RIGHT, BOTTOM, PANEL = 0.66, 0.06, 0.26, 2.08
"""Margins and height [in] of the panel: fixed, because the swarm's positions depend on its size."""
MOST_BESIDE = 2  # swarms up to which the median stands beside each, in a single column; of more it stands below each
LARGEST_VAF = 99.9999  # larger ones [percent] are drawn here


def vaf_scale(vaf: Array) -> Array:
    """Height of a VAF [percent] on the axis: minus the logarithm of the variance that the fit does not explain."""
    return np.asarray(-np.log10(np.maximum(100 - np.asarray(vaf), 1e-9)))


def vaf_from_scale(height: Array) -> Array:
    return np.asarray(100 - 10.0 ** -np.asarray(height))


def drawn_vaf(rows: pl.DataFrame) -> Array:
    return np.asarray(np.minimum(rows["VAF"].to_numpy(), LARGEST_VAF))


def axis_ticks(low: float, high: float) -> list[float]:
    """Round VAFs between two heights; of more than twelve, those at which the unexplained share is a power of ten."""
    every = (
        -900, -400, -100, 0, 50, 80, 90, 95, 98, 99, 99.5, 99.8, 99.9, 99.95, 99.98, 99.99, 99.995, 99.998, 99.999,
        99.9995, 99.9998, 99.9999,
    )  # fmt: skip
    ticks = [tick for tick in every if low <= vaf_scale(np.array(tick)) <= high]
    decades = [tick for tick in ticks if abs(np.log10(100 - tick) % 1 - 0.5) > 0.499]
    return decades if len(ticks) > 12 else ticks


def said_vaf(vaf: float) -> str:
    """A VAF [percent] with two or more digits behind the point, and two of the unexplained share."""
    return f"{rounded_number(vaf, min(max(decimals_of(100 - vaf), 2), 6))} %"


def axis_limits(vaf: Array) -> tuple[float, float]:
    """Ends of the axis, in heights of `vaf_scale`, with room of 5 % at both sides, and for two ticks."""
    heights = vaf_scale(np.minimum(vaf, LARGEST_VAF))
    room = max(0.05 * float(np.ptp(heights)), 0.4 - float(np.ptp(heights)) / 2)
    return float(np.min(heights)) - room, float(np.max(heights)) + room


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial and amplitude, with its place `x` in the swarm, 0 to 1 across the panel.

    A trial that no stepped sine moved has no amplitudes, and one row. Each controller of each joint and side has a
    swarm. `x_centre` is its middle, `median_VAF` [percent] its median. Fits without a VAF (a constant torque) have no
    row.

    Raises InputError: no fit of a single amplitude has a VAF.
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
    for place, rows in enumerate(groups):
        inches = (vaf_scale(drawn_vaf(rows)) - low) / (high - low) * PANEL
        offsets = style.swarm_positions(inches, 4.9 / 72) / width  # the marker and a small gap
        centre = pitch * (0.92 * place + 0.46 if len(groups) <= MOST_BESIDE else place + 0.5)
        swarms.append(
            rows.with_columns(
                x=centre + style.squeezed(offsets, 0.4 * pitch),
                x_centre=pl.lit(centre),
                median_VAF=pl.col("VAF").median(),
            )
        )
    return pl.concat(swarms)


def swarms_of(table: pl.DataFrame) -> list[pl.DataFrame]:
    return [
        rows
        for part in table.partition_by(PLACE, maintain_order=True)
        for controller in looks_in(part)
        if len(rows := of_controller(part, controller))
    ]


def panel_width(swarms: int) -> float:
    return (style.SINGLE_COLUMN if swarms <= MOST_BESIDE else style.DOUBLE_COLUMN) - MARGIN_LEFT - RIGHT


@style.paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A swarm per controller of each joint and side, over an axis that is logarithmic in the unexplained variance."""
    swarms, looks = swarms_of(table), looks_in(table)
    several = len(table.select(PLACE).unique()) > 1
    lines = [swarm_name(rows, looks[rows["controller"][0]].label, several, len(swarms)) for rows in swarms]
    below = 0.17 * max(line.count("\n") for line in lines)
    width, height = panel_width(len(swarms)) + MARGIN_LEFT + RIGHT, 2.4 + below
    figure = Figure(figsize=(width, height))
    place = (MARGIN_LEFT, BOTTOM + below, width - MARGIN_LEFT - RIGHT, PANEL)
    ax = figure.add_axes((place[0] / width, place[1] / height, place[2] / width, place[3] / height))
    ax.set_yscale("function", functions=(vaf_scale, vaf_from_scale))
    for rows in swarms:
        draw_swarm(ax, rows, looks[rows["controller"][0]], len(swarms))
    if len(table.filter(style.DRAWN_OPEN)):
        ax.legend(handles=[style.OPEN_MARKER], loc="lower left")
    low, high = axis_limits(table["VAF"].to_numpy())
    ax.set_ylim(float(vaf_from_scale(np.array(low))), float(vaf_from_scale(np.array(high))))
    ax.set_yticks(axis_ticks(low, high), minor=False)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.set_xlim(0, 1)
    ax.set_xticks([rows["x_centre"][0] for rows in swarms], lines)
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("VAF (%), log scale of 100 − VAF")
    return figure


def draw_swarm(ax: Axes, rows: pl.DataFrame, look: style.Look, swarms: int) -> None:
    shape: dict[str, Any] = {"marker": look.marker, "linewidths": 0.8, "label": look.label}
    style.draw_fits(ax, rows, rows["x"], drawn_vaf(rows), look.colour, look.size, **shape)
    centre, median, half = rows["x_centre"][0], min(rows["median_VAF"][0], LARGEST_VAF), 0.3 / swarms
    ax.hlines(median, centre - half, centre + half, color=style.BLACK, linewidth=1.2, zorder=0.5)
    if swarms <= MOST_BESIDE:
        ax.annotate(f"median\n{said_vaf(rows['median_VAF'][0])}", (centre + half + 0.02 / swarms, median), va="center")


def swarm_name(rows: pl.DataFrame, controller: str, several: bool, swarms: int) -> str:
    """What stands below a swarm, in lines of the width that each of so many `swarms` has."""
    place = place_name(rows["joint"][0], rows["side"][0]) if several or swarms > MOST_BESIDE else ""
    median = f"median {said_vaf(rows['median_VAF'][0])}" if swarms > MOST_BESIDE else ""
    letters = max(int(17 * panel_width(swarms) / swarms), 6)
    named = (controller.strip(), place, fits_and_trials(rows), median)
    return "\n".join(part for line in named if line for part in textwrap.wrap(line, letters))


def fits_and_trials(rows: pl.DataFrame) -> str:
    trials = count_of(rows["trial"].n_unique(), "trial")
    return trials if len(rows) == rows["trial"].n_unique() else f"{count_of(len(rows), 'fit')} of {trials}"


def caption(table: pl.DataFrame) -> str:
    said = [
        "Variance accounted for (VAF) by the best second-order system, Eq. 15: a marker per trial and amplitude. The "
        "axis is logarithmic in 100 − VAF, the share of the variance that the system leaves unexplained. Black bars "
        "are medians; the place across a swarm has no meaning."
    ]
    swarms = swarms_of(table)
    several = len(table.select(PLACE).unique()) > 1
    for rows in swarms:
        place = rows.select(PLACE).row(0) if several else ()
        name = ", ".join(filter(None, [*place, rows["controller"][0] or NO_CONTROLLER.label.lower()]))
        low, median, high = (said_vaf(np.quantile(rows["VAF"], share)) for share in (0, 0.5, 1))
        said.append(
            f"{as_text(name[:1].upper() + name[1:])} ({fits_and_trials(rows)}): median {median}, {low} to {high}."
        )
    if len(table.filter(pl.col("VAF") > LARGEST_VAF)):
        said.append(f"Larger VAFs than {LARGEST_VAF} % are drawn there.")
    return " ".join([*said, doubtful_said(table, "drawn open")])
