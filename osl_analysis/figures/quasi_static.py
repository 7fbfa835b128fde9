"""Fig. 3 and `torque_angle`: torque against angle of the belt, and of a joint that is moved slowly."""

from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from osl_analysis.figures import names, style
from osl_analysis.judge.doubts import IS_DOUBTFUL

MOST_LOOPS = 12  # trials of a panel of Fig. 3 that have their names at the ends of their loops
MEAN_SLOPE = "mean slope"  # name that takes the place of the trial in the two rows that carry the mean slope
BRANCHES: dict[str, style.Dash] = {"loading": "-", "unloading": (0, (6, 3))}  # with the line styles of sound trials
GREY_TRIAL: dict[str, Any] = {"color": "#B4B4B4", "linewidth": 0.9}
DOUBTFUL_TRIAL: dict[str, Any] = {"color": style.BLACK, "linestyle": style.DOTTED, "linewidth": 0.9}
MEAN_LINE: dict[str, Any] = {"color": style.MAGENTA, "linestyle": style.DASHED, "linewidth": 1.3}


def fig3_caption(table: pl.DataFrame) -> str:
    fits = table.filter(pl.col("trial") != MEAN_SLOPE).unique("trial", maintain_order=True)
    said = [
        "Torque against deflection of the transmission, with the actuator locked. Above, the trials in grey and the "
        "mean slope while loading, dashed. Below, what each trial's torque differs by from the mean slope, solid while "
        "loading and dashed while unloading: the width of a loop is its hysteresis."
    ]
    if max(part["trial"].n_unique() for _, part in names.placed_rows(table)) <= MOST_LOOPS + 1:
        said.append("The names of the trials stand at the ends of their loops.")
    for name, part in names.placed_rows(table):
        for row in part.filter(pl.col("trial") == MEAN_SLOPE).head(1).iter_rows(named=True):
            K_s, loop = (
                names.with_interval(row[name], row[f"{name}_low"], row[f"{name}_high"], unit)
                for name, unit in (("K_s", "N·m/rad"), ("hysteresis_area", "J"))
            )
            number = names.count_of(part["trial"].n_unique() - 1, "trial")
            said.append(
                f"{names.as_text(name)} ({number}): the mean stiffness $K_s$ is {K_s}, and a loop loses {loop}."
            )
    return " ".join([*said, names.doubtful_said(fits, "drawn dotted")])


@style.paper_style()
def draw_fig3(table: pl.DataFrame) -> Figure:
    """Above, torque over deflection, the mean slope dashed; below, torque minus that of the mean slope."""
    parts = names.placed_rows(table)
    across = min(len(parts), 2)
    rows = 2 * -(-len(parts) // across)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, 0.4 + 1.8 * rows, rows=rows, columns=across, names=[""] * (rows * across))
    named = []
    for number, (name, part) in enumerate(parts):
        above = 2 * across * (number // across) + number % across
        belts, loops = axes[above], axes[above + across]
        draw_belts(belts, part)
        named.append((loops, draw_loops(loops, part)))
        belts.set_title(f"{belts.get_title(loc='left')} {name}", loc="left")
        loops.sharex(belts)
    for ax in axes:
        if not ax.has_data():
            ax.remove()
    trials = table.filter(pl.col("trial") != MEAN_SLOPE)
    entries = [style.key(f"Trials ($n$ = {trials['trial'].n_unique()})", color=GREY_TRIAL["color"])]
    if style.has_doubtful(trials):
        doubtful = trials.filter(IS_DOUBTFUL)["trial"].n_unique()
        entries.append(style.key(f"Doubtful fit ($n$ = {doubtful})", **DOUBTFUL_TRIAL))
    entries.append(style.key("Mean slope while loading", **MEAN_LINE))
    for branch, dash in BRANCHES.items():
        entries.append(style.key(branch.capitalize(), color=style.BLACK, linestyle=dash, linewidth=0.5))
    figure.legend(handles=entries, loc="outside upper center", ncols=2 if len(figure.axes) == 2 else len(entries))
    for loops, ends in named:
        if len(ends) <= MOST_LOOPS:
            style.name_ends(loops, [(name, names.drawn_name(name, 12), colour, end) for name, colour, end in ends])
    return figure


def draw_belts(ax: Axes, table: pl.DataFrame) -> None:
    mean = table.filter(pl.col("trial") == MEAN_SLOPE)
    trials = table.filter(pl.col("trial") != MEAN_SLOPE).partition_by("trial", maintain_order=True)
    for drawn, look in (
        (trials, GREY_TRIAL),
        (filter(style.has_doubtful, trials), DOUBTFUL_TRIAL),
        ([mean], MEAN_LINE),
    ):
        for rows in drawn:
            ax.plot(rows["theta_s_deg"], rows["torque"], **look)
    ax.tick_params(labelbottom=False)
    ax.set_ylabel("Joint torque (N·m)")
    for K_s, low, high in mean.select("K_s", "K_s_low", "K_s_high").head(1).iter_rows():
        text = rf"$\hat{{K}}_s = {K_s:.1f}$ N·m/rad"
        text += "" if low is None or high is None else f"\n95 % interval {low:.1f} to {high:.1f} N·m/rad"
        ax.text(0.99, 0.04, text, transform=ax.transAxes, ha="right", va="bottom", linespacing=1.4)


def draw_loops(ax: Axes, table: pl.DataFrame) -> list[tuple[str, str, tuple[float, float]]]:
    """Each trial's name, colour and the far end (deflection [deg], deviation [N*m]) of its loop. Trials with ends
    beside each other differ in colour, whose lightness is 0, 57 and 30 of 100."""
    ax.axhline(0, **MEAN_LINE)
    ends = [
        (trial.select("theta_s_deg", "deviation").row(int(trial["theta_s_deg"].abs().arg_max() or 0)), trial)
        for trial in table.filter(pl.col("trial") != MEAN_SLOPE).partition_by("trial", maintain_order=True)
    ]
    named, colours = [], (style.BLACK, "#3F8FBF", "#6B3A0A")
    for number, (end, trial) in enumerate(sorted(ends, key=lambda one: one[0][1])):
        colour, doubtful = colours[number % len(colours)], style.has_doubtful(trial)
        for branch, dash in BRANCHES.items():
            rows = trial.filter(pl.col("branch") == branch)
            line = style.DOTTED if doubtful else dash
            ax.plot(rows["theta_s_deg"], rows["deviation"], color=colour, linestyle=line, linewidth=0.5)
        named.append((trial["trial"][0], colour, end))
    for area in table["hysteresis_area"].drop_nulls().head(1):
        ax.text(0.02, 0.04, f"Mean loop area {area:.3g} J", transform=ax.transAxes, va="bottom")
    ax.set_xlabel(r"Transmission deflection $\theta_s$ (deg)")
    ax.set_ylabel("Torque minus\nmean slope (N·m)")
    return named


CURVE_COLUMNS = (
    "trial", "branch", "angle_deg", "torque", "stiffness", "stiffness_low", "stiffness_high", "desired_torque",
    "desired",
)  # fmt: skip
"""Columns of `torque_angle_curves.csv` that are drawn."""
LOADING_WIDTH, UNLOADING_WIDTH = 1.1, 0.6
MOST_CURVES = 16  # largest number of trials of a panel that are named


def torque_angle_points(curves: pl.DataFrame, table: pl.DataFrame) -> pl.DataFrame:
    facts = names.completed(table, names.JOINT_SIDE).select("trial", *names.JOINT_SIDE, "doubtful")
    joined = curves.select(CURVE_COLUMNS).join(facts, on="trial", how="left", maintain_order="left")
    return joined.select(*names.JOINT_SIDE, *CURVE_COLUMNS, "doubtful")


def torque_angle_caption(table: pl.DataFrame) -> str:
    said = [
        f"Torque against angle of {names.count_of(table['trial'].n_unique(), 'trial')}, moved slowly. (a) Torque, "
        "thick while loading and thin while unloading. (b) Slope of torque over angle while loading; shaded: its 95 % "
        "interval."
    ]
    if table["desired_torque"].count():
        said.append("Dashed: the curves that the trials of this colour were designed for.")
    for trial in table.partition_by("trial", maintain_order=True)[:MOST_CURVES]:
        loading = trial.filter(pl.col("branch") == "loading")
        torque = loading.drop_nulls("torque").sort("angle_deg")["torque"]
        (low, high), slopes = (torque[0], torque[-1]), loading["stiffness"].drop_nulls().to_numpy()
        steepest = f", steepest {np.max(slopes):.4g} {names.UNIT_SIGN['K']}" if len(slopes) else ""
        said.append(f"{names.as_text(trial['trial'][0])}: {low:.3g} to {high:.3g} N·m{steepest}.".replace("-", "−"))
    fits = table.unique("trial", maintain_order=True)
    return " ".join([*said, names.doubtful_said(fits, "drawn dotted", fit="trial")])


@style.paper_style()
def draw_torque_angle(table: pl.DataFrame) -> Figure:
    """(a) Torque against angle, desired curves dashed; (b) stiffness while loading with its 95 % interval."""
    parts, colours = names.placed_rows(table), curve_colours(table)
    titles = [name for name, _ in parts for _ in range(2)]
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3.0 * len(parts) + 0.3, rows=len(parts), columns=2, names=titles)
    for number, (_, part) in enumerate(parts):
        draw_curves(axes[2 * number], axes[2 * number + 1], part, colours)
    entries: list[tuple[str, float, Any]] = [("Loading", LOADING_WIDTH, "-"), ("Unloading", UNLOADING_WIDTH, "-")]
    entries += [("Desired", LOADING_WIDTH, style.DASHED)] * (table["desired_torque"].count() > 0)
    entries += [("Doubtful trial", LOADING_WIDTH, style.DOTTED)] * style.has_doubtful(table)
    handles = [style.key(label, color=style.BLACK, linewidth=w, linestyle=dash) for label, w, dash in entries]
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    for number, ax in enumerate(axes):
        column = ("torque", "stiffness")[number % 2]
        loading = parts[number // 2][1].filter(pl.col("branch") == "loading").drop_nulls(column).sort("angle_deg")
        last = loading.unique("trial", keep="last", maintain_order=True).select("trial", "angle_deg", column)
        if len(last) <= MOST_CURVES:
            style.name_ends(
                ax,
                [
                    (name, names.drawn_name(name.replace("_", " "), 18), colours[name], (x, y))
                    for name, x, y in last.iter_rows()
                ],
            )
    return figure


def draw_curves(left: Axes, right: Axes, table: pl.DataFrame, colours: dict[str, str]) -> None:
    """Torque of both branches of every trial, and desired torque, on the left; stiffness while loading on the right."""
    for trial in table.partition_by("trial", maintain_order=True):
        look: dict[str, Any] = {
            "color": colours[trial["trial"][0]],
            "linestyle": style.DOTTED if style.has_doubtful(trial) else "-",
        }
        for branch, width in (("loading", LOADING_WIDTH), ("unloading", UNLOADING_WIDTH)):
            rows = trial.filter(pl.col("branch") == branch)
            left.plot(rows["angle_deg"], rows["torque"], linewidth=width, **look)
        rows = trial.filter(pl.col("branch") == "loading").drop_nulls("stiffness")
        right.plot(rows["angle_deg"], rows["stiffness"], linewidth=LOADING_WIDTH, **look)
        band = rows.drop_nulls(["stiffness_low", "stiffness_high"])
        ends = band["stiffness_low"], band["stiffness_high"]
        right.fill_between(band["angle_deg"], *ends, color=look["color"], alpha=0.25, linewidth=0)
    for curve in table.drop_nulls("desired").partition_by("desired", maintain_order=True):
        line = curve.drop_nulls("desired_torque").unique("angle_deg").sort("angle_deg")
        look = {"color": colours[curve["trial"][0]], "linestyle": style.DASHED, "linewidth": LOADING_WIDTH}
        left.plot(line["angle_deg"], line["desired_torque"], **look)
    for ax in (left, right):
        ax.axhline(0, color=style.BLACK, linewidth=0.4)
        ax.axvline(0, color=style.BLACK, linewidth=0.4)
        ax.set_xlabel("Joint angle (deg)")
    left.set_ylabel("Resisting torque (N·m)")
    right.set_ylabel("Stiffness while loading (N·m/rad)")


def curve_colours(table: pl.DataFrame) -> dict[str, str]:
    """A colour per trial: those with a desired curve share its colour, the others go through a colour map in order, but
    for its end that stands out from white by less than three to one."""
    desired_of = dict(table.select("trial", "desired").unique(maintain_order=True).iter_rows())
    others = [trial for trial, desired in desired_of.items() if desired is None]
    shades = mpl.colormaps["viridis"](np.linspace(0, 0.6, max(len(others), 1)))
    found = {trial: to_hex(shade) for trial, shade in zip(others, shades, strict=False)}
    of_desired = (style.MAGENTA, style.ORANGE, style.PURPLE, "#6B3A0A")
    wanted = list(dict.fromkeys(filter(None, desired_of.values())))
    for trial, desired in desired_of.items():
        if desired is not None:
            found[trial] = of_desired[wanted.index(desired) % len(of_desired)]
    return found


FIG3 = style.Drawing(
    (
        *("joint", "side", "trial", "branch", "theta_s_deg", "torque", "deviation", "K_s", "K_s_low", "K_s_high"),
        *("hysteresis_area", "hysteresis_area_low", "hysteresis_area_high", "doubtful"),
    ),
    draw_fig3,
    fig3_caption,
)
TORQUE_ANGLE = style.Drawing(
    (*names.JOINT_SIDE, *CURVE_COLUMNS, "doubtful"),
    draw_torque_angle,
    torque_angle_caption,
    torque_angle_points,
    CURVE_COLUMNS,
)
