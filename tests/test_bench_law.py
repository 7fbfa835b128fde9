"""The law that ran is read from current and angle of the motor alone: by a law that is written here anew, sampled at
500 Hz and late, whatever the joint does."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import ROOT

from osl_analysis.bench.law import OTHER_LAW, law_table, law_that_ran
from osl_analysis.bench.record import record_of_trial, with_actuator
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.campaign.configuration import read_section
from osl_analysis.model.compensator import Gains
from osl_analysis.model.parameters import read_parameters
from osl_analysis.trial import Trial

SETTINGS = read_section(ROOT / "config/config.yaml", "dynamometer", DynamometerAnalysis)
P = read_parameters(ROOT / "config/parameters/default.yaml")
RATE, WIDTH = 1000.0, 0.05


def logged(gains):
    """Forty seconds of five sines; the motor's angle lags behind the joint's and bears a motion of its own. The law
    sees it each 2 ms, and its velocity by a low-pass of 2 ms."""
    time = np.arange(0, 40, 1 / RATE)
    rng = np.random.default_rng(7)
    frequencies, phases = np.array([0.4, 1.1, 1.9, 3.1, 4.7]), rng.uniform(0, 2 * np.pi, 5)

    def motion(at):
        return 0.03 * np.sin(2 * np.pi * np.outer(at, frequencies) + phases).sum(axis=1)

    theta, theta_m = motion(time), 2.4 * motion(time - 3e-3) + 0.02 * np.sin(2 * np.pi * 0.23 * time)
    omega, filtered = np.gradient(theta_m, time), np.zeros_like(time)
    for k in range(1, time.size):
        filtered[k] = filtered[k - 1] + (omega[k] - filtered[k - 1]) * (1 - np.exp(-1 / (RATE * 2e-3)))
    seen = np.arange(time.size) // 2 * 2
    u, sign = (-gains.K_1 * theta_m - gains.B_1 * filtered)[seen], np.tanh(filtered / WIDTH)[seen]
    current = u / (P.k_tau * P.n_m)
    if gains.cancels_friction:
        for _ in range(40):  # Eq. 5 has the current on both sides
            current = (u + sign * P.f_C + sign * P.f_G * np.abs(current)) / (P.k_tau * P.n_m)
    current = current + rng.normal(0, 0.02, time.size)
    torque = 300 * theta + 5 * np.gradient(theta, time) + rng.normal(0, 0.02, time.size)
    columns = {"time": time, "theta": theta, "theta_m": theta_m, "current": current, "torque": torque}
    return Trial("t", pl.DataFrame(columns), {})


def told(ran, programmed, keep=("theta", "theta_m", "current", "torque")):
    trial = logged(ran)
    trial = Trial("t", trial.samples.select("time", *keep), {})
    record = with_actuator(record_of_trial(trial, SETTINGS), trial)
    return law_table(record, trial, P, programmed, WIDTH)


@pytest.mark.parametrize("cancels", [False, True])
@pytest.mark.parametrize(("stiffer", "damped"), [(1.0, 1.0), (0.92, 0.92), (1.42, 1.0), (1.0, 2.0)])
def test_the_gains_that_ran_are_measured_and_are_others_where_other_ones_were_programmed(stiffer, damped, cancels):
    programmed = Gains(20.0, 0.3, cancels)
    ran = replace(programmed, K_1=stiffer * 20.0, B_1=damped * 0.3)
    table = told(ran, programmed)
    row = table.row(0, named=True)
    assert row["K_1"] == pytest.approx(ran.K_1, rel=4e-3)
    assert row["B_1"] == pytest.approx(ran.B_1 - 5e-4 * ran.K_1, abs=4e-3)  # a sample of the log is 0 or 1 ms late
    assert (row["f_C"], row["f_G"]) == pytest.approx((cancels * P.f_C, cancels * P.f_G), abs=0.02)
    another = (stiffer, damped) != (1.0, 1.0)
    assert any(row[name] > most for name, most in OTHER_LAW.items()) == another
    acts = law_that_ran(table, programmed)
    assert acts == (Gains(row["K_1"], row["B_1"], cancels) if another else programmed)


def test_a_feedforward_of_friction_that_did_not_run_is_told_and_the_rest_of_the_law_is_as_programmed():
    programmed = Gains(20.0, 0.3, True)
    table = told(replace(programmed, cancels_friction=False), programmed)
    assert table["feedforward_error"][0] == pytest.approx(1.0, abs=0.03)
    assert table["K_1_error"][0] < OTHER_LAW["K_1_error"]
    assert not law_that_ran(table, programmed).cancels_friction


@pytest.mark.parametrize("keep", [("theta", "theta_m", "torque"), ("theta", "current", "torque")])
def test_without_current_or_angle_of_the_motor_no_law_is_measured_and_the_programmed_one_counts(keep):
    programmed = Gains(20.0, 0.3, True)
    table = told(programmed, programmed, keep)
    assert (table.is_empty(), law_that_ran(table, programmed)) == (True, programmed)
