"""The small line below every figure of a campaign: whether its data are simulated, what it was made of, and which
trials it lacks.
"""

import textwrap
from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from osl_analysis.figures.names import with_glyphs
from osl_analysis.figures.style import GREY, paper_style

SMALL, LINE, LETTERS_PER_INCH = 5.5, 0.1, 28
"""Size [pt], height of a line [in] and letters per inch."""
EDGE = 0.02
"""Distance [in] of the line from the figure above it and from the edge of the page."""
MOST_NAMED = 4
"""Missing trials that are named; the caption names more, the table `excluded.csv` all of them."""


def said_of_missing(trials: Sequence[str]) -> str:
    """Which trials a figure lacks; empty if none."""
    more = f" and {len(trials) - MOST_NAMED} more" if len(trials) > MOST_NAMED else ""
    return f"Without {len(trials)} refused: {', '.join(trials[:MOST_NAMED])}{more}" if trials else ""


@paper_style()
def write_footer(figure: Figure, text: str) -> Bbox:
    """A small line below a drawn figure; the part of the plane [in] to be saved, which is as much taller.

    The figure itself keeps its size and its layout: the line stands below its lower edge.
    """
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(text, int(width * LETTERS_PER_INCH))
    words = figure.text(
        0.5,
        -EDGE / height,
        with_glyphs("\n".join(lines)),
        fontsize=SMALL,
        color=GREY,
        ha="center",
        va="top",
        linespacing=1.1,
        parse_math=False,
    )
    words.set_in_layout(False)
    return Bbox.from_extents(0.0, -(LINE * len(lines) + 2 * EDGE), width, height)
