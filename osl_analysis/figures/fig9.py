# SPDX-License-Identifier: Apache-2.0
"""Fig. 9: stiffness, damping and inertia of the ankle while walking."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from osl_analysis.figures import marks, style

QUANTITIES = ("K", "B", "I")
MEAN_RESPONSE = "ensemble"  # `trial` of the mean response


class Layout:
    """Places in a group, from its middle, and sizes."""

    # distances on the axis from the middle of a group
    HEIGHT = 2.9  # of the figure [in]
    REACH = 0.32  # of its points, to either side
    MEAN_AT = 0.55  # its mean
    LAST_AT = 1.15  # the last of its fits
    NEXT_GROUP = 2.1  # the middle of the next group
    BESIDE = 0.4  # free beside the first and the last group
    MARGIN = 0.45  # of a panel, for the labels of its vertical axis [in]
    SWARM_HEIGHT = 1.2  # over which the values of a panel spread [in]
    POINT = 3.4 / 72  # diameter of a point with a small gap [in]
    CAP = 2.5  # half of the bar's end [pt]
    MOST_LEVEL = 2  # groups whose names stand level
    LETTERS = 14  # of a line of such a name


DRAWN = ("perturbation", "mean", "ensemble_low", "ensemble_high", "commanded")
# Fits to the mean response: estimator, column, distance from the middle, face and name of a marker
FITS = (
    ("ensemble", "ensemble", 0.85, style.PURPLE, "Fit to the mean response, 95 % interval"),
    ("ensemble, predicted gait", "predicted", Layout.LAST_AT, style.WHITE, "Minus predicted gait"),
)
# Numbers of a group above the panels by column: factor, decimal places, words
OF_RESPONSE = {
    "n": (1, 0, "$n$ = {} perturbed, "),
    "n_unperturbed": (1, 0, "{} unperturbed crossings,\n"),
    "onset_phase": (100, 0, "onset at {} % of stance, "),
    "window_s": (1000, 0, "fitted for {} ms, "),
    "vaf": (1, 2, "VAF {} %"),
}
PERTURBATION = style.Look(style.GREY, "o", 2.6, "One perturbation", edge=0.6)
IN_BLACK: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8}


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
    summary = walking_summary.drop_nulls("mean").filter(pl.col("quantity").is_in(QUANTITIES))
    group = pl.col("group").cast(pl.String)  # without entries it is a column of numbers
    summary = summary.with_columns(group)
    of_groups = summary.filter(estimator="mean of perturbations").select(*keys, "n", "mean", "sd")
    commanded = summary.filter(estimator="ensemble").select(*keys, "commanded")
    of_crossings = walking_groups.select(group, "doubtful", "n_unperturbed", "onset_phase")
    fitted = walking_responses.filter(trial=MEAN_RESPONSE).drop_nulls("torque_model")
    span = (pl.col("time").max() - pl.col("time").min()) * pl.len() / (pl.len() - 1)
    windows = fitted.group_by(group).agg(window_s=span)
    of_groups = of_groups.join(commanded, on=keys)
    for of_group in (of_crossings, windows):
        of_groups = of_groups.join(of_group, on="group", how="left")
    for estimator, column, *_ in FITS:
        names_of = {column: "mean", f"{column}_low": "low", f"{column}_high": "high"}
        of_fit = summary.filter(estimator=estimator).select(*keys, **names_of)
        of_groups = of_groups.join(of_fit, on=keys, how="left")
    vaf = walking_summary.filter(estimator="ensemble", quantity="VAF")
    of_groups = of_groups.join(vaf.select(group, vaf="mean"), on="group", how="left")
    is_fitted = pl.all_horizontal(pl.col(QUANTITIES).is_finite())
    fits = walking.with_columns(group).filter(is_fitted)
    perturbations = fits.unpivot(
        QUANTITIES, index=["group", "trial", "doubtful"],
        variable_name="quantity", value_name="perturbation",
    )  # fmt: skip
    groups = of_groups["group"].unique(maintain_order=True).to_list()
    if len(groups) == 1:
        of_configuration = pl.when(quantity="K").then(pl.lit(commanded_K, pl.Float64))
        of_groups = of_groups.with_columns(commanded=pl.coalesce("commanded", of_configuration))
    perturbations = perturbations.filter(pl.col("group").is_in(groups))
    rows = pl.concat([of_groups, perturbations], how="diagonal_relaxed")
    return rows.sort(
        pl.col("group").replace_strict(groups, range(len(groups))),
        pl.col("quantity").replace_strict(QUANTITIES, range(3)),
        maintain_order=True,
    )


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """(a) K, (b) B, (c) I, side by side, each with all groups."""
    of_groups = table.filter(pl.col("trial").is_null(), quantity="K")
    width = style.SINGLE_COLUMN if len(of_groups) == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, Layout.HEIGHT, 1, 3)
    left = -Layout.REACH - Layout.BESIDE
    right = (len(of_groups) - 1) * Layout.NEXT_GROUP + Layout.LAST_AT + Layout.BESIDE
    unit = (width / 3 - Layout.MARGIN) / (right - left)
    groups = of_groups.select("group", "n").rows() if len(of_groups) > 1 else []
    labels = [f"{style.drawn_name(name, Layout.LETTERS)}\n({n})" for name, n in groups]
    places = [number * Layout.NEXT_GROUP + Layout.MEAN_AT / 2 for number in range(len(labels))]
    for ax, quantity in zip(axes, QUANTITIES, strict=True):
        rows = table.filter(quantity=quantity)
        values = rows.select(DRAWN).unpivot()["value"].drop_nulls().to_numpy()
        height = Layout.SWARM_HEIGHT / max(np.ptp(values), 1e-9)
        for number, group in enumerate(rows.partition_by("group")):
            draw_group(ax, group, number * Layout.NEXT_GROUP, height, unit)
        ax.set_xlim(left, right)
        ax.set_xticks(places, labels, rotation=0 if len(labels) <= Layout.MOST_LEVEL else 90)
        ax.set_ylabel(style.AXIS_LABELS[quantity])
        if quantity == "I" or ax.dataLim.y0 < 0:
            ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
    axes[-1].yaxis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{1e3 * value:.6g}".replace("-", "−"))
    )
    keys = [*marks.labelled(axes[:1]), *marks.open_keys(table)]
    marks.legend_above(figure, keys, of_response(of_groups))
    return figure


def of_response(of_groups: pl.DataFrame) -> str:
    """What the fits to the mean responses are made of, and the VAF of these; of several groups from
    the smallest to the largest number."""
    text = ""
    for column, (factor, places, words) in OF_RESPONSE.items():
        if style.has_values(of_groups, column):
            ends = of_groups.select(low=pl.min(column), high=pl.max(column)).row(0)
            number = " to ".join(dict.fromkeys(f"{factor * end:.{places}f}" for end in ends))
            text += words.format(number)
    return text.removesuffix(", ")


def draw_group(ax: Axes, rows: pl.DataFrame, place: float, height: float, unit: float) -> None:
    """One quantity of a group around its place: perturbations, their mean, the fits to the mean
    response, and the command. `height` is the length of a unit of the quantity, `unit` that of the
    horizontal axis [in]."""
    fits = rows.drop_nulls("trial")
    offsets = marks.swarm_offsets(
        fits["perturbation"].to_numpy() * height, Layout.POINT, Layout.REACH * unit
    )
    marks.draw_fits(
        ax, fits, place + offsets / unit, fits["perturbation"], PERTURBATION, marks.BEHIND_LINES
    )
    group = rows.row(0, named=True)
    ax.errorbar(
        place + Layout.MEAN_AT, group["mean"], yerr=group["sd"],
        fmt="s", markersize=3, capsize=Layout.CAP, label="Mean ± SD", **IN_BLACK,
    )  # fmt: skip
    for _, column, beside, face, label in FITS:
        # an interval of percentiles, which may lie on one side of the estimate
        x, ends = [place + beside] * 2, [group[f"{column}_low"], group[f"{column}_high"]]
        ax.plot(x, ends, color=style.PURPLE, linewidth=1.2, marker="_", markersize=2 * Layout.CAP)
        ax.plot(
            x[:1], [group[column]], "D", color=style.PURPLE, mfc=face, markersize=3.2, label=label
        )
    if group["commanded"] is not None:
        ax.plot(
            [place - Layout.REACH - 0.1, place + Layout.LAST_AT + 0.15], [group["commanded"]] * 2,
            linestyle=style.DASHED, zorder=0, label="Commanded", **IN_BLACK,
        )  # fmt: skip
