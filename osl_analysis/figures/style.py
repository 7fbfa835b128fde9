"""The style of all figures: size of a page, colours, looks of controllers, panels and settings."""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from typing import Any, Literal

import matplotlib as mpl
import polars as pl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Figure

SINGLE_COLUMN = 3.5  # width of a column of an IEEE two-column page [in]
DOUBLE_COLUMN = 7.16  # width of its text block [in]
TALLEST = 9.4  # figure that fits this block [in]

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
BLUE = "#3F8FBF"  # the third, if two are not enough
BROWN = "#6B3A0A"  # the fourth

LETTERS_PER_INCH = 17  # of the text on an axis
BAND_ALPHA = 0.25  # opacity of a band around a curve
HAIRLINE = 0.4  # width of an axis at 0 [pt]
THIN = 0.7  # of the bar of a range [pt]
THICK = 1.8  # of the bar of an interval [pt]
DOTTED = (0, (1, 1.5))  # line style of doubtful fits
DASHED = (0, (3, 2))  # of means and of what is desired

PAPER = mpl.rc_params_from_file(Path(__file__).with_suffix(".mplstyle"), use_default_template=False)
Dash = Literal["-", ""] | tuple[float, tuple[float, ...]]  # a line style as matplotlib takes it


@dataclass(frozen=True)
class Drawing:
    """A figure: which numbers it needs, how they are drawn, and what its caption says of them."""

    draw: Callable[[pl.DataFrame], Figure]  # of the plotted numbers
    columns: Sequence[str]  # of the plotted numbers
    # result tables -> plotted numbers; by default one table unchanged
    points: Callable[..., pl.DataFrame] = pl.DataFrame.clone
    needs: Sequence[str] = ()  # columns of the result table from which `points` are
    caption: Callable[[pl.DataFrame], str] = lambda _: ""  # plotted numbers -> Markdown
    # why the figure is not drawn if there is no number
    nothing: str = "no trial of the campaign has the numbers that this figure shows"


def drawing(*columns_and_points: Any, **facts: Any) -> Callable[..., Drawing]:
    """Make a function that draws plotted numbers a `Drawing` in the style of the paper; the
    arguments are its other fields."""
    return lambda draw: Drawing(paper_style()(draw), *columns_and_points, **facts)


@dataclass(frozen=True)
class Look:
    """How one controller is drawn in every figure."""

    colour: str
    marker: str
    size: float  # of the marker [pt]
    label: str  # name in the legend
    dash: Dash = "-"
    edge: float = 0.8  # width of the marker's edge [pt]

    def smaller(self, share: float) -> "Look":
        """This look with markers of a share of their size."""
        return replace(self, size=share * self.size)


LOOKS = {  # of the controllers of the draft
    "compensated": Look(ORANGE, "o", 3.8, "Compensated", (0, (4, 1.5))),
    "uncompensated": Look(PURPLE, "D", 3.4, "Uncompensated", (0, (5, 1.5, 1, 1.5))),
}


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw and save with the settings `PAPER` only, whatever the user's matplotlibrc; usable as a
    decorator."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(PAPER)
        yield


@contextmanager
def without_collecting() -> Iterator[None]:
    """Do not look for objects that nothing refers to any more; usable as a decorator.

    A figure is 100,000 small objects that live until it is saved. To look through them again and
    again takes an eighth of the time and finds nothing.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def panels(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    *,
    titles: Sequence[str] = (),
    share_x: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Make a figure and its panels.

    Parameters
    ----------
    width, height : float
        Of the figure [in].
    rows, columns : int
    titles : sequence of str
        Panel by panel what stands behind its letter; fewer than panels: nothing.
    share_x : bool
        Whether the panels of a column share the horizontal axis. Only the lowest then has tick
        labels.

    Returns
    -------
    Figure
    list of Axes
        Row by row. Several panels are lettered (a), (b) ...
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex="col" if share_x else False)
    axes = list(grid.flat)
    for number, ax in enumerate(axes):
        letter = f"({ascii_lowercase[number]})" if len(axes) > 1 else ""
        title = titles[number] if number < len(titles) else ""
        # `y` is given so that matplotlib need not look for labels above the panel
        ax.set_title(f"{letter} {title}".strip(), loc="left", y=1)
    return figure, axes


@paper_style()
def lay_out(figure: Figure) -> None:
    """Place everything once, at the resolution of a PNG: every format then has the same places, and
    is drawn once."""
    figure.set_dpi(PAPER["savefig.dpi"])
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    every_axis = [axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)]
    for axis in every_axis:
        if not axis.get_label_text():
            fix_label(axis)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
    figure.set_layout_engine(None)  # with any engine, `savefig` draws once more in vain
    for axis in every_axis:
        if axis.get_label_text():
            axis.get_tightbbox(renderer)  # this places the label
            fix_label(axis)


def fix_label(axis: Axis) -> None:
    """Keep the label of an axis where it is: whenever it is measured or drawn, matplotlib measures
    all numbers at the axis in order to place the label beside them, even one without a text."""
    label = axis.get_label()
    place = label.get_transform().transform(label.get_position())  # [pixels]
    axis.set_label_coords(*axis.axes.transAxes.inverted().transform(place))


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
