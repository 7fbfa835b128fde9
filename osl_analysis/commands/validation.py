"""The validation study on the bench: many noisy trials, every estimator, and what their intervals are worth.

Nothing is written but tables: the simulator hands its logs over in memory.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.commands.validation_bench import EXPERIMENTS, Bench
from osl_analysis.commands.validation_walking import walking_rows
from osl_analysis.config import DynamometerAnalysis, ValidationStudy
from osl_analysis.fits.estimators import Record
from osl_analysis.fits.impedance import impedance_columns
from osl_analysis.fits.protocol import rows_of
from osl_analysis.fits.study import performance, regression_bound
from osl_analysis.parameters import read_parameters
from osl_analysis.signals import LowPass, Motion
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.table_file import read_table, write_table
from osl_analysis.validation import read_yaml
from osl_analysis.walking.settings import WalkingAnalysis

KEYS = ("experiment", "estimator", "interval_method", "quantity")
Row = dict[str, Any]


def run_batch(
    experiment: str,
    first: int,
    count: int,
    study: ValidationStudy,
    dynamometer: DynamometerAnalysis,
    walking: WalkingAnalysis,
    output: Path,
) -> None:
    """Estimates of trials (or campaigns of walking) number `first` to `first + count - 1` of one experiment."""
    settings = read_yaml(study.simulation, SimulationSettings).model_copy(update={"seed": study.seed})
    numbers = range(first, first + count)
    p = read_parameters(settings.parameters)
    if experiment == "walking":
        rows = [row for number in numbers for row in walking_rows(number, study, settings, p, walking)]
    else:
        bench = EXPERIMENTS[experiment](study, settings, p, dynamometer)
        names = [f"{experiment}_{number:05d}" for number in numbers]
        rows = bench_rows(bench, names, LowPass(dynamometer.cutoff_hz, dynamometer.order))
    write_table(pl.DataFrame([{"experiment": experiment, **row} for row in rows], infer_schema_length=None), output)


def bench_rows(bench: Bench, trials: Sequence[str], low_pass: LowPass) -> list[Row]:
    """Per trial, estimator and quantity: value, truth, interval, bound. A trial's name decides its noise.

    The truth is what the same estimator finds in the same trial through ideal sensors, or where there is one the
    parameter that made the torque: the study is of noise. `model_error` is what the truth differs from linear theory.
    """
    ideal = bench.record("ideal", ideal=True)
    truths = {(name, method): fit for name, method, fit in bench.fit(bench, ideal, low_pass)}
    bounds, rows = noise_bound(bench, ideal), []
    for trial in trials:
        record = bench.record(trial)
        for name, method, fit in bench.fit(bench, record, low_pass):
            for quantity in bench.names:
                truth = bench.exact.get(quantity, truths[name, method][quantity])
                row: Row = {"trial": trial, "estimator": name, "interval_method": method}
                row |= {"quantity": quantity, "value": fit[quantity], "se": fit.se(quantity), "truth": truth}
                low, high = fit.interval(quantity)
                error = truth - bench.theory[quantity] if quantity in bench.theory else None
                rows.append(row | {"low": low, "high": high, "bound": bounds[quantity], "model_error": error})
    return rows


def noise_bound(bench: Bench, ideal: Record) -> dict[str, float]:
    """Cramer-Rao bound of the load cell's noise, rounding counted as noise, for the true motion where it is fitted."""
    effects, motion = bench.settings.effects, bench.motion
    noise = float(np.hypot(effects.load_cell_noise.value, effects.load_cell_quantisation.value / np.sqrt(12)))
    if not bench.protocol:
        rows = np.arange(int(np.argmax(motion.theta > 0.05 * motion.theta.max())), int(np.argmax(motion.theta)) + 1)
        return regression_bound({"K_s": motion.theta[rows], "offset": np.ones(len(rows))}, noise)
    rows = rows_of(ideal.segments)
    columns = impedance_columns(Motion(motion.theta[rows], motion.omega[rows], motion.alpha[rows]))
    if "B_j" in bench.names:
        columns = {"B_j": columns["B"], "J_j": columns["I"], "offset": columns["offset"]}
    return regression_bound(columns, noise)


def summarise(batches: Sequence[Path], output: Path) -> None:
    """Bias, RMSE over the bound and coverage per experiment, estimator, kind of interval and quantity."""
    table = pl.concat([read_table(path) for path in batches], how="diagonal_relaxed")
    rows = []
    for key, group in table.group_by(KEYS, maintain_order=True):
        value, truth, low, high, se, bound = (
            group[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
            for name in ("value", "truth", "low", "high", "se", "bound")
        )
        found = performance(value - truth, se, (low <= truth) & (truth <= high), bound)
        model_error = group["model_error"].cast(pl.Float64).mean()
        rows.append({**dict(zip(KEYS, key, strict=True)), **asdict(found), "model_error": model_error})
    write_table(pl.DataFrame(rows, infer_schema_length=None).fill_nan(None), output)
