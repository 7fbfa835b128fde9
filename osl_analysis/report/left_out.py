"""Which trials of a campaign are left out of its results, and why."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import polars as pl

OUTCOMES = ("refused", "failed", "died")
"""Entries of the column `check` of `excluded.csv` that are no checks: outcomes of a job."""
MOST_NAMED = 3
"""Trials that a reason names."""


@dataclass
class LeftOut:
    """Why one trial is left out."""

    refused: bool
    """Whether it is missing because a job refused or failed; False: it was excluded."""
    reasons: list[str] = field(default_factory=list)

    def say(self, reason: str) -> None:
        """Add a reason, once."""
        if reason not in self.reasons:
            self.reasons.append(reason)


def left_out_trials(
    excluded: pl.DataFrame, crossings: pl.DataFrame | None, refused: Mapping[str, str]
) -> dict[str, LeftOut]:
    """The trials that are left out, by name.

    `excluded` is `excluded.csv`, `crossings` is `walking_excluded.csv`, `refused` has the reason of each refused trial.
    """
    found: dict[str, LeftOut] = {}
    for row in excluded.iter_rows(named=True):
        by_job = row["check"] in OUTCOMES
        numbers = "" if row["value"] is None else f" {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
        reason = row["remark"] if by_job else f"{row['check']}{numbers}: {row['remark']}"
        found.setdefault(row["trial"], LeftOut(by_job)).say(reason)
    for trial, reason in refused.items():
        if trial not in found:
            found[trial] = LeftOut(True, [reason])
    for row in crossings.iter_rows(named=True) if crossings is not None else ():
        found.setdefault(row["trial"], LeftOut(False)).say(row["reason"])
    return found


def without_result(causes: list[str]) -> LeftOut:
    """A trial whose result is missing for want of other trials, which were left out."""
    named = ", ".join(causes[:MOST_NAMED]) + (f" and {len(causes) - MOST_NAMED} more" if causes[MOST_NAMED:] else "")
    because = f"{named} was refused or excluded" if len(causes) == 1 else f"{named} were refused or excluded"
    return LeftOut(True, [f"it has no result, because {because}" if causes else "it has no result"])
