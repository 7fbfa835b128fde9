"""Fig. 4: torque of one trial over time, measured and modelled."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.bench.impedance import Analysis
from osl_analysis.figures import marks, style

MEASURED_LINE: dict[str, Any] = {"color": style.LIGHT_GREY, "linewidth": 2.2}
MODEL_LINE: dict[str, Any] = {
    "color": style.MAGENTA,  # as in the draft's text; its caption calls it blue
    "linewidth": 1.0,
    "linestyle": (0, (2.5, 1.5)),
}
GAP_STEPS = 2.0  # a step that is longer than so many ordinary ones is a gap
SHOWN_S = 10.0  # length of the part of a trial that is shown
SAME_AMPLITUDE_DEG = 1e-6  # difference of an amplitude that a CSV file rounds
DRAWN = ("theta_deg", "torque", "torque_model")


def points(fits: pl.DataFrame, analysis: Analysis, choice: Mapping[str, Any]) -> pl.DataFrame:
    """The numbers of Fig. 4: the end of the largest amplitude, or of a motion that is no stepped
    sine, measured and by the best second-order fit.

    Rests and other amplitudes have no rows. Rows that are not fitted, such as first cycles, have no
    modelled torque.

    Parameters
    ----------
    fits
        The trial's own table of fits, with their doubts.
    analysis
        Eq. 15 of the trial.
    choice
        That of `time_series_example`.
    """
    record = analysis.record
    strata = record.groups.strata
    sizes = [
        (each.commanded_deg or each.label, each.label)
        for each in strata
        if isinstance(each.label, float)
    ]
    label = max(sizes, default=(0.0, None))[1]  # None: of a motion without amplitudes
    is_fitted = record.is_fitted(label)
    is_moving = is_fitted.copy()
    for stratum in strata:
        if label in (None, stratum.label):
            is_moving[stratum.rows] = True
    rows = np.flatnonzero(is_moving & record.usable)
    last = rows[rows > rows[-1] - round(SHOWN_S * record.rate_hz)]
    modelled = np.where(is_fitted, analysis.modelled(label), np.nan)

    amplitude = pl.col("amplitude_deg")
    is_shown = amplitude.is_null()
    if isinstance(label, float) and label in analysis.fits:  # this amplitude has a fit of its own
        is_shown = (amplitude - label).abs() < SAME_AMPLITUDE_DEG
    texts = {
        **{name: choice[name] or None for name in ("trial", "joint", "side", "chosen")},
        "controller": choice.get("controller"),
        "doubtful": fits.filter(is_shown)["doubtful"][0],
        "model": "second-order system",
    }
    return pl.DataFrame(
        {
            "time": record.time[last] - record.time[last[0]],
            "theta_deg": np.rad2deg(record.motion.theta[last]),
            "torque": record.filtered_torque[last],
            "torque_model": pl.Series(modelled[last]).fill_nan(None),
        }
    ).with_columns(
        **{name: pl.lit(text, pl.String) for name, text in texts.items()},
        **{name: pl.lit(choice.get(name), pl.Float64) for name in ("K_d", "B_d")},
    )


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
