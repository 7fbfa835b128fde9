"""Gains over desired impedances, which `osl-analysis gains` draws."""

from itertools import product

import polars as pl

from osl_analysis.figures import names, style

# a shade, a line style and a marker each: 60 lines differ in one of them
LINES = tuple(product((style.BLACK, style.GREY, "#A8A8A8"), ("-", "--", ":", "-.")))
MARKERS = ("o", "s", "^", "D", "v")


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """B_1 n_T^2 over K_d, a line per B_d."""
    figure, (ax,) = style.panels(style.SINGLE_COLUMN, 2.7)
    for number, rows in enumerate(table.partition_by("B_d", maintain_order=True)):
        shade, dash = LINES[number % len(LINES)]
        ax.plot(
            rows["K_d"], rows["B_1_joint"], color=shade, linestyle=dash,
            marker=MARKERS[number % len(MARKERS)], markersize=2.8, linewidth=0.8,
            label=f"{rows['B_d'][0]:g}",
        )  # fmt: skip
    ax.set_xlabel(names.AXIS_LABELS["K_d"])
    ax.set_ylabel("Gain $B_1 n_T^2$ (N·m·s/rad)")
    title = names.AXIS_LABELS["B_d"]
    figure.legend(title=title, loc="outside upper center", ncols=5, columnspacing=1.2)
    return figure
