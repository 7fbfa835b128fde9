"""The findings that a trial can have, and the rules that find them (`findings.yaml`)."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import polars as pl

from osl_analysis.files import own_yaml

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
    explains_misfit
        Whether it makes a fit worse, so that the misfit of the same trial is no finding of its own.
    of_recording
        Whether it is a fault of the recording, which does not depend on amplitude: the fit to all
        of a trial must show it, too.
    causes_others
        Whether it brings about other findings, as a wrong unit or sign does.
    is_result
        Whether it is a property of the device, which is then not of second order: the fit is what
        it says, and not doubtful.
    spoils_estimates
        Whether no estimate can be told beside it: other causes of a misfit may be its effect.
    is_misfit
        Whether it is a misfit without a known cause.
    """

    name: str
    title: str
    says: Texts
    remedy: Texts = ""
    brief: str = ""
    explains_misfit: bool = False
    of_recording: bool = False
    causes_others: bool = False
    is_result: bool = False
    spoils_estimates: bool = False
    is_misfit: bool = False


SIDES = ("above", "below", "ratio")  # of limits


@dataclass(frozen=True)
class Rule:
    """When a row of a result table has a finding: a number is beyond a limit, a condition holds, or
    both.

    `findings.yaml` says what each field means.
    """

    finding: str
    column: str = ""
    above: float | Literal["K", "B", "I"] | None = None
    below: float | None = None
    ratio: float | None = None
    when: str = ""
    tables: Collection[str] = ()
    in_unit: bool = False
    misfit: bool = False
    units: Sequence[str] = ()
    second: str = ""
    to_stated: bool = False
    unless: Collection[str] = ()
    grade: Literal["not checked", "notes", "doubts"] = "not checked"
    says: Texts = ""
    remedy: Texts = ""

    @cached_property
    def condition(self) -> pl.Expr:
        """The condition `when`; a null is none."""
        return pl.sql_expr(self.when).fill_null(value=False)

    def concerns(self, table: str, columns: Collection[str]) -> bool:
        """Whether the rule is about a table with these columns."""
        needed = self.condition.meta.root_names() if self.when else []
        if self.column:
            needed.append(self.column)
        return (not self.tables or table in self.tables) and set(needed) <= set(columns)

    def ends(self, accuracy: Mapping[str, float]) -> tuple[float, float]:
        """The lowest and the highest number that are not beyond its limit, by the accuracy that K,
        B and I need."""
        if self.ratio is not None:
            return 1 / self.ratio, self.ratio
        above = accuracy[self.above] if isinstance(self.above, str) else self.above
        high = math.inf if above is None else above
        return -high if self.below is None else self.below, high


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
RULES = [Rule(**fields) for fields in CONTENT["rules"]]
CHECKS = {name: Check(name, **fields) for name, fields in CONTENT["checks"].items()}
FAMILIES: dict[str, str] = CONTENT["families"]
"""Findings by family of the rivals that the inference weighs."""


def rule_of(column: str, side: str = "above", table: str = "") -> Rule:
    """The rule on a number beyond a limit on this side, of any table if none is named, with its
    words; of a column that has none, one without words."""
    of_column = [
        rule
        for rule in RULES
        if rule.column == column and (not table or not rule.tables or table in rule.tables)
    ]
    on_side = [rule for rule in of_column if getattr(rule, side) is not None]
    return next(iter([*on_side, *of_column]), Rule(finding=column, column=column))


def known_finding(name: str) -> KnownFinding:
    """A finding of `findings.yaml`; of a column that has a limit in the configuration, and no entry
    there, one without words."""
    return FINDINGS.get(name) or KnownFinding(name, title=name, says="")
