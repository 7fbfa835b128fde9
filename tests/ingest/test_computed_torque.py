# SPDX-License-Identifier: Apache-2.0
"""A torque that was computed from angle and current of its trial is no measurement."""

import numpy as np
import polars as pl
import pytest
from conftest import refused_with, white_noise
from scipy.signal import lfilter

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Trial
from osl_analysis.bench.plausibility import computed_torque
from osl_analysis.ingest.guard import check_own_torque

TIME = np.arange(4000) / 200
TURN = 2 * np.pi * TIME
THETA = 0.08 * np.sin(0.7 * TURN) + 0.03 * np.sin(2.3 * TURN)
ANGLE = np.round(THETA, 5)
OMEGA = np.gradient(THETA, TIME)
ALPHA = np.gradient(OMEGA, TIME)
SPEED = np.round(9 * np.sin(0.9 * TURN), 3)
CURRENT = np.round(3 * np.sin(0.4 * TURN) + np.sin(1.9 * TURN + 1), 3)
NOISE = white_noise(TIME.size, 5)


@pytest.mark.parametrize(
    ("torque", "names"),
    [
        (150 * ANGLE, "theta"),
        (90 * ANGLE + 900 * ANGLE**3 + 7e5 * ANGLE**5 + 7, "theta"),
        (np.round(150 * THETA + 12 * OMEGA, 4), "theta"),
        (np.round(150 * ANGLE + lfilter([0.9], [1, -0.7], np.gradient(ANGLE, TIME)), 5), "theta"),
        (0.8 * CURRENT - 20 * ANGLE, "theta.*current"),
        (
            4 * CURRENT * (1 + 0.8 * ANGLE - 2 * ANGLE**2)
            - 0.4 * np.tanh(OMEGA / 0.2)
            + 0.003 * NOISE,
            "theta and current",
        ),
        (0.8 * CURRENT - np.sign(SPEED) * (0.3 + 0.05 * abs(CURRENT)), "current and omega_m"),
    ],
)
def test_a_torque_that_follows_from_angle_and_current_is_refused(torque, names):
    with refused_with(rf"follows.*{names}.*computed"):
        check_own_torque(trial_of(torque))


@pytest.mark.parametrize(
    "friction",
    [
        np.tanh(OMEGA / 0.01),
        np.tanh(OMEGA / 0.2),
        np.sign(OMEGA + 0.1 * NOISE),  # of a noisy speed
        (1 + 0.5 * np.exp(-((OMEGA / 0.1) ** 2))) * np.tanh(OMEGA / 0.02) + 0.2 * OMEGA,  # Stribeck
    ],
)
def test_a_torque_of_a_noisy_current_less_friction_is_refused(friction):
    current = CURRENT + 0.02 * NOISE
    torque = current * (3 + 0.4 * ANGLE) - 0.9 * friction

    with refused_with("follows.*theta and current.*computed"):
        check_own_torque(trial_of(torque, current))


@pytest.mark.parametrize(
    "torque",
    [
        150 * THETA + 3 * OMEGA + 0.02 * ALPHA,  # of a simulated joint
        np.round(150 * THETA + 0.05 * NOISE),
        150 * THETA + 3 * np.tanh(OMEGA / 0.05),
        600
        * (np.round(THETA + 0.02 * np.sin(1.3 * TURN), 5) - ANGLE),  # of a spring's two encoders
        1.7 * CURRENT + 0.01 * NOISE,
        1.7 * CURRENT + 0.9 * np.tanh(OMEGA / 0.05) + 0.05 * NOISE,
    ],
)
def test_a_torque_of_a_sensor_is_taken(torque):
    check_own_torque(trial_of(torque))


def test_a_torque_that_is_stated_to_be_measured_is_believed():
    trial = trial_of(150 * ANGLE)
    trial.provenance["columns"] = {"torque": {"measured": True}}

    check_own_torque(trial)


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"column": "effort"}, "effort"),
        ({"column": "1", "found": "torque [A]"}, "torque [A]"),
        ({"column": "torque_from_current"}, "torque_from_current"),
        ({"column": "torque_from_current", "measured": True}, None),
        ({"column": "tau_est"}, "tau_est"),
        ({"topic": "/currents", "field": "wrench.torque.z"}, None),
    ],
)
def test_a_torque_that_is_called_so_is_not_measured_until_it_is_stated(stated, message):
    trial = trial_of(150 * THETA)
    trial.provenance["columns"] = {"torque": stated}

    assert pl.select(computed_torque(trial)).item() == message


def trial_of(torque, current=CURRENT):
    columns = {"time": TIME, "theta": ANGLE, "current": current, "omega_m": SPEED, "torque": torque}
    return Trial("a", pl.DataFrame(columns))


# Where the limits stand. Noise is a 95 % quantile of the torque's standard deviation.

ALIKE = 1.96  # standard deviations of normal noise, within which 95 % lie
OTHER_NOISE = white_noise(TIME.size, 6)


def angle_trial(torque):
    """A trial with an angle and a torque of its first rows."""
    rows = len(torque)
    return Trial("a", pl.DataFrame({"time": TIME[:rows], "theta": ANGLE[:rows], "torque": torque}))


def current_trial(torque, current):
    return Trial("a", pl.DataFrame({"time": TIME, "current": current, "torque": torque}))


def with_noise(torque, share, noise=NOISE):
    """A torque with noise, of which a share of the torque's scatter is exceeded in 5 % of rows."""
    return torque + share / ALIKE * np.std(torque) * noise


def is_refused(trial):
    try:
        check_own_torque(trial)
    except InputError:
        return True
    return False


@pytest.mark.parametrize(("share", "refused"), [(5e-4, True), (7e-4, False)])
def test_a_load_cell_leaves_more_than_6_parts_in_10_000_of_an_angle_s_formula(share, refused):
    """In sums of three rows, the samples of 16 ms at 200 Hz."""
    torque = with_noise(150 * ANGLE, share * np.sqrt(3))

    assert is_refused(angle_trial(torque)) == refused


@pytest.mark.parametrize(("share", "refused"), [(1.5e-3, True), (3e-3, False)])
def test_a_load_cell_leaves_more_than_2_parts_in_1000_of_a_current_with_its_arm(share, refused):
    torque = with_noise(4 * CURRENT * (1 + 0.8 * ANGLE), share)

    assert is_refused(trial_of(torque)) == refused


@pytest.mark.parametrize(("of_sensor", "refused"), [(0.1, True), (0.22, False)])
def test_a_load_cell_has_more_noise_than_a_third_of_that_of_the_current(of_sensor, refused):
    """Of noise in the current, the torque that a program computes from it has the same."""
    scatter = 0.02 * CURRENT.std()
    current = CURRENT + scatter * NOISE
    torque = 4 * current + 4 * of_sensor * scatter * OTHER_NOISE

    assert is_refused(trial_of(torque, current)) == refused


@pytest.mark.parametrize(("share", "refused"), [(3e-5, True), (7e-5, False)])
def test_a_load_cell_leaves_more_than_a_tenth_of_its_noise_of_a_filtered_current(share, refused):
    current = CURRENT + 0.2 * NOISE
    torque = with_noise(lfilter([0.1], [1, -0.9], 4 * current), share, OTHER_NOISE)

    assert is_refused(current_trial(torque, current)) == refused


@pytest.mark.parametrize(("rows", "refused"), [(98, False), (150, True)])
def test_a_hundred_rows_tell_a_computed_torque(rows, refused):
    assert is_refused(angle_trial(150 * ANGLE[:rows])) == refused


@pytest.mark.parametrize(("power", "refused"), [(5, True), (7, False)])
def test_a_spring_that_stiffens_with_more_than_the_fifth_power_is_no_formula(power, refused):
    stiffening = (ANGLE / 0.1) ** power

    assert is_refused(angle_trial(15 * ANGLE + 7 * stiffening)) == refused
