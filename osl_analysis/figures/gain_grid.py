"""Gains over desired impedances, which `osl-analysis gains` draws."""

import matplotlib as mpl
import numpy as np
import polars as pl

from osl_analysis.figures import names, style

DARK_ENOUGH = 0.85  # share of a colour map from its dark end on, which stands out from white


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """B_1 n_T^2 over K_d, a line per B_d."""
    figure, (ax,) = style.panels(style.SINGLE_COLUMN, 2.7)
    of_damping = table.partition_by("B_d", maintain_order=True)
    shades = mpl.colormaps["viridis"](np.linspace(0, DARK_ENOUGH, len(of_damping)))
    for rows, shade in zip(of_damping, shades, strict=True):
        label = f"{rows['B_d'][0]:g}"
        ax.plot(rows["K_d"], rows["B_1_joint"], color=shade, marker="o", markersize=2, label=label)
    ax.set_xlabel(names.AXIS_LABELS["K_d"])
    ax.set_ylabel("Gain $B_1 n_T^2$ (N·m·s/rad)")
    title = names.AXIS_LABELS["B_d"]
    figure.legend(title=title, loc="outside upper center", ncols=5, columnspacing=1.2)
    return figure
