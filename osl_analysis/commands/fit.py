"""One trial fitted for the command line: the estimates, and the torque beside the fitted model's."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.transmission import fit_transmission
from osl_analysis.commands.actuator import actuator_table, read_actuator_trial
from osl_analysis.commands.belt import belt_table, read_belt_trial
from osl_analysis.commands.diagnosis import trial_phasors
from osl_analysis.commands.impedance import impedance_table
from osl_analysis.commands.stepped_sine import SteppedSineTrial, read_stepped_sine
from osl_analysis.commands.transmission import transmission_table
from osl_analysis.config import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.doubtful import DoubtfulFits, marked
from osl_analysis.second_order import fit_impedance
from osl_analysis.trial import Array

UNITS = {
    "K": "N·m/rad", "B": "N·m·s/rad", "I": "kg·m²", "K_s": "N·m/rad", "B_j": "N·m·s/rad", "J_j": "kg·m²",
    "T_C": "N·m", "k_tau_n_m": "N·m/A", "f_C": "N·m", "f_G": "N·m/A", "B_m": "N·m·s/rad", "J_m": "kg·m²",
    "offset": "N·m", "drift": "N·m/s",
}  # fmt: skip


@dataclass(frozen=True)
class FittedTrial:
    """Tidy estimates, a row per fit, and the series (time [s], torque, torque_model [N*m]) of the fit to all data."""

    estimates: pl.DataFrame
    series: pl.DataFrame


def fit_one(
    model: str, trial: Path, parameters: Path, settings: DynamometerAnalysis, limits: DoubtfulFits
) -> FittedTrial:
    """Fit an ingested trial with model `belt`, `transmission` or `impedance`.

    Raises
    ------
    InputError, IdentifiabilityError
        The trial lacks a signal, does not follow the protocol, or cannot identify the model.
    """
    if model == "belt":
        record = read_belt_trial(trial, parameters, settings)
        modelled = record.fit.loading["K_s"] * record.theta_s + record.fit.loading["offset"]
        return FittedTrial(marked(belt_table(record), limits.belt, model), series(record.time, record.torque, modelled))
    stepped = read_stepped_sine(trial, settings)
    if model == "transmission":
        table = marked(transmission_table(stepped), limits.transmission, model)
        return FittedTrial(table, transmission_series(stepped))
    table = impedance_table(stepped, trial_phasors(stepped))
    return FittedTrial(marked(table, limits.impedance, model), impedance_series(stepped))


def fit_one_actuator(trial: Path, settings: ActuatorAnalysis, limits: DoubtfulFits) -> FittedTrial:
    """Fit an ingested trial of the actuator's bench; raises as `fit_one`."""
    record = read_actuator_trial(trial, settings)
    table = marked(actuator_table(record), limits.actuator, "actuator")
    return FittedTrial(table, series(record.time, record.torque, record.modelled))


def transmission_series(record: SteppedSineTrial) -> pl.DataFrame:
    """Measured torque and that of Eq. 4 over the whole record, fitted to the protocol's blocks."""
    *_, (_, motion, torque) = record.parts()
    fit, whole = fit_transmission(motion, torque), record.motion
    modelled = fit["B_j"] * whole.omega + fit["J_j"] * whole.alpha + fit["offset"]
    return series(record.time, record.filtered_torque, modelled)


def impedance_series(record: SteppedSineTrial) -> pl.DataFrame:
    """Measured torque and that of Eq. 15 over the whole record, fitted to the protocol's blocks."""
    *_, (_, motion, torque) = record.parts()
    return series(record.time, record.filtered_torque, fit_impedance(motion, torque).torque(record.motion))


def series(time: Array, torque: Array, torque_model: Array) -> pl.DataFrame:
    """Time [s] from the start, measured and modelled torque [N*m]."""
    return pl.DataFrame({"time": time - time[0], "torque": torque, "torque_model": torque_model})


def estimates_text(estimates: pl.DataFrame) -> str:
    """The estimates as a table for the eye: a line per fit and quantity, with 95 % interval and VAF."""
    lines = []
    for row in estimates.to_dicts():
        amplitude = row.get("amplitude_deg")
        which = "all amplitudes" if amplitude is None else f"{amplitude:g} deg"
        quality = f"VAF {row['VAF']:.2f} %, R2 {row['R2']:.5f}, condition {row['condition_number']:.1f}"
        lines.append(f"{row['trial']}, {which}: {quality}")
        for name in (n for n in UNITS if f"{n}_se" in row):
            half = row[f"{name}_high"] - row[name]
            lines.append(f"  {name:<7}{row[name]:>12.5g} ± {half:<10.2g} {UNITS[name]}{amplitudes_text(row, name)}")
        if row.get("doubtful"):
            lines.append(f"  doubtful: {row['doubtful']}")
    return "\n".join(
        [*lines, "± is the half-width of the 95 % interval of noise, by the method that interval_method names"]
    )


def amplitudes_text(row: Mapping[str, Any], name: str) -> str:
    """From where to where the single amplitudes read an estimate, where a row has that."""
    low, high = row.get(f"{name}_amplitudes_low"), row.get(f"{name}_amplitudes_high")
    return "" if low is None or high is None else f", single amplitudes {low:.5g} to {high:.5g}"
