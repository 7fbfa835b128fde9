# SPDX-License-Identifier: Apache-2.0
"""Torque over time of any fitted trial, for a notebook."""

import polars as pl

from osl_analysis.figures import style
from osl_analysis.figures.fig4 import draw_torque


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """Torque [N·m] over time [s], measured and modelled, above the residual."""
    figure, (torque, residual) = style.panels(style.DOUBLE_COLUMN, 3.4, rows=2, share_x=True)
    draw_torque(torque, residual, table, "Best-fit model")
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    return figure
