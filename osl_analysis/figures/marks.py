# SPDX-License-Identifier: Apache-2.0
"""What several figures draw: markers that lead to trials, bars, swarms, legends, and logarithmic
axes."""

from collections.abc import Callable, Collection, Sequence
from typing import Any
from urllib.parse import quote

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator
from numpy.typing import ArrayLike

from osl_analysis.figures.style import (
    BLACK,
    GREY,
    HAIRLINE,
    THICK,
    THIN,
    WHITE,
    Look,
    by_controller,
    has_values,
)
from osl_analysis.stats.repeats import is_doubtful
from osl_analysis.trial import Array

# bars of an estimate: ending of its columns, label, width [pt]
BARS = (("", "95 % interval", THICK), ("_range", "Range", THIN))
BAR_LENGTH = 8.0  # of a bar in a legend [pt]
TOUCHING = 1e-9  # relative difference of two places that are one, by rounding
STEPS_PER_POINT = 8  # of the offsets that a point of a swarm tries
MOST_STEPS = 1000

# matplotlib's zorder of markers; bars and lines have 2
BEFORE_BARS = 3
BEHIND_LINES = 1


def has_doubtful(table: pl.DataFrame) -> bool:
    """Whether a fit of a table is doubtful."""
    return bool(is_doubtful(table).any())


def place_in_report(trial: str) -> str:
    """A trial in the report of a run, as the figures' SVG files reach it."""
    return f"../report.html#trial={quote(trial, safe='')}"


def draw_fits(
    ax: Axes,
    rows: pl.DataFrame,
    x: ArrayLike,
    y: ArrayLike,
    look: Look,
    zorder: int = BEFORE_BARS,
    names: Collection[str] = (),
    sizes: ArrayLike = 1.0,
) -> None:
    """Draw a marker for each fit, which leads to its trial.

    Parameters
    ----------
    ax : Axes
    rows : DataFrame
        A row per fit, with `trial` and `doubtful`; the marker of a doubtful one is open.
    x, y : (n,)
        Places of the markers, in units of the axes.
    look : Look
    zorder : int
        `BEFORE_BARS` or `BEHIND_LINES`.
    names : Collection of str
        Estimates whose doubts open a marker; by default those of any do.
    sizes : (n,)
        Of the markers, of that of the look.
    """
    faces = [WHITE if doubtful else look.colour for doubtful in is_doubtful(rows, names)]
    drawn = ax.scatter(
        x, y, np.square(look.size * np.asarray(sizes)), marker=look.marker, label=look.label,
        facecolors=faces, edgecolors=look.colour, linewidths=look.edge, zorder=zorder,
    )  # fmt: skip
    drawn.set_urls([place_in_report(trial) for trial in rows["trial"]])


def draw_estimates(ax: Axes, rows: pl.DataFrame, x: str, y: str, look: Look) -> None:
    """Draw the column `y` over `x` as `draw_fits`, before thin bars for the range over single
    motion and thick ones for the 95 % interval, where these are known."""
    for ending, _, width in BARS:
        ends = [f"{y}{ending}_low", f"{y}{ending}_high"]
        known = rows.drop_nulls(ends)
        ax.vlines(known[x], *known.select(ends), color=look.colour, linewidth=width)
    draw_fits(ax, rows, rows[x], rows[y], look, names=[y])


# Legends


def draw_zero_lines(ax: Axes) -> None:
    """Hairlines where an axis is 0."""
    for draw in (ax.axhline, ax.axvline):
        draw(0, color=BLACK, linewidth=HAIRLINE)


def key(label: str, **look: Any) -> Line2D:
    """An entry of a legend that is drawn nowhere else; a `marker` stands there without a line."""
    if "marker" in look:
        look.setdefault("linestyle", "")
    return Line2D([], [], label=label, **look)


def open_keys(table: pl.DataFrame) -> list[Line2D]:
    """What an open marker says, if a fit of the table is doubtful."""
    if not has_doubtful(table):
        return []
    return [key("Open: doubtful", marker="o", color=GREY, mfc=WHITE, markersize=3.8, mew=0.8)]


def estimate_keys(table: pl.DataFrame, quantity: str) -> list[Line2D]:
    """What `draw_estimates` has drawn of a quantity: controllers, bars and open markers."""
    keys = [
        key(look.label, marker=look.marker, color=look.colour, markersize=look.size)
        for look, _ in by_controller(table)
    ]
    for ending, label, width in BARS:
        if has_values(table, f"{quantity}{ending}_low"):
            keys.append(key(label, marker="|", color=GREY, markersize=BAR_LENGTH, mew=width))
    return keys + open_keys(table)


def labelled(axes: Sequence[Axes]) -> list[Any]:
    """What was drawn with a label, the first of each."""
    entries: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    return list(entries.values())


def legend_above(figure: Figure, keys: Sequence[Any], title: str = "") -> None:
    """Put a legend above all panels, in as many columns as the page has room for."""
    for columns in range(len(keys), 0, -1):
        legend = figure.legend(
            handles=keys, loc="outside upper center", ncols=columns, columnspacing=1.0,
            title=title or None, alignment="left",
        )  # fmt: skip
        if legend.get_window_extent().width <= figure.bbox.width:
            break
        if columns > 1:
            legend.remove()


# Swarms


def swarm_offsets(heights: Array, width: float, reach: float) -> Array:
    """Find places side by side at which points of a swarm do not overlap.

    Parameters
    ----------
    heights : (n,)
        Where the points stand along the axis of their value [in].
    width : float
        Diameter of a point [in].
    reach : float
        Largest offset to either side [in]. Beyond it, all move together.

    Returns
    -------
    (n,)
        Offsets from the middle [in]. From the lowest point up, each takes the free place that is
        nearest to the middle.
    """
    offsets = np.zeros(len(heights))
    order = np.argsort(heights, kind="stable")
    steps = np.arange(MOST_STEPS)
    tried = width / STEPS_PER_POINT * ((steps + 1) // 2) * (-1.0) ** steps  # 0, 1, -1, 2, -2 ...
    for rank, point in enumerate(order):
        below = order[:rank]
        distance = np.hypot(tried[:, None] - offsets[below], heights[point] - heights[below])
        is_free = (distance >= width * (1 - TOUCHING)).all(axis=1)
        offsets[point] = tried[np.argmax(is_free)]
    widest = float(np.abs(offsets).max(initial=reach))
    return offsets * reach / widest


# Axes


def label_log_axis(axis: Axis, most: int, text: Callable[[float], str] = "{:.4g}".format) -> None:
    """Give a logarithmic axis ticks at 1, 2 and 5 of each decade, else at decades, else at 1 and 3,
    else even ones: the first of these that are two to `most`."""
    low, high = axis.get_view_interval()
    even = MaxNLocator(nbins=most - 1, steps=[1, 2, 2.5, 5, 10])
    by_decades = LogLocator(numticks=most)
    finely, coarsely = (LogLocator(subs=subs, numticks=99) for subs in ((1, 2, 5), (1, 3)))
    for locator in (finely, by_decades, coarsely, even):
        ticks = [tick for tick in locator.tick_values(low, high) if low <= tick <= high]
        if 2 <= len(ticks) <= most:
            break
    axis.set_ticks(ticks, [text(tick) for tick in ticks])
    axis.set_ticks([], minor=True)
