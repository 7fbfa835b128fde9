"""Rows that were lost, joined, wrong or written twice are told by their row, and once."""

import numpy as np
import polars as pl
import pytest
from osl_analysis.ingest.row_faults import find_row_faults, row_faults_of, with_row_faults

from osl_analysis.trial import Trial

RATE_HZ = 500.0
TIME = np.arange(6000) / RATE_HZ
TURN = 2 * np.pi * TIME
THETA = 0.06 * np.sin(0.9 * TURN) + 0.02 * np.sin(2.7 * TURN)
TORQUE = 150 * THETA + 0.04 * np.random.default_rng(1).standard_normal(TIME.size)


def trial_of(rows) -> Trial:
    """The sound recording's rows, in this order and numbered anew."""
    time = np.arange(len(rows)) / RATE_HZ
    columns = {"time": time, "theta": THETA[rows], "torque": TORQUE[rows]}
    return Trial("a", pl.DataFrame(columns), {"warnings": []})


def test_a_sound_recording_has_no_fault():
    faults = find_row_faults(trial_of(np.arange(6000)))

    assert (faults.count, faults.texts) == (0, [])


def test_lost_rows_are_told_by_the_row_behind_them():
    trial = with_row_faults(trial_of(np.delete(np.arange(6000), slice(3000, 3090))))

    (warning,) = trial.provenance["warnings"]
    assert warning.startswith("theta and torque leap in row 3001 (6.000 s) and go on elsewhere:")


def test_values_that_come_back_are_told_as_such_and_are_no_lost_rows():
    rows = np.arange(6000)
    rows[3000:3004] = 1450

    faults = find_row_faults(trial_of(rows))

    assert faults.breaks == []
    assert "is back in row 3005: values of no sensor" in faults.texts[0]


def test_a_block_that_stands_twice_is_left_out_and_what_follows_is_numbered_anew():
    rows = np.concatenate([np.arange(3000), np.arange(2800, 6000)])

    trial = with_row_faults(trial_of(rows))

    assert trial.provenance["warnings"][0].startswith("rows 3001 to 3200 repeat the 200 rows")
    assert trial.samples.equals(trial_of(np.arange(6000)).samples)
    assert len(trial.provenance["warnings"]) == 1


def test_a_block_of_a_motion_that_repeats_itself_stands_once():
    period = 1000
    columns = {"theta": np.tile(THETA[:period], 6), "torque": np.tile(TORQUE[:period], 6)}
    trial = Trial("a", pl.DataFrame({"time": TIME, **columns}))

    assert len(with_row_faults(trial).samples) == len(trial.samples)


@pytest.mark.parametrize(("windows", "count"), [("0-5", 0), ("5-9", 1)])
def test_what_ingest_noted_counts_where_its_rows_are_analysed(windows, count):
    trial = with_row_faults(trial_of(np.delete(np.arange(6000), slice(3000, 3090))))

    assert row_faults_of(trial.within(windows)).count == count


def test_the_parts_between_faults_are_what_can_be_analysed():
    trial = trial_of(np.delete(np.arange(6000), slice(3000, 3090)))

    first, second = find_row_faults(trial).windows(trial)

    assert first == pytest.approx((0.0, 5.8))
    assert second == pytest.approx((6.2, TIME[5909]))


def test_an_actuator_alone_is_told_by_its_angle():
    rows = np.delete(np.arange(6000), slice(3000, 3090))
    samples = trial_of(rows).samples.rename({"theta": "theta_m", "torque": "torque_m"})

    faults = find_row_faults(Trial("a", samples))

    assert [leaps.rows for leaps in faults.leaps] == [(3001,)]


def test_a_trial_that_is_cut_to_its_windows_begins_with_the_first():
    trial = trial_of(np.arange(6000))

    cut, windows = trial.cut_to("2-5.004 7-9")

    assert (cut.samples["time"][0], cut.samples["time"][-1]) == (2.0, 9.0)
    assert cut.within(windows).samples.equals(trial.within("2-5.004 7-9").samples)


def test_a_gap_parts_a_recording_as_well():
    rows = np.delete(np.arange(6000), slice(3000, 3600))
    columns = {"time": TIME[rows], "theta": THETA[rows], "torque": TORQUE[rows]}
    trial = Trial("a", pl.DataFrame(columns))

    found = find_row_faults(trial)

    assert found.count == 0
    assert found.windows(trial) == [(0.0, TIME[2999]), (TIME[3600], TIME[5999])]


def test_a_channel_that_stands_is_told_as_frozen_and_left_out_as_long_as_it_stands():
    torque = TORQUE.copy()
    torque[3000:3700] = torque[3000]
    torque[3700:] += 2.0  # so that it leaps where it moves on
    trial = Trial("a", trial_of(np.arange(6000)).samples.with_columns(torque=pl.Series(torque)))

    faults = find_row_faults(trial)

    (text,) = faults.texts
    assert text.startswith("torque repeats one value in 700 rows before row 3701 (7.400 s)")
    first, second = faults.windows(trial)
    assert first[1] == pytest.approx(5.8, abs=0.01)
    assert second[0] == pytest.approx(7.6, abs=0.01)
