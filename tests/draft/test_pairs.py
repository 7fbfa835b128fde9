# SPDX-License-Identifier: Apache-2.0
"""Logs of two recorders of one trial, as a draft pairs them."""

import numpy as np
import pytest

from osl_analysis.draft.draft_campaign import draft_campaign

TIME = np.arange(0, 30, 0.005)
ANGLE = 4 * np.sin(5.1 * TIME) + 2 * np.sin(11 * TIME)
OTHER = 4 * np.sin(7.7 * TIME)


def write(folder, **columns_of):
    """CSV files by their names, of a column each with its time."""
    for name, (head, values) in columns_of.items():
        rows = [f"{t:.4f},{x:.5f}" for t, x in zip(TIME, values, strict=False)]
        (folder / f"{name}.csv").write_text("\n".join([f"time_s,{head}", *rows, ""]))


ENCODER = ("knee_angle_deg", ANGLE)
LOAD_CELL = ("torque_Nm", -3 * ANGLE)


@pytest.mark.parametrize("second", ["k30_run1_torque", "torque_k30_run1"])
def test_files_whose_names_differ_by_a_word_are_one_trial(tmp_path, second):
    write(tmp_path, k30_run1=ENCODER, **{second: LOAD_CELL})

    draft = draft_campaign(tmp_path)

    (trial,) = [trial.cells for trial in draft.trials]
    assert (trial["log"], trial["log_2"]) == ("k30_run1.csv", f"{second}.csv")
    assert (trial["experiment"], trial["joint"]) == ("impedance", "knee")
    torque = draft.source_files[trial["log_2_source"]]
    assert torque.settings["clock"] == "start"
    assert torque.named["torque"].fields["sign"] == -1
    assert any("`clock: start`" in question for question, _ in draft.open)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"x": ENCODER, "x_torque": ("torque_Nm", OTHER)}, "does not follow"),
        ({"x": ENCODER, "x_torque": LOAD_CELL, "x_load": ("torque_Nm", 2 * ANGLE)}, "several"),
        ({"x_1": ENCODER, "x_2_torque": LOAD_CELL}, "missing"),
    ],
)
def test_files_that_may_not_be_one_trial_are_asked_and_each_keeps_its_row(tmp_path, files, message):
    write(tmp_path, **files)

    draft = draft_campaign(tmp_path)

    assert [trial.cells["log"] for trial in draft.trials] == [
        f"{name}.csv" for name in sorted(files)
    ]
    assert any(message in question for question, _ in draft.open)


def test_logs_of_another_day_or_run_are_no_pair(tmp_path):
    write(tmp_path, **{"2026-03-04_knee": ENCODER, "2026-03-05_knee": LOAD_CELL})

    assert not any("log_2" in trial.cells for trial in draft_campaign(tmp_path).trials)
