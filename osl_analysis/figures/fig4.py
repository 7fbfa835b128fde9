# SPDX-License-Identifier: Apache-2.0
"""Fig. 4: torque of one trial over time, measured and modelled."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from numpy.typing import NDArray

from osl_analysis.bench.impedance import Analysis
from osl_analysis.figures import marks, style
from osl_analysis.trial import Array

MEASURED_LINE: dict[str, Any] = {"color": style.LIGHT_GREY, "linewidth": 2.2}
MODEL_LINE: dict[str, Any] = {
    "color": style.MAGENTA,  # as in the draft's text; its caption calls it blue
    "linewidth": 1.0,
    "linestyle": (0, (2.5, 1.5)),
}
SHOWN_S = 10.0  # length of the part of a trial that is shown, to the nearest begin of a cycle
ENOUGH_FITTED = 0.8  # share of what is shown
CHOICE = ("trial", "joint", "side", "chosen", "controller")  # texts of `time_series_example`
SAME_AMPLITUDE_DEG = 1e-6  # difference of an amplitude that a CSV file rounds


def points(fits: pl.DataFrame, analysis: Analysis, choice: Mapping[str, Any]) -> pl.DataFrame:
    """The numbers of Fig. 4: a part of a trial at its largest amplitude, or of a motion that is no
    stepped sine, measured and by the best second-order fit.

    Rows that are not fitted, such as rests and first cycles, have no modelled torque.

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
    sizes = [
        (each.commanded_deg or each.label, each.label)
        for each in record.groups.strata
        if isinstance(each.label, float)
    ]
    label = max(sizes, default=(0.0, None))[1]  # None: of a motion without amplitudes
    is_fitted = record.is_fitted(label)
    last = shown_rows(is_fitted, record.motion.theta, round(SHOWN_S * record.rate_hz))
    modelled = np.where(is_fitted, analysis.modelled(label), np.nan)
    # NaN in gaps, so that no line crosses them
    theta_deg = np.where(record.usable, np.rad2deg(record.motion.theta), np.nan)
    torque = np.where(record.usable, record.filtered_torque, np.nan)

    amplitude = pl.col("amplitude_deg")
    is_shown = amplitude.is_null()
    if isinstance(label, float) and label in analysis.fits:  # this amplitude has a fit of its own
        is_shown = (amplitude - label).abs() < SAME_AMPLITUDE_DEG
    texts = {
        **{name: choice.get(name) or None for name in CHOICE},
        "doubtful": fits.filter(is_shown)["doubtful"][0],
        "model": "second-order system",
    }
    samples = {
        "time": record.time[last] - record.time[last[0]],
        "theta_deg": theta_deg[last],
        "torque": torque[last],
        "torque_model": modelled[last],
    }
    return pl.DataFrame(
        {**samples, **texts, "K_d": choice.get("K_d"), "B_d": choice.get("B_d")},
        schema_overrides={"K_d": pl.Float64, "B_d": pl.Float64},
        nan_to_null=True,
    )


def shown_rows(is_fitted: NDArray[np.bool_], theta: Array, count: int) -> NDArray[np.intp]:
    """The last `count` rows or so that are mostly fitted, from the begin of a cycle to the end of a
    fitted part, and none before the first that is fitted."""
    n_fitted = np.cumsum(is_fitted)  # up to each row
    ends = np.flatnonzero(np.diff(is_fitted, append=False) & is_fitted)
    shares = (n_fitted[ends] - n_fitted[np.maximum(ends - count, 0)]) / count
    enough = min(ENOUGH_FITTED, np.max(shares))
    end = ends[shares >= enough][-1]
    # a cycle begins where the angle rises through its mean
    is_above = theta > np.mean(theta[is_fitted])
    cycles = np.flatnonzero(np.diff(is_above, prepend=False) & is_above)
    first = np.flatnonzero(is_fitted)[0]
    begins = np.append(cycles[(cycles > first) & (cycles < end)], first)
    nearest = np.argmin(np.abs(begins - (end - count)))
    return np.arange(begins[nearest], end + 1)


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) angle, (b) torque and its fit, (c) residual of one trial over time."""
    title = ", ".join(style.condition(table)) or f"Trial {style.drawn_name(table['trial'][0], 60)}"
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3.9, rows=3, titles=[title], share_x=True)
    angle, torque, residual = axes
    angle.plot(table["time"], table["theta_deg"], color=style.BLACK, linewidth=0.9)
    angle.set_ylabel("Angle (deg)")
    is_doubtful = marks.has_doubtful(table)
    model = f"Best-fit {table['model'][0]}{' (doubtful)' if is_doubtful else ''}"
    draw_torque(torque, residual, table, model)

    # a sample that the fit leaves out shades the time to the next one
    is_out = table["torque_model"].is_null().to_numpy()
    for ax in axes:
        ax.fill_between(
            table["time"], 0, 1, where=is_out, transform=ax.get_xaxis_transform(),
            color=style.GRID_GREY, linewidth=0, zorder=0, label="Not fitted" if any(is_out) else "",
        )  # fmt: skip
        ax.margins(x=0.005)
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    return figure


def draw_torque(torque: Axes, residual: Axes, table: pl.DataFrame, model: str) -> None:
    """Measured torque and the fit, and below what is left [N·m], over time [s]."""
    torque.plot(table["time"], table["torque"], label="Measured", **MEASURED_LINE)
    torque.plot(table["time"], table["torque_model"], label=model, **MODEL_LINE)
    torque.set_ylabel("Torque (N·m)")
    residual.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE)
    left = table["torque"] - table["torque_model"]
    residual.plot(table["time"], left, color=style.BLACK, linewidth=0.7)
    residual.set_ylabel("Residual (N·m)")
    residual.set_xlabel("Time (s)")
