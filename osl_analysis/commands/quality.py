"""Quality control: what is measured of one trial, the verdicts on all, and the list of those that are not used."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import polars as pl

from osl_analysis.exclusion import Judge
from osl_analysis.quality.checks import Commanded, QualityRules
from osl_analysis.quality.verdict import examine, measured_table
from osl_analysis.refusal import Refusal, refused_trials
from osl_analysis.table import Places, read_table, with_places, write_table
from osl_analysis.trial import Trial


def measure_trial(trial: Trial, experiment: str, commanded: Commanded, output: Path) -> None:
    """What every check measures on an ingested trial, a row each, without limits and verdicts."""
    write_table(measured_table(trial.name, examine(trial, experiment, commanded)), output)


def judge(
    rows: Sequence[Path],
    rules: QualityRules,
    accept: Mapping[str, Collection[str]],
    output: Path,
    refused: Sequence[Refusal] = (),
    places: Places | None = None,
) -> None:
    """The verdict on every trial from what was measured, with a row for each that could not be measured, and why."""
    table = Judge(rules, accept).verdicts(rows)
    table = pl.concat([table, refused_rows(refused, verdict="refused")], how="diagonal_relaxed")
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
