"""The style of all figures: size of a page, colours, looks of controllers, panels and settings."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from typing import Any, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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

LETTERS_PER_INCH = 17  # of the text on an axis
BAND_ALPHA = 0.25  # opacity of a band around a curve
HAIRLINE = 0.4  # width of an axis at 0 [pt]
THIN = 0.7  # of the bar of a range [pt]
THICK = 1.8  # of the bar of an interval [pt]

Dash = Literal["-", ""] | tuple[float, tuple[float, ...]]  # a line style as matplotlib takes it
DOTTED: Dash = (0, (1, 1.5))  # of doubtful fits
DASHED: Dash = (0, (3, 2))  # of means and of what is desired

PAPER = mpl.rc_params_from_file(Path(__file__).with_suffix(".mplstyle"), use_default_template=False)


@dataclass(frozen=True)
class Look:
    """How the results of one controller are drawn in every figure."""

    colour: str
    marker: str
    size: float  # of the marker [pt]
    label: str  # name in the legend
    dash: Dash = "-"
    edge: float = 0.8  # width of the marker's edge [pt]


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw and save with the settings `PAPER` only, whatever the user's matplotlibrc; usable as a
    decorator. A letter that no font has is drawn as a box, without a warning."""
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        mpl.rcdefaults()
        mpl.rcParams.update(PAPER)
        yield


class PaperFigure(Figure):
    """A matplotlib `Figure` in the style of the paper, which a notebook shows without `pyplot`."""

    def savefig(self, fname: Any, **kwargs: Any) -> None:
        with paper_style():
            super().savefig(fname, **kwargs)

    def _repr_png_(self, dpi: int = 150) -> bytes:
        page = BytesIO()
        self.savefig(page, format="png", dpi=dpi)
        return page.getvalue()


def panels(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    *,
    titles: Sequence[str] = (),
    share_x: bool = False,
) -> tuple[PaperFigure, list[Axes]]:
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
    PaperFigure
    list of Axes
        Row by row. Several panels are lettered (a), (b) ...
    """
    figure = PaperFigure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex="col" if share_x else False)
    axes = list(grid.flat)
    for number, ax in enumerate(axes):
        letter = f"({ascii_lowercase[number % 26]})" if len(axes) > 1 else ""
        title = titles[number] if number < len(titles) else ""
        ax.set_title(f"{letter} {title}".strip(), loc="left")
    return figure, axes
