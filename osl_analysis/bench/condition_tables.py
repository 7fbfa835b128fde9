"""Controllers beside each other, in each condition and over all of them."""

from collections.abc import Mapping

import polars as pl

from osl_analysis.bench.component_summary import PLACE
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import alike_sizes, counted

HALF_WIDTHS = {
    symbol: (pl.col(f"{symbol}_high") - pl.col(f"{symbol}_low")) / 2
    for symbol in ("K", "B", "B_viscous")
}
NO_INTERVAL = pl.lit(None, pl.Float64)
COMPARED: Mapping[str, tuple[str, pl.Expr, pl.Expr]] = {
    "torque_error": ("N*m", pl.col("torque_error"), NO_INTERVAL),
    "K_error": (
        "%",
        100 * (pl.col("K") / pl.col("K_d") - 1).abs(),
        100 * HALF_WIDTHS["K"] / pl.col("K_d"),
    ),
    "B_error": ("N*m*s/rad", (pl.col("B") - pl.col("B_d")).abs(), HALF_WIDTHS["B"]),
    "B_viscous_error": (
        "N*m*s/rad",
        (pl.col("B_viscous") - pl.col("B_d")).abs(),
        HALF_WIDTHS["B_viscous"],
    ),
    "VAF": ("%", pl.col("VAF"), NO_INTERVAL),
}
"""Unit, value, and half-width of the 95 % interval of each compared quantity; less is better,
except for the VAF. An error is at most as uncertain as what it is the error of."""
CONDITION = (*PLACE, "K_d", "B_d", "amplitude_deg")
ALL_OF = {"trial": "trials", "amplitude": "amplitudes"}
"""What a row over all pairs is of, by what a row of one pair is of."""
COMPENSATION_TYPES: Mapping[str, type[pl.DataType]] = {
    **dict.fromkeys((*PLACE, "quantity", "unit", "of"), pl.String),
    **dict.fromkeys(("K_d", "B_d", "amplitude_deg"), pl.Float64),
    **dict.fromkeys(("pairs", "better"), pl.Int64),
    **dict.fromkeys(("compensated", "uncompensated"), pl.Float64),
    **dict.fromkeys(("difference", "difference_low", "difference_high"), pl.Float64),
}
"""Columns of `compensation.csv`."""


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
    known = known.with_columns(alike_sizes(known["amplitude_deg"]))
    known = known.drop_nulls(["K_d", "B_d"]).filter(pl.col("K_d") != 0)
    tables = []
    for name, (unit, value, half_width) in COMPARED.items():
        sides = []
        for controller in CONTROLLERS:
            fits = known.filter(controller=controller).select(
                *CONDITION, value=value, half=half_width
            )
            repeats = fits.drop_nulls("value").group_by(CONDITION)
            sides.append(repeats.agg(pl.col("value", "half").mean()))
        pairs = sides[0].join(sides[1], on=CONDITION, nulls_equal=True).sort(CONDITION)
        difference = pl.col("difference")
        is_better = difference > 0 if name == "VAF" else difference < 0
        texts = [pl.lit(name).alias("quantity"), pl.lit(unit).alias("unit")]
        tables.append(differences(pairs).with_columns(*texts, better=is_better.cast(pl.Int64)))
    rows = pl.concat(tables)
    summaries = rows.group_by(*PLACE, "of", "quantity", "unit", maintain_order=True).agg(
        pl.col("pairs", "better").sum(),
        pl.col("compensated", "uncompensated", "difference").mean(),
        difference_low=pl.col("difference").min(),
        difference_high=pl.col("difference").max(),
    )
    summaries = summaries.with_columns(pl.col("of").replace(ALL_OF))
    table = pl.concat([summaries, rows], how="diagonal")
    return table.select(pl.col(name).cast(kind) for name, kind in COMPENSATION_TYPES.items())


def differences(pairs: pl.DataFrame) -> pl.DataFrame:
    """A row per pair, of its compensated less its uncompensated value."""
    of = pl.when(pl.col("amplitude_deg").is_null()).then(pl.lit("trial"))
    half = (pl.col("half") ** 2 + pl.col("half_right") ** 2).sqrt()
    difference = pl.col("value") - pl.col("value_right")
    return pairs.select(
        *CONDITION,
        of=of.otherwise(pl.lit("amplitude")),
        pairs=pl.lit(1),
        compensated="value",
        uncompensated="value_right",
        difference=difference,
        difference_low=difference - half,
        difference_high=difference + half,
    )
