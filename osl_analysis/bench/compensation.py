"""Compensated beside uncompensated: every difference is that of two trials that were asked for the same impedance."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.components import PLACE
from osl_analysis.bench.model_comparison import mean_with_bounds
from osl_analysis.model.compensator import CONTROLLERS

QUANTITIES: Mapping[str, tuple[str, pl.Expr]] = {
    "torque_error": ("N*m", pl.col("torque_error")),
    "K_error": ("%", 100 * (pl.col("K") / pl.col("K_d") - 1).abs()),
    "B_error": ("N*m*s/rad", (pl.col("B") - pl.col("B_d")).abs()),
    "VAF": ("%", pl.col("VAF")),
}
"""Unit and value of what is compared; of all but the VAF less is better."""
ASKED = (*PLACE, "K_d", "B_d")


def compensation_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """`compensation.csv` from the rows of `impedance.csv`. Repeats of a condition count as their mean. The interval of
    a difference is Student's over pairs of trials: amplitudes of one trial are no independent pairs."""
    known = impedance.drop_nulls(["K_d", "B_d"]).filter(pl.col("K_d") != 0)
    values = {name: value.mean() for name, (_, value) in QUANTITIES.items()}
    means = known.group_by(*ASKED, "commanded_deg", "controller").agg(**values)
    sides = [means.filter(pl.col("controller") == name).drop("controller") for name in CONTROLLERS]
    both = sides[0].join(sides[1], on=[*ASKED, "commanded_deg"], nulls_equal=True).sort(*ASKED, "commanded_deg")
    whole, single = (both.filter(pl.col("commanded_deg").is_null() == of_whole) for of_whole in (True, False))
    sets = [("trials", None, whole), ("amplitudes", None, single)]
    for by, rows in (("K_d", whole), ("B_d", whole), ("commanded_deg", single)):
        sets += [(by, at, rows.filter(pl.col(by) == at)) for at in rows[by].unique().sort()]
    found = []
    for by, at, rows in sets:
        for of_place in rows.partition_by(PLACE, maintain_order=True):
            place = of_place.select(PLACE).row(0, named=True)
            found += [{**place, **paired(of_place, name), "by": by, "at": at} for name in QUANTITIES]
    types: dict[str, Any] = dict.fromkeys((*PLACE, "quantity", "unit", "by"), pl.String) | {"at": pl.Float64}
    types |= {"pairs": pl.Int64, "better": pl.Int64} | dict.fromkeys(("compensated", "uncompensated"), pl.Float64)
    types |= dict.fromkeys(("difference", "difference_low", "difference_high"), pl.Float64)
    return pl.DataFrame(found, schema=types)


def paired(pairs: pl.DataFrame, name: str) -> dict[str, Any]:
    """One quantity in some pairs."""
    difference = pairs[name] - pairs[f"{name}_right"]
    by_trial = pairs.select("K_d", "B_d", difference=difference).group_by("K_d", "B_d").agg(pl.col("difference").mean())
    better = int((difference > 0 if name == "VAF" else difference < 0).sum())
    row = {"quantity": name, "unit": QUANTITIES[name][0], "pairs": len(pairs), "better": better}
    row |= {"compensated": pairs[name].mean(), "uncompensated": pairs[f"{name}_right"].mean()}
    return row | mean_with_bounds("difference", np.sort(by_trial["difference"].to_numpy()))
