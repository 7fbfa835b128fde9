"""The validation study: many noisy trials and campaigns of walking, and what the estimates' intervals are worth.

Nothing is kept but tables. The simulator hands its logs over in memory, save where the study is of recorded files.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.config import ValidationStudy
from osl_analysis.parameters import DrivetrainParameters, read_parameters
from osl_analysis.signals import LowPass
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.study.actuator import actuator
from osl_analysis.study.bench import BENCHES, Experiment
from osl_analysis.study.performance import performance
from osl_analysis.study.phasors import frequency_response
from osl_analysis.study.repeats import repeated_belt, repeated_transmission
from osl_analysis.study.walking import walking_rows
from osl_analysis.table import read_table, write_table
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.yaml_settings import read_yaml

KEYS = ("experiment", "estimator", "interval_method", "quantity")
WALKING = ("walking", RECORDED := "walking recorded")
"""The studies of walking: from angle and torque on, and through markers, plate, C3D files and ingest."""
Row = dict[str, Any]
Builder = Callable[[ValidationStudy, SimulationSettings, DrivetrainParameters, DynamometerAnalysis], Experiment]
EXPERIMENTS: dict[str, Builder] = {
    **BENCHES,
    "repeated transmission": repeated_transmission,
    "repeated belt": repeated_belt,
    "frequency response": frequency_response,
}


def run_batch(
    experiment: str,
    first: int,
    count: int,
    study: ValidationStudy,
    dynamometer: DynamometerAnalysis,
    actuator_analysis: ActuatorAnalysis,
    walking: WalkingAnalysis,
    sources: Path,
    output: Path,
) -> None:
    """Estimates of trials (or campaigns of walking) number `first` to `first + count - 1` of one experiment."""
    settings = read_yaml(study.simulation, SimulationSettings).model_copy(update={"seed": study.seed})
    numbers = range(first, first + count)
    p = read_parameters(settings.parameters)
    if experiment in WALKING:
        rows = list(walking_rows(numbers, study, settings, p, walking, sources if experiment == RECORDED else None))
    else:
        names = [f"{experiment}_{number:05d}" for number in numbers]
        if experiment == "actuator":
            rows = bench_rows(actuator(settings, p, actuator_analysis), names, actuator_analysis.low_pass)
        else:
            bench = EXPERIMENTS[experiment](study, settings, p, dynamometer)
            rows = bench_rows(bench, names, dynamometer.low_pass)
    write_table(pl.DataFrame([{"experiment": experiment, **row} for row in rows], infer_schema_length=None), output)


def bench_rows(bench: Experiment, trials: Sequence[str], low_pass: LowPass) -> list[Row]:
    """Per trial, estimator and quantity: value, truth, interval, bound. A trial's name decides its noise.

    The truth is what the same estimator finds in the same trial through ideal sensors, or where there is one the
    parameter that made the torque: the study is of noise. `model_error` is what the truth differs from linear theory.
    """
    truths = {name: found for name, _, found in bench.estimates("ideal", low_pass, ideal=True)}
    bounds, rows = bench.bounds(), []
    for trial in trials:
        for name, method, found in bench.estimates(trial, low_pass):
            for quantity, estimate in found.items():
                truth = bench.exact.get(quantity, truths[name][quantity].value)
                row: Row = {"trial": trial, "estimator": name, "interval_method": method, "quantity": quantity}
                error = truth - bench.theory[quantity] if quantity in bench.theory else None
                row |= {**asdict(estimate), "truth": truth}
                rows.append(row | {"bound": bounds[quantity], "model_error": error})
    return rows


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
