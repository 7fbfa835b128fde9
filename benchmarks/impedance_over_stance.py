"""Impedance over stance: how often the intervals of a simulated campaign cover what the leg
rendered, and the figure.

Run from the repository: `python benchmarks/impedance_over_stance.py [campaigns]`. The leg follows
the trajectory of `config/impedance/synthetic_walking.csv`; the platform turns at four timings.
Crossings pass through the simulated sensors' noise and the walking analysis of
`config/config.yaml`, not through files. Prints the coverage at each timing, and writes the figure
of `docs/walking.md`. About ten seconds a campaign. The same seeds give the same.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from study import StudyLaboratory, gait_laboratory

from osl_analysis.commands.figure import draw_table
from osl_analysis.commands.walking import commanded_over_stance
from osl_analysis.walking.ensemble import group_headline
from osl_analysis.walking.group_table import fitted_time
from osl_analysis.walking.result_tables import trajectory_points, with_trajectory
from osl_analysis.walking.unperturbed_gait import unperturbed_gait

FIGURE = Path("docs/impedance_over_stance.png")
TRAJECTORY, STANCE_SHARE = Path("config/impedance/synthetic_walking.csv"), 0.62
TIMINGS = (0.18, 0.33, 0.51, 0.69)
"""Phases of stance at which the ramp is commanded."""
CROSSINGS = 10
"""Perturbed crossings at each timing, and unperturbed crossings, in a campaign."""
RESAMPLES = 500
QUANTITIES = ("K", "B", "I")


def laboratory() -> StudyLaboratory:
    """The shipped gait laboratory."""
    shipped = gait_laboratory()
    return replace(
        shipped, analysis=shipped.analysis.model_copy(update={"bootstrap_samples": RESAMPLES})
    )


def at_timing(shipped: StudyLaboratory, phase: float) -> StudyLaboratory:
    """The laboratory whose platform turns at another phase of stance, with the shipped scatter."""
    first, last = shipped.gait.perturbation.stance_phase
    half = (last - first) / 2
    ramp = shipped.gait.perturbation.model_copy(
        update={"stance_phase": (phase - half, phase + half)}
    )
    return replace(shipped, gait=shipped.gait.model_copy(update={"perturbation": ramp}))


def campaign(number: int, shipped: StudyLaboratory) -> list[dict[str, object]]:
    """Rows as in `impedance_over_stance.csv` with the truth: the same estimator's for the
    perturbations alone."""
    names = [f"over_{number:04d}_{k}" for k in range(CROSSINGS)]
    gait = unperturbed_gait([shipped.unperturbed(f"{name}_u") for name in names], 3)
    rows, stance = [], float(np.mean(gait.stance))
    for timing in TIMINGS:
        walked = [at_timing(shipped, timing).perturbed(f"{name}_{timing:g}") for name in names]
        result = group_headline([crossing for crossing, *_ in walked], gait, shipped.analysis)
        onset = float(
            np.mean(
                [(crossing.onset - crossing.stance.heel_strike) / stance for crossing, *_ in walked]
            )
        )
        phase = onset + fitted_time(result) / stance
        places = {
            "phase": phase,
            "onset_phase": onset,
            "end_phase": onset + shipped.analysis.window_s / stance,
        }
        for quantity in QUANTITIES:
            low, high = result.resampled.interval(quantity)
            row = {
                "series": "all",
                "quantity": quantity,
                "timing": timing,
                **places,
                "low": low,
                "high": high,
            }
            truth = float(np.mean([exact[quantity] for _, exact, _ in walked]))
            rows.append(
                row | {"estimate": result.ensemble.fit[quantity], "truth": truth, "commanded": None}
            )
    return rows


def main(campaigns: int, first: int = 0) -> None:
    """Print the coverage and the error at each timing; draw the first campaign."""
    shipped = laboratory()
    rows = [
        row | {"campaign": k}
        for k in range(first, first + campaigns)
        for row in campaign(k, shipped)
    ]
    table = pl.DataFrame(rows, schema_overrides={"commanded": pl.Float64})
    covered = (pl.col("low") <= pl.col("truth")) & (pl.col("truth") <= pl.col("high"))
    error = pl.col("estimate") - pl.col("truth")
    order = pl.col("quantity").replace_strict(
        {q: i for i, q in enumerate(QUANTITIES)}, return_dtype=pl.Int64
    )
    by_timing = table.group_by("quantity", "timing").agg(
        covered.sum().alias("covered"), pl.len().alias("of"), pl.col("phase").mean(),
        pl.col("truth").mean(),
        error.mean().alias("bias"), (error.std() / pl.len().sqrt()).alias("bias_se"),
        ((pl.col("high") - pl.col("low")) / 2).mean().alias("half_width"),
    )  # fmt: skip
    with pl.Config(tbl_rows=-1, tbl_cols=-1, tbl_width_chars=200):
        print(by_timing.sort(order, "timing"))
        print(
            table.group_by("quantity").agg(covered.mean().alias("coverage"), pl.len()).sort(order)
        )
    if first == 0:
        (curve,) = commanded_over_stance([TRAJECTORY], "simulated", STANCE_SHARE)
        shown = with_trajectory(
            table.filter(pl.col("campaign") == 0).drop("truth", "timing", "campaign"), *curve
        )
        draw_table(
            "impedance_over_stance",
            pl.concat([shown, trajectory_points(*curve)], how="diagonal"),
            [FIGURE],
        )


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:] or ["100"]))
