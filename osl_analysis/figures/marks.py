"""Marks that several figures share: markers that lead to trials, bars, swarms, and legends."""

from collections.abc import Iterable, Mapping
from typing import Any
from urllib.parse import quote

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from osl_analysis.figures.style import GREY, THICK, THIN, WHITE, Look
from osl_analysis.stats.repeats import IS_DOUBTFUL
from osl_analysis.trial import Array

# bars, in legends
INTERVAL = "95 % interval"
AMPLITUDES = "Range over amplitudes"
BAR_LENGTH = 8.0  # of a bar in a legend [pt]
TOUCHING = 1e-9  # relative difference of two places that are one, by rounding


def has_doubtful(table: pl.DataFrame) -> bool:
    """Whether a fit of a table is doubtful."""
    return bool(table.select(IS_DOUBTFUL.any()).item())


def place_in_report(trial: str) -> str:
    """A trial in the report of a run, as the figures' SVG files reach it."""
    return f"../report.html#trial={quote(trial, safe='')}"


# matplotlib's zorder of markers; bars and lines have 2
BEFORE_BARS = 3
BEHIND_LINES = 1


def draw_fits(
    ax: Axes, rows: pl.DataFrame, x: ArrayLike, y: ArrayLike, look: Look, zorder: int = BEFORE_BARS
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
    """
    faces = [
        WHITE if doubtful else look.colour for doubtful in rows.select(IS_DOUBTFUL).to_series()
    ]
    drawn = ax.scatter(
        x, y, look.size**2, marker=look.marker, label=look.label, facecolors=faces,
        edgecolors=look.colour, linewidths=look.edge, zorder=zorder,
    )  # fmt: skip
    drawn.set_urls([place_in_report(trial) for trial in rows["trial"]])


def draw_bars(ax: Axes, rows: pl.DataFrame, x: str, y: str, colour: str, width: float) -> None:
    """Draw upright bars from `y`_low to `y`_high, where both are known."""
    low, high = f"{y}_low", f"{y}_high"
    known = rows.drop_nulls([low, high])
    ax.vlines(known[x], known[low], known[high], color=colour, linewidth=width)


def draw_estimates(ax: Axes, rows: pl.DataFrame, x: str, y: str, look: Look) -> None:
    """Draw the column `y` over `x` as `draw_fits`, before thin bars for the range over single
    amplitudes and thick ones for the 95 % interval."""
    draw_bars(ax, rows, x, f"{y}_amplitudes", look.colour, THIN)
    draw_bars(ax, rows, x, y, look.colour, THICK)
    draw_fits(ax, rows, rows[x], rows[y], look)


# Legends


def key(label: str, **look: Any) -> Line2D:
    """An entry of a legend that is drawn nowhere else; a `marker` stands there without a line."""
    if "marker" in look and "linestyle" not in look:
        look["linestyle"] = ""
    return Line2D([], [], label=label, **look)


def controller_entries(looks: Iterable[Look]) -> dict[str, Line2D]:
    """A marker for each controller, by its name."""
    return {
        look.label: key(look.label, marker=look.marker, color=look.colour, markersize=look.size)
        for look in looks
    }


def bar_entry(label: str, width: float, colour: str = GREY) -> dict[str, Line2D]:
    """An upright bar of a width [pt]."""
    return {label: key(label, marker="|", color=colour, markersize=BAR_LENGTH, mew=width)}


def bar_entries(table: pl.DataFrame, quantities: Iterable[str]) -> dict[str, Line2D]:
    """What `draw_estimates` has drawn of some quantities: the 95 % interval, and the range over
    amplitudes where it is more than a point."""
    entries: dict[str, Line2D] = {}
    for ending, label, width in (("", INTERVAL, THICK), ("_amplitudes", AMPLITUDES, THIN)):
        if any(has_range(table, f"{quantity}{ending}") for quantity in quantities):
            entries |= bar_entry(label, width)
    return entries


def has_range(table: pl.DataFrame, name: str) -> bool:
    """Whether `name`_high is above `name`_low in a row of the table."""
    low, high = f"{name}_low", f"{name}_high"
    if low not in table.columns or high not in table.columns:
        return False
    return not table.filter(pl.col(high) > pl.col(low)).is_empty()


def open_entry(table: pl.DataFrame) -> dict[str, Line2D]:
    """What an open marker says, if a fit of the table is doubtful."""
    if not has_doubtful(table):
        return {}
    label = "Open: doubtful"
    return {label: key(label, marker="o", color=GREY, mfc=WHITE, markersize=3.8, mew=0.8)}


def legend_entries(axes: Iterable[Axes]) -> dict[str, Any]:
    """The handles of what was drawn with a label, by label."""
    entries: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        entries.update(zip(labels, handles, strict=True))
    return entries


def legend_above(
    figure: Figure, entries: Mapping[str, Any], most: int, columnspacing: float = 1.4
) -> None:
    """Put a legend above all panels, in as many columns as the page has room for, `most` at
    most."""
    for columns in range(min(most, len(entries)), 0, -1):
        legend = figure.legend(
            list(entries.values()), list(entries),
            loc="outside upper center", ncols=columns, columnspacing=columnspacing,
        )  # fmt: skip
        width = legend.get_window_extent().width / figure.dpi
        if width < figure.get_figwidth():
            return
        if columns > 1:
            legend.remove()


# Swarms


def swarm_offsets(heights: Array, width: float, inches: float, reach: float) -> Array:
    """Find places side by side at which points of a swarm do not overlap.

    Parameters
    ----------
    heights : (n,)
        Where the points stand along the axis of their value [in].
    width : float
        Diameter of a point [in].
    inches : float
        Length of a unit of the other axis [in].
    reach : float
        Largest offset to either side, in units of the other axis. Beyond it, all move together.

    Returns
    -------
    (n,)
        Offsets from the middle, in units of the other axis. From the lowest point up, each takes
        the free place that is nearest to the middle.
    """
    offsets = np.zeros(len(heights))
    order = np.argsort(heights, kind="stable")
    for rank, point in enumerate(order):
        placed = order[:rank]
        near = placed[np.abs(heights[placed] - heights[point]) < width]
        distance = np.sqrt(width**2 - (heights[near] - heights[point]) ** 2)
        touching = distance * (1 + TOUCHING)
        candidates = np.concatenate([[0.0], offsets[near] - touching, offsets[near] + touching])
        free = [
            candidate
            for candidate in candidates
            if (np.abs(candidate - offsets[near]) >= distance).all()
        ]
        side = 1 if rank % 2 else -1  # of two places as near, the left and the right in turn
        offsets[point] = min(free, key=lambda place: (round(abs(place) / width, 6), side * place))

    offsets /= inches
    widest = float(np.max(np.abs(offsets), initial=0))
    return offsets * min(1.0, reach / widest) if widest > 0 else offsets
