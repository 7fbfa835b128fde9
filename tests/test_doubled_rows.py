"""Rows that stand twice, are missing, or belong to another trial, are told by their row."""

import numpy as np
import polars as pl
import pytest
from osl_analysis.ingest.doubled_rows import numbered_twice

from osl_analysis.errors import InputError
from osl_analysis.ingest.guard import lost_rows
from osl_analysis.ingest.raw_files import read_converted, read_source

RATE = 200.0
TIME = np.arange(2000) / RATE
ANGLE = 0.1 * np.sin(2 * np.pi * 1.3 * TIME) + 0.05 * np.sin(2 * np.pi * 2.9 * TIME)
TORQUE = 150 * ANGLE + 0.05 * np.random.default_rng(8).standard_normal(TIME.size)
DOUBLED = np.sort(np.r_[np.arange(TIME.size), 400, 777, 1210])


def rows_at(places):
    """The rows at these places, numbered anew."""
    return {"time": TIME[: len(places)], "theta": ANGLE[places], "torque": TORQUE[places]}


def test_a_row_that_was_written_twice_is_found_though_it_was_numbered_anew():
    table = pl.DataFrame({**rows_at(DOUBLED[:2000])})

    found = numbered_twice(table["time"].to_numpy(), table.drop("time"))

    assert found.tolist() == [401, 779, 1213]


def test_a_sample_that_was_missed_and_held_is_no_doubled_row():
    held = np.arange(TIME.size)
    held[[400, 777]] -= 1
    table = pl.DataFrame(rows_at(held))

    assert numbered_twice(TIME, table.drop("time")).size == 0


@pytest.mark.parametrize("step", [0.0, 2 * np.pi / 2**12])
def test_sound_rows_are_neither_doubled_nor_lost(step):
    angle = np.rint(ANGLE / step) * step if step else ANGLE
    table = pl.DataFrame({"theta": angle, "torque": np.rint(TORQUE)})

    assert numbered_twice(TIME, table).size == 0
    assert lost_rows(TIME, angle) is None


def test_rows_that_were_lost_before_they_were_numbered_are_told_by_their_row():
    kept = np.delete(np.arange(TIME.size), [1000, 1232])

    found = lost_rows(TIME[: kept.size], ANGLE[kept])

    assert found is not None
    assert (found.count, found.rows[0]) == (2, 1000)
    assert found.steps == pytest.approx(2.0, abs=0.05)


def read_table(folder, columns):
    """What ingest makes of a CSV file with these columns, and its remarks."""
    pl.DataFrame(columns).write_csv(folder / "log.csv")
    (folder / "csv.yaml").write_text(
        "format: csv\ntime: {column: time, unit: s}\nchannels:\n"
        "  theta: {column: theta, unit: rad}\n  torque: {column: torque, unit: N*m}\n"
    )
    converted = read_converted(folder / "log.csv", read_source(folder / "csv.yaml"))
    return converted.samples, converted.warnings


def test_doubled_rows_are_left_out_and_named(tmp_path):
    samples, (remark,) = read_table(tmp_path, rows_at(DOUBLED[:2000]))

    assert samples["theta"].to_list() == ANGLE[:1997].tolist()
    assert samples["time"].to_list() == TIME[:1997].tolist()
    assert "3 lines stand twice, first line 403" in remark


def test_rows_that_stand_twice_with_their_stamps_are_left_out_and_named(tmp_path):
    twice = np.r_[np.arange(1200), np.arange(1100, TIME.size)]
    columns = {"time": TIME[twice], "theta": ANGLE[twice], "torque": TORQUE[twice]}

    samples, (remark,) = read_table(tmp_path, columns)

    assert samples["theta"].to_list() == ANGLE.tolist()
    assert "100 lines stand twice, first line 1202" in remark


def test_a_second_trial_behind_the_first_is_told_by_its_line(tmp_path):
    columns = {
        "time": np.r_[TIME, TIME],
        "theta": np.r_[ANGLE, 2 * ANGLE],
        "torque": np.r_[TORQUE, 2 * TORQUE],
    }

    with pytest.raises(
        InputError, match=r"begins anew in line 2002.*cut the file before line 2002"
    ):
        read_table(tmp_path, columns)


def test_values_of_a_device_that_is_hardly_slower_than_its_log_are_no_doubled_rows():
    twice = np.floor(np.arange(TIME.size) * 0.98).astype(int)
    table = pl.DataFrame(rows_at(twice))

    assert (np.diff(twice) == 0).sum() > 30
    assert numbered_twice(TIME, table.drop("time")).size == 0


def test_values_that_a_log_misses_of_a_device_that_is_hardly_faster_are_no_lost_rows():
    read = np.floor(np.arange(1900) * 1.02).astype(int)

    assert lost_rows(TIME[: read.size], ANGLE[read]) is None
