"""The limits of the configuration: thresholds of the checks of recordings, verdicts by them on the
measured values (`ingest/examine.py`), and limits on columns of result tables.

Measuring needs samples and no limits; judging needs a few numbers and no samples. A changed limit
only judges again."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.config.experiments import judged_tables
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.errors import InputError, nearest
from osl_analysis.judge.causes import TABLE
from osl_analysis.judge.finding import Limits
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
    """A rule per check, under the check's name; `validate_rules` compares them with the checks."""

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


class DoubtfulFits(Settings):
    """Limits by table. The tables of `judged_tables` can have limits on every numeric column."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Limits] = Field(init=False)

    @model_validator(mode="after")
    def _tables_are_judged(self) -> Self:
        tables, largest = (
            described_tables_by_name(),
            {"VAF": 100, "R2": 1, "correlation": 1, "coherence": 1},
        )
        for name, limits in self.__pydantic_extra__.items():
            if name not in judged_tables():
                known = f"limits may stand on {', '.join(judged_tables())}"
                raise misplaced(f"unknown table; {known}{nearest(name, judged_tables())}", name)
            numbers = [
                column.name for column in tables[name].columns.values() if column.unit != "text"
            ]
            for end, column, limit in limits.stated():
                if column not in numbers:
                    said = (
                        f"tables/{name}.csv has no number of this name; correct"
                        f" it{nearest(column, numbers)}"
                    )
                    raise misplaced(said, name, end, column)
                most = next((n for one, n in largest.items() if one in column), 0)
                if (
                    end == "below"
                    and limit is not None
                    and limit > (high := limits.above.get(column) or np.inf)
                ):
                    said = (
                        f"{limit:g} is above the upper limit {high:g}, and every fit would be"
                        " doubtful; correct one"
                    )
                    raise misplaced(said, name, end, column)
                if (
                    limit
                    and most
                    and (abs(limit) > most or (end == "below" and 0 < limit < most / 100))
                ):
                    of = f"a {'percentage' if most == 100 else 'share'}, which is at most {most}"
                    raise misplaced(
                        f"{limit:g} is no limit of {of}; write one as {0.9 * most:g}",
                        name,
                        end,
                        column,
                    )
        return self

    def of(self, table: str) -> Limits:
        return self.__pydantic_extra__.get(table, Limits())


@dataclass(frozen=True)
class Check:
    """A check of recordings, whose threshold stands in the configuration."""

    name: str
    cause: str
    fails: Literal["above", "below"] = "above"  # the side of its threshold on which it fails

    def failed(self, value: float | None, limit: float) -> bool:
        """Whether a value is beyond its threshold by more than rounding; NaN fails, None (not
        applicable) does not."""
        if value is None:
            return False
        slack = 1e-9 * limit  # 100 Hz from stamps is 99.999 999 999 97 Hz
        return not (value >= limit - slack if self.fails == "below" else value <= limit + slack)


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
