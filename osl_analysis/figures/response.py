"""Figure `response`: impedance of the joint over frequency, and what models miss."""

from collections.abc import Iterable
from string import ascii_lowercase
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from osl_analysis.figures import marks, names, style
from osl_analysis.stats.repeats import NORMAL_97_5
from osl_analysis.trial import Array

MOST_TRIALS = 12  # that one page shows; the table has all
MOST_ACROSS = 3  # trials side by side; four if there are more than nine
PANEL_HEIGHT = 0.84  # [in]
AROUND_TRIAL = 0.5  # height between the panels of two trials, with their labels [in]
LEGEND_HEIGHT = 0.45  # [in]
PANELS = ("Magnitude\n(N·m/rad)", "Phase (deg)", "Misfit, noise\n(N·m/rad)")

MEASURED: dict[str, Any] = {
    "color": style.BLACK, "marker": "o", "markersize": 2.2, "mew": 0.5, "linestyle": "",
}  # fmt: skip
BAR_WIDTH = 0.6  # of an interval [pt]
# noise and distortion of one realisation
LEVELS: dict[str, dict[str, Any]] = {
    "odd_level": {"color": style.ORANGE, "marker": "^", "mew": 0, "label": "Odd distortion"},
    "even_level": {"color": style.PURPLE, "marker": "s", "mew": 0, "label": "Even distortion"},
    "noise_level": {"color": style.GREY, "marker": "x", "mew": 0.5, "label": "Noise"},
}
# models of the impedance, by the ending of their columns
MODELS: dict[str, dict[str, Any]] = {
    "_eq15": {"color": style.MAGENTA, "label": r"Fit of $K + sB + s^2I$"},
    "_eq9": {"color": style.BLACK, "linestyle": (0, (4, 1.5)), "label": names.LINEAR_MODEL},
}


def draw(table: pl.DataFrame) -> style.PaperFigure:
    """Three panels of each trial: magnitude, phase, and what models miss beside noise and
    distortion."""
    trials = table.partition_by("trial", maintain_order=True)[:MOST_TRIALS]
    across = min(len(trials), MOST_ACROSS)
    if len(trials) > MOST_ACROSS**2:
        across = MOST_ACROSS + 1
    down = -(-len(trials) // across)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    height = LEGEND_HEIGHT + down * (len(PANELS) * PANEL_HEIGHT + AROUND_TRIAL)
    figure, axes = style.panels(width, height, len(PANELS) * down, across)
    # panels of one trial stand one above the other
    grid = np.array(axes, dtype=object).reshape(down, len(PANELS), across)
    of_trials = grid.swapaxes(1, 2).reshape(-1, len(PANELS))
    for number, (of_trial, rows) in enumerate(zip(of_trials, trials, strict=False)):
        draw_trial(of_trial, rows)
        letter = f"({ascii_lowercase[number]}) " if len(trials) > 1 else ""
        name = names.drawn_name(rows["trial"][0], 30)
        title = f"{letter}{name}\n{', '.join(names.condition(rows, units=False))}".strip()
        for ax, text in zip(of_trial, (title, "", ""), strict=True):
            ax.set_title(text, loc="left")
    for of_trial in of_trials[::across]:
        for ax, label in zip(of_trial, PANELS, strict=True):
            ax.set_ylabel(label)
    for unused in of_trials[len(trials) :].ravel():
        unused.remove()

    shown = of_trials[: len(trials)].ravel().tolist()
    interval = marks.key("95 % interval", marker="|", color=style.BLACK, mew=BAR_WIDTH)
    marks.legend_above(figure, [*marks.labelled(shown), interval, *marks.open_keys(table)])
    figure.align_ylabels()
    return figure


def draw_trial(of_trial: Iterable[Axes], rows: pl.DataFrame) -> None:
    """Measured magnitude [N·m/rad] and phase [deg] with 95 % intervals, models, and below what
    these miss, noise and distortion [N·m/rad]."""
    magnitude, phase, level = of_trial
    # standard deviation of the complex impedance, of noise and distortion, or of noise where
    # distortion is not known; one direction in the plane has half of its variance
    sd = pl.coalesce("total_sd", "noise_sd").fill_null(0.0)
    half = NORMAL_97_5 * sd / np.sqrt(2)
    halves = {"magnitude": half, "phase_deg": (half / pl.col("magnitude")).degrees()}
    fill = style.WHITE if marks.has_doubtful(rows) else style.BLACK
    frequency_hz = rows["frequency_hz"]
    for ax, (name, half_width) in zip((magnitude, phase), halves.items(), strict=True):
        ends = rows.select(low=pl.col(name) - half_width, high=pl.col(name) + half_width)
        ax.vlines(frequency_hz, *ends, color=style.BLACK, linewidth=BAR_WIDTH)
        ax.plot(frequency_hz, rows[name], mfc=fill, label="Measured Z", **MEASURED)
        ax.tick_params(labelbottom=False)
        ax.yaxis.set_major_locator(MaxNLocator(nbins=4))
    for ending, look in MODELS.items():
        if names.has_values(rows, f"magnitude{ending}"):
            magnitude.plot(frequency_hz, rows[f"magnitude{ending}"], linewidth=0.9, **look)
            phase.plot(frequency_hz, rows[f"phase_deg{ending}"], linewidth=0.9, **look)
            misfit = np.abs(impedance(rows, "") - impedance(rows, ending))
            level.plot(frequency_hz, misfit, linewidth=0.9, **look)

    noise = pl.col("noise_level")
    for name, look in LEVELS.items():
        # noise above 0, and distortion above the noise, on a logarithmic axis
        smallest = 0.0 if name == "noise_level" else noise.clip(0.0)
        seen = rows.filter(pl.col(name) > smallest)
        if not seen.is_empty():
            level.plot(seen["frequency_hz"], seen[name], markersize=2.5, linestyle="", **look)
    level.set_yscale("log")
    marks.label_log_axis(level.yaxis, 4)
    level.set_xlabel("Frequency (Hz)")
    for ax in of_trial:
        ax.set_xlim(0, 1.04 * float(frequency_hz.to_numpy().max()))
        ax.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))


def impedance(rows: pl.DataFrame, ending: str) -> Array:
    """Impedance [N·m/rad] (n,), complex, of the columns with this ending."""
    magnitude = rows[f"magnitude{ending}"].to_numpy()
    phase = np.deg2rad(rows[f"phase_deg{ending}"].to_numpy())
    return np.asarray(magnitude * np.exp(1j * phase))
