"""Fig. 7 and `response`: admittance and impedance of the joint over frequency."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.figures import style
from osl_analysis.figures.names import (
    NO_CONTROLLER,
    UNIT_SIGN,
    as_text,
    count_of,
    doubtful_said,
    drawn_name,
    look_numbers,
    looks_in,
    of_controller,
    of_place,
    place_name,
    placed_rows,
    wrapped_words,
)

FIG7_NEEDS = (
    "trial", "controller", "K_d", "B_d", "frequency_hz", "magnitude", "magnitude_low", "magnitude_high",
    "magnitude_min", "magnitude_max", "phase_deg", "phase_low_deg", "phase_high_deg", "phase_min_deg",
    "phase_max_deg", "doubtful",
)  # fmt: skip
FIG7_COLUMNS = (
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


def fig7_points(response: pl.DataFrame, curves: pl.DataFrame) -> pl.DataFrame:
    """Observed points of one desired impedance with 95 % intervals and the range over amplitudes, then the curves, with
    `CURVE_TYPES`: the desired response and, where there is a prediction, that of a controller's linear model.
    Magnitudes in rad/(N*m), phases in degrees. Raises InputError: the responses are of several desired impedances, K_d
    [N*m/rad] and B_d [N*m*s/rad]."""
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
    ).select(FIG7_COLUMNS)
    numbers = response.select("controller", "look").unique()
    return pl.concat(
        [observed, curves.join(numbers, on="controller", how="left", maintain_order="left")], how="diagonal_relaxed"
    ).select(FIG7_COLUMNS)


def response_curve(curve: str, controller: str | None, frequency_hz: np.ndarray, Y: np.ndarray) -> pl.DataFrame:
    """An integral admittance Y [rad/(N*m)], complex (n,), as rows."""
    columns = {"frequency_hz": frequency_hz, "magnitude": np.abs(Y), "phase_deg": np.rad2deg(np.angle(Y))}
    named = {"curve": curve, "controller": controller}
    return pl.DataFrame(columns).with_columns(pl.lit(v, pl.String).alias(name) for name, v in named.items())


def fig7_caption(table: pl.DataFrame) -> str:
    observed = table.filter(pl.col("curve") == OBSERVED)
    K_d, B_d = observed.select("K_d", "B_d").row(0)
    stated = [
        f"${name}$ = {value:g} {unit}"
        for name, value, unit in (("K_d", K_d, UNIT_SIGN["K"]), ("B_d", B_d, UNIT_SIGN["B"]))
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
def draw_fig7(table: pl.DataFrame) -> Figure:
    """(a) magnitude, (b) phase over the logarithm of frequency: markers observed, black line desired, broken lines
    predicted. A marker is the mean over amplitudes, open where the phasor of one at least is doubtful. A thin bar is
    their range, a thick bar the 95 % interval of noise. Several joints or sides stand side by side."""
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
        magnitude.set_yscale("log")
        style.label_log_axis(magnitude.yaxis, magnitude.get_ylim(), most=6, scale=1e3)
        style.label_phase_axis(phase)
        f = part["frequency_hz"].to_numpy()
        for ax in (magnitude, phase):
            ax.set_xscale("log")
            limits = style.with_margins(float(f.min()), float(f.max()))
            style.label_log_axis(ax.xaxis, limits, most=8 if len(parts) == 1 else 5)
        magnitude.tick_params(labelbottom=False)
        phase.set_xlabel("Frequency (Hz)")
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


def draw_controller(ax: Axes, rows: pl.DataFrame, look: style.Look, column: str, bounds: str) -> None:
    observed, curve = (rows.filter(pl.col("curve") == kind) for kind in (OBSERVED, LINEAR_MODEL))
    if len(observed):
        style.draw_spread(ax, observed, "frequency_hz", bounds, look.colour)
        shape: dict[str, Any] = {"marker": look.marker, "linewidths": 0.8, "label": look.label, "zorder": 2.5}
        style.draw_fits(ax, observed, observed["frequency_hz"], observed[column], look.colour, look.size, **shape)
    if len(curve):
        x, y = curve["frequency_hz"], curve[column]
        ax.plot(x, y, color=look.colour, linewidth=0.9, linestyle=look.dash, label=f"{look.label}, {LINEAR_MODEL}")


RESPONSE_COLUMNS = (
    "trials", "joint", "side", "controller", "K_d", "B_d", "method", "realisations", "frequency_hz", "magnitude",
    "phase_deg", "magnitude_eq15", "phase_deg_eq15", "magnitude_eq9", "phase_deg_eq9", "noise_level", "odd_level",
    "even_level", "total_level", "noise_sd", "total_sd", "doubtful",
)  # fmt: skip
WORD_COLUMNS = ("trials", "joint", "side", "controller", "method", "doubtful")
MOST_CONDITIONS, MOST_ACROSS = 12, 3
"""Conditions that one page shows at most (the table has all), and those side by side; one more if they are so many."""
SIZE = 2.2  # size [pt] of the markers
LONGEST_TRIAL, SHORTER = 28, 18
"""Letters of a trial's name above its panels, with up to `MOST_ACROSS` conditions side by side, and with more."""
AXIS = 0.42  # width [in] beside a panel that its title cannot take
LEVEL_LOOKS = {
    "odd_level": (style.ORANGE, "^", "Odd distortion"),
    "even_level": (style.PURPLE, "s", "Even distortion"),
    "noise_level": (style.GREY, "x", "Noise"),
}
"""Colour, marker and name of each level."""
STRUCTURE_LOOKS = {
    "eq15": (style.MAGENTA, "-", r"Eq. 15: $K + sB + s^2I$"),
    "eq9": (style.BLACK, (0, (4, 1.5)), "Eq. 9: drivetrain"),
}


def condition_points(single: pl.DataFrame, pooled: pl.DataFrame) -> pl.DataFrame:
    """The rows of every condition: those of `response_pooled.csv`, then of each trial that is in none of them."""
    in_pool = {name for names in pooled["trials"].unique() for name in str(names).split(", ")}
    alone = single.filter(~pl.col("trial").is_in(in_pool)).with_columns(trials=pl.col("trial"))
    rows = pl.concat([pooled, alone], how="diagonal_relaxed")
    absent = {
        name: pl.String if name in WORD_COLUMNS else pl.Float64 for name in RESPONSE_COLUMNS if name not in rows.columns
    }
    return rows.with_columns(pl.lit(None, kind).alias(name) for name, kind in absent.items()).select(RESPONSE_COLUMNS)


def condition_words(row: Mapping[str, Any], longest: int = LONGEST_TRIAL) -> list[str]:
    """Joint, controller, desired impedance, trials by the first one's name, and realisations of a condition."""
    words = [place_name(row["joint"], row["side"]), drawn_name(row["controller"] or "")]
    words.append(", ".join(f"${name}$ = {row[name]:g}" for name in ("K_d", "B_d") if row[name] is not None))
    trials = str(row["trials"]).split(", ")
    more = f" and {len(trials) - 1} more" if len(trials) > 1 else ""
    words.append(drawn_name(trials[0], longest) + more)
    if row["method"] != "local polynomial":
        words.append(count_of(int(row["realisations"]), "realisation"))
    return [*filter(None, words)]


def response_caption(table: pl.DataFrame) -> str:
    conditions = table.partition_by("trials", maintain_order=True)
    said = [
        f"Impedance Z, torque over angle, over frequency, of {count_of(len(conditions), 'condition')}, $K_d$ in "
        f"{UNIT_SIGN['K']} and $B_d$ in {UNIT_SIGN['B']}. Each has three panels: magnitude, phase, and below how far "
        "the structures fitted to it (lines) are from what is measured, beside noise and distortion of one realisation "
        "(markers; distortion below the noise is not drawn). Bars are 95 % intervals: of noise and distortion where "
        "several realisations show both, otherwise of noise. Where the motion does not repeat itself, by the local "
        "polynomial method, distortion is part of the noise."
    ]
    if len(conditions) > MOST_CONDITIONS:
        said.append(f"The first {MOST_CONDITIONS} conditions are shown; response.csv has all of them.")
    for short, name in (("eq15", "the second-order system of Eq. 15"), ("eq9", "the drivetrain of Eq. 9")):
        medians = [float(np.median(missed)) for rows in conditions if len(missed := percent_missed(rows, short))]
        if medians:
            to = f" to {max(medians):.2g}" if len(medians) > 1 else ""
            said.append(f"Half of the frequencies are within {min(medians):.2g}{to} % of {name}.")
    fits = table.unique("trials", maintain_order=True).rename({"trials": "trial"})
    return " ".join([*said, doubtful_said(fits, "drawn with open markers", fit="condition")])


def percent_missed(rows: pl.DataFrame, short: str) -> NDArray[np.float64]:
    """Distance [percent of the measured impedance] of a structure where it is known, (m,)."""
    measured = complex_number(rows, "")
    missed = 100 * np.abs(measured - complex_number(rows, f"_{short}")) / np.abs(measured)
    return np.asarray(missed[np.isfinite(missed)])


@style.paper_style()
def draw_response(table: pl.DataFrame) -> Figure:
    """Per condition magnitude, phase, and the structures' deviation beside distortion above the noise, and noise."""
    conditions = table.partition_by("trials", maintain_order=True)
    shown = conditions[:MOST_CONDITIONS]
    down, across = grid_of(len(shown))
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    # of each condition three panels with their axes, and the lines above them
    figure = Figure(figsize=(width, 0.5 + down * (3 * 0.84 + 0.3)), layout="constrained")
    axes = figure.subplots(3 * down, across, squeeze=False)
    entries: dict[str, Line2D] = {}
    for number, rows in enumerate(shown):
        row, column = divmod(number, across)
        parts = list(axes[3 * row : 3 * row + 3, column])
        entries |= draw_condition(parts, rows)
        words = condition_words(rows.row(0, named=True), LONGEST_TRIAL if across <= MOST_ACROSS else SHORTER)
        words[0] = f"({chr(ord('a') + number)}) " * (len(shown) > 1) + words[0]
        parts[0].set_title(wrapped_words(words, width / across - AXIS), loc="left")
        if column == 0:
            for ax, label in zip(
                parts, ("Magnitude\n(N·m/rad)", "Phase (deg)", "Deviation,\nlevel (N·m/rad)"), strict=True
            ):
                ax.set_ylabel(label)
    for unused in axes[-3:, len(shown) - across * (down - 1) :].ravel():
        unused.remove()
    columns = style.legend_columns(list(entries), width, most=6)
    figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=columns, columnspacing=1.2)
    figure.align_ylabels()
    if len(conditions) > MOST_CONDITIONS:
        figure.supxlabel(
            f"Further {count_of(len(conditions) - MOST_CONDITIONS, 'condition')} in response.csv", fontsize=8
        )
    return figure


def grid_of(conditions: int) -> tuple[int, int]:
    """Conditions one below the other and side by side."""
    across = min(conditions, MOST_ACROSS + (conditions > MOST_ACROSS**2))
    return -(-conditions // across), across


def draw_condition(parts: Sequence[Axes], rows: pl.DataFrame) -> dict[str, Line2D]:
    """Three panels of one condition; the entries of the legend, here and below."""
    magnitude, phase, beside = parts
    entries = draw_curves(magnitude, rows, "magnitude") | draw_curves(phase, rows, "phase_deg")
    entries |= draw_levels(beside, rows)
    beside.set_title(why_no_distortion(rows), loc="left")
    beside.set_xlabel("Frequency (Hz)")
    for ax in parts:
        ax.set_xlim(0, 1.04 * float(np.max(rows["frequency_hz"].to_numpy())))
        ax.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    for ax in (magnitude, phase):
        ax.tick_params(labelbottom=False)
        ax.yaxis.set_major_locator(MaxNLocator(nbins=4))
    return entries


def why_no_distortion(rows: pl.DataFrame) -> str:
    levels = [rows[name].cast(pl.Float64).to_numpy() for name in ("odd_level", "even_level")]
    if any(drawn_level(rows, level).any() for level in levels):
        return ""
    if any(np.isfinite(level).any() for level in levels):
        return "Distortion below noise"
    return "Distortion is in the noise" if rows["method"][0] == "local polynomial" else "No line shows distortion"


def drawn_level(rows: pl.DataFrame, level: NDArray[np.float64]) -> NDArray[np.bool_]:
    noise = rows["noise_level"].cast(pl.Float64).to_numpy()
    return np.asarray(np.isfinite(level) & (level > 0) & (level > noise))


def draw_curves(ax: Axes, rows: pl.DataFrame, quantity: str) -> dict[str, Line2D]:
    f = rows["frequency_hz"]
    half = intervals(rows, quantity)
    ax.vlines(f, rows[quantity] - half, rows[quantity] + half, color=style.BLACK, linewidth=0.6)
    doubtful = len(rows.filter(style.DRAWN_OPEN)) > 0
    fill = style.WHITE if doubtful else style.BLACK
    ax.plot(f, rows[quantity], "o", color=style.BLACK, markersize=SIZE, mew=0.5, mfc=fill)
    entries = {"Measured Z": Line2D([], [], linestyle="", marker="o", color=style.BLACK, markersize=SIZE)}
    if doubtful:
        entries[str(style.OPEN_MARKER.get_label())] = style.OPEN_MARKER
    for short, (colour, dash, label) in STRUCTURE_LOOKS.items():
        curve = rows[f"{quantity}_{short}"].cast(pl.Float64)
        if curve.count():
            (line,) = ax.plot(f, curve, color=colour, linestyle=dash, linewidth=0.9)
            entries[label] = line
    return entries


def intervals(rows: pl.DataFrame, quantity: str) -> pl.Series:
    """Half-widths of the 95 % intervals, of noise and distortion, or of noise where these are not known."""
    sd = pl.coalesce(pl.col("total_sd").cast(pl.Float64), pl.col("noise_sd").cast(pl.Float64)).fill_null(0.0)
    half = 1.96 * sd / np.sqrt(2)  # of one direction in the complex plane
    return rows.select(half if quantity == "magnitude" else half / pl.col("magnitude") * (180 / np.pi)).to_series()


def draw_levels(ax: Axes, rows: pl.DataFrame) -> dict[str, Line2D]:
    f, entries = rows["frequency_hz"].to_numpy(), {}
    measured = complex_number(rows, "")
    for short, (colour, dash, _) in STRUCTURE_LOOKS.items():
        if rows[f"magnitude_{short}"].count():
            ax.plot(
                f, np.abs(measured - complex_number(rows, f"_{short}")), color=colour, linestyle=dash, linewidth=0.9
            )
    for name, (colour, marker, label) in LEVEL_LOOKS.items():
        level = rows[name].cast(pl.Float64).to_numpy()
        seen = level > 0 if name == "noise_level" else drawn_level(rows, level)
        if seen.any():
            (line,) = ax.plot(
                f[seen], level[seen], marker, color=colour, markersize=SIZE + 0.3, mew=0.5 * (marker == "x")
            )
            entries[label] = line
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    return entries


def complex_number(rows: pl.DataFrame, ending: str) -> NDArray[np.complex128]:
    size, phase = (rows[f"{name}{ending}"].cast(pl.Float64).to_numpy() for name in ("magnitude", "phase_deg"))
    return np.asarray(size * np.exp(1j * np.deg2rad(phase)))


FIG7 = style.Drawing(FIG7_COLUMNS, draw_fig7, fig7_caption, fig7_points, FIG7_NEEDS)
RESPONSE = style.Drawing(
    RESPONSE_COLUMNS,
    draw_response,
    response_caption,
    condition_points,
    nothing="every impedance trial follows the stepped sine; its frequency response is in phasors.csv and Fig. 7",
)
