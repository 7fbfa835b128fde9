"""The page in place of a figure that cannot be drawn."""

import textwrap

import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures.names import figure_title, with_glyphs
from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, GREY, paper_style

COLUMNS = ("figure", "trial", "file", "reason")
CHARACTERS_PER_INCH = 17
"""Of the text below a figure."""


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """Which figure is missing, and because of which trials and files: a row per cause."""
    causes = [f"trial {row['trial']}: {row['reason']}" if row["trial"] else f"{row['file']}: {row['reason']}"
              for row in table.iter_rows(named=True)]  # fmt: skip
    lines = [line for cause in causes for line in textwrap.wrap(cause, int(DOUBLE_COLUMN * CHARACTERS_PER_INCH))]
    figure = Figure(figsize=(DOUBLE_COLUMN, 0.6 + 0.16 * len(lines)))
    figure.text(0.02, 0.95, f"{figure_title(table['figure'][0])} is not drawn", color=BLACK, fontsize=11, va="top")
    below = 1 - 0.4 / figure.get_figheight()
    figure.text(0.02, below, with_glyphs("\n".join(lines)), color=GREY, va="top", parse_math=False)
    return figure
