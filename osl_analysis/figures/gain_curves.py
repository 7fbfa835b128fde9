"""Fig. 8 and `gain_grid`: control gains over stance, and over desired impedances."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator, PercentFormatter

from osl_analysis.config.impedance_trajectory import STANCE_SHARE
from osl_analysis.figures import columns_of, names, style

# Fig. 8

AS_PRINTED = 1e-9  # phases are compared so closely


def fig8_points(gains: pl.DataFrame) -> pl.DataFrame:
    """The desired impedance and the gains in stance: in swing the walking controller renders no
    impedance (Section IV)."""
    return gains.select(columns_of("fig8")).filter(pl.col("phase") <= STANCE_SHARE + AS_PRINTED)


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
