"""The law that ran is read from current and angle of the motor alone: by a law that is written here
anew, sampled at 500 Hz and late, whatever the joint does."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from scipy.signal import lfilter

from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.controller_law import (
    CHUNKS,
    LAW_COLUMNS,
    OTHER_LAW,
    by_chunks,
    certain_errors,
    law_table,
    law_that_ran,
)
from osl_analysis.bench.record import with_actuator
from osl_analysis.bench.recorded_motion import record_of_trial
from osl_analysis.campaign.configuration import read_section
from osl_analysis.model.compensator import Gains, motor_current
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Trial

SETTINGS = read_section(ROOT / "config/config.yaml", "dynamometer", DynamometerAnalysis)
P = read_parameters(ROOT / "config/parameters/default.yaml")
RATE, WIDTH = 1000.0, 0.05


def logged(gains, late=0.0, reads=1.0, feedforward=P):
    """Forty seconds of five sines; the motor's angle lags behind the joint's and bears a motion of
    its own. The law sees it each 2 ms, and its velocity by a low-pass of 2 ms, and both `late`. The
    log `reads` another current."""
    time = np.arange(0, 40, 1 / RATE)
    rng = np.random.default_rng(7)
    frequencies, phases = np.array([0.4, 1.1, 1.9, 3.1, 4.7]), rng.uniform(0, 2 * np.pi, 5)

    def motion(at):
        return 0.03 * np.sin(2 * np.pi * np.outer(at, frequencies) + phases).sum(axis=1)

    theta, theta_m = (
        motion(time),
        2.4 * motion(time - 3e-3) + 0.02 * np.sin(2 * np.pi * 0.23 * time),
    )
    omega, kept = np.gradient(theta_m, time), np.exp(-1 / (RATE * 2e-3))
    filtered = lfilter([1 - kept], [1, -kept], omega)
    seen = np.maximum(np.arange(time.size) // 2 * 2 - round(late * RATE), 0)
    u, sign = (-gains.K_1 * theta_m - gains.B_1 * filtered)[seen], np.tanh(filtered / WIDTH)[seen]
    current = motor_current(u, sign * gains.cancels_friction, feedforward)
    rubs = (
        np.sign(omega) * (P.f_C + P.f_G * np.abs(current))
        + P.B_m * omega
        + P.J_m * np.gradient(omega, time)
    )
    torque = P.B_j * np.gradient(theta, time) - P.n_T * (P.k_tau * P.n_m * current - rubs)
    torque, current = (x + rng.normal(0, 0.02, time.size) for x in (torque, reads * current))
    columns = {
        "time": time,
        "theta": theta,
        "theta_m": theta_m,
        "current": current,
        "torque": torque,
    }
    return Trial("t", pl.DataFrame(columns), {})


def told(ran, programmed, keep=("theta", "theta_m", "current", "torque"), **planted):
    trial = logged(ran, **planted)
    trial = Trial("t", trial.samples.select("time", *keep), {})
    record = with_actuator(record_of_trial(trial, SETTINGS), trial)
    return law_table(record, P, programmed, WIDTH)


def beyond(row):
    """What of a row is beyond its limit."""
    limits = OTHER_LAW | {"loop_late_s": 3e-3, "current_error": 0.02}
    return {name for name, most in limits.items() if abs(row[name]) > most}


@pytest.mark.parametrize(
    ("stiffer", "damped", "cancels"), [(1.0, 1.0, True), (0.92, 0.92, True), (1.0, 2.0, False)]
)
def test_the_gains_that_ran_are_measured_and_told_from_the_programmed_ones(
    stiffer, damped, cancels
):
    programmed = Gains(20.0, 0.3, cancels)
    ran = replace(programmed, K_1=stiffer * 20.0, B_1=damped * 0.3)
    table = told(ran, programmed)
    row = table.row(0, named=True)
    true = {
        "K_1": ran.K_1,
        "B_1": ran.B_1 - 5e-4 * ran.K_1,
        "f_C": cancels * P.f_C,
        "f_G": cancels * P.f_G,
    }
    true["k_tau_n_m"] = P.k_tau * P.n_m  # a sample of the log is 0 or 1 ms late
    for name, value in true.items():
        assert row[f"{name}_low"] < value < row[f"{name}_high"], name
    assert row["K_1_high"] - row["K_1_low"] < 0.006 * ran.K_1
    another = (stiffer, damped) != (1.0, 1.0)
    assert bool(beyond(row)) == another
    gains = Gains(row["K_1"], row["B_1"], cancels) if another else programmed
    assert law_that_ran(table, programmed, P) == (gains, P)


@pytest.mark.parametrize(("f_C", "f_G"), [(0.0, 0.0), (0.5, 1.0)])
def test_a_feedforward_of_friction_that_is_not_the_programmed_one_is_told(f_C, f_G):
    programmed = Gains(20.0, 0.3, True)
    table = told(programmed, programmed, feedforward=replace(P, f_C=f_C * P.f_C, f_G=f_G * P.f_G))
    assert beyond(table.row(0, named=True)) == {"feedforward_error"}
    gains, p = law_that_ran(table, programmed, P)
    assert gains == replace(programmed, cancels_friction=f_C > 0)
    assert (p.f_C, p.f_G) == pytest.approx((f_C * P.f_C, f_G * P.f_G), abs=0.01)


@pytest.mark.parametrize(("planted", "column", "size"), [
    ({"late": 6e-3}, "loop_late_s", 6e-3), ({"reads": 1.1}, "current_error", 0.1),
])  # fmt: skip
def test_a_late_loop_and_a_wrong_current_leave_the_programmed_law(planted, column, size):
    programmed = Gains(20.0, 0.3, True)
    table = told(programmed, programmed, **planted)
    assert beyond(table.row(0, named=True)) == {column}
    assert table[column][0] == pytest.approx(size, rel=0.2)
    assert law_that_ran(table, programmed, P) == (programmed, P)


@pytest.mark.parametrize("keep", [("theta", "theta_m", "torque"), ("theta", "current", "torque")])
def test_without_current_or_angle_of_the_motor_the_programmed_law_counts(
    keep,
):
    programmed = Gains(20.0, 0.3, True)
    table = told(programmed, programmed, keep)
    assert (table.is_empty(), law_that_ran(table, programmed, P)) == (True, (programmed, P))


def fit_of_law(covariance=None, **estimates):
    """A fit with these estimates, exact unless their covariance is given."""
    p = len(estimates)
    return LinearFit(
        names=tuple(estimates),
        estimates=np.array([*estimates.values()]),
        covariance=np.zeros((p, p)) if covariance is None else covariance,
        vaf=100.0,
        r_squared=1.0,
        condition_number=1.0,
        correlation_samples=1,
        samples=100,
        interval_method="chunks",
        degrees_of_freedom=np.full(p, 23.0),
        residual=np.zeros(100),
        largest_correlation=0.0,
    )


PROGRAM = {"K_1": 20.0, "B_1": 0.3, "f_C": P.f_C, "f_G": P.f_G}


def test_a_loop_is_late_by_what_the_series_of_its_delay_takes_off_and_adds():
    late_s = 8e-3  # -K_1 theta(t - d) - B_1 omega(t - d), to second order in d
    law = fit_of_law(
        K_1=20.0,
        B_1=0.3 - 20.0 * late_s,
        lag=0.3 * late_s - 20.0 * late_s**2 / 2,
        f_C=P.f_C,
        f_G=P.f_G,
    )

    errors = certain_errors(law, 1.0, PROGRAM, P, current=5.0)

    assert errors["loop_late_s"] == pytest.approx(late_s)
    assert errors["B_1_gap_s"] == 0


def test_an_error_of_the_cancelled_friction_is_certain_beyond_two_errors_of_the_sum():
    covariance = np.zeros((5, 5))
    covariance[3:, 3:] = [[4e-4, 1e-4], [1e-4, 2e-4]]
    law = fit_of_law(covariance, K_1=20.0, B_1=0.3, lag=0.0, f_C=0.0, f_G=0.0)
    current = 2.0
    friction = P.f_C + P.f_G * current
    se = np.sqrt(np.array([1, current]) @ covariance[3:, 3:] @ np.array([1, current]))

    errors = certain_errors(law, 1.0, PROGRAM, P, current)

    assert errors["feedforward_error"] == pytest.approx((friction - 2 * se) / friction)


def test_another_friction_is_taken_off_a_current_that_reads_too_much():
    law = {"trial": "t", "f_C": 0.22, "f_G": 0.05, "k_tau_n_m": 1.0, "feedforward_error": 0.5,
           "current_error": 0.1, "f_C_programmed": 0.4, "f_G_programmed": 0.05}  # fmt: skip

    _, p = law_that_ran(pl.DataFrame([law], LAW_COLUMNS), Gains(20.0, 0.3, True), P)

    assert p.f_C == pytest.approx(0.2)
    assert p.f_G == 0.05  # of the load, which reads too much as well


def test_the_covariance_by_chunks_of_a_mean_is_that_of_their_means():
    of_chunks = np.random.default_rng(0).normal(size=CHUNKS)
    residual = np.repeat(of_chunks - of_chunks.mean(), 10)
    X = np.ones((residual.size, 1))

    covariance, freedom, _, _ = by_chunks(X, np.linalg.inv(X.T @ X), residual)

    assert covariance[0, 0] == pytest.approx(np.var(of_chunks, ddof=1) / CHUNKS)
    assert freedom == CHUNKS - 1
