"""Fig. 4: ten seconds of a dynamometer trial, measured and modelled by the best second-order system."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.figures.names import as_text, doubtful_said, drawn_name, place_name
from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, DRAWN_OPEN, MAGENTA, panels, paper_style

COLUMNS = ("joint", "side", "trial", "chosen", "time", "theta_deg", "torque", "torque_model", "doubtful")


def caption(table: pl.DataFrame) -> str:
    joint, side, trial, chosen = table.select("joint", "side", "trial", "chosen").row(0)
    fitted = table.drop_nulls("torque_model")
    place, time, angle = place_name(joint, side), table["time"].to_numpy(), table["theta_deg"].to_numpy()
    why = f" ({as_text(chosen)})" if chosen else ""
    said = [
        f"{as_text(place)}, trial {as_text(trial)}{why}: the last {np.ptp(time):.3g} s of one amplitude, at most "
        f"{np.max(np.abs(angle)):.2g} deg.",
        "(a) Measured angle. (b) Torque: grey as measured, dashed by the second-order system that fits best (Eq. 15). "
        "(c) Measured minus modelled torque.",
    ]
    if len(fitted) < len(table):
        said.append("Grey ground: samples that the fit leaves out, such as the first cycles at a frequency.")
    if len(fitted):
        left = fitted["torque"] - fitted["torque_model"]
        vaf = 100 * (1 - float(np.var(left.to_numpy())) / float(np.var(fitted["torque"].to_numpy())))
        rms = float(np.sqrt(np.mean(left.to_numpy() ** 2)))
        said.append(f"Of the fitted samples shown, the RMS residual is {rms:.2g} N·m and the VAF {vaf:.2f} %.")
    said.append(doubtful_said(table.select("trial", "doubtful").head(1), "said in the legend"))
    return " ".join(said)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) Angle; (b) torque, the fit dashed magenta, which the draft calls blue in its caption; (c) residual."""
    joint, side, trial = table.select("joint", "side", "trial").row(0)
    place = f"{place_name(joint, side)}, trial {drawn_name(trial, 60)}"
    figure, (angle, torque, residual) = panels(DOUBLE_COLUMN, 3.9, rows=3, names=[place, "", ""])
    lines = with_breaks(table)
    time = lines["time"]
    angle.plot(time, lines["theta_deg"], color=BLACK, linewidth=0.9)
    torque.plot(time, lines["torque"], color="#B4B4B4", linewidth=2.2, label="Measured")
    label = "Best-fit second-order system" + " (doubtful)" * (len(table.filter(DRAWN_OPEN)) > 0)
    torque.plot(time, lines["torque_model"], color=MAGENTA, linestyle=(0, (2.5, 1.5)), linewidth=1.0, label=label)
    residual.axhline(0, color=BLACK, linewidth=0.4)
    residual.plot(time, lines["torque"] - lines["torque_model"], color=BLACK, linewidth=0.7)
    angle.set_ylabel("Angle (deg)")
    torque.set_ylabel("Torque (N·m)")
    residual.set_ylabel("Residual (N·m)")
    residual.set_xlabel("Time (s)")
    for ax in (angle, torque):
        ax.sharex(residual)
        ax.tick_params(labelbottom=False)
    for ax in (angle, torque, residual):
        shade_left_out(ax, table)
        ax.margins(x=0.005)
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    figure.align_ylabels()
    return figure


def shade_left_out(ax: Axes, table: pl.DataFrame) -> None:
    runs = table.with_columns(run=pl.col("torque_model").is_null().rle_id())
    left_out = runs.filter(pl.col("torque_model").is_null()).group_by("run", maintain_order=True)
    spans = left_out.agg(first=pl.col("time").first(), last=pl.col("time").last())
    for number, (_, first, last) in enumerate(spans.iter_rows()):
        label = "Not fitted" if number == 0 else None
        ax.axvspan(first, last, color="#E8E8E8", linewidth=0, zorder=0, label=label)


def with_breaks(table: pl.DataFrame) -> pl.DataFrame:
    """The table with a row of NaN before each step in time [s] that is longer than two ordinary ones."""
    step = pl.col("time").diff()
    broken = table.with_row_index("row").filter(step > 2 * step.median())
    ends = broken.with_columns(pl.lit(np.nan).alias(name) for name in ("theta_deg", "torque", "torque_model"))
    return pl.concat([ends, table.with_row_index("row")]).sort("row", maintain_order=True).drop("row")
