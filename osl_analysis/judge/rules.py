# SPDX-License-Identifier: Apache-2.0
"""The rules that find what no budget tells: a number of a row that is beyond its limit, or what is
missing in it."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Literal

from osl_analysis.base.units import known_factor
from osl_analysis.judge.known_findings import CONTENT, Texts

AnyRow = Mapping[str, object]  # a row of a result table


class Grade(StrEnum):
    """What a finding does to its trial or fit."""

    EXCLUDES = "excludes"  # it is in no other table and in no figure
    DOUBTS = "doubts"
    UNCHECKED = "not checked"
    NOTES = "notes"  # checked, and worth knowing


LIMIT_SIDES = ("above", "below", "ratio")  # of limits


@dataclass(frozen=True)
class Rule:
    """When a row of a result table has a finding: a number is beyond a limit, or is missing.

    `findings.yaml` says what each field means.
    """

    finding: str
    column: str = ""
    above: float | None = None
    below: float | None = None
    ratio: float | None = None
    within: Mapping[str, float] = field(default_factory=dict)
    without: Collection[str] = ()
    given: Collection[str] = ()
    tables: Collection[str] = ()
    units: Sequence[str] = ()
    second: str = ""
    unless: Collection[str] = ()
    grade: Literal["not checked", "notes", "doubts"] = "doubts"
    says: Texts = ""
    remedy: Texts = ""
    is_of_estimate: bool = False

    def holds(self, row: Mapping[str, Any]) -> bool:
        """Whether a row is within all limits of `within`, and has what it should."""
        return (
            all(row.get(column) is None for column in self.without)
            and all(row.get(column) is not None for column in self.given)
            and all(
                row.get(column) is not None and abs(row[column]) < limit
                for column, limit in self.within.items()
            )
        )

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest number that are not beyond its limit."""
        if self.ratio is not None:
            return 1 / self.ratio, self.ratio
        high = math.inf if self.above is None else self.above
        return -high if self.below is None else self.below, high


def rules_of(fields: Mapping[str, Any]) -> Iterator[Rule]:
    """A rule on each of the columns that an entry of `findings.yaml` names."""
    others = {name: value for name, value in fields.items() if name != "columns"}
    for column in fields.get("columns", [fields.get("column", "")]):
        yield Rule(**{**others, "column": column})


RULES = [rule for fields in CONTENT["rules"] for rule in rules_of(fields)]


def rule_of(column: str, side: str = "above", table: str = "") -> Rule:
    """The rule by which a number beyond a limit on this side is a doubt, of any table if none is
    named, with its words; of a column that has none, one without words."""
    of_column = [
        rule
        for rule in RULES
        if (rule.column, rule.grade) == (column, "doubts")
        and (not table or not rule.tables or table in rule.tables)
    ]
    on_side = [rule for rule in of_column if getattr(rule, side) is not None]
    return next(iter([*on_side, *of_column]), Rule(finding=column, column=column))


@dataclass(frozen=True)
class Beyond:
    """A number beyond its limit, as evidence."""

    column: str
    value: float  # in the unit of the column
    limit: float
    # above or below the limit, near a factor between units, or nan; not in `findings.csv`
    side: str = ""
    finding: str = ""  # what it is evidence of
    unit: str = ""  # the factor between units that it may be, in words
    rule: Rule = field(default=Rule(""), compare=False)  # with the words for it

    @property
    def excess(self) -> float:
        """Factor by which the number exceeds its limit: infinite beyond 0, and of NaN."""
        small, large = sorted([abs(self.value), abs(self.limit)])
        return large / small if small > 0 else math.inf


# relative differences between components and their file have a standard deviation of 2 %
NEAR_UNIT = 0.04  # relative difference of a ratio to a known value from the factor between units
Numbers = dict[str, Beyond]  # numbers of a row beyond their limits, by column


def cell_number(row: AnyRow, name: str) -> float | None:
    """The number in a column of a row; None for a text, a null, or a column that is not there."""
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else None


def numbers_beyond(row: AnyRow, rules: Sequence[Rule]) -> Numbers:
    """Find the numbers of a row that are beyond their limits.

    Parameters
    ----------
    row : AnyRow
        A null is not checked.
    rules : Sequence of Rule
        Those on its table.

    Returns
    -------
    dict of str to Beyond
        By column; NaN is beyond any limit, and a ratio near a unit's factor is `near`.
    """
    numbers: Numbers = {}
    for rule in rules:
        column = rule.column
        value = cell_number(row, column)
        low, high = rule.ends
        if value is None or low == -high == -math.inf or column in numbers:
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
        limit = low if side == "below" or math.isinf(high) else high
        finding = "wrong_unit" if is_unit else rule.finding
        numbers[column] = Beyond(column, value, limit, side, finding, unit, rule)
    return numbers


def unit_of_ratio(rule: Rule, ratio: float, row: AnyRow) -> tuple[str, bool]:
    """The factor between units near a ratio to a known value, in words, and whether it is more
    likely than another device.

    A second ratio decides that: a wrong torque scales both alike, a wrong current only this one."""
    if not rule.units or not ratio:
        return "", False
    second = cell_number(row, rule.second)
    likely = []
    if second:
        of_signals = {"current": second}
        likely = [
            signal
            for signal in rule.units
            if abs(of_signals.get(signal, second / ratio) - 1) < NEAR_UNIT
        ]
    unit = known_factor(ratio, likely, NEAR_UNIT)
    return unit or known_factor(ratio, rule.units, NEAR_UNIT), bool(unit)
