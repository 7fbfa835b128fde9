"""A torque that was computed from other signals of its log is no measurement."""

import numpy as np
import polars as pl
import pytest

from osl_analysis.draft.draft_source import draft_source
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.errors import InputError
from osl_analysis.ingest.guard import check_own_torque
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.measured import Signal, computed_from

TIME = np.arange(4000) / 200
TURN = 2 * np.pi * TIME
THETA = 0.08 * np.sin(0.7 * TURN) + 0.03 * np.sin(2.3 * TURN)
OMEGA = np.gradient(THETA, TIME)
CURRENT = 3 * np.sin(0.4 * TURN) + np.sin(1.9 * TURN + 1)
NOISE = np.random.default_rng(5).standard_normal(TIME.size)

ANGLE = Signal("angle", "angle", np.round(THETA, 5))
SPEED = Signal("speed", "speed", np.round(OMEGA, 4))
DRIVE = Signal("current", "current", np.round(CURRENT, 3))
MOTOR = np.round(THETA + 0.02 * np.sin(1.3 * TURN), 5)
DEFLECTION = 600 * (MOTOR - ANGLE.values)


@pytest.mark.parametrize(("torque", "signals", "names"), [
    (150 * ANGLE.values, [ANGLE], "'angle'"),
    (90 * ANGLE.values + 900 * ANGLE.values**3 + 7, [ANGLE], "'angle'"),
    (np.round(150 * THETA + 3 * OMEGA, 4), [ANGLE, SPEED], "'angle' and 'speed'"),
    (150 * ANGLE.values + 3 * np.gradient(ANGLE.values, TIME), [ANGLE], "'angle'"),
    (0.8 * DRIVE.values - np.sign(SPEED.values) * (0.3 + 0.05 * abs(DRIVE.values)),
     [SPEED, DRIVE], "'speed' and 'current'"),
    (DEFLECTION, [ANGLE, Signal("goal", "command", MOTOR)], "'angle' and 'goal'"),
    # measured
    (np.round(150 * THETA + 3 * OMEGA + 0.005 * NOISE, 4), [ANGLE, SPEED], ""),
    (np.round(150 * THETA + 0.05 * NOISE), [ANGLE], ""),
    (150 * THETA + 3 * np.tanh(OMEGA / 0.05), [ANGLE, SPEED], ""),
    (DEFLECTION, [ANGLE, Signal("motor", "angle", MOTOR)], ""),  # of a spring between encoders
    (150 * ANGLE.values[:100], [Signal("angle", "angle", ANGLE.values[:100])], ""),  # too short
])  # fmt: skip
def test_a_torque_is_computed_where_other_signals_leave_less_than_a_sensor_does(
    torque, signals, names
):
    assert computed_from(torque, signals) == names


def test_a_fit_refuses_the_computed_one_of_two_that_a_draft_asks_about(tmp_path):
    table = {
        "time [s]": TIME,
        "ankle_angle [rad]": ANGLE.values,
        "ankle_velocity [rad/s]": SPEED.values,
        "ankle_torque [N*m]": np.round(150 * ANGLE.values + 3 * SPEED.values, 5),
        "loadcell_torque [N*m]": 150 * THETA + 3 * OMEGA + 0.05 * NOISE,
    }
    pl.DataFrame(table).write_csv(tmp_path / "log.csv")
    draft = draft_source(inspect_recording(tmp_path / "log.csv"), "log.csv")
    lines = [line for line in draft.splitlines() if '"loadcell_torque"' not in line]
    (tmp_path / "csv.yaml").write_text("\n".join(lines).replace("NAME_3", "torque"))
    row = {"trial": "a", "log": "log.csv", "log_source": "csv"}
    trial = trial_from_files(row, tmp_path, tmp_path)

    with pytest.raises(InputError, match="from 'ankle_angle' and 'ankle_velocity'"):
        check_own_torque(trial)


def test_a_torque_in_a_table_of_degrees_is_not_computed_from_itself(tmp_path):
    torque = 150 * THETA + 3 * OMEGA + 0.05 * NOISE
    columns = np.column_stack([TIME, np.rad2deg(THETA), torque])
    names = "time\tankle_angle_r\tankle_torque_r"
    head = ("Coordinates", "version=1", f"nRows={TIME.size}", "nColumns=3", "inDegrees=yes")
    header = "\n".join([*head, "endheader", names])
    np.savetxt(tmp_path / "a.mot", columns, "%.6f", "\t", header=header, comments="")
    (tmp_path / "source.yaml").write_text(
        "format: opensim\nclock: master\ntime: {column: time, unit: s}\nchannels:\n"
        "  theta: {column: ankle_angle_r, unit: deg}\n"
        "  torque: {column: ankle_torque_r, unit: 'N*m'}\n"
    )

    row = {"trial": "a", "log": "a.mot", "log_source": "source"}

    check_own_torque(trial_from_files(row, tmp_path, tmp_path))
