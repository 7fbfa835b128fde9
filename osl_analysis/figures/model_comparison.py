"""Rival models of belt, transmission and rendered impedance: the variance of held-out torque that they do not
explain."""

from dataclasses import replace

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures.names import MARKERS, PLACE, of_place, place_name
from osl_analysis.figures.style import BLACK, DOUBLE_COLUMN, GREY, LOOKS, Look, panels, paper_style

TABLE_COLUMNS = ("experiment", "controller", "trial", "model", "VAF_held_out")
COLUMNS = (*PLACE, *TABLE_COLUMNS)
MODELS = {
    "belt": ("Belt", {"M1": "linear", "M2": "quadratic", "M3": "linear,\nhysteresis", "M4": "quadratic,\nhysteresis"}),
    "transmission": ("Transmission", {"M1": "$B_j$, $J_j$", "M2": "$B_j$, $J_j$,\nCoulomb"}),
    "impedance": (
        "Rendered impedance",
        {"M1": "Eq. 15", "M2": "Eq. 9", "M3": "Eq. 9,\nfriction", "M4": "Eq. 9,\nfriction,\n3 fitted"},
    ),
}
"""Names of each experiment and of its models, the draft's model first."""
REPEATS = Look(GREY, "o", 2.6, "Repeat")
SMALLEST = 1e-6
"""Smallest share [percent] of the variance on the axis. Smaller shares are drawn at this value."""


def points(scores: pl.DataFrame) -> pl.DataFrame:
    """One row per trial and model that was fitted to other data than those it predicts.

    Raises
    ------
    InputError
        There is none.
    """
    table = of_place(scores).select(COLUMNS).filter(pl.col("VAF_held_out").is_finite())
    if table.is_empty():
        raise InputError(
            "no model was held against data that it was not fitted to; add a second belt or transmission trial, or a "
            "second amplitude"
        )
    return table


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """A panel per experiment, the draft's model on the left: each line is a trial, each bar the geometric mean. Joints
    and sides stand side by side, each with a marker and a mean of its own.

    The axes are logarithmic in the share of the variance of held-out torque that a model does not account for.
    """
    several = len(table.select(PLACE).unique()) > 1
    present = [experiment for experiment in MODELS if experiment in table["experiment"]]
    shares = [len(MODELS[experiment][1]) for experiment in present]
    figure, axes = panels(DOUBLE_COLUMN, 2.6, columns=len(present), shares=shares)
    for ax, experiment in zip(axes, present, strict=True):
        name, models = MODELS[experiment]
        rows = table.filter(pl.col("experiment") == experiment)
        conditions = rows.partition_by(*PLACE, "controller", maintain_order=True)
        for k, trials in enumerate(conditions):
            shift = min(0.24, 0.72 / len(conditions)) * (k - (len(conditions) - 1) / 2)
            look = LOOKS.get(trials["controller"][0], REPEATS)
            if several:
                place = place_name(trials["joint"][0], trials["side"][0])
                looks = [*dict.fromkeys(rows.select(PLACE).rows())]
                marker = MARKERS[looks.index(trials.select(PLACE).row(0)) % len(MARKERS)]
                look = replace(look, label=f"{look.label}, {place}", marker=marker)
            draw_trials(ax, trials, list(models), shift, look)
        ax.set_title(name)
        ax.set_yscale("log")
        ax.set_xticks(range(len(models)), list(models.values()))
        ax.set_xlim(-0.5, len(models) - 0.5)
    axes[0].set_ylabel("Held-out variance\nnot accounted for (%)")
    handles = {label: h for ax in axes for h, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=4)
    return figure


def draw_trials(ax: Axes, rows: pl.DataFrame, models: list[str], shift: float, look: Look) -> None:
    """The trials of one condition, shifted by `shift` from the ticks of the models."""
    x = np.arange(len(models)) + shift
    wide = rows.pivot("model", index="trial", values="VAF_held_out").select(models).to_numpy()
    left = np.maximum(100 - wide, SMALLEST)
    ax.plot(x, left.T, "-", color=look.colour, alpha=0.35, linewidth=0.5)
    for i, trial in enumerate(left):
        label = look.label if i == 0 else None
        ax.plot(x, trial, look.marker, color=look.colour, markersize=look.size, mfc="none", mew=0.6, label=label)
    mean = np.exp(np.nanmean(np.log(left), axis=0))
    ax.hlines(mean, x - 0.11, x + 0.11, color=BLACK, linewidth=1.4, zorder=3, label="Geometric mean")
