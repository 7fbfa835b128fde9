"""Fig. 9: stiffness, damping and inertia of the ankle at midstance while walking."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.style import BLACK, PALE_ORANGE, SINGLE_COLUMN, panels, paper_style

SUMMARY = ("quantity", "n", "mean", "sd")
COLUMNS = (*SUMMARY, "n_doubtful", "commanded")
QUANTITIES = ("K", "B", "I")
LABELS = {
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Inertia $\hat{I}$ (kg·m$^2$)",
}
PER_PERTURBATION = "mean of perturbations"
"""Estimator whose mean and scatter are drawn, where the table has a column `estimator`."""


def points(walking_summary: pl.DataFrame, commanded_K: float | None) -> pl.DataFrame:
    """Mean and SD over the perturbations of K, B and I, with the commanded stiffness [N*m/rad] if it is known.

    `n_doubtful` is taken where the table has it: in how many of the perturbations the fit is doubtful.

    Raises
    ------
    InputError
        A quantity is not in the table.
    """
    table = walking_summary
    if "estimator" in table.columns:
        table = table.filter(pl.col("estimator") == PER_PERTURBATION)
    absent = [q for q in QUANTITIES if q not in table["quantity"]]
    if absent:
        raise InputError(
            f"the walking summary has no '{absent[0]}' over perturbations, which Fig. 9 draws; fit the crossings again"
        )
    commanded = pl.when(pl.col("quantity") == "K").then(pl.lit(commanded_K, pl.Float64)).alias("commanded")
    rows = pl.concat([table.filter(pl.col("quantity") == q) for q in QUANTITIES])
    if "n_doubtful" not in rows.columns:
        rows = rows.with_columns(n_doubtful=pl.lit(None, pl.Int64))
    return rows.with_columns(commanded).select(COLUMNS)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: bars with one SD on either side of the mean, the commanded stiffness dashed.

    Below stands how many perturbations there are, and how many of the fits are doubtful, if any.
    """
    figure, axes = panels(SINGLE_COLUMN, 2.0, columns=3)
    for ax, row in zip(axes, table.iter_rows(named=True), strict=True):
        draw_bar(ax, row["mean"], row["sd"], row["commanded"])
        ax.set_ylabel(LABELS[row["quantity"]])
    commanded = "; dashed: commanded" if table["commanded"].count() else ""
    doubtful = f" ({table['n_doubtful'][0]:g} doubtful)" if table["n_doubtful"][0] else ""
    figure.supxlabel(f"Mean ± 1 SD over {table['n'][0]} perturbations{doubtful}{commanded}", fontsize=8)
    return figure


def draw_bar(ax: Axes, mean: float, sd: float | None, commanded: float | None) -> None:
    """One mean as a bar from zero, with its scatter and, where it is known, the commanded value."""
    ax.bar([0], [mean], width=0.8, color=PALE_ORANGE, edgecolor=BLACK, linewidth=0.6)
    if sd is not None:
        ax.errorbar([0], [mean], yerr=[sd], color=BLACK, linewidth=0.8, capsize=3, capthick=0.8)
    if commanded is not None:
        ax.axhline(commanded, color=BLACK, linestyle=(0, (3, 2)), linewidth=0.8)
    ax.axhline(0, color=BLACK, linewidth=0.6)
    ax.set_xlim(-0.9, 0.9)
    ax.set_xticks([])
