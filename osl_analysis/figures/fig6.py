# SPDX-License-Identifier: Apache-2.0
"""Fig. 6: the variance of the torque that a second-order system accounts for."""

from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from osl_analysis.base.trial import Array
from osl_analysis.figures import style
from osl_analysis.stats.rounding import written

NOMINAL_DIGITS = 2  # significant digits of an amplitude in the legend: measured ones scatter by 1 %
LEAST_DRAWN = 1e-4  # smaller unexplained shares are drawn here [percent]
MEDIAN_LINE: Any = {"color": style.BLACK, "zorder": 1}


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial and amplitude, doubtful where the fit to all of the trial is. A trial that
    no stepped sine moved has one row, a fit without a VAF (a constant torque) none."""
    is_single = pl.col("amplitude_deg").is_not_null() | (pl.len().over("trial") == 1)
    return impedance.filter(is_single & pl.col("VAF").is_finite())


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """A swarm for each controller of each joint and side."""
    swarms = [
        (title, look, rows)
        for title, part in style.by_place(table)
        for look, rows in style.by_controller(part)
    ]
    width = style.SINGLE_COLUMN if len(swarms) <= 2 else style.DOUBLE_COLUMN
    figure, (ax,) = style.panels(width, 3)
    span = float(np.ptp(np.log10(unexplained(table))))
    labels = []
    for place, (title, look, rows) in enumerate(swarms):
        shares = unexplained(rows)
        heights = np.log10(shares)
        x = place + style.swarm_offsets(heights, span, style.SWARM_ROWS / 2)
        style.draw_fits(ax, rows, x, shares, look, areas=areas(rows, table))
        lines = [look.label, title, f"$n$ = {len(rows)}", draw_median(ax, rows, place)]
        labels.append("\n".join(filter(None, lines)))
    ax.set_yscale("log")
    ax.set_xlim(-0.5, len(swarms) - 0.5)
    ax.set_xticks(range(len(swarms)), labels)
    ax.tick_params(axis="x", length=0)
    style.label_log_axis(ax.yaxis, lambda share: f"{100 - share:.7g}")
    ax.invert_yaxis()
    ax.set_ylabel("VAF (%), log scale of 100 − VAF")
    keys = [style.key("Median", **MEDIAN_LINE), *amplitude_keys(table)]
    style.legend_above(figure, [*keys, *style.open_keys(table)])
    return figure


def areas(rows: pl.DataFrame, table: pl.DataFrame) -> Array:
    """Area of each fit's marker (n,), of the usual one, whose diameter is that of the table's
    largest amplitude."""
    largest = table["amplitude_deg"].cast(pl.Float64).max() or 1.0
    share = rows["amplitude_deg"].cast(pl.Float64).fill_null(largest) / largest
    return share.to_numpy() ** 2


def amplitude_keys(table: pl.DataFrame) -> list[Line2D]:
    """A marker for each amplitude [deg], grey, since its size means the same of every
    controller."""
    rows = table.drop_nulls("amplitude_deg").with_columns(
        nominal_deg=pl.col("amplitude_deg").round_sig_figs(NOMINAL_DIGITS)
    )
    amplitudes = rows.unique("nominal_deg").sort("nominal_deg")
    sizes = mpl.rcParams["lines.markersize"] * np.sqrt(areas(amplitudes, table))
    keys = []
    for amplitude, size in zip(amplitudes["nominal_deg"], sizes, strict=True):
        keys.append(style.key(f"{amplitude:g}°", marker="o", color=style.GREY, ms=size))
    return keys


def unexplained(rows: pl.DataFrame) -> Array:
    """100 − VAF of each fit (n,) [percent], as it is drawn."""
    return np.maximum(100 - rows["VAF"].to_numpy(), LEAST_DRAWN)


def draw_median(ax: Axes, rows: pl.DataFrame, place: int) -> str:
    """The median of the fits that are not doubtful, and its text as in `summary.json`."""
    used = rows.remove(pl.col("is_doubtful"))
    if used.is_empty():
        return "all doubtful"
    median = np.median(used["VAF"])
    ax.hlines(max(100 - median, LEAST_DRAWN), place - 1 / 3, place + 1 / 3, **MEDIAN_LINE)
    return f"median {written(median, unit='%')} %"
