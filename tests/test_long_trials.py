"""What is done to a long trial some rows at a time: the same as at once, in little memory beside its signals."""

import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from osl_analysis import stored_trial
from osl_analysis.bench.series import Series
from osl_analysis.pieces import pieces
from osl_analysis.signals import LowPass
from osl_analysis.stats import rounding
from osl_analysis.stats.rounding import distinct_values, even_values, surely_more, visible_step
from osl_analysis.stored_trial import StoredTrial
from osl_analysis.timebase.grid import one_time_base
from osl_analysis.timebase.stream import Stream
from osl_analysis.trial import Trial, write_trial

SAMPLES = 100_000


def bytes_per_sample(work: Callable[[], Any]) -> float:
    """Largest memory of numpy's arrays in some work on `SAMPLES` samples, per sample."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / SAMPLES
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("true", "most"), [(False, 50), (True, 60)])
def test_the_time_base_takes_few_arrays_beside_the_signals(true: bool, most: float) -> None:
    """Two signals, the grid and its rows are 25 bytes per sample if they are not those that came in."""
    random, taken = np.random.default_rng(1), np.arange(SAMPLES) / 1000
    stamps = taken + true * 2e-5 * random.uniform(-1, 1, SAMPLES)
    signals = {"theta": np.sin(20 * stamps), "torque": np.cos(20 * stamps)}
    one_time_base([Stream("both", stamps[:1000], {"theta": signals["theta"][:1000]})])  # what is loaded once
    assert bytes_per_sample(lambda: one_time_base([Stream("both", stamps, signals)])) < most


def test_a_signal_is_filtered_in_the_place_of_one_copy() -> None:
    signal, low_pass = np.random.default_rng(2).standard_normal(SAMPLES), LowPass(15.0)
    low_pass(signal[:1000], 1000.0)
    assert bytes_per_sample(lambda: low_pass(signal, 1000.0)) < 14


def test_a_stored_trial_is_read_some_rows_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every third row in turn one column has a sample; the last piece is not full."""
    turn, time = np.arange(5000) % 3, np.arange(5000.0)
    column = pl.Series("theta", np.where(turn == 1, np.sin(time), np.nan), nan_to_null=True)
    write_trial(Trial("long", pl.DataFrame({"time": time}).with_columns(column)), tmp_path / "long.parquet")
    monkeypatch.setattr(stored_trial, "AT_ONCE", 700)
    stamps, theta = StoredTrial(tmp_path / "long.parquet").arrays("theta")
    np.testing.assert_array_equal(stamps, time[turn == 1])
    np.testing.assert_array_equal(theta, np.sin(time[turn == 1]))


def test_distinct_values_are_sought_some_rows_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.round(np.random.default_rng(3).standard_normal(5000), 1)
    monkeypatch.setattr(rounding, "AT_ONCE", 700)
    np.testing.assert_array_equal(distinct_values(values, most=5000), np.unique(values))
    assert distinct_values(values, most=len(np.unique(values)) - 1) is None


def test_a_signal_has_surely_more_values_only_where_it_has_more() -> None:
    rng = np.random.default_rng(3)
    assert surely_more(rng.standard_normal(20_000), 10_000)
    for signal in (rng.standard_normal(20_000), rng.integers(-300, 300, 20_000) * 0.1, np.tile([0.0, -0.0], 10)):
        assert not surely_more(signal, len(np.unique(signal)))


def test_values_that_are_whole_steps_apart_are_found_without_a_list_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of signals on steps of a converter, in floats of four bytes too; one value beside the steps is seen."""
    random = np.random.default_rng(5)
    turns = 0.003 * np.rint(200 * np.sin(np.linspace(0, 60, 40_000)) + random.standard_normal(40_000)) + 0.0007
    monkeypatch.setattr(rounding, "pieces", partial(pieces, size=777))
    found, expected = even_values(turns, most=20_000), np.unique(np.rint((turns - 0.0007) / 0.003)) * 0.003 + 0.0007
    assert found is not None
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert even_values(turns, most=300) is None
    assert even_values(turns.astype(np.float32).astype(float), most=20_000) is None
    assert visible_step(turns.astype(np.float32).astype(float)) == pytest.approx(0.003, rel=1e-3)
    beside = turns.copy()
    beside[17_777] += 0.001
    assert even_values(beside, most=20_000) is None
    doubled = np.where(np.arange(40_000) % 39 == 0, 2 * np.rint(turns / 0.006), np.rint(turns / 0.003)) * 0.003
    assert visible_step(doubled) == pytest.approx(0.003, rel=1e-9)  # those that are tried show every other step


@pytest.mark.parametrize("most", [7, 10_000])
def test_no_outlier_of_a_long_residual_is_lost(most: int) -> None:
    random, n = np.random.default_rng(4), 40_000
    torque, modelled, fitted = random.standard_normal(n), random.standard_normal(n), random.random(n) < 0.7
    table = Series(np.arange(n) / 1000, torque, modelled, np.zeros(n), fitted).table(most)
    step = -(-n // most)
    own = [(torque - modelled)[k : k + step][fitted[k : k + step]] for k in range(0, n, step)]
    low, high = ([f(part) if part.size else None for part in own] for f in (np.min, np.max))
    for name, expected in (("residual_low", low), ("residual_high", high)):
        assert table[name].to_list() == pl.Series(expected, dtype=pl.Float64).round_sig_figs(7).to_list()
