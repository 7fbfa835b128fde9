"""Number of minima of Eq. 14 and the gain, over the plane of desired impedances."""

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures.style import BLACK, MAGENTA, SINGLE_COLUMN, SIZE_OF_TEXT, panels, paper_style

COLUMNS = ("K_d", "B_d", "minima", "B_1_joint")
LEVELS = (1, 3, 10, 30, 100, 300, 1000)


PALE = "#C8C8C8"
"""Grey of the requests with one minimum, behind the contours."""


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A pale dot per request with exactly one minimum, a cross per request with none; contours of B_1 n_T^2.

    `table` holds a full grid, `minima` the number that `certify` proved.
    """
    figure, (ax,) = panels(SINGLE_COLUMN, 3.1)
    K_d, B_d = (np.unique(table[name].to_numpy()) for name in ("K_d", "B_d"))
    gains = table.sort("K_d", "B_d")["B_1_joint"].to_numpy().reshape(len(K_d), len(B_d)).T
    one, none = table.filter(pl.col("minima") == 1), table.filter(pl.col("minima") == 0)
    ax.plot(one["K_d"], one["B_d"], ".", color=PALE, markersize=1.8, mew=0)
    ax.plot([], [], "o", color=PALE, markersize=3, mew=0, label="One minimum")
    ax.plot(none["K_d"], none["B_d"], "x", color=MAGENTA, markersize=4, mew=1, clip_on=False, zorder=3, label="None")
    contours = ax.contour(K_d, B_d, gains, levels=LEVELS, colors=BLACK, linewidths=0.7)
    for text in ax.clabel(contours, fmt=lambda level: f"{level:g}", fontsize=SIZE_OF_TEXT):
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.5})
    ax.plot([], [], color=BLACK, linewidth=0.7, label="Gain $B_1 n_T^2$ (N·m·s/rad)")
    ax.set_xlim(0, float(K_d.max()))
    ax.set_ylim(0, 1.02 * float(B_d.max()))
    ax.set_xlabel("Desired stiffness $K_d$ (N·m/rad)")
    ax.set_ylabel("Desired damping $B_d$ (N·m·s/rad)")
    figure.legend(loc="outside upper center", ncols=3, columnspacing=1.0, handletextpad=0.4)
    return figure
