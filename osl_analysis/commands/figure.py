"""Figures: the numbers to be plotted from result tables, the drawn page from those numbers, and the
captions."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
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
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.campaign.configuration import FrequencyResponseFigure
from osl_analysis.commands.walking_files import read_unperturbed_gaits, selected_crossings
from osl_analysis.errors import InputError
from osl_analysis.figures import captions, drawing_of, names
from osl_analysis.figures.frequency import (
    DESIRED,
    LINEAR_MODEL,
    draw_fig7,
    over_amplitudes,
    response_curve,
)
from osl_analysis.figures.names import completed, look_numbers
from osl_analysis.figures.saved import METADATA, saved_figure, write_footer
from osl_analysis.figures.style import lay_out, without_collecting
from osl_analysis.files import atomic_path, digest, write_text
from osl_analysis.judge.judging import judged, marked
from osl_analysis.judge.limits import Limits
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
from osl_analysis.table import read_table, read_tables, with_evidence, write_table
from osl_analysis.trial import read_trial
from osl_analysis.walking.result_tables import walking_page_points
from osl_analysis.walking.unperturbed_gait import unperturbed_gait
from osl_analysis.walking.walking_settings import TimingSettings

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
    arguments: list[Any] = [with_evidence(table, figure.needs)]
    arguments += [read_table(path) for path in (second, third) if path]
    if option is not None:
        arguments.append(option)
    write_table(figure.points(*arguments), output, data)


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
            draw_table(name, table, outputs, names_of_trials(refused), origin, footer)
            return
        causes = [("", str(table_csv), figure.nothing)]
    reasons = pl.DataFrame(causes, schema=("trial", "file", "reason"), orient="row")
    reasons = reasons.with_columns(figure=pl.lit(name))
    draw_table("not_drawn", reasons, outputs, origin=origin, footer=footer)


def names_of_trials(refused: Iterable[Refusal]) -> list[str]:
    """The refused trials, each once; some refusals are of no single trial."""
    return list(dict.fromkeys(refusal.trial for refusal in refused if refusal.trial))


CURVE_POINTS = 101  # of a response by a model
SHOWN_S = 10.0  # length of the part of a trial that Fig. 4 shows
SAME_AMPLITUDE_DEG = 1e-6  # difference of an amplitude that a CSV file rounds
MOST_NAMED = 4  # refused trials below a figure; the caption names more, `excluded.csv` all


@without_collecting()
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
    if missing:
        without = f"Without {len(missing)} refused: {', '.join(missing[:MOST_NAMED])}"
        if len(missing) > MOST_NAMED:
            without += f" and {len(missing) - MOST_NAMED} more"
        origin = f"{origin}. {without}" if origin else without
    figure = drawing_of(name).draw(table)
    page_box = write_footer(figure, origin) if origin and footer else None
    lay_out(figure)
    for path in outputs:
        content = saved_figure(figure, path.suffix, origin, page_box)
        with atomic_path(path) as temporary:
            temporary.write_bytes(content)


def write_captions(
    *, tables: Mapping[str, Path], shown: Mapping[str, Sequence[Path]], footer: str, output: Path
) -> None:
    """Write a section per figure: its title, and its caption or why it is not drawn. `tables` are
    the plotted numbers by the name of the figure, `shown` the results of single trials that it
    shows; the refused ones are named."""
    sections = [
        f"# Captions\n\n{captions.as_text(footer)}. Why a fit is doubtful stands in the column"
        " `doubtful` of the figure's CSV file.\n"
    ]
    for name, table in tables.items():
        refusals = chain.from_iterable(read_refusals(file) for file in shown.get(name, ()))
        caption = caption_of(name, table, names_of_trials(refusals))
        sections.append(f"## {names.figure_title(name)}\n\n{caption}\n")
    write_text(output, "\n".join(sections))


def caption_of(name: str, table_csv: Path, missing: Sequence[str] = ()) -> str:
    """The caption of one figure from its plotted numbers, with the trials that it lacks; or why it
    is not drawn."""
    causes = [f"{cause.trial or cause.file}: {cause.reason}" for cause in read_refusals(table_csv)]
    if causes:
        return f"{UNDRAWN} {captions.listed_text(causes)}."
    figure = drawing_of(name)
    table = read_table(table_csv, required=figure.columns)
    if table.is_empty():
        return f"{UNDRAWN} {captions.as_text(figure.nothing[:1].upper() + figure.nothing[1:])}."
    sentences = [figure.caption(table), captions.doubtful_sentence(table)]
    if missing:
        sentences.append(
            f"Without {names.count_of(len(missing), 'trial')} whose recordings or fits were"
            f" refused: {captions.listed_text(missing)}."
        )
    return " ".join(filter(None, sentences))


def fig3(curves: Sequence[Path], table: Path, summary: Path, output: Path, data: str = "") -> None:
    """The numbers of Fig. 3, from the trials' curves, `belt.csv` and `belt_summary.csv`."""
    drawn = read_tables(curves, "belt_curves")
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
    """Write the numbers of Fig. 4: the end of the largest amplitude, or of a motion that is no
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
        That of `time_series_example`.
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
    label = record.largest_amplitude
    analysis = analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE)
    series = analysis.last_seconds(label, SHOWN_S)

    fits = read_table(fit)
    fits = marked(fits, judged(fits, limits, "impedance"), "impedance")
    amplitude = pl.col("amplitude_deg")
    is_shown = amplitude.is_null()
    if isinstance(label, float) and label in analysis.fits:  # this amplitude has a fit of its own
        is_shown = (amplitude - label).abs() < SAME_AMPLITUDE_DEG
    texts = {
        **{name: choice[name] or None for name in ("trial", "joint", "side", "chosen")},
        "controller": choice.get("controller"),
        "doubtful": fits.filter(is_shown)["doubtful"][0],
        "model": "second-order system",
    }
    constants = [pl.lit(text, pl.String).alias(name) for name, text in texts.items()]
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
    the gains are known and the parameter file is of this joint."""
    measured = over_amplitudes(read_table(table, required=draw_fig7.needs))
    responses = completed(measured, PLACE)
    responses = responses.with_columns(look_numbers(responses["controller"]))
    if choice is not None:
        K_d, B_d, why = choice.K_d, choice.B_d, None
    else:
        K_d, B_d, why = most_frequent_impedance(responses)
    shown = responses.filter(
        pl.col("K_d").eq_missing(pl.lit(K_d)), pl.col("B_d").eq_missing(pl.lit(B_d))
    )
    points = beside_theory(shown, parameters, weight)
    write_table(points.with_columns(chosen=pl.lit(why, pl.String)), output, data)


def most_frequent_impedance(responses: pl.DataFrame) -> tuple[float | None, float | None, str]:
    """K_d [N*m/rad] and B_d [N*m*s/rad] that most trials have, and in words why these; null where
    there is no response."""
    impedances = responses.group_by("K_d", "B_d", maintain_order=True)
    counts = impedances.agg(n=pl.col("trial").n_unique())
    counts = counts.sort("n", descending=True, maintain_order=True)
    if counts.is_empty():
        return None, None, "the desired impedance with the most trials"
    K_d, B_d, most = counts.row(0)
    is_one_of_several = counts.filter(n=most).height > 1
    first = "the first of the desired impedances" if is_one_of_several else "the desired impedance"
    return K_d, B_d, f"{first} with the most trials"


def beside_theory(responses: pl.DataFrame, parameters: Path | None, weight: Weight) -> pl.DataFrame:
    """The same for measured responses of one desired impedance in memory, without the column
    `chosen`."""
    shown = responses.sort("frequency_hz", maintain_order=True)
    curves = []
    for measured in shown.partition_by(PLACE, maintain_order=True):
        joint, side, K_d, B_d = measured.select(*PLACE, "K_d", "B_d").row(0)
        low_hz, high_hz = measured["frequency_hz"][0], measured["frequency_hz"][-1]
        frequency_hz = np.linspace(float(low_hz), float(high_hz), CURVE_POINTS)
        place = (joint, side)
        if K_d is not None and B_d is not None:
            desired = desired_admittance(K_d, B_d)
            curves.append(response_curve(DESIRED, None, frequency_hz, desired, place))
        if parameters is None or joint_of(parameters) != joint:
            continue
        p = read_parameters(parameters)
        for controller in measured["controller"].unique(maintain_order=True):
            gains = DesiredImpedance(controller, K_d, B_d).gains(p, weight)
            if gains is not None:
                Y = joint_admittance(gains.K_1, gains.B_1, p, p.J_j)
                curves.append(response_curve(LINEAR_MODEL, controller, frequency_hz, Y, place))
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
    selected = selected_crossings(crossings, selection)
    gaits = read_unperturbed_gaits(unperturbed)
    frames = []
    for of_group in isolated.partition_by("group", maintain_order=True):
        trials = set(of_group["trial"])
        perturbed = [crossing for crossing in selected if crossing.name in trials]
        gait_curves = {
            "unperturbed": gaits[of_group["group"][0]],
            "perturbed": unperturbed_gait(perturbed, 1),
        }
        points = walking_page_points(perturbed, gait_curves, of_group.drop("group"), settings)
        frames.append(points.with_columns(group=pl.lit(of_group["group"][0])))
    write_table(pl.concat(frames, how="diagonal"), output, data)
