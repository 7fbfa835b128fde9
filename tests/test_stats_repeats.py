"""Means over trials, and rival models over trials."""

import numpy as np
import polars as pl
import pytest
from scipy.special import stdtrit
from scipy.stats import t as student
from scipy.stats import ttest_ind

from osl_analysis.errors import InputError
from osl_analysis.judge.doubts import summary_of_trials
from osl_analysis.signals import LowPass
from osl_analysis.stats.repeats import (
    Candidate,
    effective_samples,
    mean_over_trials,
    over_repeats,
    rank_words,
    score_models,
)


def test_what_repeats_have_in_common_widens_the_interval_of_their_mean():
    values = [1.0, 2.0, 4.0, 3.0]
    own = np.var(values, ddof=1) / 4
    summary = over_repeats(values, [(own, 3)])
    assert summary.se == pytest.approx(np.sqrt(2 * own))
    assert summary.high - summary.mean == pytest.approx(stdtrit(6, 0.975) * np.sqrt(2 * own))
    assert over_repeats(values).high - 2.5 == pytest.approx(stdtrit(3, 0.975) * np.sqrt(own))


def test_a_mean_over_trials_says_where_its_interval_is_from_and_one_without_numbers_is_null():
    table = pl.DataFrame({"a": [None, None], "b": [2.0, None], "c": [1.0, 3.0]}, schema_overrides={"a": pl.Float64})
    rows = summary_of_trials(table, ("a", "b", "c")).to_dicts()
    found = [(r["n"], r["mean"], r["sd"] is None, r["interval_method"]) for r in rows]
    assert found == [(0, None, True, None), (1, 2.0, True, None), (2, 2.0, False, "Student")]
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


LOW_PASS = LowPass(15)


def test_effective_samples_are_those_of_theory():
    """White noise has n; AR(1) has n (1 - r^2)/(1 + r^2) (Bayley and Hammersley): within 10 % for 20 000 samples."""
    rng = np.random.default_rng(4)
    white = rng.standard_normal(20_000)
    assert effective_samples(white) == pytest.approx(20_000, rel=0.1)
    r, correlated = 0.9, np.zeros(20_000)
    for i in range(1, 20_000):
        correlated[i] = r * correlated[i - 1] + white[i]
    assert effective_samples(correlated) == pytest.approx(20_000 * (1 - r**2) / (1 + r**2), rel=0.1)
    band = LOW_PASS(white, 1000.0)
    assert effective_samples(band) == pytest.approx(20_000 * 2 * 15 / 1000, rel=0.15)
    thinned = effective_samples(band[::11])
    assert thinned == pytest.approx(effective_samples(band), rel=0.15), "thinning a filtered signal loses nothing"
    assert effective_samples(np.zeros(50)) == effective_samples(np.full(50, 0.3)) == 50, "an exact fit"


@pytest.mark.parametrize("size", [0.0, 1e-15])
def test_of_models_that_fit_exactly_the_one_with_fewest_parameters_ranks_first(size):
    """Whether rounding leaves zeros or 1e-15 N*m depends on the processor; the ranks must not."""
    rng = np.random.default_rng(8)
    torque, nothing = rng.standard_normal(500), size * rng.standard_normal(500)
    scores = score_models(torque, [Candidate("", "", p, nothing, nothing) for p in (3, 2)])
    assert scores["rank"].to_list() == [2, 1]
    assert scores["BIC"].is_finite().all()


def test_bic_charges_a_parameter_the_logarithm_of_the_effective_samples():
    rng = np.random.default_rng(5)
    torque, left = rng.standard_normal(500), 0.1 * rng.standard_normal(500)
    few, many = (Candidate("", "", p, left, left) for p in (2, 5))
    scores = score_models(torque, [few, many])
    m, (bic_of_few, bic_of_many) = scores["effective_samples"][0], scores["BIC"]
    assert bic_of_many - bic_of_few == pytest.approx(3 * np.log(m))
    assert bic_of_few == pytest.approx(m * np.log(np.mean(left**2)) + 2 * np.log(m))
    assert scores["rank"].to_list() == [1, 2]


def test_paired_differences_tell_models_apart_that_their_own_scatter_hides():
    """Trials differ by 100, the models by 1 +- 0.1 in every trial."""
    rng = np.random.default_rng(1)
    trial = rng.normal(0, 100, 10)
    loss = np.column_stack([trial, trial - 1 + rng.normal(0, 0.1, 10), trial + 3])
    assert rank_words(loss) == ["worse", "preferred", "worse"]
    assert mean_over_trials(loss[:, 0]).low < mean_over_trials(loss[:, 1]).mean < mean_over_trials(loss[:, 0]).high


def test_of_models_that_tie_the_first_is_preferred_although_another_has_the_smaller_mean():
    loss = np.array([[1.0, 0.9, 5.0], [1.0, 1.2, 5.0], [1.0, 0.8, 5.0]])
    assert rank_words(loss) == ["preferred", "tied", "worse"]


def test_a_single_trial_tells_nothing_apart_and_has_no_interval():
    assert rank_words(np.array([[1.0, 0.0]])) == ["preferred", "tied"]
    assert rank_words(np.zeros((0, 2))) == [None, None]
    alone = mean_over_trials(np.array([4.0]))
    assert (alone.n, alone.mean) == (1, 4.0)
    assert np.isnan([alone.sd, alone.low, alone.high]).all()


def test_intervals_are_students_and_wider_where_trials_share_their_fits():
    """Own trials: s / sqrt(n), n - 1 degrees of freedom. Shared: s^2 (1/n + 1/(n - 1)) after Nadeau and Bengio. Both
    terms are of one scatter, which is worth n - 1 degrees of freedom and not the sum of two independent ones."""
    values = np.array([1.0, 2.0, 4.0, 7.0])
    own, shared = mean_over_trials(values), mean_over_trials(values, shared=True)
    assert own.high - own.mean == pytest.approx(student.ppf(0.975, 3) * np.std(values, ddof=1) / 2)
    assert shared.se**2 == pytest.approx(np.var(values, ddof=1) * (1 / 4 + 1 / 3))
    assert (shared.high - shared.mean) / shared.se == pytest.approx(student.ppf(0.975, 3))
    assert shared.mean == own.mean == over_repeats(values).mean == 3.5
    assert over_repeats(values).high == own.high
    with pytest.raises(InputError, match="repeat the experiment"):
        over_repeats([1.0])
