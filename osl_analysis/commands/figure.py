"""Figures: the numbers to be plotted from result tables, the drawn page from those numbers, and the
captions."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import analysed
from osl_analysis.bench.belt import belt_figure_points
from osl_analysis.bench.bench_settings import ImpedanceAnalysis
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.effects import IMPEDANCE, plain_sums
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.recorded_motion import record_of_trial
from osl_analysis.campaign.configuration import FrequencyResponseFigure
from osl_analysis.commands.walking import (
    commanded_over_stance,
    read_unperturbed_gaits,
    selected_crossings,
)
from osl_analysis.errors import InputError
from osl_analysis.figures import drawing_of, names
from osl_analysis.figures.frequency import DESIRED, LINEAR_MODEL, draw_fig7, response_curve
from osl_analysis.figures.names import completed, look_numbers
from osl_analysis.files import atomic_path, digest, write_text
from osl_analysis.judge.finding import Limits
from osl_analysis.judge.judging import judged, marked
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import (
    FileOrNone,
    desired_admittance,
    joint_admittance,
    joint_of,
    read_parameters,
)
from osl_analysis.refusal import Refusal, read_refusals
from osl_analysis.stats.repeats import DOUBTFUL
from osl_analysis.table import read_table, with_evidence, write_table
from osl_analysis.trial import read_trial
from osl_analysis.walking.crossing import DOWN, UP
from osl_analysis.walking.result_tables import trajectory_points, walking_page_points
from osl_analysis.walking.unperturbed_gait import unperturbed_gait
from osl_analysis.walking.walking_settings import TimingSettings

# Formats, each with the entries of its metadata for what the data are, and for the time: equal
# numbers give equal files
METADATA = {
    ".pdf": ("Subject", "CreationDate"),
    ".svg": ("Description", "Date"),
    ".png": ("Description", "Date"),
}

UNDRAWN = "This figure is not drawn."  # how the caption of one begins that has nothing to show


def plot_numbers(
    name: str,
    table: Path,
    output: Path,
    option: Any = None,
    second: Path | None = None,
    third: Path | None = None,
    data: str = "",
) -> None:
    """Write what figure `name` plots, from the one result table that it shows, or up to three.
    `option` is the value of the setting that the list of figures names; None: not set."""
    figure = drawing_of(name)
    read = [
        with_evidence(table, figure.needs),
        *(read_table(path) for path in (second, third) if path),
    ]
    write_table(
        figure.points(*read) if option is None else figure.points(*read, option), output, data
    )


def draw_figure(
    name: str,
    table_csv: Path,
    outputs: Sequence[Path],
    refused: Sequence[Refusal] = (),
    origin: str = "",
    footer: bool = True,
) -> None:
    """Draw a figure, or say on its page why it is not drawn.

    Parameters
    ----------
    name
        Of the figure.
    table_csv
        The numbers that it shows.
    outputs
        PDF, SVG or PNG files.
    refused
        Why trials are missing that it would show.
    origin
        What the data are; the first digits of the SHA-256 of `table_csv` are added.
    footer
        Whether a small line below the figure says so, too; its metadata always do.
    """
    if origin:
        origin += f", numbers {str(digest(table_csv))[:8]}"
    causes = [(cause.trial, cause.file, cause.reason) for cause in read_refusals(table_csv)]
    if not causes:
        figure = drawing_of(name)
        table = read_table(table_csv, required=figure.columns)
        if not table.is_empty():
            missing = list(dict.fromkeys(cause.trial for cause in refused if cause.trial))
            draw_table(name, table, outputs, missing, origin, footer)
            return
        causes = [("", str(table_csv), figure.nothing)]
    reasons = pl.DataFrame(causes, schema=("trial", "file", "reason"), orient="row")
    reasons = reasons.with_columns(figure=pl.lit(name))
    draw_table("not_drawn", reasons, outputs, origin=origin, footer=footer)


MOST_NAMED = 4  # refused trials below a figure; the caption names more, `excluded.csv` all
PNG_EFFORT = 3  # of 9; lines hardly shrink by more


def draw_table(
    name: str,
    table: pl.DataFrame,
    outputs: Sequence[Path],
    missing: Sequence[str] = (),
    origin: str = "",
    footer: bool = True,
) -> None:
    """Draw numbers in memory, as `draw_figure`; `missing` are the refused trials."""
    for path in outputs:
        if path.suffix not in METADATA:
            raise InputError(
                f"{path}: figures are written as {', '.join(METADATA)}; choose one of these"
                " suffixes"
            )
    from osl_analysis.figures import style, svg_text  # matplotlib takes half a second

    if missing:
        further = len(missing) - MOST_NAMED
        named = ", ".join(missing[:MOST_NAMED]) + (f" and {further} more" if further > 0 else "")
        without = f"Without {len(missing)} refused: {named}"
        origin = f"{origin}. {without}" if origin else without
    figure = drawing_of(name).draw(table)
    page_box = names.write_footer(figure, origin) if origin and footer else None
    style.lay_out(figure)
    for path in outputs:
        subject, date = METADATA[path.suffix]
        metadata: dict[str, str | None] = {}
        options: dict[str, Any] = {}
        if path.suffix == ".png":
            options["pil_kwargs"] = {"compress_level": PNG_EFFORT}
        else:
            metadata[date] = None  # the same numbers give the same file
        if origin:
            metadata[subject] = origin
        page = BytesIO()  # a writer that the disk interrupts would leave its file open
        with style.paper_style():
            figure.savefig(
                page,
                format=path.suffix.removeprefix("."),
                metadata=metadata,
                bbox_inches=page_box,
                **options,
            )
        content = page.getvalue()
        if path.suffix == ".svg":
            content = svg_text.with_readable_text(content.decode()).encode()
        with atomic_path(path) as temporary:
            temporary.write_bytes(content)


def write_captions(
    *, tables: Mapping[str, Path], shown: Mapping[str, Sequence[Path]], footer: str, output: Path
) -> None:
    """Write a section per figure: its title, and its caption or why it is not drawn. `tables` are
    the plotted numbers by the name of the figure, `shown` the results of single trials that it
    shows; the refused ones are named."""
    doubts = "Why a fit is doubtful stands in the column `doubtful` of the figure's CSV file."
    said = [f"# Captions\n\n{names.as_text(footer)}. {doubts}\n"]
    for name, table in tables.items():
        refused = (
            cause.trial
            for file in shown.get(name, ())
            for cause in read_refusals(file)
            if cause.trial
        )
        caption = caption_of(name, table, list(dict.fromkeys(refused)))
        said.append(f"## {names.figure_title(name)}\n\n{caption}\n")
    write_text(output, "\n".join(said))


def caption_of(name: str, table_csv: Path, missing: Sequence[str] = ()) -> str:
    """The caption of one figure from its plotted numbers, with the trials that it lacks; or why it
    is not drawn."""
    if causes := [
        f"{cause.trial or cause.file}: {cause.reason}" for cause in read_refusals(table_csv)
    ]:
        return f"{UNDRAWN} {names.listed_text(causes)}."
    figure = drawing_of(name)
    table = read_table(table_csv, required=figure.columns)
    if table.is_empty():
        return f"{UNDRAWN} {names.as_text(figure.nothing[:1].upper() + figure.nothing[1:])}."
    lacks = (
        f" Without {names.count_of(len(missing), 'trial')} whose recordings or fits were refused: "
    )
    said = " ".join(part for part in (figure.caption(table), names.doubtful_said(table)) if part)
    return f"{said}{f'{lacks}{names.listed_text(missing)}.' if missing else ''}"


def fig3(curves: Sequence[Path], table: Path, summary: Path, output: Path, data: str = "") -> None:
    """The numbers of Fig. 3, from the trials' curves, `belt.csv` and `belt_summary.csv`."""
    drawn = pl.concat([read_table(path, of="belt_curves") for path in curves])
    judged = read_table(table, ["trial", *PLACE, "doubtful"])
    write_table(belt_figure_points(drawn, judged, read_table(summary)), output, data)


def fig4(
    trial: Path,
    fit: Path,
    settings: ImpedanceAnalysis,
    choice: Mapping[str, Any],
    limits: Limits,
    output: Path,
    windows: str | None = None,
    data: str = "",
) -> None:
    """Write the numbers of Fig. 4: the last seconds of one amplitude, or of a motion that is no
    stepped sine, measured and by the best second-order fit.

    Parameters
    ----------
    trial
        The recording.
    fit
        The trial's own table of fits.
    settings
        Of the fit.
    choice
        That of `time_series_example`: trial, place, condition, amplitude and duration.
    limits
        By which the fit may be doubtful.
    output
        The table of plotted numbers.
    windows
        As in `bench.fit_impedance_trial`.
    data
        What the data are.
    """
    record = record_of_trial(read_trial(trial), settings, windows)
    label = record.label_near(choice["amplitude_deg"])
    amplitude, analysis = (
        pl.col("amplitude_deg"),
        analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE),
    )
    alone = isinstance(label, float) and label in analysis.fits
    shown = (amplitude - label).abs() < 1e-6 if alone else amplitude.is_null()
    series = analysis.last_seconds(label, choice["duration_s"])
    fits = read_table(fit)
    doubtful = marked(fits, judged(fits, limits, "impedance"), "impedance").filter(shown)[
        "doubtful"
    ][0]
    texts = {name: choice[name] or None for name in ("trial", "joint", "side", "chosen")}
    texts |= {"controller": choice.get("controller"), "doubtful": doubtful}
    texts["model"] = "second-order system"
    constants = [pl.lit(value, pl.String).alias(name) for name, value in texts.items()]
    for name in ("K_d", "B_d"):
        constants.append(pl.lit(choice.get(name), pl.Float64).alias(name))
    write_table(series.with_columns(constants), output, data)


def fig7(
    table: Path,
    parameters: FileOrNone,
    choice: FrequencyResponseFigure | None,
    weight: Weight,
    output: Path,
    data: str = "",
) -> None:
    """The numbers of Fig. 7: measured responses of one K_d, B_d, without a `choice` of those that
    most trials have; the desired one (Eq. 11), if both are known; and the linear model (Eq. 9), if
    the gains are known and the parameter file is of this joint. Trials that no stepped sine moved
    have no responses."""
    responses = completed(read_table(table, required=draw_fig7.needs), PLACE)
    responses = responses.with_columns(look_numbers(responses["controller"]))
    pairs = responses.group_by("K_d", "B_d", maintain_order=True).agg(pl.col("trial").n_unique())
    counts = (ranked := pairs.sort("trial", descending=True, maintain_order=True))[
        "trial"
    ].to_list()
    K_d, B_d = (
        (choice.K_d, choice.B_d)
        if choice
        else (*ranked.select("K_d", "B_d").rows(), (None, None))[0]
    )
    shown = responses.filter(
        pl.col("K_d").eq_missing(pl.lit(K_d)), pl.col("B_d").eq_missing(pl.lit(B_d))
    )
    first = (
        "the first of the desired impedances"
        if counts[1:2] == counts[:1]
        else "the desired impedance"
    )
    chosen = None if choice else f"{first} with the most trials"
    write_table(
        beside_theory(shown, parameters, weight).with_columns(chosen=pl.lit(chosen, pl.String)),
        output,
        data,
    )


def beside_theory(responses: pl.DataFrame, parameters: Path | None, weight: Weight) -> pl.DataFrame:
    """The same for measured responses of one desired impedance in memory, without the column
    `chosen`."""
    shown, curves = responses.sort("frequency_hz", maintain_order=True), []
    for measured in shown.partition_by(PLACE, maintain_order=True):
        joint, side, K_d, B_d = measured.select(*PLACE, "K_d", "B_d").row(0)
        p = read_parameters(parameters) if parameters and joint_of(parameters) == joint else None
        f = np.linspace(
            float(measured["frequency_hz"][0]), float(measured["frequency_hz"][-1]), 101
        )
        s = np.asarray(2j * np.pi * f, dtype=np.complex128)
        if K_d is not None and B_d is not None:
            curves.append(
                response_curve(DESIRED, None, f, desired_admittance(K_d, B_d)(s), (joint, side))
            )
        for name in measured["controller"].unique(maintain_order=True) if p else ():
            gains = DesiredImpedance(name, K_d, B_d).gains(p, weight)
            if p and gains:
                Y = joint_admittance(gains.K_1, gains.B_1, p, p.J_j)
                curves.append(response_curve(LINEAR_MODEL, name, f, Y(s), (joint, side)))
    return draw_fig7.points(shown, curves)


def plot_walking_page(
    *,
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    responses: Path,
    table: Path,
    settings: TimingSettings,
    output: Path,
    data: str = "",
) -> None:
    """Write the numbers that the walking page plots. `crossings` are the perturbed ones,
    `selection` is `walking_crossings.csv`, `responses` `walking_responses.csv`, `table`
    `walking.csv`."""
    isolated = read_table(
        responses, ["group", "trial", "time", "theta_deg", "torque", "torque_model"]
    )
    doubtful = read_table(table, ["trial", DOUBTFUL]).select("trial", DOUBTFUL)
    isolated = isolated.join(doubtful, on="trial", how="left", maintain_order="left")
    chosen, gaits = selected_crossings(crossings, selection), read_unperturbed_gaits(unperturbed)
    gait_of = dict(read_table(selection, ["trial", "gait"]).select("trial", "gait").iter_rows())
    frames = []
    for (group,), of_group in isolated.partition_by(
        "group", maintain_order=True, as_dict=True
    ).items():
        perturbed = [crossing for crossing in chosen if crossing.name in set(of_group["trial"])]
        gait = gaits[gait_of[perturbed[0].name]]
        # whose mean is nobody's gait
        ways = {c.sign: f"perturbed {DOWN if c.sign < 0 else UP}" for c in perturbed}
        ways = ways if len(ways) > 1 else dict.fromkeys(ways, "perturbed")
        shown = {
            name: unperturbed_gait([c for c in perturbed if c.sign == sign], 1)
            for sign, name in ways.items()
        }
        points = walking_page_points(
            perturbed, {"unperturbed": gait, **shown}, of_group.drop("group"), settings
        )
        frames.append(points.with_columns(group=pl.lit(group)))
    write_table(pl.concat(frames, how="diagonal"), output, data)


def plot_over_stance(
    table: Path,
    output: Path,
    stance_share: float,
    trajectory: Sequence[Path] = (),
    data: str = "",
) -> None:
    """Rows of the table, and points of the commanded trajectory, of quantities that have more than
    one point."""
    rows = read_table(table, ("series", "quantity", "phase", "estimate", "low", "high"))
    for curves in commanded_over_stance(trajectory, data, stance_share):
        rows = pl.concat([rows, trajectory_points(*curves)], how="diagonal_relaxed")
    write_table(rows.filter(pl.col("phase").n_unique().over("quantity") > 1), output, data)
