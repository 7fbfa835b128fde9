# SPDX-License-Identifier: Apache-2.0
"""Summaries over trials: of the components of the drivetrain, of the delay of a bench, and of
controllers beside each other."""

from collections.abc import Mapping

import polars as pl

from osl_analysis.bench.parts_alone import ACTUATOR_PARAMETERS, LOSSES
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import alike_sizes, is_doubtful, summary_of_trials, summary_row

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

COMPARED: Mapping[str, tuple[str, str, str | None]] = {
    "torque_error": ("N*m", "torque_error", None),
    "K_error": ("%", "100 * abs(K / K_d - 1)", "50 * (K_high - K_low) / K_d"),
    "B_error": ("N*m*s/rad", "abs(B - B_d)", "(B_high - B_low) / 2"),
    "B_viscous_error": (
        "N*m*s/rad",
        "abs(B_viscous - B_d)",
        "(B_viscous_high - B_viscous_low) / 2",
    ),
    "VAF": ("%", "VAF", None),
}
"""Unit, value, and half-width of the 95 % interval of each compared quantity, in SQL; less is
better, except for the VAF. An error is at most as uncertain as what it is the error of."""
OF_PAIR = {
    "of": "CASE WHEN amplitude_deg IS NULL THEN 'trial' ELSE 'amplitude' END",
    "pairs": "CAST(1 AS BIGINT)",
    "compensated": "value",
    "uncompensated": "value_of_other",
    "difference": "value - value_of_other",
    "half_width": "sqrt(half * half + half_of_other * half_of_other)",
    "better": "CAST(CASE quantity WHEN 'VAF' THEN value_of_other - value"
    " ELSE value - value_of_other END < 0 AS BIGINT)",
}
"""Columns of a compensated trial beside an uncompensated one, in SQL."""
CONDITION = (*PLACE, "K_d", "B_d", "amplitude_deg")


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
    half_widths = (pl.col("lag_s_high") - pl.col("lag_s_low")) / 2
    is_apart = (pl.col("lag_s") - delay_s).abs() > MOST_APART * half_widths
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
    """`compensation.csv` from the rows of `impedance.csv`, of estimates that are not doubtful.

    A row over all pairs has the mean difference and the lowest and highest of them: conditions are
    chosen and no sample, so that no interval of their mean is known. A row of one pair has its own
    95 % interval, whose half-width is the root of the sum of both trials' squares. Repeats of a
    condition count as their mean, with the mean of their half-widths. Amplitudes are the commanded
    ones; where none is stated, the measured ones that are alike."""
    size = pl.coalesce(pl.col("commanded_deg", "amplitude_deg").cast(pl.Float64))
    counts = {
        f"{name}_counts": ~is_doubtful(impedance, pl.sql_expr(value).meta.root_names())
        for name, (_, value, _) in COMPARED.items()
    }
    known = impedance.with_columns(amplitude_deg=size, **counts)
    known = known.with_columns(alike_sizes(known["amplitude_deg"])).sort(CONDITION)
    known = known.filter(pl.col("K_d") != 0, pl.col("B_d").is_not_null())
    values = pl.concat(
        known.filter(f"{name}_counts").select(
            *CONDITION,
            "controller",
            quantity=pl.lit(name),
            unit=pl.lit(unit),
            value=pl.sql_expr(value),
            half=pl.sql_expr(half) if half else pl.lit(None, pl.Float64),
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
    rows = pairs.with_columns(**{name: pl.sql_expr(text) for name, text in OF_PAIR.items()})
    rows = rows.with_columns(
        difference_low=pl.col("difference") - pl.col("half_width"),
        difference_high=pl.col("difference") + pl.col("half_width"),
    )
    summaries = rows.group_by(*PLACE, "of", "quantity", "unit", maintain_order=True).agg(
        pl.col("pairs", "better").sum(),
        pl.col("compensated", "uncompensated", "difference").mean(),
        difference_low=pl.col("difference").min(),
        difference_high=pl.col("difference").max(),
    )
    summaries = summaries.with_columns(pl.col("of") + "s")
    names = described_tables_by_name()["compensation"].columns
    table = pl.concat([summaries, rows], how="diagonal_relaxed")
    return table.select(name for name in names if name in table.columns)
