# SPDX-License-Identifier: Apache-2.0
"""The inference of a leg, whose friction grows with the current, as the simulator moves it."""

from dataclasses import replace

import numpy as np
import pytest
from bench_synthetic import table_of
from conftest import half_width
from shipped import CONFIG
from shipped import LEG as P

import osl_analysis as osl
from osl_analysis.bench.friction import actuator_of_leg
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.inference.actuator import deviations
from osl_analysis.inference.spectra import BLOCKS
from osl_analysis.model.compensator import uncompensated_gains
from osl_analysis.model.drivetrain import dynamic_stiffness, held_actuator, linear_torque

GAINS = uncompensated_gains(300, 5, P)


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """Of a leg whose friction no controller cancels."""
    folder = tmp_path_factory.mktemp("leg")
    log = osl.simulate_trial(folder, "impedance_K300_B5.0_uncompensated")
    return record_of_trial(
        osl.read_recording(*log), CONFIG.dynamometer, extra_columns=["theta_m", "current"]
    )


def test_the_actuator_s_friction_is_found_and_its_motion_without_it(record):
    """As Eqs. 1, 2 and 7 answer without friction; the belt's hysteresis stays within a few
    percent."""
    found = actuator_of_leg(record)

    def answer(s):
        return P.K_s / P.n_T / held_actuator(s, GAINS.K_1, GAINS.B_1, P)

    theta = record.theta
    true = linear_torque(answer, theta, record.rate_hz, 15.0)
    angles = found.angles(theta, 0 * theta, record.rate_hz)[0], record.actuator["theta_m"]
    inside = slice(5000, -5000)
    left, by_friction = (np.std((angle - true)[inside]) for angle in angles)
    assert left < 0.1 * by_friction
    assert found.friction_probability > 0.99


def test_without_compensation_the_impedance_of_the_linear_leg_is_held(record):
    """As Eq. 7 answers, fitted to the same motion."""

    def answer(s):
        return dynamic_stiffness(s, GAINS.K_1, GAINS.B_1, P)

    torque = linear_torque(answer, record.theta, record.rate_hz, 45.0)
    filtered = record.settings.low_pass(torque, record.rate_hz)
    true = rendered_impedance(replace(record, torque=torque, filtered_torque=filtered)).whole

    row = table_of(record).row(-1, named=True)

    for name, column in {"K": "K_without_friction", "B": "B_viscous"}.items():
        assert row[f"{column}_low"] < true[name] < row[f"{column}_high"]
    assert half_width(row, "K_without_friction") < 0.01 * true["K"]


def test_deviations_are_those_of_other_speeds_and_of_a_jackknife():
    blocks = np.full(BLOCKS, 2.0)
    blocks[-1] += 1.0
    of_friction = np.concatenate([[1.0, 1.5, 0.5], blocks])  # of all, at other speeds, by blocks

    errors = deviations(of_friction)

    assert np.linalg.norm(errors[:2]) == pytest.approx(np.sqrt(0.5))
    jackknife = (BLOCKS - 1) / BLOCKS * np.sum((blocks - blocks.mean()) ** 2)
    assert np.sum(errors[2:] ** 2) == pytest.approx(jackknife)
