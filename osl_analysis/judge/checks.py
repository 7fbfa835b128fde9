"""The verdicts on recordings: what was measured of them (`ingest/examine.py`) against the configured rules."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import polars as pl

from osl_analysis.errors import InputError, nearest
from osl_analysis.judge.causes import TABLE
from osl_analysis.judge.limits import QualityRules


@dataclass(frozen=True)
class Check:
    """A check of recordings, whose threshold stands in the configuration."""

    name: str
    cause: str
    fails: Literal["above", "below"] = "above"  # the side of its threshold on which it fails

    def failed(self, value: float | None, limit: float) -> bool:
        """Whether a value is beyond its threshold by more than rounding; NaN fails, None (not applicable) does not."""
        if value is None:
            return False
        slack = 1e-9 * limit  # 100 Hz from stamps is 99.999 999 999 97 Hz
        return not (value >= limit - slack if self.fails == "below" else value <= limit + slack)


CHECKS = {name: Check(name, **facts) for name, facts in TABLE["checks"].items()}


def unknown_check(name: str) -> str:
    return f"'{name}' is no quality check; the checks are {', '.join(CHECKS)}{nearest(name, CHECKS)}"


def validate_rules(rules: QualityRules, units: Mapping[str, str]) -> None:
    """`units` are those of what the checks measure. Raises InputError: a check has no rule, a rule no check, or a
    threshold is no size in the unit of its check."""
    for name in (*rules.by_check, *CHECKS):
        if name not in CHECKS:
            raise InputError(f"configuration, quality: {unknown_check(name)}")
        if name not in rules.by_check:
            raise InputError(f"configuration, quality: no rule for the check '{name}'; add it as in config/config.yaml")
        threshold, known = rules.by_check[name].threshold, units[name]
        size, _, unit = threshold.partition(" ")
        try:
            fits = unit.strip() == known and 0 <= float(size) < math.inf
        except ValueError:
            fits = False
        if not fits:
            raise InputError(
                f"configuration, quality.{name}: threshold '{threshold}' must be a number from 0 and its unit, "
                f"as in '1 {known}'"
            )


def judged_table(measured: pl.DataFrame, rules: QualityRules, accept: Mapping[str, Collection[str]]) -> pl.DataFrame:
    """`measured_table` of trials with thresholds and verdicts; `accept`: checks that the sheet accepts, by trial."""
    judged = []
    for trial, name, value, unit, remark in measured.iter_rows():
        rule = rules.by_check[name]
        failed, accepted = CHECKS[name].failed(value, rule.limit), name in accept.get(trial, ())
        verdict = rule.on_failure if failed and not accepted else "pass"
        said = "; ".join(filter(None, ["accepted in the sheet" if failed and accepted else "", remark]))
        judged.append((trial, name, value, unit, rule.limit, verdict, said))
    order = ("trial", "check", "value", "unit", "threshold", "verdict", "remark")
    columns = dict.fromkeys(order, pl.String) | dict.fromkeys(("value", "threshold"), pl.Float64)
    return pl.DataFrame(judged, columns, orient="row")
