"""Fig. 7: observed and desired frequency response of the joint."""

from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import style
from osl_analysis.figures.names import (
    NO_CONTROLLER,
    UNIT_OF,
    as_text,
    count_of,
    doubtful_said,
    look_numbers,
    looks_in,
    of_controller,
    of_place,
    placed_rows,
)

RESPONSE_COLUMNS = (
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
OBSERVED, DESIRED, LINEAR_MODEL = "observed", "desired", "linear model"  # kinds of `curve`


def points(response: pl.DataFrame, curves: pl.DataFrame) -> pl.DataFrame:
    """Observed points of one desired impedance with 95 % intervals and the range over amplitudes, then the curves.

    `response` has the columns `RESPONSE_COLUMNS` and, where the campaign has them, `joint`, `side` and `look`; `curves`
    has `CURVE_TYPES`: the desired response and, where there is a prediction, that of the linear model of a controller.
    Magnitudes in rad/(N*m), phases in degrees.

    Raises InputError: the responses are of several desired impedances, K_d [N*m/rad] and B_d [N*m*s/rad].
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
    """An integral admittance Y [rad/(N*m)], complex (n,), as rows."""
    columns = {"frequency_hz": frequency_hz, "magnitude": np.abs(Y), "phase_deg": np.rad2deg(np.angle(Y))}
    named = {"curve": curve, "controller": controller}
    return pl.DataFrame(columns).with_columns(pl.lit(v, pl.String).alias(name) for name, v in named.items())


def caption(table: pl.DataFrame) -> str:
    observed = table.filter(pl.col("curve") == OBSERVED)
    K_d, B_d = observed.select("K_d", "B_d").row(0)
    stated = [
        f"${name}$ = {value:g} {unit}"
        for name, value, unit in (("K_d", K_d, UNIT_OF["K"]), ("B_d", B_d, UNIT_OF["B"]))
        if value is not None
    ]
    chosen = observed["chosen"].drop_nulls() if "chosen" in observed.columns else observed["trial"].clear()
    why = f" ({as_text(chosen[0])})" if len(chosen) else ""
    said = [
        f"Frequency response of the joint, angle over torque: {', '.join(stated) or 'no impedance is stated'}{why}. "
        "Above its magnitude, below its phase. Markers are measured phasors, averaged over amplitudes."
    ]
    if observed["magnitude_amplitudes_low"].count():
        said.append("Thin bars are the range over amplitudes.")
    if observed["magnitude_low"].count():
        relative = (observed["magnitude_high"] - observed["magnitude_low"]) / 2 / observed["magnitude"]
        of_phase = (observed["phase_high"] - observed["phase_low"]) / 2
        widest = [float(half.to_numpy()[half.is_not_null().to_numpy()].max()) for half in (100 * relative, of_phase)]
        said.append(f"Thick bars are 95 % intervals of noise, at most ± {widest[0]:.2g} % and ± {widest[1]:.2g} deg.")
    if (table["curve"] == DESIRED).any():
        said.append("Black: desired impedance (Eq. 11).")
    if (table["curve"] == LINEAR_MODEL).any():
        said.append("Broken lines: the drivetrain with the controller's gains, without friction (Eq. 9).")
    trials = observed.group_by("controller", maintain_order=True).agg(pl.col("trial").n_unique())
    named = (f"{as_text(name or NO_CONTROLLER.label)} {count_of(n, 'trial')}" for name, n in trials.iter_rows())
    said.append(f"Measured: {', '.join(named)}.")
    return " ".join([*said, doubtful_said(observed, "drawn open", fit="phasor")])


@style.paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """(a) magnitude, (b) phase over the logarithm of frequency: markers observed, black line desired, broken lines
    predicted, each controller's with a line style of its own.

    A marker is the mean over amplitudes. A thin bar is their range, a thick bar the 95 % interval of noise. The phasor
    of at least one amplitude is doubtful where the marker is open. Several joints or sides stand side by side.
    """
    parts, looks = placed_rows(table), looks_in(table.filter(pl.col("curve") != DESIRED))
    names = [name for name, _ in parts]
    width = style.SINGLE_COLUMN if len(parts) == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, 3.7, rows=2, columns=len(parts), names=names + [""] * len(parts))
    shown: dict[Axes, str] = {}
    for number, (_, part) in enumerate(parts):
        magnitude, phase = axes[number], axes[number + len(parts)]
        shown |= {magnitude: "magnitude", phase: "phase"}
        for ax, column, bounds in ((magnitude, "magnitude", "magnitude"), (phase, "phase_deg", "phase")):
            for controller, look in looks.items():
                draw_controller(ax, of_controller(part, controller), look, column, bounds)
            curve = part.filter(pl.col("curve") == DESIRED)
            if len(curve):
                wanted: dict[str, Any] = {"color": style.BLACK, "label": style.LOOKS["desired"].label}
                ax.plot(curve["frequency_hz"], curve[column], zorder=1, **wanted)
        label_axes(magnitude, phase, part["frequency_hz"].to_numpy(), most=8 if len(parts) == 1 else 5)
    axes[0].set_ylabel("Magnitude\n" r"(10$^{-3}$ rad/(N·m))")
    axes[len(parts)].set_ylabel("Phase (deg)")
    named = style.legend_entries(shown)
    handles = [*named.values(), *style.spread_entries(shown, table)]
    handles += [style.OPEN_MARKER] * len(table.filter(style.DRAWN_OPEN).head(1))
    labels = [*named, *(str(handle.get_label()) for handle in handles[len(named) :])]
    columns = style.legend_columns(labels, figure.get_figwidth(), most=2 if len(shown) == 2 else 4)
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, columnspacing=1.5)
    figure.align_ylabels()
    return figure


def label_axes(magnitude: Axes, phase: Axes, frequency_hz: np.ndarray, most: int) -> None:
    magnitude.set_yscale("log")
    style.label_log_axis(magnitude.yaxis, magnitude.get_ylim(), most=6, scale=1e3)
    style.label_phase_axis(phase)
    limits = style.with_margins(float(frequency_hz.min()), float(frequency_hz.max()))
    for ax in (magnitude, phase):
        ax.set_xscale("log")
        style.label_log_axis(ax.xaxis, limits, most)
    magnitude.tick_params(labelbottom=False)
    phase.set_xlabel("Frequency (Hz)")


def draw_controller(ax: Axes, rows: pl.DataFrame, look: style.Look, column: str, bounds: str) -> None:
    observed, curve = (rows.filter(pl.col("curve") == kind) for kind in (OBSERVED, LINEAR_MODEL))
    if len(observed):
        style.draw_spread(ax, observed, "frequency_hz", bounds, look.colour)
        shape: dict[str, Any] = {"marker": look.marker, "linewidths": 0.8, "label": look.label, "zorder": 2.5}
        style.draw_fits(ax, observed, observed["frequency_hz"], observed[column], look.colour, look.size, **shape)
    if len(curve):
        x, y = curve["frequency_hz"], curve[column]
        ax.plot(x, y, color=look.colour, linewidth=0.9, linestyle=look.dash, label=f"{look.label}, {LINEAR_MODEL}")
