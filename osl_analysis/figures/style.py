"""What all figures share: page, lettering, colours and markers, and panels ready to draw in."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

SINGLE_COLUMN, DOUBLE_COLUMN = 3.5, 7.16
"""Widths [in] of one column and of the text block of an IEEE two-column page."""

BLACK, GREY, MAGENTA = "#000000", "#6E6E6E", "#C2127F"
ORANGE, PALE_ORANGE, PURPLE = "#E66100", "#F5C09A", "#5D3A9B"
"""Told apart by every common kind of colour vision, and in greyscale by lightness (58 against 32 of 100)."""

NORMAL_95 = 1.96
"""Half width of a 95 % interval in standard errors, for estimates from thousands of samples."""

PAPER: dict[Any, Any] = {
    "font.family": "STIXGeneral",  # Times-like, and shipped with matplotlib: the same on every machine
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "text.hinting": "no_hinting",  # letters of a PNG keep the spacing that they have in the PDF
    "axes.linewidth": 0.6,
    "axes.labelpad": 2.5,
    "axes.titlepad": 4,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
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


@dataclass(frozen=True)
class Look:
    """Colour, marker, size of the marker [pt] and name of one condition, the same in every figure."""

    colour: str
    marker: str
    size: float
    label: str


LOOKS = {
    "desired": Look(BLACK, "", 0, "Desired"),
    "compensated": Look(ORANGE, "o", 3.8, "Compensated"),
    "uncompensated": Look(PURPLE, "D", 3.4, "Uncompensated"),
}


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw and save with `PAPER` alone, whatever the user's matplotlibrc says; usable as a decorator."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(PAPER)
        yield


def panels(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """A figure of the given size [in] and its panels, row by row, lettered (a), (b) ... if there are several."""
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=rows > 1)
    axes = [ax for row in grid for ax in row]
    if len(axes) > 1:
        for ax, letter in zip(axes, "abcdefgh", strict=False):
            ax.set_title(f"({letter})", loc="left")
    return figure, axes
