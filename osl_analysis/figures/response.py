"""Impedance over frequency with noise and distortion, and the structures fitted to it, for every condition."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from osl_analysis.figures import style
from osl_analysis.figures.names import UNIT_OF, count_of, doubtful_said, drawn_name, place_name, wrapped_words

FITTED_CURVES = ("magnitude", "phase_deg", "magnitude_eq15", "phase_deg_eq15", "magnitude_eq9", "phase_deg_eq9")
LEVEL_COLUMNS = ("noise_level", "odd_level", "even_level", "total_level")
OF_CONDITION = ("trials", "joint", "side", "controller", "K_d", "B_d")
COLUMNS = (
    *OF_CONDITION,
    "method",
    "realisations",
    "frequency_hz",
    *FITTED_CURVES,
    *LEVEL_COLUMNS,
    "noise_sd",
    "total_sd",
    "doubtful",
)
WORD_COLUMNS = ("trials", "joint", "side", "controller", "method", "doubtful")
NOTHING = "every impedance trial follows the stepped sine; its frequency response is in phasors.csv and Fig. 7"
"""Why there is nothing to draw where the table has no rows."""
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


def points(single: pl.DataFrame, pooled: pl.DataFrame) -> pl.DataFrame:
    """The rows of every condition: those of `response_pooled.csv`, then of each trial that is in none of them."""
    in_pool = {name for names in pooled["trials"].unique() for name in str(names).split(", ")}
    alone = single.filter(~pl.col("trial").is_in(in_pool)).with_columns(trials=pl.col("trial"))
    rows = pl.concat([pooled, alone], how="diagonal_relaxed")
    absent = {name: pl.String if name in WORD_COLUMNS else pl.Float64 for name in COLUMNS if name not in rows.columns}
    return rows.with_columns(pl.lit(None, kind).alias(name) for name, kind in absent.items()).select(COLUMNS)


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


def caption(table: pl.DataFrame) -> str:
    conditions = table.partition_by("trials", maintain_order=True)
    said = [
        f"Impedance Z, torque over angle, over frequency, of {count_of(len(conditions), 'condition')}, $K_d$ in "
        f"{UNIT_OF['K']} and $B_d$ in {UNIT_OF['B']}. Each has three panels: magnitude, phase, and below how far the "
        "structures fitted to it (lines) are from what is measured, beside noise and distortion of one realisation "
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
def draw(table: pl.DataFrame) -> Figure:
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
