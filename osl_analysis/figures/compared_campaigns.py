"""`comparison`: two campaigns, ratio by ratio, with their verdicts."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.figures import marks, names, style
from osl_analysis.judge.two_campaigns import RATIO, label_of

VERDICT_LOOKS = {
    "equivalent": style.Look(style.PURPLE, "o", 4.2, "Equivalent"),
    "different": style.Look(style.ORANGE, "D", 3.8, "Different"),
    "undecided": style.Look(style.GREY, "s", 3.8, "Undecided"),
    None: style.Look(style.BLACK, "|", 5.0, "Without a verdict"),
}
USUAL_MARGIN = 5.0  # where no row has one [percent]


@style.drawing(("experiment", "quantity", *RATIO, "verdict"))
def draw_comparison(table: pl.DataFrame) -> Figure:
    """A line per ratio, B over A less 1, with its interval, the margin as a band, the verdict
    beside it."""
    with_ratio = table.drop_nulls("relative_percent")
    rows = table if with_ratio.is_empty() else with_ratio  # without any ratio, lines that say so
    figure, (ax,) = style.panels(style.DOUBLE_COLUMN, 0.75 + 0.19 * len(rows))
    ax.axvline(0, color=style.BLACK, linewidth=0.6, zorder=1)
    labels = []
    for place, row in enumerate(rows.iter_rows(named=True)):
        draw_ratio(ax, place, row)
        labels.append(names.drawn_name(label_of(row), 60))
    ax.set_yticks(range(len(rows)), labels)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    label_ratio_axis(ax, rows)

    entries = marks.legend_entries([ax])
    if names.has_values(rows, "margin_percent"):
        label = "Margin of equivalence"
        entries[label] = marks.key(label, color=style.GRID_GREY, linewidth=6)
    if names.has_values(rows, RATIO[1]):
        entries[marks.INTERVAL] = marks.key(marks.INTERVAL, color=style.GREY, linewidth=1.2)
    marks.legend_above(figure, entries, 5)
    return figure


def draw_ratio(ax: Axes, place: int, row: Mapping[str, Any]) -> None:
    """One ratio less 1 [percent], its interval, its margin, and its verdict in words."""
    look = VERDICT_LOOKS[row["verdict"]]
    middle, low, high = (row[name] for name in RATIO)
    margin = row["margin_percent"]
    if margin is not None:
        ax.fill_betweenx(
            [place - 0.5, place + 0.5], -margin, margin,
            color=style.GRID_GREY, linewidth=0, zorder=0,
        )  # fmt: skip
    if low is not None:
        ax.hlines(place, low, high, color=look.colour, linewidth=1.2)
    x = np.nan if middle is None else middle
    ax.plot(x, place, look.marker, color=look.colour, markersize=look.size, label=look.label)

    verdict = row["verdict"] or ""
    if not verdict and middle is None:
        verdict = "no ratio"
    elif not verdict and low is None:
        verdict = "no interval"
    ax.text(
        1.01, place, verdict,
        color=look.colour, va="center", transform=ax.get_yaxis_transform(),
    )  # fmt: skip


def label_ratio_axis(ax: Axes, rows: pl.DataFrame) -> None:
    """An axis that is logarithmic beyond twice the largest margin: 40 % of a friction may stand
    beside 0.1 % of a belt."""
    linear = 2 * max(rows["margin_percent"].drop_nulls().to_list(), default=USUAL_MARGIN)
    low, high = ax.get_xlim()
    ax.set_xscale("symlog", linthresh=linear, linscale=1.5)
    sizes = np.array([linear / 4, linear / 2, *linear * 2.0 ** np.arange(12)])
    ax.set_xticks([tick for tick in (0.0, *sizes, *-sizes) if low <= tick <= high])
    ax.xaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.set_xlim(low, high)
    ax.set_xlabel(f"B over A, less 1 (%), logarithmic beyond ±{linear:g} %")
