"""The numbers of the walking page: what was averaged and what was subtracted on the way to Fig. 9."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.unperturbed_file import read_normal_gait
from osl_analysis.commands.walking import ENSEMBLE
from osl_analysis.commands.walking_selection import used
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.perturbation import PHASES, NormalGait, normal_gait
from osl_analysis.walking.settings import WalkingAnalysis

EVERY = 4
"""A hundred points of stance are enough for a curve."""


def plot_numbers(
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    responses: Path,
    table: Path,
    settings: WalkingAnalysis,
    output: Path,
) -> None:
    """Write what the walking page plots: angle [deg] and torque [N*m] over stance [%], responses over time [ms].

    `crossings` are the perturbed ones, `selection` is `walking_crossings.csv`, `responses` `walking_responses.csv`,
    `table` `walking.csv`.
    """
    isolated = read_table(responses, ["trial", "time", "theta_deg", "torque", "torque_model"])
    reasons = read_table(table, ["trial", "doubtful"]).select("trial", "doubtful")
    isolated = isolated.join(reasons, on="trial", how="left", maintain_order="left")
    kept = set(isolated["trial"])
    walked = [c for c in used(crossings, selection) if c.name in kept]
    calm, moved = read_normal_gait(unperturbed), normal_gait(walked, 2)
    frames = [*gait_rows("unperturbed", calm), *gait_rows("perturbed", moved), window_rows(walked, settings.window_s)]
    write_table(pl.concat([*frames, response_rows(isolated)], how="diagonal"), output)


def gait_rows(curve: str, gait: NormalGait) -> list[pl.DataFrame]:
    """Mean and SD over crossings, of angle and torque."""
    signals = {"angle": np.rad2deg(gait.theta), "torque": gait.torque}
    return [gait_row(panel, curve, values[:, ::EVERY], len(gait.names)) for panel, values in signals.items()]


def gait_row(panel: str, curve: str, values: Array, n: int) -> pl.DataFrame:
    """Mean and SD of one signal at each phase."""
    columns = {"x": 100 * PHASES[::EVERY], "mean": values.mean(axis=0), "sd": values.std(axis=0, ddof=1)}
    return pl.DataFrame(columns).with_columns(panel=pl.lit(panel), curve=pl.lit(curve), n=pl.lit(n))


def window_rows(crossings: Sequence[Crossing], window: float) -> pl.DataFrame:
    """Where the fitted window lies in stance: mean phase [%] of its ends."""
    ends = [
        [100 * (c.onset + late - c.stance.heel_strike) / c.stance.duration for late in (0.0, window)]
        for c in crossings
        if c.onset is not None
    ]
    return pl.DataFrame({"panel": "angle", "curve": "window", "x": np.mean(ends, axis=0)})


def response_rows(isolated: pl.DataFrame) -> pl.DataFrame:
    """Isolated angle and torque of every perturbation and of their mean, and the mean's fit."""
    each = pl.when(pl.col("trial") == ENSEMBLE).then(pl.lit("mean")).otherwise(pl.lit("each")).alias("curve")
    x = (1e3 * pl.col("time")).alias("x")
    parts = [
        isolated.select("trial", "doubtful", x, each, pl.col(column).alias("mean"), pl.lit(panel).alias("panel"))
        for panel, column in (("response angle", "theta_deg"), ("response torque", "torque"))
    ]
    fit = isolated.filter((pl.col("trial") == ENSEMBLE) & pl.col("torque_model").is_not_null())
    labels = pl.lit("fit").alias("curve"), pl.lit("response torque").alias("panel")
    parts.append(fit.select("trial", x, labels[0], pl.col("torque_model").alias("mean"), labels[1]))
    return pl.concat(parts, how="diagonal")
