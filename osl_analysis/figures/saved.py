"""A drawn figure as the content of a PDF, SVG or PNG file, with a small line below it."""

import textwrap
from io import BytesIO
from typing import Any

from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from osl_analysis.figures import names
from osl_analysis.figures.style import GREY, paper_style

# Formats, each with the entries of its metadata for what the data are, and for the time: equal
# numbers give equal files
METADATA = {
    ".pdf": ("Subject", "CreationDate"),
    ".svg": ("Description", "Date"),
    ".png": ("Description", "Date"),
}
PNG_EFFORT = 3  # of 9; lines hardly shrink by more


def saved_figure(figure: Figure, suffix: str, origin: str, page_box: Bbox | None) -> bytes:
    """Write a figure in a format of `METADATA`.

    Parameters
    ----------
    figure : Figure
    suffix : str
        Of the format, as `.pdf`.
    origin : str
        What the data are, for the metadata of the file; empty: nothing.
    page_box : Bbox or None
        The part of the plane that is saved [in]; None: the figure.
    """
    subject, date = METADATA[suffix]
    metadata: dict[str, str | None] = {}
    options: dict[str, Any] = {}
    if suffix == ".png":
        options["pil_kwargs"] = {"compress_level": PNG_EFFORT}
    else:
        metadata[date] = None  # the same numbers give the same file
    if origin:
        metadata[subject] = origin
    page = BytesIO()  # a writer that the disk interrupts would leave its file open
    with paper_style():
        figure.savefig(
            page, format=suffix.removeprefix("."), metadata=metadata, bbox_inches=page_box,
            **options,
        )  # fmt: skip
    return page.getvalue()


FOOTER_SIZE = 5.5  # of its letters [pt]
FOOTER_LINE = 0.1  # height of a line [in]
FOOTER_EDGE = 0.02  # free above and below [in]
FOOTER_LETTERS = 28  # per inch


@paper_style()
def write_footer(figure: Figure, text: str) -> Bbox:
    """Write a small line below a drawn figure, whose size and layout stay.

    Returns
    -------
    Bbox
        The part of the plane that is to be saved, taller than the figure [in].
    """
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(text, int(width * FOOTER_LETTERS))
    words = figure.text(
        0.5,
        -FOOTER_EDGE / height,
        names.with_glyphs("\n".join(lines)),
        fontsize=FOOTER_SIZE,
        color=GREY,
        ha="center",
        va="top",
        linespacing=1.1,
        parse_math=False,
    )
    words.set_in_layout(False)
    return Bbox.from_extents(0.0, -(FOOTER_LINE * len(lines) + 2 * FOOTER_EDGE), width, height)
