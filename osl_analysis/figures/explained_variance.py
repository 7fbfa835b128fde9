"""Fig. 6: the variance of the torque that a second-order system accounts for."""

import textwrap
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import columns_of, marks, names, style
from osl_analysis.figures.ticks import label_log_axis
from osl_analysis.stats.repeats import counted, doubts_of_trials
from osl_analysis.trial import Array

LEAST_UNEXPLAINED = 1e-4  # smaller unexplained shares are drawn here [percent]
MEDIAN_LINE: dict[str, Any] = {"color": style.BLACK, "linewidth": 1.2}
HEIGHT = 3.0  # of the figure [in]
PANEL_HEIGHT = 1.7  # of its panel, at least [in]
MARGIN = 0.75  # of the panel, for the labels of its vertical axis [in]
POINT = 4.9 / 72  # diameter of a marker with a small gap [in]
REACH = 0.45  # of a swarm to either side; swarms are 1 apart
MEDIAN_REACH = 0.3  # of the line at its median to either side
MOST_IN_COLUMN = 2  # swarms in one column of the page

NO_VAF = "the impedance table has no VAF of one amplitude, which Fig. 6 draws; fit the trials again"


def fig6_points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial and amplitude, doubtful where the fit to all of the trial is. A trial that
    no stepped sine moved has one row, a fit without a VAF (a constant torque) none."""
    is_single = pl.col("amplitude_deg").is_not_null() | (pl.len().over("trial") == 1)
    table = doubts_of_trials(impedance).filter(is_single & pl.col("VAF").is_finite())
    if table.is_empty():
        raise InputError(NO_VAF)
    table = table.with_columns(names.look_numbers(table["controller"]))
    return names.completed(table, columns_of("fig6"), only=True)


def fig6_caption(table: pl.DataFrame) -> str:
    """What Fig. 6 shows."""
    of_what = "trial and amplitude" if names.has_values(table, "amplitude_deg") else "trial"
    sentences = [
        "Variance accounted for (VAF) by the best fit of K, B and I: a marker per"
        f" {of_what}. The axis is logarithmic in 100 − VAF, the share of the variance that the fit"
        " leaves unexplained."
    ]
    if not table.filter(pl.col("VAF") > 100 - LEAST_UNEXPLAINED).is_empty():
        sentences.append(f"Larger VAFs than {100 - LEAST_UNEXPLAINED:g} % are drawn there.")
    if marks.has_doubtful(table):
        sentences.append("The median is of trials that are not doubtful.")
    sentences.append("The place across a swarm has no meaning.")
    return " ".join(sentences)


@style.drawing(
    columns_of("fig6"),
    fig6_points,
    needs=("trial", "controller", "K_d", "B_d", "amplitude_deg", "VAF"),
    caption=fig6_caption,
)
def draw_fig6(table: pl.DataFrame) -> Figure:
    """A swarm for each controller of each joint and side."""
    swarms = swarms_of(table)
    is_narrow = len(swarms) <= MOST_IN_COLUMN
    figure, (ax,) = style.panels(style.SINGLE_COLUMN if is_narrow else style.DOUBLE_COLUMN, HEIGHT)
    inches = (figure.get_figwidth() - MARGIN) / len(swarms)
    limits = unexplained_limits(np.concatenate([unexplained(rows) for _, rows in swarms]))
    ax.set_yscale("log")
    ax.set_ylim(*limits)

    looks = names.looks_in(table)
    below = []
    for place, (title, rows) in enumerate(swarms):
        look = looks[rows["controller"][0]]
        draw_swarm(ax, rows, place, look, inches)
        below.append(written_below(rows, look.label.strip(), title, inches))
    ax.set_xlim(-0.5, len(swarms) - 0.5)
    ax.set_xticks(range(len(swarms)), below)
    ax.tick_params(axis="x", length=0)
    label_unexplained_axis(ax, limits)

    entries = {"Median": marks.key("Median", **MEDIAN_LINE)} | marks.open_entry(table)
    marks.legend_above(figure, entries, 4)
    return figure


def swarms_of(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint, side and controller, with joint and side where they are told."""
    parts = names.placed_rows(table)
    swarms = []
    for place, part in parts:
        for controller in names.looks_in(part):
            swarms.append((place, names.of_controller(part, controller)))
    has_places = len(parts) > 1 or len(swarms) > MOST_IN_COLUMN
    return [(place if has_places else "", rows) for place, rows in swarms]


def unexplained(rows: pl.DataFrame) -> Array:
    """100 − VAF of each fit (n,) [percent], as it is drawn."""
    return np.asarray(np.maximum(100 - rows["VAF"].to_numpy(), LEAST_UNEXPLAINED))


def unexplained_limits(shares: Array) -> tuple[float, float]:
    """Ends of the axis [percent] around all unexplained shares (n,): room for two ticks at
    least."""
    exponents = np.log10(shares)
    span = float(np.ptp(exponents))
    room = max(0.05 * span, 0.4 - span / 2)
    return float(10 ** (exponents.min() - room)), float(10 ** (exponents.max() + room))


def draw_swarm(ax: Axes, rows: pl.DataFrame, place: int, look: style.Look, inches: float) -> None:
    """The fits of one controller around a place of the axis, whose unit has this length [in], and
    the median of those that are not doubtful."""
    low, high = np.log10(ax.get_ylim())
    shares = unexplained(rows)
    heights = (high - np.log10(shares)) / (high - low) * PANEL_HEIGHT
    x = place + marks.swarm_offsets(heights, POINT, inches, REACH)
    marks.draw_fits(ax, rows, x, shares, look, marks.BEHIND_LINES)
    median = np.maximum(100 - median_vaf(rows), LEAST_UNEXPLAINED)  # NaN: nothing is drawn
    ax.hlines(median, place - MEDIAN_REACH, place + MEDIAN_REACH, **MEDIAN_LINE, zorder=0.5)


def median_vaf(rows: pl.DataFrame) -> float:
    """The median VAF [percent] of the fits that means count; NaN where all are doubtful."""
    used = counted(rows)
    return float(np.median(used["VAF"])) if len(used) else np.nan


def written_below(rows: pl.DataFrame, controller: str, place: str, inches: float) -> str:
    """The lines below a swarm: controller, joint and side, number of fits, median."""
    n_trials = rows["trial"].n_unique()
    fits = names.count_of(n_trials, "trial")
    if len(rows) != n_trials:
        fits = f"{names.count_of(len(rows), 'fit')} of {fits}"
    median = median_vaf(rows)
    text = "no median: all doubtful"
    if np.isfinite(median):
        leading = int(np.floor(np.log10(max(100 - median, 1e-5))))
        digits = min(max(1 - leading, 2), 6)  # two of the unexplained share
        text = f"median {median:.{digits}f} %".replace("-", "−")
    parts = (controller, place, fits, text)

    lines = []
    for line in parts:
        lines += textwrap.wrap(line, max(int(style.LETTERS_PER_INCH * inches), 6))
    return "\n".join(lines)


def label_unexplained_axis(ax: Axes, limits: tuple[float, float]) -> None:
    """Write the VAF at round numbers of 100 − VAF. Nothing is drawn beyond the least share."""
    label_log_axis(ax.yaxis, limits, 12)
    ticks = [tick for tick in ax.get_yticks() if tick >= LEAST_UNEXPLAINED * (1 - 1e-9)]
    labels = []
    for tick in ticks:
        is_last = bool(np.isclose(tick, LEAST_UNEXPLAINED, atol=0.0))
        labels.append(f"{'≥ ' if is_last else ''}{100 - tick:.7g}".replace("-", "−"))
    ax.set_yticks(ticks, labels)
    ax.invert_yaxis()
    ax.set_ylabel("VAF (%), log scale of 100 − VAF")
