"""Figs. 4, 5 and 6: measured and modelled torque, estimated stiffness and damping, and VAF of
impedance trials; beside them what models say: the prediction of the components, and each link from
command to torque."""

import textwrap
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import columns_of, names, style
from osl_analysis.stats.repeats import counted, doubts_of_trials
from osl_analysis.table import held_against_desired

OF_FITS = ("trial", "controller", "K_d", "B_d", "amplitude_deg")


def shown_trial(table: pl.DataFrame) -> str:
    """The trial of Fig. 4, and why this one."""
    joint, side, trial, chosen = table.select("joint", "side", "trial", "chosen").row(0)
    why = f" ({names.as_text(chosen)})" if chosen else ""
    place = names.as_text(names.place_name(joint, side))
    return f"{f'{place}, trial' if place else 'Trial'} {names.as_text(trial)}{why}."


@style.drawing(columns_of("fig4"), about=shown_trial)
def draw_fig4(table: pl.DataFrame) -> Figure:
    """(a) Angle; (b) torque, the fit dashed magenta, which the draft calls blue in its caption; (c)
    residual."""
    joint, side, trial = table.select("joint", "side", "trial").row(0)
    place = ", ".join(
        filter(None, [names.place_name(joint, side), f"trial {names.drawn_name(trial, 60)}"])
    )
    figure, axes = style.panels(style.DOUBLE_COLUMN, 3.9, rows=3, names=[place, "", ""])
    angle, torque, residual = axes
    step, drawn = pl.col("time").diff(), ("theta_deg", "torque", "torque_model")
    # with one of NaN before each step that is longer than two ordinary ones
    rows = table.with_row_index("row")
    breaks = rows.filter(step > 2 * step.median()).with_columns(
        pl.lit(np.nan).alias(name) for name in drawn
    )
    lines = pl.concat([breaks, rows]).sort("row", maintain_order=True)
    time, label = (
        lines["time"],
        f"Best-fit {table['model'][0]}" + " (doubtful)" * style.has_doubtful(table),
    )
    angle.plot(time, lines["theta_deg"], color=style.BLACK, linewidth=0.9)
    torque.plot(time, lines["torque"], color="#B4B4B4", linewidth=2.2, label="Measured")
    torque.plot(
        time,
        lines["torque_model"],
        color=style.MAGENTA,
        linestyle=(0, (2.5, 1.5)),
        linewidth=1.0,
        label=label,
    )
    residual.axhline(0, color=style.BLACK, linewidth=0.4)
    residual.plot(time, lines["torque"] - lines["torque_model"], color=style.BLACK, linewidth=0.7)
    residual.set_xlabel("Time (s)")
    out = pl.col("torque_model").is_null()
    unfitted = (
        table.with_columns(run=out.rle_id()).filter(out).partition_by("run", maintain_order=True)
    )
    for ax, name in zip(axes, ("Angle (deg)", "Torque (N·m)", "Residual (N·m)"), strict=True):
        ax.set_ylabel(name)
        if ax is not residual:
            ax.sharex(residual)
            ax.tick_params(labelbottom=False)
        for number, run in enumerate(unfitted):
            label, ends = "" if number else "Not fitted", (run["time"][0], run["time"][-1])
            ax.axvspan(*ends, color="#E8E8E8", linewidth=0, zorder=0, label=label)
        ax.margins(x=0.005)
    torque.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    figure.align_ylabels()
    return figure


def fig5_points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial: its fit to all amplitudes, with 95 % intervals, and the range over single
    amplitudes and what linear theory predicts where the table has them."""
    table = impedance.filter(pl.col("amplitude_deg").is_null())
    if table.is_empty():
        raise InputError(
            "the impedance table has no fit over all amplitudes (a row with empty amplitude_deg), "
            "which Fig. 5 draws; fit the trials again"
        )
    return names.completed(
        table.with_columns(names.look_numbers(table["controller"])), columns_of("fig5"), True
    )


def fig5_panels(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame, str, bool]]:
    """Panel by panel the name of the joint, its trials with their place `x` on the axis, the
    quantity, and whether its error is drawn. Trials of one condition are 1 apart, those of another
    B_d 0.7 more, and of another K_d 1.6 more."""
    order, panels = (
        {controller: number for number, controller in enumerate(names.looks_in(table))},
        [],
    )
    for name, part in names.placed_rows(table):
        ranks = pl.Series("rank", [order[controller] for controller in part["controller"]])
        rows = part.with_columns(ranks).sort(
            "K_d", "B_d", "rank", nulls_last=True, maintain_order=True
        )
        steps = [0.0]
        for before, after in pairwise(rows.select("K_d", "B_d").rows()):
            steps.append(
                1 + (1.6 if before[0] != after[0] else 0.7 if before[1] != after[1] else 0.0)
            )
        rows = rows.with_columns(x=pl.Series(np.cumsum(steps)))
        for symbol in "KB":
            panels.append((name, rows, symbol, False))
            if errors_of(rows, symbol)[symbol].count():
                panels.append((name, rows, symbol, True))
    return panels


def fig5_entries(table: pl.DataFrame, looks: dict[str | None, style.Look]) -> dict[str, Any]:
    """What the legend says, of what is drawn."""
    entries = {
        o.label: style.key(o.label, marker=o.marker, color=o.colour, markersize=o.size)
        for o in looks.values()
    }
    entries |= style.open_entry(table)
    for label, column, line in (
        ("Desired", "{}_d", {"color": style.BLACK, "linewidth": 0.8}),
        (
            "Linear model",
            "{}_predicted",
            {"marker": "_", "color": style.GREY, "markersize": 7, "mew": 0.7},
        ),
        (
            "Viscous part",
            "{}_viscous",
            {"marker": "x", "color": style.GREY, "markersize": 3.2, "mew": 0.9},
        ),
    ):
        columns = [column.format(symbol) for symbol in "KB"]
        if any(table[name].count() for name in columns if name in table.columns):
            entries[label] = style.key(label, **line)
    return entries


@style.drawing(
    columns_of("fig5"), fig5_points, (*OF_FITS, "K", "K_low", "K_high", "B", "B_low", "B_high")
)
def draw_fig5(table: pl.DataFrame) -> Figure:
    """Stiffness and damping, and below each its error in percent where a value was asked for. Each
    desired impedance has a place of its own on the axis, which is no scale; its trials stand side
    by side there."""
    looks, drawn = names.looks_in(table), fig5_panels(table)
    several = len({name for name, *_ in drawn}) > 1
    words = [
        f"{'Stiffness' if symbol == 'K' else 'Damping'}{', error' * error}"
        for *_, symbol, error in drawn
    ]
    titles = [
        f"{name}: {word}" if several else word
        for (name, *_), word in zip(drawn, words, strict=True)
    ]
    heights = [0.9 if error else 1.0 for *_, error in drawn]
    height = 0.5 + 1.5 * sum(heights)
    figure, axes = style.panels(
        style.DOUBLE_COLUMN, height, rows=len(drawn), names=titles, heights=heights
    )
    for k, (ax, (_, rows, symbol, error)) in enumerate(zip(axes, drawn, strict=True)):
        draw_quantity(ax, errors_of(rows, symbol) if error else rows, symbol, looks)
        if k + 1 < len(drawn) and drawn[k + 1][1] is rows:
            ax.set_xticks([])
        else:
            letter_conditions(ax, rows)
        if error:
            label_percent_axis(ax)
            ax.set_ylabel(rf"$\hat{{{symbol}}}/{symbol}_d - 1$ (%)")
            continue
        ax.set_ylabel(names.AXIS_LABELS[symbol])
        for wanted in rows.drop_nulls(f"{symbol}_d").partition_by(
            "K_d", "B_d", maintain_order=True
        ):
            ends = wanted["x"][0] - 0.6, wanted["x"][-1] + 0.6
            ax.hlines(wanted[f"{symbol}_d"][0], *ends, color=style.BLACK, linewidth=0.8)
    entries = fig5_entries(table, looks)
    style.legend_above(figure, entries, 6, 0.9 * style.DOUBLE_COLUMN, columnspacing=1.4)
    figure.align_ylabels()
    return figure


def errors_of(rows: pl.DataFrame, symbol: str) -> pl.DataFrame:
    """The same rows with all that is drawn of one quantity in percent of its desired value, less
    100; null where none is above zero. Of a damping that without friction, where this is
    certain."""
    desired, kinds = (
        pl.col(f"{symbol}_d"),
        ("", "_low", "_high", "_amplitudes_low", "_amplitudes_high", "_predicted"),
    )
    held = held_against_desired(rows).with_columns(B_viscous=pl.lit(None, pl.Float64))
    drawn = (pl.col(f"{symbol}{kind}") for kind in kinds)
    return held.with_columns(
        pl.when(desired > 0).then(100 * (one / desired - 1)).name.keep() for one in drawn
    )


def label_percent_axis(ax: Axes) -> None:
    """Errors [percent] on an axis that is even up to 2 % and logarithmic beyond: 1 % is seen beside
    50 %."""
    low, high = min(ax.dataLim.y0, -1.0), max(ax.dataLim.y1, 1.0)
    ax.set_yscale("symlog", linthresh=2.0, linscale=0.5)
    every = [sign * size for size in (2, 10, 30, 100, 300, 1000) for sign in (-1, 1)]
    shown = sorted([0, *(tick for tick in every if 1.2 * low <= tick <= 1.2 * high)])
    ax.set_yticks(shown, [f"{tick:+g}".replace("-", "−") if tick else "0" for tick in shown])
    ax.set_yticks([], minor=True)
    ax.set_ylim(1.5 * low, 1.5 * high)
    ax.grid(axis="y", color="#E4E4E4", linewidth=0.4)
    ax.axhline(0, color=style.BLACK, linewidth=0.8)
    ax.set_axisbelow(True)


def draw_quantity(
    ax: Axes, rows: pl.DataFrame, symbol: str, looks: dict[str | None, style.Look]
) -> None:
    """Estimates of one quantity at their places `x`, and lines between values of K_d; a cross is
    the part of the damping that is no friction."""
    last = float(rows["x"][-1])
    # at this share of their usual size, and not below 0.3, the markers of neighbours do not touch
    share = float(np.clip(72 * ax.figure.figure.get_figwidth() / (last + 8) / 4.5, 0.3, 1.0))
    for controller, look in looks.items():
        fits = names.of_controller(rows, controller)
        style.draw_estimates(ax, fits, "x", symbol, look, share, zorder=3)
        ax.plot(
            fits["x"],
            fits[f"{symbol}_predicted"],
            "_",
            color=look.colour,
            markersize=7 * share,
            mew=0.7,
        )
        if symbol == "B":
            ax.plot(
                fits["x"],
                fits["B_viscous"],
                "x",
                color=look.colour,
                markersize=3.2 * share,
                mew=0.9,
                zorder=4,
            )
    edge = max(1.0, (8 - last) / 2)  # an axis has room for eight trials at least
    ax.set_xlim(-edge, last + edge)
    for left, right in pairwise(rows.partition_by("K_d", maintain_order=True)):
        ax.axvline((left["x"][-1] + right["x"][0]) / 2, color="#B8B8B8", linewidth=0.5, zorder=0)


def letter_conditions(ax: Axes, rows: pl.DataFrame) -> None:
    """Below the axis the desired dampings, and below these the stiffnesses; as many as there is
    room for. A few trials for which none is stated have their names."""
    inches = (ax.figure.figure.get_figwidth() - 0.6) / float(np.ptp(ax.get_xlim()))
    if not rows["K_d"].count() + rows["B_d"].count() and inches > 0.5:
        ax.set_xticks(
            rows["x"], [names.drawn_name(trial, 10) for trial in rows["trial"]], fontsize="small"
        )
        ax.tick_params(axis="x", length=0)
        return
    for minor, keys in ((False, ["K_d", "B_d"]), (True, ["K_d"])):
        places = rows.group_by(keys, maintain_order=True).agg(pl.col("x").mean())
        name, equals = ("$K_d$ ", "= ") if minor else ("", "")
        shown, end = {}, -np.inf
        for place, value in places.select("x", keys[-1]).iter_rows():
            word = name + ("not stated" if value is None else f"{equals}{value:g}")
            half = 0.03 * len(word) / inches  # letters of 8 points
            if place - half > end:
                shown[place] = word
                end = place + half + 0.06 / inches
        ax.set_xticks(list(shown), list(shown.values()), minor=minor)
    ax.xaxis.remove_overlapping_locs = False
    ax.tick_params(axis="x", which="both", length=0)
    ax.tick_params(axis="x", which="minor", pad=13)
    ax.set_xlabel("Desired $B_d$ (N·m·s/rad) for each desired $K_d$ (N·m/rad)")


LEAST_LEFT = 1e-4  # smaller unexplained shares [percent] are drawn here


def fig6_points(impedance: pl.DataFrame) -> pl.DataFrame:
    """One row per trial and amplitude, doubtful where the fit to all of the trial is. A trial that
    no stepped sine moved has one row, a fit without a VAF (a constant torque) none."""
    single = (pl.col("amplitude_deg").is_not_null() | (pl.len().over("trial") == 1)) & pl.col(
        "VAF"
    ).is_finite()
    in_mean = counted(impedance)["trial"].unique()
    marked = doubts_of_trials(impedance).with_columns(
        in_mean=pl.col("trial").is_in(in_mean.to_list()).cast(pl.Int64)
    )
    table = marked.filter(single)
    if table.is_empty():
        raise InputError(
            "the impedance table has no VAF of one amplitude, which Fig. 6 draws; fit the trials"
            " again"
        )
    return names.completed(
        table.with_columns(names.look_numbers(table["controller"])), columns_of("fig6"), True
    )


@style.drawing(columns_of("fig6"), fig6_points, (*OF_FITS, "VAF"))
def draw_fig6(table: pl.DataFrame) -> Figure:
    """A swarm per controller of each joint and side, over an axis that is logarithmic in the
    unexplained variance."""
    looks, parts = names.looks_in(table), table.partition_by(names.JOINT_SIDE, maintain_order=True)
    found = (
        names.of_controller(part, controller)
        for part in parts
        for controller in names.looks_in(part)
    )
    swarms = [
        rows.with_columns(left=(100 - pl.col("VAF")).clip(LEAST_LEFT))
        for rows in found
        if len(rows)
    ]
    width = style.SINGLE_COLUMN if len(swarms) <= 2 else style.DOUBLE_COLUMN
    figure, (ax,) = style.panels(width, 3.0)
    ax.set_yscale("log")
    every = np.log10(np.concatenate([rows["left"].to_numpy() for rows in swarms]))
    # at both ends, and for two ticks
    room = max(0.05 * float(np.ptp(every)), 0.4 - float(np.ptp(every)) / 2)
    low, high = float(every.min()) - room, float(every.max()) + room
    ax.set_ylim(10.0**low, 10.0**high)
    # of a swarm [in]: the panel is no smaller
    across, height, written = (width - 0.75) / len(swarms), 1.8, []
    for place, rows in enumerate(swarms):
        look, heights = (
            looks[rows["controller"][0]],
            (high - np.log10(rows["left"].to_numpy())) / (high - low) * height,
        )
        # the marker and a small gap
        x = place + style.swarm_offsets(heights, 4.9 / 72, across, 0.45)
        style.draw_fits(ax, rows, x, rows["left"], look, linewidths=0.8)
        median = float(np.median(rows.filter(in_mean=1)["VAF"]))
        ends = place - 0.3, place + 0.3
        ax.hlines(
            max(100 - median, LEAST_LEFT), *ends, color=style.BLACK, linewidth=1.2, zorder=0.5
        )
        where = (
            names.place_name(*rows.select(names.JOINT_SIDE).row(0))
            if len(parts) > 1 or len(swarms) > 2
            else ""
        )
        n, trials = rows["trial"].n_unique(), names.count_of(rows["trial"].n_unique(), "trial")
        fits = trials if len(rows) == n else f"{names.count_of(len(rows), 'fit')} of {trials}"
        # two of the unexplained share
        digits = min(max(1 - int(np.floor(np.log10(max(100 - median, 1e-5)))), 2), 6)
        told = (look.label.strip(), where, fits, f"median {median:.{digits}f} %".replace("-", "−"))
        lines = (textwrap.wrap(line, max(int(17 * across), 6)) for line in told if line)
        written.append("\n".join(part for line in lines for part in line))
    if entries := style.open_entry(table):
        ax.legend(handles=entries.values(), loc="lower left")
    style.label_log_axis(ax.yaxis, (10.0**low, 10.0**high), 12)
    # nothing is drawn beyond
    ticks = [tick for tick in ax.get_yticks() if tick >= LEAST_LEFT * (1 - 1e-9)]
    said = [
        f"{'≥ ' * bool(np.isclose(tick, LEAST_LEFT, atol=0.0))}{100 - tick:.7g}".replace("-", "−")
        for tick in ticks
    ]
    ax.set_yticks(ticks, said)
    ax.invert_yaxis()
    ax.set_xlim(-0.5, len(swarms) - 0.5)
    ax.set_xticks(range(len(swarms)), written)
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("VAF (%), log scale of 100 − VAF")
    return figure


def prediction_points(prediction: pl.DataFrame, frequencies: pl.DataFrame) -> pl.DataFrame:
    columns = columns_of("prediction")
    trials = names.completed(prediction, columns, True).filter(pl.col("VAF").is_not_null())
    rows = [trials, names.completed(frequencies, columns, True)]
    table = pl.concat([one for one in rows if len(one)] or rows, how="vertical_relaxed")
    return table.with_columns(names.look_numbers(table["controller"]))


@style.drawing(
    columns_of("prediction"),
    prediction_points,
    needs=("trial", "controller", "VAF"),
    nothing="the components of no impedance trial were all measured",
)
def draw_prediction(table: pl.DataFrame) -> Figure:
    """Measured over predicted, with the identity; their difference with its interval; what is
    missed over frequency."""
    said = {
        "K": r"stiffness $\hat{K}$ (N·m/rad)",
        "B": r"damping $\hat{B}$ (N·m·s/rad)",
        "torque": "torque, SD (N·m)",
    }
    parts, looks = names.placed_rows(table), names.looks_in(table)
    rows, kinds = 3 * len(parts), ("Stiffness", "Damping", "Torque")
    titles = names.panel_titles(
        parts, (*kinds, *(f"{kind}, difference" for kind in kinds), "Torque missed", "", "")
    )
    figure, axes = style.panels(
        style.DOUBLE_COLUMN, min(0.4 + 1.9 * rows, 9.5), rows=rows, columns=3, names=titles
    )
    for number, (_, of_place) in enumerate(parts):
        part, missed = (
            of_place.filter(pl.col("share").is_null() == trials) for trials in (True, False)
        )
        for k, (symbol, words) in enumerate(said.items()):
            above, below = axes[9 * number + k], axes[9 * number + 3 + k]
            ends = part.select(symbol, f"{symbol}_measured").to_numpy()
            above.plot(
                [ends.min(), ends.max()], [ends.min(), ends.max()], color=style.BLACK, linewidth=0.6
            )
            below.axhline(0, color=style.BLACK, linewidth=0.6)
            for controller, look in looks.items():
                own = names.of_controller(part, controller)
                x, y = own[symbol], own[f"{symbol}_measured"]
                style.draw_fits(above, own, x, y, look, 0.8)
                low, high = own[f"{symbol}_low"] - x, own[f"{symbol}_high"] - x
                below.vlines(x, low, high, color=look.colour, alpha=0.3, linewidth=style.THICK)
                style.draw_fits(below, own, x, y - x, look, 0.8)
            above.set_ylabel(f"Measured {words}")
            below.set_xlabel(f"Predicted {words}")
            above.sharex(below)
            above.tick_params(labelbottom=False)
        axes[9 * number + 3].set_ylabel("Measured − predicted")
        trend, *spare = axes[9 * number + 6 : 9 * number + 9]
        grid = trend.get_gridspec()
        assert grid is not None  # of panels
        trend.set_subplotspec(grid[3 * number + 2, :])
        for ax in spare:
            ax.remove()
        for controller, look in looks.items():
            own = names.of_controller(missed, controller)
            for one in own.partition_by("trial"):
                line = style.DOTTED if style.has_doubtful(one) else "-"
                trend.plot(
                    one["frequency_hz"],
                    one["share"],
                    color=look.colour,
                    linestyle=line,
                    linewidth=0.4,
                )
            middle = own.group_by("frequency_hz").agg(pl.col("share").median()).sort("frequency_hz")
            trend.plot(
                *middle,
                color=look.colour,
                marker=look.marker,
                markersize=look.size,
                linewidth=style.THICK,
            )
        trend.set_yscale("log")
        if len(missed):
            style.label_frequency_axis(trend, missed["frequency_hz"], most=12)
            style.label_log_axis(trend.yaxis, trend.get_ylim(), most=6)
        trend.set_xlabel("Frequency (Hz)")
        trend.set_ylabel("Share of the torque (%)")
    entries = {
        o.label: style.key(o.label, marker=o.marker, color=o.colour, markersize=o.size)
        for o in looks.values()
    }
    lines = {
        "Identity": (style.BLACK, 1.0, 0.6),
        "95 % interval of the prediction": (style.GREY, 0.5, style.THICK),
    }
    for label, (colour, alpha, width) in lines.items():
        entries[label] = style.key(label, color=colour, alpha=alpha, linewidth=width)
    style.legend_above(figure, entries | style.open_entry(table), 5)
    figure.align_ylabels()
    return figure


LINKS = {
    "command": "Command: $K_1$", "motor": r"Motor: $k_\tau n_m$", "belt": "Belt: $K_s$",
    "rendered": r"Joint: $\hat{K}$",
}  # fmt: skip


def chain_points(
    law: pl.DataFrame, impedance: pl.DataFrame, evidence: pl.DataFrame
) -> pl.DataFrame:
    """By how much [percent] each link of a trial is off what is expected of it."""
    table = names.completed(law, (*columns_of("chain"), "K_1", "k_tau_n_m"))
    for link, symbol in (("command", "K_1"), ("motor", "k_tau_n_m")):
        for end in ("", "_low", "_high"):
            off = 100 * (pl.col(f"{symbol}{end}") / pl.col(f"{symbol}_programmed") - 1)
            table = table.with_columns(off.alias(f"{link}{end}"))
    whole = pl.col("amplitude_deg").is_null()
    joint = names.completed(impedance.filter(whole), ("K", "K_low", "K_high", "K_predicted"))
    miss = {
        f"rendered{end}": 100 * (pl.col(f"K{end}") / pl.col("K_predicted") - 1)
        for end in ("", "_low", "_high")
    }
    joint = joint.select("trial", **miss)
    belt = names.completed(evidence.filter(whole), ("K_s_ratio",)).select(
        "trial", belt=100 * (pl.col("K_s_ratio") - 1)
    )
    for of_link in (belt, joint):
        table = table.drop(of_link.columns[1:]).join(
            of_link, on="trial", how="left", maintain_order="left"
        )
    return table.with_columns(names.look_numbers(table["controller"])).select(columns_of("chain"))


@style.drawing(
    columns_of("chain"),
    chain_points,
    needs=("trial", "controller", "K_1"),
    nothing="no impedance trial logs current and angle of the motor",
)
def draw_chain(table: pl.DataFrame) -> Figure:
    """A panel per link, from the command to the joint's torque: percent off, over K_d, with
    intervals."""
    parts, looks = names.placed_rows(table), names.looks_in(table)
    titles = names.panel_titles(parts, [*LINKS.values()])
    size = style.DOUBLE_COLUMN, 0.4 + 1.9 * len(parts)
    figure, axes = style.panels(
        *size, len(parts), len(LINKS), shares=[1] * len(LINKS), names=titles
    )
    for number, (_, part) in enumerate(parts):
        for ax, link in zip(axes[len(LINKS) * number :], LINKS, strict=False):
            ax.axhline(0, color=style.BLACK, linewidth=0.6)
            for controller, look in looks.items():
                own = names.of_controller(part, controller)
                if f"{link}_low" in own.columns:
                    ends = own[f"{link}_low"], own[f"{link}_high"]
                    ax.vlines(own["K_d"], *ends, color=look.colour, linewidth=style.THIN)
                style.draw_fits(ax, own, own["K_d"], own[link], look, 0.6)
            ax.set_xlabel("$K_d$ (N·m/rad)")
        axes[len(LINKS) * number].set_ylabel("Off what is expected (%)")
    entries = {
        o.label: style.key(o.label, marker=o.marker, color=o.colour, markersize=o.size)
        for o in looks.values()
    }
    style.legend_above(figure, entries | style.open_entry(table), 5)
    return figure
