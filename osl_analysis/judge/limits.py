"""The limits of the configuration: thresholds of the checks of recordings, verdicts by them on the
measured values (`ingest/examine.py`), and limits on columns of result tables.

Measuring needs samples and no limits; judging needs a few numbers and no samples. A changed limit
only judges again.
"""

import math
from collections.abc import Collection, Mapping
from typing import Any, Literal, Self

import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.config.experiments import judged_tables
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.errors import InputError, nearest
from osl_analysis.judge.finding import Accuracy, ColumnLimits, Limit, Limits
from osl_analysis.judge.known_findings import CHECKS, EVIDENCE
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
        columns: list[str] = []
        for name in judged_tables():
            columns += numeric_columns(name)
        for limit in self.every_table.stated():
            check_limit(limit, self.every_table, columns, "every_table", "any judged table")
        for name, limits in self.__pydantic_extra__.items():
            if name not in judged_tables():
                tables = ", ".join(judged_tables())
                suggestion = nearest(name, judged_tables())
                raise misplaced(f"unknown table; limits may stand on {tables}{suggestion}", name)
            for limit in limits.stated():
                check_limit(limit, limits, numeric_columns(name), name, f"tables/{name}.csv")
        return self

    def of(self, table: str) -> Limits:
        """The limits of one table: its own, and those of every table on columns that it has."""
        of_table = self.__pydantic_extra__.get(table, ColumnLimits())
        columns = set(numeric_columns(table))
        shared = self.every_table
        # a limit of the table precedes one of every table
        return Limits(
            above={**on_columns(shared.above, columns), **of_table.above},
            below={**on_columns(shared.below, columns), **of_table.below},
            ratio={**on_columns(shared.ratio, columns), **of_table.ratio},
            accuracy=self.accuracy,
        )


def numeric_columns(table: str) -> list[str]:
    """The columns of a table that hold numbers."""
    described = described_tables_by_name()
    if table not in described:
        raise LookupError(f"describe tables/{table} in osl_analysis/dictionary/")
    return [column.name for column in described[table].columns.values() if column.unit != "text"]


def on_columns(
    limits: Mapping[str, float | None], columns: Collection[str]
) -> dict[str, float | None]:
    """The limits that stand on these columns."""
    return {name: limit for name, limit in limits.items() if name in columns}


def check_limit(
    limit: Limit, limits: ColumnLimits, columns: Collection[str], section: str, table: str
) -> None:
    """Refuse a limit at its place in the configuration.

    Parameters
    ----------
    limit : Limit
    limits : ColumnLimits
        All limits of its table.
    columns : Collection of str
        The table's columns of numbers.
    section : str
        The section under `doubtful`.
    table : str
        The table's name for the message.

    Raises
    ------
    PydanticCustomError
        The limit stands on a column that the table does not have or that something else decides,
        contradicts another limit, or cannot be reached by such a number.
    """
    name = limit.column
    value = limit.value
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
        return f"state the accuracy that you need as doubtful.accuracy.{evidence.share_of}"
    if evidence.decided_by == "effect":
        return (
            "its effect on the estimates decides; state the accuracy that you need as"
            " doubtful.accuracy"
        )
    if evidence.decided_by == "sign":
        return "what cannot be negative and certainly is, is doubtful anyway"
    return ""


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
