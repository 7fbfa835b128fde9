"""The trials of a campaign that have no result, and why."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import polars as pl

from osl_analysis.judge.exclusions import exclusion_text
from osl_analysis.judge.known_findings import CHECKS, FINDINGS

NOT_ANALYSED = "recording that could not be analysed"
UNLIKE_OTHERS = "crossing unlike the others under its conditions"
LACKS_ANOTHER = "missing trial that its fit needs"


class LeftOut(NamedTuple):
    """Why a trial has no result."""

    by_job: bool  # whether a job refused or failed; else it was excluded
    cause: str  # of the first reason, in a few words, as trials are counted by
    reasons: list[str]


def left_out_trials(
    excluded: pl.DataFrame, tables: Mapping[str, pl.DataFrame], refused: Mapping[str, str]
) -> dict[str, LeftOut]:
    """Gather the trials that are left out.

    Parameters
    ----------
    excluded : polars.DataFrame
        `excluded.csv`.
    tables : Mapping of str to polars.DataFrame
        Result tables by name, of which those of walking name excluded crossings.
    refused : Mapping of str to str
        The reason of each refused trial.

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
    of_table = set(left_out)
    for trial, reason in refused.items():
        if trial not in of_table:
            add(trial, True, NOT_ANALYSED, reason)
    crossings = tables.get("walking_crossings", pl.DataFrame(schema=["trial", "status"]))
    outliers = crossings.filter(pl.col("status") == "outlier")["trial"].to_list()
    for table, column in (("walking", "excluded"), ("walking_excluded", "reason")):
        not_used = tables.get(table, pl.DataFrame(schema=["trial", column]))
        for trial, reason in not_used.select("trial", column).rows():
            if reason:
                cause = UNLIKE_OTHERS if trial in outliers else NOT_ANALYSED
                add(trial, False, cause, reason)
    return left_out


def exclusion_cause(row: Mapping[str, Any]) -> str:
    """Why a trial is not used, in a few words, by a row of `excluded.csv`: what the sheet says, or
    the cause that its check tells."""
    if row["check"] == "sample sheet":
        return str(row["remark"])
    check = CHECKS.get(row["check"])
    return FINDINGS[check.finding].title if check else NOT_ANALYSED
