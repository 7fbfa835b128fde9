"""A judgement on a trial or a fit as a value. Tables, summary, page and tests are views of it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Literal

import polars as pl
from pydantic import Field

from osl_analysis.refusal import is_refused
from osl_analysis.table import read_table
from osl_analysis.yaml_settings import NotNegative, Settings

AnyRow = Mapping[str, object]  # a row of a result table


class Grade(StrEnum):
    """What a finding does to its trial or fit."""

    EXCLUDES = "excludes"  # it is in no other table and in no figure
    DOUBTS = "doubts"
    UNCHECKED = "not checked"
    NOTES = "notes"  # checked, and worth knowing


class Remedy(StrEnum):
    """Which remedy helps, given what else of the trial is sound."""

    WHOLE = "remedy"
    ALONE = "otherwise"  # there are no rows of single amplitudes
    # the fit to all of the trial is sound, and that to one amplitude is not
    AMPLITUDE = "of_amplitude"
    FREQUENCY = "of_frequency"  # a row of one frequency
    DOUBTED = "doubted"  # for what was not checked, or is noted, in a doubtful row


class Limits(Settings):
    """Limits of one table, by column. Null: no limit."""

    above: dict[str, NotNegative | None] = Field(default_factory=dict)
    """Upper limits, by column. A fit is doubtful if the absolute value is above its limit."""
    below: dict[str, float | None] = Field(default_factory=dict)
    """Lower limits, by column. A fit is doubtful if the value is below its limit."""

    def stated(self) -> list[tuple[Literal["above", "below"], str, float | None]]:
        """Side, column and limit of each."""
        return [
            *(("above", *one) for one in self.above.items()),
            *(("below", *one) for one in self.below.items()),
        ]


@dataclass(frozen=True)
class Beyond:
    """A number beyond its limit, as evidence."""

    column: str
    value: float
    limit: float
    side: Literal["above", "below", "near", "nan"] | str

    @property
    def excess(self) -> float:
        """Factor by which the number exceeds its limit."""
        product = self.value * self.limit
        return max(abs(self.value / self.limit), abs(self.limit / self.value)) if product else 0.0


@dataclass(frozen=True)
class Finding:
    """One cause, or one thing that could not be checked, in a row of a table."""

    table: str
    subject: str  # the trial or the group
    cause: str
    grade: Grade = Grade.DOUBTS
    evidence: tuple[Beyond, ...] = ()  # none for what could not be checked
    amplitude_deg: float | None = None
    frequency_hz: float | None = None
    remedy: Remedy = Remedy.WHOLE
    inherited: str = ""  # table of the same trial that it comes from; empty: the row itself
    sizes: Mapping[str, float] = field(default_factory=dict)
    """Its effect on K [N*m/rad], B [N*m*s/rad] and I [kg*m^2], as far as the evidence gives it."""
    without: Mapping[str, float] = field(default_factory=dict)
    """The estimates with this cause as a column of the regression: K, B, I, with `_low` and
    `_high`."""


ESTIMATES = ("K", "B", "I")
FINDING_NUMBERS = [
    f"{name}_{end}"
    for name in ESTIMATES
    for end in ("size", "without", "without_low", "without_high")
]
TEXTS = (
    "table",
    "trial",
    "grade",
    "cause",
    "inherited",
    "evidence",
    "side",
    "says",
    "size",
    "remedy",
)
ORDER = (
    "finding", "table", "trial", "amplitude_deg", "frequency_hz", "grade", "cause", "inherited",
    "evidence", "value",
    "limit", "side", *FINDING_NUMBERS, "says", "size", "remedy",
)  # fmt: skip
FINDING_COLUMNS: dict[str, type[pl.DataType]] = {
    name: pl.Int64 if name == "finding" else pl.String if name in TEXTS else pl.Float64
    for name in ORDER
}
"""Columns of `findings.csv`: a row per number of evidence; rows of one finding share the number
`finding`."""


def findings_frame(found: Iterable[tuple[Finding, tuple[str, str, str]]] = ()) -> pl.DataFrame:
    """`findings.csv` from findings with their words: what is wrong, how large, and what to do."""
    rows = list[dict[str, object]]()
    for number, (one, words) in enumerate(found, start=1):
        row: dict[str, object] = {
            "finding": number,
            "table": one.table,
            "trial": one.subject,
            "cause": one.cause,
        }
        row |= {
            "amplitude_deg": one.amplitude_deg,
            "frequency_hz": one.frequency_hz,
            "grade": one.grade.value,
        }
        row |= {"inherited": one.inherited or None} | {
            f"{name}_size": size for name, size in one.sizes.items()
        }
        for name in ESTIMATES:
            row |= {
                f"{name}_without{end}": one.without.get(f"{name}{end}")
                for end in ("", "_low", "_high")
            }
        row |= dict(zip(("says", "size", "remedy"), (text or None for text in words), strict=True))
        numbers = [
            {"evidence": n.column, "value": n.value, "limit": n.limit, "side": n.side}
            for n in one.evidence
        ]
        rows += [row | each for each in numbers or [{}]]
    return pl.DataFrame(
        [{name: row.get(name) for name in FINDING_COLUMNS} for row in rows], schema=FINDING_COLUMNS
    )


def read_findings(path: Path) -> pl.DataFrame:
    """`findings.csv`; an empty table where it was refused or is not there."""
    if not path.is_file() or is_refused(path):
        return findings_frame()
    return read_table(path, ["finding"]).select(
        pl.col(name).cast(dtype) for name, dtype in FINDING_COLUMNS.items()
    )


def cell_number(row: AnyRow, name: str) -> float | None:
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else None


def subject_of(row: AnyRow) -> str:
    """The trial, or the group, of a row."""
    return next((str(row[key]) for key in ("trial", "group") if row.get(key) is not None), "")
