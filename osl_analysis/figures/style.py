# SPDX-License-Identifier: Apache-2.0
"""The style of all figures: width of a page, colours, looks of controllers, panels and settings,
and words: labels of quantities, titles by condition, and names of a campaign as matplotlib draws
them. All other sizes and widths stand in `style.mplstyle`."""

import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import matplotlib.style as mpl_style
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

SINGLE_COLUMN = 3.5  # width of a column of an IEEE two-column page [in]
DOUBLE_COLUMN = 7.16  # width of its text block [in]

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

    def _repr_png_(self, dpi: int = 150) -> bytes:
        page = BytesIO()
        self.savefig(page, format="png", dpi=dpi)
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
MARKERS = ("o", "D", "s", "^", "v", "P", "X", "p")
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
            look = Look(colour, MARKERS[number % len(MARKERS)], drawn_name(name))
        parts.append((look, rows))
    return parts


def has_values(table: pl.DataFrame, column: str) -> bool:
    """Whether the table has this column, and a row a value in it."""
    return column in table.columns and table[column].count() > 0
