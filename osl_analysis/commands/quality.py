"""Quality control of one trial, and the list of those that it excludes."""

from collections.abc import Collection, Mapping
from pathlib import Path

import polars as pl

from osl_analysis.quality.checks import Commanded
from osl_analysis.quality.settings import QualityRules
from osl_analysis.quality.verdict import examine, quality_table
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import read_trial


def check_trial(
    trial: Path,
    experiment: str,
    accept: Collection[str],
    rules: QualityRules,
    commanded: Commanded,
    output: Path,
) -> None:
    """Every check of an ingested trial, a row each; a failure of those in `accept` counts as passed."""
    record = read_trial(trial)
    write_table(quality_table(record.name, examine(record, experiment, commanded), rules, accept), output)


def list_excluded(verdicts: Path, by_sheet: Mapping[str, str], output: Path) -> None:
    """List the failed checks that exclude a trial, and the trials that the sheet excludes, with reasons."""
    failed = read_table(verdicts).filter(pl.col("verdict") == "exclude").drop("verdict")
    rows = [{"trial": trial, "check": "sample sheet", "remark": reason} for trial, reason in by_sheet.items()]
    stated = pl.DataFrame(rows, schema=dict.fromkeys(("trial", "check", "remark"), pl.String))
    write_table(pl.concat([failed, stated], how="diagonal_relaxed"), output)
