# SPDX-License-Identifier: Apache-2.0
"""Fig. 9: stiffness, damping and inertia of the ankle while walking."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import marks, style
from osl_analysis.walking.tables import ENSEMBLE

QUANTITIES = ("K", "B", "I")
# Fits to the mean response: estimator, column, face and name of a marker
FITS = (
    ("ensemble", "ensemble", style.PURPLE, "Fit to the mean response, 95 % interval"),
    ("ensemble, predicted gait", "predicted", style.WHITE, "Minus predicted gait"),
)
NEXT_GROUP = 3  # distance of the middles of two groups, of which each perturbation is within 0.5
PERTURBATION = style.Look(style.GREY, "o", "One perturbation")


def points(
    walking_summary: pl.DataFrame,
    walking: pl.DataFrame,
    walking_groups: pl.DataFrame,
    walking_responses: pl.DataFrame,
    commanded_K: float | None = None,
) -> pl.DataFrame:
    """Gather what Fig. 9 shows of each group of crossings.

    Parameters
    ----------
    walking_summary : DataFrame
        Means and ensemble estimates by group and quantity.
    walking : DataFrame
        Fits of single perturbations.
    walking_groups : DataFrame
        The doubts about each group, its unperturbed crossings and its onset.
    walking_responses : DataFrame
        Whose modelled torque shows the fitted window.
    commanded_K : float or None
        Commanded stiffness of the configuration [N·m/rad]; used in a campaign of one group.

    Returns
    -------
    DataFrame
        For each group and quantity a row with mean, SD, ensemble and command, then a row per
        perturbation.
    """
    keys = ["group", "quantity"]
    group = pl.col("group").cast(pl.String)  # without entries it is a column of numbers
    estimates = walking_summary.with_columns(group).drop_nulls("mean")
    vaf = estimates.filter(estimator="ensemble", quantity="VAF").select("group", vaf="mean")
    estimates = estimates.filter(pl.col("quantity").is_in(QUANTITIES))
    of_groups = estimates.filter(estimator="mean of perturbations").select(*keys, "n", "mean", "sd")
    commanded = estimates.filter(estimator="ensemble").select(*keys, "commanded")
    of_groups = of_groups.join(commanded, on=keys)
    for estimator, column, *_ in FITS:
        names_of = {column: "mean", f"{column}_low": "low", f"{column}_high": "high"}
        of_fit = estimates.filter(estimator=estimator).select(*keys, **names_of)
        of_groups = of_groups.join(of_fit, on=keys, how="left")

    of_crossings = walking_groups.select(group, "doubtful", "n_unperturbed", "onset_phase")
    fitted = walking_responses.filter(trial=ENSEMBLE).drop_nulls("torque_model")
    span = (pl.col("time").max() - pl.col("time").min()) * pl.len() / (pl.len() - 1)
    windows = fitted.group_by(group).agg(window_s=span)
    for of_group in (of_crossings, windows, vaf):
        of_groups = of_groups.join(of_group, on="group", how="left")
    groups = of_groups["group"].unique(maintain_order=True)
    if len(groups) == 1:
        of_configuration = pl.when(quantity="K").then(pl.lit(commanded_K, pl.Float64))
        of_groups = of_groups.with_columns(commanded=pl.coalesce("commanded", of_configuration))

    is_fitted = pl.all_horizontal(pl.col(QUANTITIES).is_finite())
    fits = walking.with_columns(group).filter(is_fitted, pl.col("group").is_in(groups.implode()))
    perturbations = fits.unpivot(
        QUANTITIES, index=["group", "trial", "doubtful"],
        variable_name="quantity", value_name="perturbation",
    )  # fmt: skip
    rows = pl.concat([of_groups, perturbations], how="diagonal_relaxed")
    order = [pl.col("group").cast(pl.Enum(groups)), pl.col("quantity").cast(pl.Enum(QUANTITIES))]
    return rows.sort(order, maintain_order=True)


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) K, (b) B, (c) I, side by side, each with all groups."""
    of_groups = table.filter(pl.col("trial").is_null(), quantity="K")
    width = style.DOUBLE_COLUMN if len(of_groups) > 1 else style.SINGLE_COLUMN
    figure, axes = style.panels(width, 3, 1, 3)
    for ax, quantity in zip(axes, QUANTITIES, strict=True):
        of_quantity = table.filter(quantity=quantity)
        span = float(np.ptp(of_quantity["perturbation"].drop_nulls().to_numpy()))
        for number, rows in enumerate(of_quantity.partition_by("group")):
            draw_group(ax, rows, NEXT_GROUP * number, span)
        ax.set_xlim(-1, NEXT_GROUP * len(of_groups) - 0.5)
        ax.set_xticks([])
        ax.set_ylabel(style.AXIS_LABELS[quantity])
        if quantity == "I" or ax.dataLim.y0 < 0:
            ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
    axes[-1].yaxis.set_major_formatter(lambda inertia, _: f"{1e3 * inertia:.6g}".replace("-", "−"))
    texts = [of_response(group) for group in of_groups.to_dicts()]
    if len(of_groups) > 1:
        names = [style.drawn_name(name) for name in of_groups["group"]]
        places = [NEXT_GROUP * number + 0.5 for number in range(len(names))]
        for ax in axes:
            ax.set_xticks(places, names, rotation=90 if len(names) > 2 else 0)
        texts = [f"{name}: {text}" for name, text in zip(names, texts, strict=True)]
    keys = [*marks.labelled(axes[:1]), *marks.open_keys(table)]
    marks.legend_above(figure, keys, "\n".join(texts))
    return figure


def of_response(group: Mapping[str, Any]) -> str:
    """What the fit to the mean response of a group is made of, and its VAF."""
    return (
        f"$n$ = {group['n']} perturbed, {group['n_unperturbed']} unperturbed crossings,\n"
        f"onset at {100 * group['onset_phase']:.0f} % of stance,"
        f" fitted for {1000 * group['window_s']:.0f} ms, VAF {group['vaf']:.2f} %"
    )


def draw_group(ax: Axes, rows: pl.DataFrame, place: float, span: float) -> None:
    """One quantity of a group around its place: perturbations, their mean, the fits to the mean
    response, and the command. `span` is the range of all perturbations."""
    fits = rows.drop_nulls("trial")
    values = fits["perturbation"].to_numpy()
    x = place + marks.swarm_offsets(values, span, 4)
    marks.draw_fits(ax, fits, x, values, PERTURBATION, areas=0.5)
    group = rows.row(0, named=True)
    ax.errorbar(
        place + 1, group["mean"], yerr=group["sd"], fmt="s", color=style.BLACK, label="Mean ± SD"
    )
    for number, (_, column, face, label) in enumerate(FITS, 3):
        # an interval of percentiles, which may lie on one side of the estimate
        beside = place + number / 2
        ends = [group[f"{column}_low"], group[f"{column}_high"]]
        ax.plot([beside, beside], ends, color=style.PURPLE, marker="_")
        ax.plot(beside, group[column], "D", color=style.PURPLE, mfc=face, label=label)
    if group["commanded"] is not None:
        ends = [place - 0.5, place + 2]
        command = [group["commanded"]] * 2
        ax.plot(ends, command, "--", color=style.BLACK, zorder=0, label="Commanded")
