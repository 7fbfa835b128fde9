# SPDX-License-Identifier: Apache-2.0
"""Make result tables from tables of single trials, judge them, and write the summary.

Example: `gather([Path("fits/belt/b_1.csv")], "belt")`.
"""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.base.errors import InputError, listing
from osl_analysis.base.files import atomic_path, write_text
from osl_analysis.base.table import (
    NOT_ANALYSED,
    SCHEMA_FIELD,
    NotAnalysed,
    Places,
    by_trial,
    check_analysed,
    check_schema,
    read_by_name,
    read_table,
    read_tables,
    with_places,
    write_table,
)
from osl_analysis.base.yaml_settings import FilesByName
from osl_analysis.campaign.campaign_trials import code, digest_of, trace
from osl_analysis.campaign.origin import sentence
from osl_analysis.config.experiments import EXPERIMENTS, JUDGED_TABLES
from osl_analysis.dictionary.described import described_tables, described_tables_by_name
from osl_analysis.judge.campaign import (
    campaign_findings,
    causes_in_campaign,
    findings_in_summary,
    table_findings,
)
from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.claims import claims_table, read_claims
from osl_analysis.judge.findings import findings_table, read_findings, view_of
from osl_analysis.judge.joining import findings_of_rows, judged_as, read_joined, with_texts
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.recording_checks import (
    BY_SHEET,
    CROSSING,
    LACKING,
    REFUSED,
    QualityRules,
    read_verdicts,
)
from osl_analysis.model.drivetrain import known_parameters
from osl_analysis.report.listed_numbers import LISTED_NUMBERS
from osl_analysis.report.numbers import (
    headline_numbers,
    macros_tex,
    numbers_in_summary,
    to_json,
)
from osl_analysis.report.paper_tables import (
    HALF_WIDTH_OF_MEAN,
    WIDTHS,
    component_rows,
    condition_rows,
    conditions,
    groups,
    interval_rows,
    markdown_for_paper,
    notes_on_conditions,
    notes_on_groups,
    tex_for_paper,
)
from osl_analysis.report.typography import aligned, markdown_table
from osl_analysis.report.verdicts import (
    answer,
    left_out_trials,
    missing_lines,
    serving_trials,
    trials_without_result,
    used_and_missing,
    verdict_counts,
)
from osl_analysis.walking.groups import LEFT_OUT


def gather(
    rows: Sequence[Path],
    name: str,
    findings: Sequence[Path] = (),
    places: Places | None = None,
    not_analysed: Sequence[NotAnalysed] = (),
) -> pl.DataFrame:
    """One table from the tables of single trials, in the order given.

    Parameters
    ----------
    rows : Sequence of Path
        The files of single trials, or archives with a table of this name.
    name : str
    findings : Sequence of Path
        The findings on the rows; none for a table that is not judged.
    places : Places or None
        Joint and side of each trial.
    not_analysed : Sequence of NotAnalysed
        Trials that get a row without estimates, in the table of their fits.
    """
    table = with_places(read_tables(rows, name), places)
    if judged_as(name) in JUDGED_TABLES:
        findings_by_row = findings_of_rows(table, read_findings(findings), name)
        table = with_texts(table, findings_by_row, name)
    table = table.drop(unpublished(table, name), strict=False)
    if "status" in table.columns:
        without = rows_of_reasons(by_trial(not_analysed), NOT_ANALYSED)
        without = without.rename({"check": "status", "remark": "reason"})
        table = pl.concat([table, without], how="diagonal_relaxed")
    return table


def unpublished(table: pl.DataFrame, name: str) -> list[str]:
    """Columns of single trials that the table over trials leaves out.

    They are those that findings alone read, and shared errors of the bench where none is stated.
    """
    bench_columns = [column for column in table.columns if column.endswith("_se_bench")]
    unstated = [column for column in bench_columns if not (table[column] > 0).any()]
    return [*described_tables_by_name()[name].of_fits, *unstated]


def list_settings(states: Sequence[Mapping[str, Any]]) -> pl.DataFrame:
    """The settings that judge or label with their states, `settings.csv`."""
    columns = dict.fromkeys(("setting", "value", "default", "state"), pl.String)
    return pl.DataFrame(states, schema=columns)


def check_claims(tables: FilesByName, claims: Path, findings: Sequence[Path] = ()) -> pl.DataFrame:
    """`claims.csv`: the claims of a file, compared with the result `tables`. Estimates that are
    doubtful by the `findings` do not count."""
    return claims_table(read_joined(tables, read_findings(findings)), read_claims(claims))


def judge(
    rows: Sequence[Path],
    rules: QualityRules,
    accept: Mapping[str, Collection[str]],
    refused: Sequence[NotAnalysed] = (),
    places: Places | None = None,
) -> pl.DataFrame:
    """`quality.csv`: the verdicts on the checks of all trials. A trial that could not be measured
    has one row with the reason."""
    verdicts = read_verdicts(rows, rules, accept)
    not_measured = rows_of_reasons(by_trial(refused), "refused")
    not_measured = not_measured.with_columns(verdict=pl.lit("refused"))
    table = pl.concat([verdicts, not_measured], how="diagonal_relaxed")
    return with_places(table, places)


def judge_table(
    name: str,
    limits: Limits,
    rows: Sequence[Path] = (),
    budget: Sequence[Path] = (),
    faults: Mapping[str, str] | None = None,
    places: Places | None = None,
) -> pl.DataFrame:
    """The findings on the fits, or groups of crossings, that are the rows of one table.

    Parameters
    ----------
    name : str
    limits : Limits
        Accuracy and limits of the configuration on this table.
    rows : Sequence of Path
        The files with its rows; none where all trials are refused, which have no findings.
    budget : Sequence of Path
        The files with the budgets of the estimates.
    faults : Mapping of str to str or None
        By trial, the source of a failed check, which names the cause of a doubt.
    places : Places or None
        Joint and side of each trial.
    """
    if not rows:
        return findings_table([])
    table = with_places(read_tables(rows, name), places)
    contributions = read_tables(budget, "budget") if budget else None
    return findings_table(table_findings(table, limits, name, faults, contributions))


def gather_findings(
    table_findings_files: Sequence[Path],
    verdicts: Path,
    findings: Path,
    view: Path,
    calibration: Sequence[Path] = (),
    refused: Sequence[NotAnalysed] = (),
    data: str = "",
) -> None:
    """Write the findings of the campaign, on its tables and on failed checks of recordings.

    Parameters
    ----------
    table_findings_files : Sequence of Path
        The files that `judge_table` wrote.
    verdicts : Path
        `quality.csv`.
    findings, view : Path
        `findings.parquet`, which decides, and `findings.csv`, which people read.
    calibration : Sequence of Path
        `calibration.csv`, if the campaign has recorded a known spring or inertia.
    refused : Sequence of NotAnalysed
        Refused fits. Other flags of such a recording are left out: they may follow from the cause
        of the refusal, as a slow clock follows from a wrong unit.
    data : str
        Whether the recordings are simulated or measured.
    """
    is_refused = pl.col("trial").is_in(list(by_trial(refused)))
    used = read_table(verdicts).filter(~is_refused | (pl.col("verdict") == "exclude"))
    findings_of_campaign = campaign_findings(
        read_findings(table_findings_files), used, is_calibrated=bool(calibration)
    )
    table = findings_table(findings_of_campaign)
    write_table(table, findings)
    write_table(view_of(table), view, data)


def rows_of_reasons(reasons: Mapping[str, str], check: str) -> pl.DataFrame:
    """A row per trial, with the reason for which it is not used as `remark`."""
    rows = [(trial, check, reason) for trial, reason in reasons.items()]
    columns = dict.fromkeys(("trial", "check", "remark"), pl.String)
    return pl.DataFrame(rows, schema=columns, orient="row")


def list_excluded(
    tables: FilesByName,
    verdicts: Path,
    sheet: Mapping[str, Mapping[str, Any]],
    refused: Sequence[NotAnalysed] = (),
    places: Places | None = None,
) -> pl.DataFrame:
    """`excluded.csv`: every trial that is not used, with its reasons.

    A reason is a refusal, a check that excludes the trial, a cell of the sheet, or the lack of
    another trial. All counts of trials use this table.
    """
    results = read_by_name(tables)
    reason_of_crossing = dict[str, str]()
    for table in results.keys() & {"walking_crossings", "walking"}:
        results[table] = results[table].filter(pl.col("status") != LEFT_OUT)
        unused = results[table].drop_nulls("reason")
        reason_of_crossing.update(unused.select("trial", "reason").iter_rows())
    failed = read_table(verdicts).filter(verdict="exclude")
    failed = failed.drop("verdict", "joint", "side", strict=False)
    by_sheet = {trial: row["exclude"] for trial, row in sheet.items() if row["exclude"]}
    parts = [
        failed.clear(),  # with the columns in their order
        rows_of_reasons(by_trial(refused), REFUSED),
        failed,
        rows_of_reasons(by_sheet, BY_SHEET),
        rows_of_reasons(reason_of_crossing, CROSSING),
    ]
    left_out = {trial for part in parts for trial in part["trial"]}
    needed = [trial for trial in serving_trials(sheet) if trial in left_out]
    causes = needed or [cause.text for cause in refused if not cause.trial]
    why = f"it has no result, since what its fit needs was refused or excluded: {listing(causes)}"
    without = dict.fromkeys(trials_without_result(sheet, results), why)
    parts.append(rows_of_reasons(without, LACKING))
    listed = pl.concat(parts, how="diagonal_relaxed")
    # a consequence of another cause is no cause
    follows = pl.col("check").is_in([CROSSING, LACKING])
    listed = listed.filter(~follows | pl.col("trial").is_first_distinct())
    return with_places(listed, places)


@dataclass(frozen=True)
class HeadlineFiles:
    """The results that headline numbers come from."""

    tables: FilesByName  # tables that the campaign has
    trials: Sequence[Path]  # as Parquet, which have the digests of recordings
    excluded: Path
    verdicts: Path  # `quality.csv`
    findings: Path  # `findings.parquet`


@dataclass(frozen=True)
class HeadlineFacts:
    """The facts that a summary states beside its numbers."""

    about: Mapping[str, str]  # origin of the numbers
    beside_draft: bool  # whether the numbers of the paper's draft stand beside them
    settings: Mapping[str, str]  # that results depend on, by dotted name
    stated: Mapping[str, str | None]  # digests of the files with statements
    # settings that decide verdicts and differ from the shipped defaults
    changed: Sequence[Mapping[str, Any]]


def write_summary(
    files: HeadlineFiles,
    facts: HeadlineFacts,
    sheet: Mapping[str, Mapping[str, Any]],
    summary_json: Path,
    numbers_tex: Path,
    refused: Sequence[NotAnalysed] = (),
) -> None:
    """Write the summary of a campaign: headline numbers, verdicts, findings and their origin.

    Parameters
    ----------
    files : HeadlineFiles
    facts : HeadlineFacts
    sheet : Mapping of str to Mapping
        The row of every trial of the sample sheet, also of those that it excludes.
    summary_json, numbers_tex : Path
        The files to write, both or none.
    refused : Sequence of NotAnalysed
        The causes of missing tables.
    """
    all_findings = read_findings([files.findings])
    tables = read_joined(files.tables, all_findings)
    numbers = list(headline_numbers(tables, facts.beside_draft))
    left_out = left_out_trials(read_table(files.excluded))
    missing_files = [cause.reason.partition(": ") for cause in refused if not cause.trial]
    verdict_count, results_of_clear = verdict_counts(sheet, all_findings, left_out)
    findings_told = causes_in_campaign(all_findings, tables, read_table(files.verdicts))
    experiments = {name: row["experiment"] for name, row in sheet.items()}
    decides = trace(facts.stated, files.trials, experiments)
    about = {**facts.about, "digest": digest_of([facts.stated, decides["recordings"], code()])}
    content = {
        "trials": used_and_missing(sheet, left_out),
        "verdicts": verdict_count,
        "results_of_clear": results_of_clear,
        "answer": answer(tables),
        "missing_results": {file: reason for file, _, reason in missing_files},
        "intervals": intervals_text(tables),
        "findings": [vars(finding) for finding in findings_told],
        "settings": facts.settings,
        "changed": facts.changed,
        "trace": decides,
    }
    with atomic_path(summary_json) as json_path, atomic_path(numbers_tex) as tex_path:
        json_path.write_text(to_json(about, numbers, content), encoding="utf-8")
        tex_path.write_text(macros_tex(about, numbers, missing_lines(content)), encoding="utf-8")


def write_paper_table(
    tables: FilesByName,
    parameters: Path | None,
    about: Mapping[str, str],
    beside_draft: bool,
    tex: Path,
    markdown: Path,
    findings: Sequence[Path] = (),
) -> None:
    """Write a table for a paper, by the first of these that `tables` has.

    `budget.csv` gives the parts of intervals; `impedance.csv` K, B and I of each condition;
    `walking_summary.csv` those of each group. Else it is the components, of summaries of the bench
    and of the parameter file, with the draft's values if `beside_draft`. Estimates that are
    doubtful by the `findings` are marked, and in no mean.
    """
    read = read_joined(tables, read_findings(findings))
    if "budget" in read:
        notes = [WIDTHS]
        means = [table for name, table in read.items() if name.endswith("_summary")]
        rows = interval_rows(read["budget"], read.get("impedance", pl.DataFrame()), means)
    elif "impedance" in read:
        condition_list = conditions(read["impedance"])
        rows = condition_rows(condition_list)
        notes = notes_on_conditions(condition_list)
    elif "walking_summary" in read:
        group_list = list(groups(read["walking_summary"]))
        rows = condition_rows(group_list)
        notes = notes_on_groups(group_list)
    else:
        known = known_parameters(parameters, [])
        components = {} if known is None else asdict(known)
        components = {name: value for name, value in components.items() if math.isfinite(value)}
        if "actuator_summary" in read and "n_m" in components:
            product = read["actuator_summary"].filter(quantity="k_tau_n_m")
            shares = pl.col("mean", "low", "high") / components["n_m"]
            read["k_tau"] = product.with_columns(shares, quantity=pl.lit("k_tau"))
        rows = component_rows(read, components, beside_draft)
        notes = [HALF_WIDTH_OF_MEAN]
    made_of = sentence(about)
    write_text(tex, tex_for_paper(rows, made_of, notes))
    write_text(markdown, markdown_for_paper(rows, made_of, notes))


FITTED_ON_BENCH = {facts.tables[0].name for facts in EXPERIMENTS.values() if facts.place == "bench"}
"""The tables of fits on the bench."""


def intervals_text(tables: Mapping[str, pl.DataFrame]) -> str:
    """A sentence on the errors of calibration in the intervals of the bench."""
    bench_tables = tables.keys() & FITTED_ON_BENCH
    if not bench_tables:
        return ""
    columns = {column for name in bench_tables for column in tables[name].columns}
    if any(column.endswith("_se_bench") for column in columns):
        return "Of the bench's calibration, intervals contain only what is stated."
    return "Intervals on the bench have no errors that all trials share."


def read_summary_file(summary_json: Path) -> dict[str, Any]:
    """Read the summary that `write_summary` wrote. Raises InputError where it is missing, damaged
    or of another release."""
    check_analysed(summary_json)
    if not summary_json.is_file():
        raise InputError(
            f"{summary_json}: no such summary",
            "run `osl-analysis run` (in a clone `snakemake reproduce-all`) first, or name the"
            " folder of your results",
        )
    try:
        content: dict[str, Any] = json.loads(summary_json.read_text(encoding="utf-8"))
        check_schema(content.get(SCHEMA_FIELD), summary_json, content.get("version"))
        numbers_in_summary(content)
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise InputError(
            f"{summary_json}: not a summary ({error})", "delete it and run `osl-analysis run`"
        ) from error
    return content


def format_results_table(summary: Mapping[str, Any], markdown: bool) -> str:
    """A summary as text: origin, numbers as Markdown or aligned columns, findings, and missing
    results."""
    rows = [("quantity", "value", "interval", "n", "draft")]
    for number in numbers_in_summary(summary):
        draft = "" if number.draft is None else f"{number.draft:g}"
        value = f"{number.text} {number.unit}"
        rows.append((number.meaning, value, number.kind or "", str(number.n), draft))
    table = markdown_table(rows) if markdown else aligned(rows)
    lines = [summary["intervals"], *(finding.sentence for finding in findings_in_summary(summary))]
    lines += missing_lines(summary)
    return "\n\n".join([sentence(summary), table, *filter(None, lines)])


def columns_text() -> str:
    """Unit and meaning of every column of every table, of every check and of every headline
    number."""
    sections = []
    for table in described_tables():
        for file, rows, columns in table.sections:
            lines = [(column.name, column.unit, column.meaning) for column in columns]
            sections.append(f"{file}: {rows}\n\n{aligned(lines)}")
    checks = [
        (name, check.unit, f"{check.meaning}. Fails {check.fails} its threshold")
        for name, check in CHECKS.items()
    ]
    sections.append(f"checks of quality control\n\n{aligned(checks)}")
    numbers = [(entry.name, entry.unit, entry.meaning) for entry in LISTED_NUMBERS]
    sections.append(f"numbers in summary.json\n\n{aligned(numbers)}")
    return "\n".join(sections)
