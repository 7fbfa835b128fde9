"""Fig. 7: observed and desired frequency response of the joint."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from osl_analysis.errors import InputError
from osl_analysis.figures.style import (
    GREY,
    IS_DOUBTFUL,
    LIGHT_DOT,
    LOOKS,
    SINGLE_COLUMN,
    draw_spread,
    light_dots,
    panels,
    paper_style,
    spread_entries,
)

RESPONSE = (
    "controller", "K_d", "B_d", "frequency_hz", "magnitude", "magnitude_low", "magnitude_high", "magnitude_min",
    "magnitude_max", "phase_deg", "phase_low_deg", "phase_high_deg", "phase_min_deg", "phase_max_deg", "doubtful",
)  # fmt: skip
CURVES = ("condition", "frequency_hz", "magnitude", "phase_deg")
COLUMNS = (
    "condition", "frequency_hz", "magnitude", "magnitude_low", "magnitude_high", "magnitude_amplitudes_low",
    "magnitude_amplitudes_high", "phase_deg", "phase_low", "phase_high", "phase_amplitudes_low",
    "phase_amplitudes_high", "doubtful",
)  # fmt: skip
LINEAR_MODEL = ", linear model"
"""Text after the controller's name in the condition of a predicted curve."""
NICE = (1, 1.5, 2, 3, 4, 5, 6, 8)


def points(response: pl.DataFrame, curves: pl.DataFrame) -> pl.DataFrame:
    """Observed points of one desired impedance with 95 % intervals and the range over amplitudes, then the curves.

    `response` has the columns `RESPONSE`; `curves` has `CURVES`, its conditions being `desired` and, where there
    is a prediction, the controller's name + `LINEAR_MODEL`. Magnitudes in rad/(N*m), phases in degrees.

    Raises
    ------
    InputError
        The responses are not those of one K_d [N*m/rad] and B_d [N*m*s/rad].
    """
    impedances = response.select("K_d", "B_d").n_unique()
    if impedances != 1:
        raise InputError(
            f"frequency responses of {impedances} desired impedances; Fig. 7 draws one: select K_d and B_d"
        )
    observed = response.with_columns(
        condition=pl.col("controller"),
        magnitude_amplitudes_low=pl.col("magnitude_min"),
        magnitude_amplitudes_high=pl.col("magnitude_max"),
        phase_low=pl.col("phase_low_deg"),
        phase_high=pl.col("phase_high_deg"),
        phase_amplitudes_low=pl.col("phase_min_deg"),
        phase_amplitudes_high=pl.col("phase_max_deg"),
    ).select(COLUMNS)
    return pl.concat([observed, curves.select(CURVES)], how="diagonal_relaxed")


def only_curves(curves: pl.DataFrame) -> pl.DataFrame:
    """The numbers of the figure without an observed point."""
    absent = [name for name in COLUMNS if name not in CURVES]
    nothing = [pl.lit(None, pl.String if name == "doubtful" else pl.Float64).alias(name) for name in absent]
    return curves.with_columns(nothing).select(COLUMNS)


def response_curve(condition: str, frequency_hz: np.ndarray, Y: np.ndarray) -> pl.DataFrame:
    """An integral admittance Y [rad/(N*m)], complex, of shape (n,), as rows in the columns `CURVES`."""
    columns = {"frequency_hz": frequency_hz, "magnitude": np.abs(Y), "phase_deg": np.rad2deg(np.angle(Y))}
    return pl.DataFrame(columns).with_columns(condition=pl.lit(condition))


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) magnitude, (b) phase: markers observed, black line desired, thin lines predicted.

    A marker is the mean over amplitudes. A thin bar is their range, a thick bar the 95 % interval of noise. A light
    dot in the marker says that the phasor of at least one amplitude is doubtful.
    """
    figure, (magnitude, phase) = panels(SINGLE_COLUMN, 3.4, rows=2)
    for ax, column, bounds in ((magnitude, "magnitude", "magnitude"), (phase, "phase_deg", "phase")):
        for (condition,), rows in table.partition_by("condition", as_dict=True, maintain_order=True).items():
            draw_condition(ax, rows, str(condition), column, bounds)
    magnitude.set_yscale("log")
    label_magnitudes(magnitude)
    magnitude.set_ylabel("Magnitude\n" r"(10$^{-3}$ rad/(N·m))")
    phase.set_ylabel("Phase (deg)")
    phase.xaxis.set_major_locator(MaxNLocator(integer=True))
    phase.set_xlabel("Frequency (Hz)")
    handles, labels = magnitude.get_legend_handles_labels()
    if table["condition"].str.ends_with(LINEAR_MODEL).any():
        handles.append(Line2D([], [], color=GREY, linewidth=0.7, linestyle=(0, (4, 1.5))))
        labels.append("Linear model")
    bars, remark = spread_entries({magnitude: "magnitude", phase: "phase"}, table)
    handles += bars + [LIGHT_DOT] * len(table.filter(IS_DOUBTFUL).head(1))
    labels += [str(handle.get_label()) for handle in handles[len(labels) :]]
    figure.legend(handles, labels, loc="outside upper center", ncols=2, columnspacing=1.5)
    figure.supxlabel(remark, fontsize=8)
    figure.align_ylabels()
    return figure


def draw_condition(ax: Axes, rows: pl.DataFrame, condition: str, column: str, bounds: str) -> None:
    """One condition in one panel: a curve if it is desired or predicted, else markers with intervals."""
    look = LOOKS[condition.removesuffix(LINEAR_MODEL)]
    if condition.endswith(LINEAR_MODEL):
        ax.plot(rows["frequency_hz"], rows[column], color=look.colour, linewidth=0.7, linestyle=(0, (4, 1.5)))
    elif not look.marker:
        ax.plot(rows["frequency_hz"], rows[column], color=look.colour, label=look.label)
    else:
        draw_spread(ax, rows, "frequency_hz", bounds, look.colour)
        ax.plot(
            rows["frequency_hz"],
            rows[column],
            look.marker,
            color=look.colour,
            markersize=look.size,
            mew=0,
            label=look.label,
        )
        doubtful = rows.filter(IS_DOUBTFUL)
        light_dots(ax, doubtful["frequency_hz"], doubtful[column])


def label_magnitudes(ax: Axes) -> None:
    """Ticks at round thousandths within the limits of a logarithmic axis, lettered as thousandths."""
    low, high = ax.get_ylim()
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = [decade * nice for decade in decades for nice in NICE if low <= decade * nice <= high]
    ax.set_yticks(ticks, [f"{1e3 * tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_ylim(low, high)
