"""Fig. 7: observed and desired frequency response of the joint."""

from collections.abc import Mapping

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from osl_analysis.errors import InputError
from osl_analysis.figures.names import look_numbers, looks_in, of_place, placed_rows
from osl_analysis.figures.style import (
    BLACK,
    DOUBLE_COLUMN,
    GREY,
    IS_DOUBTFUL,
    LIGHT_DOT,
    SINGLE_COLUMN,
    Look,
    draw_spread,
    legend_columns,
    light_dots,
    panels,
    paper_style,
    spread_entries,
)

RESPONSE = (
    "trial", "controller", "K_d", "B_d", "frequency_hz", "magnitude", "magnitude_low", "magnitude_high",
    "magnitude_min", "magnitude_max", "phase_deg", "phase_low_deg", "phase_high_deg", "phase_min_deg",
    "phase_max_deg", "doubtful",
)  # fmt: skip
COLUMNS = (
    "joint", "side", "curve", "controller", "look", "trial", "K_d", "B_d", "frequency_hz", "magnitude",
    "magnitude_low", "magnitude_high", "magnitude_amplitudes_low", "magnitude_amplitudes_high", "phase_deg",
    "phase_low", "phase_high", "phase_amplitudes_low", "phase_amplitudes_high", "doubtful",
)  # fmt: skip
CURVE_TYPES = {
    "joint": pl.String, "side": pl.String, "curve": pl.String, "controller": pl.String, "frequency_hz": pl.Float64,
    "magnitude": pl.Float64, "phase_deg": pl.Float64,
}  # fmt: skip
"""Columns, with their types, of the curves that `points` takes."""
OBSERVED, DESIRED, LINEAR_MODEL = "observed", "desired", "linear model"
"""Kinds of `curve`."""
NICE = ((1, 1.5, 2, 3, 4, 5, 6, 8), tuple(np.arange(10, 100, 2) / 10), tuple(np.arange(100, 1000) / 100))
"""Steps of the ticks of a decade; the first ones of which two lie within the axis are taken."""


def points(response: pl.DataFrame, curves: pl.DataFrame) -> pl.DataFrame:
    """Observed points of one desired impedance with 95 % intervals and the range over amplitudes, then the curves.

    `response` has the columns `RESPONSE` and, where the campaign has them, `joint`, `side` and `look`; `curves` has
    `CURVE_TYPES`: the desired response and, where there is a prediction, that of the linear model of a controller.
    Magnitudes in rad/(N*m), phases in degrees.

    Raises
    ------
    InputError
        The responses are of several desired impedances, K_d [N*m/rad] and B_d [N*m*s/rad].
    """
    impedances = response.select("K_d", "B_d").n_unique()
    if impedances > 1:
        raise InputError(
            f"frequency responses of {impedances} desired impedances; Fig. 7 draws one: select K_d and B_d"
        )
    response = of_place(response)
    if "look" not in response.columns:
        response = response.with_columns(look_numbers(response["controller"]))
    observed = response.with_columns(
        curve=pl.lit(OBSERVED),
        magnitude_amplitudes_low=pl.col("magnitude_min"),
        magnitude_amplitudes_high=pl.col("magnitude_max"),
        phase_low=pl.col("phase_low_deg"),
        phase_high=pl.col("phase_high_deg"),
        phase_amplitudes_low=pl.col("phase_min_deg"),
        phase_amplitudes_high=pl.col("phase_max_deg"),
    ).select(COLUMNS)
    numbers = response.select("controller", "look").unique()
    return pl.concat(
        [observed, curves.join(numbers, on="controller", how="left", maintain_order="left")], how="diagonal_relaxed"
    ).select(COLUMNS)


def response_curve(curve: str, controller: str | None, frequency_hz: np.ndarray, Y: np.ndarray) -> pl.DataFrame:
    """An integral admittance Y [rad/(N*m)], complex, of shape (n,), as rows; `curve` is `DESIRED` or `LINEAR_MODEL`."""
    columns = {"frequency_hz": frequency_hz, "magnitude": np.abs(Y), "phase_deg": np.rad2deg(np.angle(Y))}
    named = {"curve": curve, "controller": controller}
    return pl.DataFrame(columns).with_columns(pl.lit(v, pl.String).alias(name) for name, v in named.items())


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) magnitude, (b) phase: markers observed, black line desired, thin lines predicted.

    A marker is the mean over amplitudes. A thin bar is their range, a thick bar the 95 % interval of noise. A light
    dot in the marker says that the phasor of at least one amplitude is doubtful. Several joints or sides stand side by
    side.
    """
    parts, looks = placed_rows(table), looks_in(table.filter(pl.col("curve") != DESIRED))
    names = [name for name, _ in parts]
    width = SINGLE_COLUMN if len(parts) == 1 else DOUBLE_COLUMN
    figure, axes = panels(width, 3.4, rows=2, columns=len(parts), names=names + [""] * len(parts))
    shown: dict[Axes, str] = {}
    for number, (_, part) in enumerate(parts):
        magnitude, phase = axes[number], axes[number + len(parts)]
        magnitude.sharex(phase)
        shown |= {magnitude: "magnitude", phase: "phase"}
        for ax, column, bounds in ((magnitude, "magnitude", "magnitude"), (phase, "phase_deg", "phase")):
            for controller, look in looks.items():
                draw_controller(
                    ax, part.filter(pl.col("controller").eq_missing(pl.lit(controller))), look, column, bounds
                )
            curve = part.filter(pl.col("curve") == DESIRED)
            if len(curve):
                ax.plot(curve["frequency_hz"], curve[column], color=BLACK, label="Desired", zorder=1)
        magnitude.set_yscale("log")
        label_magnitudes(magnitude)
        magnitude.tick_params(labelbottom=False)
        phase.xaxis.set_major_locator(MaxNLocator(integer=True))
        phase.set_xlabel("Frequency (Hz)")
    axes[0].set_ylabel("Magnitude\n" r"(10$^{-3}$ rad/(N·m))")
    axes[len(parts)].set_ylabel("Phase (deg)")
    legend(figure, table, shown)
    figure.align_ylabels()
    return figure


def legend(figure: Figure, table: pl.DataFrame, shown: Mapping[Axes, str]) -> None:
    """Legend above all panels, and the remark below; `shown` are the panels with the quantity of each."""
    named = {label: handle for ax in shown for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    handles = list(named.values())
    if (table["curve"] == LINEAR_MODEL).any():
        handles.append(Line2D([], [], color=GREY, linewidth=0.7, linestyle=(0, (4, 1.5)), label="Linear model"))
    bars, remark = spread_entries(shown, table)
    handles += bars + [LIGHT_DOT] * len(table.filter(IS_DOUBTFUL).head(1))
    labels = [*named, *(str(handle.get_label()) for handle in handles[len(named) :])]
    columns = legend_columns(labels, figure.get_figwidth(), most=2 if len(shown) == 2 else 4)
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, columnspacing=1.5)
    chosen = said_of_choice(table)
    figure.supxlabel("\n".join(filter(None, [remark, chosen])), fontsize=8)


def said_of_choice(table: pl.DataFrame) -> str:
    """Which desired impedance the figure shows where it was chosen, not asked for."""
    if "chosen" not in table.columns or not table["chosen"].count():
        return ""
    K_d, B_d = table.filter(pl.col("curve") == OBSERVED).select("K_d", "B_d").row(0)
    stated = [f"${name}$ = {value:g}" for name, value in (("K_d", K_d), ("B_d", B_d)) if value is not None]
    return f"{', '.join(stated) or 'No $K_d$ and $B_d$ stated'}: {table['chosen'].drop_nulls()[0]}"


def draw_controller(ax: Axes, rows: pl.DataFrame, look: Look, column: str, bounds: str) -> None:
    """One controller in one panel: markers with intervals, and the curve of the linear model where there is one."""
    curve = rows.filter(pl.col("curve") == LINEAR_MODEL)
    ax.plot(curve["frequency_hz"], curve[column], color=look.colour, linewidth=0.7, linestyle=(0, (4, 1.5)))
    observed = rows.filter(pl.col("curve") == OBSERVED)
    if observed.is_empty():
        return
    draw_spread(ax, observed, "frequency_hz", bounds, look.colour)
    x, y = observed["frequency_hz"], observed[column]
    ax.plot(x, y, look.marker, color=look.colour, markersize=look.size, mew=0, label=look.label)
    doubtful = observed.filter(IS_DOUBTFUL)
    light_dots(ax, doubtful["frequency_hz"], doubtful[column])


def label_magnitudes(ax: Axes) -> None:
    """Ticks at round thousandths within the limits of a logarithmic axis, lettered as thousandths."""
    low, high = ax.get_ylim()
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    found = ([decade * nice for decade in decades for nice in steps if low <= decade * nice <= high] for steps in NICE)
    ticks = next((ticks for ticks in found if len(ticks) > 1), [low, high])
    ax.set_yticks(ticks, [f"{1e3 * tick:.4g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_ylim(low, high)
