"""Fig. 4, and the same for a notebook: torque over time, measured and modelled."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.figures import captions, columns_of, marks, names, style

MEASURED_LINE: dict[str, Any] = {"color": style.LIGHT_GREY, "linewidth": 2.2}
MODEL_LINE: dict[str, Any] = {
    "color": style.MAGENTA,  # as in the draft's text; its caption calls it blue
    "linewidth": 1.0,
    "linestyle": (0, (2.5, 1.5)),
}
GAP_STEPS = 2.0  # a step that is longer than so many ordinary ones is a gap
DRAWN = ("theta_deg", "torque", "torque_model")


def fig4_caption(table: pl.DataFrame) -> str:
    """What Fig. 4 shows, and why this trial."""
    joint, side, trial, chosen, controller, K_d, B_d = table.select(
        "joint", "side", "trial", "chosen", "controller", "K_d", "B_d"
    ).row(0)
    place = captions.as_text(names.place_name(joint, side))
    title = f"{place}, trial" if place else "Trial"
    condition = names.condition_parts(controller, K_d, B_d, written=captions.as_text)
    named = f"with {', '.join(condition)}" if condition else captions.as_text(trial)
    why = f" ({captions.as_text(chosen)})" if chosen else ""
    sentences = [
        f"{title} {named}{why}.",
        "(a) Measured angle. (b) Torque: grey as measured, dashed the best fit of K, B and I. (c)"
        " Residual, the measured torque less the modelled.",
    ]
    if table["torque_model"].null_count():
        sentences.append(
            "Grey ground: samples that the fit leaves out, such as the first cycles at a frequency."
        )
    return " ".join(sentences)


@style.drawing(columns_of("fig4"), caption=fig4_caption)
def draw_fig4(table: pl.DataFrame) -> Figure:
    """(a) angle, (b) torque and its fit, (c) residual of one trial over time."""
    (title,) = names.trial_titles(table).values()
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3.9, rows=3, titles=[title], share_x=True)
    angle, torque, residual = axes
    lines = with_breaks(table)
    angle.plot(lines["time"], lines["theta_deg"], color=style.BLACK, linewidth=0.9)
    angle.set_ylabel("Angle (deg)")
    draw_torque_and_model(torque, lines, table["model"][0], marks.has_doubtful(table))
    draw_residual(residual, lines)

    shade_unfitted(axes, table)
    residual.set_xlabel("Time (s)")
    for ax in axes:
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


def draw_torque_and_model(ax: Axes, lines: pl.DataFrame, model: str, is_doubtful: bool) -> None:
    """Measured torque [N·m] over time [s], and the fit."""
    label = f"Best-fit {model}{' (doubtful)' if is_doubtful else ''}"
    ax.plot(lines["time"], lines["torque"], label="Measured", **MEASURED_LINE)
    ax.plot(lines["time"], lines["torque_model"], label=label, **MODEL_LINE)
    ax.set_ylabel("Torque (N·m)")


def draw_residual(ax: Axes, lines: pl.DataFrame) -> None:
    """Measured less modelled torque [N·m] over time [s]."""
    ax.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE)
    residual = lines["torque"] - lines["torque_model"]
    ax.plot(lines["time"], residual, color=style.BLACK, linewidth=0.7)
    ax.set_ylabel("Residual (N·m)")


def shade_unfitted(axes: Sequence[Axes], table: pl.DataFrame) -> None:
    """Grey ground behind the samples that the fit leaves out."""
    is_out = pl.col("torque_model").is_null()
    runs = table.with_columns(run=is_out.rle_id()).filter(is_out)
    for number, run in enumerate(runs.partition_by("run", maintain_order=True)):
        label = "" if number else "Not fitted"
        for ax in axes:
            ax.axvspan(
                run["time"][0], run["time"][-1],
                color=style.GRID_GREY, linewidth=0, zorder=0, label=label,
            )  # fmt: skip


@style.drawing(("time", "torque", "torque_model"))
def draw_torque(table: pl.DataFrame) -> Figure:
    """Torque [N·m] over time [s], measured and modelled, above the residual."""
    figure, (torque, residual) = style.panels(style.DOUBLE_COLUMN, 3.4, rows=2, share_x=True)
    draw_torque_and_model(torque, table, "model", is_doubtful=False)
    draw_residual(residual, table)
    residual.set_xlabel("Time (s)")
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    figure.align_ylabels()
    return figure
