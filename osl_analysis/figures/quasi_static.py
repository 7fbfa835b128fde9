"""Fig. 3 and `torque_angle`: torque against angle of the belt, and of a joint that is moved
slowly."""

from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from scipy.stats import median_abs_deviation

from osl_analysis.figures import columns_of, names, style
from osl_analysis.judge.causes import doubts_of_result
from osl_analysis.stats.repeats import IS_DOUBTFUL

# robust standard deviations (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993)
OUTLYING = 3.5
# name that takes the place of the trial in the two rows that carry the mean slope
MEAN_SLOPE = "mean slope"
# with the line styles of sound trials
BRANCHES: dict[str, style.Dash] = {"loading": "-", "unloading": (0, (6, 3))}
GREY_TRIAL: dict[str, Any] = {"color": "#B4B4B4", "linewidth": 0.9}
DOUBTFUL_TRIAL: dict[str, Any] = {"color": style.BLACK, "linestyle": style.DOTTED, "linewidth": 0.9}
MEAN_LINE: dict[str, Any] = {"color": style.MAGENTA, "linestyle": style.DASHED, "linewidth": 1.3}


@style.drawing(columns_of("fig3"))
def draw_fig3(table: pl.DataFrame) -> Figure:
    """Above, torque over deflection, the mean slope dashed; below, torque minus that of the mean
    slope."""
    parts = names.placed_rows(table)
    across = min(len(parts), 2)
    rows = 2 * -(-len(parts) // across)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(
        width, 0.4 + 1.8 * rows, rows=rows, columns=across, names=[""] * (rows * across)
    )
    for number, (name, part) in enumerate(parts):
        above = 2 * across * (number // across) + number % across
        belts, loops = axes[above], axes[above + across]
        trials = part.filter(pl.col("trial") != MEAN_SLOPE).partition_by(
            "trial", maintain_order=True
        )
        mean, dotted = (
            part.filter(pl.col("trial") == MEAN_SLOPE),
            list(filter(style.has_doubtful, trials)),
        )
        for drawn, look in ((trials, GREY_TRIAL), (dotted, DOUBTFUL_TRIAL), ([mean], MEAN_LINE)):
            for one in drawn:
                belts.plot(one["theta_s_deg"], one["torque"], **look)
        belts.tick_params(labelbottom=False)
        belts.set_ylabel("Joint torque (N·m)")
        for K_s, low, high in mean.select("K_s", "K_s_low", "K_s_high").head(1).iter_rows():
            text = rf"$\hat{{K}}_s = {K_s:.1f}$ N·m/rad"
            text += (
                ""
                if low is None or high is None
                else f"\n95 % interval {low:.1f} to {high:.1f} N·m/rad"
            )
            belts.text(
                0.99,
                0.04,
                text,
                transform=belts.transAxes,
                ha="right",
                va="bottom",
                linespacing=1.4,
            )
        draw_loops(loops, trials, part["hysteresis_area"].drop_nulls())
        place = f"{name}: " * (len(parts) > 1)
        for ax, word in ((belts, "Torque"), (loops, "Hysteresis")):
            ax.set_title(f"{ax.get_title(loc='left')} {place}{word}", loc="left", y=1)
        loops.sharex(belts)
    for ax in axes:
        if not ax.has_data():
            ax.remove()
    fits = table.filter(pl.col("trial") != MEAN_SLOPE)
    entries = [style.key(f"Trials ($n$ = {fits['trial'].n_unique()})", color=GREY_TRIAL["color"])]
    if style.has_doubtful(fits):
        doubtful = fits.filter(IS_DOUBTFUL)["trial"].n_unique()
        entries.append(style.key(f"Doubtful fit ($n$ = {doubtful})", **DOUBTFUL_TRIAL))
    entries.append(style.key("Mean slope while loading", **MEAN_LINE))
    for branch, dash in BRANCHES.items():
        entries.append(
            style.key(branch.capitalize(), color=style.BLACK, linestyle=dash, linewidth=0.5)
        )
    figure.legend(
        handles=entries,
        loc="outside upper center",
        ncols=2 if len(figure.axes) == 2 else len(entries),
    )
    return figure


def draw_loops(ax: Axes, trials: list[pl.DataFrame], areas: pl.Series) -> None:
    """Every loop in grey, doubtful ones dotted; those in a colour, with their names, that end more
    than `OUTLYING` standard deviations from the median. Each leads to its trial."""
    ax.axhline(0, **MEAN_LINE)
    ends = [one.row(int(one["theta_s_deg"].abs().arg_max() or 0), named=True) for one in trials]
    far = np.array([end["deviation"] for end in ends])
    limit = OUTLYING * median_abs_deviation(far, scale="normal")
    for trial, end, away in zip(trials, ends, np.abs(far - np.median(far)), strict=True):
        doubtful, colour = (
            style.has_doubtful(trial),
            style.ORANGE if away > limit > 0 else style.GREY,
        )
        if colour == style.ORANGE:
            place, name = (end["theta_s_deg"], end["deviation"]), names.drawn_name(end["trial"], 12)
            ax.annotate(name, place, (3, 0), textcoords="offset points", color=colour, va="center")
        for branch, dash in BRANCHES.items():
            rows = trial.filter(pl.col("branch") == branch)
            line = style.DOTTED if doubtful else dash
            (drawn,) = ax.plot(
                rows["theta_s_deg"], rows["deviation"], color=colour, linestyle=line, linewidth=0.5
            )
            drawn.set_url(style.place_in_report(trial["trial"][0]))
    for area in areas.head(1):
        ax.text(0.02, 0.04, f"Mean loop area {area:.3g} J", transform=ax.transAxes, va="bottom")
    ax.set_xlabel(r"Transmission deflection $\theta_s$ (deg)")
    ax.set_ylabel("Torque minus\nmean slope (N·m)")


CURVE_COLUMNS = [
    name for name in columns_of("torque_angle") if name not in (*names.JOINT_SIDE, "doubtful")
]
WIDTHS = {"loading": 1.1, "unloading": 0.6}  # of curves [pt]


def torque_angle_points(curves: pl.DataFrame, table: pl.DataFrame) -> pl.DataFrame:
    facts = names.completed(table, ("trial", *names.JOINT_SIDE, "doubtful"), True)
    joined = curves.select(CURVE_COLUMNS).join(facts, on="trial", how="left", maintain_order="left")
    return joined.select(columns_of("torque_angle"))


@style.drawing(columns_of("torque_angle"), torque_angle_points, CURVE_COLUMNS)
def draw_torque_angle(table: pl.DataFrame) -> Figure:
    """(a) Torque against angle, desired curves dashed; (b) stiffness while loading with its 95 %
    interval."""
    parts = names.placed_rows(table)
    # trials with a desired curve share its colour, the others go through a colour map in order, but
    # for its end that stands out from white by less than three to one
    desired_of = dict(table.select("trial", "desired").unique(maintain_order=True).iter_rows())
    others = [trial for trial, desired in desired_of.items() if desired is None]
    shades = mpl.colormaps["viridis"](np.linspace(0, 0.6, max(len(others), 1)))
    wanted = list(dict.fromkeys(desired_of.values()))
    of_desired = (style.MAGENTA, style.ORANGE, style.PURPLE, "#6B3A0A")
    colours = {
        name: of_desired[wanted.index(desired) % 4]
        for name, desired in desired_of.items()
        if desired
    }
    colours |= {name: to_hex(shade) for name, shade in zip(others, shades, strict=False)}
    titles = names.panel_titles(parts, ("Torque", "Stiffness"))
    figure, axes = style.panels(
        style.DOUBLE_COLUMN, 3.0 * len(parts) + 0.3, rows=len(parts), columns=2, names=titles
    )
    for number, (_, part) in enumerate(parts):
        draw_curves(axes[2 * number], axes[2 * number + 1], part, colours)
    entries: list[tuple[str, float, Any]] = [
        (branch.capitalize(), width, "-") for branch, width in WIDTHS.items()
    ]
    entries += [("Desired", WIDTHS["loading"], style.DASHED)] * (
        table["desired_torque"].count() > 0
    )
    entries += [("Doubtful trial", WIDTHS["loading"], style.DOTTED)] * style.has_doubtful(table)
    handles = [
        style.key(label, color=style.BLACK, linewidth=w, linestyle=dash)
        for label, w, dash in entries
    ]
    if len(colours) <= 16:  # more are not named
        named = {name: names.drawn_name(name.replace("_", " "), 18) for name in desired_of}
        handles += [
            style.key(label, color=colours[name], linewidth=1.1) for name, label in named.items()
        ]
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def draw_curves(left: Axes, right: Axes, table: pl.DataFrame, colours: dict[str, str]) -> None:
    """Torque of both branches of every trial, and desired torque, on the left; stiffness while
    loading on the right."""
    for trial in table.partition_by("trial", maintain_order=True):
        look: dict[str, Any] = {"linestyle": style.DOTTED if style.has_doubtful(trial) else "-"}
        look["color"] = colours[trial["trial"][0]]
        for branch, width in WIDTHS.items():
            rows = trial.filter(pl.col("branch") == branch)
            (drawn,) = left.plot(rows["angle_deg"], rows["torque"], linewidth=width, **look)
            drawn.set_url(style.place_in_report(trial["trial"][0]))
        look["linestyle"] = (
            style.DOTTED if doubts_of_result(trial["doubtful"][0] or "", "K") else "-"
        )
        rows = trial.filter(pl.col("branch") == "loading").drop_nulls("stiffness")
        right.plot(rows["angle_deg"], rows["stiffness"], linewidth=WIDTHS["loading"], **look)
        band = rows.drop_nulls(["stiffness_low", "stiffness_high"])
        ends = band["stiffness_low"], band["stiffness_high"]
        right.fill_between(band["angle_deg"], *ends, color=look["color"], alpha=0.25, linewidth=0)
    for curve in table.drop_nulls("desired").partition_by("desired", maintain_order=True):
        line = curve.drop_nulls("desired_torque").unique("angle_deg").sort("angle_deg")
        look = {
            "color": colours[curve["trial"][0]],
            "linestyle": style.DASHED,
            "linewidth": WIDTHS["loading"],
        }
        left.plot(line["angle_deg"], line["desired_torque"], **look)
    for ax, label in (
        (left, "Resisting torque (N·m)"),
        (right, "Stiffness while loading (N·m/rad)"),
    ):
        ax.axhline(0, color=style.BLACK, linewidth=0.4)
        ax.axvline(0, color=style.BLACK, linewidth=0.4)
        ax.set_xlabel("Joint angle (deg)")
        ax.set_ylabel(label)
