"""Fig. 9: stiffness, damping and inertia of the ankle while walking, of every perturbation and of their mean."""

import textwrap
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import style
from osl_analysis.figures.names import UNIT_OF, as_text, count_of, doubtful_said, drawn_name, with_interval, with_sd

SUMMARY_NEEDED = ("group", "quantity", "estimator", "n", "mean", "sd", "low", "high", "n_doubtful", "commanded")
"""Columns that `points` needs of `walking_summary.csv`."""
ESTIMATES = ("K", "B", "I")
FIT_COLUMNS = ("trial", "group", *ESTIMATES, "doubtful")  # columns that `points` needs of `walking.csv`
COLUMNS = (
    "group", "quantity", "trial", "estimate", "n", "mean", "sd", "n_doubtful", "ensemble", "ensemble_low",
    "ensemble_high", "commanded", "doubtful",
)  # fmt: skip
AXIS_LABELS = {
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Inertia $\hat{I}$ (kg·m$^2$)",
}
PER_PERTURBATION, BY_ENSEMBLE = "mean of perturbations", "ensemble"
"""Estimators whose mean and scatter, and whose interval, are drawn."""
LEGEND = ("One perturbation", "Mean ± SD", "Fit of mean response, 95 %", "Commanded")
FROM_MIDDLE, MEAN_AT, ENSEMBLE_AT, GROUP_WIDTH = 0.32, 0.55, 0.85, 1.8
"""Distances on the axis: of single estimates from their middle, of the mean and of the ensemble's estimate from there,
and from group to group."""


def points(
    walking_summary: pl.DataFrame, walking: pl.DataFrame, over_stance: pl.DataFrame, commanded_K: float | None = None
) -> pl.DataFrame:
    """For each group and each of K, B and I a row with mean and SD over the perturbations and the ensemble's estimate
    with its 95 % interval, then a row per perturbation with its `estimate`.

    `over_stance` is `impedance_over_stance.csv`. What is commanded comes from the sheet, from `commanded_K` [N*m/rad]
    for K in a campaign of one group, or from the trajectory at the phase that the fit reads. A group without a result
    has only its perturbations.

    Raises InputError: a quantity of a group is not in the summary, or nothing has a result.
    """
    summary = walking_summary.select(SUMMARY_NEEDED).filter(pl.col("mean").is_not_null())
    fits = walking.select(FIT_COLUMNS).drop_nulls("group").filter(pl.all_horizontal(pl.col(ESTIMATES).is_finite()))
    rows = {(r["group"], r["estimator"], r["quantity"]): r for r in summary.iter_rows(named=True)}
    groups = list(dict.fromkeys([*(group for group, _, _ in rows), *fits["group"]]))
    if not groups:
        raise InputError("no perturbation has a fit, which Fig. 9 draws; see the reasons in walking_excluded.csv")
    trajectory = {(r["group"], r["quantity"]): r["commanded"] for r in over_stance.iter_rows(named=True)}
    found: list[dict[str, Any]] = []
    for group, quantity in product(groups, ESTIMATES):
        of_group = fits.filter(group=group)
        row: dict[str, Any] = {"group": group, "quantity": quantity, "n": len(of_group)}
        if any(name == group for name, _, _ in rows):
            row |= drawn_group(rows, group, quantity)
        configured = commanded_K if quantity == "K" and len(groups) == 1 else None
        known = (row.get("commanded"), configured, trajectory.get((group, quantity)))
        row["commanded"] = next((value for value in known if value is not None), None)
        found.append(row)
        single = of_group.select("group", "trial", "doubtful", pl.col(quantity).alias("estimate"))
        found += [{"quantity": quantity, **one} for one in single.iter_rows(named=True)]
    types = dict.fromkeys(COLUMNS, pl.Float64) | dict.fromkeys(("group", "quantity", "trial", "doubtful"), pl.String)
    return pl.DataFrame(found, schema=types | {"n": pl.Int64, "n_doubtful": pl.Int64}).select(COLUMNS)


def drawn_group(rows: dict[tuple[str, str, str], dict[str, Any]], group: str, quantity: str) -> dict[str, Any]:
    for estimator in (PER_PERTURBATION, BY_ENSEMBLE):
        if (group, estimator, quantity) not in rows:
            raise InputError(
                f"the walking summary has no '{quantity}' by the estimator '{estimator}', which Fig. 9 draws; fit the "
                "crossings again"
            )
    mean, ensemble = (rows[group, estimator, quantity] for estimator in (PER_PERTURBATION, BY_ENSEMBLE))
    found = {name: mean[name] for name in ("n", "mean", "sd", "n_doubtful")}
    found |= {"ensemble": ensemble["mean"], "ensemble_low": ensemble["low"], "ensemble_high": ensemble["high"]}
    return found | {"commanded": ensemble["commanded"]}


@style.paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: a point per perturbation, open where its fit is doubtful, beside them their mean with one SD
    on either side and the fit to the mean response with its 95 % interval, commanded values dashed.

    Several groups stand side by side, in panels one above the other, with the number of perturbations in brackets. No
    axis begins at zero for its own sake.
    """
    groups = table["group"].unique(maintain_order=True).to_list()
    single = len(groups) == 1
    if single:
        figure, axes = style.panels(style.SINGLE_COLUMN, 2.6, columns=3)
    else:
        figure, axes = style.panels(style.DOUBLE_COLUMN, 4.8, rows=3)
    span = (len(groups) - 1) * GROUP_WIDTH + 1.6
    width = (style.SINGLE_COLUMN / 3 if single else style.DOUBLE_COLUMN) - 0.45  # beside what is written [in]
    for ax, quantity in zip(axes, ESTIMATES, strict=True):
        rows = table.filter(pl.col("quantity") == quantity)
        for place, group in enumerate(groups):
            at, of_group = place * GROUP_WIDTH, rows.filter(group=group)
            draw_single(ax, at, of_group.drop_nulls("trial"), rows["estimate"].drop_nulls(), width / span)
            draw_group(ax, at, of_group.filter(pl.col("trial").is_null()).row(0, named=True))
        if quantity == "I" or ax.dataLim.y0 < 0:
            ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
        ax.set_xlim(-0.5, span - 0.5)
        ax.set_xticks([] if single else [n * GROUP_WIDTH + MEAN_AT / 2 for n in range(len(groups))])
        if not single:
            letters = int(17 * width / len(groups))
            ax.set_xticklabels([tick(r, letters) for r in rows.filter(pl.col("trial").is_null()).iter_rows(named=True)])
        ax.set_ylabel(AXIS_LABELS[quantity])
    found = style.legend_entries(axes[:1])
    labels = {name: found[name] for name in LEGEND if name in found}
    if len(table.filter(style.DRAWN_OPEN)):
        labels[str(style.OPEN_MARKER.get_label())] = style.OPEN_MARKER
    figure.legend(list(labels.values()), list(labels), loc="outside upper center", ncols=2 if single else 5)
    return figure


def tick(row: dict[str, object], letters: int) -> str:
    """Name of a group for the axis, in lines of so many letters, with its number of perturbations."""
    name = drawn_name(str(row["group"]), 60).replace("K_d", "$K_d$").replace("B_d", "$B_d$")
    return "\n".join(textwrap.wrap(f"{name} ({row['n']})", max(letters, 6), break_long_words=False))


def draw_single(ax: Axes, at: float, fits: pl.DataFrame, shown: pl.Series, inches: float) -> None:
    """The single estimates of one group, side by side where they would overlap; `inches`: length of a unit in x. They
    spread over 1.2 in of a panel, and each takes 3.4 pt."""
    heights = (fits["estimate"] / max(float(np.ptp(shown.to_numpy())), 1e-9) * 1.2).to_numpy()
    x = at + style.squeezed(style.swarm_positions(heights, 3.4 / 72) / inches, FROM_MIDDLE)
    style.draw_fits(ax, fits, x, fits["estimate"], style.GREY, 2.6, linewidths=0.6, label=LEGEND[0])


def draw_group(ax: Axes, at: float, row: dict[str, Any]) -> None:
    """Mean and SD of one group, the fit to its mean response with its interval, and the commanded value, as far as they
    are known. The interval's bounds are percentiles: the estimate may lie outside."""
    if row["commanded"] is not None:
        ends = [at - FROM_MIDDLE - 0.1, at + ENSEMBLE_AT + 0.15]
        look: dict[str, Any] = {"color": style.BLACK, "linestyle": style.DASHED, "linewidth": 0.8, "zorder": 0}
        ax.plot(ends, [row["commanded"]] * 2, **look, label=LEGEND[3])
    if row["mean"] is None:
        return
    sd = None if row["sd"] is None else [row["sd"]]
    ax.errorbar(
        [at + MEAN_AT], [row["mean"]], yerr=sd, fmt="s", color=style.BLACK, markersize=3, linewidth=0.8, capsize=2.5,
        label=LEGEND[1],
    )  # fmt: skip
    low, high, place = row["ensemble_low"], row["ensemble_high"], [at + ENSEMBLE_AT]
    ax.errorbar(
        place, [(low + high) / 2], yerr=[(high - low) / 2], fmt="none", color=style.PURPLE, linewidth=1.2, capsize=2.5
    )
    ax.plot(place, [row["ensemble"]], "D", color=style.PURPLE, markersize=3.2, label=LEGEND[2])


def caption(table: pl.DataFrame) -> str:
    rows = table.filter(pl.col("trial").is_null())
    groups = rows["group"].unique(maintain_order=True).to_list()
    fits = table.filter(pl.col("quantity") == ESTIMATES[0]).drop_nulls("trial")
    several = "" if len(groups) == 1 else f" in {len(groups)} groups, whose numbers stand in brackets"
    said = [
        r"Stiffness $\hat{K}$ (a), damping $\hat{B}$ (b) and inertia $\hat{I}$ (c) of the ankle while walking, Eq. 15. "
        f"Points: {count_of(len(fits), 'perturbation')}{several}. Squares: their mean ± SD. Diamonds: the fit to the "
        "mean response with its 95 % interval (bootstrap)."
    ]
    if table["commanded"].count():
        said.append("Dashed: what the walking controller commanded.")
    most = 6
    for group in groups[:most]:
        name = "" if len(groups) == 1 else f"{as_text(group)}: "
        of_group = rows.filter(group=group).iter_rows(named=True)
        said.append(f"{name}{'; '.join(quantity_said(row) for row in of_group)}.")
    if len(groups) > most:
        said.append(f"The numbers of {len(groups) - most} more groups stand in fig9.csv.")
    return " ".join([*said, doubtful_said(fits, "drawn open")])


def quantity_said(row: dict[str, Any]) -> str:
    name, unit = rf"$\hat{{{row['quantity']}}}$", UNIT_OF[row["quantity"]]
    commanded = "" if row["commanded"] is None else f", commanded {row['commanded']:g}"
    if row["mean"] is None:
        return f"{name} has no mean of several perturbations{commanded}"
    ensemble = with_interval(row["ensemble"], row["ensemble_low"], row["ensemble_high"], unit)
    return f"{name} is {with_sd(row['mean'], row['sd'], unit)}, of the mean response {ensemble}{commanded}"
