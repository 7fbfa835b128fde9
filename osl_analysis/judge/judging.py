# SPDX-License-Identifier: Apache-2.0
"""The findings about the rows of a table of fits: from the budgets of their estimates, from the
rules and from the configured limits."""

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

    symbol: str  # K, B or I, whose accuracy it needs
    name: str  # its column
    judged: str  # the column that is judged, without friction where this is certain
    unit: str
    budget: Budget
    verdict: Verdict
    needed: float
    own: Budget  # with what friction changes, where this is taken off the judged estimate

    def moved(self, by: float) -> str:
        """What a source would change, in words."""
        if by >= floored_size(self.symbol, self.own.value):
            return f"{self.name} by an unknown size, larger than itself"
        return f"{self.name} by {significant(by)} {self.unit}"

    def width(self, name: str, budget: Budget) -> str:
        """How wide its interval is, or that without friction, beside what is needed, in words."""
        largest = max(budget.in_parts(*IN_INTERVAL), key=lambda each: each.size)
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
        By trial, the finding of a failed check of its recording, which names the cause where an
        estimate is doubtful (`recording_checks.spoiled_trials`).
    budget : polars.DataFrame, optional
        `budget.csv`.

    Returns
    -------
    list of list of Finding
        For each row doubts, remarks, then what could not be checked. Rows without a fit have none.
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
    of_trials = (e.impedance for e in experiments if table in [t.name for t in e.tables])
    columns = next(of_trials, QUANTITIES)
    accuracy = limits.accuracy.model_dump()
    described = described_tables_by_name()[table]
    units = {**described.columns, **described.of_fits}
    found = []
    for symbol, own in zip(QUANTITIES, columns, strict=False):
        name = WITHOUT_FRICTION[symbol] if WITHOUT_FRICTION[symbol] in budgets else own
        if name in budgets:
            budget = budgets[name]
            needed = accuracy[symbol] * floored_size(symbol, budget.value)
            verdict = budget.verdict(needed)
            unit = units[name].unit
            found.append(Judged(symbol, own, name, unit, budget, verdict, needed, budgets[own]))
    return found


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
    """What a row is doubted for, what is worth knowing of it, and what could not be checked; of its
    `predicted` estimates whether their intervals are wide."""
    numbers = numbers_beyond(row, [rule for rule in rules if isinstance(rule, NumberRule)])
    are_weighed = any(e.budget.from_source(UNEXPLAINED) for e in estimates)
    for column, number in list(numbers.items()):
        if known_finding(number.source).spoils_estimates and are_weighed:
            fault = fault or number.source
            del numbers[column]

    if fault:
        estimates = [of_spoiled(estimate, fault) for estimate in estimates]
    found = [*doubts_of(estimates), *of_numbers(numbers), *properties_of(estimates, predicted)]
    doubts = {finding.source for finding in found if finding.grade is Grade.DOUBTS}
    found += [small for small in small_faults_of(estimates) if small.source not in doubts]
    names = {finding.source for finding in found}
    found = [
        finding
        for finding in found
        if not any(number.rule and names & {*number.rule.unless} for number in finding.evidence)
    ]
    found += not_checked(estimates)
    for rule in rules:
        if isinstance(rule, RowRule) and rule.holds(row) and not names & {*rule.unless}:
            finding = Finding(rule.source, grade=rule.grade, says=rule.says, remedy=rule.remedy)
            found.append(finding)
    order = list(Grade)
    # what spoils a recording before what follows from it, and a named cause before none
    found.sort(key=lambda each: not known_finding(each.source).spoils_estimates)
    found.sort(key=lambda each: (order.index(each.grade), each.source == UNEXPLAINED))
    subject, amplitude_deg = fit_of(row)
    of_fit: dict[str, Any] = {
        "table": table,
        "subject": subject,
        "joint": row.get("joint"),
        "side": row.get("side"),
        "amplitude_deg": amplitude_deg,
    }
    return [worded(replace(each, **of_fit), row) for each in found]


def of_spoiled(estimate: Judged, fault: Source) -> Judged:
    """The estimate of a recording in which a check found a fault, which is then likely, and named:
    what repeats and another motion leave open is the fault's, and a doubt beyond what is needed."""
    if estimate.verdict.rows:
        return replace(estimate, verdict=replace(estimate.verdict, name=fault))
    left = math.hypot(estimate.budget.half_width(), estimate.budget.half_range)
    has_friction = estimate.own is not estimate.budget  # at whose reversals a torque leaps, too
    if has_friction or left <= estimate.needed:
        return estimate
    row = Contribution(fault, left, basis="measured", part="fault")
    return replace(estimate, verdict=Verdict(fault, estimate.needed, (row,)))


def doubts_of(estimates: Sequence[Judged]) -> list[Finding]:
    """The doubts that budgets tell, by their source, or by what a check of the recording found."""
    by_source: dict[Source, list[Judged]] = {}
    for estimate in estimates:
        source = estimate.verdict.doubt
        if source is not None:
            by_source.setdefault(source, []).append(estimate)
    return [
        of_estimates(
            source,
            Grade.DOUBTS,
            [evidence_of(estimate, source) for estimate in doubted],
            doubt_text(source, doubted),
        )
        for source, doubted in by_source.items()
    ]


def evidence_of(estimate: Judged, source: Source) -> Beyond:
    """What is beyond its limit: the change by a fault; else the half-width, of which a likely fault
    makes more than is needed."""
    verdict = estimate.verdict
    size, limit = verdict.size, verdict.limit
    if size <= limit:
        size, limit = estimate.budget.half_width(), estimate.needed
    weighed = [row.probability for row in verdict.rows if row.basis == "weighed"]
    probability = sum(weighed) if weighed else None  # models that are weighed exclude each other
    return Beyond(estimate.name, size, limit, source, "above", probability=probability)


def doubt_text(source: Source, doubted: Sequence[Judged]) -> str:
    """What a source would do to estimates: its likeliest cause and those that are hardly less
    likely, their sizes, and what they leave unexplained where that matters, too."""
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
    text += f" would change {', '.join(each.moved(each.verdict.size) for each in doubted)}"
    if left:
        text += f". Torque that it leaves unexplained could change at most {', '.join(left)}"
    return text


def of_numbers(numbers: Numbers) -> list[Finding]:
    """The numbers beyond their limits by their causes."""
    by_cause: dict[tuple[Source, Grade], list[Beyond]] = {}
    for number in numbers.values():
        grade = number.rule.grade if number.rule else Grade.DOUBTS
        if known_finding(number.source).is_result:
            grade = Grade.NOTES
        by_cause.setdefault((number.source, grade), []).append(number)
    found = []
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
        found.append(finding)
    return found


def properties_of(estimates: Sequence[Judged], predicted: Sequence[Judged] = ()) -> list[Finding]:
    """Remarks: properties of the device that change an estimate by more than is needed, and
    intervals that are wider, of `predicted` estimates too."""
    remarks: dict[Source, dict[Beyond, str]] = {}  # by source the sizes in words
    for estimate in estimates:
        sizes: dict[Source, tuple[float, str]] = {}
        least = max(estimate.needed, estimate.own.half_width())
        # of several of one source the largest
        for each in sorted(estimate.own.in_parts("motion"), key=lambda each: each.size):
            change = 2 * each.size  # from one end of the range to the other
            if each.source in FINDINGS and change > least:
                detail = f" ({each.detail})" if each.detail else ""
                sizes[each.source] = (change, estimate.moved(change) + detail)
        for source, (size, text) in sizes.items():
            beyond = Beyond(estimate.name, size, estimate.needed, source, "above")
            remarks.setdefault(source, {})[beyond] = text
        for name, budget in {estimate.name: estimate.own, estimate.judged: estimate.budget}.items():
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
        of_estimates(source, Grade.NOTES, list(texts), ", ".join(texts.values()))
        for source, texts in remarks.items()
    ]


def small_faults_of(estimates: Sequence[Judged]) -> list[Finding]:
    """Remarks: faults that are likely and would change an estimate beyond its interval, by less
    than is needed."""
    remarks: dict[Source, dict[Beyond, str]] = {}
    for estimate in estimates:
        half = estimate.budget.half_width()
        of_source: dict[Source, list[Contribution]] = {}
        doubted = {row.source for row in estimate.verdict.rows}
        for row in estimate.budget.in_parts("fault"):
            if row.basis == "weighed" and row.source not in doubted:
                of_source.setdefault(row.source, []).append(row)
        for source, rows in of_source.items():
            probability = sum(row.probability for row in rows)
            size = max(row.size for row in rows)
            if probability > LIKELY and size > half:
                beyond = Beyond(estimate.name, size, half, source, "above", probability=probability)
                detail = f" ({rows[0].detail})" if rows[0].detail else ""
                remarks.setdefault(source, {})[beyond] = estimate.moved(size) + detail
    return [
        of_estimates(source, Grade.NOTES, list(texts), ", ".join(texts.values()))
        for source, texts in remarks.items()
    ]


def of_estimates(source: Source, grade: Grade, evidence: Sequence[Beyond], size: str) -> Finding:
    """A finding about the estimates of its evidence alone."""
    estimates = tuple(number.column for number in evidence)
    return Finding(source, grade=grade, evidence=tuple(evidence), estimates=estimates, size=size)


def not_checked(estimates: Sequence[Judged]) -> list[Finding]:
    """What nobody has measured, with what it would change per unit."""
    sizes: dict[Source, list[str]] = {}
    for estimate in estimates:
        for each in estimate.budget.unknown:
            texts = [f"{estimate.name} {each.per}"] if each.per else []
            sizes.setdefault(each.source, []).extend(texts)
    return [
        Finding(source, grade=Grade.UNCHECKED, size=", ".join(texts))
        for source, texts in sizes.items()
    ]
