"""Drawings of no trials: Fig. 8, requested gains, two campaigns, and why a figure is missing."""

import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator, PercentFormatter

from osl_analysis.figures import columns_of, marks, names, style
from osl_analysis.judge.two_campaigns import RATIO, label_of

# Fig. 8

AS_PRINTED = 1e-9  # phases are compared so closely


def fig8_points(gains: pl.DataFrame, stance_share: float = 0.62) -> pl.DataFrame:
    """The desired impedance and the gains in stance.

    Parameters
    ----------
    gains : DataFrame
        Over `phase` of the gait cycle.
    stance_share : float
        Stance is so much of the gait cycle. In swing the walking controller renders no impedance
        (Section IV).
    """
    return gains.select(columns_of("fig8")).filter(pl.col("phase") <= stance_share + AS_PRINTED)


def fig8_caption(table: pl.DataFrame) -> str:
    """What Fig. 8 shows."""
    sentences = [
        "Desired (a) stiffness $K_d$ and (b) damping $B_d$ of the joint over stance. An impedance"
        " is defined in stance only."
    ]
    if names.has_values(table, "trajectory"):
        sentences.append("Above stands what the trajectory says of itself.")
    if names.has_values(table, "K_1_joint"):
        sentences.append(
            "Dashed: the gains at the actuator's output that render it, times $n_T^2$."
        )
    return " ".join(sentences)


@style.drawing(columns_of("fig8"), fig8_points, needs=columns_of("fig8"), caption=fig8_caption)
def draw_fig8(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping over stance: desired, and the gain."""
    kind = table["trajectory"][0]
    title = "" if kind is None else f"Trajectory: {names.drawn_name(kind)}"
    figure, (stiffness, damping) = style.panels(
        style.SINGLE_COLUMN, 3.0, rows=2, titles=[title], share_x=True
    )
    draw_gain(stiffness, table, "K")
    stiffness.set_ylabel("Stiffness (N·m/rad)")
    draw_gain(damping, table, "B")
    damping.set_ylabel("Damping (N·m·s/rad)")
    damping.set_xlabel("Stance (% of the gait cycle)")
    damping.xaxis.set_major_locator(MultipleLocator(0.1))
    damping.xaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0, symbol=""))
    figure.align_ylabels()
    return figure


def draw_gain(ax: Axes, table: pl.DataFrame, symbol: str) -> None:
    """K or B: desired, and the gain at the joint where it is known, from 0 on."""
    ax.plot(table["phase"], table[f"{symbol}_d"], color=style.BLACK, label=f"Desired ${symbol}_d$")
    gain = f"{symbol}_1_joint"
    if names.has_values(table, gain):
        ax.plot(
            table["phase"], table[gain],
            color=style.ORANGE, linewidth=1.3, linestyle=(0, (5, 1.5)),
            label=f"Gain ${symbol}_1\\,n_T^2$",
        )  # fmt: skip
    ax.update_datalim([(table["phase"][0], 0)])
    ax.margins(x=0)
    ax.legend(loc="best")


# gain_grid

# a line style, a marker and a shade each: 60 lines differ in one of them
GRID_DASHES = ("-", "--", ":", "-.")
GRID_MARKERS = ("o", "s", "^", "D", "v")
GRID_SHADES = (style.BLACK, style.GREY, "#A8A8A8")


@style.drawing(("K_d", "B_d", "B_1_joint"))
def draw_gain_grid(table: pl.DataFrame) -> Figure:
    """B_1 n_T^2 over K_d, a line per B_d."""
    figure, (ax,) = style.panels(style.SINGLE_COLUMN, 2.7)
    for number, rows in enumerate(table.partition_by("B_d", maintain_order=True)):
        rounds, dash = divmod(number, len(GRID_DASHES))
        ax.plot(
            rows["K_d"], rows["B_1_joint"],
            linestyle=GRID_DASHES[dash], marker=GRID_MARKERS[number % len(GRID_MARKERS)],
            color=GRID_SHADES[rounds % len(GRID_SHADES)], markersize=2.8, linewidth=0.8,
            label=f"{rows['B_d'][0]:g}",
        )  # fmt: skip
    ax.set_xlabel(names.AXIS_LABELS["K_d"])
    ax.set_ylabel("Gain $B_1 n_T^2$ (N·m·s/rad)")
    figure.legend(
        title=names.AXIS_LABELS["B_d"], loc="outside upper center", ncols=5, columnspacing=1.2
    )
    return figure


# not_drawn

LINE = 0.16  # height of a line of text [in]


@style.drawing(("figure", "trial", "file", "reason"))
def draw_not_drawn(table: pl.DataFrame) -> Figure:
    """Which figure is missing, and because of which trials and files."""
    lines: list[str] = []
    for trial, file, reason in table.select("trial", "file", "reason").iter_rows():
        cause = f"trial {trial}: {reason}" if trial else f"{file}: {reason}"
        lines += textwrap.wrap(cause, int(style.DOUBLE_COLUMN * style.LETTERS_PER_INCH))
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 0.6 + LINE * len(lines)))
    title = f"{names.figure_title(table['figure'][0])} is not drawn"
    figure.text(0.02, 0.95, title, color=style.BLACK, fontsize=11, va="top")
    below = 1 - 0.4 / figure.get_figheight()
    reasons = names.with_glyphs("\n".join(lines))
    figure.text(0.02, below, reasons, color=style.GREY, va="top", parse_math=False)
    return figure


# comparison

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
