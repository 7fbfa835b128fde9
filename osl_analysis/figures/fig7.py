# SPDX-License-Identifier: Apache-2.0
"""Fig. 7: admittance of the joint over frequency, and distance from the desired impedance.

The admittance is measured, desired (Eq. 11) and that of the linear model (Eq. 9).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from osl_analysis.bench.evidence import DesiredImpedance
from osl_analysis.bench.summaries import PLACE
from osl_analysis.figures import style
from osl_analysis.figures.drawing import DESIRED, LINEAR_MODEL, OBSERVED
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import DrivetrainParameters, dynamic_stiffness
from osl_analysis.stats.doubts import is_doubtful

LABEL_ROOM = 0.08  # of the width of a single panel, for a label of a frequency
FAITHFUL_PERCENT = 10  # largest |Z - Z_d|, of |Z_d|, of a faithful impedance
LABELS = {
    "magnitude": "Magnitude (mrad/(N·m))",
    "phase_deg": "Phase (deg)",
    "Z_error": "$|Z - Z_d|/|Z_d|$ (%)",
}


def points(
    responses: pl.DataFrame, p: DrivetrainParameters | None, joint: str | None, weight: Weight
) -> pl.DataFrame:
    """The plotted numbers of Fig. 7.

    Parameters
    ----------
    responses
        Rows of `response.csv` of one desired impedance, with `look`.
    p
        The parameters of a device, as far as they are known.
    joint
        The joint of the device; other joints have no linear model.
    weight
        W of Eq. 14.

    Returns
    -------
    DataFrame
        The measured responses over all amplitudes; the desired response (Eq. 11), if K_d and B_d
        are known; and that of the linear model (Eq. 9), if the gains are.
    """
    shown = over_amplitudes(responses).sort("frequency_hz", maintain_order=True)
    curves = [shown.with_columns(curve=pl.lit(OBSERVED))]
    for measured in shown.partition_by(PLACE):
        place, K_d, B_d = measured.select("joint", "K_d", "B_d").row(0)
        if K_d is not None and B_d is not None:
            all_controllers = measured.with_columns(controller=None, look=None)
            curves.append(modelled(all_controllers, DESIRED, partial(np.polyval, [B_d, K_d])))
        if p is None or joint != place:
            continue
        for rows in measured.partition_by("controller"):
            gains = DesiredImpedance(rows["controller"][0], K_d, B_d).gains(p, weight)
            if gains is not None:
                rendered = partial(dynamic_stiffness, K_1=gains.K_1, B_1=gains.B_1, p=p)
                curves.append(modelled(rows, LINEAR_MODEL, rendered))
    points = pl.concat(curves, how="diagonal_relaxed")
    return points.with_columns(pl.col("is_doubtful").fill_null(False))


def modelled(measured: pl.DataFrame, curve: str, stiffness: Callable[[Any], Any]) -> pl.DataFrame:
    """The response by a model, torque over angle at frequencies s [rad/s], over the range of the
    measured frequencies."""
    measured_hz = measured["frequency_hz"]
    frequency_hz = np.linspace(measured_hz[0], measured_hz[-1], 100)
    Y = 1 / stiffness(2j * np.pi * frequency_hz)
    response = {
        "frequency_hz": frequency_hz,
        "magnitude": np.abs(Y),
        "phase_deg": np.rad2deg(np.angle(Y)),
        "curve": curve,
    }
    return pl.DataFrame(response).join(
        measured.select(*PLACE, "controller", "look").head(1), how="cross"
    )


def over_amplitudes(response: pl.DataFrame) -> pl.DataFrame:
    """The rows of `response.csv` over all amplitudes, with the ranges over single amplitudes.

    Ranges are those of magnitude, phase and distance from the desired impedance. A phase is within
    180 deg of that of all amplitudes. Doubts about single amplitudes count. The distance has an
    interval.
    """
    keys = ["trial", "frequency_hz"]
    overall_phase_deg = pl.col("phase_deg").filter(scope="all").first().over(keys)
    from_overall_deg = (pl.col("phase_deg") - overall_phase_deg + 180) % 360 - 180
    response = response.with_columns(phase_deg=overall_phase_deg + from_overall_deg)
    response = response.with_columns(is_doubtful=is_doubtful(response))
    whole = response.filter(scope="all")
    single = response.filter(scope="amplitude")
    doubts = pl.col("doubtful").filter("is_doubtful")
    quantities = pl.col("magnitude", "phase_deg", "Z_error")
    ranges = single.group_by(keys).agg(
        quantities.min().name.suffix("_range_low"),
        quantities.max().name.suffix("_range_high"),
        doubts_of_amplitudes=doubts.unique(maintain_order=True).str.join("; ").replace("", None),
        is_any_doubtful=pl.col("is_doubtful").any(),
    )
    joined = whole.join(ranges, on=keys, how="left", maintain_order="left")
    # Z moves along its direction as its magnitude, across it as its phase
    size = 1 + pl.col("magnitude_error") / 100
    along = (pl.col("magnitude_high") - pl.col("magnitude_low")) / 2 / pl.col("magnitude")
    across = (pl.col("phase_deg_high") - pl.col("phase_deg_low")).radians() / 2
    half = 100 * size * (along.pow(2) + across.pow(2)).sqrt()
    return joined.with_columns(
        doubtful=pl.coalesce("doubts_of_amplitudes", "doubtful"),
        is_doubtful=pl.col("is_doubtful") | pl.col("is_any_doubtful").fill_null(False),
        Z_error_low=(pl.col("Z_error") - half).clip(0),
        Z_error_high=pl.col("Z_error") + half,
    ).drop("doubts_of_amplitudes", "is_any_doubtful")


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) magnitude, (b) phase, (c) known distances over frequency; several joints stand side by
    side."""
    parts = style.by_place(table)
    observed = table.filter(curve=OBSERVED)
    titles = [title for title, _ in parts]
    if len(parts) == 1 and len(observed):
        titles = [", ".join(style.condition(observed.with_columns(controller=None)))]
    width = style.SINGLE_COLUMN if len(parts) == 1 else style.DOUBLE_COLUMN
    quantities = [name for name in LABELS if style.has_values(table, name)]
    rows = len(quantities)
    figure, axes = style.panels(width, 2 * rows, rows, len(parts), titles, sharex="col")
    for column, (_, part) in enumerate(parts):
        axes_of_part = axes[column :: len(parts)]
        for ax, quantity in zip(axes_of_part, quantities, strict=True):
            draw_part(ax, part, quantity)
        lowest = axes_of_part[-1]
        lowest.set_xscale("log")
        measured_hz = part.filter(curve=OBSERVED)["frequency_hz"].to_list()
        if measured_hz:
            style.label_values(lowest.xaxis, measured_hz, LABEL_ROOM * len(parts))
        lowest.set_xlabel("Frequency (Hz)")
    for ax, quantity in zip(axes[:: len(parts)], quantities, strict=True):
        ax.set_ylabel(LABELS[quantity])

    keys = [*style.estimate_keys(axes, observed), *style.labelled(axes, Line2D)]
    if not table.filter(curve=LINEAR_MODEL).is_empty():
        keys.append(style.key("Linear model", color=style.GREY, linestyle="--"))
    style.legend_above(figure, keys)
    return figure


def draw_part(ax: Axes, part: pl.DataFrame, quantity: str) -> None:
    """One quantity of one joint: measured, of linear models, and desired."""
    desired = part.filter(curve=DESIRED)
    if style.has_values(desired, quantity):
        frequency_hz = desired["frequency_hz"]
        ax.plot(frequency_hz, desired[quantity], color=style.BLACK, zorder=1, label="Desired")
    for number, (look, model) in enumerate(style.by_controller(part.filter(curve=LINEAR_MODEL))):
        dashes = (0, (6 / (number + 1), 2))  # the first has the longest, on and off [line widths]
        ax.plot(model["frequency_hz"], model[quantity], ls=dashes, color=look.colour)
    for look, observed in style.by_controller(part.filter(curve=OBSERVED)):
        style.draw_estimates(ax, observed, "frequency_hz", quantity, look)
    if quantity == "magnitude":
        ax.set_yscale("log")
        style.label_log_axis(ax.yaxis, lambda value: f"{1e3 * value:.4g}")
    elif quantity == "phase_deg":
        ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
    else:
        ax.axhline(FAITHFUL_PERCENT, color=style.BLACK, ls=":")
        ax.set_ylim(bottom=0)
