# SPDX-License-Identifier: Apache-2.0
"""The findings that a trial can have, and the rules that find them (`findings.yaml`)."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from osl_analysis.base.files import own_yaml

Texts = str | Sequence[str]  # of several the first counts of which all numbers are known


@dataclass(frozen=True)
class KnownFinding:
    """What a reader is told of a finding, and how it bears on others.

    Attributes
    ----------
    name
        The short name by which code and `findings.csv` identify it, such as `late_torque`.
    title
        What a reader calls it.
    says, remedy
        What is wrong, and what to do, with columns of the row in braces.
    brief
        The remedy in a few words, where it has many.
    unseen, unseen_remedy
        The same, where it could not be checked.
    is_result
        Whether it is a property of the device, which is then not of second order: the fit is what
        it says, and not doubtful.
    spoils_estimates
        Whether it names the cause where an estimate is doubtful, and makes one doubtful whose
        half-width and half-range exceed what is needed.
    """

    name: str
    title: str
    says: Texts
    remedy: Texts = ""
    brief: str = ""
    unseen: str = ""
    unseen_remedy: str = ""
    is_result: bool = False
    spoils_estimates: bool = False


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


TOLERANCE = 1e-3  # of a threshold: clocks of 100 Hz that nobody set run at 99.99 Hz


@dataclass(frozen=True)
class Check:
    """A check of recordings, whose threshold stands in the configuration."""

    name: str
    finding: str
    unit: str  # of its value and threshold
    meaning: str  # of its value
    fails: Literal["above", "below"] = "above"  # the side of its threshold on which it fails

    def failed(self, value: float | None, limit: float) -> bool:
        """Whether a value is beyond its threshold by more than `TOLERANCE`; NaN fails, None (not
        applicable) does not."""
        if value is None:
            return False
        tolerance = TOLERANCE * limit
        if self.fails == "below":
            return not value >= limit - tolerance
        return not value <= limit + tolerance


CONTENT: dict[str, Any] = own_yaml(Path(__file__).with_name("findings.yaml"))
FINDINGS = {name: KnownFinding(name, **fields) for name, fields in CONTENT["findings"].items()}
RULES = [rule for fields in CONTENT["rules"] for rule in rules_of(fields)]
CHECKS = {name: Check(name, **fields) for name, fields in CONTENT["checks"].items()}


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


def known_finding(name: str) -> KnownFinding:
    """A finding of `findings.yaml`; of a column that has a limit in the configuration, and no entry
    there, one without words."""
    return FINDINGS.get(name) or KnownFinding(name, title=name, says="")
