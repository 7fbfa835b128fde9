# SPDX-License-Identifier: Apache-2.0
"""Write the report of a run: its page, its methods section, and the lines at its end.

Example: `trace_text(summary, "K_s")` says from which files a headline number comes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.errors import (
    InputError,
    listing,
    nearest,
    printable_lines,
    without_particulars,
)
from osl_analysis.base.files import write_text
from osl_analysis.base.table import NotAnalysed, read_by_name, read_table
from osl_analysis.base.yaml_settings import FilesByName
from osl_analysis.campaign.origin import EXPERIMENTS_BY_SETTING, sentence
from osl_analysis.commands.figure import read_plotted, reasons_not_drawn
from osl_analysis.commands.tables import read_summary_file
from osl_analysis.figures.drawing import caption_of, figure_title
from osl_analysis.judge.campaign import exclusion_report, findings_in_summary
from osl_analysis.judge.findings import read_findings
from osl_analysis.judge.joining import read_joined
from osl_analysis.judge.recording_checks import BY_JOB
from osl_analysis.report import methods
from osl_analysis.report.numbers import headline_sentences, macro_name, numbers_in_summary
from osl_analysis.report.page import (
    inline_svg,
    trial_view,
    written_page,
)
from osl_analysis.report.paper_tables import conditions, groups
from osl_analysis.report.trial_signals import (
    ISOLATED,
    Signals,
    fit_signals,
    measured_response,
    recording_signals,
)
from osl_analysis.report.typography import template
from osl_analysis.report.verdicts import (
    brief_lines,
    changed_lines,
    findings_by_trial,
    left_out_trials,
    verdicts_sentence,
)
from osl_analysis.stats.rounding import significant


@dataclass(frozen=True)
class ReportFiles:
    """The results that the page shows."""

    trials: FilesByName  # recordings by trial
    series: FilesByName  # by trial, archives with signals and model on the bench
    crossings: FilesByName  # by trial
    tables: FilesByName
    figures: FilesByName  # as SVG
    verdicts: Path  # `quality.csv`
    excluded: Path
    findings: Path  # `findings.parquet`
    states: Path  # `settings.csv`
    summary: Path  # `summary.json`


def write_report(
    files: ReportFiles,
    about: Mapping[str, str],
    sheet: Mapping[str, Mapping[str, Any]],
    output: Path,
    refused: Sequence[NotAnalysed] = (),
    left_out: str = "",
) -> None:
    """Write the page of a run.

    Parameters
    ----------
    files : ReportFiles
    about : Mapping of str to str
        The origin of the results.
    sheet : Mapping of str to Mapping
        Rows of the sample sheet, also of excluded trials.
    output : Path
    refused : Sequence of NotAnalysed
        The causes of missing results.
    left_out : str
        A sentence on recordings that are not analysed.
    """
    all_findings = read_findings([files.findings])
    results = read_joined({**files.tables, "quality": files.verdicts}, all_findings)
    content = read_summary_file(files.summary)
    missing = left_out_trials(read_table(files.excluded))
    findings_of = findings_by_trial(all_findings)
    rows_of = {name: rows_by_trial(table) for name, table in results.items()}
    views = []
    for trial, row in sheet.items():
        trial_tables = {name: rows[trial] for name, rows in rows_of.items() if trial in rows}
        recordings = [named[trial] for named in (files.crossings, files.trials) if trial in named]
        views.append(
            trial_view(
                row,
                trial_tables,
                findings_of.get(trial, ()),
                missing.get(trial),
                plotted_signals(row, trial_tables, files.series.get(trial), recordings),
            )
        )
    numbers = numbers_in_summary(content)
    counts = verdicts_sentence(content["verdicts"], content["results_of_clear"])
    sentences = headline_sentences(numbers, by_condition=not content["answer"])
    texts = list(filter(None, [content["answer"], *sentences]))
    drawn, absent = drawn_figures(files.figures)
    unstated = read_table(files.states).cast(pl.String).filter(state="assumed")
    assumed = [f"{name} {value}" for name, value in unstated.select("setting", "value").rows()]
    note = f"Assumed, since nobody stated it: {', '.join(assumed)}." if assumed else ""
    condition_list = conditions(results["impedance"]) if "impedance" in results else []
    is_walking = "walking_summary" in results
    group_list = list(groups(results["walking_summary"])) if is_walking else []
    page = {
        "about": about,
        "made_of": sentence(content),
        "answer": texts[0] if texts else "",
        "sentences": [counts, *texts[1:MOST_SENTENCES]],
        "notes": [content["intervals"], left_out, note, *changed_lines(content)],
        "conditions": condition_list,
        "groups": group_list,
        "numbers": numbers,
        "findings": findings_in_summary(content),
        "trials": views,
        "figures": drawn,
        "absent_figures": absent,
        "missing_results": content["missing_results"],
    }
    write_text(output, written_page(page))


@dataclass(frozen=True)
class MethodsOutputs:
    """The text of a methods section in each format, and its references."""

    markdown: Path
    tex: Path
    bib: Path


def write_methods(
    about: Mapping[str, str],
    settings: Mapping[str, Any],
    sheet: Mapping[str, Mapping[str, Any]],
    tables: FilesByName,
    summary: Path,
    outputs: MethodsOutputs,
    captures: Sequence[Path] = (),
) -> None:
    """Write the text of a methods section.

    Parameters
    ----------
    about : Mapping of str to str
        The origin of the results.
    settings : Mapping
        The configuration.
    sheet : Mapping of str to Mapping
        The rows of the trials.
    tables : Mapping of str to Path
        Result tables, by name.
    summary : Path
        `summary.json`.
    outputs : MethodsOutputs
    captures : Sequence of Path
        Crossings; the first one has the rates of markers and plate.
    """
    facts = methods.MethodsFacts(
        about=about,
        settings=settings,
        tables=read_by_name(tables),
        sheet=list(sheet.values()),
        summary=read_summary_file(summary),
        rates_hz=rates_of(captures[0]) if captures else {},
    )
    marked = methods.paragraphs(facts)
    write_text(outputs.markdown, methods.to_markdown(marked))
    write_text(outputs.tex, methods.to_tex(marked))
    write_text(outputs.bib, methods.to_bibtex())


def rates_of(crossing: Path) -> dict[str, str]:
    """The rates [Hz] of markers and force plate of a recording, where it has them."""
    rates = {}
    for signals, begin in CAPTURED.items():
        names = [name for name in pl.read_parquet_schema(crossing) if name.startswith(begin)]
        if names:
            columns = ["time", names[0]]
            time = pl.read_parquet(crossing, columns=columns, glob=False).drop_nulls()["time"]
            if len(time) > 1:
                rates[signals] = significant(1 / float(np.median(np.diff(time.to_numpy()))), 4)
    return rates


def rows_by_trial(table: pl.DataFrame) -> dict[str, pl.DataFrame]:
    """The rows of a table by trial; none for a table without trials."""
    if "trial" not in table.columns:
        return {}
    return {rows["trial"][0]: rows for rows in table.partition_by("trial")}


WHAT_MOVES = {"actuator": "Actuator angle", "walking": "Ankle angle"}
"""Name of the moving part by experiment, where it is not the joint."""


SHOWN_COLUMNS = {"time", "torque", "theta"}  # of a recording without a fit


def plotted_signals(
    row: Mapping[str, Any],
    tables: Mapping[str, pl.DataFrame],
    series: Path | None,
    recordings: Sequence[Path],
) -> Signals | None:
    """The plotted signals of a trial; None without torque and angle.

    They are its fit, its response to a perturbation, or else the first of its `recordings` with
    rows.
    """
    motion = WHAT_MOVES.get(row["experiment"], "Joint angle")
    if series is not None:
        signals = fit_signals(read_table(series, name="series"), motion)
        if "response" in tables and "impedance" in tables:
            fit = tables["impedance"].row(-1, named=True)
            return replace(signals, response=measured_response(tables["response"], fit))
        return signals
    if "walking_responses" in tables:
        return fit_signals(tables["walking_responses"], motion, ISOLATED)
    for recording in recordings:
        shown = sorted(SHOWN_COLUMNS & pl.read_parquet_schema(recording).keys())
        # an excluded crossing has no rows
        samples = pl.read_parquet(recording, columns=shown, glob=False)
        if len(samples) and len(shown) > 1:
            return recording_signals(samples, f"{motion} (deg)")
    return None


def drawn_figures(
    figures: Mapping[str, Path],
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """The figures with their captions; and by title, the reasons for which others are not drawn."""
    drawn = []
    absent = {}
    for name, path in figures.items():
        title = figure_title(name)
        numbers = path.with_suffix(".csv")
        reasons = reasons_not_drawn(name, numbers)
        if reasons:
            absent[title] = "; ".join(reasons)
        else:
            drawing = inline_svg(name, title, path.read_text(encoding="utf-8"))
            sentences = caption_of(name, read_plotted(name, numbers))
            drawn.append({"name": name, "title": title, "caption": sentences, "drawing": drawing})
    return drawn, absent


CAPTURED = {"markers": "marker_", "the force plate": "plate"}
"""Signals of a crossing, and how their columns begin."""
MOST_SENTENCES = 3
"""Sentences at the top of the page; the first one is the answer."""
MOST_TRIALS = 12
"""Trials that are named in a line."""
REMEDY_OF_RUN = (
    "Correct these and run again. To go on without a trial, give a reason under `exclude` in the\n"
    "sample sheet; without all of these, write `failed_trials: accept` in the configuration."
)


def write_brief(
    summary: Path,
    excluded: Path,
    page: Path,
    recordings: Mapping[str, Sequence[str]],
    left_out: str,
    failed_trials: str,
    output: Path,
) -> None:
    """Write the lines at the end of a run.

    Parameters
    ----------
    summary, excluded, page
        `summary.json`, `excluded.csv` and the page.
    recordings
        The raw files of every trial of the campaign.
    left_out
        A sentence on recordings that are not analysed.
    failed_trials
        `refuse` or `accept` trials that could not be analysed.
    output
    """
    content = read_summary_file(summary)
    listed = read_table(excluded)
    by_job = listed.filter(pl.col("check").is_in(BY_JOB))
    reasons = dict(by_job.select("trial", "remark").iter_rows())
    failures = failure_lines(reasons, content["missing_results"], recordings)
    lines = [
        *brief_lines(content),
        exclusion_report(listed),
        left_out,
        *failures,
    ]
    if failures:
        accepted = "accepted: `failed_trials: accept` in the configuration"
        lines.append(accepted if failed_trials == "accept" else REMEDY_OF_RUN)
    lines.append(f"open {page} in a browser: numbers with their intervals, figures and trials")
    write_text(output, printable_lines("\n".join(filter(None, lines))) + "\n")


def failure_lines(
    reasons: Mapping[str, str],
    missing_results: Mapping[str, Any],
    recordings: Mapping[str, Sequence[str]],
) -> list[str]:
    """The lines on trials without a result, one per cause, and on missing results.

    A line names the recording, which the user can correct.
    """
    by_cause: dict[str, dict[str, str]] = {}
    for trial, reason in sorted(reasons.items()):
        files = recordings[trial]
        file = next((file for file in files if file in reason), files[0])
        text = reason.removeprefix(f"{file}: ").removeprefix(f"trial {trial}: ")
        cause = without_particulars(text.replace(file, "FILE"), trial)
        by_cause.setdefault(cause, {})[trial] = f"  trial {trial}, file {file}: {text}"
    lines = []
    if reasons:
        lines.append(f"\nNOT ANALYSED: {len(reasons)} of {len(recordings)} trials.")
    for lines_of_trial in by_cause.values():
        first, *further_trials = lines_of_trial
        also = f" (also trials {listing(further_trials, MOST_TRIALS)})" if further_trials else ""
        lines.append(lines_of_trial[first] + also)
    lines += [f"  result {file}: {reason}" for file, reason in missing_results.items()]
    return lines


# The origin of headline numbers, by the trace of `summary.json`


def trace_text(summary: Mapping[str, Any], asked: str) -> str:
    """The files, trials and settings that numbers come from, as text.

    Parameters
    ----------
    summary : Mapping
        `summary.json`.
    asked : str
        The name of a number, its macro of LaTeX, or its value as it is printed.

    Raises
    ------
    InputError
        There is no such number.
    """
    numbers = numbers_in_summary(summary)
    name = asked.lstrip("\\").removeprefix("osl")
    meant = [
        number
        for number in numbers
        if name in (number.name, macro_name(number.name), *number.texts)
    ]
    if not meant:
        names = [number.name for number in numbers]
        raise InputError(
            f"{asked}: no number of these results",
            f"name one as summary.json does, or its macro or value{nearest(asked, names)}",
        )
    trace = summary["trace"]
    texts = []
    for number in meant:
        experiments = {trace["trials"][trial]["experiment"] for trial in number.trials}
        decide = [name for name, of in EXPERIMENTS_BY_SETTING.items() if experiments & {*of}]
        settings = {
            name: value
            for name, value in summary["settings"].items()
            if name.startswith((*decide,))
        }
        facts = {"number": number, "settings": settings, "changed": changed_lines(summary)}
        texts.append(template("trace.j2").render(facts, summary=summary, trace=trace))
    return "\n\n".join(texts)
