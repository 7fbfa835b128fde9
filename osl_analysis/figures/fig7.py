"""Fig. 7: admittance of the joint over frequency, measured, desired, and of the linear model."""

from typing import Any

import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from osl_analysis.figures import DESIRED, LINEAR_MODEL, OBSERVED, marks, style


class Layout:
    """Ticks, and the width of a line."""

    MOST_TICKS = 8  # of frequency
    USUAL_PHASES = (1, 1.5, 3, 4.5, 9, 10)  # steps between ticks, times a power of ten [deg]
    MODEL_WIDTH = 0.9  # of a line [pt]


DESIRED_LINE: dict[str, Any] = {"color": style.BLACK, "zorder": 1}


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) magnitude, (b) phase over frequency; several joints or sides stand side by side."""
    parts = style.by_place(table)
    of_curve = {kind: table.filter(curve=kind) for kind in (OBSERVED, DESIRED, LINEAR_MODEL)}
    titles = [title for title, _ in parts]
    if len(parts) == 1 and not of_curve[OBSERVED].is_empty():
        titles = [", ".join(style.condition(of_curve[OBSERVED].with_columns(controller=None)))]
    width = style.SINGLE_COLUMN if len(parts) == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, 4.2, 2, len(parts), titles=titles, share_x=True)
    for column, (_, part) in enumerate(parts):
        magnitude, phase = axes[column], axes[len(parts) + column]
        draw_part(magnitude, part, "magnitude")
        draw_part(phase, part, "phase_deg")
        magnitude.set_yscale("log")
        marks.label_log_axis(magnitude.yaxis, 6, lambda value: f"{1e3 * value:.4g}")
        phase.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE, zorder=0)
        phase.yaxis.set_major_locator(MaxNLocator(5, steps=Layout.USUAL_PHASES))
        phase.set_xscale("log")
        marks.label_log_axis(phase.xaxis, Layout.MOST_TICKS // len(parts))
        phase.set_xlabel("Frequency (Hz)")
    axes[0].set_ylabel("Magnitude (mrad/(N·m))")
    axes[len(parts)].set_ylabel("Phase (deg)")

    keys = marks.estimate_keys(of_curve[OBSERVED], "magnitude")
    if not of_curve[DESIRED].is_empty():
        keys.append(marks.key("Desired", **DESIRED_LINE))
    for look, _ in style.by_controller(of_curve[LINEAR_MODEL]):
        line = {"color": look.colour, "linestyle": look.dash, "linewidth": Layout.MODEL_WIDTH}
        keys.append(marks.key(f"{look.label}, {style.LINEAR_MODEL.lower()}", **line))
    marks.legend_above(figure, keys)
    figure.align_ylabels()
    return figure


def draw_part(ax: Axes, part: pl.DataFrame, quantity: str) -> None:
    """Magnitude or phase of one joint: measured, of linear models, and desired."""
    desired = part.filter(curve=DESIRED)
    ax.plot(desired["frequency_hz"], desired[quantity], **DESIRED_LINE)
    for look, model in style.by_controller(part.filter(curve=LINEAR_MODEL)):
        ax.plot(
            model["frequency_hz"], model[quantity],
            color=look.colour, linestyle=look.dash, linewidth=Layout.MODEL_WIDTH,
        )  # fmt: skip
    for look, observed in style.by_controller(part.filter(curve=OBSERVED)):
        marks.draw_estimates(ax, observed, "frequency_hz", quantity, look)
