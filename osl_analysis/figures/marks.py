# SPDX-License-Identifier: Apache-2.0
"""What several figures draw: markers that lead to trials, bars, swarms, legends, and logarithmic
axes."""

from collections.abc import Callable, Collection, Sequence
from typing import Any
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import ArrayLike

from osl_analysis.base.trial import Array
from osl_analysis.figures.style import BLACK, GREY, WHITE, Look, by_controller, has_values
from osl_analysis.stats.repeats import is_doubtful

# bars of an estimate: ending of its columns, label, width [pt]
BARS = (("", "95 % interval", 2), ("_range", "Range", 0.5))
SWARM_ROWS = 24  # markers of a swarm that have room one above the other


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
    names: Collection[str] = (),
    areas: ArrayLike = 1.0,
) -> None:
    """Draw a marker for each fit, before bars and lines, which leads to its trial.

    Parameters
    ----------
    ax : Axes
    rows : DataFrame
        A row per fit, with `trial` and `doubtful`; the marker of a doubtful one is open.
    x, y : (n,)
        Places of the markers, in units of the axes.
    look : Look
    names : Collection of str
        Estimates whose doubts open a marker; by default those of any do.
    areas : (n,)
        Of the markers, of that of the style.
    """
    faces = [WHITE if doubtful else look.colour for doubtful in is_doubtful(rows, names)]
    drawn = ax.scatter(
        x, y, mpl.rcParams["lines.markersize"] ** 2 * np.asarray(areas), marker=look.marker,
        label=look.label, facecolors=faces, edgecolors=look.colour, zorder=3,
    )  # fmt: skip
    drawn.set_urls([place_in_report(trial) for trial in rows["trial"]])


def draw_estimates(ax: Axes, rows: pl.DataFrame, x: str, y: str, look: Look) -> None:
    """Draw the column `y` over `x` as `draw_fits`, before thin bars for the range over single
    motion and thick ones for the 95 % interval, where these are known."""
    for ending, _, width in BARS:
        ends = [f"{y}{ending}_low", f"{y}{ending}_high"]
        known = rows.drop_nulls(ends)
        ax.vlines(known[x], *known.select(ends), color=look.colour, linewidth=width)
    draw_fits(ax, rows, rows[x], rows[y], look, [y])


def draw_zero_lines(ax: Axes) -> None:
    """Hairlines where an axis is 0."""
    for draw in (ax.axhline, ax.axvline):
        draw(0, color=BLACK, linewidth=0.5)


# Legends


def key(label: str, **look: Any) -> Line2D:
    """An entry of a legend that is drawn nowhere else; a `marker` stands there without a line."""
    if "marker" in look:
        look.setdefault("linestyle", "")
    return Line2D([], [], label=label, **look)


def open_keys(table: pl.DataFrame) -> list[Line2D]:
    """What an open marker says, if a fit of the table is doubtful."""
    return [key("Open: doubtful", marker="o", color=GREY, mfc=WHITE)] if has_doubtful(table) else []


def estimate_keys(table: pl.DataFrame, quantity: str) -> list[Line2D]:
    """What `draw_estimates` has drawn of a quantity: controllers, bars and open markers."""
    keys = [
        key(look.label, marker=look.marker, color=look.colour) for look, _ in by_controller(table)
    ]
    length = 2 * mpl.rcParams["lines.markersize"]
    for ending, label, width in BARS:
        if has_values(table, f"{quantity}{ending}_low"):
            keys.append(key(label, marker="|", color=GREY, markersize=length, mew=width))
    return keys + open_keys(table)


def labelled(axes: Sequence[Axes], kind: type = object) -> list[Any]:
    """What of this kind was drawn with a label, the first of each."""
    entries: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            if isinstance(handle, kind):
                entries.setdefault(label, handle)
    return list(entries.values())


def legend_above(figure: Figure, keys: Sequence[Any], title: str = "") -> None:
    """Put a legend above all panels, in as many columns as the page has room for."""
    for columns in range(len(keys), 0, -1):
        legend = figure.legend(
            handles=keys, loc="outside upper center", ncols=columns,
            title=title or None, alignment="left",
        )  # fmt: skip
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()


def swarm_offsets(heights: Array, span: float, columns: float) -> Array:
    """Find places side by side at which points of a swarm do not overlap.

    Parameters
    ----------
    heights : (n,)
        Where the points stand along the axis of their value.
    span : float
        Range of the heights of all swarms of the axis.
    columns : float
        How many markers have room side by side. Beyond, all move together.

    Returns
    -------
    (n,)
        Offsets from the middle, -0.5 to 0.5. From the lowest point up, each takes the free place
        that is nearest to the middle.
    """
    rows = SWARM_ROWS * heights / (span or 1.0)
    offsets = np.zeros(len(rows))  # as `rows` in diameters of a marker
    steps = np.arange(1000)
    tried = (steps + 1) // 2 * (-1.0) ** steps / 4  # 0, 1, -1, 2, -2 ... quarters
    order = np.argsort(rows, kind="stable")
    for rank, point in enumerate(order):
        below = order[:rank]
        distance = np.hypot(tried[:, None] - offsets[below], rows[point] - rows[below])
        offsets[point] = tried[np.argmax((distance >= 1).all(axis=1))]
    return offsets / max(columns, 2 * np.abs(offsets).max())


def label_log_axis(axis: Axis, text: Callable[[float], str] = "{:.4g}".format) -> None:
    """Give a logarithmic axis ticks at 1, 2 and 5 of each decade, and of a short one even ones."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
    axis.set_minor_locator(NullLocator())
