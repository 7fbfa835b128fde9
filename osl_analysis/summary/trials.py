"""How many trials of each experiment the results are made of, and which ones are missing."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from osl_analysis.refusal import Refusal

SHEET = "sample sheet"
"""Entry of the column `check` of `excluded.csv` for a trial that the sheet excludes. It is not missing."""


@dataclass(frozen=True)
class TrialsUsed:
    """The trials of one experiment.

    of: number of trials in the sheet that it does not exclude.
    missing: reasons of those that are not in the results, refused or excluded by quality control, by trial.
    """

    experiment: str
    of: int
    missing: Mapping[str, str]

    @property
    def used(self) -> int:
        """Number of trials that are in the results."""
        return self.of - len(self.missing)


def trials_used(trials: Mapping[str, Sequence[str]], excluded: pl.DataFrame) -> list[TrialsUsed]:
    """The count of every experiment, from its `trials` and the table `excluded.csv`."""
    reasons: dict[str, str] = {}
    for row in excluded.filter(pl.col("check") != SHEET).iter_rows(named=True):
        reasons.setdefault(row["trial"], reason_of(row))
    return [
        TrialsUsed(experiment, len(names), {name: reasons[name] for name in names if name in reasons})
        for experiment, names in trials.items()
    ]


def reason_of(row: Mapping[str, Any]) -> str:
    """Why a row of `excluded.csv` is there: the value of the check beside its threshold, or the remark."""
    if row["value"] is None:
        return f"{row['check']}: {row['remark']}"
    return f"{row['check']} {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"


def trials_content(used: Iterable[TrialsUsed]) -> dict[str, dict[str, Any]]:
    """The counts for JSON, by experiment."""
    return {one.experiment: {"used": one.used, "of": one.of, "missing": dict(one.missing)} for one in used}


def missing_results(refused: Iterable[Refusal]) -> dict[str, str]:
    """Results over several trials that could not be computed, with the reason, by file."""
    return {one.file: one.reason.removeprefix(f"{one.file}: ") for one in refused if not one.trial}


def missing_lines(content: Mapping[str, Any], reasons: bool) -> list[str]:
    """A line per experiment with missing trials and per missing result, from the summary as it is written.

    `reasons`: with the reason of each trial.
    """
    lines = []
    for experiment, counts in content.get("trials", {}).items():
        if counts["missing"]:
            named = [f"{trial} ({why})" if reasons else trial for trial, why in counts["missing"].items()]
            lines.append(f"{counts['used']} of {counts['of']} {experiment} trials; without {', '.join(named)}")
    return lines + [f"no {file}: {why}" for file, why in content.get("missing_results", {}).items()]
