"""Fig. 5 and `errors`: the stiffness and damping that the joint renders, against those that were
asked for."""

from collections.abc import Mapping
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
MODEL_MARK: dict[str, Any] = {"marker": "_", "mew": 0.7}
VISCOUS_SIZE, MODEL_SIZE = 3.2, 6.0  # of these marks [pt]
PANEL_HEIGHT, LEGEND_HEIGHT = 1.75, 0.75  # [in]
ENDS = ("", "_low", "_high", "_amplitudes_low", "_amplitudes_high")

NO_WHOLE_FIT = (
    "the impedance table has no fit over all amplitudes (a row with empty amplitude_deg), which"
    " Fig. 5 draws; fit the trials again"
)


def fits_of_trials(impedance: pl.DataFrame) -> pl.DataFrame:
    """The fit to all of each trial, with the number of its controller's look. Raises InputError:
    there is none."""
    trials = impedance.filter(pl.col("amplitude_deg").is_null())
    if trials.is_empty():
        raise InputError(NO_WHOLE_FIT)
    return trials.with_columns(names.look_numbers(trials["controller"]))


# Fig. 5


def fig5_points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes, with 95 % intervals and the range over single
    amplitudes where the table has it."""
    return names.completed(fits_of_trials(impedance), columns_of("fig5"), only=True)


def fig5_caption(table: pl.DataFrame) -> str:
    """What Fig. 5 shows."""
    is_desired = names.has_values(table, "K_d") or names.has_values(table, "B_d")
    said = [
        r"Observed (a) stiffness $\hat{K}$ and (b) damping $\hat{B}$ of the joint"
        + (" against the desired values $K_d$ and $B_d$." if is_desired else "."),
        "A marker is the fit of K, B and I to all of one trial's motion.",
    ]
    if is_desired:
        said.append(
            "Black: the desired value. Above one desired value stand all trials that were asked for"
            " it: of each controller from left to right by the other desired value."
        )
    if names.has_values(table, "B_viscous"):
        said.append(
            "Crosses: the viscous damping, without Coulomb friction, where friction is certain."
        )
    said += bars_said(table)
    return " ".join(said)


def bars_said(table: pl.DataFrame) -> list[str]:
    """What thick and thin bars mean, if there are any."""
    said = []
    if names.has_values(table, "K_low"):
        said.append(
            "Thick bars, where they are longer than the markers: 95 % intervals, for another motion"
            " of this kind."
        )
    if names.has_values(table, "K_amplitudes_low"):
        said.append("Thin bars: the range of the fits to single amplitudes.")
    return said


@style.drawing(columns_of("fig5"), fig5_points, needs=(*NEEDED, *ESTIMATES), caption=fig5_caption)
def draw_fig5(table: pl.DataFrame) -> Figure:
    """(a) stiffness over desired stiffness, (b) damping over desired damping, for each joint."""
    figure, axes, placed = panels_of_trials(table, {"K": "K", "B": "B"})
    for ax, (symbol, rows) in zip(axes, placed, strict=True):
        draw_rendered(ax, rows, symbol)

    entries = marks.controller_entries(names.looks_in(table).values())
    if names.has_values(table, "K_d") or names.has_values(table, "B_d"):
        entries["Desired"] = marks.key("Desired", **DESIRED_LINE)
    entries |= viscous_entry(table)
    entries |= marks.bar_entries(table, "KB")
    entries |= marks.open_entry(table)
    marks.legend_above(figure, entries, 4)
    figure.align_ylabels()
    return figure


def draw_rendered(ax: Axes, rows: pl.DataFrame, symbol: str) -> None:
    """One quantity of the trials at their places `x`, and a black line at each desired value."""
    inches = length_of(ax)
    desired = f"{symbol}_d"
    for group in rows.drop_nulls(desired).partition_by(desired, maintain_order=True):
        ax.hlines(group[desired][0], group["x"][0] - 0.8, group["x"][-1] + 0.8, **DESIRED_LINE)
    draw_trials(ax, rows, symbol, inches)
    label_desired_axis(ax, rows, symbol, inches)
    ax.set_ylabel(names.AXIS_LABELS[symbol])


# errors


def error_points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial with a desired value: rendered less desired, K [percent of K_d] and B
    [N*m*s/rad], and what is predicted of them."""
    wanted = [f"{symbol}{end}" for symbol in "KB" for end in (*ENDS, "_predicted")]
    fits = names.completed(fits_of_trials(impedance), [*wanted, "B_viscous"])
    columns = []
    for end in (*ENDS, "_predicted"):
        percent = 100 * (pl.col(f"K{end}") / pl.col("K_d") - 1)
        columns.append(pl.when(pl.col("K_d") > 0).then(percent).alias(f"K_error{end}"))
        columns.append((pl.col(f"B{end}") - pl.col("B_d")).alias(f"B_error{end}"))
    columns.append((pl.col("B_viscous") - pl.col("B_d")).alias("B_viscous_error"))
    errors = names.completed(fits.with_columns(columns), columns_of("errors"), only=True)
    return errors.filter(pl.col("K_error").is_not_null() | pl.col("B_error").is_not_null())


def error_caption(table: pl.DataFrame) -> str:
    """What the figure `errors` shows."""
    said = [
        r"Rendered less desired: (a) stiffness $\hat{K}$ in percent of $K_d$, (b) damping $\hat{B}$"
        " less $B_d$. Trials stand as in Fig. 5."
    ]
    if names.has_values(table, "K_error_predicted") or names.has_values(table, "B_error_predicted"):
        said.append(
            "Short lines: the linear model, which is the drivetrain with the controller's gains and"
            " without friction."
        )
    if names.has_values(table, "B_viscous_error"):
        said.append(
            "Crosses: the viscous damping, without Coulomb friction, where friction is certain."
        )
    said += bars_said(table.rename(lambda name: name.replace("_error", "")))
    return " ".join(said)


@style.drawing(
    columns_of("errors"),
    error_points,
    needs=(*NEEDED, *ESTIMATES),
    caption=error_caption,
    nothing="no trial states what was asked for, K_d or B_d",
)
def draw_errors(table: pl.DataFrame) -> Figure:
    """(a) error of the stiffness over K_d, (b) of the damping over B_d, for each joint."""
    figure, axes, placed = panels_of_trials(table, {"K": "K_error", "B": "B_error"})
    for ax, (symbol, rows) in zip(axes, placed, strict=True):
        draw_error(ax, rows, symbol)

    entries = marks.controller_entries(names.looks_in(table).values())
    if names.has_values(table, "K_error_predicted") or names.has_values(table, "B_error_predicted"):
        label = names.LINEAR_MODEL
        entries[label] = marks.key(label, color=style.GREY, markersize=MODEL_SIZE, **MODEL_MARK)
    entries |= viscous_entry(table, "B_viscous_error")
    entries |= marks.bar_entries(table, ["K_error", "B_error"])
    entries |= marks.open_entry(table)
    marks.legend_above(figure, entries, 4)
    figure.align_ylabels()
    return figure


ERROR_LABELS = {
    "K": "Stiffness error\n" + r"$\hat{K}/K_d - 1$ (%)",
    "B": "Damping error\n" + r"$\hat{B} - B_d$ (N·m·s/rad)",
}


def draw_error(ax: Axes, rows: pl.DataFrame, symbol: str) -> None:
    """The error of one quantity, and what the linear model says of it, at the places `x`."""
    inches = length_of(ax)
    ax.axhline(0, **DESIRED_LINE, zorder=0)
    share = marker_share(rows, inches)
    for controller, look in names.looks_in(rows).items():
        own = names.of_controller(rows, controller)
        ax.plot(
            own["x"], own[f"{symbol}_error_predicted"],
            linestyle="", color=look.colour, markersize=MODEL_SIZE * share, **MODEL_MARK,
        )  # fmt: skip
    draw_trials(ax, rows, f"{symbol}_error", inches)
    label_desired_axis(ax, rows, symbol, inches)
    ax.set_ylabel(ERROR_LABELS[symbol])


# What both figures have


def panels_of_trials(
    table: pl.DataFrame, quantities: Mapping[str, str]
) -> tuple[Figure, list[Axes], list[tuple[str, pl.DataFrame]]]:
    """Make a panel for each joint and quantity: one above the other, and of several joints K and B
    side by side.

    Parameters
    ----------
    table : DataFrame
        A row per trial.
    quantities : mapping of str
        By `K` and `B` the column that is drawn. Nothing is drawn where it has no value.

    Returns
    -------
    Figure
    list of Axes
    list of (str, DataFrame)
        Of each panel `K` or `B`, and the trials with their places along its axis.
    """
    placed, titles = [], []
    parts = names.placed_rows(table)
    for title, (_, part) in zip(names.panel_titles(parts), parts, strict=True):
        for symbol, column in quantities.items():
            if names.has_values(part, column):
                placed.append((symbol, with_places(part, symbol)))
                titles.append(title)
    columns = 1 if len(parts) == 1 else 2
    width = fitting_width([rows for _, rows in placed]) if columns == 1 else style.DOUBLE_COLUMN
    rows = -(-len(placed) // columns)
    height = min(LEGEND_HEIGHT + PANEL_HEIGHT * rows, style.TALLEST)
    figure, axes = style.panels(width, height, rows, columns, titles=titles)
    for unused in axes[len(placed) :]:
        unused.remove()
    return figure, axes[: len(placed)], placed


def length_of(ax: Axes) -> float:
    """Length of the horizontal axis of a panel of these figures [in]."""
    place = ax.get_subplotspec()
    columns = 1 if place is None else place.get_gridspec().ncols
    return panel_inches(ax.figure.figure.get_figwidth(), columns)


def draw_trials(ax: Axes, rows: pl.DataFrame, quantity: str, inches: float) -> None:
    """Estimates with their bars, and the viscous damping beside the damping, at the places `x`."""
    share = marker_share(rows, inches)
    viscous = {"B": "B_viscous", "B_error": "B_viscous_error"}.get(quantity)
    for controller, look in names.looks_in(rows).items():
        own = names.of_controller(rows, controller)
        marks.draw_estimates(ax, own, "x", quantity, look, share)
    if viscous:
        size = VISCOUS_SIZE * share
        ax.plot(rows["x"], rows[viscous], linestyle="", markersize=size, zorder=4, **VISCOUS_MARK)


def viscous_entry(table: pl.DataFrame, column: str = "B_viscous") -> dict[str, Any]:
    """What a cross is, if there is one."""
    if not names.has_values(table, column):
        return {}
    label = names.VISCOUS_DAMPING
    return {label: marks.key(label, markersize=VISCOUS_SIZE, **VISCOUS_MARK)}
