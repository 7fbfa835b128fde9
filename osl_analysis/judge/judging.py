# SPDX-License-Identifier: Apache-2.0
"""Find the findings on the rows of a table of fits.

They come from the budgets of the estimates, from the rules and from the configured limits.

Example: `judged(impedance, limits, "impedance", budget=budget)[0]` are those on the first row.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.findings import WIDE_INTERVAL, Finding, fit_of
from osl_analysis.judge.joining import WHY_NO_FIT, RowFindings
from osl_analysis.judge.known_findings import FINDINGS, known_finding
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.rules import (
    AnyRow,
    Beyond,
    Grade,
    NumberRule,
    Numbers,
    RowRule,
    Rule,
    numbers_beyond,
    rules_on,
)
from osl_analysis.judge.wording import worded
from osl_analysis.stats.budget import (
    DOUBT,
    IN_INTERVAL,
    LIKELY,
    QUANTITIES,
    WIDE,
    WITHOUT_FRICTION,
    Budget,
    Contribution,
    Verdict,
    budgets_in,
    floored_size,
)
from osl_analysis.stats.rounding import significant
from osl_analysis.stats.sources import Source

UNEXPLAINED = Source.UNEXPLAINED_TORQUE


@dataclass(frozen=True)
class Judged:
    """An estimate with its budget and its verdict."""

    symbol: str  # K, B or I: its accuracy is that of the symbol
    name: str  # its column
    judged: str  # the column that is judged, without friction where this is certain
    unit: str
    budget: Budget
    verdict: Verdict
    needed: float
    with_friction: Budget  # of `name`; another than `budget` where friction was taken off

    def moved(self, by: float) -> str:
        """The change by a source, in words."""
        if by >= floored_size(self.symbol, self.with_friction.value):
            return f"{self.name} by an unknown size, larger than itself"
        return f"{self.name} by {significant(by)} {self.unit}"

    def width(self, name: str, budget: Budget) -> str:
        """The half-width of an interval and the needed one, in words."""
        largest = max(budget.in_parts(*IN_INTERVAL), key=lambda contribution: contribution.size)
        return (
            f"{name} is known to {significant(budget.half_width())} {self.unit}"
            f" (largest source: {largest.source.replace('_', ' ')}),"
            f" and {significant(self.needed)} is needed"
        )


def judged(
    table: pl.DataFrame,
    limits: Limits,
    name: str,
    faults: Mapping[str, str] | None = None,
    budget: pl.DataFrame | None = None,
) -> RowFindings:
    """Judge each row of a table.

    Parameters
    ----------
    table : polars.DataFrame
        A result table with all columns of its fits.
    limits : Limits
        Accuracy and limits of the configuration.
    name : str
        The name of the table.
    faults : Mapping of str to str, optional
        By trial, the source of a failed check of its recording, which names the cause of a
        doubtful estimate (`recording_checks.spoiled_trials`).
    budget : polars.DataFrame, optional
        `budget.csv`.

    Returns
    -------
    list of list of Finding
        For each row doubts, checks that were not possible, then remarks. Rows without a fit have
        none.
    """
    rules = rules_on(name, table.columns, limits.by_column)
    findings: RowFindings = []
    rows = table.to_dicts()
    for row, budgets in zip(rows, budgets_of_rows(rows, budget), strict=True):
        if row.get(WHY_NO_FIT) is not None:
            findings.append([])
            continue
        estimates = judged_estimates(name, budgets, limits)
        predicted = predicted_estimates(name, budgets, limits)
        named = (faults or {}).get(str(row.get("trial")))
        fault = Source(named) if named else None
        findings.append(findings_of_row(name, row, estimates, predicted, rules, fault))
    return findings


def budgets_of_rows(rows: Sequence[AnyRow], budget: pl.DataFrame | None) -> list[dict[str, Budget]]:
    """The budgets of the estimates of each row of a table, by `budget.csv`."""
    by_fit: dict[object, list[AnyRow]] = {}
    for contribution in [] if budget is None else budget.to_dicts():
        by_fit.setdefault(fit_of(contribution), []).append(contribution)
    return [budgets_in(by_fit.get(fit_of(row), ()), row) for row in rows]


def judged_estimates(table: str, budgets: Mapping[str, Budget], limits: Limits) -> list[Judged]:
    """The estimates of a row with their verdicts: those without friction where this is certain."""
    experiments = EXPERIMENTS.values()
    names_by_table = (e.impedance for e in experiments if table in [t.name for t in e.tables])
    columns = next(names_by_table, QUANTITIES)
    accuracy = limits.accuracy.model_dump()
    described = described_tables_by_name()[table]
    units = {**described.columns, **described.of_fits}
    estimates = []
    for symbol, column in zip(QUANTITIES, columns, strict=False):
        name = WITHOUT_FRICTION[symbol] if WITHOUT_FRICTION[symbol] in budgets else column
        if name in budgets:
            budget = budgets[name]
            needed = accuracy[symbol] * floored_size(symbol, budget.value)
            verdict = budget.verdict(needed)
            unit = units[name].unit
            estimates.append(
                Judged(symbol, column, name, unit, budget, verdict, needed, budgets[column])
            )
    return estimates


def predicted_estimates(table: str, budgets: Mapping[str, Budget], limits: Limits) -> list[Judged]:
    """The estimates of a group of crossings less predicted gait, `K_predicted` and the like, with
    their verdicts; none of other tables."""
    described = described_tables_by_name()[table].of_fits
    accuracy = limits.accuracy.model_dump()
    estimates = []
    for symbol in QUANTITIES:
        name = f"{symbol}_predicted"
        if name in budgets and name in described:
            budget = budgets[name]
            needed = accuracy[symbol] * floored_size(symbol, budget.value)
            verdict = budget.verdict(needed)
            unit = described[name].unit
            estimates.append(Judged(symbol, name, name, unit, budget, verdict, needed, budget))
    return estimates


def findings_of_row(
    table: str,
    row: AnyRow,
    estimates: Sequence[Judged],
    predicted: Sequence[Judged],
    rules: Sequence[Rule],
    fault: Source | None,
) -> list[Finding]:
    """The findings on a row, worded and in their order.

    `predicted` estimates have remarks on wide intervals alone.
    """
    numbers = numbers_beyond(row, [rule for rule in rules if isinstance(rule, NumberRule)])
    are_weighed = any(e.budget.from_source(UNEXPLAINED) for e in estimates)
    for column, number in list(numbers.items()):
        if known_finding(number.source).spoils_estimates and are_weighed:
            fault = fault or number.source
            del numbers[column]

    if fault:
        estimates = [with_fault(estimate, fault) for estimate in estimates]
    findings = [
        *doubts_of(estimates),
        *findings_of_numbers(numbers),
        *properties_of(estimates, predicted),
    ]
    doubts = {finding.source for finding in findings if finding.grade is Grade.DOUBTS}
    findings += [small for small in small_faults_of(estimates) if small.source not in doubts]
    names = {finding.source for finding in findings}
    findings = [
        finding
        for finding in findings
        if not any(number.rule and names & {*number.rule.unless} for number in finding.evidence)
    ]
    findings += not_checked(estimates)
    for rule in rules:
        if isinstance(rule, RowRule) and rule.holds(row) and not names & {*rule.unless}:
            finding = Finding(rule.source, grade=rule.grade, says=rule.says, remedy=rule.remedy)
            findings.append(finding)
    order = list(Grade)
    # both sorts keep equal ones in order: by grade, then a named cause before unexplained torque,
    # then faults of the recording before what follows from them
    findings.sort(key=lambda finding: not known_finding(finding.source).spoils_estimates)
    findings.sort(key=lambda finding: (order.index(finding.grade), finding.source == UNEXPLAINED))
    subject, amplitude_deg = fit_of(row)
    fit_fields: dict[str, Any] = {
        "table": table,
        "subject": subject,
        "joint": row.get("joint"),
        "side": row.get("side"),
        "amplitude_deg": amplitude_deg,
    }
    return [worded(replace(finding, **fit_fields), row) for finding in findings]


def with_fault(estimate: Judged, fault: Source) -> Judged:
    """The estimate of a recording with a known fault, which names the cause of a doubt.

    The half-width and the half-range of such an estimate are effects of the fault. Beyond what is
    needed they make it doubtful.
    """
    if estimate.verdict.rows:
        return replace(estimate, verdict=replace(estimate.verdict, name=fault))
    uncertainty = math.hypot(estimate.budget.half_width(), estimate.budget.half_range)
    # friction makes the torque leap at reversals, which checks take for faults
    has_friction = estimate.with_friction is not estimate.budget
    if has_friction or uncertainty <= estimate.needed:
        return estimate
    row = Contribution(fault, uncertainty, basis="measured", part="fault")
    return replace(estimate, verdict=Verdict(fault, estimate.needed, (row,)))


def doubts_of(estimates: Sequence[Judged]) -> list[Finding]:
    """The doubts of budgets, one for each source, or for each known fault of the recording."""
    by_source: dict[Source, list[Judged]] = {}
    for estimate in estimates:
        source = estimate.verdict.doubt
        if source is not None:
            by_source.setdefault(source, []).append(estimate)
    return [
        finding_on_estimates(
            source,
            Grade.DOUBTS,
            [evidence_of(estimate, source) for estimate in doubted],
            doubt_text(source, doubted),
        )
        for source, doubted in by_source.items()
    ]


def evidence_of(estimate: Judged, source: Source) -> Beyond:
    """The number beyond its limit: the change by a fault, else the half-width that a likely fault
    widens."""
    verdict = estimate.verdict
    size, limit = verdict.size, verdict.limit
    if size <= limit:
        size, limit = estimate.budget.half_width(), estimate.needed
    weighed = [row.probability for row in verdict.rows if row.basis == "weighed"]
    probability = sum(weighed) if weighed else None  # models that are weighed exclude each other
    return Beyond(estimate.name, size, limit, source, "above", probability=probability)


def doubt_text(source: Source, doubted: Sequence[Judged]) -> str:
    """The effect of a source on estimates, in words.

    It names the likeliest cause and those that are hardly less likely, their sizes, and the torque
    that they leave unexplained where it matters.
    """
    causes: list[str] = []
    left = []
    for estimate in doubted:
        verdict = estimate.verdict
        likeliest = verdict.rows[0]
        if likeliest.source == source:
            causes.append(likeliest.detail or "it")
        else:  # a check of the recording saw it
            causes += ["it", likeliest.detail or known_finding(likeliest.source).title]
        for row in estimate.budget.in_parts("fault"):
            if row.size > verdict.limit and row.probability > DOUBT * likeliest.probability:
                if row.detail:
                    causes.append(row.detail)
                elif row.source == UNEXPLAINED != likeliest.source:
                    left.append(estimate.moved(row.size))
    text = " or ".join(dict.fromkeys(causes))
    if " or " in text:
        text += ", which this recording does not tell apart,"
    text += (
        f" would change {', '.join(estimate.moved(estimate.verdict.size) for estimate in doubted)}"
    )
    if left:
        text += f". Torque that it leaves unexplained could change at most {', '.join(left)}"
    return text


def findings_of_numbers(numbers: Numbers) -> list[Finding]:
    """The findings by numbers beyond their limits, one for each cause."""
    by_cause: dict[tuple[Source, Grade], list[Beyond]] = {}
    for number in numbers.values():
        grade = number.rule.grade if number.rule else Grade.DOUBTS
        if known_finding(number.source).is_result:
            grade = Grade.NOTES
        by_cause.setdefault((number.source, grade), []).append(number)
    findings = []
    for (source, grade), evidence in by_cause.items():
        remedies = [number.rule.remedy for number in evidence if number.rule]
        ends = [number.column for number in evidence if number.rule and number.rule.is_of_estimate]
        finding = Finding(
            source=source,
            grade=grade,
            evidence=tuple(evidence),
            estimates=tuple(end.removesuffix("_high") for end in ends),
            remedy=next(filter(None, remedies), ""),
        )
        findings.append(finding)
    return findings


def properties_of(estimates: Sequence[Judged], predicted: Sequence[Judged] = ()) -> list[Finding]:
    """Remarks on properties of the device that change an estimate by more than is needed, and on
    intervals that are wider, also of `predicted` estimates."""
    remarks: dict[Source, dict[Beyond, str]] = {}  # by source the sizes in words
    for estimate in estimates:
        sizes: dict[Source, tuple[float, str]] = {}
        least = max(estimate.needed, estimate.with_friction.half_width())
        motions = estimate.with_friction.in_parts("motion")
        # from small to large: of several contributions of one source the largest stays
        for motion in sorted(motions, key=lambda contribution: contribution.size):
            change = 2 * motion.size  # from one end of the range to the other
            if motion.source in FINDINGS and change > least:
                detail = f" ({motion.detail})" if motion.detail else ""
                sizes[motion.source] = (change, estimate.moved(change) + detail)
        for source, (size, text) in sizes.items():
            beyond = Beyond(estimate.name, size, estimate.needed, source, "above")
            remarks.setdefault(source, {})[beyond] = text
        for name, budget in {
            estimate.name: estimate.with_friction,
            estimate.judged: estimate.budget,
        }.items():
            half = budget.half_width()
            if half > estimate.needed and not estimate.verdict.rows:
                beyond = Beyond(name, half, estimate.needed, WIDE_INTERVAL, "above")
                remarks.setdefault(WIDE_INTERVAL, {})[beyond] = estimate.width(name, budget)
    for estimate in predicted:
        if estimate.verdict.name == WIDE:
            half = estimate.budget.half_width()
            beyond = Beyond(estimate.name, half, estimate.needed, WIDE_INTERVAL, "above")
            text = estimate.width(estimate.name, estimate.budget)
            remarks.setdefault(WIDE_INTERVAL, {})[beyond] = text
    return [
        finding_on_estimates(source, Grade.NOTES, list(texts), ", ".join(texts.values()))
        for source, texts in remarks.items()
    ]


def small_faults_of(estimates: Sequence[Judged]) -> list[Finding]:
    """Remarks on likely faults that change an estimate by more than its half-width, and by less
    than is needed."""
    remarks: dict[Source, dict[Beyond, str]] = {}
    for estimate in estimates:
        half = estimate.budget.half_width()
        rows_of_source: dict[Source, list[Contribution]] = {}
        doubted = {row.source for row in estimate.verdict.rows}
        for row in estimate.budget.in_parts("fault"):
            if row.basis == "weighed" and row.source not in doubted:
                rows_of_source.setdefault(row.source, []).append(row)
        for source, rows in rows_of_source.items():
            probability = sum(row.probability for row in rows)
            size = max(row.size for row in rows)
            if probability > LIKELY and size > half:
                beyond = Beyond(estimate.name, size, half, source, "above", probability=probability)
                detail = f" ({rows[0].detail})" if rows[0].detail else ""
                remarks.setdefault(source, {})[beyond] = estimate.moved(size) + detail
    return [
        finding_on_estimates(source, Grade.NOTES, list(texts), ", ".join(texts.values()))
        for source, texts in remarks.items()
    ]


def finding_on_estimates(
    source: Source, grade: Grade, evidence: Sequence[Beyond], size: str
) -> Finding:
    """A finding about the estimates of its evidence alone."""
    estimates = tuple(number.column for number in evidence)
    return Finding(source, grade=grade, evidence=tuple(evidence), estimates=estimates, size=size)


def not_checked(estimates: Sequence[Judged]) -> list[Finding]:
    """The findings on what nobody has measured, with the change per unit."""
    sizes: dict[Source, list[str]] = {}
    for estimate in estimates:
        for contribution in estimate.budget.unknown:
            texts = [f"{estimate.name} {contribution.per}"] if contribution.per else []
            sizes.setdefault(contribution.source, []).extend(texts)
    return [
        Finding(source, grade=Grade.UNCHECKED, size=", ".join(texts))
        for source, texts in sizes.items()
    ]
