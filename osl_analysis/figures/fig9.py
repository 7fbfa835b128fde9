"""Fig. 9: stiffness, damping and inertia of the ankle at midstance while walking."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.style import BLACK, PALE_ORANGE, PURPLE, SINGLE_COLUMN, panels, paper_style

TABLE_COLUMNS = ("quantity", "estimator", "n", "mean", "sd", "low", "high", "n_doubtful")
COLUMNS = ("quantity", "n", "mean", "sd", "n_doubtful", "ensemble", "ensemble_low", "ensemble_high", "commanded")
QUANTITIES = ("K", "B", "I")
LABELS = {
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Inertia $\hat{I}$ (kg·m$^2$)",
}
PER_PERTURBATION, ENSEMBLE = "mean of perturbations", "ensemble"
"""Estimators whose mean and scatter, and whose interval, are drawn."""
BAR, BESIDE = 0.0, 0.65
"""Places of the bar and of the ensemble's estimate on the axis."""


def points(walking_summary: pl.DataFrame, commanded_K: float | None = None) -> pl.DataFrame:
    """A row for each of K, B and I: mean and SD over the perturbations, the ensemble's estimate with its 95 % interval.

    `commanded_K` [N*m/rad] is the stiffness that the walking controller commands, if it is known. `n_doubtful` is the
    number of perturbations whose fit is doubtful.

    Raises
    ------
    InputError
        A quantity is not in the table.
    """
    rows = {(r["estimator"], r["quantity"]): r for r in walking_summary.select(TABLE_COLUMNS).iter_rows(named=True)}
    for key in ((estimator, quantity) for estimator in (PER_PERTURBATION, ENSEMBLE) for quantity in QUANTITIES):
        if key not in rows:
            raise InputError(
                f"the walking summary has no '{key[1]}' by the estimator '{key[0]}', which Fig. 9 draws; fit the "
                "crossings again"
            )
    found = []
    for quantity in QUANTITIES:
        mean, ensemble = rows[PER_PERTURBATION, quantity], rows[ENSEMBLE, quantity]
        commanded = commanded_K if quantity == "K" else None
        beside = {"ensemble": ensemble["mean"], "ensemble_low": ensemble["low"], "ensemble_high": ensemble["high"]}
        found.append({**mean, **beside, "commanded": commanded})
    return pl.DataFrame(found, schema_overrides={"commanded": pl.Float64, "sd": pl.Float64}).select(COLUMNS)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: bars with one SD on either side of the mean, beside them the fit to the mean response with
    its 95 % interval, the commanded stiffness dashed.

    A line below gives the number of perturbations and, if there are any, of doubtful fits.
    """
    figure, axes = panels(SINGLE_COLUMN, 2.3, columns=3)
    for ax, row in zip(axes, table.iter_rows(named=True), strict=True):
        draw_bar(ax, row["mean"], row["sd"])
        draw_ensemble(ax, *(row[name] for name in ("ensemble", "ensemble_low", "ensemble_high")))
        draw_lines(ax, row["commanded"])
        ax.set_ylabel(LABELS[row["quantity"]])
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    commanded = "; dashed: commanded" if table["commanded"].count() else ""
    doubtful = f" ({table['n_doubtful'][0]:g} doubtful)" if table["n_doubtful"][0] else ""
    figure.supxlabel(f"{table['n'][0]} perturbations{doubtful}{commanded}", fontsize=8)
    return figure


def draw_bar(ax: Axes, mean: float, sd: float | None) -> None:
    """One mean as a bar from zero, with its scatter."""
    ax.bar([BAR], [mean], width=0.8, color=PALE_ORANGE, edgecolor=BLACK, linewidth=0.6, label="Mean ± SD of fits")
    if sd is not None:
        ax.errorbar([BAR], [mean], yerr=[sd], color=BLACK, linewidth=0.8, capsize=3, capthick=0.8)


def draw_ensemble(ax: Axes, value: float, low: float, high: float) -> None:
    """The fit to the mean response, with its interval. Its bounds are percentiles: the estimate may lie outside."""
    label, middle = "Fit of mean response, 95 %", (low + high) / 2
    ax.errorbar([BESIDE], [middle], yerr=[(high - low) / 2], fmt="none", color=PURPLE, linewidth=0.8, capsize=2)
    ax.plot([BESIDE], [value], "D", color=PURPLE, markersize=2.8, label=label)


def draw_lines(ax: Axes, commanded: float | None) -> None:
    """Zero and, where it is known, the commanded value."""
    if commanded is not None:
        ax.axhline(commanded, color=BLACK, linestyle=(0, (3, 2)), linewidth=0.8)
    ax.axhline(0, color=BLACK, linewidth=0.6)
    ax.set_xlim(-0.7, 1.0)
    ax.set_xticks([])
