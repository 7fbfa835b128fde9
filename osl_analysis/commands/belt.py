"""Belt stiffness, from trials to tables and the numbers of Fig. 3."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.bench.belt import BeltFit, fit_belt_stiffness
from osl_analysis.bench.plausibility import check_sign
from osl_analysis.commands.tables import summary_table
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.errors import InputError
from osl_analysis.model.drivetrain import belt_deflection
from osl_analysis.parameters import read_parameters
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.stats.rows import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Array
from osl_analysis.trial_file import read_trial

CURVE_STEP_HZ = 50.0
"""Points per second kept of each torque-deflection curve: enough for a line in print."""


@dataclass(frozen=True)
class BeltTrial:
    """Filtered belt deflection theta_s [rad] and resisting torque [N*m] of one trial, shape (n,), and their fit."""

    name: str
    time: Array
    rate_hz: float
    low_pass: LowPass
    theta_s: Array
    torque: Array
    fit: BeltFit


def fit_trial(trial: Path, parameters: Path, settings: DynamometerAnalysis, output: Path, curve: Path) -> None:
    """Fit one belt trial: one row of estimates to `output`, the torque-deflection curve to `curve`."""
    record = read_belt_trial(trial, parameters, settings)
    check_sign(record.name, "K_s", record.fit.K_s)
    write_table(belt_table(record), output)
    step = max(round(record.rate_hz / CURVE_STEP_HZ), 1)
    write_table(curve_table(record.name, record.theta_s[::step], record.torque[::step]), curve)


def read_belt_trial(trial: Path, parameters: Path, settings: DynamometerAnalysis) -> BeltTrial:
    """Read, filter and fit one ingested trial; an error names the trial."""
    p, record = read_parameters(parameters), read_trial(trial)
    time, theta, theta_m, torque = record.signals("theta", "theta_m", "torque")
    low_pass = settings.low_pass
    try:
        rate = sampling_rate(time)
        theta_s, torque = low_pass(belt_deflection(theta, theta_m, p), rate), low_pass(torque, rate)
        every, drift = low_pass.independent_samples(rate), settings.load_cell_drift / 60 / rate
        fit = fit_belt_stiffness(theta_s, torque, every, drift)
        return BeltTrial(record.name, time, rate, low_pass, theta_s, torque, fit)
    except InputError as error:
        raise InputError(f"trial {record.name}: {error}") from error


def belt_table(record: BeltTrial) -> pl.DataFrame:
    """One row of `belt.csv`."""
    return pl.DataFrame([{"trial": record.name, **belt_row(record)}])


def belt_row(record: BeltTrial) -> Row:
    """Loading slope, unloading slope, loop area [J], quadratic belt; then what a straight line leaves out.

    `energy_lost` is the loop's area over the energy K_s theta_s^2/2 at the peak, `stiffening` the share by which the
    quadratic belt's slope grows from rest to the peak.
    """
    fit, peak = record.fit, float(np.max(np.abs(record.theta_s - record.theta_s[0])))
    return {
        **estimates_row(fit.loading, "K_s", "offset"),
        **covariance_row(fit.loading, "K_s", "offset"),
        **diagnostics_row(fit.loading, record.rate_hz, record.low_pass),
        "unloading": fit.unloading["K_s"],
        "unloading_se": fit.unloading.se("K_s"),
        "hysteresis_area": fit.hysteresis_area,
        "quadratic_K_s": fit.quadratic["K_s"],
        "quadratic_K_s2": fit.quadratic["K_s2"],
        "quadratic_K_s2_se": fit.quadratic.se("K_s2"),
        "quadratic_VAF": fit.quadratic.vaf,
        "energy_lost": fit.hysteresis_area / (fit.K_s * peak**2 / 2),
        "stiffening": 2 * fit.quadratic["K_s2"] * peak / fit.quadratic["K_s"],
    }


def curve_table(name: str, theta_s: Array, torque: Array) -> pl.DataFrame:
    """Deflection [deg] and torque [N*m] from the rest position on, by branch."""
    deflection = np.rad2deg(theta_s - theta_s[0])
    branch = np.where(np.arange(len(theta_s)) <= np.argmax(np.abs(deflection)), "loading", "unloading")
    frame = {"trial": [name] * len(branch), "branch": branch, "theta_s_deg": deflection, "torque": torque - torque[0]}
    return pl.DataFrame(frame)


def summarise(table: Path, output: Path) -> None:
    """Mean, scatter and interval over the belt trials."""
    write_table(summary_table(read_table(table), ("K_s", "unloading", "hysteresis_area", "quadratic_K_s2")), output)


def plot_numbers(curves: Sequence[Path], table: Path, summary: Path, output: Path) -> None:
    """The numbers of Fig. 3: every trial's curve and why its fit is doubtful, the mean slope as two points."""
    reasons = read_table(table, ["trial", "doubtful"]).select("trial", "doubtful")
    data = pl.concat([read_table(path) for path in curves]).join(reasons, on="trial", how="left", maintain_order="left")
    K_s, low, high = read_table(summary).filter(pl.col("quantity") == "K_s").select("mean", "low", "high").row(0)
    peak = float(np.abs(data["theta_s_deg"].to_numpy()).max())
    line = pl.DataFrame(
        {
            "trial": ["mean slope"] * 2,
            "branch": ["loading"] * 2,
            "theta_s_deg": [0.0, peak],
            "torque": [0.0, K_s * float(np.deg2rad(peak))],
            "K_s": [K_s] * 2,
            "K_s_low": [low] * 2,
            "K_s_high": [high] * 2,
        }
    )
    write_table(pl.concat([data, line], how="diagonal"), output)
