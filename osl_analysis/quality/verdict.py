"""The table of checks, what they measured on a trial, and the verdict that follows from the configured rules.

Measuring needs the samples and no limit, judging needs a few numbers and no samples: a changed limit judges again.
"""

from collections.abc import Collection, Mapping

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.quality import channels, plates, recording
from osl_analysis.quality.checks import Check, CheckResult, Commanded, Examined, QualityRules
from osl_analysis.trial import Trial

CHECKS: dict[str, Check] = {
    check.name: check
    for check in (
        *recording.SAMPLING_CHECKS,
        *channels.CHANNEL_CHECKS,
        *plates.PLATE_CHECKS,
        *recording.LOG_CHECKS,
        *recording.PROTOCOL_CHECKS,
    )
}
"""Every check by name. A new one is its function with its entry in one of these modules, its rule under `quality` in
config/config.yaml, and its test."""
ROUNDING = 1e-9  # of a threshold: 100 Hz from stamps is 99.999 999 999 97 Hz
ACCEPTED = "accepted in the sheet"


def validate_rules(rules: QualityRules) -> None:
    """Raises InputError: a check has no rule, a rule no check, or a threshold is no size in the unit of its check."""
    for name in rules.by_check:
        if name not in CHECKS:
            raise InputError(f"configuration, quality: {unknown_check(name)}")
    for name, check in CHECKS.items():
        if name not in rules.by_check:
            raise InputError(f"configuration, quality: no rule for the check '{name}'; add it as in config/config.yaml")
        threshold = rules.rule(name).threshold
        number, _, unit = threshold.partition(" ")
        if unit.strip() != check.unit or not is_size(number):
            raise InputError(
                f"configuration, quality.{name}: threshold '{threshold}' must be a number from 0 and its unit, "
                f"as in '1 {check.unit}'"
            )


def unknown_check(name: str) -> str:
    """What is wrong with the name of a check; the new name where it is an old one."""
    if name in QualityRules.RENAMED:
        return f"the check '{name}' is now called '{QualityRules.RENAMED[name]}'; rename it"
    return f"'{name}' is no quality check; the checks are {', '.join(CHECKS)}"


def is_size(text: str) -> bool:
    """Whether the text is a finite number from 0 up."""
    try:
        return 0 <= float(text) < float("inf")
    except ValueError:
        return False


def examine(trial: Trial, experiment: str, commanded: Commanded) -> dict[str, CheckResult]:
    """The result of every check on a trial, by name; `commanded` is the protocol of stepped-sine experiments."""
    examined = Examined(trial, EXPERIMENTS[experiment], commanded)
    return {name: check.result(examined) for name, check in CHECKS.items()}


def measured_table(trial: str, results: Mapping[str, CheckResult]) -> pl.DataFrame:
    """What `examine` measured, a row per check: trial, check, value, unit, remark."""
    rows = [
        {"trial": trial, "check": name, "value": result.value, "unit": CHECKS[name].unit, "remark": result.remark}
        for name, result in results.items()
    ]
    return pl.DataFrame(rows, schema_overrides={"value": pl.Float64})


def judged_table(measured: pl.DataFrame, rules: QualityRules, accept: Mapping[str, Collection[str]]) -> pl.DataFrame:
    """`measured_table` of trials with thresholds and verdicts; `accept`: checks that the sheet accepts, by trial."""
    judged = []
    for row in measured.iter_rows(named=True):
        name, rule = row["check"], rules.rule(row["check"])
        failed, accepted = fails(name, row["value"], rule.limit), name in accept.get(row["trial"], ())
        verdict = rule.on_failure if failed and not accepted else "pass"
        remark = "; ".join(filter(None, [ACCEPTED if failed and accepted else "", row["remark"]]))
        judged.append({**row, "threshold": rule.limit, "verdict": verdict, "remark": remark})
    types = dict.fromkeys(("value", "threshold"), pl.Float64)
    order = ("trial", "check", "value", "unit", "threshold", "verdict", "remark")
    return pl.DataFrame(judged, schema={name: types.get(name, pl.String()) for name in order})


def quality_table(
    trial: str, results: Mapping[str, CheckResult], rules: QualityRules, accept: Collection[str]
) -> pl.DataFrame:
    """`judged_table` of the results of one trial."""
    return judged_table(measured_table(trial, results), rules, {trial: accept})


def fails(name: str, value: float | None, limit: float) -> bool:
    """Whether a value is beyond its threshold by more than rounding; NaN fails, None (not applicable) does not."""
    if value is None:
        return False
    slack = ROUNDING * limit
    return not (value >= limit - slack if CHECKS[name].fails == "below" else value <= limit + slack)
