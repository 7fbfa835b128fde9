# SPDX-License-Identifier: Apache-2.0
"""The style of all figures: size of a page, colours, looks of controllers, panels and settings, and
words: labels of quantities, titles by condition, and names of a campaign as matplotlib draws
them."""

import textwrap
import warnings
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from typing import Any, Literal

import matplotlib as mpl
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

SINGLE_COLUMN = 3.5  # width of a column of an IEEE two-column page [in]
DOUBLE_COLUMN = 7.16  # width of its text block [in]
TALLEST = 9.4  # figure that fits this block [in]
NARROW = 0.55  # height of a narrow panel, of that of another

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
    narrow: Collection[int] = (),
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
    narrow : collection of int
        Rows of panels that are less high, and belong to those above them: they have no letter.

    Returns
    -------
    PaperFigure
    list of Axes
        Row by row. Several panels are lettered (a), (b) ...
    """
    figure = PaperFigure(figsize=(width, height), layout="constrained")
    heights = [NARROW if row in narrow else 1.0 for row in range(rows)]
    grid = figure.subplots(
        rows, columns, squeeze=False, height_ratios=heights, sharex="col" if share_x else False
    )
    axes = list(grid.flat)
    lettered = [ax for number, ax in enumerate(axes) if number // columns not in narrow]
    for number, ax in enumerate(lettered):
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
LINEAR_MODEL = "Linear model"  # drivetrain with a controller's gains, without friction (Eq. 9)

LOOKS = {  # of the controllers of the draft
    "compensated": Look(ORANGE, "o", 3.8, "Compensated"),
    "uncompensated": Look(PURPLE, "D", 3.4, "Uncompensated"),
}
# of other controllers by their numbers: with these two and black, colours are 20 or more apart
# (CIE 1976) for readers without long- or medium-wavelength cones
COLOURS = ("#3F8FBF", "#6B3A0A", "#2F5555", "#B98860", "#2B46F0")
MARKERS = ("s", "^", "v", "P", "X", "p", "h")
NO_CONTROLLER = Look("#757575", ">", 3.6, "Controller not stated")


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
    for symbol, value, unit in (("$K_d$", K_d, " N·m/rad"), ("$B_d$", B_d, " N·m·s/rad")):
        if value is not None:
            parts.append(f"{symbol} = {value:g}{unit}")
    if controller is not None:
        parts.append(drawn_name(controller))
    return parts


def by_place(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint and side, whose results never share a panel, with a title such as
    `Knee, left`; it is empty where there is only one."""
    parts = table.partition_by("joint", "side")
    if len(parts) == 1:
        return [("", table)]
    titled = []
    for part in parts:
        joint, side = part.select("joint", "side").row(0)
        name = drawn_name(joint or "")
        named = f"{name[:1].upper()}{name[1:]}"
        titled.append((", ".join(filter(None, (named, side))), part))
    return titled


def by_controller(table: pl.DataFrame) -> list[tuple[Look, pl.DataFrame]]:
    """The rows of each controller with its look: those of the draft, those that state none, and the
    others by `look`, their number."""
    ordered = table.sort("look", "controller", nulls_last=[False, True], maintain_order=True)
    parts = []
    for rows in ordered.partition_by("controller"):
        name, number = rows.select("controller", "look").row(0)
        look = LOOKS.get(name, NO_CONTROLLER)
        if number is not None:
            look = Look(
                COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)], NO_CONTROLLER.size,
                drawn_name(name),
            )  # fmt: skip
        parts.append((look, rows))
    return parts


def has_values(table: pl.DataFrame, column: str) -> bool:
    """Whether the table has this column, and a row a value in it."""
    return column in table.columns and table[column].count() > 0
