"""Fig. 3 and `torque_angle`: torque against angle of the belt, and of a joint that is moved
slowly."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from scipy.stats import median_abs_deviation

from osl_analysis.figures import columns_of, marks, names, style
from osl_analysis.judge.causes import doubts_of_result
from osl_analysis.rounding import written
from osl_analysis.stats.repeats import IS_DOUBTFUL

# Fig. 3

# robust standard deviations (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993)
OUTLYING = 3.5
# name that takes the place of the trial in the two rows that carry the mean slope
MEAN_SLOPE = "mean slope"
IS_MEAN = pl.col("trial") == MEAN_SLOPE
# with the line styles of sound trials
BRANCHES: dict[str, style.Dash] = {"loading": "-", "unloading": (0, (6, 3))}
GREY_TRIAL: dict[str, Any] = {"color": style.LIGHT_GREY, "linewidth": 0.9}
DOUBTFUL_TRIAL: dict[str, Any] = {"color": style.BLACK, "linestyle": style.DOTTED, "linewidth": 0.9}
MEAN_LINE: dict[str, Any] = {"color": style.MAGENTA, "linestyle": style.DASHED, "linewidth": 1.3}
LOOP_WIDTH = 0.5  # of lines [pt]
NO_MEAN_SLOPE = "No mean slope: all trials are doubtful"
TEXT_MARGIN = 0.2  # of the loops' height, below them for the text


def fig3_caption(table: pl.DataFrame) -> str:
    """What Fig. 3 shows."""
    sentences = [
        "Torque against deflection of the belt, with the actuator locked. (a) The trials in"
        " grey and the mean slope while loading, dashed. (b) Torque of each trial minus that of the"
        " mean slope, solid while loading and dashed while unloading: the width of a loop is its"
        " hysteresis. In brackets: 95 % intervals of the means over trials."
    ]
    if not table.filter(~IS_MEAN).is_empty():
        sentences.append(
            f"A loop that ends more than {OUTLYING:g} robust standard deviations from the median of"
            " the loops' ends is named."
        )
    return " ".join(sentences)


@style.drawing(columns_of("fig3"), caption=fig3_caption)
def draw_fig3(table: pl.DataFrame) -> Figure:
    """(a) torque over deflection and the mean slope, (b) torque minus that of the mean slope; two
    panels for each joint."""
    parts = names.placed_rows(table)
    across = min(len(parts), 2)
    rows = 2 * -(-len(parts) // across)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, 0.4 + 1.8 * rows, rows, across)
    titled = zip(names.panel_titles(parts), parts, strict=True)
    for number, (place, (_, part)) in enumerate(titled):
        down, column = divmod(number, across)  # two rows of panels for each row of joints
        belts = axes[2 * down * across + column]
        loops = axes[(2 * down + 1) * across + column]
        draw_belts(belts, part)
        draw_loops(loops, part)
        belts.tick_params(labelbottom=False)
        loops.sharex(belts)
        for ax in (belts, loops):
            ax.set_title(f"{ax.get_title(loc='left')} {place}".strip(), loc="left", y=1)
    for ax in axes:
        if not ax.has_data():
            ax.remove()

    entries = belt_entries(table.filter(~IS_MEAN))
    marks.legend_above(figure, entries, 2 if across == 1 else len(entries))
    figure.align_ylabels()
    return figure


def belt_entries(trials: pl.DataFrame) -> dict[str, Any]:
    """The legend of Fig. 3."""
    labels: list[tuple[str, dict[str, Any]]] = [
        (f"Trials ($n$ = {trials['trial'].n_unique()})", {"color": style.LIGHT_GREY})
    ]
    if marks.has_doubtful(trials):
        n_doubtful = trials.filter(IS_DOUBTFUL)["trial"].n_unique()
        labels.append((f"Doubtful fit ($n$ = {n_doubtful})", DOUBTFUL_TRIAL))
    labels.append(("Mean slope while loading", MEAN_LINE))
    for branch, dash in BRANCHES.items():
        line = {"color": style.BLACK, "linestyle": dash, "linewidth": LOOP_WIDTH}
        labels.append((branch.capitalize(), line))
    return {label: marks.key(label, **look) for label, look in labels}


def trials_of(part: pl.DataFrame) -> list[pl.DataFrame]:
    """The rows of each trial."""
    return part.filter(~IS_MEAN).partition_by("trial", maintain_order=True)


def draw_belts(ax: Axes, part: pl.DataFrame) -> None:
    """Torque over deflection of each trial, doubtful ones dotted; the mean slope, and its
    number."""
    trials = trials_of(part)
    for trial in trials:
        ax.plot(trial["theta_s_deg"], trial["torque"], **GREY_TRIAL)
    for trial in trials:
        if marks.has_doubtful(trial):
            ax.plot(trial["theta_s_deg"], trial["torque"], **DOUBTFUL_TRIAL)
    mean = part.filter(IS_MEAN)
    ax.plot(mean["theta_s_deg"], mean["torque"], **MEAN_LINE)
    ax.set_ylabel("Joint torque (N·m)")

    if not mean.is_empty():
        K_s = written(*mean.select("K_s", "K_s_low", "K_s_high").row(0))
        text = rf"$\hat{{K}}_s$ = {K_s} N·m/rad"
        corner: dict[str, Any] = {"ha": "right", "va": "bottom"}
        ax.text(0.99, 0.04, text, transform=ax.transAxes, **corner)


def draw_loops(ax: Axes, part: pl.DataFrame) -> None:
    """Every loop in grey, doubtful ones dotted; those in a colour, with their names, that end more
    than `OUTLYING` standard deviations from the median. Each leads to its trial."""
    ax.axhline(0, **MEAN_LINE)
    ax.margins(y=TEXT_MARGIN)
    trials = [trial for trial in trials_of(part) if trial["deviation"].count()]
    if not trials:
        ax.text(0.02, 0.04, NO_MEAN_SLOPE, transform=ax.transAxes, va="bottom")
    ends = []
    for trial in trials:
        largest = trial["theta_s_deg"].abs().arg_max() or 0
        ends.append(trial.row(int(largest), named=True))
    for trial, end, is_outlying in zip(trials, ends, outlying(ends), strict=True):
        colour = style.ORANGE if is_outlying else style.GREY
        if is_outlying:
            ax.annotate(
                names.drawn_name(end["trial"], 12), (end["theta_s_deg"], end["deviation"]), (3, 0),
                textcoords="offset points", color=colour, va="center",
            )  # fmt: skip
        is_doubtful = marks.has_doubtful(trial)
        for branch, dash in BRANCHES.items():
            # without a line from the end of one cycle to the next
            of_branch = trial.select(pl.when(branch=branch).then("deviation"))
            (line,) = ax.plot(
                trial["theta_s_deg"], of_branch,
                color=colour, linewidth=LOOP_WIDTH,
                linestyle=style.DOTTED if is_doubtful else dash,
            )  # fmt: skip
            line.set_url(marks.place_in_report(trial["trial"][0]))
    mean = part.drop_nulls("hysteresis_area")
    if not mean.is_empty():
        area = written(*mean.select(r"^hysteresis_area(_low|_high)?$").row(0))
        ax.text(0.02, 0.04, f"Mean loop area {area} J", transform=ax.transAxes, va="bottom")
    ax.set_xlabel(r"Belt deflection $\theta_s$ (deg)")
    ax.set_ylabel("Torque minus\nmean slope (N·m)")


def outlying(ends: Sequence[Mapping[str, Any]]) -> list[bool]:
    """Whether each loop ends more than `OUTLYING` robust standard deviations from the median."""
    if not ends:
        return []
    deviations = np.array([end["deviation"] for end in ends])
    limit = OUTLYING * median_abs_deviation(deviations, scale="normal")
    distances = np.abs(deviations - np.median(deviations))
    return [bool(distance > limit > 0) for distance in distances]


# torque_angle

CURVE_COLUMNS = [
    name for name in columns_of("torque_angle") if name not in (*names.JOINT_SIDE, "doubtful")
]
WIDTHS = {"loading": 1.1, "unloading": 0.6}  # of curves [pt]
OF_DESIRED = (style.MAGENTA, style.ORANGE, style.PURPLE, style.BROWN)
# share of a colour map from its dark end on: beyond, it stands out from white by less than 3 to 1
DARK_ENOUGH = 0.6
MOST_NAMED = 16  # trials in the legend; of more, none is named


def torque_angle_points(curves: pl.DataFrame, table: pl.DataFrame) -> pl.DataFrame:
    """The curves, with joint, side and doubts of their trials."""
    facts = names.completed(table, ("trial", *names.JOINT_SIDE, "doubtful"), only=True)
    joined = curves.select(CURVE_COLUMNS).join(facts, on="trial", how="left", maintain_order="left")
    return joined.select(columns_of("torque_angle"))


def torque_angle_caption(table: pl.DataFrame) -> str:
    """What the figure `torque_angle` shows."""
    sentences = [
        "Torque against angle of trials that are moved slowly. (a) Torque, thick while loading and"
        " thin while unloading. (b) Slope of torque over angle while loading."
    ]
    if names.has_values(table, "desired"):
        sentences.append("Dashed: the curves that the trials of this colour were designed for.")
    return " ".join(sentences)


@style.drawing(
    columns_of("torque_angle"),
    torque_angle_points,
    needs=CURVE_COLUMNS,
    caption=torque_angle_caption,
)
def draw_torque_angle(table: pl.DataFrame) -> Figure:
    """(a) torque over angle, (b) stiffness while loading; two panels for each joint."""
    parts = names.placed_rows(table)
    colours = colours_of_trials(table)
    figure, axes = style.panels(
        style.DOUBLE_COLUMN, 3.0 * len(parts) + 0.3, len(parts), 2,
        titles=[title for title in names.panel_titles(parts) for _ in range(2)],
    )  # fmt: skip
    for number, (_, part) in enumerate(parts):
        draw_torque_curves(axes[2 * number], part, colours)
        draw_stiffness_curves(axes[2 * number + 1], part, colours)
    marks.legend_above(figure, torque_angle_entries(table, colours), 4)
    figure.align_ylabels()
    return figure


def colours_of_trials(table: pl.DataFrame) -> dict[str, str]:
    """Colours by trial: those with a desired curve share its colour, the others go through a colour
    map in order."""
    desired_of = dict(table.select("trial", "desired").unique(maintain_order=True).iter_rows())
    wanted = list(dict.fromkeys(desired_of.values()))
    others = [trial for trial, desired in desired_of.items() if desired is None]
    shades = mpl.colormaps["viridis"](np.linspace(0, DARK_ENOUGH, max(len(others), 1)))
    colours = {}
    for trial, desired in desired_of.items():
        if desired is None:
            colours[trial] = to_hex(shades[others.index(trial)])
        else:
            colours[trial] = OF_DESIRED[wanted.index(desired) % len(OF_DESIRED)]
    return colours


def torque_angle_entries(table: pl.DataFrame, colours: dict[str, str]) -> dict[str, Any]:
    """The legend: what widths and dashes say, and the trials if they are few."""
    thick = WIDTHS["loading"]
    looks: dict[str, dict[str, Any]] = {}
    for branch, width in WIDTHS.items():
        looks[branch.capitalize()] = {"color": style.BLACK, "linewidth": width}
    black = {"color": style.BLACK, "linewidth": thick}
    if names.has_values(table, "desired_torque"):
        looks["Desired"] = {**black, "linestyle": style.DASHED}
    if marks.has_doubtful(table):
        looks["Doubtful trial"] = {**black, "linestyle": style.DOTTED}
    if len(colours) <= MOST_NAMED:
        for number, (trial, colour) in enumerate(colours.items(), start=1):
            name = names.drawn_name(trial.replace("_", " "), 18)
            label = f"{name} ({number})" if name in looks else name  # two are shortened alike
            looks[label] = {"color": colour, "linewidth": thick}
    return {label: marks.key(label, **look) for label, look in looks.items()}


def draw_torque_curves(ax: Axes, part: pl.DataFrame, colours: dict[str, str]) -> None:
    """Torque of both branches of every trial, and desired torque, over angle."""
    for trial in part.partition_by("trial", maintain_order=True):
        name = trial["trial"][0]
        dash: style.Dash = style.DOTTED if marks.has_doubtful(trial) else "-"
        for branch, width in WIDTHS.items():
            rows = trial.filter(pl.col("branch") == branch)
            (line,) = ax.plot(
                rows["angle_deg"], rows["torque"],
                color=colours[name], linewidth=width, linestyle=dash,
            )  # fmt: skip
            line.set_url(marks.place_in_report(name))
    for curve in part.drop_nulls("desired").partition_by("desired", maintain_order=True):
        desired = curve.drop_nulls("desired_torque").unique("angle_deg").sort("angle_deg")
        ax.plot(
            desired["angle_deg"], desired["desired_torque"],
            color=colours[curve["trial"][0]], linewidth=WIDTHS["loading"], linestyle=style.DASHED,
        )  # fmt: skip
    label_angle_axes(ax, "Resisting torque (N·m)")


def draw_stiffness_curves(ax: Axes, part: pl.DataFrame, colours: dict[str, str]) -> None:
    """Slope of torque over angle while loading."""
    for trial in part.partition_by("trial", maintain_order=True):
        colour = colours[trial["trial"][0]]
        is_doubtful = bool(doubts_of_result(trial["doubtful"][0] or "", "K"))
        rows = trial.filter(pl.col("branch") == "loading").drop_nulls("stiffness")
        ax.plot(
            rows["angle_deg"], rows["stiffness"],
            color=colour, linewidth=WIDTHS["loading"],
            linestyle=style.DOTTED if is_doubtful else "-",
        )  # fmt: skip
    label_angle_axes(ax, "Stiffness while loading (N·m/rad)")


def label_angle_axes(ax: Axes, label: str) -> None:
    """Lines at 0, and the names of the axes."""
    ax.axhline(0, color=style.BLACK, linewidth=style.HAIRLINE)
    ax.axvline(0, color=style.BLACK, linewidth=style.HAIRLINE)
    ax.set_xlabel("Joint angle (deg)")
    ax.set_ylabel(label)
