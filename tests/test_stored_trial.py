"""A trial that stays in its file gives what the trial in memory gives."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from osl_analysis import stored_trial
from osl_analysis.errors import InputError
from osl_analysis.stored_trial import StoredTrial, open_trial
from osl_analysis.timebase.gaps import GapLimits
from osl_analysis.trial import Trial, read_trial, write_trial
from osl_analysis.uniform import uniform_signals

ORIGIN = {"columns": {"torque": {"delay": 2e-4}}}


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """Two devices of 500 Hz, one with jitter that is true, and a value that is missing from the log."""
    random, taken = np.random.default_rng(5), np.arange(3000) / 500
    jittered = taken + 2e-5 * random.standard_normal(3000)
    angle = pl.DataFrame({"time": jittered, "theta": np.sin(5 * jittered), "theta_command": np.sin(5 * taken)})
    torque = np.where(np.arange(3000) == 700, np.nan, np.cos(5 * taken))
    both = pl.concat([angle, pl.DataFrame({"time": taken + 1e-3, "torque": torque})], how="diagonal").sort("time")
    write_trial(Trial("two devices", both, ORIGIN), tmp_path / "two.parquet")
    return tmp_path / "two.parquet"


def test_every_column_of_a_stored_trial_is_that_of_the_trial_in_memory(stored: Path) -> None:
    memory, file = read_trial(stored), StoredTrial(stored)
    assert (file.name, file.provenance, list(file.columns)) == (memory.name, ORIGIN, memory.samples.columns)
    assert file.samples.equals(memory.samples)
    for column in ("theta", "torque"):
        assert file.sampled(column).equals(memory.sampled(column))
        np.testing.assert_array_equal(file.present(column), memory.present(column))
        for one, other in zip(file.arrays(column), memory.arrays(column), strict=True):
            np.testing.assert_array_equal(one, other)
    assert file.present("torque").sum() == 3000


def test_a_stored_trial_has_the_time_base_of_the_trial_in_memory(stored: Path) -> None:
    one, other = (
        uniform_signals(trial, ("theta", "torque"), GapLimits(), ("theta_command",))
        for trial in (read_trial(stored), StoredTrial(stored))
    )
    assert one.report == other.report
    assert set(one.signals) == {"theta", "torque"}
    for column in one.signals:
        np.testing.assert_array_equal(one[column], other[column])


def test_only_a_long_trial_stays_in_its_file(stored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert type(open_trial(stored)) is Trial
    monkeypatch.setattr(stored_trial, "LONG", 6000 * 4 - 1)
    assert type(open_trial(stored)) is StoredTrial
    monkeypatch.setattr(stored_trial, "LONG", 6000 * 4)
    assert type(open_trial(stored)) is Trial


def test_what_is_no_trial_is_refused_as_by_reading_it(stored: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no column 'velocity'; map the channel"):
        StoredTrial(stored).arrays("velocity")
    with pytest.raises(InputError, match="no such trial; ingest it first"):
        open_trial(tmp_path / "none.parquet")
    (tmp_path / "text.parquet").write_text("no parquet")
    with pytest.raises(InputError, match="not a Parquet file"):
        open_trial(tmp_path / "text.parquet")
    pl.DataFrame({"time": [0.0, 1.0]}).write_parquet(tmp_path / "plain.parquet")
    with pytest.raises(InputError, match="Parquet without provenance"):
        StoredTrial(tmp_path / "plain.parquet")


def test_time_that_goes_back_is_refused_in_a_stored_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Trial, "__post_init__", lambda trial: None)
    write_trial(Trial("back", pl.DataFrame({"time": [0.0, 2.0, 1.0]})), tmp_path / "back.parquet")
    with pytest.raises(InputError, match="back: time goes from 2"):
        StoredTrial(tmp_path / "back.parquet")


def test_signals_that_are_released_leave_what_is_known_of_the_time_base(stored: Path) -> None:
    whole = uniform_signals(StoredTrial(stored), ("theta", "torque"), GapLimits(), ("theta_command",))
    assert np.isfinite(whole.as_recorded("torque")).all()
    assert (len(whole.as_recorded("torque")), len(whole.as_recorded("theta"))) == (2999, 3000)
    released, command = whole.released(), whole.computed("theta_command")
    assert command is not None
    np.testing.assert_allclose(command, np.sin(5 * whole.time), atol=1e-3)
    assert (released.report, released.trial) == (whole.report, whole.trial)
    assert not released.signals
    assert released.computed("theta_command") is None
    assert not any(one.stream.signals for one in released.grid.taken if "theta" in one.decision.signals)
    for column in ("theta", "torque"):
        np.testing.assert_array_equal(released.sampled(column), whole.sampled(column))
