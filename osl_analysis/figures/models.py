"""What models say beside what was measured: the prediction of the components, and each link from command to torque."""

import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures import columns_of, names, style


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
    """Measured over predicted, with the identity; their difference with its interval; what is missed over frequency."""
    said = {"K": r"stiffness $\hat{K}$ (N·m/rad)", "B": r"damping $\hat{B}$ (N·m·s/rad)", "torque": "torque, SD (N·m)"}
    parts, looks = names.placed_rows(table), names.looks_in(table)
    rows, kinds = 3 * len(parts), ("Stiffness", "Damping", "Torque")
    titles = names.panel_titles(parts, (*kinds, *(f"{kind}, difference" for kind in kinds), "Torque missed", "", ""))
    figure, axes = style.panels(style.DOUBLE_COLUMN, min(0.4 + 1.9 * rows, 9.5), rows=rows, columns=3, names=titles)
    for number, (_, of_place) in enumerate(parts):
        part, missed = (of_place.filter(pl.col("share").is_null() == trials) for trials in (True, False))
        for k, (symbol, words) in enumerate(said.items()):
            above, below = axes[9 * number + k], axes[9 * number + 3 + k]
            ends = part.select(symbol, f"{symbol}_measured").to_numpy()
            above.plot([ends.min(), ends.max()], [ends.min(), ends.max()], color=style.BLACK, linewidth=0.6)
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
                trend.plot(one["frequency_hz"], one["share"], color=look.colour, linestyle=line, linewidth=0.4)
            middle = own.group_by("frequency_hz").agg(pl.col("share").median()).sort("frequency_hz")
            trend.plot(*middle, color=look.colour, marker=look.marker, markersize=look.size, linewidth=style.THICK)
        trend.set_yscale("log")
        if len(missed):
            style.label_frequency_axis(trend, missed["frequency_hz"], most=12)
            style.label_log_axis(trend.yaxis, trend.get_ylim(), most=6)
        trend.set_xlabel("Frequency (Hz)")
        trend.set_ylabel("Share of the torque (%)")
    entries = {o.label: style.key(o.label, marker=o.marker, color=o.colour, markersize=o.size) for o in looks.values()}
    lines = {"Identity": (style.BLACK, 1.0, 0.6), "95 % interval of the prediction": (style.GREY, 0.5, style.THICK)}
    for label, (colour, alpha, width) in lines.items():
        entries[label] = style.key(label, color=colour, alpha=alpha, linewidth=width)
    style.legend_above(figure, entries | style.open_entry(table), 5)
    figure.align_ylabels()
    return figure


LINKS = {
    "command": "Command: $K_1$", "motor": r"Motor: $k_\tau n_m$", "belt": "Belt: $K_s$",
    "rendered": r"Joint: $\hat{K}$",
}  # fmt: skip


def chain_points(law: pl.DataFrame, impedance: pl.DataFrame, evidence: pl.DataFrame) -> pl.DataFrame:
    """By how much [percent] each link of a trial is off what is expected of it."""
    table = names.completed(law, (*columns_of("chain"), "K_1", "k_tau_n_m"))
    for link, symbol in (("command", "K_1"), ("motor", "k_tau_n_m")):
        for end in ("", "_low", "_high"):
            off = 100 * (pl.col(f"{symbol}{end}") / pl.col(f"{symbol}_programmed") - 1)
            table = table.with_columns(off.alias(f"{link}{end}"))
    whole = pl.col("amplitude_deg").is_null()
    joint = names.completed(impedance.filter(whole), ("K", "K_low", "K_high", "K_predicted"))
    miss = {f"rendered{end}": 100 * (pl.col(f"K{end}") / pl.col("K_predicted") - 1) for end in ("", "_low", "_high")}
    joint = joint.select("trial", **miss)
    belt = names.completed(evidence.filter(whole), ("K_s_ratio",)).select("trial", belt=100 * (pl.col("K_s_ratio") - 1))
    for of_link in (belt, joint):
        table = table.drop(of_link.columns[1:]).join(of_link, on="trial", how="left", maintain_order="left")
    return table.with_columns(names.look_numbers(table["controller"])).select(columns_of("chain"))


@style.drawing(
    columns_of("chain"),
    chain_points,
    needs=("trial", "controller", "K_1"),
    nothing="no impedance trial logs current and angle of the motor",
)
def draw_chain(table: pl.DataFrame) -> Figure:
    """A panel per link, from the command to the joint's torque: percent off, over K_d, with intervals."""
    parts, looks = names.placed_rows(table), names.looks_in(table)
    titles = names.panel_titles(parts, [*LINKS.values()])
    size = style.DOUBLE_COLUMN, 0.4 + 1.9 * len(parts)
    figure, axes = style.panels(*size, len(parts), len(LINKS), shares=[1] * len(LINKS), names=titles)
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
    entries = {o.label: style.key(o.label, marker=o.marker, color=o.colour, markersize=o.size) for o in looks.values()}
    style.legend_above(figure, entries | style.open_entry(table), 5)
    return figure
