"""Transmission losses B_j and J_j, from trials to tables."""

from pathlib import Path

import polars as pl

from osl_analysis.bench.plausibility import check_sign
from osl_analysis.bench.transmission import fit_transmission, fit_transmission_with_coulomb, transmission_columns
from osl_analysis.commands.diagnosis import lowest_held_out, nonlinear_row, of_amplitude, trial_phasors
from osl_analysis.commands.stepped_sine import SteppedSineTrial, read_stepped_sine
from osl_analysis.commands.tables import summary_table
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.stats.rows import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.table import read_table, write_table


def fit_trial(trial: Path, settings: DynamometerAnalysis, output: Path) -> None:
    """Fit one trial: a row per amplitude and one over all amplitudes (amplitude empty)."""
    table = transmission_table(read_stepped_sine(trial, settings))
    check_sign(table["trial"][0], "B_j", table["B_j"][-1])
    write_table(table, output)


def transmission_table(record: SteppedSineTrial) -> pl.DataFrame:
    """Eq. 4 fitted to each amplitude [deg] and to all of them (amplitude null), without and with Coulomb friction.

    `coulomb_share` is the part of B_j that friction of constant size takes over when it may. A lag of the torque is not
    among the diagnostics: it would read as an inertia of -B_j times the lag, and nothing tells the two apart.
    `load_cell_drift` [N*m/min] is what was taken from the torque.
    """
    rows = []
    phasors = trial_phasors(record)
    for amplitude, motion, torque in record.parts():
        cycles = record.cycles(amplitude)
        fit = fit_transmission(motion, torque, cycles, record.every)
        other = fit_transmission_with_coulomb(motion, torque, cycles=cycles, every=record.every)
        estimates: Row = {**estimates_row(fit, "B_j", "J_j", "offset"), **covariance_row(fit, "B_j", "J_j")}
        estimates |= diagnostics_row(fit, record.rate_hz, record.low_pass)
        coulomb = {**estimates_row(other, "T_C"), "B_j_coulomb": other["B_j"], "VAF_coulomb": other.vaf}
        diagnosis = {
            **nonlinear_row(of_amplitude(phasors, amplitude)),
            "VAF_held_out": lowest_held_out(record, amplitude, fit, transmission_columns),
            "coulomb_share": 1 - other["B_j"] / fit["B_j"],
            "load_cell_drift": 60 * record.drift,
        }
        rows.append({"trial": record.name, "amplitude_deg": amplitude, **estimates, **coulomb, **diagnosis})
    return pl.DataFrame(rows, schema_overrides={"amplitude_deg": pl.Float64}, infer_schema_length=None)


def summarise(table: Path, output: Path) -> None:
    """Mean, scatter and interval over the trials' fits to all amplitudes."""
    whole = read_table(table).filter(pl.col("amplitude_deg").is_null())
    write_table(summary_table(whole, ("B_j", "J_j", "VAF", "T_C", "VAF_coulomb")), output)
