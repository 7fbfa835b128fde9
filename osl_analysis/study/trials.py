"""Bench trials of the study: inputs, estimates of one trial, and a table row for each estimate."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.config import StudySettings
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array
from osl_analysis.walking.settings import WalkingAnalysis

StudyRow = dict[str, Any]
"""One row of the study's table of estimates."""


@dataclass(frozen=True)
class StudyInputs:
    """Settings with which the study simulates and analyses its trials.

    Attributes
    ----------
    study
        The study's own choices: protocol, impedance, numbers of trials.
    simulation
        The simulated campaign.
    gait
        The simulated gait laboratory. None where the simulation has none.
    p
        The parameters that make the trials.
    dynamometer, actuator, walking
        Settings of the analyses.
    sources
        Folder of the source files.
    """

    study: StudySettings
    simulation: SimulationSettings
    gait: WalkingSettings | None
    p: DrivetrainParameters
    dynamometer: DynamometerAnalysis
    actuator: ActuatorAnalysis
    walking: WalkingAnalysis
    sources: Path


@dataclass(frozen=True)
class Estimate:
    """An estimate with its standard error and 95 % interval, all in the unit of the quantity.

    Attributes
    ----------
    value
        The estimate.
    se
        Its standard error.
    low, high
        Ends of its 95 % interval.
    """

    value: float
    se: float
    low: float
    high: float


DEFAULT = "filtered"
"""Name of the bench's estimator in the tables: one filter for all signals, then derivatives, then least squares."""
Estimates = Iterator[tuple[str, str, Mapping[str, Estimate]]]
"""The estimates of one trial: estimator, kind of interval, and an estimate for each quantity."""


class StudiedExperiment(Protocol):
    """An experiment that the study repeats. The name of a trial decides its noise."""

    @property
    def exact(self) -> Mapping[str, float]:
        """The parameters that made the trial, by quantity, where the joint has such parameters. Else empty."""
        ...

    @property
    def theory(self) -> Mapping[str, float]:
        """Prediction of linear theory, by quantity; empty without a prediction."""
        ...

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates of one trial. The sensors of an `ideal` trial have no errors."""
        ...

    def bounds(self) -> Mapping[str, float]:
        """The smallest standard deviation of any unbiased estimate, by quantity."""
        ...


def estimates_of(fit: LinearFit, names: tuple[str, ...]) -> dict[str, Estimate]:
    """The named estimates of a fit."""
    return {name: Estimate(fit[name], fit.se(name), *fit.interval(name)) for name in names}


def torque_noise(settings: SimulationSettings, time: Array) -> tuple[float, Array]:
    """Standard deviations [N*m] of the load cell's white noise, with its rounding, and of its drift at `time` [s]."""
    effects = settings.effects
    white = float(np.hypot(effects.load_cell_noise.value, effects.load_cell_quantisation.value / np.sqrt(12)))
    return white, effects.load_cell_drift.value / 60 * time


def trial_rows(experiment: StudiedExperiment, trials: Sequence[str], low_pass: LowPass) -> list[StudyRow]:
    """Value, truth, interval and bound for every trial, estimator and quantity.

    The truth is the parameter that made the torque, where the joint has such a parameter. `model_truth` is the estimate
    of the same estimator in the same trial with ideal sensors. Without such a parameter it is also the truth.
    `model_error` is `model_truth` minus the prediction of linear theory.
    """
    ideal = {name: estimates for name, _, estimates in experiment.estimates("ideal", low_pass, ideal=True)}
    bounds, rows = experiment.bounds(), []
    for trial in trials:
        for name, method, estimates in experiment.estimates(trial, low_pass):
            for quantity, estimate in estimates.items():
                model_truth = ideal[name][quantity].value
                truth = experiment.exact.get(quantity, model_truth)
                row: StudyRow = {"trial": trial, "estimator": name, "interval_method": method, "quantity": quantity}
                error = model_truth - experiment.theory[quantity] if quantity in experiment.theory else None
                row |= {**asdict(estimate), "truth": truth, "model_truth": model_truth}
                rows.append(row | {"bound": bounds[quantity], "model_error": error})
    return rows
