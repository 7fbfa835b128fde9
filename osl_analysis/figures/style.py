"""The style of all figures: page size, lettering, colours and markers, panels, axes with their
ticks, and swarms."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from itertools import zip_longest
from pathlib import Path
from string import ascii_lowercase
from typing import Any, Literal
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, MultipleLocator

from osl_analysis.stats.repeats import IS_DOUBTFUL
from osl_analysis.trial import Array

# widths [in] of one column and of the text block of an IEEE two-column page
SINGLE_COLUMN, DOUBLE_COLUMN = 3.5, 7.16

BLACK, WHITE, GREY, MAGENTA = "#000000", "#FFFFFF", "#6E6E6E", "#C2127F"
ORANGE, PURPLE = "#E66100", "#5D3A9B"
"""Orange and purple differ for every common kind of colour vision, and in greyscale by lightness
(58 and 32 of 100)."""

THIN, THICK = 0.7, 1.8  # widths [pt] of bars over amplitudes, and of intervals
# line styles of doubtful fits, and of means and what is desired
DOTTED, DASHED = (0, (1, 1.5)), (0, (3, 2))

PAPER = mpl.rc_params_from_file(Path(__file__).with_suffix(".mplstyle"), use_default_template=False)
Dash = Literal["-", ""] | tuple[float, tuple[float, ...]]  # A line style as matplotlib takes it


@dataclass(frozen=True)
class Drawing:
    columns: Sequence[str]  # of the plotted numbers
    draw: Callable[[pl.DataFrame], Figure]
    points: Callable[..., pl.DataFrame] = lambda table: table  # result tables -> plotted numbers
    needs: Sequence[str] = ()  # columns of the result table from which `points` are
    # what of these numbers the caption says first, in Markdown
    about: Callable[[pl.DataFrame], str] = lambda _: ""
    # why, without any number
    nothing: str = "no trial of the campaign has the numbers that this figure shows"


def drawing(columns: Sequence[str], *more: Any, **others: Any) -> Callable[..., Drawing]:
    """Makes a function that draws plotted numbers of these `columns`, in the style of the paper, a
    `Drawing`."""
    return lambda draw: Drawing(columns, paper_style()(draw), *more, **others)


@dataclass(frozen=True)
class Look:
    """Colour, marker, size of the marker [pt], name and line style of one condition, the same in
    every figure."""

    colour: str
    marker: str
    size: float
    label: str
    dash: Dash = "-"


LOOKS = {  # of the controllers of the draft
    "compensated": Look(ORANGE, "o", 3.8, "Compensated", (0, (4, 1.5))),
    "uncompensated": Look(PURPLE, "D", 3.4, "Uncompensated", (0, (5, 1.5, 1, 1.5))),
}


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw and save with the settings `PAPER` only, independent of the user's matplotlibrc; usable
    as a decorator."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(PAPER)
        yield


def panels(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    shares: Any = None,
    names: Sequence[str] = (),
    heights: Sequence[float] | None = None,
) -> tuple[Figure, list[Axes]]:
    """A figure of the given size [in] and its panels, row by row, lettered (a), (b) ... if there
    are several. `shares` are the relative widths of the columns; the panels of a row then share
    their vertical axis. `heights` are those of the rows. `names` stand behind the letters; panels
    with names of their own share no axis."""
    figure = Figure(figsize=(width, height), layout="constrained")
    share = rows > 1 and not names
    ratios = {"width_ratios": shares, "height_ratios": heights}
    grid = figure.subplots(
        rows, columns, squeeze=False, sharex=share, sharey=bool(shares), **ratios
    )
    letters = [f"({letter})" for letter in ascii_lowercase[: grid.size]] * (grid.size > 1)
    titles = [f"{letter} {name}" for letter, name in zip_longest(letters, names, fillvalue="")]
    for ax, title in zip(grid.flat, titles, strict=False):
        # no labels stand there that each drawing would have to look for
        ax.set_title(title.strip(), loc="left", y=1)
    return figure, list(grid.flat)


@paper_style()
def lay_out(figure: Figure) -> None:
    """Place everything once, at the resolution of a PNG: every format then has the same places, and
    is drawn once."""
    figure.set_dpi(PAPER["savefig.dpi"])
    if engine := figure.get_layout_engine():
        engine.execute(figure)
    figure.set_layout_engine(None)  # with any engine, `savefig` draws once more in vain


def key(label: str, **look: Any) -> Line2D:
    """An entry of a legend that is drawn nowhere else; a `marker` stands there without a line."""
    return Line2D([], [], label=label, **({"linestyle": ""} if "marker" in look else {}) | look)


def legend_entries(axes: Iterable[Axes]) -> dict[str, Any]:
    """The handles of what was drawn with a label, by label."""
    return {
        label: handle
        for ax in axes
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }


def legend_above(
    figure: Figure, entries: Mapping[str, Any], most: int, width: float = np.inf, **looks: Any
) -> None:
    """The legend above all panels, in `most` columns or fewer, no wider than the page or `width`
    [in]."""
    for columns in range(min(most, len(entries)), 0, -1):
        legend = figure.legend(
            entries.values(), entries.keys(), loc="outside upper center", ncols=columns, **looks
        )
        if legend.get_window_extent().width / figure.dpi < min(width, figure.get_figwidth()):
            return
        if columns > 1:
            legend.remove()


def has_doubtful(table: pl.DataFrame) -> bool:
    return not table.filter(IS_DOUBTFUL).is_empty()


def open_entry(table: pl.DataFrame) -> dict[str, Line2D]:
    """For the legend, where a fit of the table is doubtful and its marker open."""
    marker = key("Open: doubtful", marker="o", color=GREY, mfc=WHITE, markersize=3.8, mew=0.8)
    return {str(marker.get_label()): marker} if has_doubtful(table) else {}


def draw_fits(
    ax: Axes,
    rows: pl.DataFrame,
    x: Any,
    y: Any,
    look: Look,
    share: float = 1.0,
    linewidths: float = 0.8,
    **looks: Any,
) -> None:
    """A marker of a share of the look's size per row, open where its fit is doubtful. It leads to
    its trial."""
    fill = [WHITE if doubtful else look.colour for doubtful in rows.select(IS_DOUBTFUL).to_series()]
    looks |= {"facecolors": fill, "edgecolors": look.colour, "linewidths": linewidths}
    drawn = ax.scatter(
        x, y, (share * look.size) ** 2, marker=look.marker, label=look.label, **looks
    )
    drawn.set_urls([place_in_report(trial) for trial in rows["trial"]])


def draw_estimates(
    ax: Axes, rows: pl.DataFrame, x: str, y: str, look: Look, share: float = 1.0, **looks: Any
) -> None:
    """The column `y` over `x` by `draw_fits`, on thin bars for the range over single amplitudes and
    thick ones for the 95 % interval of `y`."""
    for kind, width in (("_amplitudes", THIN), ("", THICK)):
        low, high = f"{y}{kind}_low", f"{y}{kind}_high"
        bars = rows.drop_nulls([low, high])
        ax.vlines(bars[x], bars[low], bars[high], color=look.colour, linewidth=width)
    draw_fits(ax, rows, rows[x], rows[y], look, share, **looks)


def place_in_report(trial: str) -> str:
    """A trial in the report of a run, as the figures' SVG files reach it."""
    return f"../report.html#trial={quote(trial, safe='')}"


def label_log_axis(axis: Axis, limits: tuple[float, float], most: int, scale: float = 1.0) -> None:
    """A logarithmic axis between `limits` with three to `most` ticks, written as numbers times
    `scale`: 1, 2 and 5 of each decade, else decades, else even ones."""
    low, high = limits
    even = MaxNLocator(nbins=most - 1, steps=[1, 2, 2.5, 5, 10])
    for locator in (LogLocator(subs=(1, 2, 5), numticks=99), LogLocator(numticks=most), even):
        ticks = [
            tick
            for tick in locator.tick_values(low, high)
            if low * (1 - 1e-9) <= tick <= high * (1 + 1e-9)
        ]
        if 3 <= len(ticks) <= most:
            break
    axis.set_ticks(ticks or [low], [f"{tick * scale:.4g}" for tick in ticks or [low]])
    axis.set_ticks([], minor=True)
    axis.set_view_interval(*limits, ignore=True)


def label_frequency_axis(ax: Axes, f: pl.Series, most: int) -> None:
    """Frequencies [Hz] on a logarithmic axis, of which 4 % are free on either side."""
    low, high = float(f.to_numpy().min()), float(f.to_numpy().max())
    factor = float(np.exp(0.04 * (np.log(high / low) if high > low else 1.0)))
    ax.set_xscale("log")
    label_log_axis(ax.xaxis, (low / factor, high * factor), most)


def label_phase_axis(ax: Axes) -> None:
    """Phases [deg] on the vertical axis: 0 stands on it, with a line, and ticks at usual fractions
    of a turn."""
    low, high = ax.get_ylim()
    margin = 0.04 * max(high, 0.0, high - low, -low)
    ax.set_ylim(min(low, -margin), max(high, margin))
    ax.axhline(0, color=BLACK, linewidth=0.4, zorder=0)
    span = float(np.ptp(ax.get_ylim()))
    steps = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45, 90)
    ax.yaxis.set_major_locator(
        MultipleLocator(next((step for step in steps if step >= span / 5), 180))
    )


def swarm_offsets(heights: Array, width: float, inches: float, reach: float) -> Array:
    """Sideways offsets (n,), none beyond `reach`, at which points of diameter `width` [in] at these
    heights (n,) [in] do not overlap; `inches` are the length of a unit of the axis. Each takes the
    free place nearest to the middle."""
    offsets = np.zeros(len(heights))
    order = np.argsort(heights, kind="stable")
    for rank, point in enumerate(order):
        below = order[:rank][np.abs(heights[order[:rank]] - heights[point]) < width]
        apart = np.sqrt(width**2 - (heights[below] - heights[point]) ** 2) * (1 + 1e-9)
        candidates = np.concatenate([[0.0], offsets[below] - apart, offsets[below] + apart])
        free = [c for c in candidates if (np.abs(c - offsets[below]) >= apart * (1 - 1e-9)).all()]
        side = 1 if rank % 2 else -1
        offsets[point] = min(free, key=lambda c: (round(abs(c) / width, 6), side * c))
    offsets /= inches
    return np.asarray(
        offsets * min(1.0, reach / max(float(np.max(np.abs(offsets), initial=0)), 1e-9))
    )


class NotebookFigure(Figure):
    """A matplotlib `Figure` that a notebook shows without `pyplot`, and saves in the style of the
    paper."""

    def _repr_png_(self, dpi: int = 150) -> bytes:
        page = BytesIO()
        self.savefig(page, format="png", dpi=dpi)
        return page.getvalue()

    def savefig(self, fname: Any, **kwargs: Any) -> None:
        with paper_style():
            super().savefig(fname, **kwargs)
