"""The trials of a campaign that have no result, and why."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.judge.recording_checks import exclusion_text

OF_CROSSINGS = ("walking_crossings", "walking")
"""Tables whose column `reason` tells why a crossing is not used."""


class LeftOut(NamedTuple):
    """Why a trial has no result."""

    by_job: bool  # whether a job refused or failed; else it was excluded
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
        Result tables by name, all that the campaign has.

    Returns
    -------
    dict of str to LeftOut
        By trial; each reason once.
    """
    left_out: dict[str, LeftOut] = {}

    def add(trial: str, by_job: bool, reason: str) -> None:
        reasons = left_out.setdefault(trial, LeftOut(by_job, [])).reasons
        if reason not in reasons:
            reasons.append(reason)

    for row in excluded.iter_rows(named=True):
        by_job = row["check"] == "refused"  # which is no check
        reason = row["remark"] if by_job else exclusion_text(row)
        add(row["trial"], by_job, reason)
    for table in OF_CROSSINGS:
        not_used = tables.get(table, pl.DataFrame(schema=["trial", "reason"]))
        for trial, reason in not_used.select("trial", "reason").rows():
            if reason:
                add(trial, False, reason)
    lacking = "it has no result, since a trial that its fit needs was refused or excluded"
    for trial in trials_without_result(sheet, tables):
        if trial not in left_out:
            add(trial, True, lacking)
    return left_out


def trials_without_result(
    sheet: Mapping[str, Mapping[str, Any]], tables: Mapping[str, pl.DataFrame]
) -> list[str]:
    """The trials that lack a row of a table that their fit fills."""
    trials_of = {name: {*table["trial"]} for name, table in tables.items() if "trial" in table}
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


def used_and_missing(
    sheet: Mapping[str, Mapping[str, Any]], left_out: Mapping[str, LeftOut]
) -> dict[str, dict[str, Any]]:
    """By experiment: number `of` trials in the sheet, number `used`, and why others are
    `missing`."""
    by_experiment: dict[str, dict[str, Any]] = {}
    for experiment in EXPERIMENTS:
        trials = [trial for trial, row in sheet.items() if row["experiment"] == experiment]
        missing = {trial: left_out[trial].reasons[0] for trial in trials if trial in left_out}
        used = len(trials) - len(missing)
        if trials:
            by_experiment[experiment] = {"used": used, "of": len(trials), "missing": missing}
    return by_experiment


def missing_lines(content: Mapping[str, Any]) -> list[str]:
    """A line per experiment with missing trials and their reasons, and per missing result."""
    lines = []
    for experiment, counts in content["trials"].items():
        trials = [f"{trial} ({reason})" for trial, reason in counts["missing"].items()]
        if trials:
            used = f"{counts['used']} of {counts['of']} {experiment} trials"
            lines.append(f"{used}; without {', '.join(trials)}")
    for file, reason in content["missing_results"].items():
        lines.append(f"no {file}: {reason}")
    return lines
