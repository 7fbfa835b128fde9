"""Fig. 9: stiffness, damping and inertia of the ankle at midstance while walking."""

from itertools import product

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.names import drawn_name
from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, PALE_ORANGE, PURPLE, SINGLE_COLUMN, panels, paper_style

TABLE_COLUMNS = ("group", "quantity", "estimator", "n", "mean", "sd", "low", "high", "n_doubtful", "commanded")
COLUMNS = (
    "group", "quantity", "n", "mean", "sd", "n_doubtful", "ensemble", "ensemble_low", "ensemble_high", "commanded"
)  # fmt: skip
QUANTITIES = ("K", "B", "I")
LABELS = {
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Inertia $\hat{I}$ (kg·m$^2$)",
}
PER_PERTURBATION, ENSEMBLE = "mean of perturbations", "ensemble"
"""Estimators whose mean and scatter, and whose interval, are drawn."""
BESIDE, GROUP_WIDTH = 0.65, 1.8
"""Distances on the axis from a bar to the ensemble's estimate, and from group to group."""


def points(walking_summary: pl.DataFrame, commanded_K: float | None = None) -> pl.DataFrame:
    """A row for each group and each of K, B and I: mean and SD over the perturbations, the ensemble's estimate with its
    95 % interval.

    `commanded_K` [N*m/rad] is the stiffness that the walking controller commands, if it is known; it is for a campaign
    of one group whose sheet states none. `n_doubtful` is the number of perturbations whose fit is doubtful. Groups
    without a result are not drawn.

    Raises
    ------
    InputError
        A quantity is not in the table.
    """
    summary = walking_summary.select(TABLE_COLUMNS).filter(pl.col("mean").is_not_null())
    rows = {(r["group"], r["estimator"], r["quantity"]): r for r in summary.iter_rows(named=True)}
    groups = list(dict.fromkeys(group for group, _, _ in rows)) or [""]
    found = []
    for group, quantity in product(groups, QUANTITIES):
        for estimator in (PER_PERTURBATION, ENSEMBLE):
            if (group, estimator, quantity) not in rows:
                raise InputError(
                    f"the walking summary has no '{quantity}' by the estimator '{estimator}', which Fig. 9 draws; fit "
                    "the crossings again"
                )
        mean, ensemble = (rows[group, estimator, quantity] for estimator in (PER_PERTURBATION, ENSEMBLE))
        commanded = commanded_K if quantity == "K" and len(groups) == 1 else None
        beside = {"ensemble": ensemble["mean"], "ensemble_low": ensemble["low"], "ensemble_high": ensemble["high"]}
        stated = commanded if ensemble["commanded"] is None else ensemble["commanded"]
        found.append({**mean, **beside, "commanded": stated})
    return pl.DataFrame(found, schema_overrides={"commanded": pl.Float64, "sd": pl.Float64}).select(COLUMNS)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: bars with one SD on either side of the mean, beside them the fit to the mean response with
    its 95 % interval, commanded values dashed. Several groups stand side by side.

    A line below gives the number of perturbations and, if there are any, of doubtful fits.
    """
    groups = table["group"].unique(maintain_order=True).to_list()
    single = len(groups) == 1
    figure, axes = panels(SINGLE_COLUMN if single else DOUBLE_COLUMN, 2.3 if single else 2.9, columns=3)
    for ax, quantity in zip(axes, QUANTITIES, strict=True):
        rows = table.filter(pl.col("quantity") == quantity).to_dicts()
        for number, row in enumerate(rows):
            at = number * GROUP_WIDTH
            draw_bar(ax, at, row["mean"], row["sd"])
            draw_ensemble(ax, at + BESIDE, *(row[name] for name in ("ensemble", "ensemble_low", "ensemble_high")))
            draw_commanded(ax, at, row["commanded"])
        ax.axhline(0, color=BLACK, linewidth=0.6)
        ax.set_xlim(-0.7, (len(rows) - 1) * GROUP_WIDTH + 1.0)
        ax.set_xticks([] if single else [n * GROUP_WIDTH + BESIDE / 2 for n in range(len(rows))])
        if not single:
            ax.set_xticklabels([tick(row) for row in rows], rotation=35, ha="right", rotation_mode="anchor")
        ax.set_ylabel(LABELS[quantity])
    labels = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    figure.legend(list(labels.values()), list(labels), loc="outside upper center", ncols=2)
    figure.supxlabel(said_below(table, single), fontsize=8)
    return figure


def tick(row: dict[str, object]) -> str:
    """Name of a group for the axis, with its number of perturbations."""
    name = drawn_name(str(row["group"]), 60).replace("K_d", "$K_d$").replace("B_d", "$B_d$")
    return f"{name} ({row['n']})"


def said_below(table: pl.DataFrame, single: bool) -> str:
    """What the line below the panels says."""
    one = table.filter(pl.col("quantity") == QUANTITIES[0])
    commanded = "; dashed: commanded" if table["commanded"].count() else ""
    count = one["n_doubtful"].sum()
    doubtful = f" ({count:g} doubtful)" if count else ""
    several = "" if single else f", in {len(one)} groups (number of each in brackets)"
    return f"{one['n'].sum():g} perturbations{several}{doubtful}{commanded}"


def draw_bar(ax: Axes, at: float, mean: float, sd: float | None) -> None:
    """One mean as a bar from zero, with its scatter."""
    ax.bar([at], [mean], width=0.8, color=PALE_ORANGE, edgecolor=BLACK, linewidth=0.6, label="Mean ± SD of fits")
    if sd is not None:
        ax.errorbar([at], [mean], yerr=[sd], color=BLACK, linewidth=0.8, capsize=3, capthick=0.8)


def draw_ensemble(ax: Axes, at: float, value: float, low: float, high: float) -> None:
    """The fit to the mean response, with its interval. Its bounds are percentiles: the estimate may lie outside."""
    label, middle = "Fit of mean response, 95 %", (low + high) / 2
    ax.errorbar([at], [middle], yerr=[(high - low) / 2], fmt="none", color=PURPLE, linewidth=0.8, capsize=2)
    ax.plot([at], [value], "D", color=PURPLE, markersize=2.8, label=label)


def draw_commanded(ax: Axes, at: float, commanded: float | None) -> None:
    """The commanded value across one group, where it is known."""
    if commanded is not None:
        ax.plot([at - 0.6, at + 0.9], [commanded] * 2, color=BLACK, linestyle=(0, (3, 2)), linewidth=0.8)
