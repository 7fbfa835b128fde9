"""Fig. 9, the walking page, and the impedance over stance: what was measured on the ankle while walking."""

import textwrap
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.figures import style
from osl_analysis.figures.names import (
    UNIT_SIGN,
    as_text,
    count_of,
    decimals_of,
    doubtful_said,
    drawn_name,
    rounded_number,
    with_interval,
    with_sd,
)

SUMMARY_NEEDED = ("group", "quantity", "estimator", "n", "mean", "sd", "low", "high", "n_doubtful", "commanded")
"""Columns that Fig. 9 needs of `walking_summary.csv`."""
ESTIMATES = ("K", "B", "I")
FIT_COLUMNS = ("trial", "group", *ESTIMATES, "doubtful")  # and of `walking.csv`
FIG9_COLUMNS = (
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


def fig9_points(
    walking_summary: pl.DataFrame, walking: pl.DataFrame, over_stance: pl.DataFrame, commanded_K: float | None = None
) -> pl.DataFrame:
    """For each group and each of K, B and I a row with mean and SD over the perturbations and the ensemble's estimate
    with its 95 % interval, then a row per perturbation with its `estimate`. What is commanded comes from the sheet,
    from `commanded_K` [N*m/rad] for K in a campaign of one group, or from the trajectory at the phase that the fit
    reads (`over_stance`). Raises InputError: a quantity of a group is not in the summary, or nothing has a result."""
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
    types = dict.fromkeys(FIG9_COLUMNS, pl.Float64) | dict.fromkeys(
        ("group", "quantity", "trial", "doubtful"), pl.String
    )
    return pl.DataFrame(found, schema=types | {"n": pl.Int64, "n_doubtful": pl.Int64}).select(FIG9_COLUMNS)


def drawn_group(rows: dict[tuple[str, str, str], dict[str, Any]], group: str, quantity: str) -> dict[str, Any]:
    for estimator in (PER_PERTURBATION, BY_ENSEMBLE):
        if (group, estimator, quantity) not in rows:
            raise InputError(
                f"the walking summary has no '{quantity}' by the estimator '{estimator}', which Fig. 9 draws; fit the "
                "crossings again"
            )
    mean, ensemble = (rows[group, estimator, quantity] for estimator in (PER_PERTURBATION, BY_ENSEMBLE))
    found = {name: mean[name] for name in ("n", "mean", "sd", "n_doubtful")} | {"commanded": ensemble["commanded"]}
    return found | {"ensemble": ensemble["mean"], **{f"ensemble_{end}": ensemble[end] for end in ("low", "high")}}


@style.paper_style()
def draw_fig9(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: a point per perturbation, open where its fit is doubtful, beside them their mean with one SD
    on either side and the fit to the mean response with its 95 % interval, commanded values dashed. Several groups
    stand side by side, in panels one above the other, with the number of perturbations in brackets."""
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
    x = at + style.swarm_offsets(heights, 3.4 / 72, inches, FROM_MIDDLE)
    style.draw_fits(ax, fits, x, fits["estimate"], style.Look(style.GREY, "o", 2.6, LEGEND[0]), linewidths=0.6)


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


def fig9_caption(table: pl.DataFrame) -> str:
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
    name, unit = rf"$\hat{{{row['quantity']}}}$", UNIT_SIGN[row["quantity"]]
    commanded = "" if row["commanded"] is None else f", commanded {row['commanded']:g}"
    if row["mean"] is None:
        return f"{name} has no mean of several perturbations{commanded}"
    ensemble = with_interval(row["ensemble"], row["ensemble_low"], row["ensemble_high"], unit)
    return f"{name} is {with_sd(row['mean'], row['sd'], unit)}, of the mean response {ensemble}{commanded}"


GAIT = {"unperturbed": (style.PURPLE, "-", "Unperturbed"), "perturbed": (style.ORANGE, (0, (5, 1.5)), "Perturbed")}
RESPONSES = {"response angle": "deg", "response torque": "N·m"}


@style.paper_style()
def draw_walking_page(table: pl.DataFrame) -> Figure:
    """Over stance (a) angle and (b) torque, over time (c) isolated angle and (d) isolated torque, for each group."""
    groups = table.partition_by("group", maintain_order=True)
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 4.4 * len(groups)), layout="constrained")
    parts = figure.subfigures(len(groups), 1, squeeze=False)[:, 0]
    for part, rows in zip(parts, groups, strict=True):
        if len(groups) > 1:
            part.suptitle(drawn_name(rows["group"][0], 60), fontsize=8)
        axes = part.subplots(2, 2)
        draw_panels(axes, rows)
        found = style.legend_entries((axes[0, 1], axes[1, 1]))
        part.legend(list(found.values()), list(found), loc="outside upper center", ncols=4)
    return figure


def draw_panels(axes: NDArray[np.object_], table: pl.DataFrame) -> None:
    for ax, letter in zip(axes.ravel(), "abcd", strict=True):
        ax.set_title(f"({letter})", loc="left")
    for ax, panel in zip(axes[0], ("angle", "torque"), strict=True):
        draw_intervals(ax, table, "angle")
        draw_gait(ax, table.filter(pl.col("panel") == panel))
    for ax, panel in zip(axes[1], RESPONSES, strict=True):
        draw_intervals(ax, table, "response angle")
        draw_isolated(ax, table, panel)
    axes[0, 0].set_ylabel("Ankle angle, dorsiflexion up (deg)")
    axes[0, 1].set_ylabel("Ankle torque (N·m)")
    axes[1, 0].set_ylabel("Isolated angle (deg)")
    axes[1, 1].set_ylabel("Isolated torque (N·m)")


def curve(table: pl.DataFrame, panel: str, name: str) -> pl.DataFrame:
    return table.filter((pl.col("panel") == panel) & (pl.col("curve") == name))


def draw_intervals(ax: Axes, table: pl.DataFrame, panel: str) -> None:
    looks: dict[str, dict[str, Any]] = {
        "baseline": {"facecolor": "none", "edgecolor": "#C4C4C4", "hatch": "////", "label": "Baseline"},
        "window": {"color": style.PALE_ORANGE, "alpha": 0.5, "label": "Fitted window"},
    }
    for name, look in looks.items():
        ends = curve(table, panel, name)["x"]
        if len(ends):
            ax.axvspan(float(ends[0]), float(ends[1]), linewidth=0, zorder=0, **look)


def draw_gait(ax: Axes, rows: pl.DataFrame) -> None:
    for name, (colour, dashes, label) in GAIT.items():
        one = rows.filter(pl.col("curve") == name)
        x, mean, sd = (one[column].to_numpy() for column in ("x", "mean", "sd"))
        ax.fill_between(x, mean - sd, mean + sd, color=colour, alpha=0.25, linewidth=0)
        ax.plot(x, mean, color=colour, linestyle=dashes, label=f"{label} ($n$ = {int(one['n'][0])})")
    ax.set_xlim(0, 100)
    ax.set_xlabel("Stance (%)")


def draw_isolated(ax: Axes, table: pl.DataFrame, panel: str) -> None:
    """Every perturbation thin, their mean, and the fit."""
    every = curve(table, panel, "each")
    trials = every.partition_by("trial", maintain_order=True)
    doubtful = [one for one in trials if len(one.filter(style.DRAWN_OPEN))]
    looks: list[tuple[list[pl.DataFrame], str, dict[str, Any]]] = [
        (trials, "Each perturbation", {"color": style.GREY, "alpha": 0.45, "linewidth": 0.5}),
        (
            doubtful,
            f"Doubtful fit ($n$ = {len(doubtful)})",
            {"color": style.BLACK, "linewidth": 0.7, "linestyle": style.DOTTED},
        ),
    ]
    for drawn, label, look in looks:
        for place, one in enumerate(drawn):
            (line,) = ax.plot(one["x"], one["mean"], label=None if place else label, **look)
            line.set_url(style.place_in_report(one["trial"][0]))
    mean, fit = curve(table, panel, "mean"), curve(table, panel, "fit")
    ax.plot(mean["x"], mean["mean"], color=style.BLACK, linewidth=1.4, label="Mean")
    if not fit.is_empty():
        label = r"Fit of $K\theta + B\dot\theta + I\ddot\theta$"
        ax.plot(fit["x"], fit["mean"], color=style.ORANGE, linewidth=1.4, linestyle=style.DASHED, label=label)
    ax.axhline(0, color=style.BLACK, linewidth=0.4)
    ax.axvline(0, color=style.BLACK, linewidth=0.4)
    ax.set_xlim(float(every["x"].min()), float(every["x"].max()))  # type: ignore[arg-type]
    ax.set_xlabel("Time from the platform’s onset (ms)")


def walking_page_caption(table: pl.DataFrame) -> str:
    groups = table.partition_by("group", maintain_order=True)
    said = [
        "From crossings to the responses that Fig. 9 fits. (a) Ankle angle and (b) ankle torque over stance, mean ± SD "
        "of unperturbed and perturbed crossings. (c) Isolated angle and (d) isolated torque: every perturbed crossing "
        "minus the mean unperturbed gait at the same phase of stance, their mean, and the fit of Eq. 15 to it in the "
        "shaded window."
    ]
    if len(ends := curve(groups[0], "response angle", "baseline")["x"]):
        said.append(
            f"Each response is zero on average over the hatched baseline, {rounded_number(ends[0], 0)} to "
            f"{rounded_number(ends[1], 0)} ms from the onset, and not at the onset: in between, a crossing's own gait "
            "departs from the mean one, and the zero-phase filter spreads the platform's motion to times before the "
            "onset. The fit has no offset, so that both are in it."
        )
    most = 4
    for rows in groups[:most]:
        name = f"{as_text(rows['group'][0])}: " if len(groups) > 1 else ""
        counts = {name: int(curve(rows, "angle", name)["n"][0]) for name in GAIT}
        crossings = f"{count_of(counts['unperturbed'], 'unperturbed crossing')} and {counts['perturbed']} perturbed"
        said.append(f"{name}{crossings}; {onset_said(rows)}.")
    if len(groups) > most:
        said.append(f"The numbers of {len(groups) - most} more groups stand in walking_page.csv.")
    fits = table.filter(pl.col("curve") == "each").unique("trial", maintain_order=True)
    return " ".join([*said, doubtful_said(fits, "dotted")])


def onset_said(rows: pl.DataFrame) -> str:

    def at_onset(of: pl.DataFrame) -> pl.Series:
        nearest = of.sort(pl.col("x").abs(), maintain_order=True).group_by("trial", maintain_order=True).first()
        return nearest["mean"]

    said = []
    for panel, unit in RESPONSES.items():
        mean, each = (at_onset(curve(rows, panel, name)) for name in ("mean", "each"))
        sd = float(each.std()) if len(each) > 1 else 0.0  # type: ignore[arg-type]
        digits = decimals_of(sd or 0.1 * float(mean[0]))
        said.append(
            f"{rounded_number(float(mean[0]), digits)} {unit}" + (f" (SD {rounded_number(sd, digits)})" if sd else "")
        )
    return f"at the onset the mean response is {' and '.join(said)}"


SERIES_LOOKS = ((style.PURPLE, "o"), (style.ORANGE, "D"), ("#3F8FBF", "s"), ("#6B3A0A", "^"))
"""Colours and markers of the series."""
COMMANDED_SERIES = "commanded"  # series of the curve that the controller commands; all other series are estimates
WIDTHS = {"interval": 1.2, "window": 0.6}  # of lines [pt]


def over_stance_caption(table: pl.DataFrame) -> str:
    said = [
        "Impedance of the ankle over stance: (a) stiffness, (b) damping, (c) inertia. A marker is the fit to the mean "
        "response of a group, at the phase that the fit reads. Upright bars are 95 % intervals, level ones the windows "
        "of the fits."
    ]
    if table["commanded"].count():
        said.append("Dashed, and short black lines at the groups: what the controller commands.")
    estimates = table.filter(pl.col("series") != COMMANDED_SERIES)
    for rows in estimates.sort("phase").partition_by("series", "phase", maintain_order=True):
        told = "; ".join(
            f"${row['quantity']}$ {with_interval(row['estimate'], row['low'], row['high'], UNIT_SIGN[row['quantity']])}"
            for row in rows.drop_nulls("estimate").iter_rows(named=True)
        )
        counts = rows["n"].drop_nulls() if "n" in rows.columns else rows["phase"].clear()
        of = f", {count_of(int(counts[0]), 'perturbation')}" if len(counts) else ""
        if told:
            said.append(f"{as_text(rows['series'][0])} at {100 * rows['phase'][0]:.0f} % of stance{of}: {told}.")
    return " ".join(said)


@style.paper_style()
def draw_over_stance(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: the fit of each group at the phase that it reads, its fitted window as a horizontal bar, its
    95 % interval as a vertical one. The commanded impedance is dashed, and a short line at each group."""
    figure, axes = style.panels(style.DOUBLE_COLUMN, 2.6, columns=3)
    names = [name for name in table["series"].unique(maintain_order=True) if name != COMMANDED_SERIES]
    for ax, quantity in zip(axes, ESTIMATES, strict=True):
        rows = table.filter(pl.col("quantity") == quantity)
        curve = rows.filter(pl.col("series") == COMMANDED_SERIES)
        if len(curve):
            ax.plot(
                100 * curve["phase"], curve["commanded"], color=style.BLACK, linestyle=style.DASHED, label="Commanded"
            )
        for number, name in enumerate(names):
            label = "Fit of mean response" if len(names) == 1 else drawn_name(name)
            draw_series(ax, rows.filter(pl.col("series") == name), *SERIES_LOOKS[number % len(SERIES_LOOKS)], label)
        ax.axhline(0, color=style.BLACK, linewidth=0.4, zorder=0)
        ax.set_xlim(0, 100)
        ax.set_xlabel("Stance (%)")
        ax.set_ylabel(AXIS_LABELS[quantity])
    named = style.legend_entries(axes)
    for marker, width, label in zip("|_", WIDTHS.values(), ("95 % interval", "Fitted window"), strict=True):
        named[label] = Line2D([], [], color=style.BLACK, linestyle="", marker=marker, markersize=8, mew=width)
    style.legend_above(figure, named, 6)
    return figure


def draw_series(ax: Axes, rows: pl.DataFrame, colour: str, marker: str, label: str) -> None:
    rows = rows.sort("phase")
    x, estimate, low, high = (rows[name].to_numpy() for name in ("phase", "estimate", "low", "high"))
    ends = np.array([rows["phase"] - rows["onset_phase"], rows["end_phase"] - rows["phase"]])
    ax.plot(100 * x, rows["commanded"].to_numpy(), "_", color=style.BLACK, markersize=9, mew=1.2, zorder=1.5)
    ax.vlines(100 * x, low, high, color=colour, linewidth=WIDTHS["interval"])
    window = {"linewidth": WIDTHS["window"], "capsize": 1.5}
    ax.errorbar(100 * x, estimate, xerr=100 * np.abs(ends), fmt="none", color=colour, **window)  # type: ignore[arg-type]
    ax.plot(100 * x, estimate, marker, color=colour, markersize=3.5, mew=0, label=label)


FIG9 = style.Drawing(FIG9_COLUMNS, draw_fig9, fig9_caption, fig9_points)
WALKING_PAGE = style.Drawing(
    ("group", "panel", "curve", "trial", "x", "mean", "sd", "doubtful"), draw_walking_page, walking_page_caption
)
IMPEDANCE_OVER_STANCE = style.Drawing(
    ("series", "quantity", "phase", "onset_phase", "end_phase", "estimate", "low", "high", "commanded"),
    draw_over_stance,
    over_stance_caption,
)
