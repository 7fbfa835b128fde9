"""A trial whose log is several files: a clamped actuator with one for each of its currents."""

import numpy as np
import pytest

from osl_analysis.commands.new_campaign import draft_campaign
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.trial import OWN_CLOCKS

CURRENTS = (0.5, -0.5, 1.0, 0.0, 10.0)  # A, in the order in which they were recorded
ROW = {"trial": "steps", "log": "level_*.csv", "log_source": "bench"}
SOURCE = """
format: csv
time: {column: "time [s]"}
channels:
  current: {column: "current [A]"}
  torque_m: {column: "torque [N*m]"}
"""


def write_logs(folder, begin_s, header="time [s],current [A],torque [N*m]"):
    """A log of two seconds for each current, which begins `begin_s` after the one before."""
    (folder / "bench.yaml").write_text(SOURCE)
    rng = np.random.default_rng(1)
    for number, ampere in enumerate(CURRENTS):
        time = begin_s * number + np.arange(200) / 100
        noise = 0.01 * rng.standard_normal((2, 200))
        columns = np.column_stack([time, ampere + noise[0], 0.8 * ampere + noise[1]])
        path = folder / f"level_{ampere:g}A.csv"
        np.savetxt(path, columns, "%.5f", ",", header=header, comments="")


def test_logs_of_one_clock_stand_when_they_were_recorded(tmp_path):
    write_logs(tmp_path, begin_s=60.0)

    trial = trial_from_files(ROW, tmp_path, tmp_path)

    time, current = trial.arrays("current")
    assert (len(time), time[0], time[-1]) == (1000, 0.0, pytest.approx(241.99))
    assert current.reshape(5, -1).mean(axis=1) == pytest.approx(CURRENTS, abs=0.01)
    assert OWN_CLOCKS not in trial.provenance["log"]
    parts = trial.provenance["files"]["log"]["parts"]
    assert len({part["sha256"] for part in parts}) == 5


def test_logs_whose_clocks_begin_anew_stand_in_the_order_of_their_names(tmp_path):
    """With numbers in their names in the order of numbers, `10` behind `2`."""
    write_logs(tmp_path, begin_s=0.0)

    trial = trial_from_files(ROW, tmp_path, tmp_path)

    time, current = trial.arrays("current")
    levels = current.reshape(5, -1).mean(axis=1)
    assert levels == pytest.approx([0.5, 0.0, 1.0, 10.0, -0.5], abs=0.01)
    assert np.diff(time).max() == pytest.approx(1.0)
    assert trial.provenance["log"][OWN_CLOCKS]
    assert any("begin anew" in text for text in trial.provenance["warnings"])


def test_a_name_that_no_file_has_is_refused(tmp_path):
    write_logs(tmp_path, begin_s=0.0)
    with pytest.raises(InputError, match=r"other_\*\.csv: no such file"):
        trial_from_files({**ROW, "log": "other_*.csv"}, tmp_path, tmp_path)


def test_a_draft_takes_logs_of_single_currents_for_one_trial(tmp_path):
    write_logs(tmp_path, begin_s=60.0)
    (tmp_path / "bench.yaml").unlink()

    draft = draft_campaign(tmp_path)

    cells = [trial.cells for trial in draft.trials]
    (row,) = cells
    assert (row["trial"], row["experiment"]) == ("level__A", "actuator")
    assert row["log"] == "level_*A.csv"


def test_a_draft_leaves_logs_of_whole_staircases_apart(tmp_path):
    time = np.arange(1800) / 100
    for number in range(3):
        rng = np.random.default_rng(number)
        current = np.repeat([0, 1, 2, 1, 0, -1, -2, -1, 0], 200) + 0.01 * rng.standard_normal(1800)
        columns = np.column_stack([time, current, 0.8 * current + 0.01 * rng.standard_normal(1800)])
        header = "time [s],current [A],torque [N*m]"
        np.savetxt(tmp_path / f"{number}.csv", columns, "%.5f", ",", header=header, comments="")

    draft = draft_campaign(tmp_path)

    assert [trial.cells["log"] for trial in draft.trials] == ["0.csv", "1.csv", "2.csv"]
