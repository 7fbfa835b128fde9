"""Summaries over trials: of the components of the drivetrain, and of the delay of a bench."""

from typing import Any

import polars as pl

from osl_analysis.bench.actuator_alone import ACTUATOR_PARAMETERS
from osl_analysis.bench.leg_belt import BELT_ERROR, without_lag
from osl_analysis.bench.transmission import LOSSES
from osl_analysis.dictionary import table_of
from osl_analysis.stats.repeats import summary_of_trials, summary_row

PLACE = ("joint", "side")
SUMMARISED = {
    "belt": ("K_s", "unloading", "hysteresis_area"),
    "transmission": (*LOSSES, "VAF"),
    "actuator": (*ACTUATOR_PARAMETERS, "VAF"),
}
"""Columns of each part's table for which a summary has mean, scatter and interval over the
trials."""


def part_summary(part: str, table: pl.DataFrame) -> pl.DataFrame:
    """Summary of the fits to whole trials in `belt.csv`, `transmission.csv` or `actuator.csv`,
    separately for each joint and side, which have columns."""
    whole = table
    if "amplitude_deg" in table.columns:
        whole = table.filter(pl.col("amplitude_deg").is_null())
    found = []
    for of_place in whole.partition_by(PLACE, maintain_order=True):
        place = of_place.select(PLACE).head(1)
        summary = summary_of_trials(of_place, SUMMARISED[part])
        found.append(place.join(summary, how="cross"))
    return pl.concat(found, how="vertical_relaxed")


def delay_table(rows: pl.DataFrame, name: str = "delay") -> pl.DataFrame:
    """The delay of a bench, pooled over trials: one number, and what it changes.

    Parameters
    ----------
    rows : DataFrame
        `impedance.csv`, of which belts of legs tell `lag_s`, or
        `calibration.csv`. Doubtful rows count: a late torque is a cause of doubt.
    name : str
        Of the table: `delay`, or `calibration_delay`, which has no B and I.

    Returns
    -------
    DataFrame
        One row per row that tells a lag.
    """
    lags = rows.drop_nulls("lag_s")
    of_trials = lags
    if "amplitude_deg" in lags.columns:
        of_trials = lags.filter(pl.col("amplitude_deg").is_null())
        of_trials = of_trials.with_columns(lag_s_se_bench=pl.lit(BELT_ERROR))
    if of_trials.is_empty():
        return table_of([], name)
    delay_s, low_s, high_s = of_trials.select("lag_s", "lag_s_low", "lag_s_high").row(0)
    if len(of_trials) > 1:  # a single trial has its own interval
        pooled: dict[str, Any] = summary_row(of_trials, "lag_s")
        delay_s, low_s, high_s = pooled["mean"], pooled["low"], pooled["high"]
    to_state = None
    if low_s * high_s > 0:
        late = "torque" if delay_s > 0 else "theta"
        to_state = f"{late}: {{delay: {1e3 * abs(delay_s):.3g} ms}}"
    table = lags.with_columns(
        trials=pl.lit(len(of_trials)),
        delay_s=pl.lit(delay_s),
        delay_s_low=pl.lit(low_s),
        delay_s_high=pl.lit(high_s),
        to_state=pl.lit(to_state, pl.String),
    )
    if "K" in table.columns:
        half_width_s = pl.lit((high_s - low_s) / 2)
        table = table.with_columns(without_lag(pl.col("delay_s"), half_width_s))
    described = table_of([], name).columns
    told = table.select(column for column in described if column in table.columns)
    return table_of(told.to_dicts(), name, complete=True)
