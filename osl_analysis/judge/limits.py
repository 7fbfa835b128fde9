"""The limits of the configuration on columns of result tables, and the accuracy that estimates
need."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from osl_analysis.config.experiments import JUDGED_TABLES
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.errors import nearest
from osl_analysis.files import own_yaml
from osl_analysis.judge.known_findings import rule_of
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


SIDES = ("above", "below", "ratio")
DECIDED_BY = {
    "accuracy": "state the accuracy that you need as doubtful.accuracy",
    "effect": (
        "its effect on the estimates decides; state the accuracy that you need as doubtful.accuracy"
    ),
    "sign": "what cannot be negative and certainly is, is doubtful anyway",
}
"""What decides about a column in place of a limit of its own."""


class Limits(ColumnLimits):
    """Limits of one table, and the accuracy that its estimates need."""

    accuracy: Accuracy = Accuracy()


FIXED = {
    table: ColumnLimits(**limits)
    for table, limits in own_yaml(Path(__file__).with_name("limits.yaml")).items()
}
"""The limits that no campaign changes, by table; `every_table` has those of all tables."""


class DoubtfulFits(Settings):
    """The accuracy that estimates need, and limits by table. The tables of `JUDGED_TABLES` can have
    limits on every numeric column that neither accuracy nor a fixed limit decides."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ColumnLimits] = Field(init=False)

    accuracy: Accuracy = Accuracy()  # The accuracy that K, B and I need, in all tables.

    @model_validator(mode="after")
    def _limits_are_of_tables(self) -> Self:
        for name, limits in self.__pydantic_extra__.items():
            if name not in JUDGED_TABLES:
                tables = ", ".join(JUDGED_TABLES)
                raise misplaced(
                    f"unknown table; limits may stand on {tables} ({OF_EARLIER_RELEASE})"
                    f"{nearest(name, JUDGED_TABLES)}",
                    name,
                )
            check_columns(limits, name)
        return self

    def of(self, table: str) -> Limits:
        """The limits of one table: the fixed ones on columns that it has, and the stated ones."""
        columns = numeric_columns(table)
        limits: dict[str, Any] = {side: {} for side in SIDES}
        stated = self.__pydantic_extra__.get(table, ColumnLimits())
        # the later ones precede
        for part in (FIXED["every_table"], FIXED.get(table, ColumnLimits()), stated):
            for side in SIDES:
                limits[side].update(getattr(part, side))
        of_table = {
            side: {name: limit for name, limit in limits[side].items() if name in columns}
            for side in SIDES
        }
        return Limits(**of_table, accuracy=self.accuracy)


def numeric_columns(table: str) -> list[str]:
    """The columns of a table that hold numbers."""
    described = described_tables_by_name()[table]
    columns = [*described.columns.values(), *described.of_fits.values()]
    return [column.name for column in columns if column.unit != "text"]


def check_columns(limits: ColumnLimits, table: str) -> None:
    """Refuse a limit at its place in the configuration with PydanticCustomError: on a column that
    its table does not have or that something else decides, or below an upper limit of the same
    column."""
    columns = numeric_columns(table)
    for side in SIDES:
        for name, value in getattr(limits, side).items():
            upper = limits.above.get(name)
            rule = rule_of(name)
            if rule is not None and rule.by != "limit":
                message = f"takes no limit: {DECIDED_BY[rule.by]}; remove the line"
            elif is_fixed(name, side, table):
                message = "takes no limit: osl_analysis/judge/limits.yaml has it; remove the line"
            elif name not in columns:
                message = (
                    f"tables/{table}.csv has no number of this name; correct it"
                    f" ({OF_EARLIER_RELEASE})"
                    f"{nearest(name, columns)}"
                )
            elif side == "below" and None not in (value, upper) and value > upper:
                message = (
                    f"{value:g} is above the upper limit {upper:g}, and every fit would be"
                    " doubtful; correct one"
                )
            elif "VAF" in name and value and value < 1:
                message = f"{value:g} is no percentage; write {100 * value:g}"
            else:
                continue
            raise misplaced(message, table, side, name)


def is_fixed(column: str, side: str, table: str) -> bool:
    """Whether a limit is one that no campaign changes."""
    tables = [FIXED[name] for name in ("every_table", table) if name in FIXED]
    return any(column in getattr(limits, side) for limits in tables)
