"""Which finding a number beyond its limit is evidence of. Values decide here; words stand in
`words.py`."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from osl_analysis.judge.finding import AnyRow, Beyond, cell_number
from osl_analysis.judge.known_findings import (
    EVIDENCE,
    FINDINGS,
    HYPOTHESES,
    KnownFinding,
    known_finding,
)
from osl_analysis.judge.limits import Limit, Limits
from osl_analysis.units import known_factor


@dataclass(frozen=True)
class CauseInRow:
    """A cause of doubt with its numbers beyond their limits in one row."""

    cause: KnownFinding
    numbers: tuple[Beyond, ...]


LEAST_EFFECT = 1.0  # limit of what is decided by its effect, a multiple of what is worth telling
# relative differences between components and their file have a standard deviation of 2 %
NEAR_UNIT = 0.04  # of a ratio to a unit's factor
RATIOS_TO_STATED = ("desired_ratio", "K_over_K_d")  # to a desired curve, or to stated gains
NEAR_STATED = 0.015  # of these ratios to a unit's factor, and of a second one to the first
NEAR_SECOND_RATIO = 0.1  # of the second ratio to what another unit would make of it
LARGEST_UNCERTAINTY = 1.05  # upper end over estimate, above which a ratio tells no unit
FAR_BEYOND = 1.15  # of a limit: a cause of others that is farther beyond it precedes them


BETWEEN = "; "  # titles of findings in a cell
FINDINGS_BY_TITLE = {kind.title: kind for kind in FINDINGS.values()}


def doubts_of_result(titles: str, result: str) -> str:
    """Those findings in a cell of the column `DOUBTFUL` that concern one result of the fit."""
    concerning = []
    for title in titles.split(BETWEEN):
        kind = FINDINGS_BY_TITLE.get(title)
        if kind is None or not kind.concerns or result in kind.concerns:
            concerning.append(title)
    return BETWEEN.join(concerning)


def results_in(remarks: str | None) -> list[str]:
    """Those findings in a cell of the column `remarks` that are properties of the device."""
    titles = (remarks or "").split(BETWEEN)
    return [kind.title for kind in FINDINGS.values() if kind.is_result and kind.title in titles]


def limits_in(table: str, columns: Collection[str], limits: Limits) -> list[Limit]:
    """The limits on the columns of a table: those that follow from the accuracy of its estimates,
    those of the configuration, and that nothing is below zero that cannot be."""
    configured = limits.stated()
    stated = {limit.column for limit in configured}
    by_accuracy: list[Limit] = []
    by_sign: list[Limit] = []
    for name, evidence in EVIDENCE.items():
        if (
            name not in columns
            or name in stated
            or (evidence.tables and table not in evidence.tables)
        ):
            continue
        if evidence.decided_by == "effect":
            by_accuracy.append(Limit(name, "above", LEAST_EFFECT))
        elif evidence.decided_by == "accuracy":
            by_accuracy.append(Limit(name, "above", limits.accuracy.of(evidence.share_of)))
        elif evidence.decided_by == "sign":
            by_sign.append(Limit(name, "below", 0.0))
    return [*by_accuracy, *configured, *by_sign]


def numbers_beyond(row: AnyRow, limits: Iterable[Limit]) -> dict[str, Beyond]:
    """Find the numbers of a row that are beyond their limits.

    Parameters
    ----------
    row : AnyRow
        A null is not checked.
    limits : iterable of Limit
        Those of its table (`limits_in`).

    Returns
    -------
    dict of str to Beyond
        By column; NaN is beyond any limit, and a ratio near a unit's factor is `near`.
    """
    numbers: dict[str, Beyond] = {}
    for limit in limits:
        name = limit.column
        value = cell_number(row, name)
        if limit.value is None or value is None:
            continue
        if math.isnan(value):
            numbers[name] = Beyond(name, value, limit.value, "nan")
        elif limit.side == "above" and value > limit.value:
            numbers[name] = Beyond(name, value, limit.value, "above")
        elif limit.side == "above" and value < -limit.value:
            numbers[name] = Beyond(name, value, -limit.value, "below")
        elif limit.side == "below" and value < limit.value:
            numbers[name] = Beyond(name, value, limit.value, "below")
        elif name not in numbers and suspected_unit(name, value, row):
            numbers[name] = Beyond(name, value, limit.value, "near")
    return numbers


def suspected_unit(name: str, ratio: float, row: AnyRow) -> str:
    """The factor between units (`known_factor`) near a ratio that a device may have as well; empty
    for none.

    The second ratio decides: a wrong torque scales both ratios alike, a wrong current only this
    one."""
    evidence = EVIDENCE.get(name)
    if evidence is None or not evidence.second_ratio:
        return ""
    second_ratio = cell_number(row, evidence.second_ratio)
    if not second_ratio or not ratio:
        return ""
    symbol = name.removesuffix("_ratio")
    estimate = cell_number(row, symbol)
    high = cell_number(row, f"{symbol}_high")
    if estimate and high and high > LARGEST_UNCERTAINTY * estimate:
        return ""
    near, near_second = NEAR_UNIT, NEAR_SECOND_RATIO
    if name in RATIOS_TO_STATED:
        near = near_second = NEAR_STATED
    is_current_likely = abs(second_ratio - 1) < near_second
    are_others_likely = abs(second_ratio / ratio - 1) < near_second
    of_current: list[str] = []
    of_others: list[str] = []
    for signal in evidence.signals:
        if signal == "current" and is_current_likely:
            of_current.append(signal)
        if signal != "current" and are_others_likely:
            of_others.append(signal)
    factor_name, _ = known_factor(ratio, of_current + of_others, near)
    return factor_name


def cause_of(number: Beyond, row: AnyRow) -> KnownFinding:
    """The cause of a number beyond its limit; for an unknown column its name."""
    name, value = number.column, number.value
    if name not in EVIDENCE:
        return known_finding(name)
    if suspected_unit(name, value, row):
        return FINDINGS["wrong_unit"]
    if name == "fault_harm":
        return FINDINGS[HYPOTHESES[str(row["fault_family"])]]
    if name == "K_change" and (value > 0 or row.get("fault_family") == "size"):
        return FINDINGS["nonlinear_spring"]
    return FINDINGS[EVIDENCE[name].on_side(number.side).finding]


def explaining(row: AnyRow, numbers: Mapping[str, Beyond]) -> KnownFinding | None:
    """The first cause in a row that makes its fit worse; harmonics alone count as friction."""
    columns = [name for name in numbers if name in EVIDENCE]
    for name in sorted(columns, key=lambda name: EVIDENCE[name].is_misfit):
        cause = cause_of(numbers[name], row)
        if cause.explains_misfit:
            return cause
    return None


def rank_of(number: Beyond) -> int:
    """The place of evidence among that of its row: causes of others first, unknown ones last."""
    if number.column not in EVIDENCE:
        return 2
    finding = EVIDENCE[number.column].on_side(number.side).finding
    causes_others = FINDINGS[finding].causes_others
    return 0 if causes_others and number.excess > FAR_BEYOND else 1


def causes_in(
    row: AnyRow, numbers: Mapping[str, Beyond], misfit_by: KnownFinding | None
) -> list[CauseInRow]:
    """Order the numbers of a row by their causes.

    Parameters
    ----------
    row : AnyRow
    numbers : Mapping of str to Beyond
        Its numbers beyond their limits, by column.
    misfit_by : KnownFinding or None
        What explains the misfit of the trial, which takes the columns that show it.

    Returns
    -------
    list of CauseInRow
        Causes of others first, unknown ones last.
    """
    numbers_of: dict[str, list[Beyond]] = {}
    for number in sorted(numbers.values(), key=rank_of):
        cause = cause_of(number, row)
        if misfit_by is not None and number.column in EVIDENCE:
            cause = misfit_by if EVIDENCE[number.column].is_misfit else cause
        numbers_of.setdefault(cause.name, []).append(number)
    return [CauseInRow(known_finding(name), tuple(of)) for name, of in numbers_of.items()]


def with_effects(causes: list[CauseInRow], fault: KnownFinding | None) -> list[CauseInRow]:
    """Causes of which those that may be effects of a fault of the recording are evidence of it.
    `fault` is what a check of the recording found; None: what the row shows."""
    fault = fault or next((each.cause for each in causes if each.cause.spoils_estimates), None)
    effects = [
        each
        for each in causes
        if each.cause is fault or each.cause.explains_misfit or each.cause.is_misfit
    ]
    if fault is None or not effects:
        return causes
    numbers = tuple(number for each in effects for number in each.numbers)
    return [CauseInRow(fault, numbers), *(each for each in causes if each not in effects)]
