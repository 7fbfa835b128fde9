"""The report of a run, and the comparison of two: reads what the runs wrote, and writes one
page."""

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from os.path import realpath
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.campaign.origin import sentence
from osl_analysis.commands.figure import UNDRAWN, draw_figure
from osl_analysis.commands.tables import read_summary
from osl_analysis.dictionary import described_tables
from osl_analysis.errors import InputError
from osl_analysis.figures import FIGURES
from osl_analysis.figures.names import figure_title
from osl_analysis.files import atomic_path, write_text
from osl_analysis.judge.finding import read_findings
from osl_analysis.judge.summary_findings import findings_in_summary
from osl_analysis.judge.two_campaigns import (
    COMPARED_QUANTITIES,
    comparison_table,
    label_of,
    verdicts_in_words,
)
from osl_analysis.refusal import Refusal, is_refused
from osl_analysis.report.brief import findings_lines
from osl_analysis.report.left_out import left_out_trials
from osl_analysis.report.numbers import headline_sentences, numbers_in_summary
from osl_analysis.report.page import Page, ShownFigure, trial_view, written_page
from osl_analysis.report.paper_tables import conditions, groups
from osl_analysis.report.rounding import written
from osl_analysis.report.signals import (
    Signals,
    of_fit,
    of_perturbation,
    of_recording,
    phasor_response,
)
from osl_analysis.report.text_tables import aligned
from osl_analysis.report.used_trials import missing_lines
from osl_analysis.report.verdicts import findings_by_trial, verdicts_sentence
from osl_analysis.table import read_table, with_evidence, write_table


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """What the page of a run is made of, and where it is written."""

    about: Mapping[str, str]
    sheet: Mapping[str, Mapping[str, Any]]  # rows of the sample sheet, also of excluded trials
    trials: Mapping[str, Path]  # recordings, by trial
    series: Mapping[str, Path]  # archives with signals and model of bench trials
    crossings: Mapping[str, Path]
    tables: Mapping[str, Path]  # result tables, by name
    figures: Mapping[str, Path]  # SVG files, by name
    verdicts: Path  # `quality.csv`
    excluded: Path
    findings: Path
    states: Path  # `settings.csv`
    summary: Path
    output: Path
    captions: Path | None = None
    refused: Sequence[Refusal] = ()
    unnamed: str = ""  # tells recordings without a row


def write_report(files: ReportFiles) -> None:
    """Write the page of a run."""
    tables = {name: with_evidence(path) for name, path in files.tables.items()}
    summary = read_summary(files.summary)
    left_out = left_out_trials(files.sheet, read_table(files.excluded), tables)
    findings = findings_by_trial(read_findings(files.findings))
    rows_of = {name: rows_by_trial(table) for name, table in tables.items()}
    checks = rows_by_trial(read_table(files.verdicts))
    views = []
    for trial, row in files.sheet.items():
        of_trial = {name: rows[trial] for name, rows in rows_of.items() if trial in rows}
        views.append(
            trial_view(
                row,
                of_trial,
                findings.get(trial, ()),
                left_out.get(trial),
                checks.get(trial, pl.DataFrame()),
                signals_of(row, of_trial, files),
            )
        )
    numbers = numbers_in_summary(summary)
    notes = [summary["intervals"], files.unnamed, assumed_text(read_table(files.states))]
    drawn, absent = drawn_figures(files.figures, read_captions(files.captions))
    page = Page(
        about=files.about,
        made_of=sentence(files.about),
        verdict=[verdicts_sentence(summary["verdicts"]), *headline_sentences(numbers)],
        notes=[note for note in notes if note],
        conditions=conditions(tables["impedance"]) if "impedance" in tables else (),
        groups=list(groups(tables["walking_summary"])) if "walking_summary" in tables else (),
        numbers=numbers,
        findings=findings_in_summary(summary),
        trials=views,
        figures=drawn,
        absent_figures=absent,
        missing_results=summary["missing_results"],
    )
    write_text(files.output, written_page(page))


def rows_by_trial(table: pl.DataFrame) -> dict[str, pl.DataFrame]:
    """The rows of each trial of a table; none where it has no trials."""
    if "trial" not in table.columns:
        return {}
    return {
        str(trial): rows for (trial,), rows in table.partition_by("trial", as_dict=True).items()
    }


MOVING = {"actuator": "Actuator angle", "walking": "Ankle angle"}
"""What moves in trials of an experiment, where it is not the joint."""


def signals_of(
    row: Mapping[str, Any], tables: Mapping[str, pl.DataFrame], files: ReportFiles
) -> Signals | None:
    """What the page plots of a trial: its fit, its response to a perturbation, its crossing, or
    else its recording; None without torque and angle."""
    trial, experiment = row["trial"], row["experiment"]
    motion = MOVING.get(experiment, "Joint angle")
    series = files.series.get(trial)
    if series is not None:
        signals = of_fit(read_table(series, name="series"), motion)
        if "phasors" in tables and "impedance" in tables:
            fit = tables["impedance"].row(-1, named=True)
            return replace(signals, response=phasor_response(tables["phasors"], fit))
        return signals
    if "walking_responses" in tables:
        return of_perturbation(tables["walking_responses"])
    for recording in (files.crossings.get(trial), files.trials.get(trial)):
        if recording is not None:
            columns = pl.read_parquet_schema(recording)
            if "torque" in columns or "theta" in columns:
                return of_recording(pl.read_parquet(recording), f"{motion} (deg)")
    return None


def assumed_text(states: pl.DataFrame) -> str:
    """The settings of `settings.csv` that are used though nobody stated them; empty if all are."""
    assumed = states.cast(pl.String).filter(state="assumed")
    texts = [f"{name} {value}" for name, value in assumed.select("setting", "value").rows()]
    return f"Assumed, since nobody stated it: {', '.join(texts)}." if texts else ""


MARKED_SIGN = re.compile(r"\\(?=[^\w$\s])")
"""The backslash before a sign that would mean something in Markdown."""


def read_captions(path: Path | None) -> Mapping[str, str]:
    """The captions of figures by title; none where they were not written."""
    if path is None or is_refused(path):
        return {}
    sections = f"\n{path.read_text(encoding='utf-8')}".split("\n## ")[1:]
    parts = (section.partition("\n") for section in sections)
    return {title.strip(): MARKED_SIGN.sub("", body).strip() for title, _, body in parts}


def drawn_figures(
    figures: Mapping[str, Path], captions: Mapping[str, str]
) -> tuple[list[ShownFigure], dict[str, str]]:
    """The figures with their captions, and, by title, why each of the others is not drawn."""
    drawn: list[ShownFigure] = []
    absent: dict[str, str] = {}
    for name, path in figures.items():
        title = figure_title(name)
        caption = captions.get(title, "")
        plotted_numbers = path.with_suffix(".csv")
        if is_refused(plotted_numbers) or read_table(plotted_numbers).is_empty():
            absent[title] = caption.removeprefix(UNDRAWN).strip()
        else:
            reading = FIGURES[name].reading
            drawn.append(
                ShownFigure(name, title, caption, reading, path.read_text(encoding="utf-8"))
            )
    return drawn, absent


def compared_cells(
    row: Mapping[str, Any], of_a: Mapping[str, Any], of_b: Mapping[str, Any]
) -> dict[str, str]:
    """A row of `comparison.csv` in words, by the heads of what is printed, from the summaries of
    both campaigns."""
    ratio = number_text(row, "relative_percent")
    return {
        "quantity": label_of(row),
        f"A: {of_a.get('campaign')}": number_text(row, "mean_A"),
        f"B: {of_b.get('campaign')}": number_text(row, "mean_B"),
        "unit": row["unit"],
        "B - A": number_text(row, "difference"),
        "B over A, less 1": f"{ratio} %" if ratio else "",
        "verdict": row["verdict"] or "",
        "remark": row["remark"] or without_difference(row),
    }


def without_difference(row: Mapping[str, Any]) -> str:
    """Why a row of `comparison.csv` with numbers of both campaigns has no difference."""
    method = str(row["method"] or "")
    return method.removeprefix("none: ") if method.startswith("none: ") else ""


@dataclass(frozen=True)
class Comparison:
    """Two campaigns beside each other.

    Attributes
    ----------
    table
        The rows of `comparison.csv`.
    text
        What to print.
    """

    table: pl.DataFrame
    text: str


def number_text(row: Mapping[str, Any], name: str) -> str:
    """A number of a row with its interval in brackets; empty if it has none."""
    if row[name] is None:
        return ""
    return written(row[name], row.get(f"{name}_low"), row.get(f"{name}_high"))


def tables_to_compare(folder: Path) -> dict[str, pl.DataFrame]:
    """The tables of a campaign that are compared, by name, of those that it has, with the errors of
    its bench."""
    tables: dict[str, pl.DataFrame] = {}
    for name, columns in COMPARED_QUANTITIES.items():
        path = folder / f"tables/{name}.csv"
        if name == "walking_summary":  # a row per quantity
            columns = ("quantity", "estimator", "n", "mean", "low", "high", "commanded")
        if path.is_file() and not is_refused(path):
            tables[name] = with_evidence(path, columns)
    return tables


def remarks_on(
    a: Mapping[str, Any], b: Mapping[str, Any], tables: Sequence[Mapping[str, pl.DataFrame]]
) -> list[str]:
    """In what two summaries differ beside their numbers, or whether all numbers of their `tables`
    are the same."""
    remarks = []
    for name in ("data", "version"):
        if a.get(name) != b.get(name):
            remarks.append(f"{name}: {a.get(name)} in A, {b.get(name)} in B")
    if are_equal(*tables):
        remarks.append("A and B have the same estimates in all trials; one is a copy of the other")
    return remarks


def are_equal(a: Mapping[str, pl.DataFrame], b: Mapping[str, pl.DataFrame]) -> bool:
    """Whether two campaigns have the same tables."""
    return a.keys() == b.keys() and all(table.equals(b[name]) for name, table in a.items())


def both_summaries(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """The summaries in two folders of results. Raises InputError: as `compare_campaigns`."""
    if realpath(folders[0]) == realpath(folders[1]):
        raise InputError(
            f"{folders[1]}: A and B are the same folder; name the results of another campaign"
        )
    a, b = (read_summary(folder / "summary.json") for folder in folders)
    for name, number in a["numbers"].items():
        unit = b["numbers"].get(name, number)["unit"]
        if unit != number["unit"]:
            raise InputError(
                f"{folders[1] / 'summary.json'}: '{name}' is in {unit}, but in {number['unit']} in"
                f" {folders[0]}; run the older campaign again with this version"
            )
    return [a, b]


def compare_campaigns(
    folders: Sequence[Path], output: Path, margin: float | None = None
) -> Comparison:
    """Compare the results of two campaigns.

    Parameters
    ----------
    folders : Sequence of Path
        Those of A and B.
    output : Path
        Folder for `comparison` as .csv, .pdf, .svg and .png: all or none.
    margin : float or None
        As in `comparison_table`.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        Both are one folder, one has no summary or an older table, there is nothing to compare, or a
        number has two units.
    """
    a, b = both_summaries(folders)
    tables = [tables_to_compare(folder) for folder in folders]
    table = comparison_table(tables[0], tables[1], margin)
    if table["difference"].is_null().all():
        raise InputError(
            f"{folders[0]} and {folders[1]}: nothing to compare, no quantity is of one condition in"
            " both; run both to their end, state K_d and B_d in both sheets, or give trials that"
            " belong together one name"
        )
    table.insert_column(2, pl.Series("unit", units_of(table)))
    paths = {kind: output / f"comparison.{kind}" for kind in ("csv", "pdf", "svg", "png")}
    origins = dict.fromkeys(summary.get("data", "") for summary in (a, b))
    with ExitStack() as stack:
        new = {kind: stack.enter_context(atomic_path(path)) for kind, path in paths.items()}
        write_table(table, new["csv"], " and ".join(origins))
        footer = f"A: {sentence(a)}; B: {sentence(b)}"
        draw_figure(
            "comparison", new["csv"], [new[kind] for kind in ("pdf", "svg", "png")], origin=footer
        )
    cells = [compared_cells(row, a, b) for row in table.iter_rows(named=True)]
    rows = aligned([list(cells[0]), *(list(row.values()) for row in cells)])
    lines = [rows, "", *verdicts_in_words(table), *remarks_on(a, b, tables)]
    of_campaigns = {"A": a, "B": b}
    for name, summary in of_campaigns.items():
        lines += [f"{name}: {line}" for line in findings_lines(findings_in_summary(summary))]
    for name, summary in of_campaigns.items():
        lines += [f"{name}: {line}" for line in missing_lines(summary, reasons=True)]
    lines.append(f"wrote {', '.join(str(path) for path in paths.values())}")
    return Comparison(table, "\n".join(lines))


def units_of(comparison: pl.DataFrame) -> list[str]:
    """The unit of each row of a comparison, from the described tables."""
    columns = {table.place: table.columns for table in described_tables()}
    units = []
    for experiment, quantity in comparison.select("experiment", "quantity").iter_rows():
        units.append(columns[f"tables/{experiment}"][quantity].unit)
    return units
