"""Which cause a number beyond its limit is evidence of. Values decide here; words stand in
`words.py`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from osl_analysis.dictionary import own_yaml
from osl_analysis.judge.finding import AnyRow, Beyond, Limit, Limits, cell_number
from osl_analysis.units import known_factor

TABLE: dict[str, dict[str, Any]] = own_yaml(Path(__file__).with_suffix(".yaml"))


@dataclass(frozen=True)
class Cause:
    """A cause of numbers beyond their limits.

    Attributes
    ----------
    name
        Its name in every table, message and document.
    explains
        Whether it makes a fit worse, so that the misfit of the same trial is no cause of its own.
    of_recording
        Whether it is a fault of the recording, which does not depend on amplitude: the fit to all
        of a trial must show it, too.
    first
        Whether it causes others, as a wrong unit or sign does.
    of
        Results that it concerns; empty: all.
    spoils
        Whether no estimate can be told beside it: other causes of a worse fit may be its effect.
    without
        Columns of the estimates by K, B and I, from the same fit with this cause as a column of the
        regression.
    """

    name: str
    explains: bool = False
    of_recording: bool = False
    first: bool = False
    of: Sequence[str] = ()
    spoils: bool = False
    without: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Evidence:
    """A column of result tables.

    Attributes
    ----------
    cause
        The cause of a number beyond its limit.
    misfit
        Whether a cause that explains the trial's misfit takes this column, too.
    size
        The estimate (K, B, I) of which the number is a share; empty: none.
    of
        Signals whose units scale this ratio to a known value.
    second_ratio
        Column of another ratio that tells a unit from another device; its own name: none is needed;
        empty: the number is no such ratio.
    decided_by
        What decides whether it is a doubt: a limit of the configuration; the accuracy that the
        estimate `size` needs; by how much the estimates with the cause in the fit differ; or that
        it is certainly below zero.
    tables
        In which it counts; empty: in all.
    """

    column: str
    cause: str
    misfit: bool = False
    size: str = ""
    of: Sequence[str] = ("torque", "angle")
    second_ratio: str = ""
    decided_by: Literal["configuration", "accuracy", "effect", "sign"] = "configuration"
    tables: Sequence[str] = ()


@dataclass(frozen=True)
class CauseInRow:
    """A cause with its numbers beyond their limits in one row."""

    cause: Cause
    numbers: Sequence[Beyond]


BETWEEN = "; "  # names of causes in a cell
CAUSES = {name: Cause(name, **fields) for name, fields in TABLE["causes"].items()}
HYPOTHESES: dict[str, str] = TABLE["hypotheses"]
"""Causes by hypothesis of the inference, or by its family."""
EVIDENCE = {name: Evidence(name, **fields) for name, fields in TABLE["columns"].items()}
"""The evidence by column. Any other column may have a limit, too: its cause is then its name."""

# Limit of what is decided by its effect. `fault_harm` is a multiple of what is worth telling;
# `certain_lag_damping` is in N*m*s/rad: one sample at 300 Hz and K = 300 N*m/rad
LEAST_EFFECT = 1.0
# relative differences between components and their file have a standard deviation of 2 %
NEAR_UNIT = 0.04  # of a ratio to a unit's factor
NEAR_UNIT_OF_CURVE = 0.015  # the same, of the ratio to a desired curve
NEAR_SECOND_RATIO = 0.1  # of the second ratio to what another unit would make of it
LARGEST_UNCERTAINTY = 1.05  # upper end over estimate, above which a ratio tells no unit
FAR_BEYOND = 1.15  # of a limit: a cause of others that is farther beyond it precedes them


def doubts_of_result(names: str, result: str) -> str:
    """Those causes in a cell of the column `DOUBTFUL` that concern one result of the fit."""
    concerning = []
    for name in names.split(BETWEEN):
        results = CAUSES[name].of if name in CAUSES else ()
        if not results or result in results:
            concerning.append(name)
    return BETWEEN.join(concerning)


def limits_in(table: str, row: AnyRow, limits: Limits) -> list[Limit]:
    """The limits of a row of a table: those that follow from the accuracy of its estimates, those
    of the configuration, and that nothing is below zero that cannot be."""
    configured = limits.stated()
    stated = {limit.column for limit in configured}
    by_accuracy: list[Limit] = []
    by_sign: list[Limit] = []
    for name, evidence in EVIDENCE.items():
        if name not in row or name in stated or (evidence.tables and table not in evidence.tables):
            continue
        if evidence.decided_by == "effect":
            by_accuracy.append(Limit(name, "above", LEAST_EFFECT))
        elif evidence.decided_by == "accuracy":
            by_accuracy.append(Limit(name, "above", limits.accuracy.of(evidence.size)))
        elif evidence.decided_by == "sign":
            by_sign.append(Limit(name, "below", 0.0))
    return [*by_accuracy, *configured, *by_sign]


def numbers_beyond(table: str, row: AnyRow, limits: Limits) -> dict[str, Beyond]:
    """Find the numbers of a row that are beyond their limits.

    Parameters
    ----------
    table : str
        Its name.
    row : AnyRow
        A null is not checked.
    limits : Limits
        Accuracy and limits of the table.

    Returns
    -------
    dict of str to Beyond
        By column; NaN is beyond any limit, and a ratio near a unit's factor is `near`.
    """
    numbers: dict[str, Beyond] = {}
    for limit in limits_in(table, row, limits):
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
    if not second_ratio:
        return ""
    symbol = name.removesuffix("_ratio")
    estimate = cell_number(row, symbol)
    high = cell_number(row, f"{symbol}_high")
    if estimate and high and high > LARGEST_UNCERTAINTY * estimate:
        return ""
    is_current_likely = abs(second_ratio - 1) < NEAR_SECOND_RATIO
    are_others_likely = abs(second_ratio / ratio - 1) < NEAR_SECOND_RATIO
    of_current: list[str] = []
    of_others: list[str] = []
    for signal in evidence.of:
        if signal == "current" and is_current_likely:
            of_current.append(signal)
        if signal != "current" and are_others_likely:
            of_others.append(signal)
    near = NEAR_UNIT_OF_CURVE if symbol == "desired" else NEAR_UNIT
    factor_name, _ = known_factor(ratio, of_current + of_others, near)
    return factor_name


def cause_of(name: str, value: float, row: AnyRow) -> Cause:
    """The cause of a number beyond its limit; for an unknown column its name."""
    if name not in EVIDENCE:
        return Cause(name)
    if suspected_unit(name, value, row):
        return CAUSES["another unit"]
    if name == "residual_over_gait" and cell_number(row, "plate_ringing_hz"):
        return CAUSES["plate that rings"]
    if name == "plate_unexplained" and cell_number(row, "plate_zeroed"):
        return CAUSES["plate with a threshold"]
    if name == "rate_change" and value < 0:
        return CAUSES["loss that falls with speed"]
    if name == "fault_harm" and cell_number(row, "row_harm"):
        return CAUSES["lost or joined rows"]
    if name == "fault_harm":
        hypothesis, family = str(row.get("fault")), str(row.get("fault_family"))
        return CAUSES[HYPOTHESES.get(hypothesis) or HYPOTHESES[family]]
    if name == "K_change" and (value > 0 or row.get("fault_family") == "size"):
        return CAUSES["spring that is not linear"]
    return CAUSES[EVIDENCE[name].cause]


def explaining(row: AnyRow, numbers: Mapping[str, Beyond]) -> Cause | None:
    """The first cause in a row that makes its fit worse; harmonics alone count as friction."""
    columns = [name for name in numbers if name in EVIDENCE]
    for name in sorted(columns, key=lambda name: EVIDENCE[name].misfit):
        cause = cause_of(name, numbers[name].value, row)
        if cause.explains:
            return cause
    return None


def rank_of(number: Beyond) -> int:
    """The place of evidence among that of its row: causes of others first, unknown ones last."""
    if number.column not in EVIDENCE:
        return 2
    causes_others = CAUSES[EVIDENCE[number.column].cause].first
    return 0 if causes_others and number.excess > FAR_BEYOND else 1


def causes_in(
    row: AnyRow, numbers: Mapping[str, Beyond], misfit_by: Cause | None
) -> list[CauseInRow]:
    """Order the numbers of a row by their causes.

    Parameters
    ----------
    row : AnyRow
    numbers : Mapping of str to Beyond
        Its numbers beyond their limits, by column.
    misfit_by : Cause or None
        What explains the misfit of the trial, which takes the columns that show it.

    Returns
    -------
    list of CauseInRow
        Causes of others first, unknown ones last. Beside a cause that spoils all estimates, no
        other that makes the fit worse is named.
    """
    causes: dict[str, Cause] = {}
    evidence: dict[str, list[Beyond]] = {}
    for number in sorted(numbers.values(), key=rank_of):
        is_misfit = number.column in EVIDENCE and EVIDENCE[number.column].misfit
        cause = cause_of(number.column, number.value, row)
        if misfit_by is not None and is_misfit:
            cause = misfit_by
        causes.setdefault(cause.name, cause)
        evidence.setdefault(cause.name, []).append(number)
    spoiler = next((cause for cause in causes.values() if cause.spoils), None)
    in_row = []
    for name, cause in causes.items():
        is_effect = spoiler is not None and cause.explains and cause is not spoiler
        if not is_effect:
            in_row.append(CauseInRow(cause, evidence[name]))
    return in_row
