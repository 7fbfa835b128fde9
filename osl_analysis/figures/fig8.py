# SPDX-License-Identifier: Apache-2.0
"""Fig. 8: desired impedance and control gains over stance."""

import polars as pl
from matplotlib.axes import Axes

from osl_analysis.config.impedance_trajectory import STANCE_SHARE
from osl_analysis.figures import style


def points(gains: pl.DataFrame) -> pl.DataFrame:
    """The desired impedance and the gains in stance: in swing the walking controller renders no
    impedance (Section IV)."""
    phase = pl.col("phase")
    return gains.filter(phase <= STANCE_SHARE).with_columns(stance=100 * phase / STANCE_SHARE)


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) stiffness, (b) damping over stance: desired, and the gain."""
    kind = table["trajectory"][0]
    title = f"Trajectory: {style.drawn_name(kind)}" if kind else ""
    figure, axes = style.panels(style.SINGLE_COLUMN, 3, 2, titles=[title], sharex="col")
    stiffness, damping = axes
    draw_gain(stiffness, table, "K")
    stiffness.set_ylabel("Stiffness (N·m/rad)")
    draw_gain(damping, table, "B")
    damping.set_ylabel("Damping (N·m·s/rad)")
    damping.set_xlabel("Stance (%)")
    return figure


def draw_gain(ax: Axes, table: pl.DataFrame, symbol: str) -> None:
    """K or B: desired, and the gain at the joint where it is known, from 0 on."""
    ax.plot(table["stance"], table[f"{symbol}_d"], color=style.BLACK, label=f"Desired ${symbol}_d$")
    gain = f"{symbol}_1_joint"
    if style.has_values(table, gain):
        label = f"Gain ${symbol}_1\\,n_T^2$"
        ax.plot(table["stance"], table[gain], "--", color=style.ORANGE, label=label)
    ax.update_datalim([(table["stance"][0], 0)])
    ax.margins(x=0)
    ax.legend(loc="best")
