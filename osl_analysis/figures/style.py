# SPDX-License-Identifier: Apache-2.0
"""The style of all figures, and the parts that several figures draw.

It has the width of a page, colours, looks of controllers, panels, labels of quantities, titles by
condition, and names of a campaign as matplotlib draws them. Shared parts are markers that lead to
trials, bars, swarms, legends and logarithmic axes. `style.mplstyle` has all other sizes and widths.

Example: `panels(SINGLE_COLUMN, 3, 2)` is a figure with two panels, one above the other.
"""

import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from typing import Any
from urllib.parse import quote

import matplotlib as mpl
import matplotlib.style as mpl_style
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import (
    FixedFormatter,
    FixedLocator,
    FuncFormatter,
    Locator,
    LogLocator,
    MaxNLocator,
    NullLocator,
)
from numpy.typing import ArrayLike

from osl_analysis.base.trial import Array
from osl_analysis.figures.drawing import IS_DOUBTFUL

# Widths of a figure [in], a tenth of a point (1/72.27 in) below those of IEEEtran, so that TeX does
# not call the box overfull.
TEX_POINTS_PER_INCH = 72.27
SINGLE_COLUMN = 251.9 / TEX_POINTS_PER_INCH  # IEEEtran: \columnwidth is 252.0 pt
DOUBLE_COLUMN = 515.9 / TEX_POINTS_PER_INCH  # IEEEtran: \textwidth is 516.0 pt

BLACK = "#000000"
WHITE = "#FFFFFF"
GREY = "#6E6E6E"
MAGENTA = "#C2127F"
LIGHT_GREY = "#B4B4B4"  # of data behind others
GRID_GREY = "#E4E4E4"  # of grids, bands and grounds
ORANGE = "#E66100"
PURPLE = "#5D3A9B"
"""Orange and purple differ for every common kind of colour vision, and in greyscale by lightness
(58 and 32 of 100)."""
STYLE = Path(__file__).with_suffix(".mplstyle")


@dataclass(frozen=True)
class Look:
    """How the results of one controller are drawn in every figure."""

    colour: str
    marker: str
    label: str  # name in the legend


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw and save with the settings of `STYLE` only, whatever the user's matplotlibrc. A letter
    that no font has is drawn as a box, without a warning."""
    with mpl_style.context(STYLE, after_reset=True), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        yield


class PaperFigure(Figure):
    """A matplotlib `Figure` in the style of the paper, which a notebook shows without `pyplot`."""

    def savefig(self, fname: Any, **kwargs: Any) -> None:
        with paper_style():
            super().savefig(fname, **kwargs)

    def _repr_png_(self) -> bytes:
        page = BytesIO()
        self.savefig(page, format="png", dpi=150)
        return page.getvalue()


def panels(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    titles: Sequence[str] = (),
    **choices: Any,
) -> tuple[PaperFigure, list[Axes]]:
    """Make a figure and its panels.

    Parameters
    ----------
    width, height : float
        Of the figure [in].
    rows, columns : int
    titles : sequence of str
        Panel by panel what stands behind its letter; fewer than panels: nothing.
    **choices
        Of `Figure.subplots`, as `sharex="col"`.

    Returns
    -------
    PaperFigure
    list of Axes
        Row by row. Several panels are lettered (a), (b) ...
    """
    figure = PaperFigure(figsize=(width, height), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False, **choices).flat)
    for number, ax in enumerate(axes):
        letter = f"({ascii_lowercase[number % 26]})" if len(axes) > 1 else ""
        title = titles[number] if number < len(titles) else ""
        ax.set_title(f"{letter} {title}".strip(), loc="left")
    return figure, axes


AXIS_LABELS = {  # one name per quantity, in every figure
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Apparent inertia $\hat{I}$ (10$^{-3}$ kg·m$^2$)",
    "K_d": "Desired stiffness $K_d$ (N·m/rad)",
    "B_d": "Desired damping $B_d$ (N·m·s/rad)",
}

# of controllers by their numbers, the first two as in the draft: these and black are 20 or more
# apart (CIE 1976) for readers without long- or medium-wavelength cones
COLOURS = (ORANGE, PURPLE, "#3F8FBF", "#6B3A0A", "#2F5555", "#B98860", "#2B46F0")
MARKER_SHAPES = ("o", "D", "s", "^", "v", "P", "X", "p")
NO_CONTROLLER = Look(GREY, ">", "Controller not stated")


def drawn_name(name: str, letters: int = 22) -> str:
    """A name from a file as matplotlib draws it: in lines of so many letters, without mathematics,
    and no label that `_` hides."""
    lines = textwrap.fill(name, letters).replace("$", r"\$")
    return f" {lines}" if lines.startswith("_") else lines


def condition(rows: pl.DataFrame) -> list[str]:
    """What is stated of the condition of these rows, such as `$K_d$ = 200 N·m/rad`; empty where
    nothing is."""
    K_d, B_d, controller = rows.select("K_d", "B_d", "controller").row(0)
    parts = []
    if K_d is not None:
        parts.append(f"$K_d$ = {K_d:g} N·m/rad")
    if B_d is not None:
        parts.append(f"$B_d$ = {B_d:g} N·m·s/rad")
    if controller is not None:
        parts.append(drawn_name(controller))
    return parts


def by_place(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint and side, whose results never share a panel, with a title such as
    `Knee, left`; it is empty where there is only one."""
    parts = table.partition_by("joint", "side", as_dict=True)
    if len(parts) == 1:
        return [("", table)]
    titled = []
    for place, part in parts.items():
        title = drawn_name(", ".join(filter(None, place)))
        titled.append((f"{title[:1].upper()}{title[1:]}", part))
    return titled


def by_controller(table: pl.DataFrame) -> list[tuple[Look, pl.DataFrame]]:
    """The rows of each controller with its look, which follows from `look`, its number; last those
    that state none."""
    ordered = table.sort("look", nulls_last=True, maintain_order=True)
    parts = []
    for (name, number), rows in ordered.partition_by("controller", "look", as_dict=True).items():
        look = NO_CONTROLLER
        if number is not None:
            colour = COLOURS[number % len(COLOURS)]
            look = Look(colour, MARKER_SHAPES[number % len(MARKER_SHAPES)], drawn_name(name))
        parts.append((look, rows))
    return parts


def has_values(table: pl.DataFrame, column: str) -> bool:
    """Whether the table has this column, and a row a value in it."""
    return column in table.columns and table[column].count() > 0


# What several figures draw

# bars of an estimate: ending of its columns, label, width [pt]
INTERVAL_LABEL, RANGE_LABEL = "95 % interval", "Range"
BARS = (("", INTERVAL_LABEL, 2), ("_range", RANGE_LABEL, 0.5))
POINTS_PER_INCH = 72
SWARM_ROWS = 24  # markers of a swarm that have room one above the other


def has_doubtful(table: pl.DataFrame) -> bool:
    """Whether a fit of plotted numbers is doubtful, or an estimate of it."""
    marks = [column for column in table.columns if column.endswith(IS_DOUBTFUL)]
    return any(table[column].cast(pl.Boolean).any() for column in marks)


def place_in_report(trial: str) -> str:
    """A trial in the report of a run, as the figures' SVG files reach it."""
    return f"../report.html#trial={quote(trial, safe='')}"


def draw_fits(
    ax: Axes,
    rows: pl.DataFrame,
    x: ArrayLike,
    y: ArrayLike,
    look: Look,
    areas: ArrayLike = 1.0,
    doubt: str = IS_DOUBTFUL,
) -> None:
    """Draw a marker for each fit, before bars and lines, which leads to its trial.

    Parameters
    ----------
    ax : Axes
    rows : DataFrame
        A row per fit, with `trial`, and the column `doubt`.
    x, y : (n,)
        Places of the markers, in units of the axes.
    look : Look
    areas : (n,)
        Of the markers, of that of the style.
    doubt : str
        Column that says whether the fit, or the estimate that is drawn, is doubtful: its marker is
        then open.
    """
    faces = [WHITE if is_doubtful else look.colour for is_doubtful in rows[doubt]]
    drawn = ax.scatter(
        x,
        y,
        mpl.rcParams["lines.markersize"] ** 2 * np.asarray(areas),
        marker=look.marker,
        label=look.label,
        facecolors=faces,
        edgecolors=look.colour,
        zorder=3,
    )
    drawn.set_urls([place_in_report(trial) for trial in rows["trial"]])


def draw_estimates(ax: Axes, rows: pl.DataFrame, x: str, y: str, look: Look) -> None:
    """Draw the column `y` over `x` as `draw_fits`, before thin bars for the range over single
    motion and thick ones for the 95 % interval, where these are known. A marker is open where the
    estimate is doubtful, by the column `y_is_doubtful`, or else where its fit is."""
    for ending, label, width in BARS:
        ends = [f"{y}{ending}_low", f"{y}{ending}_high"]
        known = rows.drop_nulls(ends)
        ax.vlines(known[x], *known.select(ends), color=look.colour, linewidth=width, label=label)
    estimate_mark = f"{y}_{IS_DOUBTFUL}"
    doubt = estimate_mark if estimate_mark in rows.columns else IS_DOUBTFUL
    draw_fits(ax, rows, rows[x], rows[y], look, doubt=doubt)


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


def estimate_keys(axes: Sequence[Axes], table: pl.DataFrame) -> list[Line2D]:
    """What `draw_estimates` has drawn that is seen: controllers, the range if one is longer than
    its marker, and open markers. Captions tell of the interval."""
    keys = [
        key(look.label, marker=look.marker, color=look.colour) for look, _ in by_controller(table)
    ]
    marker_size = mpl.rcParams["lines.markersize"]
    if any(longest_bar(ax, RANGE_LABEL) > marker_size for ax in axes):
        length = 2 * marker_size
        keys.append(key(RANGE_LABEL, marker="|", color=GREY, markersize=length, mew=0.5))
    return keys + open_keys(table)


def longest_bar(ax: Axes, label: str) -> float:
    """Length of the longest bar of this label as it is drawn [pt]."""
    lengths = [0.0]
    for bars in ax.collections:
        if isinstance(bars, LineCollection) and bars.get_label() == label:
            lengths += [np.ptp(ax.transData.transform(ends)[:, 1]) for ends in bars.get_segments()]
    return max(lengths) * POINTS_PER_INCH / ax.figure.dpi


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
            handles=keys,
            loc="outside upper center",
            ncols=columns,
            title=title or None,
            alignment="left",
        )
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


class LogTicks(Locator):
    """Ticks of a logarithmic axis: at 1, else at 1, 2 and 5, else at each digit of a decade, the
    first of these of which `FEWEST_TICKS` lie on the axis; else at even distances."""

    DIGITS = ((1,), (1, 2, 5), (1, 2, 3, 4, 5, 6, 7, 8, 9))
    FEWEST_TICKS = 3  # fewer do not show that the scale is logarithmic
    MOST_EVEN_TICKS = 4

    def __call__(self) -> list[float]:
        assert self.axis is not None, "a locator of an axis"
        low, high = sorted(self.axis.get_view_interval())
        return self.tick_values(low, high)

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        for digits in self.DIGITS:
            ticks = np.asarray(LogLocator(subs=digits).tick_values(vmin, vmax))
            on_axis = ticks[(ticks >= vmin) & (ticks <= vmax)]
            if len(on_axis) >= self.FEWEST_TICKS:
                return [float(tick) for tick in on_axis]
        even = np.asarray(MaxNLocator(self.MOST_EVEN_TICKS).tick_values(vmin, vmax))
        return [float(tick) for tick in even]


def label_log_axis(axis: Axis, text: Callable[[float], str] = "{:.4g}".format) -> None:
    """Give a logarithmic axis at least three ticks, whose labels are plain numbers."""
    axis.set_major_locator(LogTicks())
    axis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
    axis.set_minor_locator(NullLocator())


def label_values(axis: Axis, values: Sequence[float], room: float) -> None:
    """Give a logarithmic axis a tick at each of some values, such as the measured frequencies.

    Parameters
    ----------
    axis : Axis
    values : sequence of float
    room : float
        Smallest distance of two labels, as a share of the axis; a tick that is nearer to the last
        label has none.
    """
    ordered = sorted({float(value) for value in values})
    span = np.log(ordered[-1] / ordered[0]) or 1.0
    labels = []
    last = -np.inf
    for value in ordered:
        place = float(np.log(value / ordered[0]) / span)
        has_room = place - last >= room
        labels.append(f"{value:g}" if has_room else "")
        if has_room:
            last = place
    axis.set_major_locator(FixedLocator(ordered))
    axis.set_major_formatter(FixedFormatter(labels))
    axis.set_minor_locator(NullLocator())
