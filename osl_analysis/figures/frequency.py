"""Fig. 7 and `response`: admittance and impedance of the joint over frequency."""

from collections.abc import Callable, Sequence
from string import ascii_lowercase
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from osl_analysis.errors import InputError
from osl_analysis.figures import captions, columns_of, marks, names, style
from osl_analysis.figures.ticks import label_frequency_axis, label_log_axis, label_phase_axis
from osl_analysis.stats.repeats import NORMAL_97_5
from osl_analysis.trial import Array

# Fig. 7

FIG7_COLUMNS = [name for name in columns_of("fig7") if name != "chosen"]
# kinds of `curve`
OBSERVED = "observed"
DESIRED = "desired"
LINEAR_MODEL = "linear model"
PARTS = ("magnitude", "phase_deg")
MOST_TICKS = 8  # of frequency, in the panel of one joint
MOST_TICKS_NARROW = 5  # in those of several joints side by side


def fig7_points(response: pl.DataFrame, curves: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """Join the points that Fig. 7 plots.

    Parameters
    ----------
    response : DataFrame
        Observed points of one desired impedance.
    curves : sequence of DataFrame
        By `response_curve`: the desired response, and those of linear models.

    Raises
    ------
    InputError
        The responses are of several desired impedances.
    """
    impedances = response.select("K_d", "B_d").n_unique()
    if impedances > 1:
        raise InputError(
            f"frequency responses of {impedances} desired impedances; Fig. 7 draws one: select"
            " K_d, B_d"
        )
    if "look" not in response.columns:
        response = response.with_columns(names.look_numbers(response["controller"]))
    looks = response.select("controller", "look").unique()
    observed = response.with_columns(curve=pl.lit(OBSERVED))
    parts = [names.completed(observed, FIG7_COLUMNS, only=True)]
    for curve in curves:
        parts.append(curve.join(looks, on="controller", how="left", maintain_order="left"))
    return pl.concat(parts, how="diagonal_relaxed").select(FIG7_COLUMNS)


def response_curve(
    curve: str,
    controller: str | None,
    frequency_hz: np.ndarray,
    admittance: Callable[[Any], Any],
    place: Sequence[str | None],
) -> pl.DataFrame:
    """Write a curve of the admittance as rows of Fig. 7.

    Parameters
    ----------
    curve : str
        `DESIRED` or `LINEAR_MODEL`.
    controller : str or None
        Of a linear model.
    frequency_hz : (n,)
    admittance : callable
        Integral admittance [rad/(N·m)] at complex frequencies s [rad/s].
    place : (str or None, str or None)
        Joint and side.
    """
    joint, side = place
    Y = admittance(np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128))
    texts = {"joint": joint, "side": side, "curve": curve, "controller": controller}
    numbers = pl.DataFrame(
        {
            "frequency_hz": frequency_hz,
            "magnitude": np.abs(Y),
            "phase_deg": np.rad2deg(np.angle(Y)),
        }
    )
    columns = [pl.lit(value, pl.String).alias(name) for name, value in texts.items()]
    return numbers.select(*columns, *numbers.columns)


def fig7_caption(table: pl.DataFrame) -> str:
    """What Fig. 7 shows, of which desired impedance, and why of this one."""
    observed = names.completed(table.filter(pl.col("curve") == OBSERVED), ["chosen"])
    K_d, B_d, chosen = observed.select("K_d", "B_d", "chosen").row(0)
    stated = names.condition_parts(None, K_d, B_d)
    why = f" ({captions.as_text(chosen)})" if chosen is not None else ""
    of = f" for {', '.join(stated)}{why}" if stated else ""
    sentences = [
        f"Frequency response of the joint, angle over torque{of}: (a) magnitude, (b) phase.",
        "Markers: measured phasors.",
    ]
    if marks.has_range(table, "magnitude_amplitudes"):
        sentences.append("They are averages over amplitudes, thin bars the range over these.")
    if names.has_values(table, "magnitude_low"):
        sentences.append(
            "Thick bars, where they are longer than the markers: 95 % intervals of noise."
        )
    kinds = set(table["curve"])
    if DESIRED in kinds:
        sentences.append("Black: the desired impedance.")
    if LINEAR_MODEL in kinds:
        sentences.append(
            "Broken lines: the linear model, which is the drivetrain with the controller's gains"
            " and without friction. Its apparent inertia I may be negative."
        )
    return " ".join(sentences)


@style.drawing(
    FIG7_COLUMNS,
    fig7_points,
    needs=[name for name in FIG7_COLUMNS if name not in ("joint", "side", "curve", "look")],
    caption=fig7_caption,
    nothing="no trial follows a stepped sine, whose phasors it shows",
)
def draw_fig7(table: pl.DataFrame) -> Figure:
    """(a) magnitude, (b) phase over frequency; several joints or sides stand side by side."""
    parts = names.placed_rows(table)
    looks = names.looks_in(table.filter(pl.col("curve") != DESIRED))
    across = len(parts)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    figure, axes = style.panels(
        width, 4.2, rows=2, columns=across, titles=names.panel_titles(parts), share_x=True
    )
    most_ticks = MOST_TICKS if across == 1 else MOST_TICKS_NARROW
    for column, (_, part) in enumerate(parts):
        magnitude, phase = axes[column], axes[across + column]
        for ax, quantity in zip((magnitude, phase), PARTS, strict=True):
            draw_response_of(ax, part, quantity, looks)
        magnitude.set_yscale("log")
        label_log_axis(magnitude.yaxis, magnitude.get_ylim(), most=6, scale=1e3)
        label_phase_axis(phase)
        tested = part.filter(pl.col("curve") == OBSERVED)["frequency_hz"]
        label_frequency_axis(phase, part["frequency_hz"], most_ticks, tested.to_list())
        phase.set_xlabel("Frequency (Hz)")
    axes[0].set_ylabel("Magnitude (mrad/(N·m))")
    axes[across].set_ylabel("Phase (deg)")

    entries = fig7_entries(table, axes, looks)
    marks.legend_above(figure, entries | marks.open_entry(table), 2 if across == 1 else 4)
    figure.align_ylabels()
    return figure


def fig7_entries(
    table: pl.DataFrame, axes: Sequence[Axes], looks: dict[str | None, style.Look]
) -> dict[str, Any]:
    """The legend of Fig. 7: markers, then lines, then bars."""
    entries: dict[str, Any] = {}
    if OBSERVED in table["curve"]:
        entries = dict(marks.controller_entries(looks.values()))
    for label, handle in marks.legend_entries(axes).items():
        entries.setdefault(label, handle)
    return entries | marks.bar_entries(table, PARTS)


def draw_response_of(
    ax: Axes, part: pl.DataFrame, quantity: str, looks: dict[str | None, style.Look]
) -> None:
    """Magnitude or phase of one joint: measured, of linear models, and desired."""
    of_curve = {kind: part.filter(pl.col("curve") == kind) for kind in part["curve"].unique()}
    none = part.clear()
    desired = of_curve.get(DESIRED, none)
    if len(desired):
        ax.plot(
            desired["frequency_hz"], desired[quantity],
            color=style.BLACK, label="Desired", zorder=1,
        )  # fmt: skip
    for controller, look in looks.items():
        observed = names.of_controller(of_curve.get(OBSERVED, none), controller)
        if len(observed):
            marks.draw_estimates(ax, observed, "frequency_hz", quantity, look)
        model = names.of_controller(of_curve.get(LINEAR_MODEL, none), controller)
        if len(model):
            ax.plot(
                model["frequency_hz"], model[quantity],
                color=look.colour, linewidth=0.9, linestyle=look.dash,
                label=f"{look.label}, {names.LINEAR_MODEL.lower()}",
            )  # fmt: skip


# response

MOST_CONDITIONS = 12  # trials that one page shows; the table has all
MOST_ACROSS = 3  # trials side by side; four if there are more than nine
PANEL_HEIGHT = 0.84  # [in]
AROUND_TRIAL = 0.4  # height between the panels of two trials, with their labels [in]
LEGEND_HEIGHT = 0.45  # [in]
SIZE = 2.2  # size [pt] of the markers


# noise and distortion of one realisation: colour, marker, width of its edge [pt], label
LEVELS = {
    "odd_level": (style.ORANGE, "^", 0.0, "Odd distortion"),
    "even_level": (style.PURPLE, "s", 0.0, "Even distortion"),
    "noise_level": (style.GREY, "x", 0.5, "Noise"),
}
# models of the impedance: how their lines are drawn, label
STRUCTURES: dict[str, tuple[dict[str, Any], str]] = {
    "eq15": ({"color": style.MAGENTA, "linestyle": "-"}, r"Fit of $K + sB + s^2I$"),
    "eq9": ({"color": style.BLACK, "linestyle": (0, (4, 1.5))}, names.LINEAR_MODEL),
}


def response_points(response: pl.DataFrame) -> pl.DataFrame:
    """The columns that the figure plots, null where the table lacks one."""
    return names.completed(response, columns_of("response"), only=True)


def response_caption(table: pl.DataFrame) -> str:
    """What the figure `response` shows."""
    has_distortion = names.has_values(table, "odd_level") or names.has_values(table, "even_level")
    levels = "the noise and distortion" if has_distortion else "the noise"
    sentences = [
        "Impedance Z of the joint, torque over angle, over frequency. Each trial has three panels:"
        f" magnitude, phase, and below the misfit of the models (lines) beside {levels} of one"
        " realisation (markers)."
    ]
    if names.has_desired(table):
        sentences.append(
            "Above stands what was asked for, $K_d$ in N·m/rad and $B_d$ in N·m·s/rad."
        )
    if names.has_values(table, "magnitude_eq15"):
        sentences.append("Magenta: the fit of K, B and I.")
    if names.has_values(table, "magnitude_eq9"):
        sentences.append("Dashed: the linear model, which is the drivetrain with its gains.")
    if table["trial"].n_unique() > MOST_CONDITIONS:
        sentences.append(f"The first {MOST_CONDITIONS} trials are shown.")
    is_robust = names.has_values(table.filter(method="robust"), "total_sd")
    sentences.append(
        f"Upright bars: 95 % intervals of noise{' and distortion' if is_robust else ''}."
    )
    if not table.filter(method="local polynomial").is_empty():
        sentences.append(
            "Where the motion does not repeat itself, distortion is part of the noise."
        )
    return " ".join(sentences)


@style.drawing(
    columns_of("response"),
    response_points,
    caption=response_caption,
    nothing=(
        "every impedance trial follows the stepped sine; its frequency response is in phasors.csv"
        " and Fig. 7"
    ),
)
def draw_response(table: pl.DataFrame) -> Figure:
    """Three panels of each trial: magnitude, phase, and what models miss beside noise and
    distortion."""
    trials = table.partition_by("trial", maintain_order=True)[:MOST_CONDITIONS]
    across = min(len(trials), MOST_ACROSS)
    if len(trials) > MOST_ACROSS**2:
        across = MOST_ACROSS + 1
    down = -(-len(trials) // across)
    width = style.SINGLE_COLUMN if across == 1 else style.DOUBLE_COLUMN
    height = LEGEND_HEIGHT + down * (len(PANELS) * PANEL_HEIGHT + AROUND_TRIAL)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(len(PANELS) * down, across, squeeze=False)

    titles = names.trial_titles(table, is_narrow=across > 1)
    entries: dict[str, Any] = {}
    for number, rows in enumerate(trials):
        row, column = divmod(number, across)
        first = len(PANELS) * row
        of_trial = list(axes[first : first + len(PANELS), column])
        entries |= draw_condition(of_trial, rows)
        letter = f"({ascii_lowercase[number]}) " if len(trials) > 1 else ""
        of_trial[0].set_title(f"{letter}{titles[rows['trial'][0]]}", loc="left")
    for ax, label in zip(axes[:, 0], PANELS * down, strict=True):
        ax.set_ylabel(label)
    n_in_last_row = len(trials) - across * (down - 1)
    for unused in axes[-len(PANELS) :, n_in_last_row:].ravel():
        unused.remove()

    marks.legend_above(figure, entries, 6, columnspacing=1.2)
    figure.align_ylabels(axes[:, 0])
    return figure


PANELS = ("Magnitude\n(N·m/rad)", "Phase (deg)", "Misfit, noise\n(N·m/rad)")


def draw_condition(of_trial: Sequence[Axes], rows: pl.DataFrame) -> dict[str, Any]:
    """Draw the three panels of one trial.

    Returns
    -------
    dict
        The entries of the legend, by label.
    """
    rows = rows.with_columns(pl.col(*LEVELS, "total_sd", "noise_sd").cast(pl.Float64))
    magnitude, phase, level = of_trial
    entries = draw_measured_impedance(magnitude, phase, rows)
    for short, (line, label) in STRUCTURES.items():
        if rows[f"magnitude_{short}"].count():
            entries[label] = draw_structure(of_trial, rows, short, line)
    entries |= draw_levels(level, rows)
    entries |= marks.open_entry(rows)

    level.set_xlabel("Frequency (Hz)")
    for ax in of_trial:
        ax.set_xlim(0, 1.04 * float(rows["frequency_hz"].to_numpy().max()))
        ax.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    return entries


def draw_measured_impedance(magnitude: Axes, phase: Axes, rows: pl.DataFrame) -> dict[str, Any]:
    """Measured magnitude [N·m/rad] and phase [deg] with 95 % intervals, and their entries of the
    legend."""
    # standard deviation of the complex impedance, of noise and distortion, or of noise where
    # distortion is not known; one direction in the plane has half of its variance
    sd = pl.coalesce("total_sd", "noise_sd").fill_null(0.0)
    half = NORMAL_97_5 * sd / np.sqrt(2)
    halves = {"magnitude": half, "phase_deg": (half / pl.col("magnitude")).degrees()}
    fill = style.WHITE if marks.has_doubtful(rows) else style.BLACK
    point: dict[str, Any] = {"color": style.BLACK, "markersize": SIZE, "mew": 0.5}
    for ax, (name, half_width) in zip((magnitude, phase), halves.items(), strict=True):
        ends = rows.select(low=pl.col(name) - half_width, high=pl.col(name) + half_width)
        ax.vlines(rows["frequency_hz"], ends["low"], ends["high"], color=style.BLACK, linewidth=0.6)
        ax.plot(rows["frequency_hz"], rows[name], "o", mfc=fill, **point)
        ax.tick_params(labelbottom=False)
        ax.yaxis.set_major_locator(MaxNLocator(nbins=4))
    measured = {"Measured Z": marks.key("Measured Z", marker="o", **point)}
    return measured | marks.bar_entry(marks.INTERVAL, 0.6, style.BLACK)


def draw_structure(
    of_trial: Sequence[Axes], rows: pl.DataFrame, short: str, look: dict[str, Any]
) -> Any:
    """A model's magnitude, phase and distance from the measured impedance; the handle of its
    line."""
    curves: tuple[Any, ...] = (
        rows[f"magnitude_{short}"],
        rows[f"phase_deg_{short}"],
        misfit(rows, short),
    )
    for ax, curve in zip(of_trial, curves, strict=True):
        (line,) = ax.plot(rows["frequency_hz"], curve, linewidth=0.9, **look)
    return line


def misfit(rows: pl.DataFrame, short: str) -> Array:
    """Distance [N·m/rad] (n,) of a model from the measured impedance, NaN where it is not known."""
    Z = complex_impedance(rows, "")
    return np.asarray(np.abs(Z - complex_impedance(rows, f"_{short}")))


def complex_impedance(rows: pl.DataFrame, end: str) -> Array:
    """Impedance [N·m/rad] (n,), complex, of the columns with this end."""
    magnitude = rows[f"magnitude{end}"].cast(pl.Float64).to_numpy()
    phase = np.deg2rad(rows[f"phase_deg{end}"].cast(pl.Float64).to_numpy())
    return np.asarray(magnitude * np.exp(1j * phase))


def draw_levels(ax: Axes, rows: pl.DataFrame) -> dict[str, Any]:
    """Noise above 0, and distortion above the noise [N·m/rad], on a logarithmic axis; the entries
    of the legend."""
    entries = {}
    noise = rows["noise_level"].to_numpy()
    for name, (colour, marker, edge, label) in LEVELS.items():
        level = rows[name].to_numpy()
        smallest = 0.0 if name == "noise_level" else np.maximum(noise, 0)
        is_seen = level > smallest
        if is_seen.any():
            (entries[label],) = ax.plot(
                rows["frequency_hz"].to_numpy()[is_seen], level[is_seen],
                linestyle="", marker=marker, color=colour,
                markersize=SIZE + 0.3, mew=edge,
            )  # fmt: skip
    ax.set_yscale("log")
    label_log_axis(ax.yaxis, ax.get_ylim(), most=4)
    return entries
