"""Fig. 4: torque of one trial over time, measured and modelled."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import marks, style

MEASURED_LINE: dict[str, Any] = {"color": style.LIGHT_GREY, "linewidth": 2.2}
MODEL_LINE: dict[str, Any] = {
    "color": style.MAGENTA,  # as in the draft's text; its caption calls it blue
    "linewidth": 1.0,
    "linestyle": (0, (2.5, 1.5)),
}
GAP_STEPS = 2.0  # a step that is longer than so many ordinary ones is a gap
DRAWN = ("theta_deg", "torque", "torque_model")


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) angle, (b) torque and its fit, (c) residual of one trial over time."""
    title = ", ".join(style.condition(table)) or f"Trial {style.drawn_name(table['trial'][0], 60)}"
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3.9, rows=3, titles=[title], share_x=True)
    angle, torque, residual = axes
    lines = with_breaks(table)
    angle.plot(lines["time"], lines["theta_deg"], color=style.BLACK, linewidth=0.9)
    angle.set_ylabel("Angle (deg)")
    is_doubtful = marks.has_doubtful(table)
    model = f"Best-fit {table['model'][0]}{' (doubtful)' if is_doubtful else ''}"
    draw_torque(torque, residual, lines, model)

    # a sample that the fit leaves out shades the time to the next one
    is_out = table["torque_model"].is_null().to_numpy()
    for ax in axes:
        ax.fill_between(
            table["time"], 0, 1, where=is_out, transform=ax.get_xaxis_transform(),
            color=style.GRID_GREY, linewidth=0, zorder=0, label="Not fitted" if any(is_out) else "",
        )  # fmt: skip
        ax.margins(x=0.005)
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    figure.align_ylabels()
    return figure


def with_breaks(table: pl.DataFrame) -> pl.DataFrame:
    """The samples, with one of NaN before each gap in time, so that no line crosses it."""
    step = pl.col("time").diff()
    rows = table.with_row_index("row")
    breaks = rows.filter(step > GAP_STEPS * step.median())
    breaks = breaks.with_columns(pl.lit(np.nan).alias(name) for name in DRAWN)
    return pl.concat([breaks, rows]).sort("row", maintain_order=True)


def draw_torque(torque: Axes, residual: Axes, lines: pl.DataFrame, model: str) -> None:
    """Measured torque and the fit, and below what is left [N·m], over time [s]."""
    torque.plot(lines["time"], lines["torque"], label="Measured", **MEASURED_LINE)
    torque.plot(lines["time"], lines["torque_model"], label=model, **MODEL_LINE)
    torque.set_ylabel("Torque (N·m)")
    residual.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE)
    left = lines["torque"] - lines["torque_model"]
    residual.plot(lines["time"], left, color=style.BLACK, linewidth=0.7)
    residual.set_ylabel("Residual (N·m)")
    residual.set_xlabel("Time (s)")
