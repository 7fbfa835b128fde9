"""Controllers beside each other, in each condition and over all of them."""

from collections.abc import Mapping

import polars as pl

from osl_analysis.bench.component_summary import PLACE
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import alike_sizes, counted

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
CONDITION = (*PLACE, "K_d", "B_d", "amplitude_deg")


def compensation_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """`compensation.csv` from the rows of `impedance.csv`, of the trials that a mean counts
    (`counted`).

    A row over all pairs has the mean difference and the lowest and highest of them: conditions are
    chosen and no sample, so that no interval of their mean is known. A row of one pair has its own
    95 % interval, whose half-width is the root of the sum of both trials' squares. Repeats of a
    condition count as their mean, with the mean of their half-widths. Amplitudes are the commanded
    ones; where none is stated, the measured ones that are alike."""
    size = pl.coalesce(pl.col("commanded_deg", "amplitude_deg").cast(pl.Float64))
    known = counted(impedance).with_columns(amplitude_deg=size)
    known = known.with_columns(alike_sizes(known["amplitude_deg"])).sort(CONDITION)
    known = known.filter(pl.col("K_d") != 0, pl.col("B_d").is_not_null())
    values = pl.concat(
        known.select(
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
    rows = pairs.select(
        *keys,
        of=pl.when(pl.col("amplitude_deg").is_null())
        .then(pl.lit("trial"))
        .otherwise(pl.lit("amplitude")),
        pairs=pl.lit(1, pl.Int64),
        compensated="value",
        uncompensated="value_of_other",
        difference=pl.col("value") - pl.col("value_of_other"),
        half=(pl.col("half") ** 2 + pl.col("half_of_other") ** 2).sqrt(),
    ).with_columns(
        better=(pl.when(quantity="VAF").then(-1).otherwise(1) * pl.col("difference") < 0).cast(
            pl.Int64
        ),
        difference_low=pl.col("difference") - pl.col("half"),
        difference_high=pl.col("difference") + pl.col("half"),
    )
    summaries = rows.group_by(*PLACE, "of", "quantity", "unit", maintain_order=True).agg(
        pl.col("pairs", "better").sum(),
        pl.col("compensated", "uncompensated", "difference").mean(),
        difference_low=pl.col("difference").min(),
        difference_high=pl.col("difference").max(),
    )
    summaries = summaries.with_columns(pl.col("of") + "s")
    names = described_tables_by_name()["compensation"].columns
    table = pl.concat([summaries, rows.drop("half")], how="diagonal_relaxed")
    return table.select(name for name in names if name in table.columns)
