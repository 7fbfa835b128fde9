"""Guesses of a draft: what a channel's name and unit tell, and nothing where they contradict a column."""

import pytest

from osl_analysis.columns import COLUMNS
from osl_analysis.ingest.draft import channel_lines, likely_column
from osl_analysis.ingest.overview import RecordedChannel


def channel(name: str, unit: str = "") -> RecordedChannel:
    return RecordedChannel("column", {"column": name}, unit)


@pytest.mark.parametrize(
    ("name", "unit", "column"),
    [
        ("angleJIM", "", "theta"),
        ("variables.ankle_angle", "deg", "theta"),
        ("JointPosition", "rad", "theta"),
        ("position[name=ankle]", "rad", "theta"),
        ("ankle_angle_r", "deg", "theta"),
        ("desired_angle", "deg", "theta_command"),
        ("motor_position", "rad", "theta_m"),
        ("theta_m", "rad", "theta_m"),
        ("actuator velocity", "rad/s", "omega_m"),
        ("LoadCellTorque", "Nm", "torque"),
        ("effort[name=ankle]", "N*m", "torque"),
        ("motor_torque", "N*m", "torque_m"),
        ("I_q", "A", "current"),
        ("motor_current", "mA", "current"),
        ("sync_out", "V", "sync"),
        ("Trig", "", "trigger"),
        ("torque", "deg", ""),
        ("angle", "V", ""),
        ("commanded_torque", "N*m", ""),
        ("R_ground_torque_y", "N*m", ""),
        ("velocity[name=ankle]", "rad/s", ""),
        ("case_temperature", "", ""),
        ("load", "Nm", "torque"),
        ("ch3", "deg", "theta"),
        ("roll", "deg", ""),
        ("battery", "A", ""),
        ("desired_current", "A", ""),
    ],
)
def test_a_name_and_its_unit_tell_the_column(name: str, unit: str, column: str) -> None:
    assert likely_column(channel(name, unit)) == column
    assert column in ("", *COLUMNS)


def test_of_many_channels_those_that_are_like_no_column_are_comments() -> None:
    names = ["ankle_angle", "torque_Nm", *(f"spare_{k}" for k in range(12))]
    lines = list(channel_lines([channel(name) for name in names]))
    assert [line.partition("  # ")[2] for line in lines[:2]] == ["theta?", "torque?"]
    assert [line[:10] for line in lines[:2]] == ["  NAME_1: ", "  NAME_2: "]
    assert all(line.startswith("#   NAME_") for line in lines[2:])
    few = list(channel_lines([channel(name) for name in names[:5]]))
    assert not any(line.startswith("#") for line in few)
