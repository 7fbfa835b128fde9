"""Damping gains over a grid of desired impedances."""

import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures.style import BLACK, GREY, SINGLE_COLUMN, panels, paper_style

COLUMNS = ("K_d", "B_d", "B_1_joint")
DASHES = ("-", "--", ":", "-.")
MARKERS = ("o", "s", "^", "D", "v")
SHADES = (BLACK, GREY, "#A8A8A8")
"""A line style, a marker and a shade each: 60 lines differ in one of them."""


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """B_1 n_T^2 over K_d, a line per B_d."""
    figure, (ax,) = panels(SINGLE_COLUMN, 2.7)
    for i, (B_d, rows) in enumerate(table.group_by("B_d", maintain_order=True)):
        marker, colour = MARKERS[i % len(MARKERS)], SHADES[i // len(DASHES) % len(SHADES)]
        ax.plot(
            rows["K_d"], rows["B_1_joint"], DASHES[i % len(DASHES)], color=colour, marker=marker, markersize=2.8,
            linewidth=0.8, label=f"{B_d[0]:g}",
        )  # fmt: skip
    ax.set_xlabel("Desired stiffness $K_d$ (N·m/rad)")
    ax.set_ylabel("Gain $B_1 n_T^2$ (N·m·s/rad)")
    figure.legend(title="Desired damping $B_d$ (N·m·s/rad)", loc="outside upper center", ncols=5, columnspacing=1.2)
    return figure
