"""Dynamometer validation: Eq. 15 per trial and amplitude, its diagnostics, and the phasors of angle and torque."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from osl_analysis.bench.estimators import ESTIMATORS, Covariance, Record
from osl_analysis.bench.plausibility import check_sign
from osl_analysis.bench.protocol import rows_of
from osl_analysis.commands.diagnosis import (
    Admittance,
    SegmentPhasors,
    lag_row,
    lowest_held_out,
    nonlinear_row,
    of_amplitude,
    trial_phasors,
)
from osl_analysis.commands.stepped_sine import SteppedSineTrial, read_stepped_sine
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.doubtful import EXCLUDED
from osl_analysis.errors import OslAnalysisError
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.prediction import predicted_impedance
from osl_analysis.parameters import read_parameters
from osl_analysis.second_order import fit_impedance, impedance_columns
from osl_analysis.stats.rows import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.sinusoid import Phasor, complex_row, polar_row, response
from osl_analysis.table import write_table


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
    table = impedance_table(record, found, joint_admittance(gains.K_1, gains.B_1, p, p.J_j))
    check_sign(record.name, "K", table["K"][-1])
    write_table(table.with_columns(**literals(condition), **literals(prediction)), output)
    write_table(phasor_table(record.name, found).with_columns(**literals(condition)), phasors)
    write_table(estimator_table(record).with_columns(**literals(condition)), estimators)


def literals(values: Mapping[str, float | str]) -> dict[str, pl.Expr]:
    """Constant columns."""
    return {name: pl.lit(value) for name, value in values.items()}


def impedance_table(
    record: SteppedSineTrial,
    phasors: Sequence[SegmentPhasors],
    expected: Admittance | None = None,
) -> pl.DataFrame:
    """Eq. 15 fitted to each amplitude [deg] and to all of them (amplitude null), with what makes a fit doubtful.

    The row over all amplitudes has the range of the single amplitudes' estimates beside its interval, which is of
    noise: what friction makes of amplitude is in the range.

    `load_cell_drift` [N*m/min] is what was taken from the torque. `expected` is the linear model's admittance, where
    the gains are known: it tells a lag of the torque.
    """
    rows = []
    for amplitude, motion, torque in record.parts():
        fit = fit_impedance(motion, torque, record.cycles(amplitude), record.every).fit
        estimates = {
            **estimates_row(fit, "K", "B", "I", "offset"),
            **covariance_row(fit, "K", "B", "I"),
            **diagnostics_row(fit, record.rate_hz, record.low_pass),
        }
        chosen = of_amplitude(phasors, amplitude)
        diagnosis = {
            **lag_row(chosen, fit["K"], expected),
            **nonlinear_row(chosen),
            "VAF_held_out": lowest_held_out(record, amplitude, fit, impedance_columns),
        }
        diagnosis |= {"load_cell_drift": 60 * record.drift}
        rows.append({"trial": record.name, "amplitude_deg": amplitude, **estimates, **diagnosis})
    table = pl.DataFrame(rows, schema_overrides={"amplitude_deg": pl.Float64}, infer_schema_length=None)
    return table.with_columns(*(bound for name in ("K", "B", "I") for bound in amplitude_range(name)))


def amplitude_range(name: str) -> list[pl.Expr]:
    """`<name>_amplitudes_low` and `_high`: from where to where the fits to single amplitudes read an estimate.

    In the row over all amplitudes (amplitude null), where there are two or more of them; null in all other rows.
    """
    amplitude = pl.col("amplitude_deg")
    single = pl.col(name).filter(amplitude.is_not_null())
    spread = amplitude.is_null() & (amplitude.count() > 1)
    bounds = {"low": single.min(), "high": single.max()}
    return [pl.when(spread).then(value).alias(f"{name}_amplitudes_{end}") for end, value in bounds.items()]


def estimator_table(record: SteppedSineTrial) -> pl.DataFrame:
    """Eq. 15 over all amplitudes by every estimator that the trial's signals allow.

    One that refuses the trial, as a moving polynomial does where it has too few samples per period of the cut-off, has
    a row without numbers that says why.
    """
    segments = record.segments(None)
    rows: list[Row] = []
    raw = Record(record.time, record.theta, record.command, record.torque, record.rate_hz, segments)
    for name, estimator in ESTIMATORS.items():
        if name == "instrumental" and record.command is None:
            continue
        try:
            fit = estimator(raw, record.low_pass, Covariance())
        except OslAnalysisError as error:
            rows.append({"trial": record.name, "estimator": name, EXCLUDED: str(error)})
            continue
        estimates = {**estimates_row(fit, "K", "B", "I"), **covariance_row(fit, "K", "B", "I")}
        rate = record.rate_hz * fit.samples / len(rows_of(segments))  # an estimator may have thinned them
        diagnostics = diagnostics_row(fit, rate, record.low_pass)
        rows.append({"trial": record.name, "estimator": name, **estimates, **diagnostics, EXCLUDED: None})
    return pl.DataFrame(rows, schema_overrides={EXCLUDED: pl.String}, infer_schema_length=None)


def phasor_table(trial: str, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """Per amplitude and frequency: phasors of angle [rad] and torque [N*m], Y [rad/(N*m)], distortions."""
    where = [{"trial": trial, "amplitude_deg": s.amplitude_deg, "frequency_hz": s.frequency_hz} for s in phasors]
    return pl.DataFrame([{**place, **phasor_row(s.theta, s.torque)} for place, s in zip(where, phasors, strict=True)])


def phasor_row(theta: Phasor, torque: Phasor) -> Row:
    """Phasors and their ratio with covariances and degrees of freedom, the distortions, Y's magnitude and phase."""
    Y = response(theta, torque)
    return {
        **complex_row("theta", theta),
        **complex_row("torque", torque),
        "theta_distortion": theta.distortion,
        "torque_distortion": torque.distortion,
        **complex_row("Y", Y),
        **{f"Y_{name}": value for name, value in polar_row(Y).items()},
        "interval_method": torque.interval_method,
    }
