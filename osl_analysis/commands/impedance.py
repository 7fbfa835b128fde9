"""Dynamometer validation: Eq. 15 per trial and amplitude, its diagnostics, and the phasors of angle and torque."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from osl_analysis.commands.diagnosis import Admittance, SegmentPhasors, diagnosis_row, trial_phasors
from osl_analysis.commands.stepped_sine import SteppedSineTrial, read_stepped_sine
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.fits.diagnostics import doubts
from osl_analysis.fits.estimators import ESTIMATORS, Covariance, Record
from osl_analysis.fits.impedance import fit_impedance
from osl_analysis.fits.rows import covariance_row, diagnostics_row, estimates_row
from osl_analysis.fits.sign import check_sign
from osl_analysis.fits.sinusoid import Phasor, response
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.prediction import predicted_impedance
from osl_analysis.parameters import read_parameters
from osl_analysis.signals import LowPass
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
    estimators: Path,
) -> None:
    """Fit one trial: Eq. 15 per amplitude and over all (amplitude empty) to `output`, by every estimator to
    `estimators`; phasors to `phasors`."""
    p, record = read_parameters(parameters), read_stepped_sine(trial, settings)
    condition: dict[str, float | str] = {"controller": controller, "K_d": K_d, "B_d": B_d}
    gains = select_gains(controller, K_d, B_d, p, weight)
    predicted = predicted_impedance(gains, p, settings.frequencies_hz)
    prediction: dict[str, float | str] = dict(
        zip(("K_predicted", "B_predicted", "I_predicted"), predicted, strict=True)
    )
    found = trial_phasors(record)
    table = impedance_table(record, found, settings, joint_admittance(gains.K_1, gains.B_1, p, p.J_j))
    check_sign(record.name, "K", table["K"][-1])
    write_table(table.with_columns(**literals(condition), **literals(prediction)), output)
    write_table(phasor_table(record.name, found).with_columns(**literals(condition)), phasors)
    write_table(estimator_table(record, settings).with_columns(**literals(condition)), estimators)


def literals(values: Mapping[str, float | str]) -> dict[str, pl.Expr]:
    """Constant columns."""
    return {name: pl.lit(value) for name, value in values.items()}


def impedance_table(
    record: SteppedSineTrial,
    phasors: Sequence[SegmentPhasors],
    settings: DynamometerAnalysis,
    expected: Admittance | None = None,
) -> pl.DataFrame:
    """Eq. 15 fitted to each amplitude [deg] and to all of them (amplitude null), with what makes a fit doubtful.

    `expected` is the linear model's admittance, where the gains are known: it tells a lag of the torque.
    """
    rows = []
    for amplitude, motion, torque in record.parts():
        fit = fit_impedance(motion, torque, cycles=record.cycles(amplitude)).fit
        estimates = {
            **estimates_row(fit, "K", "B", "I", "offset"),
            **covariance_row(fit, "K", "B", "I"),
            **diagnostics_row(fit, record.rate_hz),
        }
        diagnosis = diagnosis_row(record, amplitude, fit, phasors, settings, expected)
        doubtful = doubts({**estimates, **diagnosis}, settings.doubtful.above, settings.doubtful.below)
        rows.append({"trial": record.name, "amplitude_deg": amplitude, **estimates, **diagnosis, "doubtful": doubtful})
    return pl.DataFrame(rows, schema_overrides={"amplitude_deg": pl.Float64}, infer_schema_length=None)


def estimator_table(record: SteppedSineTrial, settings: DynamometerAnalysis) -> pl.DataFrame:
    """Eq. 15 over all amplitudes by every estimator that the trial's signals allow."""
    low_pass, rows = LowPass(settings.cutoff_hz, settings.order), []
    raw = Record(record.time, record.theta, record.command, record.torque, record.rate_hz, record.segments(None))
    for name, estimator in ESTIMATORS.items():
        if name == "instrumental" and record.command is None:
            continue
        fit = estimator(raw, low_pass, Covariance())
        estimates = {**estimates_row(fit, "K", "B", "I"), **covariance_row(fit, "K", "B", "I")}
        rows.append({"trial": record.name, "estimator": name, **estimates, **diagnostics_row(fit, record.rate_hz)})
    return pl.DataFrame(rows)


def phasor_table(trial: str, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """Per amplitude and frequency: phasors of angle [rad] and torque [N*m], Y [rad/(N*m)], distortions."""
    where = [{"trial": trial, "amplitude_deg": s.amplitude_deg, "frequency_hz": s.frequency_hz} for s in phasors]
    return pl.DataFrame([{**place, **phasor_row(s.theta, s.torque)} for place, s in zip(where, phasors, strict=True)])


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
