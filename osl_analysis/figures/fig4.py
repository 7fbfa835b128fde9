# SPDX-License-Identifier: Apache-2.0
"""Fig. 4: torque of one trial over time, measured and modelled."""

import numpy as np
import polars as pl

from osl_analysis.figures import style

SHOWN_S = 10  # length of the part of a trial that is shown, as in the draft
STEP_S = 1  # between the parts that are compared


def points(series: pl.DataFrame) -> pl.DataFrame:
    """The ten seconds of a trial's `series` of which the fit uses most samples, the last of equals;
    the whole of a shorter fit.

    Rows that are not fitted, such as rests and first cycles, have no modelled torque.
    """
    fitted_s = series.drop_nulls("torque_model")["time"].to_numpy()
    first_s, last_s = fitted_s[[0, -1]]
    ends_s = np.arange(last_s, min(first_s + SHOWN_S, last_s) - STEP_S / 2, -STEP_S)
    counts = [np.count_nonzero((fitted_s > end - SHOWN_S) & (fitted_s <= end)) for end in ends_s]
    end_s = ends_s[np.argmax(counts)]  # the first of equals, which ends last
    begin_s = max(end_s - SHOWN_S, first_s)
    shown = series.filter(pl.col("time").is_between(begin_s, end_s))
    return shown.with_columns(pl.col("time") - pl.col("time").first())


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """Angle, if it is known, torque and its fit, and the residual of one trial over time."""
    rows = 2 + style.has_values(table, "theta_deg")
    title = ", ".join(style.condition(table)) or f"Trial {style.drawn_name(table['trial'][0], 60)}"
    figure, axes = style.panels(style.DOUBLE_COLUMN, 4, rows, titles=[title], sharex="col")
    *angles, torque, residual = axes
    for angle in angles:
        angle.plot(table["time"], table["theta_deg"], color=style.BLACK)
        angle.set_ylabel("Angle (deg)")
    doubt = " (doubtful)" if style.has_doubtful(table) else ""
    torque.plot(
        table["time"], table["torque"], color=style.LIGHT_GREY, linewidth=2, label="Measured"
    )
    torque.plot(
        table["time"],
        table["torque_model"],
        "--",
        color=style.MAGENTA,  # as in the draft's text; its caption calls it blue
        label=f"Best fit{doubt}",
    )
    torque.set_ylabel("Torque (N·m)")
    residual.axhline(0, color=style.BLACK, linewidth=0.5)
    residual.plot(table["time"], table["torque"] - table["torque_model"], color=style.BLACK)
    residual.set_ylabel("Residual (N·m)")
    residual.set_xlabel("Time (s)")

    # a sample that the fit leaves out shades the time to the next one
    is_out = table["torque_model"].is_null().to_numpy()
    for ax in axes:
        ax.fill_between(
            table["time"],
            0,
            1,
            where=is_out,
            transform=ax.get_xaxis_transform(),
            color=style.GRID_GREY,
            linewidth=0,
            zorder=0,
            label="Not fitted" if any(is_out) else "",
        )
        ax.margins(x=0)
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    return figure
