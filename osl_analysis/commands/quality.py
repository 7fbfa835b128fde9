"""Quality control of one trial, and the list of those that it excludes."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import polars as pl

from osl_analysis.quality.checks import Commanded, QualityRules
from osl_analysis.quality.verdict import examine, quality_table
from osl_analysis.refusal import Refusal, refused_trials
from osl_analysis.table import Places, read_table, with_places, write_table
from osl_analysis.trial import Trial


def check_trial(
    trial: Trial, experiment: str, accept: Collection[str], rules: QualityRules, commanded: Commanded, output: Path
) -> None:
    """Every check of an ingested trial, a row each; a failure of those in `accept` counts as passed."""
    write_table(quality_table(trial.name, examine(trial, experiment, commanded), rules, accept), output)


def tabulate(rows: Sequence[Path], output: Path, refused: Sequence[Refusal] = (), places: Places | None = None) -> None:
    """One table from the verdicts on single trials, with a row for every trial that could not be judged, and why."""
    tables = [read_table(path) for path in rows]
    table = pl.concat([*tables, refused_rows(refused, verdict="refused")], how="diagonal_relaxed")
    write_table(with_places(table, places or {}), output)


def refused_rows(refused: Sequence[Refusal], **cells: str) -> pl.DataFrame:
    """A row per refused trial, with its outcome as check and its reason and remedy as remark; `cells` are added."""
    rows = [
        {"trial": one.trial, "check": one.outcome, "remark": f"{one.reason}; {one.remedy}", **cells}
        for one in refused_trials(refused).values()
    ]
    text, empty = pl.String(), pl.Null()
    schema = {"trial": text, "check": text, "value": empty, "unit": empty, "threshold": empty}
    return pl.DataFrame(rows, schema=schema | dict.fromkeys(cells, text) | {"remark": text})


def list_excluded(
    verdicts: Path,
    by_sheet: Mapping[str, str],
    output: Path,
    refused: Sequence[Refusal] = (),
    places: Places | None = None,
) -> None:
    """List every trial that is not used, with the reason: the failed checks that exclude it, why it was refused, or
    what the sheet says.
    """
    failed = read_table(verdicts).filter(pl.col("verdict") == "exclude").drop("verdict")
    rows = [{"trial": trial, "check": "sample sheet", "remark": reason} for trial, reason in by_sheet.items()]
    stated = pl.DataFrame(rows, schema=dict.fromkeys(("trial", "check", "remark"), pl.String))
    table = pl.concat([refused_rows(refused), failed, stated], how="diagonal_relaxed")
    write_table(with_places(table.drop("joint", "side", strict=False), places or {}), output)
