# SPDX-License-Identifier: Apache-2.0
"""`osl.fit` reads a table with columns named by signal and unit, whose torque has a stated sign."""

import numpy as np
import polars as pl
import pytest
from conftest import refused_with

import osl_analysis as osl

K, B, INERTIA = 93.0, 1.4, 0.03  # N*m/rad, N*m*s/rad, kg*m^2


def write_joint(path, names=("time_s", "theta_deg", "torque_Nm"), torque_sign=1):
    """A joint of K, B and I that three sines move, without noise, as CSV; the angle is in degrees,
    whatever its column is called."""
    time = np.arange(0, 20, 0.01)
    theta = np.zeros_like(time)
    torque = np.zeros_like(time)
    for hz in (0.5, 1.5, 3.0):
        s = 2j * np.pi * hz
        rotation = np.exp(s * time)
        theta += np.deg2rad(2) * rotation.real
        torque += np.deg2rad(2) * ((INERTIA * s**2 + B * s + K) * rotation).real
    columns = (time, np.rad2deg(theta), torque_sign * torque)
    pl.DataFrame(dict(zip(names, columns, strict=True))).write_csv(path)
    return path


@pytest.mark.parametrize("names", [
    ("time_s", "theta_deg", "torque_Nm"), ("time [s]", "theta [deg]", "torque [N*m]"),
])  # fmt: skip
@pytest.mark.parametrize("sign", [1, -1])
def test_columns_named_by_signal_and_unit_give_the_joint_that_made_them(tmp_path, names, sign):
    log = write_joint(tmp_path / "k93.csv", names, torque_sign=sign)

    fit = osl.fit(log, sign=sign)

    assert (fit.K, fit.B) == pytest.approx((K, B), rel=1e-3)
    assert pytest.approx(INERTIA, rel=1e-2) == fit.I
    assert fit.trial == "k93"


@pytest.mark.parametrize("sign", [1, -1])
def test_a_torque_without_its_sign_is_refused_with_the_sign_of_the_motion(tmp_path, sign):
    log = write_joint(tmp_path / "k93.csv", torque_sign=sign)

    with refused_with(
        rf"k93\.csv: the sign of the torque is not stated.*suggests sign={sign}, .*K 9"
    ):
        osl.fit(log)


def test_the_wrong_sign_is_refused_and_never_corrected(tmp_path):
    log = write_joint(tmp_path / "k93.csv")

    with refused_with("negative, so the torque drives the motion"):
        osl.fit(log, sign=-1)


def test_names_without_signal_or_unit_are_refused_with_names_that_are_read(tmp_path):
    log = write_joint(tmp_path / "k93.csv", names=("time_s", "knee_angle_deg", "torque_Nm"))

    with refused_with(r"it has time_s, knee_angle_deg, torque_Nm.*theta_deg"):
        osl.fit(log, sign=1)


@pytest.mark.parametrize("sign", [0, 2, -3])
def test_a_sign_is_1_or_minus_1(tmp_path, sign):
    log = write_joint(tmp_path / "k93.csv")

    with refused_with(f"sign={sign}"):
        osl.fit(log, sign=sign)


def test_a_trial_takes_no_sign(tmp_path):
    trial = osl.Trial("t", pl.DataFrame({"time": [0.0, 1.0], "theta": 0.0, "torque": 0.0}))

    with refused_with("has the sign that its source file states"):
        osl.fit(trial, sign=1)
