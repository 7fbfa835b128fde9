"""What is measured on a whole recording: its sampling, its clocks, damage to its log, the motion that was commanded;
and the verdicts of all checks by the rules of the configuration.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import InputError
from osl_analysis.judge.channels import CHANNEL_CHECKS, not_applicable, worst
from osl_analysis.judge.table import Cause, Check, CheckResult, Commanded, Examined, QualityRules
from osl_analysis.protocol.stepped_sine import FEWEST_OF_A_RUN, Likeness, Run, SteppedSineProtocol, find_runs
from osl_analysis.timebase.grid import GapLimits, devices_of, streams, uniform_signals
from osl_analysis.timebase.samples import take
from osl_analysis.trial import Trial

TOO_FEW = "no channel has three samples"


def measure_rate(examined: Examined) -> CheckResult:
    """Lowest median sampling rate [Hz]; the remark has the rate of every recorder."""
    if not examined.steps:
        return not_applicable(TOO_FEW)
    rates = {column: 1 / float(np.median(step)) for column, step in examined.steps.items()}
    return CheckResult(min(rates.values()), ", ".join(f"{column} {rate:.6g} Hz" for column, rate in rates.items()))


def measure_jitter(examined: Examined) -> CheckResult:
    """Largest slow wander [%] of a recorder's stamps about their line, in steps, where nothing decides what it is. 0
    where the stamps lie on their line, or where signals or the source file decide (docs/time_base.md): scatter of any
    size then costs nothing. The remark has each recorder's scatter and the decision."""
    wander, remarks = {}, []
    columns = [column for column in examined.experiment.needed_columns if column in examined.samples.columns]
    try:
        parts = take(streams(examined.trial, devices_of(examined.trial, columns), frozenset()))
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    for part in parts:
        open_question = part.matters and not part.firm
        name, step = ", ".join(part.signals), part.clock.step
        wander[name] = 100 * part.clock.wander / step if open_question else 0.0
        if part.matters:
            remarks.append(f"{name}: {100 * part.clock.sd / step:.3g} % of scatter, {part.why}")
    found = worst(wander, "no signals of a bench")
    return found if found.value is None else CheckResult(found.value, "; ".join(remarks))


def measure_gap(examined: Examined) -> CheckResult:
    """Longest time [s] without a sample, beyond the median step; 0 where no sample is missing."""
    gaps = {}
    for column, step in examined.steps.items():
        usual = float(np.median(step))
        gaps[column] = float(step.max()) - usual if step.max() > 1.5 * usual else 0.0
    return worst(gaps, TOO_FEW)


def measure_clock(examined: Examined) -> CheckResult:
    """RMS residual [s] of the fit of the log's clock; the remark has its drift and its matched edges."""
    clock = examined.trial.provenance.get("clock")
    if not clock:
        return not_applicable("one clock")
    ppm, error = 1e6 * clock["drift"], 1e6 * clock["drift_error"]
    outside = f"{clock.get('rows_before', 0)} and {clock.get('rows_after', 0)} rows of the log before and after"
    matched = f"{clock['edges']} matched and {clock['excluded_edges']} excluded by {clock.get('method', 'edges')}"
    return CheckResult(clock["residual"], f"drift {ppm:.1f} +- {error:.1f} ppm; {matched}; {outside} motion capture")


def measure_damage(examined: Examined) -> CheckResult:
    """Share of the log [%] that was lost to damage; the remark has ingest's report."""
    damage = damage_report(examined.trial)
    if not damage:
        return not_applicable("no damage report")
    said = [f"{damage[key]} {key.replace('_', ' ')}" for key in ("chunks_lost", "messages_lost") if damage.get(key)]
    said += [] if damage.get("complete", True) else ["the file is not complete"]
    said += [f"CRC {damage['crc']}"] if damage.get("crc") else []
    remarks = damage.get("remarks") or []
    said += [remarks] if isinstance(remarks, str) else map(str, remarks)
    return CheckResult(100 * float(damage.get("share_lost") or 0.0), "; ".join(said))


def measure_truncation(examined: Examined) -> CheckResult:
    """1 if the end of the log is missing, as after a crash, which the share that was lost does not count; else 0."""
    damage = damage_report(examined.trial)
    if not damage:
        return not_applicable("no damage report")
    if damage.get("complete", True):
        return CheckResult(0.0)
    return CheckResult(1.0, "no end: see whether the trial lasts as long as it should")


def damage_report(trial: Trial) -> dict[str, Any]:
    return dict(trial.provenance.get("damage") or trial.provenance.get("log", {}).get("damage") or {})


NO_STEPPED_SINE = "no stepped sine"
MOST_DIFFERENCES, MOST_RUNS = 20, 3  # differences, and runs of one amplitude at one frequency, that are said one by one


def measure_protocol(examined: Examined) -> CheckResult:
    """Number of segments, of one amplitude and frequency, that are missing, have other numbers of cycles than
    commanded, or were not commanded. Another motion in place of the stepped sine is said and does not count."""
    if "theta" not in examined.samples.columns:
        return not_applicable(NO_STEPPED_SINE)
    commanded = examined.commanded.protocol
    fewest = min(FEWEST_OF_A_RUN, int(min(commanded.cycles_at, default=FEWEST_OF_A_RUN)))
    try:
        angle = uniform_signals(examined.trial, ["theta"], GapLimits())
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    time, theta = angle.time, angle["theta"]
    excitation = examined.commanded.excitation if examined.experiment.any_motion else "stepped sine"
    if excitation == "any":
        return CheckResult(0.0, "not compared: the configuration says that any motion moves the joint")
    alike = Likeness(time, theta, commanded) if excitation == "auto" else None
    if alike is not None and alike.kind == "other":
        return CheckResult(0.0, "no stepped sine but another motion, which is fitted as such")
    found = find_runs(time, theta, fewest) if alike is None else alike.runs
    remarks = differences(found, commanded)
    more = [f"and {len(remarks) - MOST_DIFFERENCES} differences more"] * (len(remarks) > MOST_DIFFERENCES)
    pairs = len(commanded.amplitudes) * len(commanded.frequencies_hz)
    words = [*remarks[:MOST_DIFFERENCES], *more] or [f"{pairs} commanded pairs of amplitude and frequency found"]
    off = [run.frequency_hz / f - 1 for run in found if (f := commanded.frequency_near(run.frequency_hz))]
    median = float(np.median(off)) if off else 0.0
    if abs(median) >= 1e-3:
        side = "above" if median > 0 else "below"
        words.append(f"frequencies are {100 * abs(median):.2g} % {side} the commanded ones")
    return CheckResult(float(len(remarks)), "; ".join(words))


def differences(found: Sequence[Run], commanded: SteppedSineProtocol) -> list[str]:
    """A remark on every commanded pair of amplitude and frequency that is missing or has other numbers of cycles, and
    on every run that was not commanded. A protocol may have a pair more than once."""
    followed = [(commanded.amplitude_near(run.amplitude), commanded.frequency_near(run.frequency_hz)) for run in found]
    cycles: dict[tuple[float, float], float] = {}
    for amplitude in commanded.amplitudes:
        for frequency, count in zip(commanded.frequencies_hz, commanded.cycles_at, strict=True):
            cycles[amplitude, frequency] = cycles.get((amplitude, frequency), 0.0) + count
    remarks = []
    for (amplitude, frequency), wanted in cycles.items():
        own = [run for run, pair in zip(found, followed, strict=True) if pair == (amplitude, frequency)]
        # the same within 5 %, or half a cycle of each run: a ramp has no sharp end
        if not own:
            remarks.append(f"missing {np.rad2deg(amplitude):g} deg at {frequency:g} Hz")
        elif abs(sum(run.cycles for run in own) - wanted) > max(0.05 * wanted, 0.5 * len(own)):
            more = f" and {len(own) - MOST_RUNS} times more" if len(own) > MOST_RUNS else ""
            remarks.append(f"{' and '.join(map(str, own[:MOST_RUNS]))}{more}, commanded are {wanted:g}")
    return remarks + [f"besides {run}" for run, pair in zip(found, followed, strict=True) if None in pair]


RECORDING_CHECKS = (
    Check("rate", "Hz", "below", "lowest median sampling rate of the channels",
        Cause("slow sampling", "a channel has few samples for the fastest motion, whose acceleration is then uncertain",
            "record this channel faster"), measure_rate),
    Check("jitter", "%", "above",
        "slow wander of the stamps, in sampling steps, where neither signals nor source file decide what it is",
        Cause("uncertain time stamps", "the stamps wander, and nothing tells whether the samples do too, which shifts "
            "B and I", "state `stamps: exact` or `stamps: even` of the log in the source file"), measure_jitter),
    Check("gap", "s", "above", "longest time without a sample, beyond one step",
        Cause("gap in the recording", "samples are missing, and the motion around them is not used",
            "look for a recorder that is too slow or a loose cable"), measure_gap),
)  # fmt: skip
LOG_CHECKS = (
    Check("clock_residual", "s", "above", "RMS residual of the fit of the log's clock to motion capture's",
        Cause("clocks that do not fit", "log and motion capture are matched with an uncertainty that shifts B",
            "check the sync line"), measure_clock),
    Check("damage", "%", "above", "largest share of a topic of the log that was lost",
        Cause("damaged log", "a part of the log could not be read", "copy the log again from the recorder, or record "
            "again"), measure_damage),
    Check("truncated", "logs", "above", "logs without their end; how much is missing is not known",
        Cause("log without its end", "the end of the log is missing, and what is there is analysed",
            "copy or record it again, give a reason under `exclude` in the sample sheet, or write `truncated` under "
            "`accept` there"), measure_truncation),
    Check("protocol", "segments", "above",
        "segments in which recording and command differ: missing, with fewer or more cycles, or not commanded",
        Cause("another motion than stated", "amplitudes, frequencies or numbers of cycles are not those that the "
            "configuration commands, and what was recorded is fitted", "state under `dynamometer` what was commanded"),
        measure_protocol, lambda experiment: experiment.stepped_sine, NO_STEPPED_SINE),
)  # fmt: skip
CHECKS: dict[str, Check] = {check.name: check for check in (*RECORDING_CHECKS, *CHANNEL_CHECKS, *LOG_CHECKS)}
"""Every check by name. A new one is its function with its row here or in `channels`, its rule under `quality` in
config/config.yaml, and its test."""
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
        size, _, unit = threshold.partition(" ")
        try:
            fits = unit.strip() == check.unit and 0 <= float(size) < float("inf")
        except ValueError:
            fits = False
        if not fits:
            raise InputError(
                f"configuration, quality.{name}: threshold '{threshold}' must be a number from 0 and its unit, "
                f"as in '1 {check.unit}'"
            )


def unknown_check(name: str) -> str:
    """What is wrong with the name of a check; the new name where it is an old one."""
    if name in QualityRules.RENAMED:
        return f"the check '{name}' is now called '{QualityRules.RENAMED[name]}'; rename it"
    return f"'{name}' is no quality check; the checks are {', '.join(CHECKS)}"


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
        failed, accepted = CHECKS[name].failed(row["value"], rule.limit), name in accept.get(row["trial"], ())
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
