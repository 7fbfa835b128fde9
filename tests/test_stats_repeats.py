"""Means over repeated trials, and their summary tables."""

import numpy as np
import polars as pl
import pytest
from scipy.special import stdtrit
from scipy.stats import ttest_ind

from osl_analysis.bench.diagnostics import summary_of_trials
from osl_analysis.errors import InputError
from osl_analysis.stats.repeats import CommonError, over_repeats


def test_repeats_give_students_interval():
    values = [1.0, 2.0, 4.0]
    summary = over_repeats(values)
    half = 4.302652729911275 * np.std(values, ddof=1) / np.sqrt(3)
    assert (summary.mean, summary.high - summary.mean) == pytest.approx((7 / 3, half))
    with pytest.raises(InputError, match="repeat the experiment"):
        over_repeats([1.0])


def test_what_repeats_have_in_common_widens_the_interval_of_their_mean():
    values = [1.0, 2.0, 4.0, 3.0]
    own = np.var(values, ddof=1) / 4
    summary = over_repeats(values, [CommonError(own, 3)])
    assert summary.se == pytest.approx(np.sqrt(2 * own))
    assert summary.high - summary.mean == pytest.approx(stdtrit(6, 0.975) * np.sqrt(2 * own))
    assert over_repeats(values).high - 2.5 == pytest.approx(stdtrit(3, 0.975) * np.sqrt(own))


def test_a_mean_over_trials_says_where_its_interval_is_from():
    rows = summary_of_trials(pl.DataFrame({"a": [1.0, 3.0], "b": [1.0, None]}), ("a", "b")).to_dicts()
    assert [row["interval_method"] for row in rows] == ["Student", None]


def test_a_summary_of_a_column_without_numbers_has_no_mean():
    table = pl.DataFrame({"a": [None, None], "b": [2.0, None], "c": [1.0, 3.0]}, schema_overrides={"a": pl.Float64})
    rows = summary_of_trials(table, ("a", "b", "c")).to_dicts()
    assert [(r["n"], r["mean"], r["sd"] is None) for r in rows] == [(0, None, True), (1, 2.0, True), (2, 2.0, False)]
    assert summary_of_trials(table.clear(), ("a",))["mean"].to_list() == [None]


def test_kinds_of_trials_count_as_one_mean_each_and_their_difference_is_no_scatter():
    """The mean of two means has the error sqrt(s1^2/n1 + s2^2/n2)/2; Welch's degrees of freedom, by SciPy's test."""
    first, second = [1.0, 2.0, 3.0, 6.0], [101.0, 103.0, 107.0]
    summary = over_repeats([*first, *second], kinds=[1] * 4 + [-1] * 3)
    assert summary.mean == pytest.approx((3.0 + 311 / 3) / 2)
    assert summary.se == pytest.approx(np.sqrt(np.var(first, ddof=1) / 4 + np.var(second, ddof=1) / 3) / 2)
    interval = ttest_ind(first, second, equal_var=False).confidence_interval()
    assert summary.high - summary.low == pytest.approx((interval.high - interval.low) / 2)
    assert summary.sd == pytest.approx(np.sqrt((3 * np.var(first, ddof=1) + 2 * np.var(second, ddof=1)) / 5))
