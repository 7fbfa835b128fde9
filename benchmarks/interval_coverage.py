# SPDX-License-Identifier: Apache-2.0
"""How often the 95 % intervals of K, B and I hold: 19 motions with five disturbances each.

Run from the repository: `python benchmarks/interval_coverage.py [seeds] [rows.csv]`, 40 seeds by
default, on two processes. `interval_recordings.py` makes the recordings. A row per recording goes
into `build/coverage.csv`, and with the default seeds the table into `docs/bench_validation.md`.

An interval is that of the same motion, started alike, again, or, where nothing repeats, of noise
and misfit of the recording. Under noise, a lean and a coarse encoder Eq. 15 holds,
and the truth is the joint's K, B and I. A hardening spring and friction are no part of Eq. 15: the
truth is the same fit of the noise-free motion in the same rows. How far that lies from a plain
least squares is told, too.
"""

import sys
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from causes import PAGE, ROOT, markdown, write_between
from interval_recordings import DISTURBANCES, MOTIONS, Array, Recording, recorded
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

import osl_analysis as osl
from osl_analysis.bench.bench_settings import SteppedSineAnalysis
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.bench.record import Record
from osl_analysis.campaign.configuration import config_for_trials

SEEDS = 40
FIRST_SEED = 5000  # those from 100 to 3150 were seen while the intervals were made
PROCESSES = 2
FEWEST_HELD = 0.85  # of a cell: a motion, a disturbance and one of K, B, I
LACKING_FIT = ("hardening", "friction")  # of which Eq. 15 is no truth
NEAR = {"K": 0.01, "B": 0.03, "I": 0.1}  # of the plain least squares


@cache
def settings() -> SteppedSineAnalysis:
    """The shipped settings, without a protocol."""
    shipped = config_for_trials(ROOT / "config/config.yaml").dynamometer
    nothing = {"amplitudes_deg": None, "frequencies_hz": None, "cycles": None}
    return shipped.model_copy(update=nothing)


def record_of(made: Recording, theta: Array, torque: Array) -> Record:
    """The record of some signals of a recording."""
    signals = pl.DataFrame({"time": made.time, "theta": theta, "torque": torque})
    return record_of_trial(osl.Trial("joint", signals), settings(), made.windows)


def plain_least_squares(made: Recording, rows: NDArray[np.bool_]) -> Array:
    """K, B and I by a student's script: a filter, a spline's derivatives, and least squares."""
    rate_hz = 1 / (made.time[1] - made.time[0])
    low_pass = butter(4, settings().cutoff_hz, fs=rate_hz, output="sos")
    theta, torque = sosfiltfilt(low_pass, [made.true_theta, made.true_torque])
    spline = make_interp_spline(made.time, theta, k=5)
    motion = [spline(made.time, order)[rows] for order in range(3)]
    X = np.column_stack([*motion, np.ones(rows.sum()), made.time[rows]])
    return np.linalg.lstsq(X, torque[rows])[0][:3]


def row_of(job: tuple[str, str, int]) -> dict[str, Any]:
    """By how much K, B and I of a recording miss the truth, and the half-widths of their intervals;
    of lacks of fit also by how much the truth differs from a plain least squares. All are shares of
    the joint's own."""
    motion, disturbance, seed = job
    made = recorded(motion, disturbance, seed)
    row: dict[str, Any] = {"motion": motion, "disturbance": disturbance, "seed": seed}
    try:
        record = record_of(made, made.theta, made.torque)
        fit = rendered_impedance(record).whole
    except osl.OslAnalysisError as error:
        return {**row, "refused": str(error)}
    row |= {"groups": record.groups.kind, "interval_method": fit.interval_method}
    truth = made.joint
    if disturbance in LACKING_FIT:
        ideal = record_of(made, made.true_theta, made.true_torque)
        same_rows = replace(ideal, groups=record.groups, band_hz=record.band_hz)
        noise_free = rendered_impedance(same_rows).whole
        truth = np.array([noise_free[name] for name in NEAR])
        apart = np.abs(truth - plain_least_squares(made, record.is_fitted())) / made.joint
        row |= dict(zip((f"{name}_apart" for name in NEAR), apart.tolist(), strict=True))
    for name, of_joint, true in zip(NEAR, made.joint, truth, strict=True):
        row[f"{name}_miss"] = float((fit[name] - true) / of_joint)
        row[f"{name}_half"] = float(fit.half_width(name) / of_joint)
    return row


def held_in(rows: pl.DataFrame) -> dict[str, float]:
    """Share of the intervals of each estimate that hold the truth."""
    return {
        name: float((rows[f"{name}_miss"].abs() <= rows[f"{name}_half"]).mean())  # type: ignore[arg-type]
        for name in NEAR
    }


def percents(values: Any, form: str) -> str:
    """Shares as `1.2, 3.4, 5.6` [percent]."""
    return ", ".join(format(100 * value, form) for value in values)


def lines_of(rows: pl.DataFrame) -> Iterator[tuple[object, ...]]:
    """A line per disturbance, pooled over motions."""
    for disturbance in DISTURBANCES:
        mine = rows.filter(pl.col("disturbance") == disturbance)
        fitted = mine.filter(pl.col("K_miss").is_not_null())
        low = []
        for (motion,), cell in fitted.group_by("motion", maintain_order=True):
            seldom = {k: held for k, held in held_in(cell).items() if held < FEWEST_HELD}
            low += [f"{name} of {motion} {100 * held:.0f}" for name, held in seldom.items()]
        near = "–"
        if disturbance in LACKING_FIT:
            shares = [(fitted[f"{name}_apart"] <= most).mean() for name, most in NEAR.items()]
            near = percents(shares, ".0f")
        yield (
            disturbance,
            len(fitted),
            len(mine) - len(fitted),
            percents(held_in(fitted).values(), ".1f"),
            percents([fitted[f"{name}_half"].median() for name in NEAR], ".2g"),
            "; ".join(low) or "none",
            near,
        )


HEADER = (
    "disturbance", "n", "refused", "K, B, I held, %", "half-widths, %",
    f"cells below {100 * FEWEST_HELD:.0f} %", "noise-free K, B, I near a script's, %",
)  # fmt: skip


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    rows_file = Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "build/coverage.csv"
    warnings.simplefilter("ignore")  # of recordings whose remarks nobody reads here
    jobs = product(MOTIONS, DISTURBANCES, range(FIRST_SEED, FIRST_SEED + seeds))
    with ProcessPoolExecutor(PROCESSES) as pool:
        found = list(pool.map(row_of, jobs, chunksize=4))
    rows = pl.DataFrame(found, infer_schema_length=None)
    rows_file.parent.mkdir(parents=True, exist_ok=True)
    rows.write_csv(rows_file)
    table = markdown(HEADER, lines_of(rows))
    print(table)
    if seeds == SEEDS:
        write_between(PAGE, {"coverage": table})


if __name__ == "__main__":
    main()
