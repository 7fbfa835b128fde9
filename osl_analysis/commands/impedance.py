"""Dynamometer validation: Eq. 15 per trial and amplitude, and the phasors of angle and torque."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.stepped_sine import SteppedSineTrial, read_stepped_sine
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.fits.impedance import fit_impedance
from osl_analysis.fits.rows import diagnostics_row, estimates_row
from osl_analysis.fits.sinusoid import Phasor, fit_sinusoid, response
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.prediction import predicted_impedance
from osl_analysis.parameters import read_parameters
from osl_analysis.table_file import write_table


def fit_trial(
    trial: Path,
    controller: str,
    K_d: float,
    B_d: float,
    parameters: Path,
    settings: DynamometerAnalysis,
    weight: Weight,
    output: Path,
    phasors: Path,
) -> None:
    """Fit one trial: Eq. 15 per amplitude and over all (amplitude empty) to `output`, phasors to `phasors`."""
    p, record = read_parameters(parameters), read_stepped_sine(trial, settings)
    condition: dict[str, float | str] = {"controller": controller, "K_d": K_d, "B_d": B_d}
    predicted = predicted_impedance(select_gains(controller, K_d, B_d, p, weight), p, settings.frequencies_hz)
    prediction: dict[str, float | str] = dict(
        zip(("K_predicted", "B_predicted", "I_predicted"), predicted, strict=True)
    )
    write_table(impedance_table(record).with_columns(**literals(condition), **literals(prediction)), output)
    write_table(phasor_table(record, settings.settle_cycles).with_columns(**literals(condition)), phasors)


def literals(values: Mapping[str, float | str]) -> dict[str, pl.Expr]:
    """Constant columns."""
    return {name: pl.lit(value) for name, value in values.items()}


def impedance_table(record: SteppedSineTrial) -> pl.DataFrame:
    """Eq. 15 fitted to each amplitude [deg] and to all of them (amplitude null)."""
    rows = []
    for amplitude, motion, torque in record.parts():
        fit = fit_impedance(motion, torque).fit
        estimates = {**estimates_row(fit, "K", "B", "I", "offset"), **diagnostics_row(fit, record.rate_hz)}
        rows.append({"trial": record.name, "amplitude_deg": amplitude, **estimates})
    return pl.DataFrame(rows, schema_overrides={"amplitude_deg": pl.Float64})


def phasor_table(record: SteppedSineTrial, settle_cycles: int) -> pl.DataFrame:
    """Per amplitude and frequency: phasors of angle [rad] and torque [N*m], Y [rad/(N*m)], distortions."""
    rows = []
    for block in record.blocks:
        for segment in block.segments:
            time, f = record.time[segment.rows], segment.frequency_hz
            theta = fit_sinusoid(time, record.theta[segment.rows], f, settle_cycles)
            torque = fit_sinusoid(time, record.torque[segment.rows], f, settle_cycles)
            where = {"trial": record.name, "amplitude_deg": float(np.rad2deg(block.amplitude)), "frequency_hz": f}
            rows.append({**where, **phasor_row(theta, torque)})
    return pl.DataFrame(rows)


def phasor_row(theta: Phasor, torque: Phasor) -> dict[str, float]:
    """Phasors and their ratio, with the covariance of the ratio."""
    Y = response(theta, torque)
    return {
        "theta_re": theta.value.real,
        "theta_im": theta.value.imag,
        "torque_re": torque.value.real,
        "torque_im": torque.value.imag,
        "theta_distortion": theta.distortion,
        "torque_distortion": torque.distortion,
        "Y_re": Y.value.real,
        "Y_im": Y.value.imag,
        "Y_var_re": float(Y.covariance[0, 0]),
        "Y_cov": float(Y.covariance[0, 1]),
        "Y_var_im": float(Y.covariance[1, 1]),
    }
