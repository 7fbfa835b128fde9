"""A page in place of a figure that is missing, which says why."""

import textwrap

import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures import names, style

LINE = 0.16  # height of a line of text [in]


@style.drawing(("figure", "trial", "file", "reason"))
def draw_not_drawn(table: pl.DataFrame) -> Figure:
    """Which figure is missing, and because of which trials and files."""
    lines: list[str] = []
    for trial, file, reason in table.select("trial", "file", "reason").iter_rows():
        cause = f"trial {trial}: {reason}" if trial else f"{file}: {reason}"
        lines += textwrap.wrap(cause, int(style.DOUBLE_COLUMN * style.LETTERS_PER_INCH))
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 0.6 + LINE * len(lines)))
    title = f"{names.figure_title(table['figure'][0])} is not drawn"
    figure.text(0.02, 0.95, title, color=style.BLACK, fontsize=11, va="top")
    below = 1 - 0.4 / figure.get_figheight()
    reasons = names.with_glyphs("\n".join(lines))
    figure.text(0.02, below, reasons, color=style.GREY, va="top", parse_math=False)
    return figure
