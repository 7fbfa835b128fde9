"""Fig. 7: admittance of the joint over frequency."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from osl_analysis.errors import InputError
from osl_analysis.figures import captions, columns_of, marks, names, style
from osl_analysis.figures.ticks import label_frequency_axis, label_log_axis, label_phase_axis
from osl_analysis.stats.table_rows import INTERVAL_ENDS

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


def over_amplitudes(response: pl.DataFrame) -> pl.DataFrame:
    """The rows of `response.csv` over all amplitudes, with the doubts about single ones, and with
    the range of their magnitudes and phases, which are counted from that of all."""
    whole = response.filter(scope="all")
    of_whole = whole.select("trial", "frequency_hz", phase_of_whole="phase_deg")
    single = response.filter(scope="amplitude").join(of_whole, on=["trial", "frequency_hz"])
    apart = (pl.col("phase_deg") - pl.col("phase_of_whole") + 180) % 360 - 180
    single = single.with_columns(phase_deg=pl.col("phase_of_whole") + apart)
    doubts = pl.col("doubtful").filter(pl.col("doubtful") != "")
    ranges = single.group_by("trial", "frequency_hz").agg(
        pl.col(*PARTS).min().name.suffix("_amplitudes_low"),
        pl.col(*PARTS).max().name.suffix("_amplitudes_high"),
        doubts=doubts.unique(maintain_order=True).str.join("; "),
    )
    joined = whole.join(ranges, on=["trial", "frequency_hz"], how="left", maintain_order="left")
    return joined.with_columns(doubtful=pl.coalesce("doubts", "doubtful")).drop("doubts")


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
        "Markers: measured.",
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
    needs=[
        *("trial", "scope", "controller", "K_d", "B_d", "frequency_hz", "doubtful"),
        *(f"{part}{end}" for part in PARTS for end in INTERVAL_ENDS),
    ],
    caption=fig7_caption,
    nothing="no impedance trial has a frequency response",
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
