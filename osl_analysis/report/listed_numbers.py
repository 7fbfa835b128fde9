# SPDX-License-Identifier: Apache-2.0
"""The list of headline numbers, in the order of the summary.

Each entry says the table, the rows and the function of its number:

    ListedNumber("K", "impedance", "N*m/rad", value="K", rows=is_whole, ends=("K_low", "K_high"))

Importing fails where a table lacks a column, or `numbers.yaml` the words of a number. The first
numbers say whether compensation is better: a pair is a compensated and an uncompensated trial of
one condition, or both at one frequency.
"""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any, Literal

import polars as pl

from osl_analysis.base.errors import nearest
from osl_analysis.base.files import package_yaml
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.stats.doubts import is_doubtful

Column = str | Callable[[pl.DataFrame], pl.Series]
"""A column of a table, or a function of the table that gives one."""

BY_CONDITION = "by condition"
"""`says` of numbers that stand in the sentence of their condition."""


@dataclass(frozen=True)
class WordsOfNumber:
    """The words of a number: its meaning, and the begin of its sentence at the end of a run and on
    the page; empty for none."""

    meaning: str
    says: str = ""


CONTENT: Mapping[str, Any] = package_yaml(Path(__file__).with_name("numbers.yaml"))
WORDS = {name: WordsOfNumber(**texts) for name, texts in CONTENT.items()}


def all_rows(table: pl.DataFrame) -> pl.Series:
    """Every row of a table."""
    return pl.repeat(True, len(table), eager=True)


@dataclass(frozen=True)
class ListedNumber:
    """A headline number.

    Attributes
    ----------
    name
        Its name; columns of the first row may stand in braces, as `{name}`.
    table
        Its result table.
    unit
        Its unit, with columns in braces as in `name`.
    value
        The column, or the function of the table, with the number of each row.
    of
        The columns that `value` uses, where it is a function. A row counts where none of them is
        doubtful.
    rows
        The function that says which rows (n,) count.
    ends
        The ends of its interval; None: several rows have the range of their values.
    by
        Columns; there is a number for each combination of their values, which ends its name.
    reduce
        How rows become one number; a mean of estimates has Student's interval.
    symbol
        The symbol before the number in its sentence.
    in_condition
        Whether it stands in the sentence of its condition, in place of one of its own.
    draft
        The value in the paper's draft.
    interval
        The name of its interval, where no column has it.
    origin
        The table with its trials, where that is neither its own nor that of the summary.
    words
        The key of its words in `numbers.yaml`; empty: its name.
    """

    name: str
    table: str
    unit: str
    _: KW_ONLY
    value: Column
    of: tuple[str, ...] = ()
    rows: Callable[[pl.DataFrame], pl.Series] = all_rows
    ends: tuple[Column, Column] | None = None
    by: tuple[str, ...] = ()
    reduce: Literal["mean", "median", "sum"] = "mean"
    symbol: str = ""
    in_condition: bool = False
    draft: float | None = None
    interval: str = ""
    origin: str = ""
    words: str = ""

    def __post_init__(self) -> None:
        if (self.words or self.name) not in WORDS:
            raise ValueError(f"numbers.yaml has no words of '{self.words or self.name}'")
        described = described_tables_by_name()[self.table]
        columns = {**described.columns, **described.of_fits}
        ends = [end for end in self.ends or () if isinstance(end, str)]
        for column in (*self.columns, *ends, *self.by):
            if column not in columns:
                raise ValueError(
                    f"number {self.name}: {self.table} has no column '{column}'"
                    f"{nearest(column, columns)}"
                )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that the number uses."""
        return (self.value,) if isinstance(self.value, str) else self.of

    @property
    def meaning(self) -> str:
        """Its meaning, with columns of the first row in braces."""
        return WORDS[self.words or self.name].meaning

    @property
    def says(self) -> str:
        """The begin of its sentence."""
        return BY_CONDITION if self.in_condition else WORDS[self.words or self.name].says


def column_of(table: pl.DataFrame, column: Column) -> pl.Series:
    """A column (n,) of a table, or a function of it, as floats."""
    values = table[column] if isinstance(column, str) else column(table)
    return values.cast(pl.Float64)


# Which rows count


def is_whole(fits: pl.DataFrame) -> pl.Series:
    """Fits to all amplitudes of a trial."""
    return fits["amplitude_deg"].is_null()


def is_drawn(fits: pl.DataFrame) -> pl.Series:
    """Fits to single amplitudes, or to a motion that has no amplitude (Fig. 6)."""
    return fits["amplitude_deg"].is_not_null() | fits["trial"].is_unique()


def is_estimate(quantity: str, estimator: str = "") -> Callable[[pl.DataFrame], pl.Series]:
    """Rows of one quantity, by one estimator if it is named."""

    def chosen(summary: pl.DataFrame) -> pl.Series:
        rows = summary["quantity"] == quantity
        return rows & (summary["estimator"] == estimator) if estimator else rows

    return chosen


def is_pair_of_trials(quantity: str) -> Callable[[pl.DataFrame], pl.Series]:
    """Rows of a quantity over pairs of trials."""

    def chosen(compensation: pl.DataFrame) -> pl.Series:
        return (compensation["of"] == "trials") & (compensation["quantity"] == quantity)

    return chosen


def is_of_all_amplitudes(response: pl.DataFrame) -> pl.Series:
    return response["scope"] == "all"


def is_headline(response: pl.DataFrame) -> pl.Series:
    return response["is_headline"].cast(pl.Boolean)  # a column of nulls has no type


def is_delay_to_state(delay: pl.DataFrame) -> pl.Series:
    """The first trial of those that agree on a delay, which all have it."""
    is_first = delay.select(pl.col("trial") == pl.col("trial").min())["trial"]
    return delay["to_state"].is_not_null() & is_first


def is_certain_without_agreement(delay: pl.DataFrame) -> pl.Series:
    """Trials whose delay is certainly not 0, and that do not agree on one."""
    return delay["to_state"].is_null() & (delay["delay_s_low"] * delay["delay_s_high"] > 0)


# Functions of tables


def negative(column: str) -> Callable[[pl.DataFrame], pl.Series]:
    """A column with the other sign."""
    return lambda table: -table[column]


def milliseconds(column: str) -> Callable[[pl.DataFrame], pl.Series]:
    """A column [s] in ms."""
    return lambda table: 1000 * table[column]


def is_nearer_to_Z_d(response: pl.DataFrame) -> pl.Series:
    """Whether |Z - Z_d| is smaller with compensation, by frequency of each compensated trial.

    It is compared with the smallest sound one without compensation in the same condition, and null
    where there is none.
    """
    pair = ["joint", "side", "K_d", "B_d", "frequency_hz"]
    rows = response.with_columns(is_left_out=is_doubtful(response, ["Z_error"]))
    uncompensated = rows.filter(pl.col("controller") == "uncompensated", ~pl.col("is_left_out"))
    smallest = uncompensated.group_by(pair).agg(smallest=pl.col("Z_error").min())
    paired = rows.join(smallest, on=pair, how="left", nulls_equal=True, maintain_order="left")
    is_smaller = pl.when(controller="compensated").then(pl.col("Z_error") < pl.col("smallest"))
    return paired.select(is_smaller=is_smaller)["is_smaller"]


def percent_above_K_d(fits: pl.DataFrame) -> pl.Series:
    return 100 * (fits["K"] / fits["K_d"] - 1)


def above_B_d(fits: pl.DataFrame) -> pl.Series:
    return fits["B"] - fits["B_d"]


def distance_to_B_d(fits: pl.DataFrame) -> pl.Series:
    return (fits["B"] - fits["B_d"]).abs()


def viscous_distance_to_B_d(fits: pl.DataFrame) -> pl.Series:
    return (fits["B_viscous"] - fits["B_d"]).abs()


def change_of_K_by_offset(groups: pl.DataFrame) -> pl.Series:
    return groups["K"] * groups["offset_share"]


# The numbers

CONDITION = ("controller", "K_d", "B_d")


def nearer(symbol: str, unit: str) -> ListedNumber:
    """How much nearer to the desired value an estimate is with compensation."""
    return ListedNumber(
        f"nearer_{symbol}",
        "compensation",
        unit,
        value=negative("difference"),
        of=("difference",),
        ends=(negative("difference_high"), negative("difference_low")),
        rows=is_pair_of_trials(f"{symbol}_error"),
        interval="lowest to highest",
        origin="impedance",
    )


def condition_number(estimate: str, unit: str, symbol: str = "") -> ListedNumber:
    """An estimate of the trials of each condition."""
    return ListedNumber(
        estimate,
        "impedance",
        unit,
        value=estimate,
        ends=(f"{estimate}_low", f"{estimate}_high"),
        rows=is_whole,
        by=CONDITION,
        symbol=symbol,
        in_condition=bool(symbol),
    )


def at_frequency(name: str, column: str, unit: str, symbol: str) -> ListedNumber:
    """Real or imaginary part of Z at one frequency, of each condition."""
    return ListedNumber(
        name,
        "response",
        unit,
        value=column,
        ends=(f"{column}_low", f"{column}_high"),
        rows=is_headline,
        by=CONDITION,
        symbol=symbol,
    )


def while_walking(
    estimate: str, unit: str, symbol: str = "", draft: float | None = None
) -> ListedNumber:
    """An estimate of each group of crossings."""
    return ListedNumber(
        f"walking_{estimate}",
        "walking_summary",
        unit,
        value="mean",
        ends=("low", "high"),
        rows=is_estimate(estimate, "ensemble"),
        by=("group",),
        symbol=symbol,
        draft=draft,
    )


def component_number(
    quantity: str, table: str, unit: str, draft: float, symbol: str = ""
) -> ListedNumber:
    """A component of the drivetrain, as the mean over its trials."""
    return ListedNumber(
        quantity,
        table,
        unit,
        value="mean",
        ends=("low", "high"),
        rows=is_estimate(quantity),
        draft=draft,
        symbol=symbol,
    )


LISTED_NUMBERS = (
    nearer("K", "points"),
    nearer("B", "N*m*s/rad"),
    ListedNumber(
        "nearer_Z",
        "response",
        "pairs",
        value=is_nearer_to_Z_d,
        of=("controller", "Z_error", "joint", "side", "K_d", "B_d", "frequency_hz"),
        rows=is_of_all_amplitudes,
        reduce="sum",
    ),
    ListedNumber(
        "VAF_median",
        "impedance",
        "%",
        value="VAF",
        rows=is_drawn,
        by=("controller",),
        reduce="median",
    ),
    ListedNumber(
        "K_bias",
        "impedance",
        "%",
        value=percent_above_K_d,
        of=("K", "K_d"),
        rows=is_whole,
        by=("controller",),
    ),
    ListedNumber(
        "B_bias",
        "impedance",
        "N*m*s/rad",
        value=above_B_d,
        of=("B", "B_d"),
        rows=is_whole,
        by=("controller",),
    ),
    ListedNumber(
        "B_error",
        "impedance",
        "N*m*s/rad",
        value=distance_to_B_d,
        of=("B", "B_d"),
        rows=is_whole,
        by=("controller",),
    ),
    ListedNumber(
        "torque_error",
        "impedance",
        "N*m",
        value="torque_error",
        rows=is_whole,
        by=("controller",),
    ),
    ListedNumber(
        "bench_delay",
        "delay",
        "ms",
        value=milliseconds("delay_s"),
        of=("delay_s",),
        ends=(milliseconds("delay_s_low"), milliseconds("delay_s_high")),
        rows=is_delay_to_state,
    ),
    ListedNumber(
        "bench_delay_undecided",
        "delay",
        "ms",
        value=milliseconds("lag_s"),
        of=("lag_s",),
        rows=is_certain_without_agreement,
    ),
    condition_number("K", "N*m/rad", "K"),
    condition_number("B", "N*m*s/rad", "B"),
    condition_number("B_viscous", "N*m*s/rad"),
    condition_number("K_d_rendered", "N*m/rad"),
    condition_number("B_d_rendered", "N*m*s/rad"),
    at_frequency("K_at_hz", "stiffness", "N*m/rad", "K"),
    at_frequency("B_at_hz", "damping", "N*m*s/rad", "B"),
    condition_number("I", "kg*m^2"),
    while_walking("K", "N*m/rad", "K", draft=340.0),
    while_walking("B", "N*m*s/rad", "B"),
    while_walking("I", "kg*m^2"),
    ListedNumber(
        "walking_K_by_offset",
        "walking_groups",
        "N*m/rad",
        value=change_of_K_by_offset,
        of=("K", "offset_share"),
        by=("group",),
    ),
    component_number("K_s", "belt_summary", "N*m/rad", 685.6, "K_s"),
    component_number("B_j", "transmission_summary", "N*m*s/rad", 0.452, "B_j"),
    component_number("J_j", "transmission_summary", "kg*m^2", 0.005),
    ListedNumber(
        "transmission_VAF",
        "transmission",
        "%",
        value="VAF",
        rows=is_whole,
        draft=99.1,
    ),
    component_number("k_tau_n_m", "actuator_summary", "N*m/A", 1.0197),
    component_number("f_C", "actuator_summary", "N*m", 0.377),
    component_number("f_G", "actuator_summary", "N*m/A", 0.0896),
    component_number("B_m", "actuator_summary", "N*m*s/rad", 0.0056),
    component_number("J_m", "actuator_summary", "kg*m^2", 0.009211),
    ListedNumber(
        "torque_angle_K",
        "torque_angle",
        "N*m/rad",
        value="K",
        ends=("K_low", "K_high"),
        by=("trial",),
    ),
    ListedNumber(
        "energy_lost",
        "torque_angle",
        "J",
        value="energy_lost",
        ends=("energy_lost_low", "energy_lost_high"),
        by=("trial",),
    ),
    ListedNumber(
        "VAF_mean",
        "impedance",
        "%",
        value="VAF",
        rows=is_drawn,
        by=("controller",),
    ),
    ListedNumber(
        "B_viscous_error",
        "impedance",
        "N*m*s/rad",
        value=viscous_distance_to_B_d,
        of=("B_viscous", "B_d"),
        rows=is_whole,
        by=("controller",),
    ),
    ListedNumber("walking_VAF", "walking", "%", value="VAF"),
    ListedNumber(
        "{name}",
        "claims",
        "{unit}",
        value="value",
        ends=("low", "high"),
        by=("name",),
        words="claim",
    ),
)
