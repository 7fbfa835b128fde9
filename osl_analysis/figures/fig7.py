"""Fig. 7: admittance of the joint over frequency, measured, desired, and of the linear model, and
how far the measured impedance is from these."""

from typing import Any

import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from osl_analysis.figures import DESIRED, LINEAR_MODEL, OBSERVED, marks, style
from osl_analysis.model.rendered_impedance import FAITHFUL


class Layout:
    """Ticks, the width of a line, and the height of a panel."""

    MOST_TICKS = 8  # of frequency
    USUAL_PHASES = (1, 1.5, 3, 4.5, 9, 10)  # steps between ticks, times a power of ten [deg]
    MODEL_WIDTH = 0.9  # of a line [pt]
    PANEL_HEIGHT = 1.85  # with its share of legend and axis [in]


DESIRED_LINE: dict[str, Any] = {"color": style.BLACK, "zorder": 1}


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) magnitude, (b) phase, (c) known distances over frequency; several joints stand side by
    side."""
    parts = style.by_place(table)
    of_curve = {kind: table.filter(curve=kind) for kind in (OBSERVED, DESIRED, LINEAR_MODEL)}
    titles = [title for title, _ in parts]
    if len(parts) == 1 and not of_curve[OBSERVED].is_empty():
        titles = [", ".join(style.condition(of_curve[OBSERVED].with_columns(controller=None)))]
    width = style.SINGLE_COLUMN if len(parts) == 1 else style.DOUBLE_COLUMN
    labels = ["Magnitude (mrad/(N·m))", "Phase (deg)"]
    if style.has_values(table, "Z_error") or style.has_values(table, "model_error"):
        labels.append("Distance of $Z$ (%)")
    height = Layout.PANEL_HEIGHT * len(labels)
    figure, axes = style.panels(width, height, len(labels), len(parts), titles=titles, share_x=True)
    for column, (_, part) in enumerate(parts):
        magnitude, phase, *distances = axes[column :: len(parts)]
        draw_part(magnitude, part, "magnitude")
        draw_part(phase, part, "phase_deg")
        magnitude.set_yscale("log")
        marks.label_log_axis(magnitude.yaxis, 6, lambda value: f"{1e3 * value:.4g}")
        phase.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE, zorder=0)
        phase.yaxis.set_major_locator(MaxNLocator(5, steps=Layout.USUAL_PHASES))
        for distance in distances:
            draw_distances(distance, part)
        phase.set_xscale("log")
        marks.label_log_axis(phase.xaxis, Layout.MOST_TICKS // len(parts))
        axes[column - len(parts)].set_xlabel("Frequency (Hz)")
    for ax, label in zip(axes[:: len(parts)], labels, strict=True):
        ax.set_ylabel(label)

    keys = marks.estimate_keys(of_curve[OBSERVED], "magnitude")
    if not of_curve[DESIRED].is_empty():
        keys.append(marks.key("Desired", **DESIRED_LINE))
    if not of_curve[LINEAR_MODEL].is_empty():
        line = {"color": style.GREY, "linestyle": style.DASHED, "linewidth": Layout.MODEL_WIDTH}
        keys.append(marks.key(style.LINEAR_MODEL, **line))
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


def draw_distances(ax: Axes, part: pl.DataFrame) -> None:
    """How far the measured impedance of one joint is from the desired one, a marker, and from that
    of the linear model, a line."""
    for look, observed in style.by_controller(part.filter(curve=OBSERVED)):
        marks.draw_fits(ax, observed, observed["frequency_hz"], observed["Z_error"], look)
        ax.plot(
            observed["frequency_hz"], observed["model_error"],
            color=look.colour, linestyle=look.dash, linewidth=Layout.MODEL_WIDTH,
        )  # fmt: skip
    ax.axhline(100 * FAITHFUL, color=style.BLACK, linewidth=style.HAIRLINE, zorder=0)
    ax.set_ylim(bottom=0)
