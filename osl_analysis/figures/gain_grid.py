"""Damping gains over a grid of desired impedances."""

import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures.style import BLACK, SINGLE_COLUMN, panels, paper_style

COLUMNS = ("K_d", "B_d", "B_1_joint")
DASHES = ("-", "--", ":", "-.")


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """B_1 n_T^2 over K_d, a line per B_d."""
    figure, (ax,) = panels(SINGLE_COLUMN, 2.4)
    for i, (B_d, rows) in enumerate(table.group_by("B_d", maintain_order=True)):
        ax.plot(rows["K_d"], rows["B_1_joint"], DASHES[i % len(DASHES)], color=BLACK, marker=".", label=f"{B_d[0]:g}")
    ax.set_xlabel("Desired stiffness $K_d$ (N·m/rad)")
    ax.set_ylabel("Gain $B_1 n_T^2$ (N·m·s/rad)")
    ax.legend(title="$B_d$ (N·m·s/rad)", ncols=2)
    return figure
