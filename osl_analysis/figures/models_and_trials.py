"""`prediction` and `chain`: what models say of impedance trials. The prediction is from components
that were measured alone; the chain goes from the command to the torque of the joint."""

from typing import Any

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

COLUMNS = 2  # panels side by side
PANEL_HEIGHT = 1.85  # [in]
LEGEND_HEIGHT = 0.6  # [in]
MARKER_SHARE = 0.9  # of the usual size
ZERO_LINE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.6, "zorder": 0}


def figure_height(rows: int) -> float:
    """Of a figure of so many rows of panels [in]."""
    return min(LEGEND_HEIGHT + PANEL_HEIGHT * rows, style.TALLEST)


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
