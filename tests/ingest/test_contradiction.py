# SPDX-License-Identifier: Apache-2.0
"""A speed and the angle of its body contradict each other where one of both has a wrong scale."""

import numpy as np
import polars as pl
import pytest
from conftest import white_noise

from osl_analysis.base.trial import Trial
from osl_analysis.ingest.quality import Commanded, measure_quality
from osl_analysis.ingest.raw_files import read_converted, read_source
from osl_analysis.signals.agreement import speed_factor

TIME = np.arange(8000) / 200
TURN = 2 * np.pi * TIME
ANGLE = 5 * np.sin(0.7 * TURN) + 2 * np.sin(2.3 * TURN)  # deg
SPEED = np.gradient(ANGLE, TIME)
SOURCE = """format: csv
time: {column: time, unit: s}
channels:
  theta: {column: "theirs", unit: deg}
  torque: {column: torque, unit: N*m}
"""


def factors(folder, angle, speed, more="", speeds=SPEED):
    """What is told of a log with an angle, a column `speed`, and further ones."""
    (folder / "log.yaml").write_text(SOURCE.replace("theirs", angle) + more)
    rows = np.column_stack([TIME, ANGLE, speeds, ANGLE])
    text = f"time,{angle},{speed},torque"
    np.savetxt(folder / "log.csv", rows, "%.6f", ",", header=text, comments="")
    origins = read_converted(folder / "log.csv", read_source(folder / "log.yaml")).origins
    return {
        column: (facts["beside"], facts["speed_factor"])
        for column, facts in origins.items()
        if "beside" in facts
    }


@pytest.mark.parametrize(("angle", "speed", "factor"), [
    ("angle", "velocity [deg/s]", 1),
    ("angle", "velocity [rad/s]", 57.3),
    ("knee_pos", "knee_vel", 1),  # no unit is stated, and one explains it
    ("q[5]", "dq[5]", 1),
])  # fmt: skip
def test_a_speed_that_no_analysis_reads_is_compared_by_name_and_unit(
    tmp_path, angle, speed, factor
):
    told = factors(tmp_path, angle, speed)

    assert told == {"theta": (speed.split(" ")[0], pytest.approx(factor, rel=0.003))}


def test_half_of_the_speed_without_a_unit_is_explained_by_none(tmp_path):
    told = factors(tmp_path, "angle", "velocity", speeds=SPEED / 2)

    assert told == {"theta": ("velocity", pytest.approx(0.5, rel=0.01))}


@pytest.mark.parametrize("speed", ["motor_velocity [deg/s]", "velocity_setpoint [deg/s]"])
def test_the_speed_of_another_body_and_a_command_are_not_compared(tmp_path, speed):
    assert factors(tmp_path, "angle", speed) == {}


def test_an_angle_that_no_analysis_reads_is_compared_with_the_speed_of_its_body(tmp_path):
    (tmp_path / "log.yaml").write_text(
        SOURCE.replace("theta", "omega_m")
        .replace("theirs", "motor_velocity")
        .replace("deg", "deg/s")
    )
    rows = np.column_stack([TIME, 2 * ANGLE, SPEED, ANGLE])
    header = "time,motor_angle [deg],motor_velocity,torque"
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=header, comments="")

    converted = read_converted(tmp_path / "log.csv", read_source(tmp_path / "log.yaml"))

    assert converted.origins["omega_m"]["speed_factor"] == pytest.approx(0.5, rel=0.003)


def test_angle_and_speed_of_an_actuator_are_of_one_body_whatever_they_are_called():
    columns = {"time": TIME, "theta_m": 9 * ANGLE, "omega_m": SPEED, "current": ANGLE}
    trial = Trial("a", pl.DataFrame(columns))

    check = measure_quality(trial, "actuator", Commanded())["contradiction"]

    assert check.value == pytest.approx(100 * (1 - 1 / 9), rel=0.003)


def test_noise_of_the_angle_and_a_filter_of_the_speed_change_the_factor_by_less_than_3_percent():
    late = np.convolve(SPEED, np.ones(5) / 5)[: SPEED.size]  # a mean over 25 ms

    factor = speed_factor(TIME, ANGLE + 0.05 * white_noise(TIME.size, 3), late)

    assert factor == pytest.approx(1, abs=0.03)


def test_a_speed_that_does_not_follow_is_not_judged():
    assert np.isnan(speed_factor(TIME, ANGLE, white_noise(TIME.size, 4)))
