"""`prediction` and `chain`: what models say of impedance trials. The prediction is from components
that were measured alone; the chain goes from the command to the torque of the joint."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.figures import columns_of, marks, names, style
from osl_analysis.figures.desired_axis import (
    label_desired_axis,
    marker_share,
    panel_inches,
    with_places,
)
from osl_analysis.figures.ticks import label_frequency_axis, label_log_axis

COLUMNS = 2  # panels side by side
PANEL_HEIGHT = 1.85  # [in]
LEGEND_HEIGHT = 0.6  # [in]
MARKER_SHARE = 0.9  # of the usual size
ZERO_LINE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.6, "zorder": 0}


def figure_height(rows: int) -> float:
    """Of a figure of so many rows of panels [in]."""
    return min(LEGEND_HEIGHT + PANEL_HEIGHT * rows, style.TALLEST)


# prediction

COMPARED = {  # quantity: its axis, and the desired value over which it is drawn
    "K": ("Measured − predicted\n" + r"$\hat{K}$ (N·m/rad)", "K"),
    "B": ("Measured − predicted\n" + r"$\hat{B}$ (N·m·s/rad)", "B"),
    "torque": ("Measured − predicted\nSD of torque (N·m)", "K"),
}
PREDICTED_ALPHA = 0.35  # of the bars behind the markers
# names in the legend
PREDICTED = "95 % interval of the prediction"
QUARTILES = "Residual torque: quartiles of trials"
RANGE = "Residual torque: range of trials"
DODGE = 0.012  # of two controllers at one frequency, as a share of the axis


def prediction_points(prediction: pl.DataFrame, frequencies: pl.DataFrame) -> pl.DataFrame:
    """One row per trial with a prediction, then one per trial and frequency."""
    columns = columns_of("prediction")
    trials = names.completed(prediction, columns, only=True).drop_nulls("VAF")
    of_frequencies = names.completed(frequencies, columns, only=True)
    parts = [part for part in (trials, of_frequencies) if len(part)]
    table = pl.concat(parts or [trials, of_frequencies], how="vertical_relaxed")
    return table.with_columns(names.look_numbers(table["controller"]))


def prediction_caption(table: pl.DataFrame) -> str:
    """What the figure `prediction` shows."""
    sentences = [
        "What the components of the leg, each measured alone, predict of every impedance trial,"
        " against what was measured. Nothing is fitted to these trials. Markers: measured less"
        r" predicted (a) stiffness $\hat{K}$, (b) damping $\hat{B}$ and (c) standard deviation of"
        " the torque. Bars around 0: the 95 % interval of what the trial should measure. It counts"
        " the uncertainty of the components and what the equations lack, learnt from the other"
        " trials.",
    ]
    if names.has_values(table, "share"):
        sentences.append(
            "(d) RMS of the residual torque, recorded less predicted, at each frequency, as a share"
            " of the recorded torque: median over the trials, their quartiles (thick) and range"
            " (thin)."
        )
    return " ".join(sentences)


@style.drawing(
    columns_of("prediction"),
    prediction_points,
    needs=("trial", "controller", "VAF"),
    caption=prediction_caption,
    nothing="the components of no impedance trial were all measured",
)
def draw_prediction(table: pl.DataFrame) -> Figure:
    """(a) K, (b) B and (c) SD of the torque, measured less predicted; (d) what is missed over
    frequency; four panels for each joint."""
    parts = names.placed_rows(table)
    titles = names.panel_titles(parts, [""] * (len(COMPARED) + 1))
    figure, axes = style.panels(
        style.DOUBLE_COLUMN, figure_height(2 * len(parts)), 2 * len(parts), COLUMNS, titles=titles
    )
    for number, (_, part) in enumerate(parts):
        *differences, residual = axes[4 * number : 4 * number + 4]
        trials = part.filter(pl.col("share").is_null())
        for ax, quantity in zip(differences, COMPARED, strict=True):
            draw_difference(ax, trials, quantity)
        of_frequencies = part.filter(pl.col("share").is_not_null())
        if of_frequencies.is_empty():
            residual.remove()
        else:
            draw_residual_torque(residual, of_frequencies)

    entries = marks.controller_entries(names.looks_in(table).values())
    entries |= marks.bar_entry(PREDICTED, style.THICK, style.LIGHT_GREY)
    if names.has_values(table, "share"):
        entries |= marks.bar_entry(QUARTILES, style.THICK)
        entries |= marks.bar_entry(RANGE, style.THIN)
    marks.legend_above(figure, entries | marks.open_entry(table), 3)
    figure.align_ylabels()
    return figure


def draw_difference(ax: Axes, trials: pl.DataFrame, quantity: str) -> None:
    """Measured less predicted of one quantity, and the interval of the prediction around 0."""
    label, symbol = COMPARED[quantity]
    rows = with_places(trials, symbol)
    inches = panel_inches(style.DOUBLE_COLUMN, COLUMNS)
    share = MARKER_SHARE * marker_share(rows, inches)
    ax.axhline(0, **ZERO_LINE)
    for controller, look in names.looks_in(rows).items():
        of_controller = names.of_controller(rows, controller)
        x = of_controller["x"]
        predicted = of_controller[quantity]
        below = of_controller[f"{quantity}_low"] - predicted
        above = of_controller[f"{quantity}_high"] - predicted
        ax.vlines(x, below, above, color=look.colour, alpha=PREDICTED_ALPHA, linewidth=style.THICK)
        difference = of_controller[f"{quantity}_measured"] - predicted
        marks.draw_fits(ax, of_controller, x, difference, look.smaller(share))
    label_desired_axis(ax, rows, symbol, inches)
    ax.set_ylabel(label)


def draw_residual_torque(ax: Axes, rows: pl.DataFrame) -> None:
    """Residual torque of the predictions [percent of the recorded] over frequency [Hz]: median,
    quartiles and range of the trials of each controller."""
    looks = names.looks_in(rows)
    frequencies = rows["frequency_hz"].to_numpy()
    span = float(np.ptp(np.log(frequencies))) or 1.0
    share = pl.col("share")
    for number, (controller, look) in enumerate(looks.items()):
        of_trials = names.of_controller(rows, controller).group_by("frequency_hz").agg(
            median=share.median(), least=share.min(), most=share.max(),
            lower=share.quantile(0.25, "linear"), upper=share.quantile(0.75, "linear"),
        )  # fmt: skip
        middle = of_trials.sort("frequency_hz")
        side = number - (len(looks) - 1) / 2
        x = middle["frequency_hz"].to_numpy() * np.exp(2 * DODGE * side * span)
        ax.vlines(x, middle["least"], middle["most"], color=look.colour, linewidth=style.THIN)
        ax.vlines(x, middle["lower"], middle["upper"], color=look.colour, linewidth=style.THICK)
        ax.plot(
            x, middle["median"],
            color=look.colour, marker=look.marker, markersize=look.size,
            linewidth=style.THIN, linestyle=look.dash,
        )  # fmt: skip
    ax.set_yscale("log")
    label_log_axis(ax.yaxis, ax.get_ylim(), most=6)
    label_frequency_axis(ax, rows["frequency_hz"], most=8, tested=frequencies.tolist())
    ax.set_xlabel("Frequency (Hz)")
    ax.set_ylabel("Residual torque\n(% of RMS torque)")


# chain

LINKS = {  # column: its name, and its quantity
    "command": ("Command", "$K_1$"),
    "motor": ("Motor", r"$k_\tau n_m$"),
    "belt": ("Belt", "$K_s$"),
    "rendered": ("Joint", r"$\hat{K}$"),
}
SMALLEST_DEVIATION = 1.0  # an axis shows at least so much on either side of 0 [percent]


def chain_points(
    law: pl.DataFrame, impedance: pl.DataFrame, evidence: pl.DataFrame
) -> pl.DataFrame:
    """By how much [percent] each link of a trial deviates from what is expected of it."""
    table = names.completed(law, (*columns_of("chain"), "K_1", "k_tau_n_m"))
    for link, symbol in (("command", "K_1"), ("motor", "k_tau_n_m")):
        for end in ("", "_low", "_high"):
            deviation = 100 * (pl.col(f"{symbol}{end}") / pl.col(f"{symbol}_programmed") - 1)
            table = table.with_columns(deviation.alias(f"{link}{end}"))

    is_whole = pl.col("amplitude_deg").is_null()
    joint = names.completed(impedance.filter(is_whole), ("K", "K_low", "K_high", "K_predicted"))
    deviations = []
    for end in ("", "_low", "_high"):
        deviation = 100 * (pl.col(f"K{end}") / pl.col("K_predicted") - 1)
        deviations.append(deviation.alias(f"rendered{end}"))
    rendered = joint.select("trial", *deviations)
    whole_evidence = names.completed(evidence.filter(is_whole), ("K_s_ratio",))
    belt = whole_evidence.select("trial", belt=100 * (pl.col("K_s_ratio") - 1))
    for of_link in (belt, rendered):
        without = table.drop(of_link.columns[1:])
        table = without.join(of_link, on="trial", how="left", maintain_order="left")
    return table.with_columns(names.look_numbers(table["controller"])).select(columns_of("chain"))


def chain_caption(table: pl.DataFrame) -> str:
    """What the figure `chain` shows."""
    sentences = [
        "From the command to the torque of the joint, link by link: by how much each deviates from"
        " what is expected of it. Bars: 95 % intervals."
    ]
    against = {
        "command": r"The stiffness gain $K_1$ by the current of the log is compared with the"
        " programmed one.",
        "motor": r"The motor's torque for a current, $k_\tau n_m$, is compared with the parameter"
        " file.",
        "belt": "The belt's stiffness $K_s$ by torque, angle and motor angle is compared with the"
        " parameter file.",
        "rendered": r"The joint's stiffness $\hat{K}$ is compared with what the gains that ran"
        " should give.",
    }
    sentences += [sentence for link, sentence in against.items() if names.has_values(table, link)]
    sentences.append("What one link misses is no fault of the next.")
    return " ".join(sentences)


@style.drawing(
    columns_of("chain"),
    chain_points,
    needs=("trial", "controller", "K_1"),
    caption=chain_caption,
    nothing="no impedance trial logs current and angle of the motor",
)
def draw_chain(table: pl.DataFrame) -> Figure:
    """A panel per link of each joint: percent over K_d, with intervals. A link without a number has
    none."""
    parts = names.placed_rows(table)
    links = []
    titles = []
    for place, (_, part) in zip(names.panel_titles(parts), parts, strict=True):
        for link, (name, _) in LINKS.items():
            if names.has_values(part, link):
                links.append((link, part))
                titles.append(f"{place}: {name}" if place else name)
    rows = -(-len(links) // COLUMNS)
    figure, axes = style.panels(
        style.DOUBLE_COLUMN, figure_height(rows), rows, COLUMNS, titles=titles
    )
    for ax, (link, part) in zip(axes, links, strict=False):
        draw_link(ax, part, link)
    for unused in axes[len(links) :]:
        unused.remove()

    entries = marks.controller_entries(names.looks_in(table).values())
    entries |= marks.bar_entries(table, LINKS)
    marks.legend_above(figure, entries | marks.open_entry(table), 5)
    figure.align_ylabels()
    return figure


def draw_link(ax: Axes, part: pl.DataFrame, link: str) -> None:
    """The deviation of one link [percent], with its interval where it is known."""
    rows = with_places(part, "K")
    inches = panel_inches(style.DOUBLE_COLUMN, COLUMNS)
    share = MARKER_SHARE * marker_share(rows, inches)
    ax.axhline(0, **ZERO_LINE)
    for controller, look in names.looks_in(rows).items():
        of_controller = names.of_controller(rows, controller)
        x = of_controller["x"]
        if f"{link}_low" in rows.columns:
            marks.draw_bars(ax, of_controller, "x", link, look.colour, style.THICK)
        marks.draw_fits(ax, of_controller, x, of_controller[link], look.smaller(share))
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, -SMALLEST_DEVIATION), max(high, SMALLEST_DEVIATION))
    label_desired_axis(ax, rows, "K", inches)
    _, quantity = LINKS[link]
    ax.set_ylabel(f"{quantity}, deviation (%)")
