# SPDX-License-Identifier: Apache-2.0
"""What makes a bench fit doubtful, by its right name: a late torque, friction, a spring that
stiffens, backlash."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from any_motion import multisine
from bench_synthetic import FIVE, second_order, stepped_sine
from conftest import findings_on, half_width, least_squares_alone, marked_by
from scipy.interpolate import CubicSpline
from shipped import CONFIG
from shipped import LEG as P

from osl_analysis.base.trial import Trial
from osl_analysis.bench.budgets import Evidence, certain_lag
from osl_analysis.bench.evidence import impedance_table
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.lags import Belt, belt_of_leg, is_leg
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.bench.summaries import delay_table
from osl_analysis.commands.fit import run_fit
from osl_analysis.inference.spectra import slipping_springs
from osl_analysis.judge import judging
from osl_analysis.judge.rules import Grade
from osl_analysis.model.drivetrain import PARAMETER_UNITS
from osl_analysis.report.numbers import headline_numbers, headline_sentences
from osl_analysis.stats.linear_fit import LinearFit

LATENESS = "delay of the torque"

LIMITS = CONFIG.doubtful.of("impedance")
SETTINGS = CONFIG.dynamometer


def rubbing(motion):
    return second_order(motion) + 0.8 * np.sign(motion.omega)


def test_coulomb_friction_is_named_and_has_its_size():
    tables = impedance_table(rendered_impedance(stepped_sine(rubbing, 0.03, FIVE)))
    found = judging.judged(tables["impedance"], LIMITS, "impedance", budget=tables["budget"])
    table = marked_by(found, tables["impedance"], "impedance")

    *single, whole = table.to_dicts()
    assert {row["B_viscous"] for row in single} == {None}  # one amplitude hardly tells it
    assert whole["f_C"] == pytest.approx(0.8, rel=0.01)
    assert whole["doubtful"] is None
    assert "friction" in whole["remarks"].split("; ")  # above 5 % of B


LAWS = [(0.3, -6e-4, 4e-3), (0.45, 6e-3, 4e-3), (0.6, 4e-3, 2e-3)]  # the first is undamped
N_T_ALONE = replace(P, K_s=np.nan, B_j=np.nan, J_j=np.nan)


def leg(
    torque_late=0.0,
    theta_m_late=0.0,
    theta_late=0.0,
    B_j=P.B_j,
    J_j=P.J_j,
    law=LAWS[1],
    bristles=(),
    hysteresis=0.5,
    resolution=2 * np.pi / 2**14,
):
    """A drivetrain's trial from Eqs. 3-4 and a belt with hysteresis; the actuator moves as no
    second-order joint, by a law of angle, velocity and friction."""
    rng = np.random.default_rng(8)
    time, (theta, omega, alpha) = multisine(rng)
    wound = np.dot(law, [theta, omega, np.tanh(omega / 0.05)])
    torque = (
        J_j * alpha
        + B_j * omega
        + P.K_s * wound
        + hysteresis * slipping_springs(wound, [1e-3])[0]
        + slipping_springs(theta, bristles).sum(axis=0)  # 1 N*m of friction of the joint each
        + 0.03 * rng.standard_normal(len(time))
    )
    late = {"theta": theta_late, "theta_m": theta_m_late, "torque": torque_late}
    signals = {"theta": theta, "theta_m": P.n_T * (theta - wound), "torque": torque}
    columns = {name: CubicSpline(time, signals[name])(time - late[name]) for name in signals}
    for name in ("theta", "theta_m"):
        columns[name] = np.round(columns[name] / resolution) * resolution
    return Trial("leg", pl.DataFrame({"time": time, **columns}))


def record_of_leg(trial):
    return record_of_trial(trial, SETTINGS, extra_columns=["theta_m"])


def test_another_b_j_than_that_of_the_file_makes_no_lag_certain():
    """It looks like an angle that is late by the difference over K_s: 0.36 ms."""
    lag = belt_of_leg(record_of_leg(leg(B_j=1.6 * P.B_j)), P).lag

    assert not lag.certain("lag_s")
    (of_theta_m,) = lag.budget("lag_s").from_source("theta_m_delay")
    assert of_theta_m.standard == pytest.approx(0.6 * P.B_j / P.K_s / np.sqrt(3), rel=0.1)


@least_squares_alone
@pytest.mark.parametrize(
    ("fault", "lag"),
    [
        ({}, 0),
        ({"torque_late": -4e-3}, -4e-3),
        ({"theta_m_late": 1e-3}, 0),
        ({"theta_late": 4e-3}, -4e-3),
    ],
)
def test_the_belt_shows_the_lag_of_a_leg_s_torque_whatever_theta_m_s_is(fault, lag):
    """Eq. 15 misses so much of a leg that it passes for a delay of 10 ms; a belt stays a spring."""
    tables = impedance_table(rendered_impedance(record_of_leg(leg(**fault))), P)

    found = findings_on(tables, LIMITS)

    assert tables["impedance"]["lag_s"][0] == pytest.approx(lag, abs=1.5e-4)
    grades = [finding.grade for finding in found if finding.cause == LATENESS]
    assert grades == [Grade.DOUBTS] * bool(lag)


@least_squares_alone
@pytest.mark.parametrize(
    ("law", "is_unknown"),
    [
        ((0.45, 1e-3, 2e-3), True),
        ((0.45, 3e-3, 0.0), False),  # to 7, and to 4 % of B
    ],
)
def test_a_lag_that_the_belt_tells_badly_is_said_to_be_unknown(law, is_unknown):
    tables = impedance_table(rendered_impedance(record_of_leg(leg(law=law))), P)

    late = tables["budget"].filter(part="fault", source="late_torque")
    assert late["standard"].is_null().any() == is_unknown


@pytest.mark.parametrize("bristle", [1e-5, 1e-3, 3e-3])
def test_friction_of_the_joint_beyond_the_belt_makes_no_lag(bristle):
    """Without its shapes in the model it passes for a late torque."""
    lag = belt_of_leg(record_of_leg(leg(bristles=[bristle])), P).lag

    assert not lag.certain("lag_s")
    assert abs(lag["lag_s"]) < lag.half_width("lag_s") < 4e-4


def bench_of_legs(file, known, **of_leg):
    """Rows of a bench on which three legs with J_j of 0.0165 are recorded, and its delay."""
    of_file = {
        name: {"value": value, "unit": PARAMETER_UNITS[name], "source": "ours"}
        for name, value in known.items()
    }
    file.write_text(json.dumps({"name": "a", "description": "a leg", "parameters": of_file}))
    trials = [leg(law=law, J_j=0.0165, hysteresis=0.05, resolution=2e-5, **of_leg) for law in LAWS]
    tables = [run_fit("impedance", trial, file, CONFIG).estimates["impedance"] for trial in trials]
    table = pl.concat(tables, how="diagonal")
    return table, delay_table(table).row(0, named=True)


@pytest.mark.parametrize(
    "known",
    [
        {"n_T": P.n_T},
        *(
            {"n_T": P.n_T, "K_s": P.K_s, "B_j": P.B_j, "J_j": share * 0.0165}
            for share in (0.9, 1.1)
        ),
    ],
)
def test_the_delay_of_a_bench_needs_no_exact_parameter(tmp_path, known):
    """Taken as exact, a J_j that is a tenth off would move it by 0.45 ms."""
    table, delay = bench_of_legs(tmp_path / "leg.yaml", known, torque_late=2.5e-3)

    assert delay["delay_s"] == pytest.approx(2.5e-3, abs=1.5e-4)
    assert delay["delay_s_low"] < 2.5e-3 < delay["delay_s_high"]
    assert delay["to_state"].startswith("torque: {delay: 2.")
    unknown = 0 if "K_s" in known else 3
    assert table.select("K_over_K_s", "K_s_ratio").null_count().row(0) == (unknown, unknown)


def test_an_early_theta_m_is_no_late_torque_where_b_j_is_not_known(tmp_path):
    """Torque and theta_m are early by 2 ms, which looks like a joint that loses more."""
    table, delay = bench_of_legs(tmp_path / "leg.yaml", {"n_T": P.n_T}, theta_late=2e-3)

    assert (table["lag_s_low"] < -2e-3).all()
    assert delay["to_state"] is None


def test_a_lag_of_a_leg_is_what_it_takes_off_damping_and_inertia():
    """exp(-s/100) (300 + 5 s + 0.2 s^2) = 300 + 2 s + 0.165 s^2 to second order."""
    numbers = (np.array([0.01]), np.array([[2.5e-9]]), 100.0, "blocks", np.array([9.0]))
    lag = LinearFit(("lag_s",), *numbers)

    analysis = SimpleNamespace(whole={"K": 300.0, "B": 2.0})
    found = Evidence(analysis, Belt(lag=lag), None, None, {}, False, is_leg=True)

    assert not certain_lag(found, "K")
    assert certain_lag(found, "B")[0].standard == pytest.approx(3)
    assert certain_lag(found, "I")[0].standard == pytest.approx(0.035)


def test_without_the_angle_of_its_shaft_known_gains_make_a_leg():
    trial = leg()
    samples = trial.samples.rename({"theta_m": "current"})

    record = record_of_leg(replace(trial, samples=samples))

    assert not is_leg(record, None, is_of_gains=False)
    assert is_leg(record, None, is_of_gains=True)


@pytest.mark.parametrize(("share", "is_one"), [(0.07, True), (0.03, False)])
def test_a_joint_whose_motor_turns_a_twentieth_as_far_is_a_leg(share, is_one):
    record = record_of_leg(leg())

    turning = replace(record, actuator={"theta_m": share * record.motion.theta})

    assert is_leg(turning, None, is_of_gains=False) == is_one


def test_a_belt_of_an_actuator_s_angle_with_the_wrong_sign_tells_no_lag():
    trial = leg()
    turned = replace(trial, samples=trial.samples.with_columns(theta_m=-pl.col("theta_m")))
    record = record_of_leg(turned)

    belt = belt_of_leg(record, P)

    assert belt.lag is belt_of_leg(record, N_T_ALONE).lag is None
    assert belt.K_s_ratio < 0.7


def test_the_delay_of_a_bench_is_pooled_with_what_trials_share():
    """Three trials whose angle is 2 ms late to 50 us, and which share 80 us; with
    amplitudes, which do not count."""
    lags = pl.Series([-1.95e-3, 9.0, -2.0e-3, -2.05e-3])
    amplitudes = [None, 2.0, None, None]
    half = 1.96 * 85e-6
    ends = {
        "lag_s": lags,
        "lag_s_low": lags - half,
        "lag_s_high": lags + half,
        "lag_s_se_bench": 80e-6,
    }
    rows = pl.DataFrame({"trial": [*"aabc"], "amplitude_deg": amplitudes, **ends})

    table = delay_table(rows)

    row = table.row(0, named=True)
    assert (table.height, row["trials"], row["to_state"]) == (3, 3, "theta: {delay: 2 ms}")
    assert row["delay_s"] == pytest.approx(-2e-3)
    delay_half = half_width(row, "delay_s")
    assert 1.96 * 80e-6 < delay_half < 1.96 * 100e-6


@pytest.mark.parametrize(
    ("half", "said"),
    [
        (0.24e-3, r"Write .*{delay: 1.03 ms}.*1\.03 ± 0\.94 ms"),
        (0.20e-3, r"not .*delay.*1\.03 ms .*0\.60 to 1\.30"),
    ],
)
def test_a_delay_is_proposed_where_trials_agree_within_twice_their_intervals(half, said):
    lags = pl.DataFrame({"trial": [*"abc"], "lag_s": [1.3e-3, 1.2e-3, 0.6e-3]})
    ends = {"lag_s_low": lags["lag_s"] - half, "lag_s_high": lags["lag_s"] + half}

    numbers = headline_numbers({"delay": delay_table(lags.with_columns(**ends))})

    assert re.search(said, "".join(headline_sentences(numbers)))


def test_a_trial_that_hardly_tells_the_delay_hardly_moves_it():
    """By hand: 2 ms twice to 0.1 ms, and 4 ms to 1 ms, weigh 100, 100 and 1."""
    lags = {"lag_s": [2e-3, 2e-3, 4e-3], "lag_s_low": [1.9e-3, 1.9e-3, 3e-3]}
    rows = pl.DataFrame({"trial": [*"abc"], **lags, "lag_s_high": [2.1e-3, 2.1e-3, 5e-3]})

    assert delay_table(rows)["delay_s"][0] == pytest.approx(404e-3 / 201)


def test_a_delay_that_no_trial_tells_for_certain_is_not_stated():
    row = {"trial": "a", "lag_s": 1e-4, "lag_s_low": -1e-4, "lag_s_high": 3e-4}

    table = delay_table(pl.DataFrame([row]), "calibration_delay")

    assert table.select("delay_s", "delay_s_high", "to_state").row(0) == (1e-4, 3e-4, None)
    assert delay_table(pl.DataFrame({"lag_s": [None]})).is_empty()
