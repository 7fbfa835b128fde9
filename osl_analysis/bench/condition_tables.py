"""Controllers beside each other, over trials of one condition."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.component_summary import PLACE
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import alike_sizes, counted, over_repeats
from osl_analysis.table import with_viscous_damping

COMPARED: Mapping[str, tuple[str, pl.Expr]] = {
    "torque_error": ("N*m", pl.col("torque_error")),
    "K_error": ("%", 100 * (pl.col("K") / pl.col("K_d") - 1).abs()),
    "B_error": ("N*m*s/rad", (pl.col("B") - pl.col("B_d")).abs()),
    "VAF": ("%", pl.col("VAF")),
}
"""Unit and value of each compared quantity; less is better, except for the VAF."""
ASKED = (*PLACE, "K_d", "B_d")
COMPENSATION_TYPES: Mapping[str, type[pl.DataType]] = {
    **dict.fromkeys((*PLACE, "quantity", "unit", "by"), pl.String),
    "at": pl.Float64,
    "pairs": pl.Int64,
    "better": pl.Int64,
    **dict.fromkeys(("compensated", "uncompensated"), pl.Float64),
    **dict.fromkeys(("difference", "difference_low", "difference_high"), pl.Float64),
}
"""Columns of `compensation.csv`."""


def compensation_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """`compensation.csv` from the rows of `impedance.csv`, of the trials that a mean counts
    (`counted`).

    Repeats of a condition count as their mean. The interval of a difference is Student's over pairs
    of trials: amplitudes of one trial are no independent pairs. Amplitudes are the commanded ones;
    where none is stated, the measured ones that are alike."""
    size = "commanded_deg" if impedance["commanded_deg"].is_not_null().any() else "amplitude_deg"
    used = counted(impedance)
    sizes = alike_sizes(used[size].cast(pl.Float64))
    known = with_viscous_damping(used).with_columns(sizes)
    known = known.drop_nulls(["K_d", "B_d"]).filter(pl.col("K_d") != 0)
    values = {name: value.mean() for name, (_, value) in COMPARED.items()}
    means = known.group_by(*ASKED, size, "controller").agg(**values)
    sides = [means.filter(pl.col("controller") == name).drop("controller") for name in CONTROLLERS]
    both = sides[0].join(sides[1], on=[*ASKED, size], nulls_equal=True).sort(*ASKED, size)
    whole, single = (both.filter(pl.col(size).is_null() == of_whole) for of_whole in (True, False))
    sets = [("trials", None, whole), ("amplitudes", None, single)]
    for by, rows in (("K_d", whole), ("B_d", whole), (size, single)):
        sets += [(by, at, rows.filter(pl.col(by) == at)) for at in rows[by].unique().sort()]
    found = []
    for by, at, rows in sets:
        for of_place in rows.partition_by(PLACE, maintain_order=True):
            place = of_place.select(PLACE).row(0, named=True)
            found += [{**place, **paired(of_place, name), "by": by, "at": at} for name in COMPARED]
    return pl.DataFrame(found, schema=dict(COMPENSATION_TYPES))


def paired(pairs: pl.DataFrame, name: str) -> dict[str, Any]:
    """The comparison of one quantity over pairs."""
    difference = pairs[name] - pairs[f"{name}_right"]
    is_better = difference > 0 if name == "VAF" else difference < 0
    by_trial = (
        pairs.select("K_d", "B_d", difference=difference)
        .group_by("K_d", "B_d")
        .agg(pl.col("difference").mean())
    )
    values = np.sort(by_trial["difference"].to_numpy())
    row: dict[str, Any] = {
        "quantity": name,
        "unit": COMPARED[name][0],
        "pairs": len(pairs),
        "better": int(is_better.sum()),
        "compensated": pairs[name].mean(),
        "uncompensated": pairs[f"{name}_right"].mean(),
        "difference": values.mean() if len(values) else None,
        "difference_low": None,
        "difference_high": None,
    }
    if len(values) > 1:
        over_trials = over_repeats(values)
        if over_trials is not None:
            row["difference_low"] = over_trials.low
            row["difference_high"] = over_trials.high
    return row
