"""Drawings of no trials: a single fit, requested gains, Fig. 8, the study, and why a figure is missing."""

import textwrap
from collections.abc import Sequence

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator, PercentFormatter

from osl_analysis.figures import style
from osl_analysis.figures.names import as_text, drawn_name, figure_title, with_glyphs

GAINS = ("K_1_joint", "B_1_joint")
FIG8_COLUMNS = ("phase", "trajectory", "K_d", "B_d", *GAINS)
NO_GAINS = "There are no gains, because the configuration names no parameter file."


def fig8_points(gains: pl.DataFrame, stance_share: float = 0.62) -> pl.DataFrame:
    """Desired impedance, and gains times the square of the belt's ratio, over `phase` of the gait cycle in stance, its
    first `stance_share`. In swing the walking controller renders no impedance (Section IV)."""
    return gains.select(FIG8_COLUMNS).filter(pl.col("phase") <= stance_share + 1e-9)


@style.paper_style()
def draw_fig8(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: desired black, gain dashed; above, what the trajectory says of itself."""
    figure, axes = style.panels(style.SINGLE_COLUMN, 3.0, rows=2)
    kind = table["trajectory"][0]
    if kind is not None:
        axes[0].set_title(f"(a) Trajectory: {drawn_name(kind)}", loc="left")
    for ax, desired, gain, word in zip(axes, ("K_d", "B_d"), ("K_1", "B_1"), ("Stiffness", "Damping"), strict=True):
        ax.plot(table["phase"], table[desired], color=style.BLACK, label=f"Desired ${desired}$")
        gains = table[f"{gain}_joint"]
        if gains.count():
            dashes = (0, (5, 1.5))
            ax.plot(
                table["phase"],
                gains,
                color=style.ORANGE,
                linestyle=dashes,
                linewidth=1.3,
                label=f"Gain ${gain}\\,n_T^2$",
            )
        ax.update_datalim([(table["phase"][0], 0)])
        ax.margins(x=0)
        ax.legend(loc="best")
        ax.set_ylabel(f"{word} ({'N·m/rad' if desired == 'K_d' else 'N·m·s/rad'})")
    axes[1].set_xlabel("Stance (% of the gait cycle)")
    axes[1].xaxis.set_major_locator(MultipleLocator(0.1))
    axes[1].xaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0, symbol=""))
    figure.align_ylabels()
    return figure


def fig8_caption(table: pl.DataFrame) -> str:
    kind, end = table["trajectory"][0], 100 * float(table["phase"].max())  # type: ignore[arg-type]
    whose = {
        None: "The trajectory's file does not say of what kind it is.",
        "synthetic": "The trajectory is synthetic: neither measured nor that of a published walking controller.",
    }.get(kind, f"Kind of the trajectory: {as_text(kind or '')}.")
    said = (
        f"Desired stiffness $K_d$ (a) and damping $B_d$ (b) of the joint over stance, the first {end:.0f} % of the "
        f"gait cycle. {whose} Desired: {reach(table, 'K_d')} N·m/rad and {reach(table, 'B_d')} N·m·s/rad. An "
        "impedance is defined in stance only."
    )
    if not table.select(GAINS).count().sum_horizontal()[0]:
        return f"{said} {NO_GAINS}"
    return (
        f"{said} Dashed: the gains at the actuator's output that render it, times $n_T^2$; $K_1 n_T^2$ is "
        f"{reach(table, 'K_1_joint')} N·m/rad, $B_1 n_T^2$ is {reach(table, 'B_1_joint')} N·m·s/rad."
    )


def reach(table: pl.DataFrame, column: str) -> str:
    values = table[column].drop_nulls()
    return f"{values.min():.3g} to {values.max():.3g}".replace("-", "−")  # type: ignore[str-bytes-safe]


GRID_DASHES = ("-", "--", ":", "-.")
GRID_MARKERS = ("o", "s", "^", "D", "v")
GRID_SHADES = (style.BLACK, style.GREY, "#A8A8A8")
"""A line style, a marker and a shade each: 60 lines differ in one of them."""
CHARACTERS_PER_INCH = 17  # of the text of a page in place of a figure


@style.paper_style()
def draw_torque(table: pl.DataFrame) -> Figure:
    """Torque [N*m] over time [s], measured and modelled, above the residual: `time`, `torque`, `torque_model`."""
    figure, (torque, residual) = style.panels(style.DOUBLE_COLUMN, 3.4, rows=2)
    torque.plot(table["time"], table["torque"], color=style.BLACK, linewidth=0.8, label="Measured")
    torque.plot(table["time"], table["torque_model"], "--", color="#0072B2", linewidth=0.8, label="Fitted model")
    residual.plot(table["time"], table["torque"] - table["torque_model"], color=style.BLACK, linewidth=0.5)
    torque.set_ylabel("Torque (N·m)")
    torque.legend(loc="upper left", ncols=2)
    residual.set_ylabel("Residual (N·m)")
    residual.set_xlabel("Time (s)")
    return figure


@style.paper_style()
def draw_gain_grid(table: pl.DataFrame) -> Figure:
    """B_1 n_T^2 over K_d, a line per B_d: `K_d`, `B_d`, `B_1_joint`."""
    figure, (ax,) = style.panels(style.SINGLE_COLUMN, 2.7)
    for i, (B_d, rows) in enumerate(table.group_by("B_d", maintain_order=True)):
        marker, colour = GRID_MARKERS[i % len(GRID_MARKERS)], GRID_SHADES[i // len(GRID_DASHES) % len(GRID_SHADES)]
        ax.plot(
            rows["K_d"], rows["B_1_joint"], GRID_DASHES[i % len(GRID_DASHES)], color=colour, marker=marker,
            markersize=2.8, linewidth=0.8, label=f"{B_d[0]:g}",
        )  # fmt: skip
    ax.set_xlabel("Desired stiffness $K_d$ (N·m/rad)")
    ax.set_ylabel("Gain $B_1 n_T^2$ (N·m·s/rad)")
    figure.legend(title="Desired damping $B_d$ (N·m·s/rad)", loc="outside upper center", ncols=5, columnspacing=1.2)
    return figure


@style.paper_style()
def draw_reasons(table: pl.DataFrame) -> Figure:
    """Which figure is missing, and because of which trials and files: `figure`, `trial`, `file`, `reason` per cause."""
    causes = [f"trial {row['trial']}: {row['reason']}" if row["trial"] else f"{row['file']}: {row['reason']}"
              for row in table.iter_rows(named=True)]  # fmt: skip
    lines = [line for cause in causes for line in textwrap.wrap(cause, int(style.DOUBLE_COLUMN * CHARACTERS_PER_INCH))]
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 0.6 + 0.16 * len(lines)))
    figure.text(
        0.02, 0.95, f"{figure_title(table['figure'][0])} is not drawn", color=style.BLACK, fontsize=11, va="top"
    )
    below = 1 - 0.4 / figure.get_figheight()
    figure.text(0.02, below, with_glyphs("\n".join(lines)), color=style.GREY, va="top", parse_math=False)
    return figure


QUANTITY_LOOKS = {
    "K": (style.ORANGE, "o"),
    "B": (style.PURPLE, "D"),
    "I": (style.BLACK, "s"),
    "f_C": (style.GREY, "^"),
    "f_G": (style.GREY, "v"),
}
SAME_AS = {"K_s": "K", "B_j": "B", "J_j": "I", "k_tau_n_m": "K", "B_m": "B", "J_m": "I"}
SAME_AS |= {"magnitude": "K", "phase": "B"}
BELOW_ROW = {"K": -0.22, "B": 0.0, "I": 0.22, "f_C": -0.11, "f_G": 0.11}
"""Distance of each marker below the line of its row."""
SYMBOLS = {
    "K": r"$K$, $K_s$, $|Y|$, $k_\tau n_m$", "B": r"$B$, $B_j$, $B_m$, arg $Y$", "I": "$I$, $J_j$, $J_m$",
    "f_C": "$f_C$", "f_G": "$f_G$",
}  # fmt: skip
"""What each marker stands for."""
LIMITS = {"bias": (-1.2, 1.2), "rmse_over_bound": (0.8, 1.6), "coverage": (80.0, 101.0)}
ARROWS = (">", "<")  # arrows for values above and below the limits
BOUNDS = {"bias": np.inf, "rmse_over_bound": np.inf, "coverage": 100.0}  # values beyond which nothing can be
AIMS = {"bias": (-0.2, 0.2), "rmse_over_bound": (0.0, 1.15), "coverage": (93.0, 97.0)}
MEASURES = {
    "bias": "Bias (standard deviations)",
    "rmse_over_bound": "RMSE / Cramér–Rao bound",
    "coverage": "Coverage of 95 % intervals (%)",
}
RowKey = tuple[str, ...]


@style.paper_style()
def draw_study(table: pl.DataFrame) -> Figure:
    """A row per experiment, estimator and interval, a marker per quantity with two Monte Carlo errors."""
    keys = headed(table.select("experiment", "estimator", "interval_method").unique(maintain_order=True))
    figure, axes = style.panels(style.DOUBLE_COLUMN, 0.9 + 0.155 * len(keys), columns=3)
    table = table.with_columns(pl.col("coverage") * 100, pl.col("coverage_mc") * 100)
    for ax, column in zip(axes, MEASURES, strict=True):
        draw_measure(ax, table, keys, column)
        ax.set_yticks(range(len(keys)), [])
    long = {"unperturbed crossings": "gait", "unperturbed crossings + plate trials": "gait + plate"}
    labels = [k[0].replace(" us", " µs") if len(k) == 1 else f"{k[1]}, {long.get(k[2], k[2])}" for k in keys]
    axes[0].set_yticklabels(labels)
    for text, key in zip(axes[0].get_yticklabels(), keys, strict=True):
        text.set_fontweight("bold" if len(key) == 1 else "normal")
    seen = {SAME_AS.get(name, name) for name in (q.partition(",")[0] for q in table["quantity"])}
    handles = [
        Line2D([], [], color=c, marker=m, linestyle="", label=SYMBOLS[q])
        for q, (c, m) in QUANTITY_LOOKS.items()
        if q in seen
    ]
    handles.append(
        Line2D([], [], color=style.GREY, marker=ARROWS[0], markersize=3, linestyle="", label="Beyond the panel")
    )
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def headed(rows: pl.DataFrame) -> list[RowKey]:
    """The rows, and before the first of each experiment a row with its name."""
    keys: list[RowKey] = []
    for key in rows.rows():
        if not keys or keys[-1][0] != key[0]:
            keys.append(key[:1])
        keys.append(key)
    return keys


def draw_measure(ax: Axes, table: pl.DataFrame, keys: Sequence[RowKey], column: str) -> None:
    low, high = LIMITS[column]
    ax.axvspan(max(AIMS[column][0], low), AIMS[column][1], color="#E8E8E8", linewidth=0)
    places = {key: place for place, key in enumerate(keys)}
    for row in table.drop_nulls(column).iter_rows(named=True):
        quantity = row["quantity"].partition(",")[0]
        quantity = SAME_AS.get(quantity, quantity)
        colour, marker = QUANTITY_LOOKS[quantity]
        place = places[row["experiment"], row["estimator"], row["interval_method"]] + BELOW_ROW[quantity]
        value, half = float(np.clip(row[column], low, high)), 2 * row[f"{column}_mc"]
        if value == row[column]:
            ends = max(value - half, low), min(value + half, high, BOUNDS[column])
            ax.hlines(place, *ends, color=colour, linewidth=0.6)
        else:
            marker = ARROWS[value > row[column]]
        ax.plot(value, place, marker, color=colour, markersize=2.6, mew=0.6, clip_on=False)
    for place in (place for place, key in enumerate(keys) if len(key) == 1 and place):
        ax.axhline(place - 0.5, color=style.GREY, linewidth=0.4)
    ax.set_xlim(low, high)
    ax.set_ylim(len(keys) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel(MEASURES[column])


FIG8 = style.Drawing(FIG8_COLUMNS, draw_fig8, fig8_caption, fig8_points, FIG8_COLUMNS)
TORQUE = style.Drawing(("time", "torque", "torque_model"), draw_torque)
GAIN_GRID = style.Drawing(("K_d", "B_d", "B_1_joint"), draw_gain_grid)
STUDY = style.Drawing(
    ("experiment", "estimator", "interval_method", "quantity", *(f"{m}{mc}" for m in MEASURES for mc in ("", "_mc"))),
    draw_study,
)
NOT_DRAWN = style.Drawing(("figure", "trial", "file", "reason"), draw_reasons)
