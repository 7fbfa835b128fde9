"""Fig. 4: ten seconds of a dynamometer trial, measured and modelled by the best second-order system."""

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures.names import drawn_name, place_name
from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, IS_DOUBTFUL, MAGENTA, panels, paper_style

COLUMNS = ("joint", "side", "trial", "chosen", "time", "theta_deg", "torque", "torque_model", "doubtful")


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """Angle above, torque below with the fit dashed magenta, as in Fig. 3.

    The draft calls this line blue in its caption and magenta in its text. Rows in order of time: `time` [s] from
    0, `theta_deg` [deg], `torque` and `torque_model` [N*m], and `doubtful`. The legend says if the fit is doubtful.
    Lines end where the time steps over rows that are not of this amplitude. The line below names the trial where it
    was `chosen`.
    """
    table = with_breaks(table)
    joint, side, trial, chosen = table.select("joint", "side", "trial", "chosen").row(0)
    figure, (angle, torque) = panels(DOUBLE_COLUMN, 2.8, rows=2, names=[f"{place_name(joint, side)}: angle", "Torque"])
    angle.sharex(torque)
    angle.tick_params(labelbottom=False)
    angle.plot(table["time"], table["theta_deg"], color=BLACK, linewidth=0.9)
    torque.plot(table["time"], table["torque"], color="#B4B4B4", linewidth=2.2, label="Measured")
    torque.plot(
        table["time"],
        table["torque_model"],
        color=MAGENTA,
        linestyle=(0, (2.5, 1.5)),
        linewidth=1.0,
        label="Best-fit second-order system" + " (doubtful)" * (len(table.filter(IS_DOUBTFUL)) > 0),
    )
    angle.set_ylabel("Angle (deg)")
    torque.set_ylabel("Torque (N·m)")
    torque.set_xlabel("Time (s)")
    for ax in (angle, torque):
        ax.margins(x=0.005)
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    if chosen:
        figure.supxlabel(f"Trial {drawn_name(trial)}: {chosen}", fontsize=8)
    return figure


def with_breaks(table: pl.DataFrame) -> pl.DataFrame:
    """The table with a row of NaN before each step in time [s] that is longer than two ordinary ones."""
    step = pl.col("time").diff()
    broken = table.with_row_index("row").filter(step > 2 * step.median())
    signals = ("theta_deg", "torque", "torque_model")
    ends = broken.with_columns(pl.lit(np.nan).alias(name) for name in signals)
    return pl.concat([ends, table.with_row_index("row")]).sort("row", maintain_order=True).drop("row")
