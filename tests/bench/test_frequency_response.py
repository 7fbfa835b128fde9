# SPDX-License-Identifier: Apache-2.0
"""Frequency response of a joint: of sines by their cycles, of any other motion by windows."""

import numpy as np
import polars as pl
import pytest
from any_motion import chirp, made_trial, multisine
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
from osl_analysis.bench.impedance import analysed
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
    return response_table(analysed(record, IMPEDANCE))


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
    assert table["damping"].to_numpy() == pytest.approx(B, rel=5e-3)
    assert table["stiffness"].to_numpy() == pytest.approx((1 / Y).real, rel=1e-3)


@pytest.mark.parametrize("amplitudes", [1, 2])
def test_few_cycles_cover_the_response_and_its_mean_over_amplitudes(amplitudes):
    """95 % of 400 records of six cycles of Y = 1/(200 + 40 j) with a noisy torque; a normal
    quantile would reach 90 %."""
    Z = 200 + 40j
    theta = np.full(6, 0.05 + 0j)
    covered = []
    for seed in range(400):
        responses = []
        for k in range(amplitudes):
            rng = np.random.default_rng(10 * seed + k)
            noise = rng.standard_normal(6) + 1j * rng.standard_normal(6)
            torque = Z * theta + (0.5 + k) * noise
            responses.append(response_of_pieces(1.0, theta, torque, np.arange(6)))
        row = mean_response(responses).to_row(RECORD)
        truths = {
            "magnitude": abs(1 / Z),
            "phase_deg": -np.rad2deg(np.angle(Z)),
            "stiffness": Z.real,
            "damping": Z.imag / (2 * np.pi),
        }
        covered.append([row[f"{n}_low"] <= t <= row[f"{n}_high"] for n, t in truths.items()])

    of_each = np.mean(covered, axis=0)
    assert ((of_each > 0.92) & (of_each < 0.98)).all(), of_each


@pytest.mark.parametrize(
    ("stated", "magnitude", "phase"),
    [
        ({"calibration": Calibration(angle_gain=0.02)}, 0.02, 0.0),
        ({"calibration": Calibration(delay=2e-3)}, 0.0, 2 * np.pi * 2e-3),
        (
            {"bench_stiffness": BenchStiffness(value="3000 N*m/rad", standard_error="300 N*m/rad")},
            100 * 300 / 3000**2 * 0.6,
            100 * 300 / 3000**2 * 0.8,
        ),
    ],
)
def test_errors_of_the_bench_stretch_turn_and_shift_a_response(stated, magnitude, phase):
    """All amplitudes share them: a mean over amplitudes does not lessen them."""
    record = with_settings(RECORD, **stated)
    exact = Response(1.0, (0.6 - 0.8j) / 100, np.zeros(6, complex), 5.0)

    row = mean_response([exact, exact]).to_row(record)

    halves = [row[f"{name}_high"] - row[name] for name in ("magnitude", "phase_deg")]
    assert halves[0] == pytest.approx(1.96 * magnitude / 100, rel=1e-3, abs=1e-12)
    assert halves[1] == pytest.approx(1.96 * np.rad2deg(phase), rel=1e-3, abs=1e-9)


# ---- Other motions


def multisines(rng, realisations):
    """theta, omega, alpha (3, n) of multisines of 0.5 to 6 Hz with rests between."""
    return np.hstack([multisine(rng, 8.0, 4)[1] for _ in range(realisations)])


def recorded(rng, motion, friction=0.0):
    """The record of a joint with Coulomb friction [N*m] that is moved so."""
    time = np.arange(motion[0].size) / RATE
    rubs = friction * np.tanh(motion[1] / 0.01)
    trial = made_trial(rng, (time, motion), more=rubs, K=K, B=B, I=I)
    return record_of_trial(trial, CONFIG.dynamometer.model_copy(update={"excitation": "any"}))


@pytest.mark.parametrize(
    "motion_of",
    [lambda rng: chirp(rng, band=(0.4, 6.4))[1], lambda rng: multisines(rng, 4)],
    ids=["windows", "periods"],
)
def test_the_response_to_another_motion_is_the_joint_s_within_its_intervals(motion_of):
    covered = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        table = table_of_record(recorded(rng, motion_of(rng)))
        Y = eq15(table["frequency_hz"])

        assert table["magnitude"].to_numpy() == pytest.approx(np.abs(Y), rel=2e-3)
        told = table.drop_nulls("magnitude_low")
        assert len(told) > 5
        assert (told["magnitude_high"] < 2 * told["magnitude"]).all()
        of_told = eq15(told["frequency_hz"])
        covered.append(holds(told, "magnitude", np.abs(of_told)))
        covered.append(holds(told, "phase_deg", np.rad2deg(np.angle(of_told))))

    assert 0.9 < np.mean(covered) <= 1


def test_stiffness_and_damping_stand_at_a_stated_frequency():
    """Between the lines of four seconds; of a joint of second order K is K - I w^2."""
    rng = np.random.default_rng(1)
    record = recorded(rng, chirp(rng, band=(0.4, 6.4))[1])

    table = response_table(analysed(record, IMPEDANCE), 3.3)

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

    assert len(table) > 8
    assert table["magnitude"].null_count() == 0
    assert table["magnitude_low"].null_count() > 0.5 * len(table)


def test_a_response_tells_how_far_it_is_from_the_desired_impedance():
    frequency_hz = np.array([1.0, 2.0, 3.0])
    Z = (K + 2j * np.pi * frequency_hz * B) * [1.05, 0.98 * np.exp(0.05j), 1.2]
    columns = {"magnitude": 1 / abs(Z), "phase_deg": -np.degrees(np.angle(Z))}

    response = pl.DataFrame({"frequency_hz": frequency_hz, **columns})
    errors = with_errors(response.with_columns(K_d=K, B_d=B, amplitude_deg=2.0))

    assert errors["magnitude_error"].to_list() == pytest.approx([5, -2, 20])
    assert errors["phase_error"].to_list() == pytest.approx([0, np.degrees(0.05), 0], abs=1e-9)
    assert errors["Z_error"][2] == pytest.approx(20)
