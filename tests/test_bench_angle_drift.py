"""An angle that drifts where the joint does not, as a gyro's."""

import numpy as np
import pytest
from bench_synthetic import FIVE, record_of_sines, second_order, stepped_sine

from osl_analysis.bench.analysis import analysed
from osl_analysis.bench.angle_drift import angle_drift_deg, steady_drift
from osl_analysis.bench.effects import IMPEDANCE, plain_sums
from osl_analysis.judge.known_findings import EVIDENCE

SOUND = stepped_sine(second_order, 0.05, FIVE)  # K = 200 N*m/rad
SHARE = np.linspace(0.0, 1.0, len(SOUND.time))  # of the recording
DRIFTS = {"steady": np.deg2rad(2.0) * SHARE, "warming": np.deg2rad(2.0) * (1 - np.exp(-4 * SHARE))}


def drift_of(theta, torque):
    record = record_of_sines(SOUND.time, theta, torque, FIVE)
    return angle_drift_deg(analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE))


@pytest.mark.parametrize("drift", DRIFTS.values(), ids=DRIFTS)
def test_an_angle_that_drifts_is_told_by_the_torque_that_does_not_follow(drift):
    found = drift_of(SOUND.theta + drift, SOUND.torque)

    fitted = SOUND.rows()
    assert found == pytest.approx(np.rad2deg(np.ptp(drift[fitted])), rel=0.1)


@pytest.mark.parametrize("drift", DRIFTS.values(), ids=DRIFTS)
def test_a_joint_that_turns_slowly_and_a_load_cell_that_drifts_are_no_drift_of_the_angle(drift):
    assert drift_of(SOUND.theta + drift, SOUND.torque + 200 * drift) == 0.0
    assert drift_of(SOUND.theta, SOUND.torque + 200 * drift) == 0.0
    assert drift_of(SOUND.theta, SOUND.torque) == 0.0


def test_a_steady_drift_of_the_angle_is_no_drift_of_the_load_cell():
    record = record_of_sines(SOUND.time, SOUND.theta + DRIFTS["steady"], SOUND.torque, FIVE)

    assert abs(60 * record.drift) < 0.5  # N*m/min; the least squares of both alike gave hundreds
    assert EVIDENCE["angle_drift_deg"].finding == "angle_drift"


def test_a_steady_drift_of_slow_cycles_is_told_where_the_torque_comes_back():
    time = np.linspace(0.0, 40.0, 2000)
    theta = 0.2 * np.sin(0.6 * time)
    noise = 0.05 * np.random.default_rng(3).standard_normal(time.size)
    drift = np.linspace(0.0, 0.07, time.size)

    assert steady_drift(theta + drift, 60 * theta + noise) == pytest.approx(0.07, rel=0.02)
    assert steady_drift(theta + drift, 60 * (theta + drift) + noise) == 0.0
    assert steady_drift(theta, 60 * theta + noise) == 0.0


def test_an_angle_that_wanders_is_told_as_one_that_drifts():
    steps = np.random.default_rng(8).standard_normal(SOUND.time.size)
    walk = np.cumsum(steps) / np.sqrt(steps.size) * np.deg2rad(2.0)

    assert drift_of(SOUND.theta + walk, SOUND.torque) > 0.5
