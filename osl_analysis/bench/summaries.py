# SPDX-License-Identifier: Apache-2.0
"""Summaries over trials: of the components of the drivetrain, of the delay of a bench, and of
controllers beside each other."""

from collections.abc import Mapping

import polars as pl

from osl_analysis.bench.budgets import half_width_of
from osl_analysis.bench.parts_alone import ACTUATOR_PARAMETERS, LOSSES
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.doubts import counted
from osl_analysis.stats.repeats import summary_of_trials, summary_row

PLACE = ("joint", "side")
# half-widths of the interval of a trial that agrees with the mean
MOST_APART = 2.0
SUMMARISED = {
    "belt": ("K_s", "unloading", "hysteresis_area"),
    "transmission": (*LOSSES, "B_j_viscous", "VAF"),
    "actuator": (*ACTUATOR_PARAMETERS, "VAF"),
}
"""Columns of each part's table for which a summary has mean, scatter and interval over the
trials."""


K_PERCENT = 100 / pl.col("K_d")
NO_INTERVAL = pl.lit(None, pl.Float64)
COMPARED: Mapping[str, tuple[str, pl.Expr, pl.Expr]] = {
    "torque_error": ("N*m", pl.col("torque_error"), NO_INTERVAL),
    "K_error": ("%", (K_PERCENT * pl.col("K") - 100).abs(), K_PERCENT * half_width_of("K")),
    "B_error": ("N*m*s/rad", (pl.col("B") - pl.col("B_d")).abs(), half_width_of("B")),
    "B_viscous_error": (
        "N*m*s/rad",
        (pl.col("B_viscous") - pl.col("B_d")).abs(),
        half_width_of("B_viscous"),
    ),
    "VAF": ("%", pl.col("VAF"), NO_INTERVAL),
}
"""Unit, value, and half-width of the 95 % interval of each compared quantity; less is better,
except for the VAF. An error is at most as uncertain as what it is the error of."""
CONDITION = (*PLACE, "K_d", "B_d")


def of_whole_trials(table: pl.DataFrame) -> pl.DataFrame:
    """The rows of whole trials, without those of single amplitudes where a table has them."""
    if "amplitude_deg" not in table.columns:
        return table
    return table.filter(pl.col("amplitude_deg").is_null())


def part_summary(part: str, table: pl.DataFrame) -> pl.DataFrame:
    """Summary of the fits to whole trials in `belt.csv`, `transmission.csv` or `actuator.csv`,
    separately for each joint and side, which have columns."""
    found = []
    for of_place in of_whole_trials(table).partition_by(PLACE):
        place = of_place.select(PLACE).head(1)
        summary = summary_of_trials(of_place, SUMMARISED[part])
        found.append(place.join(summary, how="cross"))
    return pl.concat(found, how="vertical_relaxed")


def delay_table(rows: pl.DataFrame, name: str = "delay") -> pl.DataFrame:
    """The delay of a bench, pooled over trials: one number. It is to be stated
    where the trials agree within `MOST_APART`.

    Parameters
    ----------
    rows : DataFrame
        `impedance.csv`, of which belts of legs tell `lag_s`, or
        `calibration.csv`. Doubtful rows count: a late torque is a cause of doubt.
    name : str
        Of the table: `delay`, or `calibration_delay`.

    Returns
    -------
    DataFrame
        One row per trial that tells a lag.
    """
    lags = of_whole_trials(rows.drop_nulls("lag_s"))
    if lags.is_empty():
        return table_of([], name)
    pooled = summary_row(lags, "lag_s", is_weighted=True)
    delay_s, low_s, high_s = pooled["mean"], pooled["low"], pooled["high"]
    to_state = None
    is_apart = (pl.col("lag_s") - delay_s).abs() > MOST_APART * half_width_of("lag_s")
    if low_s * high_s > 0 and not lags.select(is_apart.any()).item():
        late = "torque" if delay_s > 0 else "theta"
        to_state = f"{late}: {{delay: {1e3 * abs(delay_s):.3g} ms}}"
    table = lags.with_columns(
        trials=len(lags),
        delay_s=delay_s,
        delay_s_low=low_s,
        delay_s_high=high_s,
        to_state=pl.lit(to_state, pl.String),
    )
    described = table_of([], name)
    return pl.concat([described, table], how="diagonal_relaxed").select(described.columns)


def compensation_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """`compensation.csv` from the rows of `impedance.csv`, joined with their doubts, of estimates
    that are not doubtful.

    A row over all pairs has the mean difference and the lowest and highest of them: conditions are
    chosen and no sample, so that no interval of their mean is known. A row of one pair has its own
    95 % interval, whose half-width is the root of the sum of both trials' squares. Repeats of a
    condition count as their mean, with the mean of their half-widths."""
    whole = of_whole_trials(impedance).sort(CONDITION)
    whole = whole.filter(pl.col("K_d") != 0, pl.col("B_d").is_not_null())
    values = pl.concat(
        counted(whole, value.meta.root_names()).select(
            *CONDITION,
            "controller",
            quantity=pl.lit(name),
            unit=pl.lit(unit),
            value=value,
            half=half,
        )
        for name, (unit, value, half) in COMPARED.items()
    )
    keys = [*CONDITION, "quantity", "unit"]
    repeats = values.drop_nulls("value").group_by(*keys, "controller", maintain_order=True)
    means = repeats.agg(pl.col("value", "half").mean())
    compensated, uncompensated = (means.filter(controller=name) for name in CONTROLLERS)
    pairs = compensated.join(
        uncompensated, on=keys, nulls_equal=True, maintain_order="left", suffix="_of_other"
    )
    difference = pl.col("value") - pl.col("value_of_other")
    half_width = (pl.col("half").pow(2) + pl.col("half_of_other").pow(2)).sqrt()
    gain = pl.when(quantity="VAF").then(difference).otherwise(-difference)
    rows = pairs.rename({"value": "compensated", "value_of_other": "uncompensated"}).with_columns(
        pairs.select(
            of=pl.lit("trial"),
            pairs=pl.lit(1, pl.Int64),
            better=(gain > 0).cast(pl.Int64),
            difference=difference,
            difference_low=difference - half_width,
            difference_high=difference + half_width,
        )
    )
    summaries = rows.group_by(*PLACE, "quantity", "unit", maintain_order=True).agg(
        pl.col("pairs", "better").sum(),
        pl.col("compensated", "uncompensated", "difference").mean(),
        difference_low=pl.col("difference").min(),
        difference_high=pl.col("difference").max(),
        of=pl.lit("trials"),
    )
    names = described_tables_by_name()["compensation"].columns
    table = pl.concat([summaries, rows], how="diagonal_relaxed")
    return table.select(name for name in names if name in table.columns)
