# SPDX-License-Identifier: Apache-2.0
"""Rules on single rows of result tables, for what no budget shows.

A rule finds a number of a row that is beyond its limit, or a cell that is missing.

    NumberRule(
        "clipped_torque",
        Source.CLIPPED_SIGNAL,
        tables=(Table.BELT, Table.IMPEDANCE),
        column="saturated_samples",
        limit=at_most(5),
    )

Importing fails where a table has no such column, or `words.yaml` no such rule. Beyond a limit of
this file the method or the number cannot be right. A rule with `limit=None` has a limit that
depends on the device and its bench: the configuration states it, under `doubtful`.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from enum import StrEnum
from typing import Literal

from osl_analysis.base.errors import nearest
from osl_analysis.base.units import known_factor
from osl_analysis.config.experiments import JUDGED_TABLES
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.known_findings import WORDS_OF_RULES
from osl_analysis.stats.sources import Source

AnyRow = Mapping[str, object]  # a row of a result table


class Grade(StrEnum):
    """The consequence of a finding for its trial or fit."""

    EXCLUDES = "excludes"  # the trial is in no other table and in no figure
    DOUBTS = "doubts"
    UNCHECKED = "not checked"
    NOTES = "notes"  # checked, and worth knowing


class Table(StrEnum):
    """The result tables whose rows are judged."""

    BELT = "belt"
    TRANSMISSION = "transmission"
    ACTUATOR = "actuator"
    IMPEDANCE = "impedance"
    TORQUE_ANGLE = "torque_angle"
    CALIBRATION = "calibration"
    WALKING = "walking"
    WALKING_GROUPS = "walking_groups"


Signal = Literal["torque", "angle", "current"]
Side = Literal["above", "below", "ratio"]
"""The kind of a limit in the configuration: above an absolute value, below a value, or a ratio on
both sides of 1."""


# Limits and conditions


@dataclass(frozen=True)
class Limit:
    """The lowest and the highest number that are within it."""

    low: float = -math.inf
    high: float = math.inf

    @property
    def side(self) -> Side | None:
        """The kind under which the configuration states it; None: its two sides are unlike."""
        if self.low == -self.high or math.isinf(self.low):
            return "above"
        if math.isinf(self.high):
            return "below"
        return "ratio" if self.low == 1 / self.high else None


def at_most(size: float) -> Limit:
    """The limit of an absolute value."""
    return Limit(-size, size)


def at_least(low: float) -> Limit:
    """The lower limit of a value."""
    return Limit(low=low)


def within_factor(factor: float) -> Limit:
    """The limit of a ratio to a known value, on both sides of 1."""
    return Limit(1 / factor, factor)


@dataclass(frozen=True)
class Missing:
    """A row has nothing in a column."""

    column: str

    def holds(self, row: AnyRow) -> bool:
        return row.get(self.column) is None


@dataclass(frozen=True)
class Given:
    """A row has something in a column."""

    column: str

    def holds(self, row: AnyRow) -> bool:
        return row.get(self.column) is not None


@dataclass(frozen=True)
class SmallerThan:
    """The absolute value of a number in a row is smaller than a size."""

    column: str
    size: float

    def holds(self, row: AnyRow) -> bool:
        value = cell_number(row, self.column)
        return value is not None and abs(value) < self.size


Condition = Missing | Given | SmallerThan


# Rules


@dataclass(frozen=True)
class Rule:
    """When a row of a result table has a finding.

    Attributes
    ----------
    name
        Its key in `words.yaml`; rules with the same words share it.
    source
        The source of its findings.
    tables
        The tables whose rows it judges.
    grade
        The consequence of its findings.
    unless
        Findings that explain it: a row with one of them has no finding by this rule.
    """

    name: str
    source: Source
    _: KW_ONLY
    tables: tuple[Table, ...]
    grade: Grade = Grade.DOUBTS
    unless: tuple[Source, ...] = ()

    def __post_init__(self) -> None:
        if self.name not in WORDS_OF_RULES:
            raise ValueError(f"words.yaml has no rule '{self.name}'")
        for column in self.columns:
            self.check_column(column)

    def check_column(self, column: str) -> None:
        """Refuse a column that one of its tables does not have with ValueError."""
        for table in self.tables:
            described = described_tables_by_name()[table]
            columns = {**described.columns, **described.of_fits}
            if column not in columns:
                raise ValueError(
                    f"rule {self.name}: {table} has no column '{column}'{nearest(column, columns)}"
                )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that the rule needs."""
        return ()

    @property
    def says(self) -> str:
        """The words for the size of the finding, or for what could not be checked."""
        return WORDS_OF_RULES[self.name].says

    @property
    def remedy(self) -> str:
        """The words for what to do; empty where the finding has them."""
        return WORDS_OF_RULES[self.name].remedy


@dataclass(frozen=True)
class NumberRule(Rule):
    """A rule that finds a number beyond its limit.

    Attributes
    ----------
    column
        The column of the number.
    limit
        Its limit; None: the configuration states it, under `doubtful`.
    units
        The signals that scale the number, a ratio to a known value. A wrong unit of one of them may
        explain it.
    second
        The column of a second ratio, which tells a wrong unit from another device. A wrong torque
        scales both ratios alike; a wrong current leaves the second at 1.
    is_of_estimate
        Whether the finding is about the estimate of its column alone, and about no other.
    """

    _: KW_ONLY
    column: str
    limit: Limit | None
    units: tuple[Signal, ...] = ()
    second: str = ""
    is_of_estimate: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.second:
            self.check_column(self.second)

    @property
    def columns(self) -> tuple[str, ...]:
        return (self.column,)


@dataclass(frozen=True)
class RowRule(Rule):
    """A rule that finds rows by cells that are there or missing.

    Attributes
    ----------
    conditions
        Conditions that all hold in a row with the finding.
    """

    _: KW_ONLY
    conditions: tuple[Condition, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        return tuple(condition.column for condition in self.conditions)

    def holds(self, row: AnyRow) -> bool:
        """Whether a row has the finding."""
        return all(condition.holds(row) for condition in self.conditions)


# The rules of each table, in the order in which their numbers stand in a finding


CHECKS_OF_RECORDINGS: tuple[Rule, ...] = (
    # samples in a row at the largest torque: the load cell is clipped
    NumberRule(
        "clipped_torque",
        Source.CLIPPED_SIGNAL,
        tables=(
            Table.BELT,
            Table.TRANSMISSION,
            Table.ACTUATOR,
            Table.IMPEDANCE,
            Table.TORQUE_ANGLE,
            Table.CALIBRATION,
        ),
        column="saturated_samples",
        limit=at_most(5),
    ),
    # [N*m/min] estimated from the torque; ten times the usual drift
    NumberRule(
        "drifting_load_cell",
        Source.CHANGE_OVER_TIME,
        tables=(Table.TRANSMISSION,),
        column="load_cell_drift",
        limit=at_most(0.5),
    ),
    # share of the range: the load cell drifts, or the device creeps
    NumberRule(
        "open_torque_loop",
        Source.OPEN_LOOP,
        tables=(Table.TORQUE_ANGLE,),
        column="closure_torque",
        limit=at_most(0.05),
    ),
    # of the energy stored: more comes back than went in, beyond noise
    NumberRule(
        "returned_energy",
        Source.OPEN_LOOP,
        tables=(Table.TORQUE_ANGLE,),
        column="returned_share",
        limit=at_most(1.01),
    ),
    # times both intervals: the stated fixture is not the measured one
    NumberRule(
        "fixture_error",
        Source.FIXTURE_INERTIA,
        tables=(Table.CALIBRATION,),
        column="fixture_error",
        limit=at_most(1.0),
    ),
    # [ppm] beyond its interval by which two clocks differ: 0.06 ms in a minute
    NumberRule(
        "clock_drift",
        Source.CLOCKS_DISAGREE,
        tables=(Table.CALIBRATION,),
        column="certain_clock_drift_ppm",
        limit=at_most(1.0),
    ),
    # [s] beyond its interval by which the torque is early, or late
    NumberRule(
        "leading_torque",
        Source.LATE_TORQUE,
        tables=(Table.CALIBRATION,),
        column="certain_lag_s",
        limit=at_least(-2e-5),
    ),
    NumberRule(
        "lagging_torque",
        Source.LATE_TORQUE,
        tables=(Table.CALIBRATION,),
        unless=(Source.CLOCKS_DISAGREE,),
        column="certain_lag_s",
        limit=Limit(high=2e-5),
    ),
    # of torque over angle, beyond its interval
    NumberRule(
        "torque_gain",
        Source.WRONG_GAIN,
        tables=(Table.CALIBRATION,),
        column="certain_gain_error",
        limit=at_most(0.002),
    ),
    # noise near half the rate of the markers over that at a tenth of it: of raw ones 0.07 to 1
    NumberRule(
        "smoothed_markers",
        Source.SMOOTHED_MARKERS,
        tables=(Table.WALKING_GROUPS,),
        column="marker_noise_ratio",
        limit=at_least(0.001),
    ),
    # residual of the foot's rigid body after the onset over that before it; of gaps that no one
    # filled 1
    NumberRule(
        "filled_marker_gaps",
        Source.OCCLUDED_MARKER,
        tables=(Table.WALKING_GROUPS,),
        column="foot_residual_ratio",
        limit=at_most(3.0),
    ),
    # share of the platform's turn: a window that ends on the ramp tells K from I badly
    NumberRule(
        "late_turn",
        Source.SLOW_RAMP,
        tables=(Table.WALKING_GROUPS,),
        column="turn_share",
        limit=at_least(0.9),
    ),
    # of what the unperturbed crossings leave: not of second order, or a clipped channel
    NumberRule(
        "residual_over_gait",
        Source.UNEXPLAINED_TORQUE,
        tables=(Table.WALKING, Table.WALKING_GROUPS),
        column="residual_over_gait",
        limit=at_most(6.0),
    ),
    # relative change of K if the fit has an offset
    NumberRule(
        "offset_of_fit",
        Source.UNEXPLAINED_TORQUE,
        tables=(Table.WALKING_GROUPS,),
        column="offset_share",
        limit=at_most(0.5),
    ),
    # of stance, before the onset: 1 of 12 sound crossings scatters by 0.03
    NumberRule(
        "change_of_pace",
        Source.MIXED_GROUP,
        tables=(Table.WALKING_GROUPS,),
        column="pace_change",
        limit=at_most(0.05),
    ),
    # of stance: perturbations at several timings
    NumberRule(
        "scattered_onsets",
        Source.MIXED_GROUP,
        tables=(Table.WALKING_GROUPS,),
        column="onset_phase_sd",
        limit=at_most(0.05),
    ),
)
"""They name the cause of a doubtful estimate, and decide where no candidate models were weighed."""

# of K, without friction, over the sheet's K_d, where the gains are not known: a spring in series
# lowers K, the shipped ankle's belt of 770 N*m/rad to 0.66 of K_d = 400
K_UNLIKE_SHEET = Limit(0.5, 1.06)

PLAUSIBILITY: tuple[Rule, ...] = (
    # of the belt's stiffness: the motor acts through the belt
    NumberRule(
        "stiffer_than_belt",
        Source.UNLIKELY_SIZE,
        tables=(Table.IMPEDANCE,),
        column="K_over_K_s",
        limit=at_most(1.0),
        units=("torque", "angle"),
    ),
    NumberRule(
        "K_unlike_sheet",
        Source.UNLIKELY_SIZE,
        tables=(Table.IMPEDANCE,),
        unless=(Source.TORQUE_PATH,),
        column="K_over_K_d",
        limit=K_UNLIKE_SHEET,
        units=("torque", "angle"),
        second="B_over_B_d",
    ),
    # [N*m/rad]; ankles and prosthetic feet have up to 1500
    NumberRule(
        "too_stiff",
        Source.UNLIKELY_SIZE,
        tables=(Table.IMPEDANCE,),
        column="K",
        limit=at_most(5000.0),
    ),
    # [N*m/rad, N*m*s/rad]; no joint is so soft, and a pure damper has B
    RowRule(
        "too_soft",
        Source.UNLIKELY_SIZE,
        tables=(Table.IMPEDANCE,),
        conditions=(SmallerThan("K", 1.0), SmallerThan("B", 0.1)),
    ),
    # times the step of an encoder in rad: the step tells deg from rad
    NumberRule(
        "angle_in_degrees",
        Source.WRONG_UNIT,
        tables=(Table.IMPEDANCE,),
        column="angle_too_small",
        limit=at_most(2.0),
    ),
    # of K without friction to what the gains should give: legs of the default device 0.98 to 1.01,
    # devices differ from their file by 2 %
    NumberRule(
        "K_unlike_gains",
        Source.UNLIKELY_SIZE,
        tables=(Table.IMPEDANCE,),
        column="K_ratio",
        limit=within_factor(1.06),
        units=("torque", "angle"),
    ),
    # of the joint's angle: K_s is 1 % too small
    NumberRule(
        "shaft_turn_back",
        Source.IMPOSSIBLE_ESTIMATE,
        tables=(Table.BELT,),
        column="shaft_turn",
        limit=at_least(-0.02),
    ),
    # [N*m/rad]; a person's ankle is no negative spring
    NumberRule(
        "negative_K",
        Source.IMPOSSIBLE_ESTIMATE,
        tables=(Table.WALKING_GROUPS,),
        column="K",
        limit=at_least(0.0),
        is_of_estimate=True,
    ),
    # the upper ends of the intervals of dampings, frictions and inertias, which are positive
    NumberRule(
        "negative_interval",
        Source.IMPOSSIBLE_ESTIMATE,
        tables=(Table.IMPEDANCE, Table.WALKING_GROUPS),
        column="B_high",
        limit=at_least(0.0),
        is_of_estimate=True,
    ),
    NumberRule(
        "negative_interval",
        Source.IMPOSSIBLE_ESTIMATE,
        tables=(Table.IMPEDANCE, Table.ACTUATOR),
        column="f_C_high",
        limit=at_least(0.0),
        is_of_estimate=True,
    ),
    NumberRule(
        "negative_interval",
        Source.IMPOSSIBLE_ESTIMATE,
        tables=(Table.ACTUATOR,),
        column="B_m_high",
        limit=at_least(0.0),
        is_of_estimate=True,
    ),
    NumberRule(
        "negative_interval",
        Source.IMPOSSIBLE_ESTIMATE,
        tables=(Table.ACTUATOR,),
        column="J_m_high",
        limit=at_least(0.0),
        is_of_estimate=True,
    ),
    # [N*m/rad]; no joint is so soft, nor so stiff
    NumberRule(
        "K_of_no_device",
        Source.UNLIKELY_SIZE,
        tables=(Table.TORQUE_ANGLE,),
        column="K",
        limit=Limit(1.0, 10_000.0),
    ),
    # [kg*m^2]; Eq. 15 reads a leg with a drivetrain, of third order, with a negative I
    NumberRule(
        "negative_inertia",
        Source.IMPOSSIBLE_ESTIMATE,
        tables=(Table.WALKING_GROUPS,),
        column="I_high",
        limit=at_least(-0.3),
        is_of_estimate=True,
    ),
    # [N*m*s/rad] upper ends of intervals: a torque that is early gives energy
    NumberRule(
        "negative_damping",
        Source.LATE_TORQUE,
        tables=(Table.TRANSMISSION,),
        column="B_j_high",
        limit=at_least(0.0),
    ),
    NumberRule(
        "negative_damping",
        Source.LATE_TORQUE,
        tables=(Table.BELT,),
        column="B_loading_high",
        limit=at_least(0.0),
    ),
)
"""Units, signs and sizes, against gains, the sheet or the parameter file."""

STATED_BY_CONFIGURATION: tuple[Rule, ...] = (
    NumberRule(
        "energy_lost",
        Source.OPEN_LOOP,
        tables=(Table.BELT,),
        column="energy_lost",
        limit=None,
    ),
    NumberRule(
        "B_unlike_gains",
        Source.DAMPING_UNLIKE_GAINS,
        tables=(Table.IMPEDANCE,),
        unless=(Source.FRICTION,),
        column="B_gap_s",
        limit=None,
    ),
    NumberRule(
        "torque_constant",
        Source.UNLIKELY_SIZE,
        tables=(Table.ACTUATOR,),
        column="k_tau_n_m_ratio",
        limit=None,
        units=("torque", "current"),
        second="J_m_ratio",
    ),
    NumberRule(
        "belt_stiffness",
        Source.UNLIKELY_SIZE,
        tables=(Table.BELT, Table.IMPEDANCE),
        column="K_s_ratio",
        limit=None,
        units=("torque", "angle"),
        second="K_s_ratio",
    ),
    NumberRule(
        "joint_damping",
        Source.UNLIKELY_SIZE,
        tables=(Table.TRANSMISSION,),
        column="B_j_ratio",
        limit=None,
        units=("torque", "angle"),
        second="J_j_ratio",
    ),
    NumberRule(
        "component_ratio",
        Source.UNLIKELY_SIZE,
        tables=(Table.TRANSMISSION,),
        column="J_j_ratio",
        limit=None,
        units=("torque", "angle"),
    ),
    NumberRule(
        "component_ratio",
        Source.UNLIKELY_SIZE,
        tables=(Table.ACTUATOR,),
        column="J_m_ratio",
        limit=None,
        units=("torque", "angle"),
    ),
    NumberRule(
        "component_ratio",
        Source.UNLIKELY_SIZE,
        tables=(Table.ACTUATOR,),
        column="f_C_ratio",
        limit=None,
        units=("torque", "angle"),
    ),
    NumberRule(
        "unexplained_variance",
        Source.UNEXPLAINED_TORQUE,
        tables=(Table.IMPEDANCE, Table.TORQUE_ANGLE, Table.WALKING_GROUPS),
        column="VAF",
        limit=None,
    ),
    NumberRule(
        "stance_durations",
        Source.MIXED_GROUP,
        tables=(Table.WALKING_GROUPS,),
        column="unperturbed_stance_sd",
        limit=None,
    ),
    NumberRule(
        "left_out_crossings",
        Source.SELECTED_CROSSINGS,
        tables=(Table.WALKING_GROUPS,),
        column="left_out_share",
        limit=None,
    ),
    NumberRule(
        "changed_set_up",
        Source.SET_UP_DIFFERS,
        tables=(Table.WALKING_GROUPS,),
        column="different_mm",
        limit=None,
    ),
    NumberRule(
        "plate_height",
        Source.PLATE_HEIGHT,
        tables=(Table.WALKING_GROUPS,),
        column="plate_height_m",
        limit=None,
    ),
    NumberRule(
        "plate_lag_scatter",
        Source.CLOCKS_DISAGREE,
        tables=(Table.WALKING_GROUPS,),
        column="plate_lag_sd_s",
        limit=None,
    ),
    NumberRule(
        "bridged_markers",
        Source.OCCLUDED_MARKER,
        tables=(Table.WALKING,),
        column="bridged",
        limit=None,
    ),
    NumberRule(
        "centre_of_pressure",
        Source.WRONG_CENTRE_OF_PRESSURE,
        tables=(Table.WALKING_GROUPS,),
        column="cop_outside_m",
        limit=None,
    ),
)
"""Findings by a limit that the configuration states, under `doubtful`, in any table that has the
column."""

CLOCKS_AND_GEARS: tuple[Rule, ...] = (
    # [s/s] by which the plate's clock runs otherwise than that of the cameras: a second of it lags
    # by a ms more
    NumberRule(
        "plate_drift",
        Source.CLOCKS_DISAGREE,
        tables=(Table.WALKING_GROUPS,),
        column="plate_drift",
        limit=at_most(0.001),
    ),
    # [s] by which the plate lags more in the crossings than in unloaded recordings: 1 ms moves K by
    # 7 %, B by 25 %
    NumberRule(
        "plate_lag_change",
        Source.CLOCKS_DISAGREE,
        tables=(Table.WALKING_GROUPS,),
        column="plate_lag_change_s",
        limit=at_most(0.001),
    ),
    # of the ratio that is stated: encoders and teeth are exact
    NumberRule(
        "gear_ratio",
        Source.COLUMNS_CONTRADICT,
        tables=(Table.IMPEDANCE,),
        column="gear_ratio",
        limit=within_factor(1.03),
    ),
)

REMARKS: tuple[Rule, ...] = (
    # of the parameter file's: a belt and a motor's constant are known to a few percent
    NumberRule(
        "gain_or_device",
        Source.WRONG_GAIN,
        tables=(Table.BELT,),
        grade=Grade.NOTES,
        unless=(Source.WRONG_UNIT, Source.UNLIKELY_SIZE),
        column="K_s_ratio",
        limit=within_factor(1.05),
    ),
    NumberRule(
        "gain_or_device",
        Source.WRONG_GAIN,
        tables=(Table.ACTUATOR,),
        grade=Grade.NOTES,
        unless=(Source.WRONG_UNIT, Source.UNLIKELY_SIZE),
        column="k_tau_n_m_ratio",
        limit=within_factor(1.05),
    ),
    # of the sheet's B_d: friction, and a loop without compensation, move B by half
    NumberRule(
        "B_unlike_sheet",
        Source.DAMPING_UNLIKE_GAINS,
        tables=(Table.IMPEDANCE,),
        grade=Grade.NOTES,
        unless=(Source.FRICTION, Source.WRONG_UNIT, Source.UNLIKELY_SIZE),
        column="B_over_B_d",
        limit=Limit(0.5, 1.5),
    ),
)
"""What is worth knowing."""

NOT_CHECKED: tuple[Rule, ...] = (
    RowRule(
        "no_fixture",
        Source.FIXTURE_INERTIA,
        tables=(Table.TRANSMISSION, Table.TORQUE_ANGLE),
        grade=Grade.UNCHECKED,
        conditions=(Missing("fixture"),),
    ),
    RowRule(
        "no_fixture",
        Source.FIXTURE_INERTIA,
        tables=(Table.CALIBRATION,),
        grade=Grade.UNCHECKED,
        conditions=(Missing("fixture"), Missing("rest_deg")),
    ),
    RowRule(
        "one_speed",
        Source.LATE_TORQUE,
        tables=(Table.TORQUE_ANGLE,),
        grade=Grade.UNCHECKED,
        conditions=(Given("energy_lost"),),
    ),
    RowRule(
        "no_belt_stiffness",
        Source.WRONG_GAIN,
        tables=(Table.BELT,),
        grade=Grade.UNCHECKED,
        conditions=(Missing("K_s_ratio"),),
    ),
    RowRule(
        "no_torque_constant",
        Source.WRONG_GAIN,
        tables=(Table.ACTUATOR,),
        grade=Grade.UNCHECKED,
        conditions=(Missing("k_tau_n_m_ratio"),),
    ),
    RowRule(
        "no_angle",
        Source.WRONG_GAIN,
        tables=(Table.ACTUATOR,),
        grade=Grade.UNCHECKED,
        conditions=(Given("speed_alone"),),
    ),
    RowRule(
        "computed_torque",
        Source.TORQUE_PATH,
        tables=(Table.IMPEDANCE, Table.TORQUE_ANGLE, Table.ACTUATOR),
        grade=Grade.UNCHECKED,
        conditions=(Given("torque_from"),),
    ),
    RowRule(
        "no_gear_ratio",
        Source.COLUMNS_CONTRADICT,
        tables=(Table.IMPEDANCE,),
        grade=Grade.UNCHECKED,
        conditions=(Given("gear"), Missing("gear_ratio")),
    ),
    RowRule(
        "no_torque_zero",
        Source.NOT_ZEROED,
        tables=(Table.TORQUE_ANGLE,),
        grade=Grade.UNCHECKED,
        conditions=(Missing("torque_zero"),),
    ),
)
"""Rules on what could not be checked and no budget has."""

RULES: tuple[Rule, ...] = (
    *CHECKS_OF_RECORDINGS,
    *PLAUSIBILITY,
    *STATED_BY_CONFIGURATION,
    *CLOCKS_AND_GEARS,
    *REMARKS,
    *NOT_CHECKED,
)


def number_rules() -> Iterator[NumberRule]:
    """The rules by a number, in their order."""
    return (rule for rule in RULES if isinstance(rule, NumberRule))


def rules_on(
    table: str, columns: Iterable[str], configured_limits: Iterable[tuple[str, Limit]]
) -> list[Rule]:
    """The rules on a table: first those with limits of the configuration, then those of this file.

    Parameters
    ----------
    table : str
        The table's name.
    columns : Iterable of str
        The table's columns.
    configured_limits : Iterable of (str, Limit)
        Columns, and the limits that the configuration states for them.
    """
    present = set(columns)
    configured = [
        stated_rule(column, limit) for column, limit in configured_limits if column in present
    ]
    built_in = [rule for rule in RULES if table in rule.tables and present >= {*rule.columns}]
    return [*configured, *built_in]


def stated_rule(column: str, limit: Limit) -> NumberRule:
    """The rule with a limit of the configuration, in the words of its column if there are any."""
    for rule in number_rules():
        if rule.column == column and rule.limit is None:
            return replace(rule, limit=limit)
    return NumberRule("stated_limit", Source.STATED_LIMIT, tables=(), column=column, limit=limit)


def has_own_limit(table: str, column: str, side: Side) -> bool:
    """Whether a rule of this file limits a column on this side: the configuration then cannot."""
    return any(
        rule.limit is not None and rule.limit.side in (side, None)
        for rule in number_rules()
        if (rule.column, rule.grade) == (column, Grade.DOUBTS) and table in rule.tables
    )


if not {*Table} <= {*JUDGED_TABLES}:
    raise ValueError(f"rules are on {[*Table]}, and the tables that are judged are {JUDGED_TABLES}")


# Numbers beyond their limits


@dataclass(frozen=True)
class Beyond:
    """A number beyond its limit, as evidence."""

    column: str
    value: float  # in the unit of the column
    limit: float
    source: Source  # that it is evidence of
    # above or below the limit, near a factor between units, or nan; `findings.csv` has no column
    # for it
    side: str = ""
    unit: str = ""  # the factor between units that it may be, in words
    rule: NumberRule | None = field(default=None, compare=False)  # whose words describe it
    probability: float | None = None  # of a fault that a budget weighs

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


def numbers_beyond(row: AnyRow, rules: Iterable[NumberRule]) -> Numbers:
    """Find the numbers of a row that are beyond their limits.

    Parameters
    ----------
    row : AnyRow
        A null is not checked.
    rules : Iterable of NumberRule
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
        if value is None or rule.limit is None or column in numbers:
            continue
        low, high = rule.limit.low, rule.limit.high
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
        source = Source.WRONG_UNIT if is_unit else rule.source
        numbers[column] = Beyond(column, value, limit, source, side, unit, rule)
    return numbers


def unit_of_ratio(rule: NumberRule, ratio: float, row: AnyRow) -> tuple[str, bool]:
    """The factor between units near a ratio to a known value, in words, and whether it is likely.

    A second ratio tells a wrong unit from another device: a wrong torque scales both ratios alike,
    a wrong current only this one.
    """
    if not rule.units or not ratio:
        return "", False
    second = cell_number(row, rule.second)
    likely = []
    if second:
        ratio_of_signal = {"current": second}
        likely = [
            signal
            for signal in rule.units
            if abs(ratio_of_signal.get(signal, second / ratio) - 1) < NEAR_UNIT
        ]
    unit = known_factor(ratio, likely, NEAR_UNIT)
    return unit or known_factor(ratio, rule.units, NEAR_UNIT), bool(unit)
