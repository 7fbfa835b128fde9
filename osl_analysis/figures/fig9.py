# SPDX-License-Identifier: Apache-2.0
"""Fig. 9: stiffness, damping and inertia of the ankle while walking."""

from collections.abc import Sequence

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from osl_analysis.figures import style
from osl_analysis.stats.budget import QUANTITIES
from osl_analysis.stats.doubts import is_doubtful
from osl_analysis.walking.impedance_fit import ENSEMBLE

# values of `estimator`
MEAN = "mean of perturbations"
PERTURBATION = "perturbation"
# Fits to the mean response: estimator, face of a marker, and category
SHOWN_FITS = (
    (ENSEMBLE, style.PURPLE, "Mean response, 95 %"),
    ("ensemble, predicted gait", style.WHITE, "Predicted gait, 95 %"),
)
ONE_PERTURBATION = style.Look(style.GREY, "o", "One perturbation")
MEAN_LABEL = "Mean ± SD"
# Places of the categories of a group on the axis; perturbations stand within 0.5 of theirs
PLACES = {
    ONE_PERTURBATION.label: 0.0,
    MEAN_LABEL: 0.9,
    **{label: 1.6 + 0.7 * number for number, (_, _, label) in enumerate(SHOWN_FITS)},
}
NEXT_GROUP = 3.5  # distance of the first categories of two groups
MARGIN = 0.7  # from the first and the last category to the ends of the axis


def points(
    walking_summary: pl.DataFrame,
    walking: pl.DataFrame,
    walking_groups: pl.DataFrame,
    walking_responses: pl.DataFrame,
    commanded_K: float | None = None,
) -> pl.DataFrame:
    """The plotted numbers of Fig. 9.

    Parameters
    ----------
    walking_summary : DataFrame
        Means and ensemble estimates by group and quantity.
    walking : DataFrame
        Fits of single perturbations.
    walking_groups : DataFrame
        Each group's unperturbed crossings and its onset.
    walking_responses : DataFrame
        Responses; the modelled torque shows the fitted window.
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
    crossing_facts = walking_groups.select(group, "n_unperturbed", "onset_phase")
    fitted_windows = fitted.group_by(group).agg(window_s=span)
    estimates = (
        walking_summary.with_columns(group).drop_nulls("mean").drop("doubtful", strict=False)
    )
    for group_facts in (crossing_facts, fitted_windows):
        estimates = estimates.join(group_facts, on="group", how="left", maintain_order="left")
    if estimates["group"].n_unique() == 1:
        configured_K = pl.when(quantity="K").then(pl.lit(commanded_K, pl.Float64))
        estimates = estimates.with_columns(commanded=pl.coalesce("commanded", configured_K))

    is_fitted = pl.all_horizontal(pl.col(QUANTITIES).is_finite())
    marked = walking.with_columns(
        group, estimator=pl.lit(PERTURBATION), is_doubtful=is_doubtful(walking)
    )
    fits = marked.filter(is_fitted)
    perturbations = fits.join(estimates, on="group", how="semi").unpivot(
        QUANTITIES,
        index=["group", "estimator", "trial", "doubtful", "is_doubtful"],
        variable_name="quantity",
        value_name="mean",
    )
    points = pl.concat([estimates, perturbations], how="diagonal_relaxed")
    return points.with_columns(pl.col("is_doubtful").fill_null(False))


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) K, (b) B, (c) I, side by side, each with all groups. The axis names the categories of one
    group; of several it names the groups, and a legend the categories."""
    names = table["group"].unique(maintain_order=True)
    has_one_group = len(names) == 1
    width = style.SINGLE_COLUMN if has_one_group else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, 4, 1, len(QUANTITIES))
    for ax, quantity in zip(axes, QUANTITIES, strict=True):
        quantity_rows = table.filter(quantity=quantity)
        span = float(np.ptp(quantity_rows.filter(estimator=PERTURBATION)["mean"].to_numpy()))
        for number, rows in enumerate(quantity_rows.partition_by("group")):
            draw_group(ax, rows, NEXT_GROUP * number, span)
        last_place = NEXT_GROUP * (len(names) - 1) + max(PLACES.values())
        ax.set_xlim(-MARGIN, last_place + MARGIN)
        ax.tick_params(axis="x", length=0)
        if has_one_group:
            ax.set_xticks(list(PLACES.values()), list(PLACES), rotation=90)
        else:
            label_groups(ax, list(names))
        ax.set_ylabel(style.AXIS_LABELS[quantity])
        if quantity == "I" or ax.dataLim.y0 < 0:
            ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
    axes[-1].yaxis.set_major_formatter(lambda inertia, _: f"{1e3 * inertia:.6g}".replace("-", "−"))

    keys = style.labelled(axes[:1])
    if has_one_group:
        keys = [entry for entry in keys if entry.get_label() not in PLACES]
    style.legend_above(figure, [*keys, *style.open_keys(table)])
    return figure


def label_groups(ax: Axes, names: Sequence[str]) -> None:
    """The name of each group below the middle of its categories."""
    middle = max(PLACES.values()) / 2
    places = [NEXT_GROUP * number + middle for number in range(len(names))]
    labels = [style.drawn_name(name) for name in names]
    ax.set_xticks(places, labels, rotation=90 if len(names) > 2 else 0)


def statistics(table: pl.DataFrame) -> list[str]:
    """A sentence of the caption for each group, on the crossings, the window and the VAF of the fit
    to its mean response."""
    groups = table.filter(estimator=ENSEMBLE, quantity="VAF").to_dicts()
    sentences = []
    for group in groups:
        name = f"{group['group']}: " if len(groups) > 1 else ""
        sentences.append(
            f"{name}{group['n']} perturbed and {group['n_unperturbed']} unperturbed crossings;"
            f" onset at {100 * group['onset_phase']:.0f} % of stance;"
            f" {1000 * group['window_s']:.0f} ms are fitted; VAF {group['mean']:.2f} %."
        )
    return sentences


def draw_group(ax: Axes, rows: pl.DataFrame, place: float, span: float) -> None:
    """One quantity of a group from its place on: perturbations, their mean, the fits to the mean
    response, and the command. `span` is the range of all perturbations."""
    fits = rows.filter(estimator=PERTURBATION)
    values = fits["mean"].to_numpy()
    x = place + style.swarm_offsets(values, span, 4)
    style.draw_fits(ax, fits, x, values, ONE_PERTURBATION, areas=0.5)
    mean = rows.filter(estimator=MEAN)
    ax.errorbar(
        place + PLACES[MEAN_LABEL],
        mean["mean"],
        yerr=mean["sd"],
        fmt="s",
        color=style.BLACK,
        label=MEAN_LABEL,
    )
    for estimator, face, label in SHOWN_FITS:
        fit = rows.filter(estimator=estimator)
        if fit.is_empty():
            continue
        x_of_fit = place + PLACES[label]
        interval = fit.select("low", "high").row(0)
        # the interval may lie on one side of the estimate
        ax.plot([x_of_fit, x_of_fit], interval, color=style.PURPLE, marker="_")
        ax.plot(x_of_fit, fit["mean"], "D", color=style.PURPLE, mfc=face, label=label)
    command = rows["commanded"].drop_nulls()
    if not command.is_empty():
        ends = [place - 0.5, place + max(PLACES.values()) + 0.3]
        ax.plot(
            ends, [command[0], command[0]], "--", color=style.BLACK, zorder=0, label="Commanded"
        )
