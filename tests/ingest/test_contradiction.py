# SPDX-License-Identifier: Apache-2.0
"""A speed and its angle, and both sides of a gear, contradict each other where one has a wrong
scale."""

import numpy as np
import polars as pl
import pytest
from conftest import white_noise

from osl_analysis.base.trial import Trial
from osl_analysis.bench.plausibility import gear_told
from osl_analysis.ingest.raw_files import read_converted, read_source
from osl_analysis.model.drivetrain import REQUIRED, DrivetrainParameters
from osl_analysis.signals.agreement import turn_ratio, turns

TIME = np.arange(8000) / 200
TURN = 2 * np.pi * TIME
ANGLE = 5 * np.sin(0.7 * TURN) + 2 * np.sin(2.3 * TURN)  # deg
SPEED = np.gradient(ANGLE, TIME)
SOURCE = """format: csv
time: {column: time, unit: s}
channels:
  CHANNEL
  torque: {column: torque, unit: N*m}
"""


def message(folder, channel, **columns):
    """What is told of a log with a channel that is read, and other columns."""
    (folder / "log.yaml").write_text(SOURCE.replace("CHANNEL", channel))
    header = ",".join(["time", *columns, "torque"])
    rows = np.column_stack([TIME, *columns.values(), ANGLE])
    np.savetxt(folder / "log.csv", rows, "%.6f", ",", header=header, comments="")
    origins = read_converted(folder / "log.csv", read_source(folder / "log.yaml")).origins
    return {
        kind: facts[kind]
        for facts in origins.values()
        for kind in ("speeds", "gears")
        if kind in facts
    }


def speeds(folder, angle, speed, readings=SPEED):
    """What is told of an angle in degrees that is read, and a speed that is not."""
    channel = f'theta: {{column: "{angle}", unit: deg}}'
    return message(folder, channel, **{angle: ANGLE, speed: readings})


@pytest.mark.parametrize(
    ("speed", "readings", "factor"),
    [
        ("Gelenkgeschw. [rad/s]", np.deg2rad(SPEED), 1),
        ("w [deg/s]", 0.8 * SPEED, 0.8),
        ("Drehzahl [rpm]", SPEED / 6, 1),
        ("velocity [rad/s]", SPEED, 57.3),
        ("velocity_dps", SPEED / 2, 0.5),
    ],
)
def test_a_speed_that_nothing_reads_is_compared_by_its_unit(tmp_path, speed, readings, factor):
    name = f"'{speed.split(' [')[0]}'"

    assert speeds(tmp_path, "pos", speed, readings) == {
        "speeds": {name: pytest.approx(factor, rel=0.003)}
    }


@pytest.mark.parametrize(
    ("name", "readings"),
    [
        ("velocity_setpoint [deg/s]", SPEED),
        ("velocity [deg/s]", white_noise(TIME.size, 4)),
        ("speed", SPEED / 2),  # of no known unit
    ],
)
def test_a_command_noise_and_a_speed_without_a_unit_are_not_compared(tmp_path, name, readings):
    assert speeds(tmp_path, "angle", name, readings) == {}


def test_a_word_in_a_speed_that_nothing_reads_refuses_nothing(tmp_path):
    (tmp_path / "log.yaml").write_text(SOURCE.replace("CHANNEL", "theta: {column: a, unit: deg}"))
    rows = [f"{t:.3f},{a:.6f},1.5,{a:.6f}" for t, a in zip(TIME[:500], ANGLE[:500], strict=True)]
    rows[7] = rows[7].replace("1.5", "ERR")
    (tmp_path / "log.csv").write_text("\n".join(["time,a,w [deg/s],torque", *rows, ""]))

    converted = read_converted(tmp_path / "log.csv", read_source(tmp_path / "log.yaml"))

    assert len(converted.samples) == 500


def test_the_speed_of_another_joint_that_follows_is_no_contradiction(tmp_path):
    columns = {"hip [deg]": 0.7 * ANGLE, "hip_w [deg/s]": 0.7 * SPEED, "w [deg/s]": SPEED}

    found = message(tmp_path, "theta: {column: knee, unit: deg}", knee=ANGLE, **columns)

    assert found == {"speeds": {"'w'": pytest.approx(1, rel=0.003)}}


def test_an_angle_that_no_analysis_reads_is_compared_with_a_speed(tmp_path):
    columns = {"motor_angle [deg]": 2 * ANGLE, "speed [deg/s]": SPEED}

    found = message(tmp_path, "omega_m: {column: speed, unit: deg/s}", **columns)

    assert found == {"speeds": {"'motor_angle'": pytest.approx(0.5, rel=0.003)}}


def test_angle_and_speed_of_an_actuator_are_compared_by_any_name(tmp_path):
    both = "theta_m: {column: a, unit: deg}\n  omega_m: {column: b, unit: deg/s}"

    found = message(tmp_path, both, a=9 * ANGLE, b=SPEED)

    assert found == {"speeds": {"omega_m": pytest.approx(1 / 9, rel=0.003)}}


def test_noise_and_a_filter_change_the_factor_by_less_than_3_percent():
    late = np.convolve(SPEED, np.ones(5) / 5)[: SPEED.size]  # a mean over 25 ms
    turned = turns(TIME, ANGLE + 0.05 * white_noise(TIME.size, 3), is_speed=False)

    factor = turn_ratio(turned, turns(TIME, late, is_speed=True))

    assert factor == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize(
    ("columns", "channels", "motor"),
    [
        ({"knee": ANGLE, "motor [deg]": 40 * ANGLE}, "", "'motor'"),
        ({"knee": ANGLE, "m": 40 * ANGLE}, "\n  theta_m: {column: m, unit: deg}", "theta_m"),
        ({"knee": ANGLE, "motor_speed [deg/s]": 40 * SPEED}, "", "'motor_speed'"),
    ],
)
def test_how_far_the_motor_turns_beside_its_joint_is_told(tmp_path, columns, channels, motor):
    found = message(tmp_path, "theta: {column: knee, unit: deg}" + channels, **columns)

    assert found["gears"] == {motor: pytest.approx(40, rel=0.003)}


@pytest.mark.parametrize(
    ("parameters", "ratio"),
    [
        ({}, None),
        ({"n_T": 50}, None),  # a belt may yield by any share
        ({"n_T": 5, "n_m": 8, "K_s": 15000}, 1.0),
        ({"n_T": 50, "K_s": 600}, 1.0),  # the belt yields by 0.25 of theta
        ({"n_T": 50, "K_s": 15000}, 0.808),  # by 0.01
    ],
)
def test_how_far_the_motor_turns_is_held_against_ratio_and_belt(parameters, ratio):
    samples = pl.DataFrame({"time": TIME, "theta": ANGLE, "torque": 150 * ANGLE})
    trial = Trial("a", samples, {"columns": {"theta": {"gears": {"m": 40.0}}}})
    known = dict.fromkeys(REQUIRED, np.nan) | parameters
    p = DrivetrainParameters(**known) if parameters else None

    told_of_gear = pl.select(*gear_told(trial, p)).row(0)

    assert told_of_gear == (
        "while theta turns once, m turns 40 times",
        pytest.approx(ratio, abs=1e-3),
    )
