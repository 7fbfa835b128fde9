"""Fig. 9, the walking page, and the impedance over stance: what was measured on the ankle while
walking."""

import textwrap
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import columns_of, names, style


def fig9_points(
    walking_summary: pl.DataFrame,
    walking: pl.DataFrame,
    over_stance: pl.DataFrame,
    commanded_K: float | None = None,
) -> pl.DataFrame:
    """For each group and quantity a row with mean and SD over the perturbations, the ensemble's
    estimate and interval, then a row per perturbation. What is commanded comes from the sheet, else
    from `commanded_K` [N*m/rad] in a campaign of one group, else from the trajectory
    (`over_stance`). Raises InputError: nothing has a result."""
    rows = {
        (r["group"], r["estimator"], r["quantity"]): r
        for r in walking_summary.iter_rows(named=True)
    }
    rows = {key: row for key, row in rows.items() if row["mean"] is not None}
    fits = walking.drop_nulls("group").filter(pl.all_horizontal(pl.col("K", "B", "I").is_finite()))
    groups = list(dict.fromkeys([*(group for group, _, _ in rows), *fits["group"]]))
    if not groups:
        raise InputError(
            "no perturbation has a fit, which Fig. 9 draws; see the reasons in walking_excluded.csv"
        )
    trajectory = {
        (r["group"], r["quantity"]): r["commanded"] for r in over_stance.iter_rows(named=True)
    }
    found: list[dict[str, Any]] = []
    for group, quantity in product(groups, "KBI"):
        of_group = fits.filter(group=group)
        single = of_group.select("group", "trial", "doubtful", pl.col(quantity).alias("estimate"))
        row: dict[str, Any] = {"group": group, "quantity": quantity, "n": len(single)}
        stated = None
        if mean := rows.get((group, "mean of perturbations", quantity)):
            ensemble = rows[group, "ensemble", quantity]
            row |= {name: mean[name] for name in ("n", "mean", "sd")} | {
                "ensemble": ensemble["mean"]
            }
            row |= {f"ensemble_{end}": ensemble[end] for end in ("low", "high")}
            stated, row["doubtful"] = ensemble["commanded"], ensemble.get("doubt")
        configured = commanded_K if quantity == "K" and len(groups) == 1 else None
        known = (stated, configured, trajectory.get((group, quantity)))
        found.append(
            row | {"commanded": next((value for value in known if value is not None), None)}
        )
        found += [{"quantity": quantity, **one} for one in single.iter_rows(named=True)]
    text = dict.fromkeys(("group", "quantity", "trial", "doubtful"), pl.String)
    types = dict.fromkeys(columns_of("fig9"), pl.Float64) | text | {"n": pl.Int64}
    return pl.DataFrame(found, schema=types)


@style.drawing(columns_of("fig9"), fig9_points)
def draw_fig9(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B, (c) I: a point per perturbation, open where doubtful, beside them their mean
    with one SD on either side and the fit to the mean response with its interval. Several groups
    stand in panels one above the other."""
    groups = table["group"].unique(maintain_order=True).to_list()
    single = len(groups) == 1
    page = (style.SINGLE_COLUMN, 2.6, 1, 3) if single else (style.DOUBLE_COLUMN, 4.8, 3, 1)
    figure, axes = style.panels(*page)
    # On the axis, from the middle of a group: the reach of its points, its mean, its ensemble, and
    # the next group
    reach, mean_at, ensemble_at, apart = 0.32, 0.55, 0.85, 1.8
    span = (len(groups) - 1) * apart + 1.6
    # beside what is written [in]
    width = (style.SINGLE_COLUMN / 3 if single else style.DOUBLE_COLUMN) - 0.45
    black: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8}
    purple: dict[str, Any] = {"color": style.PURPLE, "linewidth": 1.2, "capsize": 2.5}
    point = style.Look(style.GREY, "o", 2.6, "One perturbation")
    for ax, quantity in zip(axes, "KBI", strict=True):
        rows = table.filter(pl.col("quantity") == quantity)
        of_groups = rows.filter(pl.col("trial").is_null())
        for place, row in enumerate(of_groups.iter_rows(named=True)):
            at, fits = place * apart, rows.filter(group=row["group"]).drop_nulls("trial")
            # Points that would overlap stand side by side: they spread over 1.2 in of a panel, and
            # each takes 3.4 pt
            spread = max(float(np.ptp(rows["estimate"].drop_nulls().to_numpy())), 1e-9)
            x = at + style.swarm_offsets(
                (fits["estimate"] / spread * 1.2).to_numpy(), 3.4 / 72, width / span, reach
            )
            style.draw_fits(ax, fits, x, fits["estimate"], point, linewidths=0.6)
            if row["commanded"] is not None:
                ends = [at - reach - 0.1, at + ensemble_at + 0.15]
                ax.plot(
                    ends,
                    [row["commanded"]] * 2,
                    **black,
                    linestyle=style.DASHED,
                    zorder=0,
                    label="Commanded",
                )
            if row["mean"] is None:
                continue
            sd = None if row["sd"] is None else [row["sd"]]
            marked: dict[str, Any] = {
                "fmt": "s",
                "markersize": 3,
                "capsize": 2.5,
                "label": "Mean ± SD",
            }
            ax.errorbar([at + mean_at], [row["mean"]], yerr=sd, **black, **marked)
            # percentiles, not about the estimate
            low, high = row["ensemble_low"], row["ensemble_high"]
            ax.errorbar(
                [at + ensemble_at],
                [(low + high) / 2],
                yerr=[(high - low) / 2],
                fmt="none",
                **purple,
            )
            look: dict[str, Any] = {"markersize": 3.2, "label": "Fit of averaged response, 95 %"}
            ax.plot([at + ensemble_at], [row["ensemble"]], "D", color=style.PURPLE, **look)
        if quantity == "I" or ax.dataLim.y0 < 0:
            ax.axhline(0, color=style.BLACK, linewidth=0.5, zorder=0)
        ax.set_xlim(-0.5, span - 0.5)
        ax.set_xticks([] if single else [n * apart + mean_at / 2 for n in range(len(groups))])
        if not single:
            letters = max(int(17 * width / len(groups)), 6)
            told = [
                f"{names.drawn_name(group, 60)} ({n})"
                for group, n in of_groups.select("group", "n").iter_rows()
            ]
            told = [name.replace("K_d", "$K_d$").replace("B_d", "$B_d$") for name in told]
            ax.set_xticklabels(
                ["\n".join(textwrap.wrap(name, letters, break_long_words=False)) for name in told]
            )
        ax.set_ylabel(names.AXIS_LABELS[quantity])
    found = style.legend_entries(axes[:1])
    order = ("One perturbation", "Mean ± SD", "Fit of averaged response, 95 %", "Commanded")
    labels = {name: found[name] for name in order if name in found}
    labels |= style.open_entry(table)
    figure.legend(
        list(labels.values()), list(labels), loc="outside upper center", ncols=2 if single else 5
    )
    return figure


GAIT: dict[str, tuple[str, style.Dash, str]] = {
    "unperturbed": (style.PURPLE, (0, ()), "Unperturbed"),
    "perturbed": (style.ORANGE, (0, (5.0, 1.5)), "Perturbed"),
    "perturbed up": (style.ORANGE, (0, (5.0, 1.5)), "Toes up"),
    "perturbed down": ("#3F8FBF", (0, (1.5, 1.0)), "Toes down"),
}


@style.drawing(("group", "panel", "curve", "trial", "x", "mean", "sd", "doubtful"))
def draw_walking_page(table: pl.DataFrame) -> Figure:
    """Over stance (a) angle and (b) torque, over time (c) isolated angle and (d) isolated torque,
    for each group."""
    groups = table.partition_by("group", maintain_order=True)
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 4.4 * len(groups)), layout="constrained")
    parts = figure.subfigures(len(groups), 1, squeeze=False)[:, 0]
    panels = {"angle": "Ankle angle, dorsiflexion up (deg)", "torque": "Ankle torque (N·m)"}
    panels |= {"response angle": "Isolated angle (deg)", "response torque": "Isolated torque (N·m)"}
    intervals: dict[str, dict[str, Any]] = {
        "baseline": {
            "facecolor": "none",
            "edgecolor": "#C4C4C4",
            "hatch": "////",
            "label": "Baseline",
        },
        "window": {"color": "#F5C09A", "alpha": 0.5, "label": "Fitted window"},
    }
    for part, rows in zip(parts, groups, strict=True):
        if len(groups) > 1:
            part.suptitle(names.drawn_name(rows["group"][0], 60), fontsize=8)
        axes = part.subplots(2, 2)
        for ax, letter, (panel, label) in zip(axes.ravel(), "abcd", panels.items(), strict=True):
            ax.set_title(f"({letter})", loc="left", y=1)
            ax.set_ylabel(label)
            for name, look in intervals.items():
                ends = curve(rows, panel.replace("torque", "angle"), name)["x"]
                if len(ends):
                    ax.axvspan(float(ends[0]), float(ends[1]), linewidth=0, zorder=0, **look)
            if panel.startswith("response"):
                draw_isolated(ax, rows, panel)
                continue
            for name, (colour, dashes, label) in GAIT.items():
                if (one := curve(rows, panel, name)).is_empty():
                    continue
                x, mean, sd = (one[column].to_numpy() for column in ("x", "mean", "sd"))
                ax.fill_between(x, mean - sd, mean + sd, color=colour, alpha=0.25, linewidth=0)
                ax.plot(
                    x,
                    mean,
                    color=colour,
                    linestyle=dashes,
                    label=f"{label} ($n$ = {int(one['n'][0])})",
                )
            ax.set_xlim(0, 100)
            ax.set_xlabel("Stance (%)")
        found = style.legend_entries((axes[0, 1], axes[1, 1]))
        part.legend(list(found.values()), list(found), loc="outside upper center", ncols=4)
    return figure


def curve(table: pl.DataFrame, panel: str, name: str) -> pl.DataFrame:
    return table.filter((pl.col("panel") == panel) & (pl.col("curve") == name))


def draw_isolated(ax: Axes, table: pl.DataFrame, panel: str) -> None:
    """Every perturbation thin, their mean, and the fit."""
    every, mean, fit = (curve(table, panel, name) for name in ("each", "mean", "fit"))
    trials = every.partition_by("trial", maintain_order=True)
    doubtful = [one for one in trials if style.has_doubtful(one)]
    thin: dict[str, Any] = {
        "alpha": 0.45,
        "linewidth": 0.5,
        "color": style.GREY,
        "label": "Each perturbation",
    }
    dotted: dict[str, Any] = {"linewidth": 0.7, "linestyle": style.DOTTED, "color": style.BLACK}
    for drawn, look in (
        (trials, thin),
        (doubtful, dotted | {"label": f"Doubtful fit ($n$ = {len(doubtful)})"}),
    ):
        for place, one in enumerate(drawn):
            (line,) = ax.plot(one["x"], one["mean"], **look | ({"label": None} if place else {}))
            line.set_url(style.place_in_report(one["trial"][0]))
    averaged = "Half of up minus down" if "perturbed down" in table["curve"] else "Averaged"
    ax.plot(mean["x"], mean["mean"], color=style.BLACK, linewidth=1.4, label=averaged)
    if not fit.is_empty():
        label = r"Fit of $K\theta + B\dot\theta + I\ddot\theta$"
        ax.plot(
            fit["x"],
            fit["mean"],
            color=style.ORANGE,
            linewidth=1.4,
            linestyle=style.DASHED,
            label=label,
        )
    ax.axhline(0, color=style.BLACK, linewidth=0.4)
    ax.axvline(0, color=style.BLACK, linewidth=0.4)
    ax.set_xlim(float(every["x"].min()), float(every["x"].max()))  # type: ignore[arg-type]
    ax.set_xlabel("Time from the platform’s onset (ms)")


@style.drawing(
    (
        "series",
        "quantity",
        "phase",
        "onset_phase",
        "end_phase",
        "estimate",
        "low",
        "high",
        "commanded",
    ),
    nothing=(
        "all perturbations are at one phase of stance, and no curve is commanded; Fig. 9 shows them"
    ),
)
def draw_impedance_over_stance(table: pl.DataFrame) -> Figure:
    """K, B and I, those that the table has: the fit of each group at the phase that it reads, its
    fitted window as a horizontal bar, its 95 % interval as a vertical one. The commanded impedance
    is dashed, or a short line."""
    drawn = [quantity for quantity in "KBI" if quantity in table["quantity"]]
    width = style.SINGLE_COLUMN if len(drawn) == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, 2.6, columns=len(drawn))
    series = [name for name in table["series"].unique(maintain_order=True) if name != "commanded"]
    # colours and markers
    looks = ((style.PURPLE, "o"), (style.ORANGE, "D"), ("#3F8FBF", "s"), ("#6B3A0A", "^"))
    interval, window = 1.2, 0.6  # widths of lines [pt]
    for ax, quantity in zip(axes, drawn, strict=True):
        rows = table.filter(pl.col("quantity") == quantity)
        # the curve, all other series are estimates
        given = rows.filter(pl.col("series") == "commanded")
        if len(given):
            line = ax.plot(
                100 * given["phase"], given["commanded"], color=style.BLACK, label="Commanded"
            )[0]
            line.set_linestyle(style.DASHED)
        for number, name in enumerate(series):
            one, (colour, marker) = (
                rows.filter(series=name).sort("phase"),
                looks[number % len(looks)],
            )
            label = "Fit of mean response" if len(series) == 1 else names.drawn_name(name)
            x, ends = (
                100 * one["phase"].to_numpy(),
                one.select("onset_phase", "end_phase").to_numpy().T,
            )
            ax.plot(
                x,
                one["commanded"].to_numpy(),
                "_",
                color=style.BLACK,
                markersize=9,
                mew=1.2,
                zorder=1.5,
            )
            ax.vlines(x, one["low"], one["high"], color=colour, linewidth=interval)
            bars: dict[str, Any] = {
                "xerr": np.abs(100 * ends - x),
                "linewidth": window,
                "capsize": 1.5,
            }
            ax.errorbar(x, one["estimate"], fmt="none", color=colour, **bars)
            ax.plot(x, one["estimate"], marker, color=colour, markersize=3.5, mew=0, label=label)
        ax.axhline(0, color=style.BLACK, linewidth=0.4, zorder=0)
        ax.set_xlim(0, 100)
        ax.set_xlabel("Stance (%)")
        ax.set_ylabel(names.AXIS_LABELS[quantity])
    named = style.legend_entries(axes)
    for marker, width, label in (("|", interval, "95 % interval"), ("_", window, "Fitted window")):
        named[label] = style.key(label, color=style.BLACK, marker=marker, markersize=8, mew=width)
    style.legend_above(figure, named, 6)
    return figure


@style.paper_style()
def draw_half_widths(table: pl.DataFrame) -> Figure:
    """Half of the 95 % interval of K, B and I that is expected, against the number of perturbed
    crossings, by gait."""
    figure, axes = style.panels(style.DOUBLE_COLUMN, 2.4, columns=3)
    for ax, quantity in zip(axes, "KBI", strict=True):
        for gait, rows in table.group_by("gait", maintain_order=True):
            ax.loglog(
                rows["n"], rows[quantity], "o-", markersize=3, label=names.drawn_name(str(gait[0]))
            )
        ax.set_xlabel("Perturbed crossings")
        ax.set_ylabel(f"Half of the 95 % interval, {names.AXIS_LABELS[quantity]}")
    if table["gait"].n_unique() > 1:
        style.legend_above(figure, style.legend_entries(axes), 4)
    return figure
