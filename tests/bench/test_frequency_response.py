# SPDX-License-Identifier: Apache-2.0
"""Frequency response of a joint: of sines by their cycles, of any other motion by windows."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
import scipy
from any_motion import chirp, made_trial, multisine, sines
from bench_synthetic import second_order, stepped_sine, with_settings
from shipped import CONFIG

from osl_analysis.bench.bench_settings import BenchStiffness, Calibration
from osl_analysis.bench.frequency_response import (
    Response,
    mean_response,
    response_of_pieces,
    response_table,
    with_errors,
)
from osl_analysis.bench.impedance import fit_all_groups
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.bench.regression import IMPEDANCE

RATE = 250.0
K = 200.0
B = 4.0
I = 0.05
RECORD = stepped_sine(second_order)


def eq15(frequency_hz):
    s = 2j * np.pi * np.asarray(frequency_hz)
    return 1 / (K + B * s + I * s**2)


def table_of_record(record):
    return response_table(fit_all_groups(record, IMPEDANCE))


def holds(table, name, truth):
    """Share of the rows whose interval holds the truth (n,)."""
    low, high = (table[f"{name}{end}"].to_numpy() for end in ("_low", "_high"))
    return np.mean((low <= truth) & (truth <= high))


# ---- Stepped sines


def test_the_response_to_sines_is_the_joint_s_at_each_amplitude_and_over_all():
    """A load cell that drifts by 20 N*m moves nothing."""
    drifting = stepped_sine(lambda m: second_order(m) + np.linspace(0, 20, len(m.theta)))

    table = table_of_record(drifting)

    Y = eq15(table["frequency_hz"])
    assert table["scope"].to_list() == ["amplitude"] * 6 + ["all"] * 3
    assert table["magnitude"].to_numpy() == pytest.approx(np.abs(Y), rel=1e-4)
    assert table["phase_deg"].to_numpy() == pytest.approx(np.rad2deg(np.angle(Y)), abs=0.01)


def test_few_cycles_have_student_s_interval_and_their_mean_has_welch_s():
    """By SciPy, of two amplitudes whose cycles scatter by 0.1 and by 0.2 N*m/rad."""
    scatter = np.random.default_rng(0).normal(0, [[0.1], [0.2]], (2, 6))
    theta = np.full(6, 0.05 + 0j)
    first, second = (
        response_of_pieces(1.0, theta, (200 + 40j + each) * theta, np.arange(6)) for each in scatter
    )

    low = first.to_row(RECORD)["stiffness_low"]
    low_of_mean = mean_response([first, second]).to_row(RECORD)["stiffness_low"]

    student = scipy.stats.ttest_1samp(scatter[0], 0).confidence_interval()
    welch = scipy.stats.ttest_ind(scatter[0], -scatter[1], equal_var=False).confidence_interval()
    assert low - 200 == pytest.approx(student.low, abs=2e-3)
    assert low_of_mean - 200 == pytest.approx(welch.low / 2, abs=2e-3)


def test_errors_of_the_bench_stretch_turn_and_shift_a_response():
    """All amplitudes share them: a mean over amplitudes does not lessen them."""
    record = with_settings(
        RECORD,
        calibration=Calibration(angle_gain=0.02, delay=2e-3),
        bench_stiffness=BenchStiffness(value="3000 N*m/rad", standard_error="300 N*m/rad"),
    )
    exact = Response(1.0, (0.6 - 0.8j) / 100, np.zeros(6, complex), 5.0)

    row = mean_response([exact, exact]).to_row(record)

    shift = 100 * 300 / 3000**2 * np.array([0.6, 0.8])
    stretch, turn = 1.96 * np.hypot([0.02, 2 * np.pi * 2e-3], shift)
    assert row["magnitude_high"] - row["magnitude"] == pytest.approx(stretch / 100, rel=1e-3)
    assert row["phase_deg_high"] - row["phase_deg"] == pytest.approx(np.rad2deg(turn), rel=1e-3)


# ---- Other motions


def multisines(rng, realisations):
    """theta, omega, alpha (3, n) of multisines of 0.5 to 6 Hz with rests between."""
    return np.hstack([multisine(rng, 8.0, 4)[1] for _ in range(realisations)])


def recorded(rng, motion, friction=0.0, late=0.0):
    """The record of a joint with Coulomb friction [N*m], and a torque that is late [s], that is
    moved so."""
    time = np.arange(motion[0].size) / RATE
    rubs = friction * np.tanh(motion[1] / 0.01)
    trial = made_trial(rng, (time, motion), late=late, more=rubs, K=K, B=B, I=I)
    return record_of_trial(trial, CONFIG.dynamometer.model_copy(update={"excitation": "any"}))


def share_held(motion_of, late=0.0):
    """Share of intervals of the magnitude that hold the truth, over eight records."""
    shares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        record = recorded(rng, motion_of(rng)[1], late=late)
        told = table_of_record(record).drop_nulls("magnitude_low")
        shares.append(holds(told, "magnitude", np.abs(eq15(told["frequency_hz"]))))
    return np.mean(shares)


def test_the_response_to_another_motion_is_the_joint_s_within_its_intervals():
    assert share_held(chirp) > 0.9


def test_sines_half_a_hertz_apart_are_each_told_within_their_intervals():
    """Every two seconds they beat alike, and a late torque is of no joint of second order."""
    share = share_held(lambda rng: sines(rng, [0.39, 0.89, 1.65, 2.48, 3.8], duration=60.0), 0.02)

    assert 0.9 < share < 0.99


def test_a_motion_slower_than_the_lines_or_shorter_than_a_window_has_none():
    rng = np.random.default_rng(1)
    for record in (
        replace(recorded(rng, chirp(rng)[1]), band_hz=(0.1, 0.4)),
        recorded(rng, chirp(rng, duration=2.5)[1]),
    ):
        assert table_of_record(record).is_empty()


def test_stiffness_and_damping_stand_at_a_stated_frequency():
    """Between the lines of four seconds; of a joint of second order K is K - I w^2."""
    rng = np.random.default_rng(1)
    record = recorded(rng, chirp(rng)[1])

    table = response_table(fit_all_groups(record, IMPEDANCE), 3.3)

    row = table.filter("is_headline").row(0, named=True)
    assert row["frequency_hz"] == 3.3
    assert row["stiffness"] == pytest.approx(K - I * (2 * np.pi * 3.3) ** 2, rel=2e-3)
    assert row["damping"] == pytest.approx(B, rel=5e-3)


def test_intervals_beside_friction_hold_what_other_phases_would_give():
    """The best linear approximation, a mean over 14 motions of four realisations. Windows that
    repeat one another alone would hold it in half of the lines."""
    tables = []
    for seed in range(14):
        rng = np.random.default_rng(seed)
        tables.append(table_of_record(recorded(rng, multisines(rng, 4), friction=2.0)))

    covered = []
    for name in ("magnitude", "phase_deg"):
        truth = np.mean([table[name].to_numpy() for table in tables], axis=0)
        covered.append(np.mean([holds(table, name, truth) for table in tables]))
    assert min(covered) > 0.9


def test_one_realisation_has_a_response_and_no_interval():
    rng = np.random.default_rng(1)

    table = table_of_record(recorded(rng, multisines(rng, 1)))

    assert table["magnitude_low"].null_count() > 8


def test_a_response_tells_how_far_it_is_from_the_desired_impedance():
    ratio = 1.05 * np.exp(0.05j)
    Y = 1 / (K + 2j * np.pi * B) / ratio

    response = pl.DataFrame({"magnitude": abs(Y), "phase_deg": np.angle(Y, deg=True)})
    errors = with_errors(response.with_columns(frequency_hz=1.0, K_d=K, B_d=B, amplitude_deg=2.0))

    assert errors["magnitude_error"].item() == pytest.approx(5)
    assert errors["phase_error"].item() == pytest.approx(np.degrees(0.05))
    assert errors["Z_error"].item() == pytest.approx(100 * abs(ratio - 1))
