"""A speed and the angle of its body contradict each other where one of both has a wrong scale."""

import numpy as np
import pytest
from conftest import white_noise

from osl_analysis.ingest.agreement import speed_factor
from osl_analysis.ingest.raw_files import read_converted, read_source

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
    return read_converted(folder / "log.csv", read_source(folder / "log.yaml")).facts[
        "speed_factors"
    ]


@pytest.mark.parametrize(("angle", "speed", "factor"), [
    ("angle", "velocity [deg/s]", 1),
    ("angle", "velocity [rad/s]", 57.3),
    ("knee_pos", "knee_vel", 1),  # no unit is stated, and one explains it
    ("q[5]", "dq[5]", 1),
])  # fmt: skip
def test_a_speed_that_no_analysis_reads_is_compared_by_name_and_unit(
    tmp_path, angle, speed, factor
):
    (told,) = factors(tmp_path, angle, speed).items()

    assert told[1] == pytest.approx(factor, rel=0.003)
    assert speed.split(" ")[0] in told[0]
    assert angle in told[0]


def test_half_of_the_speed_without_a_unit_is_explained_by_none(tmp_path):
    (factor,) = factors(tmp_path, "angle", "velocity", speeds=SPEED / 2).values()

    assert factor == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("speed", ["motor_velocity [deg/s]", "velocity_setpoint [deg/s]"])
def test_the_speed_of_another_body_and_a_command_are_not_compared(tmp_path, speed):
    assert factors(tmp_path, "angle", speed) == {}


def test_angle_and_speed_of_an_actuator_are_of_one_body_whatever_they_are_called(tmp_path):
    named = "  omega_m: {column: output, unit: deg/s}\n"
    source = SOURCE.replace("theta", "theta_m")
    (tmp_path / "log.yaml").write_text(source.replace("theirs", "before") + named)
    rows = np.column_stack([TIME, 9 * ANGLE, SPEED, ANGLE])
    np.savetxt(
        tmp_path / "log.csv", rows, "%.6f", ",", header="time,before,output,torque", comments=""
    )

    converted = read_converted(tmp_path / "log.csv", read_source(tmp_path / "log.yaml"))

    assert [*converted.facts["speed_factors"].values()] == pytest.approx([1 / 9], rel=0.003)


def test_noise_of_the_angle_and_a_filter_of_the_speed_change_the_factor_by_less_than_3_percent():
    late = np.convolve(SPEED, np.ones(5) / 5)[: SPEED.size]  # a mean over 25 ms

    factor = speed_factor(ANGLE + 0.05 * white_noise(TIME.size, 3), late, 0.005)

    assert factor == pytest.approx(1, abs=0.03)


def test_a_speed_that_does_not_follow_is_not_judged():
    assert speed_factor(ANGLE, white_noise(TIME.size, 4), 0.005) is None
