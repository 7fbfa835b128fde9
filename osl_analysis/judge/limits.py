"""The limits of the configuration on columns of result tables, and the accuracy that estimates
need."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from osl_analysis.config.experiments import judged_tables
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.errors import nearest
from osl_analysis.judge.known_findings import EVIDENCE
from osl_analysis.yaml_settings import OF_EARLIER_RELEASE, NotNegative, Settings, misplaced

Share = Annotated[float, Field(gt=0, lt=1)]  # A part of a whole; a larger number is in percent.
Factor = Annotated[float, Field(gt=1)]  # How many times a number may be another one.


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


LARGEST_VALUES = {"VAF": 100, "R2": 1, "correlation": 1, "coherence": 1}
"""Largest values of columns whose names contain these: a percentage, or shares."""


class DoubtfulFits(Settings):
    """The accuracy that estimates need, and limits by table. The tables of `judged_tables` can have
    limits on every numeric column that no accuracy decides."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ColumnLimits] = Field(init=False)

    accuracy: Accuracy = Accuracy()  # The accuracy that K, B and I need, in all tables.
    every_table: ColumnLimits = ColumnLimits()  # Limits of all tables that have the column.

    @model_validator(mode="after")
    def _limits_are_of_tables(self) -> Self:
        columns: list[str] = []
        for name in judged_tables():
            columns += numeric_columns(name)
        for limit in self.every_table.stated():
            check_limit(limit, self.every_table, columns, "every_table", "any judged table")
        for name, limits in self.__pydantic_extra__.items():
            if name not in judged_tables():
                tables = ", ".join(judged_tables())
                suggestion = nearest(name, judged_tables())
                raise misplaced(
                    f"unknown table; limits may stand on {tables} ({OF_EARLIER_RELEASE})"
                    f"{suggestion}",
                    name,
                )
            for limit in limits.stated():
                check_limit(limit, limits, numeric_columns(name), name, f"tables/{name}.csv")
        return self

    def of(self, table: str) -> Limits:
        """The limits of one table: its own, and those of every table on columns that it has."""
        of_table = self.__pydantic_extra__.get(table, ColumnLimits())
        columns = set(numeric_columns(table))
        shared = self.every_table
        # a limit of the table precedes one of every table
        return Limits(
            above={**on_columns(shared.above, columns), **of_table.above},
            below={**on_columns(shared.below, columns), **of_table.below},
            ratio={**on_columns(shared.ratio, columns), **of_table.ratio},
            accuracy=self.accuracy,
        )


def numeric_columns(table: str) -> list[str]:
    """The columns of a table that hold numbers."""
    described = described_tables_by_name()
    if table not in described:
        raise LookupError(f"describe tables/{table} in osl_analysis/dictionary/")
    return [column.name for column in described[table].columns.values() if column.unit != "text"]


def on_columns(
    limits: Mapping[str, float | None], columns: Collection[str]
) -> dict[str, float | None]:
    """The limits that stand on these columns."""
    return {name: limit for name, limit in limits.items() if name in columns}


def check_limit(
    limit: Limit, limits: ColumnLimits, columns: Collection[str], section: str, table: str
) -> None:
    """Refuse a limit at its place in the configuration.

    Parameters
    ----------
    limit : Limit
    limits : ColumnLimits
        All limits of its table.
    columns : Collection of str
        The table's columns of numbers.
    section : str
        The section under `doubtful`.
    table : str
        The table's name for the message.

    Raises
    ------
    PydanticCustomError
        The limit stands on a column that the table does not have or that something else decides,
        contradicts another limit, or cannot be reached by such a number.
    """
    name = limit.column
    value = limit.value
    side = "ratio" if name in limits.ratio else limit.side
    instead = decided_elsewhere(name)
    if instead:
        raise misplaced(f"takes no limit: {instead}; remove the line", section, side, name)
    if name not in columns:
        message = (
            f"{table} has no number of this name; correct it ({OF_EARLIER_RELEASE})"
            f"{nearest(name, columns)}"
        )
        raise misplaced(message, section, side, name)
    if value is None:
        return
    upper = limits.above.get(name)
    if limit.side == "below" and upper is not None and value > upper:
        message = (
            f"{value:g} is above the upper limit {upper:g}, and every fit would be doubtful;"
            " correct one"
        )
        raise misplaced(message, section, side, name)
    for part, largest in LARGEST_VALUES.items():
        if part not in name or not value:
            continue
        is_too_low = limit.side == "below" and 0 < value < largest / 100
        if abs(value) > largest or is_too_low:
            kind = "percentage" if largest == 100 else "share"
            message = (
                f"{value:g} is no limit of a {kind}, which is at most {largest}; write one as"
                f" {0.9 * largest:g}"
            )
            raise misplaced(message, section, side, name)


def decided_elsewhere(column: str) -> str:
    """What decides about a column in place of a limit of its own; empty for a column that may have
    one."""
    if column not in EVIDENCE:
        return ""
    evidence = EVIDENCE[column]
    if evidence.decided_by == "accuracy":
        return f"state the accuracy that you need as doubtful.accuracy.{evidence.share_of}"
    if evidence.decided_by == "effect":
        return (
            "its effect on the estimates decides; state the accuracy that you need as"
            " doubtful.accuracy"
        )
    if evidence.decided_by == "sign":
        return "what cannot be negative and certainly is, is doubtful anyway"
    return ""
