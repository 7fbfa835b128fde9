"""Impedance over frequency with noise and distortion, and the structures fitted to it, for every condition."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray

from osl_analysis.figures.names import drawn_name, place_name
from osl_analysis.figures.style import (
    BLACK,
    DOUBLE_COLUMN,
    GREY,
    IS_DOUBTFUL,
    LIGHT_DOT,
    MAGENTA,
    ORANGE,
    PURPLE,
    light_dots,
    paper_style,
)

CURVES = ("magnitude", "phase_deg", "magnitude_eq15", "phase_deg_eq15", "magnitude_eq9", "phase_deg_eq9")
LEVELS = ("noise_level", "odd_level", "even_level", "total_level")
PLACE = ("trials", "joint", "side", "controller", "K_d", "B_d")
COLUMNS = (*PLACE, "method", "realisations", "frequency_hz", *CURVES, *LEVELS, "noise_sd", "total_sd", "doubtful")
TEXT = ("trials", "joint", "side", "controller", "method", "doubtful")
NOTHING = "every impedance trial follows the stepped sine; its frequency response is in phasors.csv and Fig. 7"
"""Why there is nothing to draw where the table has no rows."""
MOST = 12
"""Largest number of conditions that one page shows; the table has all."""
LOOKS = {
    "odd_level": (ORANGE, "^", "Odd distortion"),
    "even_level": (PURPLE, "s", "Even distortion"),
    "noise_level": (GREY, ".", "Noise"),
}
"""Colour, marker and name of each level."""
MODELS = {"eq15": (MAGENTA, "-", r"Eq. 15: $K + sB + s^2I$"), "eq9": (BLACK, (0, (4, 1.5)), "Eq. 9: drivetrain")}


def points(single: pl.DataFrame, pooled: pl.DataFrame) -> pl.DataFrame:
    """The rows of every condition: those of `response_pooled.csv`, then of each trial that is in none of them."""
    in_pool = {name for names in pooled["trials"].unique() for name in str(names).split(", ")}
    alone = single.filter(~pl.col("trial").is_in(in_pool)).with_columns(trials=pl.col("trial"))
    rows = pl.concat([pooled, alone], how="diagonal_relaxed")
    absent = {name: pl.String if name in TEXT else pl.Float64 for name in COLUMNS if name not in rows.columns}
    return rows.with_columns(pl.lit(None, kind).alias(name) for name, kind in absent.items()).select(COLUMNS)


def title_of(row: Mapping[str, Any]) -> str:
    """Joint, controller and desired impedance of a condition, as far as they are known, and its trials."""
    words = [place_name(row["joint"], row["side"]), drawn_name(row["controller"] or "")]
    for symbol, unit in (("K_d", "N·m/rad"), ("B_d", "N·m·s/rad")):
        if row[symbol] is not None:
            words.append(f"${symbol}$ = {row[symbol]:g} {unit}")
    trials = str(row["trials"]).split(", ")
    more = f" and {len(trials) - 1} more trial{'s' * (len(trials) > 2)}" if len(trials) > 1 else ""
    return ", ".join(filter(None, [*words, drawn_name(trials[0]) + more]))


@paper_style()
def draw(table: pl.DataFrame) -> Figure:
    """Per condition magnitude and phase with 95 % intervals, and the structures' deviation, distortion and noise.

    Distortion below the noise is not drawn.
    """
    conditions = table.partition_by("trials", maintain_order=True)
    shown = conditions[:MOST]
    figure = Figure(figsize=(DOUBLE_COLUMN, 0.6 + 2.0 * len(shown)), layout="constrained")
    parts = figure.subfigures(len(shown), 1, squeeze=False)[:, 0]
    entries: dict[str, Line2D] = {}
    for part, rows in zip(parts, shown, strict=True):
        part.suptitle(f"{title_of(rows.row(0, named=True))} ({method_words(rows)})", fontsize=8)
        magnitude, phase, beside = part.subplots(1, 3)
        entries |= draw_curves(magnitude, rows, "magnitude") | draw_curves(phase, rows, "phase_deg")
        entries |= draw_levels(beside, rows)
        magnitude.set_ylabel("Magnitude of Z (N·m/rad)")
        phase.set_ylabel("Phase of Z (deg)")
        beside.set_ylabel("Deviation, level (N·m/rad)")
        for ax, letter in zip((magnitude, phase, beside), "abc", strict=True):
            ax.set_title(f"({letter})", loc="left")
            ax.set_xlabel("Frequency (Hz)")
            ax.set_xlim(0, 1.04 * float(rows["frequency_hz"].max()))  # type: ignore[arg-type]
    figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=4, columnspacing=1.5)
    if len(conditions) > MOST:
        figure.supxlabel(f"{len(conditions) - MOST} more conditions are in response.csv", fontsize=8)
    return figure


def method_words(rows: pl.DataFrame) -> str:
    """How the response was measured."""
    method, count = str(rows["method"][0]), int(rows["realisations"][0])
    return method if method == "local polynomial" else f"{count} realisation{'s' * (count > 1)}"


def draw_curves(ax: Axes, rows: pl.DataFrame, quantity: str) -> dict[str, Line2D]:
    """Measured points and the lines of the structures; the entries of the legend."""
    f = rows["frequency_hz"]
    half = intervals(rows, quantity)
    ax.vlines(f, rows[quantity] - half, rows[quantity] + half, color=BLACK, linewidth=0.7)
    (line,) = ax.plot(f, rows[quantity], "o", color=BLACK, markersize=3, mew=0)
    entries = {"Measured Z": line}
    if rows.filter(IS_DOUBTFUL).height:
        light_dots(ax, f, rows[quantity])
        entries[str(LIGHT_DOT.get_label())] = LIGHT_DOT
    for short, (colour, style, label) in MODELS.items():
        curve = rows[f"{quantity}_{short}"].cast(pl.Float64)
        if curve.count():
            (line,) = ax.plot(f, curve, color=colour, linestyle=style, linewidth=0.9)
            entries[label] = line
    return entries


def intervals(rows: pl.DataFrame, quantity: str) -> pl.Series:
    """Half-widths of the 95 % intervals of magnitude or phase, of noise and distortion, or of noise where these are not
    known."""
    sd = pl.coalesce(pl.col("total_sd").cast(pl.Float64), pl.col("noise_sd").cast(pl.Float64)).fill_null(0.0)
    half = 1.96 * sd / np.sqrt(2)  # of one direction in the complex plane
    return rows.select(half if quantity == "magnitude" else half / pl.col("magnitude") * (180 / np.pi)).to_series()


def draw_levels(ax: Axes, rows: pl.DataFrame) -> dict[str, Line2D]:
    """Deviation of the structures from Z, distortion and noise, on a logarithmic axis; the entries of the legend."""
    f, entries = rows["frequency_hz"].to_numpy(), {}
    measured = complex_number(rows, "")
    for short, (colour, style, _) in MODELS.items():
        if rows[f"magnitude_{short}"].count():
            ax.plot(
                f, np.abs(measured - complex_number(rows, f"_{short}")), color=colour, linestyle=style, linewidth=0.9
            )
    noise = rows["noise_level"].cast(pl.Float64).to_numpy()
    for name, (colour, marker, label) in LOOKS.items():
        level = rows[name].cast(pl.Float64).to_numpy()
        seen = np.isfinite(level) & (level > 0) & ((level > noise) | (name == "noise_level"))
        if seen.any():
            (line,) = ax.plot(f[seen], level[seen], marker, color=colour, markersize=3.5, mew=0)
            entries[label] = line
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    return entries


def complex_number(rows: pl.DataFrame, ending: str) -> NDArray[np.complex128]:
    """The impedance of measurement or structure, (m,) [N·m/rad]."""
    size, phase = (rows[f"{name}{ending}"].cast(pl.Float64).to_numpy() for name in ("magnitude", "phase_deg"))
    return np.asarray(size * np.exp(1j * np.deg2rad(phase)))
