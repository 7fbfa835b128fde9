"""A torque that was computed from other signals of its log is no measurement."""

import numpy as np
import polars as pl
import pytest

from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.examine import check_own_torque
from osl_analysis.ingest.overview import inspect_recording
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.ingest.torque_formula import Signal, computed_from

TIME = np.arange(4000) / 200
TURN = 2 * np.pi * TIME
THETA = 0.08 * np.sin(0.7 * TURN) + 0.03 * np.sin(2.3 * TURN)
OMEGA = np.gradient(THETA, TIME)
CURRENT = 3 * np.sin(0.4 * TURN) + np.sin(1.9 * TURN + 1)
RNG = np.random.default_rng(5)
NOISE = RNG.standard_normal(TIME.size)

ANGLE = Signal("angle", "angle", np.round(THETA, 5))
SPEED = Signal("speed", "speed", np.round(OMEGA, 4))
DRIVE = Signal("current", "current", np.round(CURRENT, 3))
LOOKED_UP = np.interp(ANGLE.values, [-0.2, -0.05, 0.0, 0.1, 0.2], [-30.0, -4.0, 0.0, 12.0, 40.0])


@pytest.mark.parametrize(("torque", "found"), [
    (150 * ANGLE.values, "150 * 'angle'"),
    (np.round(150 * THETA + 3 * OMEGA, 4), "150 * 'angle' + 3 * 'speed'"),  # of what is not rounded
    (90 * ANGLE.values + 900 * ANGLE.values**3 + 7, "a function of 'angle'"),
    (LOOKED_UP, "a function of 'angle'"),
    (0.8 * DRIVE.values - np.sign(SPEED.values) * (0.3 + 0.05 * abs(DRIVE.values)),
     "a function of 'speed' and 'current'"),
    # measured
    (np.round(150 * THETA + 3 * OMEGA + 0.005 * NOISE, 4), ""),
    (np.round(150 * THETA + 0.05 * NOISE), ""),  # too coarse to tell
    (150 * THETA + 3 * np.tanh(OMEGA / 0.05), ""),
])  # fmt: skip
def test_a_function_of_the_log_to_within_rounding_is_found_and_no_other(torque, found):
    assert computed_from(torque, [ANGLE, SPEED, DRIVE]) == found


@pytest.mark.parametrize(("torque", "found"), [
    (np.round(150 * THETA + 3 * OMEGA, 4), "150 * 'angle' + 3 * 'dq'"),
    (2.5 * SPEED.values, ""),  # as of a load cell's own channel
])  # fmt: skip
def test_of_a_signal_of_unknown_kind_alone_no_torque_is_computed(torque, found):
    assert computed_from(torque, [ANGLE, Signal("dq", "other", SPEED.values)]) == found


@pytest.mark.parametrize(("name", "values", "refused"), [
    ("motor_A", np.round(CURRENT, 3), True),
    ("ch1", np.round(CURRENT, 3), False),  # may be the load cell's
    ("cell_V", np.round(CURRENT, 3), False),
])  # fmt: skip
def test_columns_that_no_source_file_names_are_candidates(tmp_path, name, values, refused):
    torque = 1.31 * values - 2 * ANGLE.values  # as without a weight on the joint
    table = {"time": TIME, "angle": ANGLE.values, "torque": torque, name: values}
    pl.DataFrame(table).write_csv(tmp_path / "log.csv")
    (tmp_path / "csv.yaml").write_text(
        "{format: csv, clock: master, time: {column: time, unit: s}, channels: {theta: {column:"
        " angle, unit: rad}, torque: {column: torque, unit: N*m}}}"
    )
    row = {"trial": "a", "log": "log.csv", "log_source": "csv"}

    trial = trial_from_files(row, tmp_path, tmp_path)

    assert ("computed_from" in trial.provenance["columns"]["torque"]) is refused


def test_the_deflection_of_a_spring_between_two_encoders_is_a_measurement():
    motor = np.round(THETA + 0.02 * np.sin(1.3 * TURN), 5)
    deflection = 600 * (motor - ANGLE.values)
    command = Signal("command", "angle", motor, is_command=True)

    assert computed_from(deflection, [ANGLE, Signal("motor", "angle", motor)]) == ""
    assert computed_from(deflection, [ANGLE, command]) == "-600 * 'angle' + 600 * 'command'"


def test_a_draft_takes_the_measured_one_and_a_fit_refuses_the_other(tmp_path):
    table = {
        "time [s]": TIME,
        "ankle_angle [rad]": ANGLE.values,
        "ankle_velocity [rad/s]": SPEED.values,
        "ankle_torque [N*m]": np.round(150 * ANGLE.values + 3 * SPEED.values, 5),
        "loadcell_torque [N*m]": 150 * THETA + 3 * OMEGA + 0.05 * NOISE,
    }
    pl.DataFrame(table).write_csv(tmp_path / "log.csv")
    draft = draft_source(inspect_recording(tmp_path / "log.csv"), "log.csv")
    assert 'torque: {column: "loadcell_torque"' in draft

    wrong = draft.replace('torque: {column: "loadcell_torque"', 'torque: {column: "ankle_torque"')
    (tmp_path / "csv.yaml").write_text(wrong)
    row = {"trial": "a", "log": "log.csv", "log_source": "csv"}
    trial = trial_from_files(row, tmp_path, tmp_path)

    with pytest.raises(InputError, match=r"150 \* 'ankle_angle' \+ 3 \* 'ankle_velocity'") as error:
        check_own_torque(trial)
    assert "'loadcell_torque'" in error.value.remedy
