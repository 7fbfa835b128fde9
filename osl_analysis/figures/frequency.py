"""Fig. 7 and `response`: admittance and impedance of the joint over frequency."""

from collections.abc import Sequence
from string import ascii_lowercase
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from osl_analysis.errors import InputError
from osl_analysis.figures import columns_of, names, style
from osl_analysis.trial import Array

FIG7_COLUMNS = [name for name in columns_of("fig7") if name != "chosen"]
OBSERVED, DESIRED, LINEAR_MODEL = "observed", "desired", "linear model"  # kinds of `curve`


def fig7_points(response: pl.DataFrame, curves: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """Observed points of one desired impedance with 95 % intervals and the range over amplitudes,
    then the curves of `response_curve`: the desired response and, where there is a prediction, that
    of a controller's linear model."""
    impedances = response.select("K_d", "B_d").n_unique()
    if impedances > 1:
        raise InputError(
            f"frequency responses of {impedances} desired impedances; Fig. 7 draws one: select"
            " K_d, B_d"
        )
    if "look" not in response.columns:
        response = response.with_columns(names.look_numbers(response["controller"]))
    numbers = response.select("controller", "look").unique()
    observed = response.with_columns(curve=pl.lit(OBSERVED))
    looked = (
        curve.join(numbers, on="controller", how="left", maintain_order="left") for curve in curves
    )
    every = [names.completed(observed, FIG7_COLUMNS, True), *looked]
    return pl.concat(every, how="diagonal_relaxed").select(FIG7_COLUMNS)


def response_curve(
    curve: str,
    controller: str | None,
    frequency_hz: np.ndarray,
    Y: np.ndarray,
    place: Sequence[str | None],
) -> pl.DataFrame:
    """An integral admittance Y [rad/(N*m)], complex (n,), of a joint and side, as rows."""
    named = {"joint": place[0], "side": place[1], "curve": curve, "controller": controller}
    numbers = {
        "frequency_hz": frequency_hz,
        "magnitude": np.abs(Y),
        "phase_deg": np.rad2deg(np.angle(Y)),
    }
    return pl.DataFrame(numbers).select(
        *(pl.lit(v, pl.String).alias(name) for name, v in named.items()), *numbers
    )


def shown_impedance(table: pl.DataFrame) -> str:
    """The desired impedance of Fig. 7, and why this one."""
    observed = names.completed(table.filter(pl.col("curve") == OBSERVED), ["chosen"])
    K_d, B_d, chosen = observed.select("K_d", "B_d", "chosen").row(0)
    stated = [
        f"${name}$ = {value:g} {unit}"
        for name, value, unit in (("K_d", K_d, "N·m/rad"), ("B_d", B_d, "N·m·s/rad"))
        if value is not None
    ]
    why = f" ({names.as_text(chosen)})" if chosen is not None else ""
    of = f": {', '.join(stated)}{why}" if stated else ""
    return f"Frequency response of the joint, angle over torque{of}."


@style.drawing(
    FIG7_COLUMNS,
    fig7_points,
    needs=[name for name in FIG7_COLUMNS if name not in ("joint", "side", "curve", "look")],
    about=shown_impedance,
    nothing="no trial follows a stepped sine, whose phasors it shows",
)
def draw_fig7(table: pl.DataFrame) -> Figure:
    """(a) magnitude, (b) phase over the logarithm of frequency; several joints or sides stand side
    by side. A marker is open where the phasor of one amplitude at least is doubtful."""
    parts, looks = (
        names.placed_rows(table),
        names.looks_in(table.filter(pl.col("curve") != DESIRED)),
    )
    across = len(parts)
    titles = [
        f"{name}: {word}" if across > 1 else word
        for word in ("Magnitude", "Phase")
        for name, _ in parts
    ]
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(width, 3.7, rows=2, columns=across, names=titles)
    for magnitude, phase, (_, part) in zip(axes[:across], axes[across:], parts, strict=True):
        kinds = {
            kind: part.filter(pl.col("curve") == kind) for kind in (OBSERVED, DESIRED, LINEAR_MODEL)
        }
        for ax, column in ((magnitude, "magnitude"), (phase, "phase_deg")):
            for controller, look in looks.items():
                observed, model = (
                    names.of_controller(kinds[kind], controller)
                    for kind in (OBSERVED, LINEAR_MODEL)
                )
                if len(observed):
                    style.draw_estimates(ax, observed, "frequency_hz", column, look, zorder=2.5)
                if len(model):
                    line: dict[str, Any] = {
                        "color": look.colour,
                        "linewidth": 0.9,
                        "linestyle": look.dash,
                    }
                    label = f"{look.label}, {LINEAR_MODEL}"
                    ax.plot(model["frequency_hz"], model[column], label=label, **line)
            curve = kinds[DESIRED]
            if len(curve):
                ax.plot(
                    curve["frequency_hz"],
                    curve[column],
                    zorder=1,
                    color=style.BLACK,
                    label="Desired",
                )
            style.label_frequency_axis(ax, part["frequency_hz"], most=8 if across == 1 else 5)
        magnitude.set_yscale("log")
        style.label_log_axis(magnitude.yaxis, magnitude.get_ylim(), most=6, scale=1e3)
        style.label_phase_axis(phase)
        magnitude.tick_params(labelbottom=False)
        phase.set_xlabel("Frequency (Hz)")
    axes[0].set_ylabel("Magnitude\n" r"(10$^{-3}$ rad/(N·m))")
    axes[across].set_ylabel("Phase (deg)")
    entries = style.legend_entries(axes)
    ranges = (
        pl.col(f"{y}_amplitudes_high") > pl.col(f"{y}_amplitudes_low")
        for y in ("magnitude", "phase_deg")
    )
    if table.select(pl.any_horizontal(*ranges).any()).item():
        bar = {"marker": "|", "color": style.BLACK, "markersize": 8, "mew": style.THIN}
        entries["Range over amplitudes"] = style.key("", **bar)
    style.legend_above(
        figure, entries | style.open_entry(table), 2 if across == 1 else 4, columnspacing=1.5
    )
    figure.align_ylabels()
    return figure


MOST_CONDITIONS, MOST_ACROSS = 12, 3
"""Trials that one page shows at most (the table has all), and those side by side; one more if they
are so many."""
SIZE = 2.2  # size [pt] of the markers
LEVEL_LOOKS = {
    "odd_level": (style.ORANGE, "^", "Odd distortion"),
    "even_level": (style.PURPLE, "s", "Even distortion"),
    "noise_level": (style.GREY, "x", "Noise"),
}  # colour, marker and name of each level
STRUCTURE_LOOKS = {
    "eq15": (style.MAGENTA, "-", r"$K + sB + s^2I$"),
    "eq9": (style.BLACK, (0, (4, 1.5)), "Drivetrain"),
}  # colour, line style, and name in the legend


def missed(rows: pl.DataFrame, short: str) -> Array:
    """Distance [N*m/rad] (n,) of a structure from the measured impedance, NaN where it is not
    known."""
    columns = (
        f"{part}{ending}" for ending in ("", f"_{short}") for part in ("magnitude", "phase_deg")
    )
    size, phase, of_structure, its_phase = (
        rows.select(pl.col(*columns).cast(pl.Float64)).to_numpy().T
    )
    return np.asarray(
        abs(
            size * np.exp(1j * np.deg2rad(phase))
            - of_structure * np.exp(1j * np.deg2rad(its_phase))
        )
    )


@style.drawing(
    columns_of("response"),
    lambda table: names.completed(table, columns_of("response"), True),
    nothing=(
        "every impedance trial follows the stepped sine; its frequency response is in phasors.csv"
        " and Fig. 7"
    ),
)
def draw_response(table: pl.DataFrame) -> Figure:
    """Per trial magnitude, phase, and the structures' deviation beside distortion above the noise,
    and noise."""
    shown = table.partition_by("trial", maintain_order=True)[:MOST_CONDITIONS]
    across = min(len(shown), MOST_ACROSS + (len(shown) > MOST_ACROSS**2))
    down = -(-len(shown) // across)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    # of each condition three panels with their axes, and the lines above them
    figure = Figure(figsize=(width, 0.5 + down * (3 * 0.84 + 0.3)), layout="constrained")
    axes = figure.subplots(3 * down, across, squeeze=False)
    entries: dict[str, Any] = {}
    for number, rows in enumerate(shown):
        row, column = divmod(number, across)
        parts = list(axes[3 * row : 3 * row + 3, column])
        entries |= draw_condition(parts, rows)
        name = names.drawn_name(rows["trial"][0], 28 if across <= MOST_ACROSS else 18)
        parts[0].set_title(f"({ascii_lowercase[number]}) " * (len(shown) > 1) + name, loc="left")
    labels = ("Magnitude\n(N·m/rad)", "Phase (deg)", "Deviation,\nlevel (N·m/rad)") * down
    for ax, label in zip(axes[:, 0], labels, strict=True):
        ax.set_ylabel(label)
    for unused in axes[-3:, len(shown) - across * (down - 1) :].ravel():
        unused.remove()
    style.legend_above(figure, entries, 6, columnspacing=1.2)
    figure.align_ylabels(axes[:, 0])
    return figure


def draw_condition(parts: Sequence[Axes], rows: pl.DataFrame) -> dict[str, Any]:
    """Three panels of one trial; the entries of the legend."""
    rows = rows.with_columns(pl.col(*LEVEL_LOOKS, "total_sd", "noise_sd").cast(pl.Float64))
    f, beside = rows["frequency_hz"].to_numpy(), parts[2]
    # 95 % intervals of one direction in the complex plane, of noise and distortion, or of noise
    # where it is not known
    half = 1.96 * pl.coalesce("total_sd", "noise_sd").fill_null(0.0) / np.sqrt(2)
    entries: dict[str, Any] = {
        "Measured Z": style.key("", marker="o", color=style.BLACK, markersize=SIZE)
    }
    entries |= style.open_entry(rows)
    halves = {"magnitude": half, "phase_deg": half / pl.col("magnitude") * (180 / np.pi)}
    for ax, (name, reach) in zip(parts, halves.items(), strict=False):
        low, high = rows.select(low=pl.col(name) - reach, high=pl.col(name) + reach)
        ax.vlines(f, low, high, color=style.BLACK, linewidth=0.6)
        fill = style.WHITE if style.has_doubtful(rows) else style.BLACK
        ax.plot(f, rows[name], "o", color=style.BLACK, markersize=SIZE, mew=0.5, mfc=fill)
        ax.tick_params(labelbottom=False)
        ax.yaxis.set_major_locator(MaxNLocator(nbins=4))
    for short, (colour, dash, label) in STRUCTURE_LOOKS.items():
        curves: tuple[Any, ...] = (
            rows[f"magnitude_{short}"],
            rows[f"phase_deg_{short}"],
            missed(rows, short),
        )
        for ax, curve in zip(parts, curves, strict=True):
            if rows[f"magnitude_{short}"].count():
                (entries[label],) = ax.plot(f, curve, color=colour, linestyle=dash, linewidth=0.9)
    levels = {name: rows[name].to_numpy() for name in LEVEL_LOOKS}
    noise = levels["noise_level"]
    seen = {
        name: level > (0 if level is noise else np.maximum(noise, 0))
        for name, level in levels.items()
    }
    for name, (colour, marker, label) in LEVEL_LOOKS.items():
        if seen[name].any():
            look: dict[str, Any] = {
                "color": colour,
                "markersize": SIZE + 0.3,
                "mew": 0.5 * (marker == "x"),
            }
            (entries[label],) = beside.plot(f[seen[name]], levels[name][seen[name]], marker, **look)
    beside.set_yscale("log")
    style.label_log_axis(beside.yaxis, beside.get_ylim(), most=4)
    beside.set_xlabel("Frequency (Hz)")
    for ax in parts:
        ax.set_xlim(0, 1.04 * float(np.max(f)))
        ax.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    return entries
