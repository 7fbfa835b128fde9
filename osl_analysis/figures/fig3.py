"""Fig. 3: torque against deflection of the transmission, every trial, the mean stiffness, and the hysteresis."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from osl_analysis.figures import style
from osl_analysis.figures.names import as_text, count_of, doubtful_said, drawn_name, placed_rows, with_interval

COLUMNS = (
    "joint", "side", "trial", "branch", "theta_s_deg", "torque", "deviation", "K_s", "K_s_low", "K_s_high",
    "hysteresis_area", "hysteresis_area_low", "hysteresis_area_high", "doubtful",
)  # fmt: skip
MOST_LOOPS = 12  # trials of a panel that have their names at the ends of their loops
MEAN_SLOPE = "mean slope"  # name that takes the place of the trial in the two rows that carry the mean slope
BRANCH_DASHES: dict[str, style.Dash] = {"loading": "-", "unloading": (0, (6, 3))}
"""Line styles of the branches of sound trials."""
PALE = "#B4B4B4"
"""Grey of the trials behind the mean slope."""


def caption(table: pl.DataFrame) -> str:
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
def draw(table: pl.DataFrame) -> Figure:
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
