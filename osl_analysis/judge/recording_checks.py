"""The thresholds of the configuration for checks of recordings, and verdicts by them on the
measured values (`ingest/quality.py`).

Measuring needs samples and no limits; judging needs a few numbers and no samples. A changed limit
only judges again.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.errors import InputError, nearest
from osl_analysis.judge.known_findings import CHECKS, FINDINGS
from osl_analysis.yaml_settings import Settings, misplaced


@dataclass(frozen=True)
class Rule:
    """The threshold of one check, and what happens to a trial beyond it."""

    limit: float  # in the unit of the check
    # `flag` says so in the table of quality; `exclude` keeps the trial out of every other table and
    # figure, too
    on_failure: Literal["flag", "exclude"]


class QualityRules(Settings):
    """The threshold of each check with its unit, under the check's name, as `gap: 0.05 s`; without
    one, a single fault is beyond it."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, str] = Field(init=False)

    # Checks whose failure excludes a trial from every table and figure but that of quality.
    exclude: tuple[str, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _checks_are_known(cls, content: Any) -> Any:
        thresholds = {**content}
        for name in thresholds.pop("exclude", ()):
            if name not in CHECKS:
                raise misplaced(unknown_check(str(name)), "exclude")
        for name in thresholds:
            if name not in CHECKS:
                raise misplaced(unknown_check(str(name)), name)
        return content

    @property
    def by_check(self) -> dict[str, Rule]:
        rules = {}
        for name in CHECKS:
            limit = float(self.__pydantic_extra__.get(name, "0").partition(" ")[0])
            rules[name] = Rule(limit, "exclude" if name in self.exclude else "flag")
        return rules


NOT_APPLICABLE = "not applicable"  # a verdict


def unknown_check(name: str) -> str:
    return (
        f"'{name}' is no quality check; the checks are {', '.join(CHECKS)}{nearest(name, CHECKS)}"
    )


def validate_rules(rules: QualityRules, units: Mapping[str, str]) -> None:
    """Refuse a threshold that is no number in the unit of its check with InputError."""
    for name, threshold in (rules.__pydantic_extra__ or {}).items():
        if not re.fullmatch(rf"\d+(\.\d*)?(e-?\d+)? +{re.escape(units[name])}", threshold):
            raise InputError(
                f"configuration, quality.{name}: threshold '{threshold}' must be a number from 0"
                f" and its unit, as in '1 {units[name]}'"
            )


def spoiled_trials(verdicts: pl.DataFrame) -> dict[str, str]:
    """By trial, the finding of its first failed check beside which no estimate can be trusted."""
    spoiled: dict[str, str] = {}
    failed = verdicts.filter(pl.col("verdict").is_in(["flag", "exclude"]))
    for trial, check in failed.select("trial", "check").iter_rows():
        finding = CHECKS[check].finding
        if FINDINGS[finding].spoils_estimates:
            spoiled.setdefault(trial, finding)
    return spoiled


VERDICT_COLUMNS = {
    "trial": pl.String,
    "check": pl.String,
    "value": pl.Float64,
    "unit": pl.String,
    "threshold": pl.Float64,
    "verdict": pl.String,
    "remark": pl.String,
}


def judged_table(
    measured: pl.DataFrame, rules: QualityRules, accept: Mapping[str, Collection[str]]
) -> pl.DataFrame:
    """Judge what was measured of recordings.

    Parameters
    ----------
    measured : polars.DataFrame
        `measured_table` of trials. Rows of checks of an older release are left out: their trials
        are ingested again.
    rules : QualityRules
    accept : Mapping of str to Collection of str
        Checks that the sheet accepts, by trial.

    Returns
    -------
    polars.DataFrame
        With thresholds and verdicts, as in `quality.csv`.
    """
    rows: list[dict[str, Any]] = []
    by_check = rules.by_check
    of_known_checks = measured.filter(pl.col("check").is_in(list(by_check)))
    for trial, name, value, unit, remark in of_known_checks.iter_rows():
        rule = by_check[name]
        remarks = [remark] if remark else []
        verdict = NOT_APPLICABLE if value is None else "pass"
        if CHECKS[name].failed(value, rule.limit):
            if name in accept.get(trial, ()):
                remarks.insert(0, "accepted in the sheet")
            else:
                verdict = rule.on_failure
        rows.append({
            "trial": trial,
            "check": name,
            "value": value,
            "unit": unit,
            "threshold": rule.limit,
            "verdict": verdict,
            "remark": "; ".join(remarks),
        })  # fmt: skip
    return pl.DataFrame(rows, VERDICT_COLUMNS)
