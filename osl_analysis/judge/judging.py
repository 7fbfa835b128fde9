"""Findings about the rows of result tables, from the rules and the configured limits, and the
tables with them.

What a known cause explains, such as a low VAF due to friction, is no finding of its own.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import polars as pl

from osl_analysis.judge.finding import (
    ESTIMATES,
    AnyRow,
    Beyond,
    Finding,
    Grade,
    cell_number,
    subject_of,
)
from osl_analysis.judge.known_findings import (
    BY_COLUMN,
    CONDITIONS,
    FINDINGS,
    HYPOTHESES,
    KnownFinding,
    Rule,
    known_finding,
    rule_of,
)
from osl_analysis.judge.limits import Accuracy, Limit, Limits
from osl_analysis.stats.repeats import DOUBTFUL
from osl_analysis.units import known_factor

HAVE_REMARKS = (
    "belt",
    "transmission",
    "actuator",
    "impedance",
    "response",
    "torque_angle",
    "walking_groups",
)
"""Judged tables of which something may be remarked, or could not be checked."""
EXCLUDED = "reason"  # column: why a row has no fit; null in rows with a fit
BETWEEN = "; "  # titles of findings in a cell
LEAST_EFFECT = 1.0  # limit of what is decided by its effect, a multiple of what is worth telling
FAR_BEYOND = 1.15  # of a limit: a cause of others that is farther beyond it precedes them


class NearUnit:
    """How near a ratio to a known value must be to the factor between two units."""

    # relative differences between components and their file have a standard deviation of 2 %
    OF_RATIO = 0.04
    OF_LARGE_RATIO = 0.08  # of a ratio beyond its limit, above `LARGE`
    LARGE = 2.0  # between units; other devices and gains are as far off, so it must be met well
    OF_STATED = 0.015  # of a ratio to stated gains, and of a second ratio to the first
    OF_SECOND = 0.1  # of the second ratio to what another unit would make of it
    MOST_UNCERTAIN = 1.05  # upper end over estimate, above which a ratio tells no unit


RATIOS_TO_STATED = ("K_over_K_d",)  # to stated gains
RowFindings = list[list[Finding]]  # for each row of a table
Numbers = dict[str, Beyond]  # numbers of a row beyond their limits, by column
Cause = tuple[KnownFinding, tuple[Beyond, ...]]  # a cause of doubt with its evidence


def judged(
    table: pl.DataFrame, limits: Limits, name: str, faults: Mapping[str, str] | None = None
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
        By trial, the finding of a failed check of its recording beside which no estimate can be
        trusted (`recording_checks.spoiled_trials`).

    Returns
    -------
    list of list of Finding
        For each row doubts in the order of their limits, remarks on the device, then what could
        not be checked; nothing of faults that move the estimates by less than their accuracy. Rows
        without a fit have none.
    """
    on_columns = limits_in(name, table.columns, limits)
    rows = table.to_dicts()
    beyond = [numbers_beyond(row, on_columns) for row in rows]
    of_whole = {row.get("trial"): beyond[k] for k, row in enumerate(rows) if of_whole_trial(row)}
    for numbers, row in zip(beyond, rows, strict=True):
        drop_unlike_whole(numbers, of_whole.get(row.get("trial"), numbers))

    # what explains the misfit of a trial, by the fit to all of it before those to its amplitudes
    misfit_by: dict[object, KnownFinding | None] = {}
    for k in sorted(range(len(rows)), key=lambda k: not of_whole_trial(rows[k])):
        trial = rows[k].get("trial")
        misfit_by[trial] = misfit_by.get(trial) or explaining(beyond[k])

    conditions = conditions_of(table, name)
    findings: RowFindings = []
    for k, row in enumerate(rows):
        if row.get(EXCLUDED) is not None:
            findings.append([])
            continue
        causes = [
            (cause, numbers)
            for cause, numbers in causes_in(beyond[k], misfit_by[row.get("trial")])
            if cause.is_result or not is_within_accuracy(name, row, numbers, limits.accuracy)
        ]
        fault = FINDINGS.get((faults or {}).get(str(row.get("trial")), ""))
        findings.append(findings_of_row(name, row, with_effects(causes, fault), conditions[k]))
    return findings


def of_whole_trial(row: AnyRow) -> bool:
    """Whether a row is the fit to a whole trial, beside fits to single amplitudes."""
    return "amplitude_deg" in row and row["amplitude_deg"] is None


def limits_in(table: str, columns: Collection[str], limits: Limits) -> list[Limit]:
    """The limits on the columns of a table: those that follow from the accuracy of its estimates,
    those of the configuration, and that nothing is below zero that cannot be."""
    stated = limits.stated()
    by_accuracy: list[Limit] = []
    by_sign: list[Limit] = []
    free = set(columns) - {limit.column for limit in stated}
    for rule, *_ in BY_COLUMN.values():
        if rule.column not in free or not rule.concerns(table, columns):
            continue
        if rule.by == "effect":
            by_accuracy.append(Limit(rule.column, "above", LEAST_EFFECT))
        elif rule.by == "accuracy":
            by_accuracy.append(Limit(rule.column, "above", limits.accuracy.of(rule.of)))
        elif rule.by == "sign":
            by_sign.append(Limit(rule.column, "below", 0.0))
    return [*by_accuracy, *stated, *by_sign]


def numbers_beyond(row: AnyRow, limits: Sequence[Limit]) -> Numbers:
    """Find the numbers of a row that are beyond their limits.

    Parameters
    ----------
    row : AnyRow
        A null is not checked.
    limits : Sequence of Limit
        Those of its table (`limits_in`).

    Returns
    -------
    dict of str to Beyond
        By column; NaN is beyond any limit, and a ratio near a unit's factor is `near`.
    """
    numbers: Numbers = {}
    for limit in limits:
        value = cell_number(row, limit.column)
        if limit.value is None or value is None or row.get(EXCLUDED) is not None:
            continue
        side, end = side_of(value, limit)
        rule = rule_of(limit.column, side)
        unit, is_unit = unit_of_ratio(rule, value, row) if rule else ("", False)
        if not side and (not is_unit or limit.column in numbers):
            continue
        finding = "wrong_unit" if is_unit else finding_of(limit.column, rule, row)
        side = side or "near"
        numbers[limit.column] = Beyond(limit.column, value, end, side, finding, unit)
    return numbers


def side_of(value: float, limit: Limit) -> tuple[str, float]:
    """On which side of a limit a number is beyond it, empty for none, and the end that it passes;
    an upper limit is one of the size."""
    assert limit.value is not None
    if math.isnan(value):
        return "nan", limit.value
    if limit.side == "above" and abs(value) > limit.value:
        return ("above", limit.value) if value > 0 else ("below", -limit.value)
    return "below" if limit.side == "below" and value < limit.value else "", limit.value


def finding_of(column: str, rule: Rule | None, row: AnyRow) -> str:
    """What a number of a column is evidence of; of a column without a rule, its own name."""
    if rule is None:
        return column
    family = row.get("fault_family")
    if column.endswith("_fault_share"):
        return HYPOTHESES[str(family)]
    if column == "K_change" and family == "size":
        return "nonlinear_spring"
    return rule.finding


def unit_of_ratio(rule: Rule, ratio: float, row: AnyRow) -> tuple[str, bool]:
    """The factor between units near a ratio to a known value, in words, and whether it is more
    likely than another device.

    A second ratio decides that: a wrong torque scales both alike, a wrong current only this one."""
    if not rule.units or not ratio:
        return "", False
    second = cell_number(row, rule.second) if rule.second else None
    symbol = rule.column.removesuffix("_ratio")
    estimate, high = cell_number(row, symbol), cell_number(row, f"{symbol}_high")
    is_known = not (estimate and high) or high <= NearUnit.MOST_UNCERTAIN * estimate
    is_stated = rule.column in RATIOS_TO_STATED
    if second and is_known:
        near, near_second = NearUnit.OF_RATIO, NearUnit.OF_SECOND
        if is_stated:
            near = near_second = NearUnit.OF_STATED
        expected = {unit: 1.0 if unit == "current" else ratio for unit in rule.units}
        likely = [unit for unit, of in expected.items() if abs(second - of) < near_second * abs(of)]
        name, factor = known_factor(ratio, likely, near)
        if name:
            return f", {factor:.3g} is the factor {name}", True
    size = max(abs(ratio), 1 / abs(ratio))
    near = NearUnit.OF_LARGE_RATIO if size > NearUnit.LARGE else NearUnit.OF_STATED
    name, factor = known_factor(ratio, rule.units, near)
    return f", {factor:.3g} is the factor {name}" if name else "", False


def drop_unlike_whole(numbers: Numbers, of_whole: Numbers) -> None:
    """Drop from a row's numbers the evidence of a recording's fault that the fit to the whole trial
    does not show. At one amplitude friction looks like such a fault; over all amplitudes it does
    not."""
    for column in list(numbers):
        rule = rule_of(column)
        if rule and FINDINGS[rule.finding].of_recording and column not in of_whole:
            del numbers[column]


def is_misfit(number: Beyond) -> bool:
    """Whether a number measures the misfit."""
    rule = rule_of(number.column)
    return rule is not None and rule.misfit


def explaining(numbers: Numbers) -> KnownFinding | None:
    """The first cause in a row that makes its fit worse; harmonics alone count as friction."""
    causes = (known_finding(number.finding) for number in sorted(numbers.values(), key=is_misfit))
    return next((cause for cause in causes if cause.explains_misfit), None)


def rank_of(number: Beyond) -> int:
    """The place of evidence among that of its row: causes of others first, unknown ones last."""
    rule = rule_of(number.column, number.side)
    if rule is None:
        return 2
    return 0 if FINDINGS[rule.finding].causes_others and number.excess > FAR_BEYOND else 1


def causes_in(numbers: Numbers, misfit_by: KnownFinding | None) -> list[Cause]:
    """Order the numbers of a row by their causes: causes of others first, unknown ones last.
    `misfit_by` explains the misfit of the trial, and takes the columns that show it."""
    numbers_of: dict[str, list[Beyond]] = {}
    for number in sorted(numbers.values(), key=rank_of):
        taken = misfit_by is not None and is_misfit(number)
        name = misfit_by.name if misfit_by and taken else number.finding
        numbers_of.setdefault(name, []).append(number)
    return [(known_finding(name), tuple(of)) for name, of in numbers_of.items()]


def with_effects(causes: list[Cause], fault: KnownFinding | None) -> list[Cause]:
    """Causes of which those that may be effects of a fault of the recording are evidence of it.
    `fault` is what a check of the recording found; None: what the row shows."""
    fault = fault or next((cause for cause, _ in causes if cause.spoils_estimates), None)
    effects: list[Beyond] = []
    others: list[Cause] = []
    for cause, numbers in causes:
        if cause is fault or cause.explains_misfit or cause.is_misfit:
            effects += numbers
        else:
            others.append((cause, numbers))
    return [(fault, tuple(effects)), *others] if fault and effects else causes


def conditions_of(table: pl.DataFrame, name: str) -> list[list[Rule]]:
    """The rules whose conditions each row of a table fulfils."""
    rules = [rule for rule in CONDITIONS if rule.concerns(name, table.columns)]
    holds = table.select(
        rule.condition.alias(str(number)) for number, rule in enumerate(rules)
    ).rows()
    if not rules:
        return [[] for _ in range(len(table))]
    return [[rule for rule, is_so in zip(rules, of_row, strict=True) if is_so] for of_row in holds]


def findings_of_row(
    table: str, row: AnyRow, causes: Sequence[Cause], conditions: Sequence[Rule]
) -> list[Finding]:
    """The doubts about a row by their causes, remarks on properties of the device, and what could
    not be checked."""
    findings = [finding_of_cause(table, row, *cause) for cause in causes]
    doubts = [each for each in findings if each.grade is Grade.DOUBTS]
    remarks = [each for each in findings if each.grade is Grade.NOTES]
    names = {doubt.name for doubt in doubts}
    if names & set(HYPOTHESES.values()):  # a rival explains what it can
        doubts = [doubt for doubt in doubts if doubt.name != "unexplained_torque"]
    for rule in conditions:
        if not names & set(rule.unless):
            remarks.append(
                Finding(
                    name=rule.finding,
                    table=table,
                    subject=subject_of(row),
                    grade=Grade(rule.grade),
                    amplitude_deg=cell_number(row, "amplitude_deg"),
                    rule=rule,
                )
            )
    return [*doubts, *remarks]


def finding_of_cause(
    table: str, row: AnyRow, cause: KnownFinding, numbers: tuple[Beyond, ...]
) -> Finding:
    """A cause of doubt about a row, or a remark on the device."""
    return Finding(
        name=cause.name,
        table=table,
        subject=subject_of(row),
        grade=Grade.NOTES if cause.is_result else Grade.DOUBTS,
        evidence=numbers,
        amplitude_deg=cell_number(row, "amplitude_deg"),
        frequency_hz=cell_number(row, "frequency_hz"),
    )


def cell_of_causes(findings: Sequence[Finding], are_doubts: bool) -> str:
    """The causes of doubt about a row in one cell, or those of its other findings."""
    causes = [
        finding.cause for finding in findings if (finding.grade is Grade.DOUBTS) == are_doubts
    ]
    return BETWEEN.join(dict.fromkeys(causes))


def marked(table: pl.DataFrame, findings: RowFindings, name: str) -> pl.DataFrame:
    """The table `name` with the column `DOUBTFUL`, the causes of doubt about each row (empty: none;
    null: no fit), and with `remarks`, which also says what could not be checked, if the table has
    it."""
    is_fit = pl.col(EXCLUDED).is_null() if EXCLUDED in table.columns else pl.lit(True)
    doubts = pl.Series([cell_of_causes(row, True) for row in findings], dtype=pl.String)
    other_causes = pl.Series([cell_of_causes(row, False) for row in findings], dtype=pl.String)
    table = table.with_columns(pl.when(is_fit).then(doubts).alias(DOUBTFUL))
    if name not in HAVE_REMARKS:
        return table
    return table.with_columns(remarks=other_causes.replace("", None))


def results_in(remarks: str | None) -> list[str]:
    """Those findings in a cell of the column `remarks` that are properties of the device."""
    titles = (remarks or "").split(BETWEEN)
    return [kind.title for kind in FINDINGS.values() if kind.is_result and kind.title in titles]


def with_inherited(
    table: pl.DataFrame,
    findings: RowFindings,
    origin: pl.DataFrame,
    findings_of_origin: RowFindings,
) -> RowFindings:
    """Add to the findings about each row the doubts of another table about the same trial and
    amplitude, or about the whole trial: a clipped or late torque concerns everything from the same
    samples.

    Parameters
    ----------
    table, findings
        The rows of a table, and the findings about them.
    origin, findings_of_origin
        The rows of the other table, and the findings about them.
    """
    doubts_by_fit: dict[tuple[Any, ...], list[Finding]] = {}
    for fit, of_row in zip(trials_and_amplitudes(origin), findings_of_origin, strict=True):
        doubts_by_fit[fit] = [finding for finding in of_row if finding.grade is Grade.DOUBTS]
    extended: RowFindings = []
    for fit, of_row in zip(trials_and_amplitudes(table), findings, strict=True):
        extended.append([*of_row, *doubts_by_fit.get(fit, ())])
    return extended


def trials_and_amplitudes(table: pl.DataFrame) -> list[tuple[Any, ...]]:
    """The trial and the amplitude of each row; None for the amplitude of a whole trial."""
    amplitude = pl.col("amplitude_deg") if "amplitude_deg" in table.columns else pl.lit(None)
    return table.select("trial", amplitude=amplitude).rows()


NAMES_IN_TABLE = {("belt", "K"): "K_s", ("transmission", "B"): "B_j", ("transmission", "I"): "J_j"}
"""Columns of the stiffness, damping and inertia of tables that do not call them K, B and I."""


def estimate_column(table: str, symbol: str) -> str:
    """The column of K, B or I in a table."""
    return NAMES_IN_TABLE.get((table, symbol), symbol)


def interval(row: AnyRow, column: str) -> tuple[float | None, float | None, float | None]:
    """An estimate and the ends of its interval; None where one is not known."""
    value, low, high = (cell_number(row, f"{column}{end}") for end in ("", "_low", "_high"))
    return value, low, high


def size_and_half_width(row: AnyRow, column: str) -> tuple[float, float]:
    """The size of an estimate, of which shares are taken: itself or, where it is not told from 0,
    the half-width of its 95 % interval; and this half-width, 0 where it is not known."""
    estimate, low, high = interval(row, column)
    half_width = 0.0 if low is None or high is None else (high - low) / 2
    return max(abs(estimate or 0.0), half_width), half_width


def shares_moved(table: str, row: AnyRow, evidence: Sequence[Beyond]) -> dict[str, float]:
    """By which share of itself the other reading of time stamps may move each of K, B and I that
    the row has; empty where the row does not tell."""
    moved: dict[str, float] = {}
    for number in evidence:
        if number.column == "time_base_shift":  # in half-widths of the interval
            for symbol in ESTIMATES:
                size, half_width = size_and_half_width(row, estimate_column(table, symbol))
                if half_width > 0:
                    moved[symbol] = number.value * half_width / size
    return moved


def is_within_accuracy(
    table: str, row: AnyRow, evidence: Sequence[Beyond], accuracy: Accuracy
) -> bool:
    """Whether the evidence of a cause certainly moves K, B and I by less than their accuracy: the
    row tells by how much, and no other number of it is beyond a limit of its own."""
    for number in evidence:
        rule = rule_of(number.column, number.side)
        if rule is None or rule.by != "effect":
            return False
    moved = shares_moved(table, row, evidence)
    return bool(moved) and all(share < accuracy.of(symbol) for symbol, share in moved.items())
