"""Findings about the rows of result tables, from the rules and the configured limits, and the
tables with them.

What a known cause explains, such as a low VAF due to friction, is no finding of its own.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import polars as pl

from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.judge.finding import AnyRow, Beyond, Finding, Grade, cell_number, subject_of
from osl_analysis.judge.known_findings import (
    FAMILIES,
    FINDINGS,
    RULES,
    SIDES,
    KnownFinding,
    Rule,
    known_finding,
    rule_of,
)
from osl_analysis.judge.limits import Limits
from osl_analysis.stats.repeats import DOUBTFUL
from osl_analysis.units import known_factor

EXCLUDED = "reason"  # column: why a row has no fit; null in rows with a fit
BETWEEN = "; "  # titles of findings in a cell
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
    accuracy = limits.accuracy.model_dump()
    needed = {f"accuracy_{symbol}": pl.lit(share) for symbol, share in accuracy.items()}
    table = table.with_columns(**needed)
    rules = rules_on(name, table.columns, limits)
    conditions = [rule.condition.alias(str(k)) for k, rule in enumerate(rules) if rule.when]
    holds = table.select(conditions).to_dict(as_series=False)
    rows = table.to_dicts()
    met = [
        [
            rule
            for k, rule in enumerate(rules)
            if row.get(EXCLUDED) is None and (not rule.when or holds[str(k)][at])
        ]
        for at, row in enumerate(rows)
    ]
    beyond = [numbers_beyond(row, of_row, accuracy) for row, of_row in zip(rows, met, strict=True)]
    # fits to whole trials, beside fits to single amplitudes
    are_whole = [row.get("amplitude_deg", "") is None for row in rows]
    of_whole = {row.get("trial"): beyond[k] for k, row in enumerate(rows) if are_whole[k]}
    # at one amplitude friction looks like a fault of the recording; over all amplitudes it does not
    for numbers, row in zip(beyond, rows, strict=True):
        shown = of_whole.get(row.get("trial"), numbers)
        for column, number in list(numbers.items()):
            if known_finding(number.finding).of_recording and column not in shown:
                del numbers[column]

    # what explains the misfit of a trial, by the fit to all of it before those to its amplitudes
    misfit_by: dict[object, KnownFinding | None] = {}
    for k in sorted(range(len(rows)), key=lambda k: not are_whole[k]):
        trial = rows[k].get("trial")
        misfit_by[trial] = misfit_by.get(trial) or explaining(beyond[k])

    findings: RowFindings = []
    for row, numbers, of_row in zip(rows, beyond, met, strict=True):
        causes = causes_in(numbers, misfit_by[row.get("trial")])
        fault = FINDINGS.get((faults or {}).get(str(row.get("trial")), ""))
        without_number = [rule for rule in of_row if not rule.column]
        findings.append(findings_of_row(name, row, with_effects(causes, fault), without_number))
    return findings


def rules_on(table: str, columns: Collection[str], limits: Limits) -> list[Rule]:
    """The rules on a table with these columns: those of `findings.yaml`, and those whose limits the
    configuration states."""
    rules = [rule for rule in RULES if rule.concerns(table, columns)]
    for side in SIDES:
        for column, value in getattr(limits, side).items():
            if column in columns:
                no_other = dict.fromkeys(SIDES)
                rules.append(replace(rule_of(column, side), **{**no_other, side: value}))
    return rules


def numbers_beyond(row: AnyRow, rules: Sequence[Rule], accuracy: Mapping[str, float]) -> Numbers:
    """Find the numbers of a row that are beyond their limits.

    Parameters
    ----------
    row : AnyRow
        A null is not checked.
    rules : Sequence of Rule
        Those on its table (`rules_on`) whose conditions it meets.
    accuracy : Mapping of str to float
        That K, B and I need.

    Returns
    -------
    dict of str to Beyond
        By column; NaN is beyond any limit, and a ratio near a unit's factor is `near`.
    """
    numbers: Numbers = {}
    for rule in rules:
        column = rule.column
        value = cell_number(row, column)
        low, high = rule.ends(accuracy)
        if value is None or math.isinf(low) or column in numbers:  # without a limit, or judged
            continue
        unit, is_unit = unit_of_ratio(rule, value, row)
        if math.isnan(value):
            side = "nan"
        elif value > high:
            side = "above"
        elif value < low:
            side = "below"
        elif is_unit:
            side = "near"
        else:
            continue
        finding = FAMILIES.get(str(row.get(rule.finding)), rule.finding)
        limit = low if side == "below" or math.isinf(high) else high
        numbers[column] = Beyond(
            column, value, limit, side, "wrong_unit" if is_unit else finding, unit, rule
        )
    return numbers


def unit_of_ratio(rule: Rule, ratio: float, row: AnyRow) -> tuple[str, bool]:
    """The factor between units near a ratio to a known value, in words, and whether it is more
    likely than another device.

    A second ratio decides that: a wrong torque scales both alike, a wrong current only this one."""
    if not rule.units or not ratio:
        return "", False
    second = cell_number(row, rule.second)
    symbol = rule.column.removesuffix("_ratio")
    estimate, high = cell_number(row, symbol), cell_number(row, f"{symbol}_high")
    is_known = not (estimate and high) or high <= NearUnit.MOST_UNCERTAIN * estimate
    if second and is_known:
        near, near_second = NearUnit.OF_RATIO, NearUnit.OF_SECOND
        if rule.to_stated:
            near = near_second = NearUnit.OF_STATED
        likely = [
            signal
            for signal in rule.units
            if abs((second if signal == "current" else second / ratio) - 1) < near_second
        ]
        unit = known_factor(ratio, likely, near)
        if unit:
            return unit, True
    size = max(abs(ratio), 1 / abs(ratio))
    near = NearUnit.OF_LARGE_RATIO if size > NearUnit.LARGE else NearUnit.OF_STATED
    return known_factor(ratio, rule.units, near), False


def explaining(numbers: Numbers) -> KnownFinding | None:
    """The first cause in a row that makes its fit worse; harmonics alone count as friction."""
    by_misfit = sorted(numbers.values(), key=lambda number: number.rule.misfit)
    causes = (known_finding(number.finding) for number in by_misfit)
    return next((cause for cause in causes if cause.explains_misfit), None)


def rank_of(number: Beyond) -> int:
    """The place of evidence among that of its row: causes of others first, unknown ones last."""
    if number.finding not in FINDINGS:
        return 2
    return 0 if FINDINGS[number.finding].causes_others and number.excess > FAR_BEYOND else 1


def causes_in(numbers: Numbers, misfit_by: KnownFinding | None) -> list[Cause]:
    """Order the numbers of a row by their causes: causes of others first, unknown ones last.
    `misfit_by` explains the misfit of the trial, and takes the columns that show it."""
    numbers_of: dict[str, list[Beyond]] = {}
    for number in sorted(numbers.values(), key=rank_of):
        name = misfit_by.name if misfit_by and number.rule.misfit else number.finding
        numbers_of.setdefault(name, []).append(number)
    return [(known_finding(name), tuple(of)) for name, of in numbers_of.items()]


def with_effects(causes: list[Cause], fault: KnownFinding | None) -> list[Cause]:
    """Causes of which those that may be effects of a fault of the recording are evidence of it.
    `fault` is what a check of the recording found; None: what the row shows."""
    fault = fault or next((cause for cause, _ in causes if cause.spoils_estimates), None)
    effects: list[Beyond] = []
    others = []
    for cause, numbers in causes:
        if cause is fault or cause.explains_misfit or cause.is_misfit:
            effects += numbers
        else:
            others.append((cause, numbers))
    return [(fault, tuple(effects)), *others] if fault and effects else causes


def findings_of_row(
    table: str, row: AnyRow, causes: Sequence[Cause], conditions: Sequence[Rule]
) -> list[Finding]:
    """The doubts about a row by their causes, remarks on properties of the device, and what could
    not be checked."""
    finding = partial(
        Finding,
        table=table,
        subject=subject_of(row),
        amplitude_deg=cell_number(row, "amplitude_deg"),
    )
    doubts = [cause for cause, _ in causes if not cause.is_result]
    are_explained = any(doubt.explains_misfit for doubt in doubts)
    findings = [
        finding(
            name=cause.name,
            grade=Grade.NOTES if cause.is_result else Grade.DOUBTS,
            evidence=numbers,
            frequency_hz=cell_number(row, "frequency_hz"),
        )
        for cause, numbers in sorted(causes, key=lambda cause: cause[0].is_result)
        if not (are_explained and cause.is_misfit)
    ]
    names = {cause.name for cause, _ in causes}
    findings += [
        finding(name=rule.finding, grade=Grade(rule.grade), rule=rule)
        for rule in conditions
        if not names & set(rule.unless)
    ]
    return findings


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
    if "remarks" not in described_tables_by_name()[name].columns:
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
