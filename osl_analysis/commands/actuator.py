"""Actuator identification (left half of Table I), from trials to tables."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.bench.actuator import PARAMETERS, actuator_columns, correlation, fit_actuator
from osl_analysis.commands.tables import summary_table
from osl_analysis.config import ActuatorAnalysis
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.rows import covariance_row, diagnostics_row, estimates_row
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Array
from osl_analysis.trial_file import read_trial


@dataclass(frozen=True)
class ActuatorTrial:
    """Time [s], filtered torque and that of the fitted model [N*m] of one trial, shape (n,), and the fit.

    `motion` is the column that it was derived from: theta_m, or omega_m of a bench that logs no angle.
    """

    name: str
    motion: str
    time: Array
    torque: Array
    modelled: Array
    fit: LinearFit
    low_pass: LowPass


def fit_trial(trial: Path, settings: ActuatorAnalysis, output: Path) -> None:
    """Fit one ingested trial: one row of estimates."""
    write_table(actuator_table(read_actuator_trial(trial, settings)), output)


def read_actuator_trial(trial: Path, settings: ActuatorAnalysis) -> ActuatorTrial:
    """Read, filter and fit one ingested trial; an error names the trial."""
    record = read_trial(trial)
    motion = next((name for name in ("theta_m", "omega_m") if name in record.samples.columns), "theta_m")
    time, moved, current, torque_m = record.signals(motion, "current", "torque_m")
    low_pass = settings.low_pass
    try:
        columns, torque = actuator_columns(
            time, moved, current, torque_m, low_pass, settings.sign_width, is_velocity=motion == "omega_m"
        )
        fit = fit_actuator(columns, torque, sampling_rate(time), low_pass, settings.slowest)
    except (InputError, IdentifiabilityError) as error:
        raise type(error)(f"trial {record.name}: {error}") from error
    modelled = np.sum([fit[name] * column for name, column in columns.items()], axis=0)
    return ActuatorTrial(record.name, motion, time, torque, modelled, fit, low_pass)


def actuator_table(record: ActuatorTrial) -> pl.DataFrame:
    """One row of `actuator.csv`."""
    estimates = estimates_row(record.fit, *PARAMETERS, "offset", "drift") | covariance_row(record.fit, *PARAMETERS)
    diagnostics = diagnostics_row(record.fit, sampling_rate(record.time), record.low_pass)
    row = {"trial": record.name, "motion": record.motion, **estimates, **diagnostics}
    return pl.DataFrame([{**row, "correlation_k_f_G": correlation(record.fit, "k_tau_n_m", "f_G")}])


def summarise(table: Path, output: Path) -> None:
    """Mean, scatter and interval over the trials."""
    write_table(summary_table(read_table(table), (*PARAMETERS, "VAF")), output)
