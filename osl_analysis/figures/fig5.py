"""Fig. 5: estimated stiffness and damping against the desired ones."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from osl_analysis.errors import InputError
from osl_analysis.figures.names import look_numbers, looks_in, of_place, placed_rows
from osl_analysis.figures.style import (
    BLACK,
    DOUBLE_COLUMN,
    GREY,
    IS_DOUBTFUL,
    WHITE,
    Look,
    draw_spread,
    legend_columns,
    panels,
    paper_style,
    spread_entries,
)

TABLE_COLUMNS = ("trial", "controller", "K_d", "B_d", "amplitude_deg", "K", "K_low", "K_high", "B", "B_low", "B_high")
"""Columns that `points` needs of the impedance table."""
WHERE_THEY_ARE = (
    "K_amplitudes_low", "K_amplitudes_high", "B_amplitudes_low", "B_amplitudes_high", "K_predicted", "B_predicted",
)  # fmt: skip
"""Columns that `points` takes if the table has them; they are null if not."""
COLUMNS = (
    "trial", "joint", "side", "controller", "look", "K_d", "B_d", "K", "K_low", "K_high", "B", "B_low", "B_high",
    *WHERE_THEY_ARE, "doubtful",
)  # fmt: skip

CLUSTER = 0.72
"""Width that the trials of one desired value take, as a share of the distance to the next desired value."""
DASHES = (0, (4, 2))
"""Line style of desired values."""
MOST_EVEN = 4.0
"""Largest distance between two desired values over the smallest one, up to which the axis is to scale."""
MOST_TICKS = 12
"""Desired values that are lettered; of more, every second, third ... one is."""
NOT_STATED = "not\nstated"
SOUND = "_sound"
"""Label of the filled markers; matplotlib lists no label with an underscore."""


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes, with 95 % intervals and the range over single amplitudes.

    `doubtful` says why the fit is doubtful.

    Raises
    ------
    InputError
        No trial has a fit over all amplitudes (a row without `amplitude_deg`).
    """
    table = impedance.filter(pl.col("amplitude_deg").is_null())
    if table.is_empty():
        raise InputError(
            "the impedance table has no fit over all amplitudes (a row with empty amplitude_deg), "
            "which Fig. 5 draws; fit the trials again"
        )
    absent = [pl.lit(None, pl.Float64).alias(column) for column in WHERE_THEY_ARE if column not in table.columns]
    table = table.with_columns(absent)
    if "doubtful" not in table.columns:
        table = table.with_columns(doubtful=pl.lit(None, pl.String))
    return of_place(table).with_columns(look_numbers(table["controller"])).select(COLUMNS)


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: a marker per trial's fit to all amplitudes, over a dashed line at the desired value.

    Trials of one desired value stand side by side, those of one controller together, in the order of the other desired
    value. A filled marker is a sound fit, an open one a doubtful fit. A thin bar is the range of the fits to single
    amplitudes, a thick bar the 95 % interval of noise. The legend names the bars, or says that the markers hide them. A
    dash of the same colour is the prediction of linear theory for the trial's gains. Every joint and side has a row of
    panels. Trials whose desired value is not stated stand at the right end of the axis.
    """
    parts, looks = placed_rows(table), looks_in(table)
    names = [name for name, _ in parts for _ in range(2)]
    figure, axes = panels(DOUBLE_COLUMN, 0.3 + 2.4 * len(parts), rows=len(parts), columns=2, names=names)
    for number, (_, part) in enumerate(parts):
        stiffness, damping = axes[2 * number : 2 * number + 2]
        draw_quantity(stiffness, part, "K", looks)
        draw_quantity(damping, part, "B", looks)
        stiffness.set_xlabel("Desired $K_d$ (N·m/rad)")
        stiffness.set_ylabel(r"Stiffness $\hat{K}$ (N·m/rad)")
        damping.set_xlabel("Desired $B_d$ (N·m·s/rad)")
        damping.set_ylabel(r"Damping $\hat{B}$ (N·m·s/rad)")
    bars, remark = spread_entries({ax: "KB"[number % 2] for number, ax in enumerate(axes)}, table)
    handles = [*entries(table, looks), *bars]
    columns = legend_columns([str(handle.get_label()) for handle in handles], DOUBLE_COLUMN, most=6)
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, columnspacing=1.4)
    figure.supxlabel(remark, fontsize=8)
    return figure


def draw_quantity(ax: Axes, table: pl.DataFrame, symbol: str, looks: dict[str | None, Look]) -> None:
    """One quantity, `K` or `B`, against its desired value."""
    desired = f"{symbol}_d"
    places = axis_places(table[desired])
    table = table.with_columns(x=side_by_side(table, desired, "B_d" if symbol == "K" else "K_d"))
    half, stated = CLUSTER / 2 * spacing(places), [level for level in places if level is not None]
    at = np.array([places[level] for level in stated])
    ax.hlines(stated, at - 1.15 * half, at + 1.15 * half, color=BLACK, linestyle=DASHES, linewidth=0.7)
    for controller, look in looks.items():
        rows = table.filter(pl.col("controller").eq_missing(pl.lit(controller)))
        draw_spread(ax, rows, "x", symbol, look.colour)
        ax.plot(rows["x"], rows[f"{symbol}_predicted"], "_", color=look.colour, markersize=5.5, mew=0.6)
        sound = rows.filter(~IS_DOUBTFUL)
        for fits, fill, label in ((rows, WHITE, look.label), (sound, look.colour, SOUND)):
            x, y = fits["x"], fits[symbol]
            ax.plot(x, y, look.marker, color=look.colour, mfc=fill, mew=0.7, markersize=look.size, label=label)
    every = -(-len(places) // MOST_TICKS)
    shown = [level for k, level in enumerate(places) if k % every == 0 or level is None]
    letters = [NOT_STATED if level is None else f"{level:g}" for level in shown]
    ax.set_xticks([places[level] for level in shown], letters)
    ax.tick_params(axis="x", length=0)
    ax.ticklabel_format(axis="y", useOffset=False)


def entries(table: pl.DataFrame, looks: dict[str | None, Look]) -> list[Line2D]:
    """Legend of the markers, of the desired values and of linear theory, as far as the table has them."""

    def entry(marker: str, label: str, **look: Any) -> Line2D:
        """A marker of the legend."""
        return Line2D([], [], linestyle="", marker=marker, label=label, **look)

    found = [entry(look.marker, look.label, color=look.colour, markersize=look.size) for look in looks.values()]
    if len(table.filter(IS_DOUBTFUL)):
        found.append(entry("o", "Open: doubtful fit", color=GREY, mfc=WHITE, markersize=3.8, mew=0.7))
    if table["K_d"].count() or table["B_d"].count():
        found.append(Line2D([], [], color=BLACK, linestyle=DASHES, linewidth=0.7, label="Desired"))
    if table["K_predicted"].count() or table["B_predicted"].count():
        found.append(entry("_", "Linear model", color=BLACK, markersize=5.5, mew=0.6))
    return found


def axis_places(desired: pl.Series) -> dict[float | None, float]:
    """Place of each desired value on its axis: to scale where the values are about evenly spaced, else one after the
    other. The place of trials without one is behind the last."""
    levels = [float(level) for level in desired.drop_nulls().unique().sort()]
    steps = np.diff(levels)
    even = bool(len(levels) < 2 or steps.max() <= MOST_EVEN * steps.min())
    places: dict[float | None, float] = {level: level if even else float(k) for k, level in enumerate(levels)}
    if desired.null_count():
        places[None] = max(places.values(), default=0.0) + spacing(places)
    return places


def spacing(places: dict[float | None, float]) -> float:
    """Smallest distance between two places; 1 if there is one."""
    return float(np.min(np.diff(sorted(places.values())), initial=np.inf)) if len(places) > 1 else 1.0


def side_by_side(table: pl.DataFrame, desired: str, other: str) -> pl.Series:
    """Places of the trials on the axis of one desired value: controller by controller, in the order of the other."""
    levels, controllers = (table[column].unique().sort().to_list() for column in (other, "controller"))
    slots = len(controllers) * (len(levels) + 1) - 1  # one stays free between two controllers
    slot = [
        controllers.index(controller) * (len(levels) + 1) + levels.index(value)
        for controller, value in table.select("controller", other).iter_rows()
    ]
    place = (np.array(slot) - (slots - 1) / 2) / max(slots - 1, 1)
    places = axis_places(table[desired])
    return pl.Series([places[value] for value in table[desired]]) + CLUSTER * spacing(places) * place
