# SPDX-License-Identifier: Apache-2.0
"""Limits of the configuration on columns of result tables, and the accuracy that estimates need.

Example: `DoubtfulFits.model_validate({"impedance": {"below": {"VAF": 80.0}}}).of("impedance")`.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from osl_analysis.base.errors import nearest
from osl_analysis.base.yaml_settings import OF_EARLIER_RELEASE, NotNegative, Settings, misplaced
from osl_analysis.config.experiments import JUDGED_TABLES
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.rules import (
    Limit,
    Side,
    Table,
    at_least,
    at_most,
    has_own_limit,
    within_factor,
)

Share = Annotated[float, Field(gt=0, lt=1)]  # A part of a whole; a larger number is in percent.
Factor = Annotated[float, Field(gt=1)]  # How many times a number may be another one.


class Accuracy(Settings):
    """Changes of K, B and I that matter, as shares of the estimate.

    They are no widths of intervals. A fault that changes an estimate by less is a remark. A fault
    that changes it by more, and by more than its half-width and half-range, makes it doubtful.
    """

    K: Share = 0.02  # Of stiffnesses; benches that agree on one spring differ by 1 to 2 %.
    # Of dampings; loads and temperatures change a joint's damping by as much.
    B: Share = 0.05
    I: Share = 0.2  # Of inertias, hardly seen below 5 Hz.


class ColumnLimits(Settings):
    """Limits of one table, by column. Null: no limit."""

    above: dict[str, NotNegative | None] = Field(default_factory=dict)
    """Upper limits, by column. A fit is doubtful if the absolute value is above its limit."""
    below: dict[str, float | None] = Field(default_factory=dict)
    """Lower limits, by column. A fit is doubtful if the value is below its limit."""
    ratio: dict[str, Factor | None] = Field(default_factory=dict)
    """Limits of ratios to a known value, by column. A fit is doubtful if the ratio is above its
    limit, or below 1 over it."""

    @property
    def by_column(self) -> Iterator[tuple[str, Limit]]:
        """The columns that have a limit, with it."""
        for column, size in self.above.items():
            if size is not None:
                yield column, at_most(size)
        for column, low in self.below.items():
            if low is not None:
                yield column, at_least(low)
        for column, factor in self.ratio.items():
            if factor is not None:
                yield column, within_factor(factor)

    @property
    def columns_by_side(self) -> dict[Side, list[str]]:
        """The columns that are named on each side, with a limit or null."""
        return {"above": [*self.above], "below": [*self.below], "ratio": [*self.ratio]}


class Limits(ColumnLimits):
    """Limits of one table, and the accuracy that its estimates need."""

    accuracy: Accuracy = Accuracy()


SHIPPED_LIMITS: Mapping[Table, ColumnLimits] = {
    Table.BELT: ColumnLimits(
        above={"energy_lost": 0.1},  # share lost by hysteresis: the slopes of a cycle differ
        ratio={"K_s_ratio": 1.5},  # another belt, or another unit of torque or angle
    ),
    Table.TRANSMISSION: ColumnLimits(
        # losses differ from joint to joint more than belts do
        ratio={"B_j_ratio": 3.0, "J_j_ratio": 3.0},
    ),
    Table.ACTUATOR: ColumnLimits(
        above={"f_C_ratio": 5.0},  # friction differs from motor to motor
        # the data sheet of a motor's constant is right to a tenth
        ratio={"k_tau_n_m_ratio": 1.25, "J_m_ratio": 3.0},
    ),
    Table.IMPEDANCE: ColumnLimits(
        # [s] of lateness by which B differs from what the gains give; sound legs: 0.8e-3 (SD)
        above={"B_gap_s": 0.00175},
        below={"VAF": 70.0},  # [%] half of the torque's SD is not the joint's; friction leaves 76
        ratio={"K_s_ratio": 1.5},  # the belt by torque, angle and theta_m, as in belt
    ),
    Table.TORQUE_ANGLE: ColumnLimits(
        below={"VAF": 98.0},  # [%] a seventh of the torque's SD is no function of angle and branch
    ),
    Table.WALKING: ColumnLimits(
        above={"bridged": 0.1},  # share of the frames in which markers were interpolated
    ),
    Table.WALKING_GROUPS: ColumnLimits(
        above={
            "unperturbed_stance_sd": 0.07,  # of their mean: several people or paces in one gait
            "left_out_share": 0.33,  # of the crossings that are outliers or refused
            "different_mm": 8.0,  # from the static trial: 10 mm up move K by 2 %
            "plate_height_m": 0.01,  # moves K by 2 %
            "plate_lag_sd_s": 0.001,  # moves K by 7 %, B by 25 %
            "cop_outside_m": 0.03,  # from the area between the foot's markers
        },
        below={"VAF": 80.0},  # [%]
    ),
}
"""The limits of the shipped configuration, which may be edited in a clone; a test holds both
against each other."""


class DoubtfulFits(Settings):
    """The accuracy that estimates need, and limits by table. The tables of `JUDGED_TABLES` can have
    limits on every numeric column that has none in `judge/rules.py`."""

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
        """The limits of one table, and the accuracy."""
        table_limits = self.__pydantic_extra__.get(table)
        return Limits.model_construct(
            **vars(table_limits) if table_limits else {}, accuracy=self.accuracy
        )


SHIPPED_DOUBTFUL: Mapping[str, Any] = {
    "accuracy": Accuracy().model_dump(),
    **{table.value: limits.model_dump() for table, limits in SHIPPED_LIMITS.items()},
}
"""`doubtful` of the shipped configuration, as a configuration states it."""


def check_limited_columns(limits: ColumnLimits, table: str) -> None:
    """Refuse a limit at its place in the configuration with PydanticCustomError: on a column that
    its table does not have or whose limit stands in `judge/rules.py`."""
    described = described_tables_by_name()[table]
    described_columns = [*described.columns.values(), *described.of_fits.values()]
    columns = [column.name for column in described_columns if column.unit != "text"]
    for side, names in limits.columns_by_side.items():
        for name in names:
            if name not in columns:
                message = (
                    f"tables/{table}.csv has no number of this name; correct it"
                    f" ({OF_EARLIER_RELEASE}){nearest(name, columns)}"
                )
                raise misplaced(message, table, side, name)
            if has_own_limit(table, name, side):
                message = "takes no limit: osl_analysis/judge/rules.py has it; remove the line"
                raise misplaced(message, table, side, name)
