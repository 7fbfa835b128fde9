"""Fig. 5: the stiffness and damping that the joint renders, against those that were asked for."""

from dataclasses import dataclass
from typing import Any

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import columns_of, marks, names, style
from osl_analysis.figures.desired_axis import (
    fitting_width,
    label_desired_axis,
    marker_share,
    panel_inches,
    with_places,
)

NEEDED = ("trial", "controller", "K_d", "B_d", "amplitude_deg")  # beside estimates
ESTIMATES = ("K", "K_low", "K_high", "B", "B_low", "B_high")
DESIRED_LINE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8}
# black, because it may stand on a marker
VISCOUS_MARK: dict[str, Any] = {"marker": "x", "mew": 0.8, "color": style.BLACK}
VISCOUS_SIZE = 3.2  # of this mark [pt]
PANEL_HEIGHT = 1.75  # [in]
LEGEND_HEIGHT = 0.75  # [in]
BESIDE_TRIALS = 0.8  # by which a desired value's line is longer than its trials on either side

NO_WHOLE_FIT = (
    "the impedance table has no fit over all amplitudes (a row with empty amplitude_deg), which"
    " Fig. 5 draws; fit the trials again"
)


@dataclass(frozen=True)
class TrialPanel:
    """A panel over the desired K or B, and the trials that it shows."""

    ax: Axes
    symbol: str  # K or B
    rows: pl.DataFrame  # the trials, with their places `x`
    inches: float  # length of the horizontal axis [in]


def fig5_points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes, with 95 % intervals and the range over single
    amplitudes where the table has it. Raises InputError: no trial has a fit."""
    trials = impedance.filter(pl.col("amplitude_deg").is_null())
    if trials.is_empty():
        raise InputError(NO_WHOLE_FIT)
    trials = trials.with_columns(names.look_numbers(trials["controller"]))
    return names.completed(trials, columns_of("fig5"), only=True)


def fig5_caption(table: pl.DataFrame) -> str:
    """What Fig. 5 shows."""
    is_desired = names.has_desired(table)
    against = " against the desired values $K_d$ and $B_d$" if is_desired else ""
    sentences = [
        rf"Observed (a) stiffness $\hat{{K}}$ and (b) damping $\hat{{B}}$ of the joint{against}.",
        "A marker is the fit of K, B and I to all of one trial's motion.",
    ]
    if is_desired:
        sentences.append(
            "Black: the desired value. Above one desired value stand all trials that were asked for"
            " it: of each controller from left to right by the other desired value."
        )
    if names.has_values(table, "B_viscous"):
        sentences.append(
            "Crosses: the viscous part of the damping, without Coulomb friction, where friction is"
            " certain."
        )
    if names.has_values(table, "K_low"):
        sentences.append(
            "Thick bars, where they are longer than the markers: 95 % intervals, for this motion."
        )
    if names.has_values(table, "K_amplitudes_low"):
        sentences.append(
            "Thin bars: the range of the fits to single amplitudes; thick ones need not hold it."
        )
    return " ".join(sentences)


@style.drawing(columns_of("fig5"), fig5_points, needs=(*NEEDED, *ESTIMATES), caption=fig5_caption)
def draw_fig5(table: pl.DataFrame) -> Figure:
    """(a) stiffness over desired stiffness, (b) damping over desired damping, for each joint."""
    figure, panels = panels_of_trials(table)
    for panel in panels:
        draw_rendered(panel)

    entries = marks.controller_entries(names.looks_in(table).values())
    if names.has_desired(table):
        entries["Desired"] = marks.key("Desired", **DESIRED_LINE)
    if names.has_values(table, "B_viscous"):
        label = names.VISCOUS_DAMPING
        entries[label] = marks.key(label, markersize=VISCOUS_SIZE, **VISCOUS_MARK)
    entries |= marks.bar_entries(table, "KB")
    entries |= marks.open_entry(table)
    marks.legend_above(figure, entries, 4)
    figure.align_ylabels()
    return figure


def draw_rendered(panel: TrialPanel) -> None:
    """One quantity of the trials at their places `x`, and a black line at each desired value."""
    desired = f"{panel.symbol}_d"
    for group in panel.rows.drop_nulls(desired).partition_by(desired, maintain_order=True):
        ends = (group["x"][0] - BESIDE_TRIALS, group["x"][-1] + BESIDE_TRIALS)
        panel.ax.hlines(group[desired][0], *ends, **DESIRED_LINE)
    draw_trials(panel)
    label_desired_axis(panel.ax, panel.rows, panel.symbol, panel.inches)
    panel.ax.set_ylabel(names.AXIS_LABELS[panel.symbol])


def panels_of_trials(table: pl.DataFrame) -> tuple[Figure, list[TrialPanel]]:
    """Make a panel for each joint and quantity that it has: one above the other, and of several
    joints K and B side by side. The table has a row per trial."""
    symbols = []
    placed = []
    titles = []
    parts = names.placed_rows(table)
    for title, (_, part) in zip(names.panel_titles(parts), parts, strict=True):
        for symbol in "KB":
            if names.has_values(part, symbol):
                symbols.append(symbol)
                placed.append(with_places(part, symbol))
                titles.append(title)
    columns = 1 if len(parts) == 1 else 2
    width = fitting_width(placed) if columns == 1 else style.DOUBLE_COLUMN
    rows = -(-len(placed) // columns)
    height = min(LEGEND_HEIGHT + PANEL_HEIGHT * rows, style.TALLEST)
    figure, axes = style.panels(width, height, rows, columns, titles=titles)
    for unused in axes[len(placed) :]:
        unused.remove()
    inches = panel_inches(width, columns)
    used = zip(axes, symbols, placed, strict=False)
    return figure, [TrialPanel(ax, symbol, trials, inches) for ax, symbol, trials in used]


def draw_trials(panel: TrialPanel) -> None:
    """Estimates with their bars, and the viscous damping beside the damping, at the places `x`."""
    share = marker_share(panel.rows, panel.inches)
    for controller, look in names.looks_in(panel.rows).items():
        trials = names.of_controller(panel.rows, controller)
        marks.draw_estimates(panel.ax, trials, "x", panel.symbol, look.smaller(share))
    if panel.symbol == "B":
        panel.ax.plot(
            panel.rows["x"], panel.rows["B_viscous"],
            linestyle="", markersize=VISCOUS_SIZE * share, zorder=4, **VISCOUS_MARK,
        )  # fmt: skip
