"""Result tables from the tables of single trials, and the summary with the headline numbers."""

import json
from collections.abc import Collection, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.torque_angle_tables import compared_with_repeats
from osl_analysis.campaign.configuration import FOUND
from osl_analysis.campaign.origin import sentence
from osl_analysis.config.experiments import judged_tables
from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path, write_text
from osl_analysis.judge.campaign import campaign_findings, known_of
from osl_analysis.judge.claims import Claims, claims_table
from osl_analysis.judge.exclusions import Judge
from osl_analysis.judge.finding import Limits, findings_frame, read_findings
from osl_analysis.judge.judging import judged, marked, with_inherited
from osl_analysis.judge.limits import DoubtfulFits, QualityRules
from osl_analysis.model.drivetrain import FileOrNone, joint_of, read_parameters
from osl_analysis.outcomes.job_log import read_log
from osl_analysis.refusal import Refusal, check_not_refused, refused_trials
from osl_analysis.report import headlines
from osl_analysis.report.paper_tables import PaperTable, components_table, conditions_table
from osl_analysis.stats.repeats import sizes_said
from osl_analysis.table import OF_ROW, Places, read_table, with_evidence, with_places, write_table


def gather(
    rows: Sequence[Path],
    output: Path,
    limits: Limits | None = None,
    fits: Sequence[Path] = (),
    limits_of_fits: Limits | None = None,
    places: Places | None = None,
    evidence: Path | None = None,
    evidence_columns: Collection[str] = (),
    data: str = "",
) -> None:
    """One table from the tables of single trials, in the order given; with `limits`, doubtful fits
    are marked. `rows` are their files, or the archives with a table of the same name as `output`,
    `fits` the trials' fits of the table whose doubts the rows share, with the limits of that table.
    `places` has joint and side of each. With `evidence` that file has the `evidence_columns`, and
    the table all others."""
    if not rows:
        raise InputError(f"{output}: no trials fill this table; add some to the sample sheet")
    table = pl.concat([read_table(path, of=output.stem) for path in rows], how="diagonal_relaxed")
    if output.stem == "torque_angle":
        table = compared_with_repeats(table, places or {})
    if limits is not None:
        findings = judged(table, limits, output.stem)
        if limits_of_fits is not None and fits:
            of = pl.concat([read_table(path) for path in fits], how="diagonal_relaxed")
            findings = with_inherited(
                output.stem, table, findings, of, judged(of, limits_of_fits, fits[0].parent.name)
            )
        table = marked(table, findings, output.stem)
    table = with_places(table, places or {})
    if evidence is not None:
        write_table(
            table.select(name for name in table.columns if name in evidence_columns), evidence, data
        )
        table = table.select(
            name for name in table.columns if name in OF_ROW or name not in evidence_columns
        )
    write_table(table, output, data)


def write_settings(
    states: Sequence[Mapping[str, Any]],
    output: Path,
    phasors: Path | None = None,
    refused: Sequence[Refusal] = (),
    data: str = "",
) -> None:
    """Write the settings that judge or label with their states. What was measured is that of
    `phasors.csv`, or none, also where that is `refused`."""
    table = pl.DataFrame(states, schema=dict.fromkeys(("setting", "value", "state"), pl.String))
    found = (
        read_table(phasors)
        if phasors
        else pl.DataFrame(schema=dict.fromkeys(FOUND.values(), pl.Float64))
    )
    own = {name: sizes_said(found[column].cast(pl.Float64)) for name, column in FOUND.items()}
    said = {name: f"[{', '.join(values)}]" for name, values in own.items() if values}
    measured = pl.col("setting").replace_strict(said, default=None, return_dtype=pl.String)
    table = table.with_columns(
        pl.when(state="measured").then(measured).otherwise("value").alias("value")
    )
    none = pl.when(pl.col("value").is_null()).then(pl.lit("none")).otherwise("state")
    write_table(table.with_columns(state=none), output, data)


def check_claims(
    tables: Mapping[str, Path],
    settings: Claims,
    frequencies_hz: Sequence[float],
    midstance: float | None,
    output: Path,
    parameters: FileOrNone = None,
    data: str = "",
) -> None:
    """Hold the paper's claims against the result `tables`. `midstance` is the commanded stiffness
    [N*m/rad]."""
    read = {name: read_table(path) for name, path in tables.items()}
    ratios = {joint_of(parameters): read_parameters(parameters).n_T} if parameters else {}
    write_table(claims_table(read, settings, frequencies_hz, midstance, ratios), output, data)


def judge(
    rows: Sequence[Path],
    rules: QualityRules,
    accept: Mapping[str, Collection[str]],
    output: Path,
    refused: Sequence[Refusal] = (),
    places: Places | None = None,
    data: str = "",
) -> None:
    """The verdict on every trial from what was measured, with a row for each that could not be
    measured, and why."""
    lost = refused_rows(refused).with_columns(verdict=pl.lit("refused"))
    table = pl.concat([Judge(rules, accept).verdicts(rows), lost], how="diagonal_relaxed")
    write_table(with_places(table, places or {}), output, data)


def write_findings(
    tables: Mapping[str, Path],
    verdicts: Path,
    limits: DoubtfulFits,
    output: Path,
    places: Places | None = None,
    data: str = "",
) -> None:
    """Write the findings on all trials, from the result `tables` by name and the verdicts on
    recordings."""
    read = {name: with_evidence(path) for name, path in tables.items()}
    write_table(
        with_places(campaign_findings(read, read_table(verdicts), limits), places or {}),
        output,
        data,
    )


def refused_rows(refused: Sequence[Refusal]) -> pl.DataFrame:
    """A row per refused trial, with its outcome as check and its reason and remedy as remark."""
    rows = [
        (one.trial, one.outcome, f"{one.reason}; {one.remedy}")
        for one in refused_trials(refused).values()
    ]
    told = pl.DataFrame(
        rows, schema=dict.fromkeys(("trial", "check", "remark"), pl.String), orient="row"
    )
    without = [pl.lit(None).alias(name) for name in ("value", "unit", "threshold")]
    return told.select("trial", "check", *without, "remark")


def list_excluded(
    verdicts: Path,
    by_sheet: Mapping[str, str],
    output: Path,
    refused: Sequence[Refusal] = (),
    places: Places | None = None,
    data: str = "",
) -> None:
    """List every trial that is not used: why it was refused, the checks that exclude it, or what
    the sheet says."""
    failed = (
        read_table(verdicts)
        .filter(pl.col("verdict") == "exclude")
        .drop("verdict", "joint", "side", strict=False)
    )
    rows = [(trial, "sample sheet", reason) for trial, reason in by_sheet.items()]
    stated = pl.DataFrame(
        rows, schema=dict.fromkeys(("trial", "check", "remark"), pl.String), orient="row"
    )
    table = pl.concat([refused_rows(refused), failed, stated], how="diagonal_relaxed")
    write_table(with_places(table, places or {}), output, data)


def write_summary(
    *,
    about: Mapping[str, str],
    table_paths: Mapping[str, Path],
    summary_json: Path,
    numbers_tex: Path,
    trials: Mapping[str, Sequence[str]] | None = None,
    excluded: Path | None = None,
    verdicts: Path | None = None,
    findings: Path | None = None,
    refused: Sequence[Refusal] = (),
    example: headlines.Example | None = None,
    beside_draft: bool = True,
) -> None:
    """Write headline numbers of a campaign from the tables that it has, by their names, with those
    of the paper's draft if `beside_draft`. `example` is the desired impedance of Fig. 4, `trials`
    has those of each experiment, `excluded` is the table of those that are not used, `verdicts` is
    `quality.csv`, `findings` is `findings.csv`, `refused` are the causes of missing tables."""
    read = {*headlines.LABELS, *judged_tables(), "prediction_causes"}
    tables = {name: with_evidence(path) for name, path in table_paths.items() if name in read}
    found = read_findings(findings) if findings else findings_frame()
    numbers = headlines.headline_numbers(tables, example, beside_draft)
    of_excluded = ("trial", "check", "value", "unit", "threshold", "remark")
    judged = read_table(verdicts) if verdicts else pl.DataFrame(schema=["check", "verdict"])
    missing = {
        "trials": (
            headlines.used_and_missing(trials or {}, read_table(excluded, of_excluded))
            if excluded
            else {}
        ),
        "missing_results": {
            one.file: one.reason.removeprefix(f"{one.file}: ") for one in refused if not one.trial
        },
    }
    intervals, lacks = (
        headlines.intervals_said(tables),
        headlines.missing_lines(missing, reasons=False),
    )
    said = {"intervals": intervals, "findings": known_of(found, tables, judged)}
    with atomic_path(summary_json) as json_path, atomic_path(numbers_tex) as tex_path:
        json_path.write_text(headlines.to_json(about, numbers, missing | said), encoding="utf-8")
        remarks = [intervals, *lacks] if intervals else lacks
        tex_path.write_text(headlines.to_tex(about, numbers, remarks), encoding="utf-8")


def write_conditions(table: Path, about: Mapping[str, str], tex: Path, markdown: Path) -> None:
    """Write K, B and I of each condition in `impedance.csv` as a table for a paper."""
    write_paper_table(conditions_table(with_evidence(table)), about, tex, markdown)


def write_components(
    summaries: Mapping[str, Path],
    about: Mapping[str, str],
    beside_draft: bool,
    tex: Path,
    markdown: Path,
) -> None:
    """Write the measured components as a table for a paper, with the draft's values if
    `beside_draft`."""
    tables = {name: read_table(path) for name, path in summaries.items()}
    write_paper_table(components_table(tables, beside_draft), about, tex, markdown)


def write_paper_table(
    table: PaperTable, about: Mapping[str, str], tex: Path, markdown: Path
) -> None:
    write_text(tex, table.to_tex(sentence(about)))
    write_text(markdown, table.to_markdown(sentence(about)))


def read_summary(summary_json: Path) -> dict[str, Any]:
    """The summary that `write_summary` wrote. Raises InputError where it is missing or is none."""
    check_not_refused(summary_json)
    if not summary_json.is_file():
        run = (
            "run `osl-analysis run` (in a clone `snakemake reproduce-all`) first, or name the"
            " folder of your results"
        )
        raise InputError(f"{summary_json}: no such summary; {run}")
    try:
        content: dict[str, Any] = json.loads(summary_json.read_text(encoding="utf-8"))
        for name, number in content["numbers"].items():
            value = number.get("value", 0.0)
            if not isinstance(value, int | float) or not isfinite(value):
                raise ValueError(f"numbers.{name}.value: {value!r} is not allowed")
            needed = [
                "value",
                "unit",
                "low",
                "high",
                "interval",
                "n",
                "n_doubtful",
                "n_left_out",
                "draft",
                "meaning",
            ]
            if lacking := [field for field in needed if field not in number]:
                raise ValueError(f"field 'numbers.{name}.{lacking[0]}' is missing")
    except (ValueError, RecursionError, TypeError, AttributeError, KeyError) as error:
        said = f"no field {error}" if isinstance(error, KeyError) else error
        again = "delete it and run `snakemake reproduce-all`"
        raise InputError(f"{summary_json}: not a summary ({said}); {again}") from error
    return content


def format_results_table(summary: Mapping[str, Any], markdown: bool = True) -> str:
    """What a summary is made of, its numbers as Markdown or aligned, what to know of them, and what
    is missing."""
    lines = [
        *filter(None, [summary.get("intervals")]),
        *(one["line"] for one in summary.get("findings", ())),
    ]
    lines += filter(None, [headlines.rule_of_means(summary["numbers"].values())])
    lines += headlines.missing_lines(summary, reasons=True)
    table = headlines.to_table(summary["numbers"], markdown)
    return "\n".join([f"{sentence(summary)}\n\n{table}", *(f"{line}\n" for line in lines)])


def later_failures(summary_json: Path) -> str:
    """Whether jobs of a later run than that of a summary were refused, failed or killed; a line,
    empty if none were."""
    made, ended = summary_json.stat().st_mtime, []
    for path in sorted((summary_json.parent / "logs").rglob("*.log")):
        log = read_log(path) if path.stat().st_mtime > made else None
        # jobs that show numbers and make none run after the summary's own
        if log and log["outcome"] != "done" and not log["job"].startswith(("figure.", "report.")):
            ended.append(f"{path.stem}: {log['error']}; correct it and run again")
    first = f"after these numbers were written, {len(ended)} jobs were refused or failed, first"
    return f"OLDER THAN A FAILED RUN: {first} {ended[0]}" if ended else ""
