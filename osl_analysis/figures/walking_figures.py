"""Fig. 9 and the walking page: what was measured on the ankle while walking."""

import textwrap
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import columns_of, marks, names, style
from osl_analysis.figures.ticks import label_in_thousandths
from osl_analysis.trial import Array

# Fig. 9

NO_FIT = "no perturbation has a fit, which Fig. 9 draws; see the reasons in walking_crossings.csv"
TEXTS = ("group", "quantity", "trial", "doubtful")


def fig9_points(
    walking_summary: pl.DataFrame,
    walking: pl.DataFrame,
    commanded_K: float | None = None,
) -> pl.DataFrame:
    """Gather what Fig. 9 shows of each group of crossings.

    Parameters
    ----------
    walking_summary : DataFrame
        Means and ensemble estimates by group and quantity.
    walking : DataFrame
        Fits of single perturbations.
    commanded_K : float or None
        Commanded stiffness of the configuration [N·m/rad]; used in a campaign of one group.

    Returns
    -------
    DataFrame
        For each group and quantity a row with mean, SD, ensemble and command, then a row per
        perturbation.

    Raises
    ------
    InputError
        No group and no perturbation has a result.
    """
    summary = {
        (row["group"], row["estimator"], row["quantity"]): row
        for row in walking_summary.drop_nulls("mean").iter_rows(named=True)
    }
    is_fitted = pl.all_horizontal(pl.col("K", "B", "I").is_finite())
    fits = walking.drop_nulls("group").filter(is_fitted)
    groups = list(dict.fromkeys([*(group for group, _, _ in summary), *fits["group"]]))
    if not groups:
        raise InputError(NO_FIT)

    rows: list[dict[str, Any]] = []
    for group, quantity in product(groups, "KBI"):
        perturbations = fits.filter(group=group).select(
            "group", "trial", "doubtful", pl.col(quantity).alias("estimate")
        )
        row = {"group": group, "quantity": quantity, "n": len(perturbations)}
        mean = summary.get((group, "mean of perturbations", quantity))
        if mean is not None:  # a group that has a mean has an ensemble
            ensemble = summary[group, "ensemble", quantity]
            row |= {
                "n": mean["n"],
                "mean": mean["mean"],
                "sd": mean["sd"],
                "ensemble": ensemble["mean"],
                "ensemble_low": ensemble["low"],
                "ensemble_high": ensemble["high"],
                "commanded": ensemble.get("commanded"),
                "doubtful": ensemble.get("doubt"),  # not in a table that was not judged
            }
        if row.get("commanded") is None and quantity == "K" and len(groups) == 1:
            row["commanded"] = commanded_K
        rows.append(row)
        for perturbation in perturbations.iter_rows(named=True):
            rows.append({"quantity": quantity, **perturbation})
    types: dict[str, Any] = dict.fromkeys(columns_of("fig9"), pl.Float64)
    types |= dict.fromkeys(TEXTS, pl.String) | {"n": pl.Int64}
    return pl.DataFrame(rows, schema=types)


def fig9_caption(table: pl.DataFrame) -> str:
    """What Fig. 9 shows."""
    sentences = [
        r"(a) Stiffness $\hat{K}$, (b) damping $\hat{B}$ and (c) apparent inertia $\hat{I}$ of the"
        " ankle while walking.",
        "Eq. 15 reads a leg with a drivetrain, which is of third order, with a lower inertia, which"
        " may be negative; the foot's inertia is in it where nobody states the foot.",
        "Points: one perturbation each. Squares: their mean ± one standard deviation. Diamonds: the"
        " fit to the mean response with its 95 % interval (bootstrap).",
    ]
    if table["group"].n_unique() > 1:
        sentences.append("In brackets: numbers of perturbations.")
    if names.has_values(table, "commanded"):
        sentences.append("Dashed: what the walking controller commanded.")
    return " ".join(sentences)


# distances on the axis from the middle of a group
REACH = 0.32  # of its points, to either side
MEAN_AT = 0.55  # its mean
ENSEMBLE_AT = 0.85  # its ensemble
NEXT_GROUP = 1.8  # the middle of the next group
BESIDE = 0.75  # free beside the first and the last group, half of it on either side
MARGIN = 0.45  # of a panel, for the labels of its vertical axis [in]
SWARM_HEIGHT = 1.2  # over which the values of a panel spread [in]
POINT = 3.4 / 72  # diameter of a point with a small gap [in]
DRAWN = ("estimate", "mean", "ensemble_low", "ensemble_high", "commanded")
PERTURBATION = style.Look(style.GREY, "o", 2.6, "One perturbation", edge=0.6)
MEAN_LABEL = "Mean ± SD"
ENSEMBLE_LABEL = f"Fit to the {names.MEAN_RESPONSE}, 95 % interval"
COMMANDED_LABEL = "Commanded"
IN_BLACK: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8}
CAP = 2.5  # half of the bar's end [pt]


@style.drawing(columns_of("fig9"), fig9_points, caption=fig9_caption)
def draw_fig9(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I. The panels of one group stand side by side, those of several one above
    the other."""
    groups = table["group"].unique(maintain_order=True).to_list()
    if len(groups) == 1:
        figure, axes = style.panels(style.SINGLE_COLUMN, 2.6, 1, 3)
        inches = style.SINGLE_COLUMN / 3 - MARGIN
    else:
        figure, axes = style.panels(style.DOUBLE_COLUMN, 4.8, 3, 1, share_x=True)
        inches = style.DOUBLE_COLUMN - MARGIN
    span = (len(groups) - 1) * NEXT_GROUP + REACH + ENSEMBLE_AT + BESIDE
    for ax, quantity in zip(axes, "KBI", strict=True):
        rows = table.filter(quantity=quantity)
        draw_groups(ax, rows, inches / span)
        ax.set_xlim(-REACH - BESIDE / 2, span - REACH - BESIDE / 2)
        ax.set_ylabel(names.AXIS_LABELS[quantity])
        if quantity == "I":
            label_in_thousandths(ax.yaxis)
        if quantity == "I" or ax.dataLim.y0 < 0:
            ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
    name_groups(axes[-1], table.filter(pl.col("trial").is_null(), quantity="K"), inches)

    drawn = marks.legend_entries(axes[:1])
    order = (PERTURBATION.label, MEAN_LABEL, ENSEMBLE_LABEL, COMMANDED_LABEL)
    entries = {label: drawn[label] for label in order if label in drawn}
    marks.legend_above(figure, entries | marks.open_entry(table), 5)
    figure.align_ylabels()
    return figure


def draw_groups(ax: Axes, rows: pl.DataFrame, unit: float) -> None:
    """One quantity of every group: perturbations, their mean, the ensemble, and the command.
    `unit` is the length of a unit of the axis [in]."""
    of_groups = rows.filter(pl.col("trial").is_null())
    drawn = rows.select(DRAWN).unpivot()["value"].drop_nulls().to_numpy()
    spread = max(float(np.ptp(drawn)), 1e-9)
    for number, row in enumerate(of_groups.iter_rows(named=True)):
        place = number * NEXT_GROUP
        fits = rows.filter(group=row["group"]).drop_nulls("trial")
        heights = fits["estimate"].to_numpy() / spread * SWARM_HEIGHT
        x = place + marks.swarm_offsets(heights, POINT, unit, REACH)
        marks.draw_fits(ax, fits, x, fits["estimate"], PERTURBATION, marks.BEHIND_LINES)
        if row["commanded"] is not None:
            ends = [place - REACH - 0.1, place + ENSEMBLE_AT + 0.15]
            ax.plot(
                ends, [row["commanded"]] * 2,
                linestyle=style.DASHED, zorder=0, label=COMMANDED_LABEL, **IN_BLACK,
            )  # fmt: skip
        if row["mean"] is not None:
            ax.errorbar(
                place + MEAN_AT, row["mean"], yerr=row["sd"],
                fmt="s", markersize=3, capsize=CAP, label=MEAN_LABEL, **IN_BLACK,
            )  # fmt: skip
            draw_ensemble(ax, place + ENSEMBLE_AT, row)


def draw_ensemble(ax: Axes, x: float, row: dict[str, Any]) -> None:
    """The fit to the mean response of a group with its interval, which is of percentiles and not
    about the estimate."""
    middle = (row["ensemble_low"] + row["ensemble_high"]) / 2
    half = (row["ensemble_high"] - row["ensemble_low"]) / 2
    ax.errorbar(
        x, middle, yerr=half,
        fmt="none", color=style.PURPLE, linewidth=1.2, capsize=CAP,
    )  # fmt: skip
    ax.plot([x], [row["ensemble"]], "D", color=style.PURPLE, markersize=3.2, label=ENSEMBLE_LABEL)


def name_groups(ax: Axes, of_groups: pl.DataFrame, inches: float) -> None:
    """Write below several groups their names and numbers of perturbations."""
    if len(of_groups) == 1:
        for panel in ax.figure.axes:
            panel.set_xticks([])
        return
    letters = max(int(style.LETTERS_PER_INCH * inches / len(of_groups)), 6)
    places, labels = [], []
    for number, (group, n) in enumerate(of_groups.select("group", "n").iter_rows()):
        name = f"{names.drawn_name(group, 60)} ({n})"
        name = name.replace("K_d", "$K_d$").replace("B_d", "$B_d$")
        places.append(number * NEXT_GROUP + MEAN_AT / 2)
        labels.append("\n".join(textwrap.wrap(name, letters, break_long_words=False)))
    ax.set_xticks(places, labels)


# walking_page

GAIT: dict[str, tuple[str, style.Dash, str]] = {  # colour, line style and name of a curve
    "unperturbed": (style.PURPLE, (0, ()), "Unperturbed"),
    "perturbed": (style.ORANGE, (0, (5.0, 1.5)), "Perturbed"),
}
SHADED: dict[str, dict[str, Any]] = {  # intervals of time
    "baseline": {
        "facecolor": "none", "edgecolor": "#C4C4C4", "hatch": "////", "label": "Baseline",
    },
    "window": {"color": "#F5C09A", "alpha": 0.5, "label": "Fitted window"},
}  # fmt: skip
PAGE_HEIGHT = 4.4  # of a group [in]
BAND_LABEL = "± SD of crossings"


def walking_page_caption(_table: pl.DataFrame) -> str:
    """What the walking page shows."""
    sentences = [
        "From crossings to the responses that Fig. 9 fits.",
        "(a) Ankle angle and (b) ankle torque over stance, mean ± SD of crossings.",
        "(c) Isolated angle and (d) isolated torque: every perturbed crossing minus the mean"
        " unperturbed gait at the same phase of stance.",
        "Thick: the mean response, and the fit of K, B and I to it in the shaded window.",
        "Each response is zero on average over the hatched baseline, and not at the onset.",
        "In between, a crossing's own gait departs from the mean one, and the filter spreads the"
        " perturbation to earlier times. The fit has no offset, so that both are in it.",
    ]
    return " ".join(sentences)


@style.drawing(
    ("group", "panel", "curve", "trial", "x", "mean", "sd", "doubtful"),
    caption=walking_page_caption,
)
def draw_walking_page(table: pl.DataFrame) -> Figure:
    """Over stance (a) angle and (b) torque, over time (c) isolated angle and (d) isolated torque;
    four panels for each group."""
    groups = table.partition_by("group", maintain_order=True)
    figure = Figure(figsize=(style.DOUBLE_COLUMN, PAGE_HEIGHT * len(groups)), layout="constrained")
    parts = figure.subfigures(len(groups), 1, squeeze=False)[:, 0]
    for part, rows in zip(parts, groups, strict=True):
        if len(groups) > 1:
            part.suptitle(names.drawn_name(rows["group"][0], 60), fontsize=8)
        angle, torque, isolated_angle, isolated_torque = axes = part.subplots(2, 2).ravel()
        for ax, letter in zip(axes, "abcd", strict=True):
            ax.set_title(f"({letter})", loc="left", y=1)

        draw_gait(angle, rows, "angle")
        angle.set_ylabel("Ankle angle, dorsiflexion up (deg)")
        draw_gait(torque, rows, "torque")
        torque.set_ylabel("Ankle torque (N·m)")
        draw_isolated(isolated_angle, rows, "response angle")
        isolated_angle.set_ylabel("Isolated angle (deg)")
        draw_isolated(isolated_torque, rows, "response torque")
        isolated_torque.set_ylabel("Isolated torque (N·m)")

        entries = marks.legend_entries((torque, isolated_torque))
        part.legend(
            list(entries.values()), list(entries), loc="outside upper center", ncols=5,
            columnspacing=1.4,
        )  # fmt: skip
        part.align_ylabels()
    return figure


def curve(table: pl.DataFrame, panel: str, name: str) -> pl.DataFrame:
    """The points of one curve of a panel."""
    return table.filter(panel=panel, curve=name)


def shade(ax: Axes, rows: pl.DataFrame, panel: str) -> None:
    """Baseline and fitted window, which the panel of the angle has for both signals."""
    for name, look in SHADED.items():
        ends = curve(rows, panel.replace("torque", "angle"), name)["x"]
        if len(ends):
            ax.axvspan(float(ends[0]), float(ends[1]), linewidth=0, zorder=0, **look)


def draw_gait(ax: Axes, rows: pl.DataFrame, panel: str) -> None:
    """Mean ± SD of unperturbed and of perturbed crossings over stance."""
    shade(ax, rows, panel)
    has_band = False
    for name, (colour, dash, label) in GAIT.items():
        points = curve(rows, panel, name)
        if points.is_empty():
            continue
        x, mean, sd = (points[column].to_numpy() for column in ("x", "mean", "sd"))
        ax.fill_between(
            x, mean - sd, mean + sd, color=colour, alpha=style.BAND_ALPHA, linewidth=0,
            label="" if has_band else BAND_LABEL,
        )  # fmt: skip
        has_band = True
        n = int(points["n"][0])
        ax.plot(x, mean, color=colour, linestyle=dash, label=f"{label} ($n$ = {n})")
    ax.set_xlim(0, 100)
    ax.set_xlabel("Stance (%)")


def draw_isolated(ax: Axes, rows: pl.DataFrame, panel: str) -> None:
    """Every perturbation thin and doubtful ones dotted, the mean response, and the fit."""
    shade(ax, rows, panel)
    draw_perturbations(ax, curve(rows, panel, "each"))
    mean, fit = curve(rows, panel, "mean"), curve(rows, panel, "fit")
    ax.plot(
        mean["x"], mean["mean"],
        color=style.BLACK, linewidth=1.4, label=names.MEAN_RESPONSE.capitalize(),
    )  # fmt: skip
    if not fit.is_empty():
        ax.plot(
            fit["x"], fit["mean"],
            color=style.ORANGE, linewidth=1.4, linestyle=style.DASHED,
            label=r"Fit of $K\theta + B\dot\theta + I\ddot\theta$",
        )  # fmt: skip
    ax.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE)
    ax.axvline(0, color=style.BLACK, linewidth=style.HAIRLINE)
    times: Array = curve(rows, panel, "each")["x"].to_numpy()
    ax.set_xlim(float(times.min()), float(times.max()))
    ax.set_xlabel("Time from the perturbation’s onset (ms)")


def draw_perturbations(ax: Axes, responses: pl.DataFrame) -> None:
    """The responses of single perturbations, and once more in another look the doubtful ones."""
    trials = responses.partition_by("trial", maintain_order=True)
    doubtful = [trial for trial in trials if marks.has_doubtful(trial)]
    draw_each(ax, trials, "Each perturbation", color=style.GREY, alpha=0.45, linewidth=0.5)
    label = f"Doubtful fit ($n$ = {len(doubtful)})"
    draw_each(ax, doubtful, label, color=style.BLACK, linewidth=0.7, linestyle=style.DOTTED)


def draw_each(ax: Axes, trials: Sequence[pl.DataFrame], label: str, **look: Any) -> None:
    """The response of each of these trials, which leads to its trial; one of them is labelled."""
    for trial in trials:
        (line,) = ax.plot(trial["x"], trial["mean"], label=label, **look)
        line.set_url(marks.place_in_report(trial["trial"][0]))
        label = ""
