"""Measured and modelled torque of one trial, for the inspection of a fit."""

import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, panels, paper_style

COLUMNS = ("time", "torque", "torque_model")


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """Torque [N*m] over time [s] above, residual of the model below."""
    figure, (torque, residual) = panels(DOUBLE_COLUMN, 3.4, rows=2)
    torque.plot(table["time"], table["torque"], color=BLACK, linewidth=0.8, label="Measured")
    torque.plot(table["time"], table["torque_model"], "--", color="#0072B2", linewidth=0.8, label="Fitted model")
    residual.plot(table["time"], table["torque"] - table["torque_model"], color=BLACK, linewidth=0.5)
    torque.set_ylabel("Torque (N·m)")
    torque.legend(loc="upper left", ncols=2)
    residual.set_ylabel("Residual (N·m)")
    residual.set_xlabel("Time (s)")
    return figure
