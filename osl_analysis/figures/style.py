"""The style of all figures: page size, lettering, colours and markers, panels, axes with their ticks, and swarms."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from itertools import zip_longest
from string import ascii_lowercase
from typing import Any, Literal, cast
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.textpath import TextPath
from matplotlib.ticker import MaxNLocator, MultipleLocator

from osl_analysis.trial import Array

SINGLE_COLUMN, DOUBLE_COLUMN = 3.5, 7.16  # widths [in] of one column and of the text block of an IEEE two-column page

BLACK, WHITE, GREY, MAGENTA = "#000000", "#FFFFFF", "#6E6E6E", "#C2127F"
ORANGE, PALE_ORANGE, PURPLE = "#E66100", "#F5C09A", "#5D3A9B"
"""Orange and purple differ for every common kind of colour vision, and in greyscale by lightness (58 and 32 of 100)."""

OPEN_MARKER = Line2D(
    [], [], linestyle="", marker="o", color=GREY, mfc=WHITE, markersize=3.8, mew=0.8, label="Open: doubtful"
)
"""For the legend of markers that are open where the fit is doubtful."""
SIZE_OF_TEXT = 8  # size [pt] of all lettering
THIN, THICK = 0.7, 1.8  # widths [pt] of bars over amplitudes, and of intervals
DOTTED, DASHED = (0, (1, 1.5)), (0, (3, 2))  # line styles of doubtful fits, and of means and what is desired

DRAWN_OPEN = pl.col("doubtful").fill_null("") != ""
"""Rows whose fit is doubtful: a number is beyond a limit of the configuration."""

PAPER: dict[Any, Any] = {
    # Times-like, and for the letters that it lacks another: both are shipped with matplotlib, the same on every machine
    "font.family": ["STIXGeneral", "DejaVu Sans"],
    "mathtext.fontset": "stix",
    **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize", "legend.fontsize"), SIZE_OF_TEXT),
    "text.hinting": "no_hinting",  # letters of a PNG keep the spacing that they have in the PDF
    "axes.linewidth": 0.6,
    "axes.labelpad": 2.5,
    "axes.titlepad": 4,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    **{f"{axis}tick.labelsize": SIZE_OF_TEXT for axis in "xy"},
    **{f"{axis}tick.{kind}.width": width for axis in "xy" for kind, width in (("major", 0.6), ("minor", 0.4))},
    **{f"{axis}tick.{kind}.size": size for axis in "xy" for kind, size in (("major", 2.5), ("minor", 1.5))},
    "hatch.linewidth": 0.5,
    "lines.linewidth": 1.0,
    "lines.markersize": 4,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.borderaxespad": 0.2,
    "legend.labelspacing": 0.3,
    "figure.constrained_layout.h_pad": 0.03,
    "figure.constrained_layout.w_pad": 0.03,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # whole TrueType outlines: IEEE refuses Type 3
    "svg.fonttype": "path",  # drawn letters: the SVG looks the same where the font is missing
    "svg.hashsalt": "osl-analysis",  # identifiers that do not change from run to run
}


Dash = Literal["-", ""] | tuple[float, tuple[float, ...]]  # A line style as matplotlib takes it


@dataclass(frozen=True)
class Drawing:
    """A figure: plotted numbers -> page, plotted numbers -> caption, and where they come from one table, `points`."""

    columns: Sequence[str]  # of the plotted numbers
    draw: Callable[[pl.DataFrame], Figure]
    caption: Callable[[pl.DataFrame], str] = lambda _: ""  # a paragraph of Markdown
    points: Callable[..., pl.DataFrame] = lambda table: table  # result tables -> plotted numbers
    needs: Sequence[str] = ()  # columns of the result table from which `points` are
    nothing: str = "no trial of the campaign has the numbers that this figure shows"  # why, without any number


@dataclass(frozen=True)
class Look:
    """Colour, marker, size of the marker [pt], name and line style of one condition, the same in every figure."""

    colour: str
    marker: str
    size: float
    label: str
    dash: Dash = "-"


LOOKS = {
    "desired": Look(BLACK, "", 0, "Desired"),
    "compensated": Look(ORANGE, "o", 3.8, "Compensated", (0, (4, 1.5))),
    "uncompensated": Look(PURPLE, "D", 3.4, "Uncompensated", (0, (5, 1.5, 1, 1.5))),
}


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw and save with the settings `PAPER` only, independent of the user's matplotlibrc; usable as a decorator."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(PAPER)
        yield


def panels(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    shares: Sequence[float] | None = None,
    names: Sequence[str] = (),
) -> tuple[Figure, list[Axes]]:
    """A figure of the given size [in] and its panels, row by row, lettered (a), (b) ... if there are several. `shares`
    are the relative widths of the columns; the panels of a row then share their vertical axis. `names` stand behind the
    letters; panels with names of their own share no axis."""
    figure = Figure(figsize=(width, height), layout="constrained")
    share = rows > 1 and not names
    grid = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=bool(shares), width_ratios=shares)
    axes = [ax for row in grid for ax in row]
    letters = [f"({letter})" for letter in ascii_lowercase[: len(axes)]] * (len(axes) > 1)
    titles = [f"{letter} {name}" for letter, name in zip_longest(letters, names, fillvalue="")]
    for ax, title in zip(axes, titles, strict=False):
        ax.set_title(title.strip(), loc="left")
    return figure, axes


@paper_style()
def lay_out(figure: Figure) -> None:
    """Place everything once, at the resolution of a PNG: every format then has the same places, and is drawn once."""
    figure.set_dpi(PAPER["savefig.dpi"])
    figure.draw_without_rendering()
    figure.set_layout_engine(None)  # with any engine, `savefig` draws once more in vain


def width_of(label: str) -> float:
    """Width [in] of a label at 8 points; a letter beyond ASCII counts as a wide one."""
    plain = "".join(sign if sign.isascii() else "M" for sign in label.replace("\\$", "S").replace("$", ""))
    font = FontProperties(family=PAPER["font.family"][:1])
    return float(TextPath((0, 0), plain, size=8, prop=font).get_extents().width) / 72 if plain.strip() else 0.0


def legend_columns(labels: Sequence[str], width: float, most: int) -> int:
    """Columns, `most` or fewer, of a legend that is no wider than the page of `width` [in]. The handle of an entry with
    its spaces takes 0.45 in."""
    widths = np.array([width_of(label) + 0.45 for label in labels])
    for columns in range(min(most, len(labels)), 1, -1):
        rows, longer = divmod(len(labels), columns)
        ends = np.cumsum([rows + (k < longer) for k in range(columns)])
        if sum(max(part) for part in np.split(widths, ends[:-1])) < width:
            return columns
    return 1


def legend_entries(axes: Iterable[Axes]) -> dict[str, Any]:
    """The handles of what was drawn with a label, by label."""
    return {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}


def draw_fits(ax: Axes, rows: pl.DataFrame, x: Any, y: Any, colour: str, size: float, **looks: Any) -> None:
    """A marker of this size [pt] per row at (x, y), open where its fit is doubtful. It leads to its trial."""
    fill = [WHITE if doubtful else colour for doubtful in rows.select(DRAWN_OPEN).to_series()]
    drawn = ax.scatter(x, y, size**2, facecolors=fill, edgecolors=colour, **looks)
    link_to_trials(drawn, rows["trial"])


def link_to_trials(drawn: Collection | Sequence[Text], trials: Iterable[str]) -> None:
    """In an SVG, each of the points, lines or names (n,) leads to its trial (n,) in the report."""
    urls = [place_in_report(trial) for trial in trials]
    if isinstance(drawn, Collection):
        drawn.set_urls(urls)
        return
    for text, url in zip(drawn, urls, strict=True):
        text.set_url(url)


def place_in_report(trial: str) -> str:
    """A trial in the report of a run, as the figures' SVG files reach it."""
    return f"../report.html#trial={quote(trial, safe='')}"


def draw_spread(ax: Axes, rows: pl.DataFrame, x: str, quantity: str, colour: str) -> None:
    """Thin bars for the range over single amplitudes, thick ones for the 95 % interval, where there are any."""
    for low, high, width in (
        (f"{quantity}_amplitudes_low", f"{quantity}_amplitudes_high", THIN),
        (f"{quantity}_low", f"{quantity}_high", THICK),
    ):
        complete = rows.drop_nulls([low, high])
        ax.vlines(complete[x], complete[low], complete[high], color=colour, linewidth=width)


def spread_entries(panels: Mapping[Axes, str], table: pl.DataFrame) -> list[Line2D]:
    """Legend of the bars of `draw_spread`, of those that are long enough to be seen beside the markers. `panels` are
    the axes with the quantity that each shows."""

    def bar(width: float, label: str) -> Line2D:
        return Line2D([], [], color=BLACK, marker="|", markersize=8, mew=width, linestyle="", label=label)

    handles = []
    if any(table[f"{quantity}_amplitudes_low"].count() for quantity in panels.values()):
        handles.append(bar(THIN, "Range over amplitudes"))
    if not any(table[f"{quantity}_low"].count() for quantity in panels.values()):
        return handles

    def longest_bar(ax: Axes, quantity: str) -> float:
        figure = ax.figure.figure
        figure.draw_without_rendering()
        ends = (table[f"{quantity}_{end}"].drop_nulls() for end in ("low", "high"))
        low, high = (ax.transData.transform(np.column_stack([np.zeros(len(y)), y]))[:, 1] for y in ends)
        return float(np.max(np.abs(high - low), initial=0)) * 72 / figure.dpi

    smallest = min(look.size for look in LOOKS.values() if look.marker)
    if any(longest_bar(ax, quantity) > smallest for ax, quantity in panels.items()):
        handles.append(bar(THICK, "95 % interval"))
    return handles


def log_ticks(low: float, high: float, most: int) -> list[float]:
    """Round values from `low` to `high` > 0 for a logarithmic axis, `most` or fewer: of the fewest steps in a decade
    that give five, else of those that give most. In a span in which none give three, they are evenly spaced."""
    within_decade = ((1,), (1, 2, 5), (1, 2, 3, 5), (1, 2, 3, 4, 5, 6, 8), (1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9))
    decades = 10.0 ** np.arange(np.floor(np.log10(low)) - 1, np.ceil(np.log10(high)) + 1)
    slack = 1e-9
    candidates = ([decade * step for decade in decades for step in steps] for steps in within_decade)
    found = [[tick for tick in ticks if low * (1 - slack) <= tick <= high * (1 + slack)] for ticks in candidates]
    wide = [float(decade) for decade in decades if low <= decade <= high]
    fitting = [ticks for ticks in found if 3 <= len(ticks) <= most]
    if fitting:
        return [float(tick) for tick in next((f for f in fitting if len(f) >= 5), max(fitting, key=len))]
    if len(wide) > most:
        return wide[:: -(-len(wide) // most)]
    even = MaxNLocator(nbins=max(most - 1, 2), steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    return [float(tick) for tick in even if low <= tick <= high] or [low]


def label_log_axis(axis: Axis, limits: tuple[float, float], most: int, scale: float = 1.0) -> None:
    """A logarithmic axis between `limits` with `log_ticks`, written as numbers times `scale`."""
    ticks = log_ticks(*limits, most)
    axis.set_ticks(ticks, [f"{tick * scale:.4g}" for tick in ticks])
    axis.set_ticks([], minor=True)
    axis.set_view_interval(*limits, ignore=True)


def with_margins(low: float, high: float, share: float = 0.04) -> tuple[float, float]:
    """Limits of a logarithmic axis with a share of it free on either side."""
    span = np.log(high / low) if high > low else 1.0
    return low * float(np.exp(-share * span)), high * float(np.exp(share * span))


def label_phase_axis(ax: Axes) -> None:
    """Phases [deg] on the vertical axis: 0 stands on it, with a line, and ticks at usual fractions of a turn."""
    low, high = ax.get_ylim()
    margin = 0.04 * max(high, 0.0, high - low, -low)
    ax.set_ylim(min(low, -margin), max(high, margin))
    ax.axhline(0, color=BLACK, linewidth=0.4, zorder=0)
    span = float(np.ptp(ax.get_ylim()))
    steps = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45, 90)
    ax.yaxis.set_major_locator(MultipleLocator(next((step for step in steps if step >= span / 5), 180)))


def moved_apart(places: Sequence[float], gap: float, limits: tuple[float, float] = (-np.inf, np.inf)) -> Array:
    """The places (n,), moved as little as possible (least squares) so that none is closer than `gap` to another. Their
    order stays: it is a monotone regression of `place - rank * gap`, by pooling neighbours that violate it. They lie
    within the limits if there is room for them."""
    values = np.asarray(places, dtype=float)
    order = np.argsort(values, kind="stable")
    pools: list[tuple[float, int]] = []
    for rank, value in enumerate(values[order]):
        mean, count = float(value - rank * gap), 1
        while pools and pools[-1][0] > mean:
            before, n = pools.pop()
            mean, count = (before * n + mean * count) / (n + count), n + count
        pools.append((mean, count))
    level = np.repeat([mean for mean, _ in pools], [count for _, count in pools])
    steps, moved = gap * np.arange(len(values)), np.empty(len(values))
    moved[order] = np.maximum(np.minimum(level + steps, limits[1] - steps[::-1]), limits[0] + steps)
    return moved


def name_ends(
    ax: Axes, ends: Sequence[tuple[float, float]], names: Sequence[str], colours: Sequence[str]
) -> list[Text]:
    """Names (n,) beside the right edge of a panel, each with a hair line to the end (x, y) of its curve. Names that
    would overlap are moved apart. The limits of the panel are kept."""
    figure = ax.figure.figure
    figure.draw_without_rendering()
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    height = 1.1 * SIZE_OF_TEXT / 72 * figure.dpi / ax.get_window_extent().height * (high - low)
    places = moved_apart([y for _, y in ends], height, (low, high))
    written: list[Text] = []
    for end, name, colour, place in zip(ends, names, colours, places, strict=True):
        hair = {"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkA": 0, "shrinkB": 0, "relpos": (0, 0.5)}
        beside = (right + 0.03 * (right - left), float(place))
        text = ax.annotate(name, end, beside, color=colour, va="center", arrowprops=hair, annotation_clip=False)
        written.append(text)
    ax.set(xlim=(left, right), ylim=(low, high))
    return written


def swarm_positions(values: Array, width: float) -> Array:
    """Sideways offsets (n,) at which points of diameter `width` at heights `values` (n,) do not overlap; in one unit.
    From the lowest value up, each point takes the free place that is nearest to the middle. Of two equally near places
    it takes the right and the left one in turn."""
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


def squeezed(offsets: Array, reach: float) -> Array:
    """The offsets, closer together so that none is farther than `reach` from the middle."""
    return np.asarray(offsets * min(1.0, reach / max(float(np.max(np.abs(offsets), initial=0)), 1e-9)))


class NotebookFigure(Figure):
    """A matplotlib `Figure` that a notebook shows without `pyplot`, and saves in the style of the paper."""

    def _repr_png_(self) -> bytes:
        page = BytesIO()
        self.savefig(page, format="png", dpi=150)
        return page.getvalue()

    def savefig(self, fname: Any, **kwargs: Any) -> None:
        with paper_style():
            super().savefig(fname, **kwargs)


def on_screen(figure: Figure) -> NotebookFigure:
    figure.__class__ = NotebookFigure
    return cast(NotebookFigure, figure)
