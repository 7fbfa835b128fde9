"""Drawings of no trials: a single fit, requested gains, Fig. 8, two campaigns, and why a figure is
missing."""

import textwrap
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator, PercentFormatter

from osl_analysis.figures import columns_of, names, style
from osl_analysis.judge.two_campaigns import RATIO, label_of


def fig8_points(gains: pl.DataFrame, stance_share: float = 0.62) -> pl.DataFrame:
    """Desired impedance, and gains times the square of the belt's ratio, over `phase` of the gait
    cycle in stance, its first `stance_share`. In swing the walking controller renders no impedance
    (Section IV)."""
    return gains.select(columns_of("fig8")).filter(pl.col("phase") <= stance_share + 1e-9)


@style.drawing(columns_of("fig8"), fig8_points, columns_of("fig8"))
def draw_fig8(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: desired black, gain dashed; above, what the trajectory says of
    itself."""
    figure, axes = style.panels(style.SINGLE_COLUMN, 3.0, rows=2)
    kind = table["trajectory"][0]
    if kind is not None:
        axes[0].set_title(f"(a) Trajectory: {names.drawn_name(kind)}", loc="left", y=1)
    for ax, symbol, name in zip(
        axes, "KB", ("Stiffness (N·m/rad)", "Damping (N·m·s/rad)"), strict=True
    ):
        ax.plot(
            table["phase"], table[f"{symbol}_d"], color=style.BLACK, label=f"Desired ${symbol}_d$"
        )
        gains = table[f"{symbol}_1_joint"]
        if gains.count():
            label, dash = f"Gain ${symbol}_1\\,n_T^2$", (0, (5, 1.5))
            ax.plot(
                table["phase"],
                gains,
                color=style.ORANGE,
                linestyle=dash,
                linewidth=1.3,
                label=label,
            )
        ax.update_datalim([(table["phase"][0], 0)])
        ax.margins(x=0)
        ax.legend(loc="best")
        ax.set_ylabel(name)
    axes[1].set_xlabel("Stance (% of the gait cycle)")
    axes[1].xaxis.set_major_locator(MultipleLocator(0.1))
    axes[1].xaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0, symbol=""))
    figure.align_ylabels()
    return figure


@style.drawing(("time", "torque", "torque_model"))
def draw_torque(table: pl.DataFrame) -> Figure:
    """Torque [N*m] over time [s], measured and modelled, above the residual: `time`, `torque`,
    `torque_model`."""
    figure, (torque, residual) = style.panels(style.DOUBLE_COLUMN, 3.4, rows=2)
    torque.plot(table["time"], table["torque"], color=style.BLACK, linewidth=0.8, label="Measured")
    torque.plot(
        table["time"],
        table["torque_model"],
        "--",
        color="#0072B2",
        linewidth=0.8,
        label="Fitted model",
    )
    residual.plot(
        table["time"], table["torque"] - table["torque_model"], color=style.BLACK, linewidth=0.5
    )
    torque.set_ylabel("Torque (N·m)")
    torque.legend(loc="upper left", ncols=2)
    residual.set_ylabel("Residual (N·m)")
    residual.set_xlabel("Time (s)")
    return figure


@style.drawing(("K_d", "B_d", "B_1_joint"))
def draw_gain_grid(table: pl.DataFrame) -> Figure:
    """B_1 n_T^2 over K_d, a line per B_d: `K_d`, `B_d`, `B_1_joint`."""
    # a line style, a marker and a shade each: 60 lines differ in one of them
    dashes, markers, shades = (
        ("-", "--", ":", "-."),
        ("o", "s", "^", "D", "v"),
        (style.BLACK, style.GREY, "#A8A8A8"),
    )
    figure, (ax,) = style.panels(style.SINGLE_COLUMN, 2.7)
    for i, (B_d, rows) in enumerate(table.group_by("B_d", maintain_order=True)):
        look: dict[str, Any] = {
            "marker": markers[i % 5],
            "color": shades[i // 4 % 3],
            "label": f"{B_d[0]:g}",
        }
        ax.plot(
            rows["K_d"], rows["B_1_joint"], dashes[i % 4], markersize=2.8, linewidth=0.8, **look
        )
    ax.set_xlabel("Desired stiffness $K_d$ (N·m/rad)")
    ax.set_ylabel("Gain $B_1 n_T^2$ (N·m·s/rad)")
    figure.legend(
        title="Desired damping $B_d$ (N·m·s/rad)",
        loc="outside upper center",
        ncols=5,
        columnspacing=1.2,
    )
    return figure


@style.drawing(("figure", "trial", "file", "reason"))
def draw_not_drawn(table: pl.DataFrame) -> Figure:
    """Which figure is missing, and because of which trials and files: `figure`, `trial`, `file`,
    `reason` per cause."""
    lines: list[str] = []
    for trial, file, reason in table.select("trial", "file", "reason").iter_rows():
        cause = f"trial {trial}: {reason}" if trial else f"{file}: {reason}"
        lines += textwrap.wrap(cause, int(style.DOUBLE_COLUMN * 17))  # letters per inch
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 0.6 + 0.16 * len(lines)))
    title = f"{names.figure_title(table['figure'][0])} is not drawn"
    figure.text(0.02, 0.95, title, color=style.BLACK, fontsize=11, va="top")
    below = 1 - 0.4 / figure.get_figheight()
    figure.text(
        0.02,
        below,
        names.with_glyphs("\n".join(lines)),
        color=style.GREY,
        va="top",
        parse_math=False,
    )
    return figure


VERDICT_LOOKS = {
    "equivalent": style.Look(style.PURPLE, "o", 4.2, "Equivalent"),
    "different": style.Look(style.ORANGE, "D", 3.8, "Different"),
    "undecided": style.Look(style.GREY, "s", 3.8, "Undecided"),
    None: style.Look(style.BLACK, "|", 5.0, "Without a verdict"),
}


@style.drawing(("experiment", "quantity", *RATIO, "verdict"))
def draw_comparison(table: pl.DataFrame) -> Figure:
    """A line per ratio, B over A less 1, with its interval, the margin as a band, the verdict
    beside it. The axis is logarithmic beyond twice the largest margin: 40 % of a friction may stand
    beside 0.1 % of a belt."""
    rows = table.drop_nulls("relative_percent")
    rows = table if rows.is_empty() else rows  # without any ratio, lines that say so
    figure, (ax,) = style.panels(style.DOUBLE_COLUMN, 0.75 + 0.19 * len(rows))
    ax.axvline(0, color=style.BLACK, linewidth=0.6, zorder=1)
    for place, row in enumerate(rows.iter_rows(named=True)):
        look, (middle, low, high) = VERDICT_LOOKS[row["verdict"]], (row[name] for name in RATIO)
        if (margin := row["margin_percent"]) is not None:
            ax.fill_betweenx(
                [place - 0.5, place + 0.5], -margin, margin, color="#E4E4E4", linewidth=0, zorder=0
            )
        if low is not None:
            ax.hlines(place, low, high, color=look.colour, linewidth=1.2)
        x = np.nan if middle is None else middle
        ax.plot(x, place, look.marker, color=look.colour, markersize=look.size, label=look.label)
        beside = row["verdict"] or (
            "" if low is not None else "no interval" if middle is not None else "no ratio"
        )
        ax.text(
            1.01, place, beside, color=look.colour, va="center", transform=ax.get_yaxis_transform()
        )
    ax.set_yticks(
        range(len(rows)),
        [names.drawn_name(label_of(row), 60) for row in rows.iter_rows(named=True)],
    )
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    linear, (low, high) = (
        2 * max(rows["margin_percent"].drop_nulls().to_list(), default=5.0),
        ax.get_xlim(),
    )
    ax.set_xscale("symlog", linthresh=linear, linscale=1.5)
    sizes = np.array([linear / 4, linear / 2, *linear * 2.0 ** np.arange(12)])
    ax.set_xticks([one for one in (0.0, *sizes, *-sizes) if low <= one <= high])
    ax.xaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.set_xlim(low, high)
    ax.set_xlabel(f"B over A, less 1 (%), logarithmic beyond ±{linear:g} %")
    style.legend_above(figure, style.legend_entries([ax]), 4)
    return figure
