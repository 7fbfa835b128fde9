# SPDX-License-Identifier: Apache-2.0
"""The limits of the configuration on columns of result tables, and the accuracy that estimates
need."""

from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from osl_analysis.base.errors import nearest
from osl_analysis.base.files import own_yaml
from osl_analysis.base.yaml_settings import OF_EARLIER_RELEASE, NotNegative, Settings, misplaced
from osl_analysis.config.experiments import JUDGED_TABLES
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.rules import LIMIT_SIDES, rule_of

SHIPPED: dict[str, Any] = own_yaml(Path(__file__).with_name("deciding_defaults.yaml"))
"""What of the shipped configuration decides verdicts."""
Share = Annotated[float, Field(gt=0, lt=1)]  # A part of a whole; a larger number is in percent.
Factor = Annotated[float, Field(gt=1)]  # How many times a number may be another one.


class Accuracy(Settings):
    """Changes of K, B and I that matter, each as a share of itself; no width of an interval.

    A fault that would move an estimate by less is a remark. One that would move it by more makes it
    doubtful, where it is beyond the estimate's half-width and half-range, too.
    """

    # Of stiffnesses; benches that agree on one spring differ by 1 to 2 %.
    K: Share = SHIPPED["doubtful"]["accuracy"]["K"]
    # Of dampings; loads and temperatures change a joint's damping by as much.
    B: Share = SHIPPED["doubtful"]["accuracy"]["B"]
    I: Share = SHIPPED["doubtful"]["accuracy"]["I"]  # Of inertias, hardly seen below 5 Hz.


class ColumnLimits(Settings):
    """Limits of one table, by column. Null: no limit."""

    above: dict[str, NotNegative | None] = Field(default_factory=dict)
    """Upper limits, by column. A fit is doubtful if the absolute value is above its limit."""
    below: dict[str, float | None] = Field(default_factory=dict)
    """Lower limits, by column. A fit is doubtful if the value is below its limit."""
    ratio: dict[str, Factor | None] = Field(default_factory=dict)
    """Limits of ratios to a known value, by column. A fit is doubtful if the ratio is above its
    limit, or below 1 over it."""


class Limits(ColumnLimits):
    """Limits of one table, and the accuracy that its estimates need."""

    accuracy: Accuracy = Accuracy()


class DoubtfulFits(Settings):
    """The accuracy that estimates need, and limits by table. The tables of `JUDGED_TABLES` can have
    limits on every numeric column that has none in `findings.yaml`."""

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
            check_limited_columns(limits, name)
        return self

    def of(self, table: str) -> Limits:
        """What is stated for one table."""
        stated = self.__pydantic_extra__.get(table)
        return Limits.model_construct(**vars(stated) if stated else {}, accuracy=self.accuracy)


def check_limited_columns(limits: ColumnLimits, table: str) -> None:
    """Refuse a limit at its place in the configuration with PydanticCustomError: on a column that
    its table does not have or whose limit stands in `findings.yaml`."""
    described = described_tables_by_name()[table]
    described_columns = [*described.columns.values(), *described.of_fits.values()]
    columns = [column.name for column in described_columns if column.unit != "text"]
    for side in LIMIT_SIDES:
        for name in getattr(limits, side):
            if name not in columns:
                message = (
                    f"tables/{table}.csv has no number of this name; correct it"
                    f" ({OF_EARLIER_RELEASE}){nearest(name, columns)}"
                )
                raise misplaced(message, table, side, name)
            if getattr(rule_of(name, side, table), side) is not None:
                message = "takes no limit: osl_analysis/judge/findings.yaml has it; remove the line"
                raise misplaced(message, table, side, name)
