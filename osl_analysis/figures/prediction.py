"""What the components predict of the rendered impedance, against what was measured: nothing is fitted."""

import polars as pl
from matplotlib.figure import Figure

from osl_analysis.figures import columns_of, names, style

PANELS = {"K": r"stiffness $\hat{K}$ (N·m/rad)", "B": r"damping $\hat{B}$ (N·m·s/rad)", "torque": "torque, SD (N·m)"}
"""The quantities with their words on the axes."""


def prediction_points(prediction: pl.DataFrame) -> pl.DataFrame:
    table = names.completed(prediction, columns_of("prediction"), True).filter(pl.col("VAF").is_not_null())
    return table.with_columns(names.look_numbers(table["controller"]))


@style.paper_style()
def draw_prediction(table: pl.DataFrame) -> Figure:
    """Above, measured over predicted, with the identity; below, their difference with the prediction's interval."""
    parts, looks = names.placed_rows(table), names.looks_in(table)
    titles, rows = [name for name, _ in parts for _ in range(6)], 2 * len(parts)
    figure, axes = style.panels(style.DOUBLE_COLUMN, 0.4 + 1.9 * rows, rows=rows, columns=3, names=titles)
    for number, (_, part) in enumerate(parts):
        for k, (symbol, words) in enumerate(PANELS.items()):
            above, below = axes[6 * number + k], axes[6 * number + 3 + k]
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
        axes[6 * number + 3].set_ylabel("Measured − predicted")
    entries = {o.label: style.key(o.label, marker=o.marker, color=o.colour, markersize=o.size) for o in looks.values()}
    lines = {"Identity": (style.BLACK, 1.0, 0.6), "95 % interval of the prediction": (style.GREY, 0.5, style.THICK)}
    for label, (colour, alpha, width) in lines.items():
        entries[label] = style.key(label, color=colour, alpha=alpha, linewidth=width)
    style.legend_above(figure, entries | style.open_entry(table), 5)
    figure.align_ylabels()
    return figure


PREDICTION = style.Drawing(
    columns_of("prediction"), draw_prediction, prediction_points,
    needs=("trial", "controller", "VAF"), nothing="the components of no impedance trial were all measured",
)  # fmt: skip
