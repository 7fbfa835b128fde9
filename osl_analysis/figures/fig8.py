"""Fig. 8: desired impedance over the gait cycle and the control gains that render it."""

import polars as pl
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from osl_analysis.figures.names import drawn_name
from osl_analysis.figures.style import BLACK, ORANGE, SINGLE_COLUMN, panels, paper_style

GAINS = ("K_1_joint", "B_1_joint")
TABLE_COLUMNS = COLUMNS = ("phase", "trajectory", "K_d", "B_d", *GAINS)
NO_GAINS = "No gains: the configuration names no parameter file"


def points(gains: pl.DataFrame) -> pl.DataFrame:
    """Desired impedance, and gains times the square of the belt's ratio, over `phase` (0 to 1) of the gait cycle."""
    return gains.select(COLUMNS)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: desired black, gain dashed orange. What the file of the trajectory says of itself, as
    synthetic, stands behind `Desired`. Without gains a line below says why."""
    figure, (stiffness, damping) = panels(SINGLE_COLUMN, 3.0, rows=2)
    kind = "" if table["trajectory"][0] is None else f" ({drawn_name(table['trajectory'][0])})"
    for ax, desired, gain in ((stiffness, "K_d", "K_1"), (damping, "B_d", "B_1")):
        ax.plot(table["phase"], table[desired], color=BLACK, label=f"Desired ${desired}${kind}")
        gains = table[f"{gain}_joint"]
        if gains.count():
            dashes = (0, (5, 1.5))
            ax.plot(
                table["phase"], gains, color=ORANGE, linestyle=dashes, linewidth=1.3, label=f"Gain ${gain}\\,n_T^2$"
            )
        ax.update_datalim([(table["phase"][0], 0)])
        ax.margins(x=0)
        ax.legend(loc="best")
    stiffness.set_ylabel("Stiffness (N·m/rad)")
    damping.set_ylabel("Damping (N·m·s/rad)")
    damping.set_xlabel("Gait cycle (%)")
    damping.xaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0, symbol=""))
    if not any(table[name].count() for name in GAINS):
        figure.supxlabel(NO_GAINS, fontsize=8)
    figure.align_ylabels()
    return figure
