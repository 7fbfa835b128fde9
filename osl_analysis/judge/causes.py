"""Which cause a number beyond its limit is evidence of. Values decide here; words stand in
`words`."""

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
    """A cause of numbers beyond their limits."""

    name: str  # its name everywhere
    # it makes a fit worse, so that the misfit of the same trial is no cause of its own
    explains: bool = False
    of_recording: bool = False
    """A fault of the recording does not depend on amplitude: the fit to all of a trial must show
    it, too."""
    first: bool = False  # it causes others, as a wrong unit or sign does
    of: Sequence[str] = ()  # results that it concerns; empty: all
    # no estimate can be told beside it: other causes of a worse fit may be its effect
    spoils: bool = False
    without: Mapping[str, str] = field(default_factory=dict)
    """Columns of the estimates by K, B and I, from the same fit with this cause as a column of the
    regression."""


@dataclass(frozen=True)
class Evidence:
    """A column of result tables."""

    column: str
    cause: str
    misfit: bool = False  # a cause that explains the trial's misfit takes this column, too
    size: str = ""  # estimate (K, B, I) of which the number is a share
    of: Sequence[str] = ("torque", "angle")  # signals whose units scale this ratio to a known value
    # column of another ratio that tells a unit from another device; its own name: none is needed
    second_ratio: str = ""
    decided_by: Literal["configuration", "accuracy", "effect", "sign"] = "configuration"
    """What decides whether it is a doubt: a limit of the configuration; the accuracy that the
    estimate `size` needs; by how much the estimates with the cause in the fit differ; or that it is
    certainly below zero."""
    tables: Sequence[str] = ()  # in which it counts; empty: in all


BETWEEN = "; "  # names of causes in a cell
CAUSES = {name: Cause(name, **facts) for name, facts in TABLE["causes"].items()}
HYPOTHESES: dict[str, str] = TABLE["hypotheses"]
"""Causes by hypothesis of the inference, or by its family."""
EVIDENCE = {name: Evidence(name, **facts) for name, facts in TABLE["columns"].items()}
"""The evidence by column. Any other column may have a limit, too: its cause is then its name."""


def doubts_of_result(names: str, result: str) -> str:
    """Those causes in a cell of the column `DOUBTFUL` that concern one result of the fit."""
    apart = [cause for cause in CAUSES.values() if cause.of and result not in cause.of]
    return BETWEEN.join(
        name for name in names.split(BETWEEN) if name not in {cause.name for cause in apart}
    )


# `fault_harm` is a multiple of what is worth telling; `certain_lag_damping` is in N*m*s/rad:
# one sample at 300 Hz and K = 300 N*m/rad
LEAST_EFFECT = 1.0


def limits_in(table: str, row: AnyRow, limits: Limits) -> list[Limit]:
    """The limits of a row of a table: those that follow from the accuracy of its estimates, those
    of the configuration, and that nothing is below zero that cannot be."""
    configured = limits.stated()
    stated = {limit.column for limit in configured}
    by_accuracy, by_sign = list[Limit](), list[Limit]()
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
    """The numbers of a row that are beyond their limits or NaN, by column; a null is not
    checked."""
    numbers: dict[str, Beyond] = {}
    for limit in limits_in(table, row, limits):
        name, value = limit.column, cell_number(row, limit.column)
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
    """The factor between units (`known_factor`) near a ratio that a device may have as well: within
    4 %, as components differ from their file by 2 % (SD); of a desired curve within 1.5 %. The
    second ratio decides: a wrong torque scales both ratios alike, a wrong current only this one,
    each within 10 %."""
    evidence, symbol = EVIDENCE.get(name), name.removesuffix("_ratio")
    second = cell_number(row, evidence.second_ratio) if evidence and evidence.second_ratio else None
    value, high = cell_number(row, symbol), cell_number(row, f"{symbol}_high")
    if evidence is None or not second or (value and high and high > 1.05 * value):
        return ""
    of_current = [signal for signal in evidence.of if signal == "current" and abs(second - 1) < 0.1]
    others = [
        signal for signal in evidence.of if signal != "current" and abs(second / ratio - 1) < 0.1
    ]
    return known_factor(ratio, of_current + others, 0.015 if symbol == "desired" else 0.04)[0]


def cause_of(name: str, value: float, row: AnyRow) -> Cause:
    """The cause of a number beyond its limit; for an unknown column its name."""
    if name not in EVIDENCE:
        return Cause(name)
    if suspected_unit(name, value, row):
        return CAUSES["another unit"]
    if name == "residual_over_gait" and cell_number(row, "plate_ringing_hz"):
        return CAUSES["plate that rings"]
    if name == "rate_change" and value < 0:
        return CAUSES["loss that falls with speed"]
    if name == "fault_harm":
        hypothesis, family = str(row.get("fault")), str(row.get("fault_family"))
        return CAUSES[HYPOTHESES.get(hypothesis) or HYPOTHESES[family]]
    if name == "K_change" and (value > 0 or row.get("fault_family") == "size"):
        return CAUSES["spring that is not linear"]
    return CAUSES[EVIDENCE[name].cause]


def explaining(row: AnyRow, found: Mapping[str, Beyond]) -> Cause | None:
    """The first cause in a row that makes its fit worse; harmonics alone count as friction."""
    names = sorted(
        (name for name in found if name in EVIDENCE), key=lambda name: EVIDENCE[name].misfit
    )
    causes = (cause_of(name, found[name].value, row) for name in names)
    return next((cause for cause in causes if cause.explains), None)


def causes_in(
    row: AnyRow, found: Mapping[str, Beyond], misfit_by: Cause | None
) -> list[tuple[Cause, list[Beyond]]]:
    """The evidence `found` in a row by cause: causes of others first, unknown last; `misfit_by`
    takes the misfit."""

    def order(one: Beyond) -> int:
        known = EVIDENCE.get(one.column)
        # a cause of others precedes them if it is far beyond its limit
        return 2 if known is None else 0 if CAUSES[known.cause].first and one.excess > 1.15 else 1

    by_cause: dict[str, tuple[Cause, list[Beyond]]] = {}
    for one in sorted(found.values(), key=order):
        is_misfit = one.column in EVIDENCE and EVIDENCE[one.column].misfit
        cause = misfit_by if misfit_by and is_misfit else cause_of(one.column, one.value, row)
        by_cause.setdefault(cause.name, (cause, []))[1].append(one)
    spoilt = any(cause.spoils for cause, _ in by_cause.values())
    return [one for one in by_cause.values() if not spoilt or one[0].spoils or not one[0].explains]
