"""A trial's quality as rows of a table: each check, what it found, and what follows."""

from collections.abc import Collection

import polars as pl

from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.quality import channels, history, sampling, unloaded
from osl_analysis.quality.finding import Finding, not_applicable
from osl_analysis.quality.names import CHECKS
from osl_analysis.quality.protocol import Commanded, check_protocol
from osl_analysis.quality.settings import QualityRules
from osl_analysis.trial import Trial

ROUNDING = 1e-9  # of a threshold: 100 Hz from stamps is 99.999 999 999 97 Hz
ACCEPTED = "accepted in the sheet"


def examine(trial: Trial, experiment: str, commanded: Commanded) -> dict[str, Finding]:
    """What every check of `CHECKS` finds in a trial; `commanded` is what a stepped-sine experiment should follow."""
    samples, steps = trial.samples, sampling.sampling_steps(trial.samples)
    stepped = EXPERIMENTS[experiment].stepped_sine and "theta" in samples.columns
    return {
        "rate": sampling.check_rate(steps),
        "jitter": sampling.check_jitter(steps),
        "gap": sampling.check_gap(steps),
        "saturation": channels.check_saturation(samples),
        "stuck": channels.check_stuck(samples),
        "unzeroed_load_cell": unloaded.check_load_cell(samples, experiment),
        "unzeroed_plate": unloaded.check_plates(samples, experiment),
        "encoder_wrap": channels.check_encoder_wrap(samples),
        "marker_gap": channels.check_marker_gap(samples),
        "clock_residual": history.check_clock(trial),
        "damage": history.check_damage(trial),
        "unfinished": history.check_unfinished(trial),
        "protocol": check_protocol(*channels.signal(samples, "theta"), commanded)
        if stepped
        else not_applicable("no stepped sine"),
    }


def fails(name: str, value: float | None, limit: float) -> bool:
    """Whether a value is on the wrong side of its threshold by more than rounding; what is no number is."""
    if value is None:
        return False
    slack = ROUNDING * limit
    return not (value >= limit - slack if CHECKS[name].fails == "below" else value <= limit + slack)


def quality_table(
    trial: str, findings: dict[str, Finding], rules: QualityRules, accept: Collection[str]
) -> pl.DataFrame:
    """A row per check: trial, check, value, unit, threshold, verdict (pass, flag, exclude), remark.

    `accept` names checks whose failure the sample sheet accepts.
    """
    rows = []
    for name, finding in findings.items():
        rule, failed = rules.rule(name), fails(name, finding.value, rules.rule(name).limit)
        accepted = failed and name in accept
        remark = "; ".join(filter(None, [ACCEPTED if accepted else "", finding.remark]))
        verdict = rule.on_failure if failed and not accepted else "pass"
        found = {"trial": trial, "check": name, "value": finding.value, "unit": CHECKS[name].unit}
        rows.append({**found, "threshold": rule.limit, "verdict": verdict, "remark": remark})
    return pl.DataFrame(rows, schema_overrides={"value": pl.Float64, "threshold": pl.Float64})
