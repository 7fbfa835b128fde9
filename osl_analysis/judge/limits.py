"""The limits of the configuration: thresholds of the checks of recordings, verdicts by them on the
measured values (`ingest/examine.py`), and limits on columns of result tables.

Measuring needs samples and no limits; judging needs a few numbers and no samples. A changed limit
only judges again."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.config.experiments import judged_tables
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.errors import InputError, nearest
from osl_analysis.judge.causes import EVIDENCE, TABLE
from osl_analysis.judge.finding import Accuracy, ColumnLimits, Limit, Limits
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
        for name in content if isinstance(content, Mapping) else ():
            if name not in CHECKS:
                raise misplaced(unknown_check(str(name)), name)
        return content

    @property
    def by_check(self) -> dict[str, Rule]:
        return self.__pydantic_extra__


LARGEST_VALUES = {"VAF": 100, "R2": 1, "correlation": 1, "coherence": 1}
"""Largest values of columns whose names contain these: a percentage, or shares."""


class DoubtfulFits(Settings):
    """The accuracy that estimates need, and limits by table. The tables of `judged_tables` can have
    limits on every numeric column that no accuracy decides."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ColumnLimits] = Field(init=False)

    accuracy: Accuracy = Accuracy()  # The accuracy that K, B and I need, in all tables.
    every_table: ColumnLimits = ColumnLimits()  # Limits of all tables that have the column.

    @model_validator(mode="after")
    def _limits_are_of_tables(self) -> Self:
        columns = list[str]()
        for name in judged_tables():
            columns += numeric_columns(name)
        for limit in self.every_table.stated():
            check_limit(limit, self.every_table, columns, "every_table", "any judged table")
        for name, limits in self.__pydantic_extra__.items():
            if name not in judged_tables():
                known = f"limits may stand on {', '.join(judged_tables())}"
                raise misplaced(f"unknown table; {known}{nearest(name, judged_tables())}", name)
            for limit in limits.stated():
                check_limit(limit, limits, numeric_columns(name), name, f"tables/{name}.csv")
        return self

    def of(self, table: str) -> Limits:
        """The limits of one table: its own, and those of every table on columns that it has."""
        own = self.__pydantic_extra__.get(table, ColumnLimits())
        columns = {*numeric_columns(table)}
        shared = self.every_table
        return Limits(
            above={**with_columns_of(shared.above, columns), **own.above},
            below={**with_columns_of(shared.below, columns), **own.below},
            ratio={**with_columns_of(shared.ratio, columns), **own.ratio},
            accuracy=self.accuracy,
        )


def numeric_columns(table: str) -> list[str]:
    """The columns of a table that hold numbers."""
    described = described_tables_by_name()[table].columns.values()
    return [column.name for column in described if column.unit != "text"]


def with_columns_of(
    limits: Mapping[str, float | None], columns: Collection[str]
) -> dict[str, float | None]:
    """Those of some limits that stand on these columns."""
    return {name: limit for name, limit in limits.items() if name in columns}


def check_limit(
    limit: Limit, limits: ColumnLimits, columns: Collection[str], section: str, table: str
) -> None:
    """Raises an error at its place in the configuration: a limit stands on a column that the table
    does not have or that something else decides, contradicts another limit, or is none of such a
    column."""
    name, value = limit.column, limit.value
    side = "ratio" if name in limits.ratio else limit.side
    instead = decided_elsewhere(name)
    if instead:
        raise misplaced(f"this limit is gone: {instead}; remove the line", section, side, name)
    if name not in columns:
        message = f"{table} has no number of this name; correct it{nearest(name, columns)}"
        raise misplaced(message, section, side, name)
    if value is None:
        return
    upper = limits.above.get(name)
    if limit.side == "below" and upper is not None and value > upper:
        message = (
            f"{value:g} is above the upper limit {upper:g}, and every fit would be doubtful;"
            " correct one"
        )
        raise misplaced(message, section, side, name)
    for part, largest in LARGEST_VALUES.items():
        if part not in name or not value:
            continue
        is_too_low = limit.side == "below" and 0 < value < largest / 100
        if abs(value) > largest or is_too_low:
            kind = "percentage" if largest == 100 else "share"
            message = (
                f"{value:g} is no limit of a {kind}, which is at most {largest}; write one as"
                f" {0.9 * largest:g}"
            )
            raise misplaced(message, section, side, name)


def decided_elsewhere(column: str) -> str:
    """What decides about a column in place of a limit of its own; empty for a column that may have
    one."""
    if column not in EVIDENCE:
        return ""
    evidence = EVIDENCE[column]
    if evidence.decided_by == "accuracy":
        return f"state the accuracy that you need as doubtful.accuracy.{evidence.size}"
    if evidence.decided_by == "effect":
        return (
            "its effect on the estimates decides; state the accuracy that you need as"
            " doubtful.accuracy"
        )
    if evidence.decided_by == "sign":
        return "what cannot be negative and certainly is, is doubtful anyway"
    return ""


TOLERANCE = 1e-3  # of a threshold: clocks of 100 Hz that nobody set run at 99.99 Hz


@dataclass(frozen=True)
class Check:
    """A check of recordings, whose threshold stands in the configuration."""

    name: str
    cause: str
    fails: Literal["above", "below"] = "above"  # the side of its threshold on which it fails

    def failed(self, value: float | None, limit: float) -> bool:
        """Whether a value is beyond its threshold by more than `TOLERANCE`; NaN fails, None (not
        applicable) does not."""
        if value is None:
            return False
        tolerance = TOLERANCE * limit
        if self.fails == "below":
            return not value >= limit - tolerance
        return not value <= limit + tolerance


NOT_APPLICABLE = "not applicable"  # a verdict
CHECKS = {name: Check(name, **facts) for name, facts in TABLE["checks"].items()}


def unknown_check(name: str) -> str:
    return (
        f"'{name}' is no quality check; the checks are {', '.join(CHECKS)}{nearest(name, CHECKS)}"
    )


def validate_rules(rules: QualityRules, units: Mapping[str, str]) -> None:
    """`units` are those of the checks. Raises InputError: a check has no rule, or a threshold
    another unit."""
    for name in CHECKS:
        if name not in rules.by_check:
            raise InputError(
                f"configuration, quality: no rule for the check '{name}'; add it as in"
                " config/config.yaml"
            )
        threshold, known = rules.by_check[name].threshold, units[name]
        size, _, unit = threshold.partition(" ")
        try:
            fits = unit.strip() == known and 0 <= float(size) < math.inf
        except ValueError:
            fits = False
        if not fits:
            raise InputError(
                f"configuration, quality.{name}: threshold '{threshold}' must be a number from 0"
                f" and its unit, as in '1 {known}'"
            )


def judged_table(
    measured: pl.DataFrame, rules: QualityRules, accept: Mapping[str, Collection[str]]
) -> pl.DataFrame:
    """`measured_table` of trials with thresholds and verdicts; `accept`: checks that the sheet
    accepts, by trial. Rows of checks of an older release are left out: their trials are ingested
    again."""
    judged = []
    for trial, name, value, unit, remark in measured.filter(
        pl.col("check").is_in([*rules.by_check])
    ).iter_rows():
        rule = rules.by_check[name]
        failed, accepted = CHECKS[name].failed(value, rule.limit), name in accept.get(trial, ())
        passed = NOT_APPLICABLE if value is None else "pass"
        verdict = rule.on_failure if failed and not accepted else passed
        said = "; ".join(
            filter(None, ["accepted in the sheet" if failed and accepted else "", remark])
        )
        judged.append((trial, name, value, unit, rule.limit, verdict, said))
    order = ("trial", "check", "value", "unit", "threshold", "verdict", "remark")
    columns = dict.fromkeys(order, pl.String) | dict.fromkeys(("value", "threshold"), pl.Float64)
    return pl.DataFrame(judged, columns, orient="row")
