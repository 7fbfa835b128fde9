"""The trials of a campaign that have no result, and why."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.judge.exclusions import exclusion_text
from osl_analysis.judge.known_findings import CHECKS, FINDINGS

NOT_ANALYSED = "recording that could not be analysed"
UNLIKE_OTHERS = "crossing unlike the others under its conditions"
LACKS_ANOTHER = "missing trial that its fit needs"
REASONS_OF_CROSSINGS = {"walking_crossings": "reason", "walking": "excluded"}
"""Columns of result tables that tell why a crossing is not used."""
TABLES_OF_TRIALS = {
    *REASONS_OF_CROSSINGS,
    *(table.name for experiment in EXPERIMENTS.values() for table in experiment.tables),
}
"""The tables by which `left_out_trials` knows of which trials there are results."""


class LeftOut(NamedTuple):
    """Why a trial has no result."""

    by_job: bool  # whether a job refused or failed; else it was excluded
    cause: str  # of the first reason, in a few words, as trials are counted by
    reasons: list[str]


def left_out_trials(
    sheet: Mapping[str, Mapping[str, Any]],
    excluded: pl.DataFrame,
    tables: Mapping[str, pl.DataFrame],
) -> dict[str, LeftOut]:
    """Gather the trials that are left out. All that counts trials counts by them.

    Parameters
    ----------
    sheet : Mapping of str to Mapping
        The row of every trial of the sample sheet, also of those that it excludes.
    excluded : polars.DataFrame
        `excluded.csv`, with every trial that was refused.
    tables : Mapping of str to polars.DataFrame
        Result tables by name, with those of `TABLES_OF_TRIALS` that the campaign has.

    Returns
    -------
    dict of str to LeftOut
        By trial; each reason once.
    """
    left_out: dict[str, LeftOut] = {}

    def add(trial: str, by_job: bool, cause: str, reason: str) -> None:
        reasons = left_out.setdefault(trial, LeftOut(by_job, cause, [])).reasons
        if reason not in reasons:
            reasons.append(reason)

    for row in excluded.iter_rows(named=True):
        # outcomes of a job, which are no checks
        by_job = row["check"] in ("refused", "failed")
        reason = row["remark"] if by_job else exclusion_text(row)
        add(row["trial"], by_job, exclusion_cause(row), reason)
    crossings = tables.get("walking_crossings", pl.DataFrame(schema=["trial", "status"]))
    outliers = crossings.filter(pl.col("status") == "outlier")["trial"].to_list()
    for table, column in REASONS_OF_CROSSINGS.items():
        not_used = tables.get(table, pl.DataFrame(schema=["trial", column]))
        for trial, reason in not_used.select("trial", column).rows():
            if reason:
                cause = UNLIKE_OTHERS if trial in outliers else NOT_ANALYSED
                add(trial, False, cause, reason)
    lacking = "it has no result, since a trial that its fit needs was refused or excluded"
    for trial in trials_without_result(sheet, tables):
        if trial not in left_out:
            add(trial, True, LACKS_ANOTHER, lacking)
    return left_out


def trials_without_result(
    sheet: Mapping[str, Mapping[str, Any]], tables: Mapping[str, pl.DataFrame]
) -> list[str]:
    """The trials that lack a row of a table that their fit fills."""
    names = tables.keys() & TABLES_OF_TRIALS
    trials_of = {name: {*tables[name]["trial"]} for name in names}
    without = []
    for trial, row in sheet.items():
        experiment = EXPERIMENTS[row["experiment"]]
        filled = [experiment.tables[0].name] if experiment.fit else []
        if row["experiment"] == "walking":
            filled.append("walking_crossings")
            if row.get("perturbed"):
                filled.append("walking")
        if any(trial not in trials_of.get(name, ()) for name in filled):
            without.append(trial)
    return without


def exclusion_cause(row: Mapping[str, Any]) -> str:
    """Why a trial is not used, in a few words, by a row of `excluded.csv`: what the sheet says, or
    the cause that its check tells."""
    if row["check"] == "sample sheet":
        return str(row["remark"])
    check = CHECKS.get(row["check"])
    return FINDINGS[check.finding].title if check else NOT_ANALYSED
