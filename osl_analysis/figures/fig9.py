# SPDX-License-Identifier: Apache-2.0
"""Fig. 9: stiffness, damping and inertia of the ankle while walking."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import style
from osl_analysis.stats.budget import QUANTITIES
from osl_analysis.walking.impedance_fit import ENSEMBLE

MEAN, PERTURBATION = "mean of perturbations", "perturbation"  # values of `estimator`
# Fits to the mean response: estimator, face and name of a marker
SHOWN_FITS = (
    (ENSEMBLE, style.PURPLE, "Mean response, 95 %"),
    ("ensemble, predicted gait", style.WHITE, "Predicted gait, 95 %"),
)
NEXT_GROUP = 3  # distance of the middles of two groups, of which each perturbation is within 0.5
ONE_PERTURBATION = style.Look(style.GREY, "o", "One perturbation")


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
        Each group's unperturbed crossings and its onset.
    walking_responses : DataFrame
        Whose modelled torque shows the fitted window.
    commanded_K : float or None
        Commanded stiffness of the configuration [N·m/rad]; used in a campaign of one group.

    Returns
    -------
    DataFrame
        The known estimates of each group, with its facts, then a row per perturbation and quantity.
    """
    group = pl.col("group").cast(pl.String)  # without entries it is a column of numbers
    fitted = walking_responses.filter(trial=ENSEMBLE).drop_nulls("torque_model")
    span = (pl.col("time").max() - pl.col("time").min()) * pl.len() / (pl.len() - 1)
    of_crossings = walking_groups.select(group, "n_unperturbed", "onset_phase")
    of_windows = fitted.group_by(group).agg(window_s=span)
    estimates = (
        walking_summary.with_columns(group).drop_nulls("mean").drop("doubtful", strict=False)
    )
    for of_groups in (of_crossings, of_windows):
        estimates = estimates.join(of_groups, on="group", how="left", maintain_order="left")
    if estimates["group"].n_unique() == 1:
        of_configuration = pl.when(quantity="K").then(pl.lit(commanded_K, pl.Float64))
        estimates = estimates.with_columns(commanded=pl.coalesce("commanded", of_configuration))

    is_fitted = pl.all_horizontal(pl.col(QUANTITIES).is_finite())
    fits = walking.with_columns(group, estimator=pl.lit(PERTURBATION)).filter(is_fitted)
    perturbations = fits.join(estimates, on="group", how="semi").unpivot(
        QUANTITIES,
        index=["group", "estimator", "trial", "doubtful"],
        variable_name="quantity",
        value_name="mean",
    )
    return pl.concat([estimates, perturbations], how="diagonal_relaxed")


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) K, (b) B, (c) I, side by side, each with all groups."""
    names = table["group"].unique(maintain_order=True)
    width = style.DOUBLE_COLUMN if len(names) > 1 else style.SINGLE_COLUMN
    figure, axes = style.panels(width, 3.5, 1, 3)
    for ax, quantity in zip(axes, QUANTITIES, strict=True):
        of_quantity = table.filter(quantity=quantity)
        span = float(np.ptp(of_quantity.filter(estimator=PERTURBATION)["mean"].to_numpy()))
        for number, rows in enumerate(of_quantity.partition_by("group")):
            draw_group(ax, rows, NEXT_GROUP * number, span)
        ax.set_xlim(-1, NEXT_GROUP * len(names) - 0.5)
        ax.set_xticks([])
        ax.set_ylabel(style.AXIS_LABELS[quantity])
        if quantity == "I" or ax.dataLim.y0 < 0:
            ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
    axes[-1].yaxis.set_major_formatter(lambda inertia, _: f"{1e3 * inertia:.6g}".replace("-", "−"))
    vaf = table.filter(estimator=ENSEMBLE, quantity="VAF")
    texts = [of_response(group) for group in vaf.to_dicts()]
    if len(names) > 1:
        labels = [style.drawn_name(name) for name in names]
        places = [NEXT_GROUP * number + 0.5 for number in range(len(names))]
        for ax in axes:
            ax.set_xticks(places, labels, rotation=90 if len(names) > 2 else 0)
        texts = [f"{name}: {text}" for name, text in zip(labels, texts, strict=True)]
    keys = [*style.labelled(axes[:1]), *style.open_keys(table)]
    style.legend_above(figure, keys, "\n".join(texts))
    return figure


def of_response(group: Mapping[str, Any]) -> str:
    """What the fit to the mean response of a group is made of, and its VAF."""
    return (
        f"$n$ = {group['n']} perturbed, {group['n_unperturbed']} unperturbed crossings,\n"
        f"onset at {100 * group['onset_phase']:.0f} % of stance,"
        f" fitted for {1000 * group['window_s']:.0f} ms, VAF {group['mean']:.2f} %"
    )


def draw_group(ax: Axes, rows: pl.DataFrame, place: float, span: float) -> None:
    """One quantity of a group around its place: perturbations, their mean, the fits to the mean
    response, and the command. `span` is the range of all perturbations."""
    fits = rows.filter(estimator=PERTURBATION)
    values = fits["mean"].to_numpy()
    x = place + style.swarm_offsets(values, span, 4)
    style.draw_fits(ax, fits, x, values, ONE_PERTURBATION, areas=0.5)
    mean = rows.filter(estimator=MEAN)
    ax.errorbar(
        place + 1, mean["mean"], yerr=mean["sd"], fmt="s", color=style.BLACK, label="Mean ± SD"
    )
    for number, (estimator, face, label) in enumerate(SHOWN_FITS, 3):
        fit = rows.filter(estimator=estimator)
        if len(fit):
            # the interval may lie on one side of the estimate
            beside = place + number / 2
            interval = fit.select("low", "high").row(0)
            ax.plot([beside, beside], interval, color=style.PURPLE, marker="_")
            ax.plot(beside, fit["mean"], "D", color=style.PURPLE, mfc=face, label=label)
    command = rows["commanded"].drop_nulls()[:1]
    if len(command):
        ends = [place - 0.5, place + 2]
        ax.plot(ends, [*command] * 2, "--", color=style.BLACK, zorder=0, label="Commanded")
