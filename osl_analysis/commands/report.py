"""The report of a run, and the comparison of two: reads what the runs wrote, and writes one
page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl
from pydantic import TypeAdapter

from osl_analysis.campaign.origin import sentence
from osl_analysis.commands.figure import reasons_not_drawn
from osl_analysis.commands.tables import read_summary
from osl_analysis.figures import FIGURES, figure_title
from osl_analysis.files import write_text
from osl_analysis.judge.finding import read_findings
from osl_analysis.judge.summary_findings import findings_in_summary
from osl_analysis.report import methods
from osl_analysis.report.left_out import left_out_trials
from osl_analysis.report.numbers import headline_sentences, numbers_in_summary
from osl_analysis.report.page import Page, ShownFigure, trial_view, written_page
from osl_analysis.report.paper_tables import conditions, groups
from osl_analysis.report.signals import (
    ISOLATED,
    Signals,
    measured_response,
    of_fit,
    of_recording,
)
from osl_analysis.report.verdicts import findings_by_trial, verdicts_sentence
from osl_analysis.status import NotAnalysed
from osl_analysis.table import read_table, with_evidence
from osl_analysis.yaml_settings import FilesByName


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """What the page of a run is made of, and where it is written."""

    about: Mapping[str, str]
    sheet: Mapping[str, Mapping[str, Any]]  # rows of the sample sheet, also of excluded trials
    trials: FilesByName  # recordings, by trial
    series: FilesByName  # archives with signals and model of bench trials
    crossings: FilesByName
    tables: FilesByName  # result tables, by name
    figures: FilesByName  # SVG files, by name
    verdicts: Path  # `quality.csv`
    excluded: Path
    findings: Path
    states: Path  # `settings.csv`
    summary: Path
    output: Path
    refused: Sequence[NotAnalysed] = ()
    left_out: str = ""  # tells recordings that are not analysed


def write_report(**given: Any) -> None:
    """Write the page of a run from the fields of `ReportFiles`."""
    files = TypeAdapter(ReportFiles).validate_python(given)
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
    verdicts = verdicts_sentence(summary["verdicts"], summary["results_of_clear"])
    notes = [summary["intervals"], files.left_out, assumed_text(read_table(files.states))]
    drawn, absent = drawn_figures(files.figures)
    page = Page(
        about=files.about,
        made_of=sentence(files.about),
        verdict=[verdicts, *headline_sentences(numbers)],
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


def write_methods(
    about: Mapping[str, str],
    settings: Mapping[str, Any],
    sheet: Mapping[str, Mapping[str, Any]],
    tables: FilesByName,
    summary: Path,
    markdown: Path,
    tex: Path,
    bib: Path,
) -> None:
    """Write what the campaign did as the text of a methods section.

    Parameters
    ----------
    about : Mapping of str to str
        What the results are made of.
    settings : Mapping
        The configuration.
    sheet : Mapping of str to Mapping
        The rows of the trials.
    tables : Mapping of str to Path
        Result tables, by name.
    summary : Path
        `summary.json`.
    markdown, tex, bib : Path
        The files to write.
    """
    facts = methods.MethodsFacts(
        about=about,
        settings=settings,
        tables={name: with_evidence(path) for name, path in tables.items()},
        sheet=list(sheet.values()),
        summary=read_summary(summary),
    )
    marked = methods.paragraphs(facts)
    write_text(markdown, methods.to_markdown(marked))
    write_text(tex, methods.to_tex(marked))
    write_text(bib, methods.BIBTEX)


def rows_by_trial(table: pl.DataFrame) -> dict[str, pl.DataFrame]:
    """The rows of each trial of a table; none where it has no trials."""
    if "trial" not in table.columns:
        return {}
    return {rows["trial"][0]: rows for rows in table.partition_by("trial")}


MOVING = {"actuator": "Actuator angle", "walking": "Ankle angle"}
"""What moves in trials of an experiment, where it is not the joint."""


SHOWN = {"time", "torque", "theta"}  # of a recording without a fit


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
        if "response" in tables and "impedance" in tables:
            fit = tables["impedance"].row(-1, named=True)
            return replace(signals, response=measured_response(tables["response"], fit))
        return signals
    if "walking_responses" in tables:
        return of_fit(tables["walking_responses"], motion, ISOLATED)
    for recording in (files.crossings.get(trial), files.trials.get(trial)):
        if recording is None:
            continue
        shown = sorted(SHOWN & pl.read_parquet_schema(recording).keys())
        samples = pl.read_parquet(recording, columns=shown)  # none of a crossing that is excluded
        if len(samples) and len(shown) > 1:
            return of_recording(samples, f"{motion} (deg)")
    return None


def assumed_text(states: pl.DataFrame) -> str:
    """The settings of `settings.csv` that are used though nobody stated them; empty if all are."""
    assumed = states.cast(pl.String).filter(state="assumed")
    texts = [f"{name} {value}" for name, value in assumed.select("setting", "value").rows()]
    return f"Assumed, since nobody stated it: {', '.join(texts)}." if texts else ""


def drawn_figures(figures: Mapping[str, Path]) -> tuple[list[ShownFigure], dict[str, str]]:
    """The figures with their captions, and, by title, why each of the others is not drawn."""
    drawn: list[ShownFigure] = []
    absent: dict[str, str] = {}
    for name, path in figures.items():
        title = figure_title(name)
        reasons = reasons_not_drawn(name, path.with_suffix(".csv"))
        if reasons:
            absent[title] = "; ".join(reasons)
        else:
            svg = path.read_text(encoding="utf-8")
            drawn.append(ShownFigure(name, title, FIGURES[name].caption, svg))
    return drawn, absent
