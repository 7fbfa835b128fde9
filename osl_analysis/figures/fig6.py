# SPDX-License-Identifier: Apache-2.0
"""Fig. 6: the variance of the torque that a second-order system accounts for."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from osl_analysis.figures import marks, style
from osl_analysis.stats.repeats import counted, doubts_of_trials
from osl_analysis.stats.rounding import written
from osl_analysis.trial import Array

LEAST_UNEXPLAINED = 1e-4  # smaller unexplained shares are drawn here [percent]


class Layout:
    """Places of swarms, and sizes."""

    HEIGHT = 3.0  # of the figure [in]
    SWARM_HEIGHT = 1.5  # over which the fits spread, at least [in]
    MARGIN = 0.75  # of the panel, for the labels of its vertical axis [in]
    POINT = 4.9 / 72  # diameter of a marker with a small gap [in]
    REACH = 0.45  # of a swarm to either side; swarms are 1 apart
    MEDIAN_REACH = 0.3  # of the line at its median to either side
    MOST_IN_COLUMN = 2  # swarms in one column of the page
    MOST_TICKS = 12
    SMALLEST = 0.4  # size of a marker, of that of the largest amplitude


LARGEST_MARKER = 3.8  # of a legend [pt]
MEDIAN_LINE: dict[str, Any] = {"color": style.BLACK, "linewidth": 1.2}


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial and amplitude, doubtful where the fit to all of the trial is. A trial that
    no stepped sine moved has one row, a fit without a VAF (a constant torque) none."""
    is_single = pl.col("amplitude_deg").is_not_null() | (pl.len().over("trial") == 1)
    return doubts_of_trials(impedance).filter(is_single & pl.col("VAF").is_finite())


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """A swarm for each controller of each joint and side."""
    swarms = [
        (title, look, rows)
        for title, part in style.by_place(table)
        for look, rows in style.by_controller(part)
    ]
    width = style.SINGLE_COLUMN if len(swarms) <= Layout.MOST_IN_COLUMN else style.DOUBLE_COLUMN
    figure, (ax,) = style.panels(width, Layout.HEIGHT)
    unit = (width - Layout.MARGIN) / len(swarms)  # of the horizontal axis [in]
    spread = max(np.ptp(np.log10(unexplained(table))), 1e-9)
    labels = []
    for place, (title, look, rows) in enumerate(swarms):
        shares = unexplained(rows)
        heights = np.log10(shares) / spread * Layout.SWARM_HEIGHT
        x = place + marks.swarm_offsets(heights, Layout.POINT, Layout.REACH * unit) / unit
        marks.draw_fits(ax, rows, x, shares, look, marks.BEHIND_LINES, sizes=sizes(rows, table))
        lines = [look.label, title, f"$n$ = {len(rows)}", draw_median(ax, rows, place)]
        labels.append("\n".join(filter(None, lines)))
    ax.set_yscale("log")
    ax.set_xlim(-0.5, len(swarms) - 0.5)
    ax.set_xticks(range(len(swarms)), labels)
    ax.tick_params(axis="x", length=0)
    marks.label_log_axis(ax.yaxis, Layout.MOST_TICKS, lambda share: f"{100 - share:.7g}")
    ax.invert_yaxis()
    ax.set_ylabel("VAF (%), log scale of 100 − VAF")
    keys = [marks.key("Median", **MEDIAN_LINE), *amplitude_keys(table)]
    marks.legend_above(figure, [*keys, *marks.open_keys(table)])
    return figure


def sizes(rows: pl.DataFrame, table: pl.DataFrame) -> Array:
    """Size of each fit's marker (n,), of the usual one: its amplitude, of the table's largest."""
    largest = table["amplitude_deg"].cast(pl.Float64).max() or 1.0
    share = rows["amplitude_deg"].cast(pl.Float64).fill_null(largest) / largest
    return np.maximum(share.to_numpy(), Layout.SMALLEST)


def amplitude_keys(table: pl.DataFrame) -> list[Line2D]:
    """The markers of the smallest and of the largest amplitude, where there are several."""
    known = table.drop_nulls("amplitude_deg").sort("amplitude_deg")
    ends = known[[0, -1]] if len(known) else known
    look = {"marker": "o", "color": style.GREY}
    return [
        marks.key(f"{row['amplitude_deg']:.2g}°", markersize=LARGEST_MARKER * size, **look)
        for row, size in zip(ends.to_dicts(), sizes(ends, table), strict=True)
    ]


def unexplained(rows: pl.DataFrame) -> Array:
    """100 − VAF of each fit (n,) [percent], as it is drawn."""
    return np.maximum(100 - rows["VAF"].to_numpy(), LEAST_UNEXPLAINED)


def draw_median(ax: Axes, rows: pl.DataFrame, place: int) -> str:
    """The median of the fits that are not doubtful, and its text as in `summary.json`."""
    used = counted(rows)
    if used.is_empty():
        return "all doubtful"
    median = np.median(used["VAF"])
    ax.hlines(
        max(100 - median, LEAST_UNEXPLAINED),
        place - Layout.MEDIAN_REACH,
        place + Layout.MEDIAN_REACH,
        **MEDIAN_LINE,
        zorder=0.5,
    )
    return f"median {written(median, unit='%')} %"
