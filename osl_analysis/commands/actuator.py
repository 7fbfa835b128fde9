"""Actuator identification (left half of Table I), from trials to tables."""

from pathlib import Path

import polars as pl

from osl_analysis.commands.repeats import summary_table
from osl_analysis.config import ActuatorAnalysis
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.fits.actuator import PARAMETERS, correlation, fit_actuator
from osl_analysis.fits.rows import diagnostics_row, estimates_row
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.table_file import read_table, write_table
from osl_analysis.trial_file import read_trial


def fit_trial(trial: Path, settings: ActuatorAnalysis, output: Path) -> None:
    """Fit one ingested trial: one row of estimates."""
    write_table(actuator_table(trial, settings), output)


def actuator_table(trial: Path, settings: ActuatorAnalysis) -> pl.DataFrame:
    """One row of `actuator.csv`; an error names the trial."""
    record = read_trial(trial)
    time, theta_m, current, torque_m = record.signals("theta_m", "current", "torque_m")
    low_pass = LowPass(settings.cutoff_hz, settings.order)
    try:
        fit = fit_actuator(time, theta_m, current, torque_m, low_pass, settings.sign_width, settings.slowest)
    except (InputError, IdentifiabilityError) as error:
        raise type(error)(f"trial {record.name}: {error}") from error
    row = {**estimates_row(fit, *PARAMETERS, "offset", "drift"), **diagnostics_row(fit, sampling_rate(time))}
    return pl.DataFrame([{"trial": record.name, **row, "correlation_k_f_G": correlation(fit, "k_tau_n_m", "f_G")}])


def summarise(table: Path, output: Path) -> None:
    """Mean, scatter and interval over the trials."""
    write_table(summary_table(read_table(table), (*PARAMETERS, "VAF")), output)
