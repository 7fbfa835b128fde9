"""Two campaigns side by side: a forest plot of the ratios of all quantities."""

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures import names, style
from osl_analysis.judge.two_campaigns import RATIO, label_of

VERDICT_LOOKS = {
    "equivalent": style.Look(style.PURPLE, "o", 4.2, "Equivalent"),
    "different": style.Look(style.ORANGE, "D", 3.8, "Different"),
    "undecided": style.Look(style.GREY, "s", 3.8, "Undecided"),
    None: style.Look(style.BLACK, "|", 5.0, "Without a verdict"),
}


@style.paper_style()
def draw_comparison(table: pl.DataFrame) -> Figure:
    """A line per ratio, B over A less 1, with its interval, the margin as a band, the verdict beside it. The axis is
    logarithmic beyond twice the largest margin: 40 % of a friction may stand beside 0.1 % of a belt."""
    rows = table.drop_nulls("relative_percent")
    rows = table if rows.is_empty() else rows  # without any ratio, lines that say so
    figure, (ax,) = style.panels(style.DOUBLE_COLUMN, 0.75 + 0.19 * len(rows))
    ax.axvline(0, color=style.BLACK, linewidth=0.6, zorder=1)
    for place, row in enumerate(rows.iter_rows(named=True)):
        look, (middle, low, high) = VERDICT_LOOKS[row["verdict"]], (row[name] for name in RATIO)
        if (margin := row["margin_percent"]) is not None:
            ax.fill_betweenx([place - 0.5, place + 0.5], -margin, margin, color="#E4E4E4", linewidth=0, zorder=0)
        if low is not None:
            ax.hlines(place, low, high, color=look.colour, linewidth=1.2)
        x = np.nan if middle is None else middle
        ax.plot(x, place, look.marker, color=look.colour, markersize=look.size, label=look.label)
        beside = row["verdict"] or ("" if low is not None else "no interval" if middle is not None else "no ratio")
        ax.text(1.01, place, beside, color=look.colour, va="center", transform=ax.get_yaxis_transform())
    ax.set_yticks(range(len(rows)), [names.drawn_name(label_of(row), 60) for row in rows.iter_rows(named=True)])
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    linear, (low, high) = 2 * max(rows["margin_percent"].drop_nulls().to_list(), default=5.0), ax.get_xlim()
    ax.set_xscale("symlog", linthresh=linear, linscale=1.5)
    sizes = np.array([linear / 4, linear / 2, *linear * 2.0 ** np.arange(12)])
    ax.set_xticks([one for one in (0.0, *sizes, *-sizes) if low <= one <= high])
    ax.xaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.set_xlim(low, high)
    ax.set_xlabel(f"B over A, less 1 (%), logarithmic beyond ±{linear:g} %")
    style.legend_above(figure, style.legend_entries([ax]), 4)
    return figure


COMPARISON = style.Drawing(
    ("experiment", "quantity", *RATIO, "verdict"),
    draw_comparison,
    about=lambda _: (
        "Ratios of the quantities of campaign B to those of campaign A, less 1, with 95 % intervals. Grey: the "
        "margin, where one is stated. Equivalent: the whole interval lies within the margin. Different: it lies wholly "
        "beyond it on one side. Quantities without a ratio are not drawn."
    ),
)
