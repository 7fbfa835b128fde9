"""Fig. 3 and `torque_angle`: torque against angle of the belt, and of a joint that is moved slowly."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from osl_analysis.figures import style
from osl_analysis.figures.names import (
    JOINT_SIDE,
    UNIT_SIGN,
    as_text,
    count_of,
    doubtful_said,
    drawn_name,
    of_place,
    placed_rows,
    with_interval,
)

MOST_LOOPS = 12  # trials of a panel that have their names at the ends of their loops
MEAN_SLOPE = "mean slope"  # name that takes the place of the trial in the two rows that carry the mean slope
BRANCH_DASHES: dict[str, style.Dash] = {"loading": "-", "unloading": (0, (6, 3))}
"""Line styles of the branches of sound trials."""
PALE = "#B4B4B4"
"""Grey of the trials behind the mean slope."""


def fig3_caption(table: pl.DataFrame) -> str:
    fits = table.filter(pl.col("trial") != MEAN_SLOPE).unique("trial", maintain_order=True)
    said = [
        "Torque against deflection of the transmission, with the actuator locked. Above, the trials in grey and the "
        "mean slope while loading, dashed. Below, what each trial's torque differs by from the mean slope, solid while "
        "loading and dashed while unloading: the width of a loop is its hysteresis."
    ]
    if max(part["trial"].n_unique() for _, part in placed_rows(table)) <= MOST_LOOPS + 1:
        said.append("The names of the trials stand at the ends of their loops.")
    for name, part in placed_rows(table):
        mean = part.filter(pl.col("trial") == MEAN_SLOPE)
        if len(mean):
            row = mean.row(0, named=True)
            K_s, loop = (
                with_interval(row[name], row[f"{name}_low"], row[f"{name}_high"], unit)
                for name, unit in (("K_s", "N·m/rad"), ("hysteresis_area", "J"))
            )
            number = count_of(part["trial"].n_unique() - 1, "trial")
            said.append(f"{as_text(name)} ({number}): the mean stiffness $K_s$ is {K_s}, and a loop loses {loop}.")
    return " ".join([*said, doubtful_said(fits, "drawn dotted")])


@style.paper_style()
def draw_fig3(table: pl.DataFrame) -> Figure:
    """Above, torque over deflection, the mean slope dashed; below, torque minus that of the mean slope."""
    parts = placed_rows(table)
    across = min(len(parts), 2)
    rows = -(-len(parts) // across)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    above = [2 * across * (number // across) + number % across for number in range(len(parts))]
    figure, axes = style.panels(
        width, 0.4 + 3.6 * rows, rows=2 * rows, columns=across, names=[""] * (2 * rows * across)
    )
    for number, (name, part) in zip(above, parts, strict=True):
        belts, loops = axes[number], axes[number + across]
        draw_belts(belts, part)
        draw_loops(loops, part)
        belts.set_title(f"{belts.get_title(loc='left')} {name}", loc="left")
        loops.sharex(belts)
    for ax in axes:
        if not ax.has_data():
            ax.remove()
    entries = line_labels(table)
    figure.legend(handles=entries, loc="outside upper center", ncols=2 if len(figure.axes) == 2 else len(entries))
    for number, (_, part) in zip(above, parts, strict=True):
        trials = coloured(part)
        if len(trials) <= MOST_LOOPS:
            names, ends = [trial["trial"][0] for trial, _ in trials], [end_of(trial) for trial, _ in trials]
            drawn = [drawn_name(name, 12) for name in names]
            texts = style.name_ends(axes[number + across], ends, drawn, [colour for _, colour in trials])
            style.link_to_trials(texts, names)
    return figure


def line_labels(table: pl.DataFrame) -> list[Line2D]:
    trials = trials_of(table)
    doubtful = [trial for trial in trials if len(trial.filter(style.DRAWN_OPEN))]
    entries = [Line2D([], [], color=PALE, label=f"Trials ($n$ = {len(trials)})")]
    if doubtful:
        label = f"Doubtful fit ($n$ = {len(doubtful)})"
        entries.append(Line2D([], [], color=style.BLACK, linestyle=style.DOTTED, linewidth=0.9, label=label))
    mean = {"color": style.MAGENTA, "linestyle": style.DASHED, "linewidth": 1.3}
    entries.append(Line2D([], [], **mean, label="Mean slope while loading"))  # type: ignore[arg-type]
    for branch, dash in BRANCH_DASHES.items():
        entries.append(Line2D([], [], color=style.BLACK, linestyle=dash, linewidth=0.5, label=branch.capitalize()))
    return entries


def trials_of(table: pl.DataFrame) -> list[pl.DataFrame]:
    return table.filter(pl.col("trial") != MEAN_SLOPE).partition_by("trial", maintain_order=True)


def draw_belts(ax: Axes, table: pl.DataFrame) -> None:
    mean, trials = table.filter(pl.col("trial") == MEAN_SLOPE), trials_of(table)
    for trial in trials:
        ax.plot(trial["theta_s_deg"], trial["torque"], color=PALE, linewidth=0.9)
    for trial in (trial for trial in trials if len(trial.filter(style.DRAWN_OPEN))):
        ax.plot(trial["theta_s_deg"], trial["torque"], color=style.BLACK, linestyle=style.DOTTED, linewidth=0.9)
    ax.plot(mean["theta_s_deg"], mean["torque"], color=style.MAGENTA, linestyle=style.DASHED, linewidth=1.3)
    ax.tick_params(labelbottom=False)
    ax.set_ylabel("Joint torque (N·m)")
    if len(mean):
        K_s, low, high = (mean[column][0] for column in ("K_s", "K_s_low", "K_s_high"))
        text = rf"$\hat{{K}}_s = {K_s:.1f}$ N·m/rad"
        text += "" if low is None or high is None else f"\n95 % interval {low:.1f} to {high:.1f} N·m/rad"
        ax.text(0.99, 0.04, text, transform=ax.transAxes, ha="right", va="bottom", linespacing=1.4)


def draw_loops(ax: Axes, table: pl.DataFrame) -> None:
    ax.axhline(0, color=style.MAGENTA, linestyle=style.DASHED, linewidth=1.3)
    for trial, colour in coloured(table):
        doubtful = len(trial.filter(style.DRAWN_OPEN)) > 0
        for branch, dash in BRANCH_DASHES.items():
            rows = trial.filter(pl.col("branch") == branch)
            line = style.DOTTED if doubtful else dash
            ax.plot(rows["theta_s_deg"], rows["deviation"], color=colour, linestyle=line, linewidth=0.5)
    area = table["hysteresis_area"].drop_nulls()
    if len(area):
        ax.text(0.02, 0.04, f"Mean loop area {area[0]:.3g} J", transform=ax.transAxes, va="bottom")
    ax.set_xlabel(r"Transmission deflection $\theta_s$ (deg)")
    ax.set_ylabel("Torque minus\nmean slope (N·m)")


def coloured(table: pl.DataFrame) -> list[tuple[pl.DataFrame, str]]:
    """The rows of each trial with a colour that trials with ends beside its own do not have. The colours differ in
    lightness: 0, 57 and 30 of 100."""
    ordered, colours = sorted(trials_of(table), key=lambda trial: end_of(trial)[1]), (style.BLACK, "#3F8FBF", "#6B3A0A")
    return [(trial, colours[number % len(colours)]) for number, trial in enumerate(ordered)]


def end_of(trial: pl.DataFrame) -> tuple[float, float]:
    """Deflection [deg] and deviation [N*m] at the far end of a loop."""
    return trial.select("theta_s_deg", "deviation").row(int(trial["theta_s_deg"].abs().arg_max() or 0))


CURVE_COLUMNS = (
    "trial", "branch", "angle_deg", "torque", "stiffness", "stiffness_low", "stiffness_high", "desired_torque",
    "desired",
)  # fmt: skip
"""Columns of `torque_angle_curves.csv` that are drawn."""
WITH_DESIRED = (style.MAGENTA, style.ORANGE, style.PURPLE, "#6B3A0A")
"""Colours of the desired curves and of the trials that should follow them."""
LIGHTEST = 0.6  # part of the colour map that is used: what is lighter stands out from white by less than three to one
LOADING_WIDTH, UNLOADING_WIDTH = 1.1, 0.6
MOST_CURVES = 16  # largest number of trials of a panel that are named
LONGEST_CURVE_NAME = 18  # letters of such a name


def torque_angle_points(curves: pl.DataFrame, table: pl.DataFrame) -> pl.DataFrame:
    facts = of_place(table).select("trial", *JOINT_SIDE, "doubtful")
    joined = curves.select(CURVE_COLUMNS).join(facts, on="trial", how="left", maintain_order="left")
    return joined.select(*JOINT_SIDE, *CURVE_COLUMNS, "doubtful")


def torque_angle_caption(table: pl.DataFrame) -> str:
    said = [
        f"Torque against angle of {count_of(table['trial'].n_unique(), 'trial')}, moved slowly. (a) Torque, thick "
        "while loading and thin while unloading. (b) Slope of torque over angle while loading; shaded: its 95 % "
        "interval."
    ]
    if table["desired_torque"].count():
        said.append("Dashed: the curves that the trials of this colour were designed for.")
    for trial in table.partition_by("trial", maintain_order=True)[:MOST_CURVES]:
        loading = trial.filter(pl.col("branch") == "loading")
        torque = loading.drop_nulls("torque").sort("angle_deg")["torque"]
        (low, high), slopes = (torque[0], torque[-1]), loading["stiffness"].drop_nulls().to_numpy()
        steepest = f", steepest {np.max(slopes):.4g} {UNIT_SIGN['K']}" if len(slopes) else ""
        said.append(f"{as_text(trial['trial'][0])}: {low:.3g} to {high:.3g} N·m{steepest}.".replace("-", "−"))
    fits = table.unique("trial", maintain_order=True)
    return " ".join([*said, doubtful_said(fits, "drawn dotted", fit="trial")])


@style.paper_style()
def draw_torque_angle(table: pl.DataFrame) -> Figure:
    """(a) Torque against angle, desired curves dashed; (b) stiffness while loading with its 95 % interval."""
    parts, colours = placed_rows(table), colours_of(table)
    names = [name for name, _ in parts for _ in range(2)]
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3.0 * len(parts) + 0.3, rows=len(parts), columns=2, names=names)
    for number, (_, part) in enumerate(parts):
        draw_place(axes[2 * number], axes[2 * number + 1], part, colours)
    figure.legend(handles=line_entries(table), loc="outside upper center", ncols=4)
    for number, (_, part) in enumerate(parts):
        for ax, column in zip(axes[2 * number : 2 * number + 2], ("torque", "stiffness"), strict=True):
            name_curves(ax, part, column, colours)
    return figure


def name_curves(ax: Axes, table: pl.DataFrame, column: str, colours: Mapping[str, str]) -> None:
    loading = table.filter(pl.col("branch") == "loading").drop_nulls(column).sort("angle_deg")
    last = loading.unique("trial", keep="last", maintain_order=True)
    if len(last) <= MOST_CURVES:
        names = [drawn_name(name.replace("_", " "), LONGEST_CURVE_NAME) for name in last["trial"]]
        ends = last.select("angle_deg", column).rows()
        style.link_to_trials(style.name_ends(ax, ends, names, [colours[name] for name in last["trial"]]), last["trial"])


def draw_place(left: Axes, right: Axes, table: pl.DataFrame, colours: Mapping[str, str]) -> None:
    for trial in table.partition_by("trial", maintain_order=True):
        draw_trial(left, right, trial, colours[trial["trial"][0]])
    wanted = table.filter(pl.col("desired").is_not_null())
    for curve in wanted.partition_by("desired", maintain_order=True):
        line = curve.drop_nulls("desired_torque").unique("angle_deg").sort("angle_deg")
        colour = colours[curve["trial"][0]]
        left.plot(
            line["angle_deg"], line["desired_torque"], color=colour, linestyle=style.DASHED, linewidth=LOADING_WIDTH
        )
    for ax in (left, right):
        ax.axhline(0, color=style.BLACK, linewidth=0.4)
        ax.axvline(0, color=style.BLACK, linewidth=0.4)
        ax.set_xlabel("Joint angle (deg)")
    left.set_ylabel("Resisting torque (N·m)")
    right.set_ylabel("Stiffness while loading (N·m/rad)")


def colours_of(table: pl.DataFrame) -> Mapping[str, str]:
    """A colour per trial: those with a desired curve share its colour, the others go through a colour map in order."""
    trials = table.select("trial", "desired").unique(maintain_order=True).rows()
    wanted = list(dict.fromkeys(desired for _, desired in trials if desired is not None))
    others = [trial for trial, desired in trials if desired is None]
    shades = mpl.colormaps["viridis"](np.linspace(0, LIGHTEST, max(len(others), 1)))
    plain = {trial: to_hex(shade) for trial, shade in zip(others, shades, strict=False)}
    return {
        trial: plain[trial] if desired is None else WITH_DESIRED[wanted.index(desired) % len(WITH_DESIRED)]
        for trial, desired in trials
    }


def draw_trial(left: Axes, right: Axes, trial: pl.DataFrame, colour: str) -> None:
    dash = style.DOTTED if len(trial.filter(style.DRAWN_OPEN)) else "-"
    for branch, width in (("loading", LOADING_WIDTH), ("unloading", UNLOADING_WIDTH)):
        rows = trial.filter(pl.col("branch") == branch)
        left.plot(rows["angle_deg"], rows["torque"], color=colour, linewidth=width, linestyle=dash)
    rows = trial.filter(pl.col("branch") == "loading").drop_nulls("stiffness")
    right.plot(rows["angle_deg"], rows["stiffness"], color=colour, linewidth=LOADING_WIDTH, linestyle=dash)
    band = rows.drop_nulls(["stiffness_low", "stiffness_high"])
    right.fill_between(
        band["angle_deg"], band["stiffness_low"], band["stiffness_high"], color=colour, alpha=0.25, linewidth=0
    )


def line_entries(table: pl.DataFrame) -> list[Line2D]:
    entries = [
        Line2D([], [], color=style.BLACK, linewidth=LOADING_WIDTH, label="Loading"),
        Line2D([], [], color=style.BLACK, linewidth=UNLOADING_WIDTH, label="Unloading"),
    ]
    if table["desired_torque"].count():
        entries.append(
            Line2D([], [], color=style.BLACK, linewidth=LOADING_WIDTH, linestyle=style.DASHED, label="Desired")
        )
    if len(table.filter(style.DRAWN_OPEN)):
        entries.append(
            Line2D([], [], color=style.BLACK, linewidth=LOADING_WIDTH, linestyle=style.DOTTED, label="Doubtful trial")
        )
    return entries


FIG3 = style.Drawing(
    (
        *("joint", "side", "trial", "branch", "theta_s_deg", "torque", "deviation", "K_s", "K_s_low", "K_s_high"),
        *("hysteresis_area", "hysteresis_area_low", "hysteresis_area_high", "doubtful"),
    ),
    draw_fig3,
    fig3_caption,
)
TORQUE_ANGLE = style.Drawing(
    (*JOINT_SIDE, *CURVE_COLUMNS, "doubtful"),
    draw_torque_angle,
    torque_angle_caption,
    torque_angle_points,
    CURVE_COLUMNS,
)
