# SPDX-License-Identifier: Apache-2.0
"""Fig. 7: admittance of the joint over frequency, measured, desired, and of the linear model, and
how far the measured impedance is from the desired one."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from osl_analysis.bench.evidence import DesiredImpedance
from osl_analysis.bench.summaries import PLACE
from osl_analysis.figures import DESIRED, LINEAR_MODEL, OBSERVED, marks, style
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import (
    DrivetrainParameters,
    desired_admittance,
    joint_admittance,
)
from osl_analysis.model.rendered_impedance import FAITHFUL


class Layout:
    """Ticks, the width of a line, and the height of a panel."""

    MOST_TICKS = 8  # of frequency
    USUAL_PHASES = (1, 1.5, 3, 4.5, 9, 10)  # steps between ticks, times a power of ten [deg]
    MODEL_POINTS = 101  # of a response by a model
    MODEL_WIDTH = 0.9  # of a line [pt]
    PANEL_HEIGHT = 1.85  # with its share of legend and axis [in]


DESIRED_LINE: dict[str, Any] = {"color": style.BLACK, "zorder": 1}


def points(
    responses: pl.DataFrame, p: DrivetrainParameters | None, joint: str | None, weight: Weight
) -> pl.DataFrame:
    """The numbers of Fig. 7.

    Parameters
    ----------
    responses
        Rows of `response.csv` of one desired impedance, with `look`.
    p
        The parameters of a device, as far as they are known, and its `joint`.
    joint
        Other joints have no linear model.
    weight
        W of Eq. 14.

    Returns
    -------
    DataFrame
        The measured responses over all amplitudes; the desired response (Eq. 11), if K_d and B_d
        are known; and that of the linear model (Eq. 9), if the gains are.
    """
    shown = over_amplitudes(responses).sort("frequency_hz", maintain_order=True)
    shown = shown.with_columns(curve=pl.lit(OBSERVED))
    curves = []
    for measured in shown.partition_by(PLACE):
        place, side, K_d, B_d = measured.select(*PLACE, "K_d", "B_d").row(0)
        low_hz, high_hz = measured["frequency_hz"][0], measured["frequency_hz"][-1]
        frequency_hz = np.linspace(low_hz, high_hz, Layout.MODEL_POINTS)
        models = []
        if K_d is not None and B_d is not None:
            models.append((DESIRED, None, desired_admittance(K_d, B_d)))
        if p is not None and joint == place:
            for controller in measured["controller"].unique(maintain_order=True):
                gains = DesiredImpedance(controller, K_d, B_d).gains(p, weight)
                if gains is not None:
                    rendered = joint_admittance(gains.K_1, gains.B_1, p, p.J_j)
                    models.append((LINEAR_MODEL, controller, rendered))
        for curve, controller, admittance in models:
            Y = admittance(2j * np.pi * frequency_hz)
            response = {
                "frequency_hz": frequency_hz,
                "magnitude": np.abs(Y),
                "phase_deg": np.rad2deg(np.angle(Y)),
                "curve": curve,
                "controller": controller,
                "joint": place,
                "side": side,
            }
            curves.append(pl.DataFrame(response))
    looks = shown.select("controller", "look").unique()
    joined = pl.concat([shown, *curves], how="diagonal_relaxed").drop("look")
    return joined.join(looks, on="controller", how="left", maintain_order="left")


def over_amplitudes(response: pl.DataFrame) -> pl.DataFrame:
    """The rows of `response.csv` over all amplitudes, with the doubts about single ones, with the
    range of their magnitudes, phases, which are counted from that of all, and distances from the
    desired impedance, and with the interval of this distance."""
    keys = ["trial", "frequency_hz"]
    whole = response.filter(scope="all")
    of_whole = whole.select(*keys, phase_of_whole="phase_deg")
    single = response.filter(scope="amplitude").join(of_whole, on=keys)
    apart = (pl.col("phase_deg") - pl.col("phase_of_whole") + 180) % 360 - 180
    single = single.with_columns(phase_deg=pl.col("phase_of_whole") + apart)
    doubts = pl.col("doubtful").filter(pl.col("doubtful") != "")
    quantities = pl.col("magnitude", "phase_deg", "Z_error")
    ranges = single.group_by(keys).agg(
        quantities.min().name.suffix("_range_low"),
        quantities.max().name.suffix("_range_high"),
        doubts=doubts.unique(maintain_order=True).str.join("; "),
    )
    joined = whole.join(ranges, on=keys, how="left", maintain_order="left")
    # Z moves along its direction as its magnitude, across it as its phase
    size = 1 + pl.col("magnitude_error") / 100
    along = (pl.col("magnitude_high") - pl.col("magnitude_low")) / 2 / pl.col("magnitude")
    across = (pl.col("phase_deg_high") - pl.col("phase_deg_low")).radians() / 2
    half = 100 * size * (along.pow(2) + across.pow(2)).sqrt()
    return joined.with_columns(
        doubtful=pl.coalesce("doubts", "doubtful"),
        Z_error_low=(pl.col("Z_error") - half).clip(0),
        Z_error_high=pl.col("Z_error") + half,
    ).drop("doubts")


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
    if style.has_values(table, "Z_error"):
        labels.append("$|Z - Z_d|/|Z_d|$ (%)")
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
    if style.has_values(table, "Z_error"):
        line = {"color": style.BLACK, "linestyle": style.DOTTED, "linewidth": style.THIN}
        keys.append(marks.key(f"{100 * FAITHFUL:g} % from desired", **line))
    marks.legend_above(figure, keys)
    return figure


def draw_part(ax: Axes, part: pl.DataFrame, quantity: str) -> None:
    """Magnitude or phase of one joint: measured, of linear models, and desired."""
    desired = part.filter(curve=DESIRED)
    ax.plot(desired["frequency_hz"], desired[quantity], **DESIRED_LINE)
    for look, model in style.by_controller(part.filter(curve=LINEAR_MODEL)):
        ax.plot(
            model["frequency_hz"], model[quantity],
            color=look.colour, linestyle=style.DASHED, linewidth=Layout.MODEL_WIDTH,
        )  # fmt: skip
    for look, observed in style.by_controller(part.filter(curve=OBSERVED)):
        marks.draw_estimates(ax, observed, "frequency_hz", quantity, look)


def draw_distances(ax: Axes, part: pl.DataFrame) -> None:
    """How far the measured impedance of one joint is from the desired one."""
    for look, observed in style.by_controller(part.filter(curve=OBSERVED)):
        marks.draw_estimates(ax, observed, "frequency_hz", "Z_error", look)
    ax.axhline(100 * FAITHFUL, color=style.BLACK, linestyle=style.DOTTED, linewidth=style.THIN)
    ax.set_ylim(bottom=0)
