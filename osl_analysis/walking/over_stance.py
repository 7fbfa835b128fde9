"""Impedance over stance: the results of groups against the phase of stance, beside the commanded impedance."""

import re

import numpy as np
import polars as pl

from osl_analysis.trial import Array
from osl_analysis.walking.conditions import ALL
from osl_analysis.walking.tables import ENSEMBLE

QUANTITIES = ("K", "B", "I")
COMMANDED = "commanded"
"""Series of the curve that the controller commands."""
FACTS = ("group", "onset_phase", "fitted_phase", "end_phase")
PLACE = ("joint", "side")


def impedance_over_stance(summary: pl.DataFrame, groups: pl.DataFrame) -> pl.DataFrame:
    """Rows of `impedance_over_stance.csv`: K, B and I of every group with a result, by quantity and phase of stance.

    `summary` is `walking_summary.csv`, `groups` is `walking_groups.csv`. `phase` is the one that the fit reads
    (`fitted_time`). A series has the groups that differ in their timing only. `commanded` is what the sheet states.
    """
    ensemble = summary.filter(
        (pl.col("estimator") == ENSEMBLE) & pl.col("quantity").is_in(QUANTITIES) & pl.col("mean").is_not_null()
    )
    rows = ensemble.join(groups.select(FACTS), on="group", how="left", maintain_order="left")
    series = pl.Series("series", [series_of(name) for name in rows["group"]], dtype=pl.String)
    order = pl.col("quantity").replace_strict({q: i for i, q in enumerate(QUANTITIES)}, return_dtype=pl.Int64)
    table = rows.with_columns(series).sort(order, "series", "fitted_phase", maintain_order=True)
    place = [name for name in PLACE if name in table.columns]
    return table.select(
        "group", *place, "series", "quantity", pl.col("fitted_phase").alias("phase"), "onset_phase", "end_phase", "n",
        pl.col("mean").alias("estimate"), "se", "low", "high", pl.col("commanded").cast(pl.Float64),
    )  # fmt: skip


def series_of(group: str) -> str:
    """Name of a group without its timing."""
    return re.sub(r"timing [-\d]+ %(, )?", "", group).removesuffix(", ") or ALL


def with_trajectory(table: pl.DataFrame, phase: Array, K_d: Array, B_d: Array) -> pl.DataFrame:
    """The table with what a trajectory commands, K_d and B_d (n,) at phases of stance (n,), where the sheet says
    nothing."""
    for quantity, values in (("K", K_d), ("B", B_d)):
        at = np.interp(table["phase"].to_numpy(), phase, values, left=np.nan, right=np.nan)
        here = (pl.col("quantity") == quantity) & pl.col(COMMANDED).is_null()
        table = table.with_columns(pl.when(here).then(pl.Series(at)).otherwise(COMMANDED).alias(COMMANDED))
    return table.with_columns(pl.col(COMMANDED).fill_nan(None))


def trajectory_points(phase: Array, K_d: Array, B_d: Array) -> pl.DataFrame:
    """The commanded trajectory as rows for the figure: series `commanded`, quantities K and B."""
    frames = [
        pl.DataFrame({"series": COMMANDED, "quantity": quantity, "phase": phase, COMMANDED: values})
        for quantity, values in (("K", K_d), ("B", B_d))
    ]
    return pl.concat(frames)
