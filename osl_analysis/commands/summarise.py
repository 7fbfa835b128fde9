"""The summary of a campaign: headline numbers from its tables, as JSON, LaTeX macros and a table for people."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import polars as pl
from pydantic import Field

from osl_analysis.about import About
from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.job_log import read_log
from osl_analysis.judge.findings import findings
from osl_analysis.refusal import Refusal, check_not_refused
from osl_analysis.summary.headlines import DRAFT_EXAMPLE, Example, headline_numbers, needed_columns
from osl_analysis.summary.text import (
    finding_lines,
    missing_lines,
    missing_results,
    to_columns,
    to_json,
    to_markdown,
    to_tex,
    trials_content,
)
from osl_analysis.table import read_table
from osl_analysis.yaml_settings import Settings, validated

NEEDED = ("trial", "check", "value", "unit", "threshold", "remark")  # columns of `excluded.csv`
SHOW = {"figure", "plotted_numbers", "walking_page", "report"}
"""Modules of jobs that show numbers and make none: they run beside the summary's own, and after it."""
CAPTIONS = "figures/captions.md"  # what the tables of plotted numbers show, in words; beside the metadata of the tables
REMEDY = "delete it and run `snakemake reproduce-all`"


def write_summary(
    *,
    about: About,
    table_paths: Mapping[str, Path],
    summary_json: Path,
    numbers_tex: Path,
    trials: Mapping[str, Sequence[str]] | None = None,
    excluded: Path | None = None,
    verdicts: Path | None = None,
    refused: Sequence[Refusal] = (),
    example: Example | None = None,
) -> None:
    """Write headline numbers of a campaign from the tables that it has, by their names.

    `about` says what they are made of, `example` which desired impedance Fig. 4 shows, `trials` has those of each
    experiment, `excluded` is the table of those that are not used, `verdicts` is `quality.csv`, `refused` are the
    causes of missing tables.

    Raises InputError: a table is missing, lacks a column, or has no finite mean where it lists one; neither file is
    written then.
    """
    needed = {name: needed_columns(name) for name in table_paths}
    tables = {name: read_table(table_paths[name], required=columns) for name, columns in needed.items() if columns}
    headlines = headline_numbers(tables, example or DRAFT_EXAMPLE)
    used = trials_content(trials or {}, read_table(excluded, NEEDED)) if excluded else {}
    judged = read_table(verdicts) if verdicts else pl.DataFrame(schema=["check", "verdict"])
    said = {"findings": [one.content() for one in findings(judged, tables)]}
    missing = {"trials": used, "missing_results": missing_results(refused)}
    with atomic_path(summary_json) as json_path, atomic_path(numbers_tex) as tex_path:
        json_path.write_text(to_json(about, headlines, missing | said), encoding="utf-8")
        tex_path.write_text(to_tex(about, headlines, missing_lines(missing, reasons=False)), encoding="utf-8")


def write_table_metadata(about: About, tables: Sequence[str], output: Path) -> None:
    """Say in one file what all tables are made of, as CSV on the Web (W3C, 2015) does: a table itself has only its
    column `data`, because a comment above the header stops other readers.
    """
    content = {
        "@context": ["http://www.w3.org/ns/csvw", {"@language": "en"}],
        "dc:title": f"Tables of campaign {about.campaign}",
        "dc:description": about.sentence(),
        **{f"osl:{name}": value for name, value in asdict(about).items()},
        **({"rdfs:seeAlso": {"@id": CAPTIONS}} if any(table.startswith("figures/") for table in tables) else {}),
        "tables": [{"url": table} for table in tables],
    }
    with atomic_path(output) as path:
        path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


class Number(Settings):
    """One headline number as the summary has it."""

    value: float
    unit: str
    low: float | None
    high: float | None
    interval: str | None
    n: int
    n_doubtful: int
    n_left_out: int
    doubt: str | None = None
    draft: float | None
    meaning: str
    amplitudes_low: float | None = None
    amplitudes_high: float | None = None


class Trials(Settings):
    """The trials of one experiment."""

    used: int
    of: int
    missing: dict[str, str]


class Summary(Settings):
    """The summary of a campaign."""

    campaign: str
    data: str = ""
    version: str = ""
    configuration: str = ""
    recorded: str = ""
    trials: dict[str, Trials] = Field(default_factory=dict)
    missing_results: dict[str, str] = Field(default_factory=dict)
    findings: list[dict[str, Any]] = Field(default_factory=list)
    numbers: dict[str, Number]


def read_summary(summary_json: Path) -> dict[str, Any]:
    """The summary that `write_summary` wrote.

    Raises InputError: the file is missing or is not a summary; the message names the number and what is wrong with it.
    """
    check_not_refused(summary_json)
    if not summary_json.is_file():
        there = summary_json / "summary.json"
        remedy = (
            "run `osl-analysis run` (in a clone `snakemake reproduce-all`) first, or name the folder of your results"
        )
        remedy = f"write `--summary {there}`" if there.is_file() else remedy
        raise InputError(f"{summary_json}: no such summary; {remedy}")
    try:
        content = json.loads(summary_json.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{summary_json}: not a summary ({error}); {REMEDY}") from error
    if not isinstance(content, dict):
        raise InputError(f"{summary_json}: not a summary (it holds no names); {REMEDY}")
    try:
        validated(content, Summary, summary_json)
    except InputError as error:
        raise InputError(f"{error}; {REMEDY}") from error
    return content


def format_results_table(summary: Mapping[str, Any], markdown: bool = True) -> str:
    """What a summary is made of, a table of its numbers (quantity, value, interval, n, the draft's value), what to know
    of them, and which trials and results are missing. The table is Markdown, or in aligned columns.
    """
    lines = [*finding_lines(summary), *missing_lines(summary, reasons=True)]
    missing = "".join(f"\n{line}\n" for line in lines)
    said = About(**{field.name: summary.get(field.name, "") for field in fields(About)}).sentence()
    table = (to_markdown if markdown else to_columns)(summary["numbers"])
    return f"{said}\n\n{table}{missing}"


def later_failures(summary_json: Path) -> str:
    """Whether jobs of a later run than that of a summary were refused, failed or killed; a line, empty if none were."""
    made = summary_json.stat().st_mtime
    logs = (path for path in (summary_json.parent / "logs").rglob("*.log") if path.stat().st_mtime > made)
    read = ((path.stem, read_log(path)) for path in sorted(logs))
    ended = [(name, log) for name, log in read if log and log.outcome != "done" and log.job.split(".")[0] not in SHOW]
    if not ended:
        return ""
    name, first = ended[0]
    return (
        f"OLDER THAN A FAILED RUN: after these numbers were written, {len(ended)} jobs were refused or failed, first "
        f"{name}: {first.error}; correct it and run again"
    )
