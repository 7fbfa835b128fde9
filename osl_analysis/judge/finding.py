"""A judgement on a trial or a fit as a value. Tables, summary, page and tests are views of it."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

import polars as pl
from pydantic import Field

from osl_analysis.refusal import is_refused
from osl_analysis.table import read_table
from osl_analysis.yaml_settings import NotNegative, Settings

AnyRow = Mapping[str, object]  # a row of a result table
Share = Annotated[float, Field(gt=0, lt=1)]  # A part of a whole; a larger number is in percent.
Factor = Annotated[float, Field(gt=1)]  # How many times a number may be another one.


class Grade(StrEnum):
    """What a finding does to its trial or fit."""

    EXCLUDES = "excludes"  # it is in no other table and in no figure
    DOUBTS = "doubts"
    UNCHECKED = "not checked"
    NOTES = "notes"  # checked, and worth knowing


class Remedy(StrEnum):
    """Which remedy helps, given what else of the trial is sound: keys of `words.yaml`."""

    WHOLE = "remedy"  # the fit to all of the trial is doubtful
    ALONE = "otherwise"  # the same, where there are no rows of single amplitudes
    AMPLITUDE = "of_amplitude"  # only the fit to one amplitude is doubtful
    FREQUENCY = "of_frequency"  # a row of one frequency
    DOUBTED = "doubted"  # for what was not checked, or is noted, in a doubtful row


class Accuracy(Settings):
    """How well K, B and I have to be known, each as a share of itself.

    A finding that may move an estimate by more makes it doubtful; one that moves every estimate by
    less is a remark.
    """

    K: Share = 0.02  # Of stiffnesses; benches that agree on one spring differ by 1 to 2 %.
    B: Share = 0.05  # Of dampings; loads and temperatures change a joint's damping by as much.
    I: Share = 0.2  # Of inertias, which are hardly seen below 5 Hz.

    def of(self, estimate: str) -> float:
        """Share of K, B or I that a finding may move it by."""
        return {"K": self.K, "B": self.B, "I": self.I}[estimate]


@dataclass(frozen=True)
class Limit:
    """The limit of one column."""

    column: str
    side: Literal["above", "below"]  # on which a number is beyond it
    value: float | None  # in the unit of the column; None: no limit


class ColumnLimits(Settings):
    """Limits of one table, by column. Null: no limit."""

    above: dict[str, NotNegative | None] = Field(default_factory=dict)
    """Upper limits, by column. A fit is doubtful if the absolute value is above its limit."""
    below: dict[str, float | None] = Field(default_factory=dict)
    """Lower limits, by column. A fit is doubtful if the value is below its limit."""
    ratio: dict[str, Factor | None] = Field(default_factory=dict)
    """Limits of ratios to a known value, by column. A fit is doubtful if the ratio is above its
    limit, or below 1 over it."""

    def stated(self) -> list[Limit]:
        """Each limit: those above, of ratios, and below."""
        limits = [Limit(column, "above", value) for column, value in self.above.items()]
        for column, factor in self.ratio.items():
            limits.append(Limit(column, "above", factor))
        for column, factor in self.ratio.items():
            limits.append(Limit(column, "below", None if factor is None else 1 / factor))
        for column, value in self.below.items():
            limits.append(Limit(column, "below", value))
        return limits


class Limits(ColumnLimits):
    """Limits of one table, and the accuracy that its estimates need."""

    accuracy: Accuracy = Accuracy()


@dataclass(frozen=True)
class Beyond:
    """A number beyond its limit, as evidence."""

    column: str
    value: float  # in the unit of the column
    limit: float
    side: str  # above or below the limit, near a factor between units, or nan

    @property
    def excess(self) -> float:
        """Factor by which the number exceeds its limit: infinite beyond 0, and of NaN."""
        if math.isnan(self.value):
            return math.inf
        if self.value == self.limit:
            return 1.0
        if self.value == 0 or self.limit == 0:
            return math.inf
        factor = abs(self.value / self.limit)
        return max(factor, 1 / factor)


@dataclass(frozen=True)
class Finding:
    """One cause, or one thing that could not be checked, in a row of a table.

    Attributes
    ----------
    table
        The name of the table.
    subject
        The trial or the group.
    evidence
        Numbers beyond their limits; none for what could not be checked.
    amplitude_deg, frequency_hz
        Those of the row; None: all.
    inherited
        Table of the same trial that it comes from; empty: the row itself.
    sizes
        Its effect on K [N*m/rad], B [N*m*s/rad] and I [kg*m^2], as far as the evidence gives it.
    without
        The estimates with this cause as a column of the regression, where they are better than the
        recorded ones: K, B, I, with `_low` and `_high`.
    untold
        Those of K, B and I of which nothing is told beside this cause.
    """

    table: str
    subject: str
    cause: str
    grade: Grade = Grade.DOUBTS
    evidence: tuple[Beyond, ...] = ()
    amplitude_deg: float | None = None
    frequency_hz: float | None = None
    remedy: Remedy = Remedy.WHOLE
    inherited: str = ""
    sizes: Mapping[str, float] = field(default_factory=dict)
    without: Mapping[str, float] = field(default_factory=dict)
    untold: tuple[str, ...] = ()

    def to_row(self) -> dict[str, object]:
        """Its columns of `findings.csv` without number, words and evidence."""
        row: dict[str, object] = {
            "table": self.table,
            "trial": self.subject,
            "amplitude_deg": self.amplitude_deg,
            "frequency_hz": self.frequency_hz,
            "grade": self.grade.value,
            "cause": self.cause,
            "inherited": self.inherited or None,
        }
        for name in ESTIMATES:
            row[f"{name}_size"] = self.sizes.get(name)
            for end in ("", "_low", "_high"):
                row[f"{name}_without{end}"] = self.without.get(f"{name}{end}")
        return row


ESTIMATES = ("K", "B", "I")
UNITS_OF_ESTIMATES = {"K": "N*m/rad", "B": "N*m*s/rad", "I": "kg*m^2"}
FINDING_NUMBERS = [
    f"{symbol}_{number}"
    for symbol, number in product(ESTIMATES, ("size", "without", "without_low", "without_high"))
]
FINDING_COLUMNS: dict[str, type[pl.DataType]] = {
    "finding": pl.Int64,
    **dict.fromkeys(("table", "trial"), pl.String),
    **dict.fromkeys(("amplitude_deg", "frequency_hz"), pl.Float64),
    **dict.fromkeys(("grade", "cause", "inherited", "evidence"), pl.String),
    **dict.fromkeys(("value", "limit"), pl.Float64),
    "side": pl.String,
    **dict.fromkeys(FINDING_NUMBERS, pl.Float64),
    **dict.fromkeys(("says", "size", "remedy"), pl.String),
}
"""Columns of `findings.csv`: a row per number of evidence; rows of one finding share the number
`finding`."""


def findings_frame(
    findings: Iterable[tuple[Finding, tuple[str, str, str]]] = (),
) -> pl.DataFrame:
    """`findings.csv` from findings with their words: what is wrong, how large, and what to do."""
    rows: list[dict[str, object]] = []
    for number, (finding, (says, size, remedy)) in enumerate(findings, start=1):
        words = {"says": says or None, "size": size or None, "remedy": remedy or None}
        shared = {"finding": number, **finding.to_row(), **words}
        if not finding.evidence:
            rows.append(shared)
        for number_beyond in finding.evidence:
            evidence = {
                "evidence": number_beyond.column,
                "value": number_beyond.value,
                "limit": number_beyond.limit,
                "side": number_beyond.side,
            }
            rows.append({**shared, **evidence})
    return pl.DataFrame(rows, schema=FINDING_COLUMNS)


def read_findings(path: Path) -> pl.DataFrame:
    """`findings.csv`; an empty table where it was refused or is not there."""
    if not path.is_file() or is_refused(path):
        return findings_frame()
    columns = [pl.col(name).cast(dtype) for name, dtype in FINDING_COLUMNS.items()]
    return read_table(path, ["finding"]).select(columns)


def cell_number(row: AnyRow, name: str) -> float | None:
    """The number in a column of a row; None for a text, a null, or a column that is not there."""
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else None


def subject_of(row: AnyRow) -> str:
    """The trial, or the group, of a row."""
    for key in ("trial", "group"):
        if row.get(key) is not None:
            return str(row[key])
    return ""
