"""The thresholds of the configuration for checks of recordings, and verdicts by them on the
measured values (`ingest/examine.py`).

Measuring needs samples and no limits; judging needs a few numbers and no samples. A changed limit
only judges again.
"""

import math
from collections.abc import Collection, Mapping
from typing import Any, Literal

import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.errors import InputError, nearest
from osl_analysis.judge.known_findings import CHECKS
from osl_analysis.yaml_settings import Settings, misplaced


class Rule(Settings):
    """The threshold of one check, and what happens to a trial beyond it."""

    threshold: str  # Number and unit, as in `20 N`.
    on_failure: Literal["flag", "exclude"]
    """`flag` says so in the table of quality; `exclude` keeps the trial out of every other table
    and figure, too."""

    @property
    def limit(self) -> float:
        """The threshold without its unit."""
        return float(self.threshold.split(maxsplit=1)[0])


class QualityRules(Settings):
    """A rule per check, under the check's name."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Rule] = Field(init=False)

    @model_validator(mode="before")
    @classmethod
    def _checks_are_known(cls, content: Any) -> Any:
        names = list(content) if isinstance(content, Mapping) else []
        for name in names:
            if name not in CHECKS:
                raise misplaced(unknown_check(str(name)), name)
        return content

    @property
    def by_check(self) -> dict[str, Rule]:
        return self.__pydantic_extra__


NOT_APPLICABLE = "not applicable"  # a verdict


def unknown_check(name: str) -> str:
    return (
        f"'{name}' is no quality check; the checks are {', '.join(CHECKS)}{nearest(name, CHECKS)}"
    )


def validate_rules(rules: QualityRules, units: Mapping[str, str]) -> None:
    """Refuse rules that lack a check, or have a threshold in another unit than that of `units`, by
    check, with InputError."""
    for name in CHECKS:
        if name not in rules.by_check:
            raise InputError(
                f"configuration, quality: no rule for the check '{name}'; add it as in"
                " config/config.yaml"
            )
        threshold = rules.by_check[name].threshold
        if not is_threshold(threshold, units[name]):
            raise InputError(
                f"configuration, quality.{name}: threshold '{threshold}' must be a number from 0"
                f" and its unit, as in '1 {units[name]}'"
            )


def is_threshold(text: str, unit: str) -> bool:
    """Whether a text is a number from 0 and this unit."""
    number, _, written_unit = text.partition(" ")
    try:
        return written_unit.strip() == unit and 0 <= float(number) < math.inf
    except ValueError:
        return False


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
    of_known_checks = measured.filter(pl.col("check").is_in(list(rules.by_check)))
    for trial, name, value, unit, remark in of_known_checks.iter_rows():
        rule = rules.by_check[name]
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
