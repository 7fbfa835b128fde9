"""Summaries of the components of the drivetrain over their trials."""

import polars as pl

from osl_analysis.bench.actuator_alone import ACTUATOR_PARAMETERS
from osl_analysis.bench.transmission import LOSSES
from osl_analysis.stats.repeats import summary_of_trials

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
