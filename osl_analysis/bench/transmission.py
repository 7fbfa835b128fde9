"""Transmission losses with the motor detached: torque = B_j omega + J_j alpha + offset (Eq. 4 with theta_s = 0)."""

from collections.abc import Mapping

import numpy as np
import polars as pl

from osl_analysis.bench.alternatives import time_base_row, time_base_words, timebase_table
from osl_analysis.bench.diagnostics import lowest_held_out_vaf
from osl_analysis.bench.phasors import at_amplitude, linear_impedance, nonlinearity, nonlinearity_row, phasors_beside
from osl_analysis.bench.series import Series
from osl_analysis.bench.stepped_sine import SteppedSineTrial, clock_drift_row, fits_by_amplitude, widened_fits
from osl_analysis.judge.doubts import summary_of_trials
from osl_analysis.signals import Motion
from osl_analysis.stats.covariance import NO_REPEATS, ResidualCorrelation
from osl_analysis.stats.fit_row import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

TRANSMISSION = ("B_j", "J_j")  # parameters of Eq. 4 with the motor detached.
COULOMB_WIDTH = 0.05
"""Velocity [rad/s] over which the sign of the velocity is smoothed where Coulomb friction is fitted for comparison."""
SUMMARISED = ("B_j", "J_j", "VAF", "T_C", "VAF_coulomb")
"""Columns of the transmission table of which `transmission_summary.csv` has a mean over trials."""


def fit_transmission(motion: Motion, torque: Array, residuals: ResidualCorrelation = NO_REPEATS) -> LinearFit:
    """Fit `B_j` [N*m*s/rad], `J_j` [kg*m^2] and `offset` [N*m] to a motion and resisting torque of shape (n,).

    `residuals` decides the covariance, as in `linear_fit`.

    Raises InputError, IdentifiabilityError: As `linear_fit`.
    """
    return linear_fit(torque, transmission_columns(motion), residuals)


def transmission_columns(motion: Motion) -> dict[str, Array]:
    """Columns of Eq. 4 with offset, of a motion (n,)."""
    return {"B_j": motion.omega, "J_j": motion.alpha, "offset": np.ones_like(motion.omega)}


def coulomb_columns(motion: Motion) -> dict[str, Array]:
    """The same with Coulomb friction `T_C` [N*m], times tanh(omega/`COULOMB_WIDTH`), for comparison."""
    return transmission_columns(motion) | {"T_C": np.tanh(motion.omega / COULOMB_WIDTH)}


def transmission_table(trial: SteppedSineTrial) -> pl.DataFrame:
    """The trial's rows of `transmission.csv`: one per amplitude [deg], and one for all of them (amplitude null).

    `coulomb_share` is the share of B_j that Coulomb friction replaces if it is fitted too. `load_cell_drift`
    [N*m/min] was subtracted from the torque. A lag of the torque is not among the diagnostics, because it cannot be
    told from an inertia of -B_j times the lag.
    """
    phasors = phasors_beside(trial, transmission_columns)
    rows: list[Row] = []
    clocks = clock_drift_row(trial)
    fits, with_friction = transmission_fits(trial), fits_by_amplitude(trial, coulomb_columns)
    others = {} if trial.other is None else transmission_fits(trial.other)
    for amplitude, fit in fits.items():
        other, friction = others.get(amplitude), with_friction[amplitude]
        chosen = at_amplitude(phasors, amplitude)
        rows.append(
            {
                "trial": trial.name,
                "amplitude_deg": amplitude,
                **estimates_row(fit, "B_j", "J_j", "offset"),
                **covariance_row(fit, "B_j", "J_j"),
                **diagnostics_row(fit, trial.rate_hz, trial.low_pass),
                **estimates_row(friction, "T_C"),
                "B_j_coulomb": friction["B_j"],
                "VAF_coulomb": friction.vaf,
                **nonlinearity_row(chosen, nonlinearity(chosen, linear_impedance(fit))),
                "VAF_held_out": lowest_held_out_vaf(trial, amplitude, fit, transmission_columns),
                "coulomb_share": 1 - friction["B_j"] / fit["B_j"],
                "load_cell_drift": 60 * trial.drift,
                **time_base_row(fit, other, TRANSMISSION),
                **clocks,
            }
        )
    return pl.DataFrame(rows, schema_overrides={"amplitude_deg": pl.Float64}, infer_schema_length=None)


def transmission_fits(trial: SteppedSineTrial) -> Mapping[float | None, LinearFit]:
    """Eq. 4 fitted to each amplitude [deg] and to all of them (None), the error of the bench's stiffness included."""
    return widened_fits(trial, transmission_columns)


def transmission_time_base(trial: SteppedSineTrial) -> pl.DataFrame:
    other = None if trial.other is None else transmission_fits(trial.other)[None]
    words = time_base_words(transmission_fits(trial)[None], other, TRANSMISSION)
    return timebase_table(trial.uniform, words, trial.bench)


def transmission_series(trial: SteppedSineTrial) -> Series:
    """Measured torque and that of Eq. 4 over the whole trial, fitted to the settled cycles."""
    return trial.beside(transmission_fits(trial)[None], transmission_columns)


def transmission_summary(table: pl.DataFrame) -> pl.DataFrame:
    return summary_of_trials(table.filter(pl.col("amplitude_deg").is_null()), SUMMARISED)
