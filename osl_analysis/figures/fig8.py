"""Fig. 8: desired impedance over stance and the control gains that render it."""

import polars as pl
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator, PercentFormatter

from osl_analysis.figures.names import as_text, drawn_name
from osl_analysis.figures.style import BLACK, ORANGE, SINGLE_COLUMN, panels, paper_style

GAINS = ("K_1_joint", "B_1_joint")
TABLE_COLUMNS = COLUMNS = ("phase", "trajectory", "K_d", "B_d", *GAINS)
NO_GAINS = "There are no gains, because the configuration names no parameter file."


def points(gains: pl.DataFrame, stance_share: float = 0.62) -> pl.DataFrame:
    """Desired impedance, and gains times the square of the belt's ratio, over `phase` of the gait cycle in stance.

    Stance is the first `stance_share` of the cycle, 0.62 where it is not stated. In swing the walking controller
    renders no impedance (Section IV): what the trajectory's file has there is not shown.
    """
    return gains.select(COLUMNS).filter(pl.col("phase") <= stance_share + 1e-9)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: desired black, gain dashed; above, what the trajectory says of itself."""
    figure, axes = panels(SINGLE_COLUMN, 3.0, rows=2)
    kind = table["trajectory"][0]
    if kind is not None:
        axes[0].set_title(f"(a) Trajectory: {drawn_name(kind)}", loc="left")
    for ax, desired, gain, word in zip(axes, ("K_d", "B_d"), ("K_1", "B_1"), ("Stiffness", "Damping"), strict=True):
        ax.plot(table["phase"], table[desired], color=BLACK, label=f"Desired ${desired}$")
        gains = table[f"{gain}_joint"]
        if gains.count():
            dashes = (0, (5, 1.5))
            ax.plot(
                table["phase"], gains, color=ORANGE, linestyle=dashes, linewidth=1.3, label=f"Gain ${gain}\\,n_T^2$"
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


def caption(table: pl.DataFrame) -> str:
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
