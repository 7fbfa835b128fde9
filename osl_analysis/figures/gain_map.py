"""Number of minima of Eq. 14 and the gain, over the plane of desired impedances."""

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures.style import BLACK, GREY, SINGLE_COLUMN, panels, paper_style

COLUMNS = ("K_d", "B_d", "minima", "B_1_joint")
LEVELS = (1, 3, 10, 30, 100, 300, 1000)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A dot per request with exactly one minimum, a cross per request with none; contours of B_1 n_T^2.

    `table` holds a full grid, `minima` the number that `certify` proved.
    """
    figure, (ax,) = panels(SINGLE_COLUMN, 2.9)
    K_d, B_d = (np.unique(table[name].to_numpy()) for name in ("K_d", "B_d"))
    gains = table.sort("K_d", "B_d")["B_1_joint"].to_numpy().reshape(len(K_d), len(B_d)).T
    one, none = table.filter(pl.col("minima") == 1), table.filter(pl.col("minima") == 0)
    ax.plot(one["K_d"], one["B_d"], ".", color=GREY, markersize=1.5, label="one minimum")
    ax.plot(none["K_d"], none["B_d"], "x", color=BLACK, markersize=4, mew=1, label="none: the joint alone damps more")
    contours = ax.contour(K_d, B_d, gains, levels=LEVELS, colors=BLACK, linewidths=0.7)
    ax.clabel(contours, fmt=lambda level: f"{level:g}", fontsize=7)
    ax.set_ylim(-0.04 * B_d.max(), 1.02 * B_d.max())
    ax.set_xlabel("Desired stiffness $K_d$ (N·m/rad)")
    ax.set_ylabel("Desired damping $B_d$ (N·m·s/rad)")
    figure.legend(loc="outside upper center", ncols=2)
    return figure
