"""Fig. 5: estimated stiffness and damping against the desired ones."""

from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from osl_analysis.errors import InputError
from osl_analysis.figures import style
from osl_analysis.figures.names import (
    UNIT_OF,
    as_text,
    count_of,
    decimals_of,
    doubtful_said,
    look_numbers,
    looks_in,
    of_controller,
    of_place,
    placed_rows,
    rounded_number,
    with_sd,
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


def points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes, with 95 % intervals and the range over single amplitudes."""
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


@style.paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) stiffness, (b) damping: a marker per trial's fit to all amplitudes, a black line at the desired value.

    Each desired impedance has a place of its own on the axis, which is no scale, the same in both panels; its trials
    stand side by side there, open where doubtful. Thin bars: range of the fits to single amplitudes; thick bars: 95 %
    interval; a dash of the same colour: linear theory. Every joint and side has two panels.
    """
    parts, looks = placed_rows(table), looks_in(table)
    names = [name for name, _ in parts for _ in range(2)]
    figure, axes = style.panels(style.DOUBLE_COLUMN, 0.5 + 3.2 * len(parts), rows=2 * len(parts), names=names)
    for (_, part), stiffness, damping in zip(parts, axes[::2], axes[1::2], strict=True):
        rows = side_by_side(part, looks)
        for ax, symbol in ((stiffness, "K"), (damping, "B")):
            draw_quantity(ax, rows, symbol, looks)
            for left, right in pairwise(rows.partition_by("K_d", maintain_order=True)):
                ax.axvline((left["x"][-1] + right["x"][0]) / 2, color="#B8B8B8", linewidth=0.5, zorder=0)
        stiffness.set_xticks([])
        letter_conditions(damping, rows)
        stiffness.set_ylabel(r"Stiffness $\hat{K}$ (N·m/rad)")
        damping.set_ylabel(r"Damping $\hat{B}$ (N·m·s/rad)")
    handles = entries(table, looks)
    columns = style.legend_columns([str(handle.get_label()) for handle in handles], 0.9 * style.DOUBLE_COLUMN, most=6)
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, columnspacing=1.4)
    figure.align_ylabels()
    return figure


def side_by_side(table: pl.DataFrame, looks: dict[str | None, style.Look]) -> pl.DataFrame:
    """Rows in the order of K_d, B_d and controller, with their place `x`; values that are not stated come last. Trials
    of one condition are 1 apart, those of another B_d 0.7 more, and of another K_d 1.6 more."""
    order = {controller: number for number, controller in enumerate(looks)}
    ranks = pl.Series("rank", [order[controller] for controller in table["controller"]])
    rows = table.with_columns(ranks).sort("K_d", "B_d", "rank", nulls_last=True, maintain_order=True)
    steps, before = [0.0], rows.select("K_d", "B_d").rows()
    for (K_before, B_before), (K_d, B_d) in pairwise(before):
        steps.append(1 + (1.6 if K_d != K_before else 0.7 if B_d != B_before else 0.0))
    return rows.with_columns(x=pl.Series(np.cumsum(steps)))


def draw_quantity(ax: Axes, rows: pl.DataFrame, symbol: str, looks: dict[str | None, style.Look]) -> None:
    for wanted in rows.drop_nulls(f"{symbol}_d").partition_by("K_d", "B_d", maintain_order=True):
        reach = float(wanted["x"].min()) - 0.6, float(wanted["x"].max()) + 0.6  # type: ignore[arg-type]
        ax.hlines(wanted[f"{symbol}_d"][0], *reach, color=style.BLACK, linewidth=0.8)
    last = float(rows["x"].max())  # type: ignore[arg-type]
    # at this share of their usual size, and not below 0.3, the markers of neighbours do not touch
    share = float(np.clip(72 * ax.figure.figure.get_figwidth() / (last + 8) / 4.5, 0.3, 1.0))
    for controller, look in looks.items():
        fits = of_controller(rows, controller)
        style.draw_spread(ax, fits, "x", symbol, look.colour)
        ax.plot(fits["x"], fits[f"{symbol}_predicted"], "_", color=look.colour, markersize=7 * share, mew=0.7)
        shape: dict[str, Any] = {"marker": look.marker, "linewidths": 0.8, "label": look.label, "zorder": 3}
        style.draw_fits(ax, fits, fits["x"], fits[symbol], look.colour, share * look.size, **shape)
    ax.ticklabel_format(axis="y", useOffset=False)
    edge = max(1.0, (8 - last) / 2)  # an axis has room for eight trials at least
    ax.set_xlim(-edge, last + edge)


def letter_conditions(ax: Axes, rows: pl.DataFrame) -> None:
    """Below the axis the desired dampings, and below these the stiffnesses; as many as there is room for."""
    inches = (ax.figure.figure.get_figwidth() - 0.6) / float(np.ptp(ax.get_xlim()))
    for minor, keys in ((False, ["K_d", "B_d"]), (True, ["K_d"])):
        places = rows.group_by(keys, maintain_order=True).agg(pl.col("x").mean())
        name, equals = ("$K_d$ ", "= ") if minor else ("", "")
        words = [name + ("not stated" if value is None else f"{equals}{value:g}") for value in places[keys[-1]]]
        shown, end = [], -np.inf
        for place, word in zip(places["x"], words, strict=True):
            half = style.width_of(word) / inches / 2
            if place - half > end:
                shown.append((place, word))
                end = place + half + 0.06 / inches
        ax.set_xticks([place for place, _ in shown], [word for _, word in shown], minor=minor)
    ax.xaxis.remove_overlapping_locs = False
    ax.tick_params(axis="x", which="both", length=0)
    ax.tick_params(axis="x", which="minor", pad=13)
    ax.set_xlabel("Desired $B_d$ (N·m·s/rad) for each desired $K_d$ (N·m/rad)")


def caption(table: pl.DataFrame) -> str:
    said = [
        r"Estimated stiffness $\hat{K}$ (a) and damping $\hat{B}$ (b) of the joint for every desired impedance $K_d$, "
        "$B_d$. A marker is the fit of Eq. 15 to all amplitudes of one trial, a black line the desired value. Places "
        "on the axis are no scale.",
    ]
    if table["K_predicted"].count() or table["B_predicted"].count():
        said.append("A short line in the colour of a marker is what linear theory predicts for its gains.")
    if table["K_amplitudes_low"].count() or table["B_amplitudes_low"].count():
        said.append("Thin bars are the range of the fits to single amplitudes.")
    widths = {symbol: (table[f"{symbol}_high"] - table[f"{symbol}_low"]).drop_nulls() for symbol in "KB"}
    if all(map(len, widths.values())):
        ends = " and ".join(f"±{width.to_numpy().max() / 2:.2g} {UNIT_OF[s]}" for s, width in widths.items())
        said.append(
            "Thick bars, where they are longer than the markers, are 95 % intervals, for another motion of this kind, "
            f"at most {ends}."
        )
    parts = placed_rows(table)
    for _, part in parts:
        place = part.select("joint", "side").row(0) if len(parts) > 1 else ()
        for controller, look in looks_in(part).items():
            fits = of_controller(part, controller)
            name = ", ".join(filter(None, [*place, controller or look.label.lower()]))
            said.append(f"{as_text(name[:1].upper() + name[1:])} ($n$ = {len(fits)}): {errors_said(fits)}.")
    return " ".join([*said, doubtful_said(table, "drawn open")])


def errors_said(fits: pl.DataFrame) -> str:
    """Mean and SD over trials of estimate minus desired value, and their range; else those of the estimates."""
    said = []
    for symbol in "KB":
        errors = (fits[symbol] - fits[f"{symbol}_d"]).drop_nulls()
        name = rf"$\hat{{{symbol}}} - {symbol}_d$"
        if errors.is_empty():
            errors, name = fits[symbol].drop_nulls(), rf"$\hat{{{symbol}}}$"
        if errors.is_empty():
            continue
        sd = None if len(errors) == 1 else float(errors.std())  # type: ignore[arg-type]
        mean, low, high = (float(value) for value in (errors.mean(), errors.min(), errors.max()))  # type: ignore[arg-type]
        digits = decimals_of(sd or 0.0, mean)
        reach = f", {rounded_number(low, digits)} to {rounded_number(high, digits)}" if sd is not None else ""
        some = f" of {count_of(len(errors), 'fit')}" if len(errors) < len(fits) else ""
        said.append(f"{name}{some} is {with_sd(mean, sd, UNIT_OF[symbol])}{reach}")
    return ", ".join(said) + (" (mean ± SD, range)" if len(fits) > 1 else "")


def entries(table: pl.DataFrame, looks: dict[str | None, style.Look]) -> list[Line2D]:

    def entry(marker: str, label: str, **look: Any) -> Line2D:
        return Line2D([], [], linestyle="", marker=marker, label=label, **look)

    found = [entry(look.marker, look.label, color=look.colour, markersize=look.size) for look in looks.values()]
    if len(table.filter(style.DRAWN_OPEN)):
        found.append(style.OPEN_MARKER)
    if table["K_d"].count() or table["B_d"].count():
        found.append(Line2D([], [], color=style.BLACK, linewidth=0.8, label="Desired"))
    if table["K_predicted"].count() or table["B_predicted"].count():
        found.append(entry("_", "Linear model", color=style.GREY, markersize=7, mew=0.7))
    return found
