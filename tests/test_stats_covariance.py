"""Covariance of correlated residuals: the spread of cycles, autocorrelation behind a filter, degrees of freedom."""

from dataclasses import replace

import numpy as np
import pytest
import statsmodels.api as sm

from osl_analysis.stats.covariance import (
    between_cycles,
    moving_sums,
    products_between,
    welch_satterthwaite,
)
from osl_analysis.stats.regression import linear_fit

CYCLE, COUNT = 50, 24


def repeated(rng, noise=0.3):
    """A friction-like residual that every cycle repeats, different in the two strata, and white noise."""
    n = CYCLE * COUNT
    t = np.arange(n) / CYCLE
    columns = {"a": np.sin(2 * np.pi * t), "b": np.cos(2 * np.pi * t), "offset": np.ones(n)}
    friction = np.sign(columns["b"]) * np.where(t < COUNT / 2, 1.0, 2.0)
    edges = np.arange(COUNT + 1.0) * CYCLE
    cycles = edges[:-1], edges[1:], np.repeat([0, 1], COUNT // 2)
    return 3 * columns["a"] + friction + noise * rng.standard_normal(n), columns, cycles


def with_spread(y, columns, first, stop, stratum):
    """The fit with the covariance of the spread of cycles."""
    fit, X = linear_fit(y, columns), np.column_stack(list(columns.values()))
    scores = products_between(X, fit.residual[:, None], first, stop)[..., 0] @ np.linalg.inv(X.T @ X)
    covariance, freedom = between_cycles(scores, stratum)
    return replace(fit, covariance=covariance, degrees_of_freedom=freedom)


def test_the_spread_of_cycles_covers_where_friction_fools_hac():
    """95 % of 600 seeded records; HAC takes the friction for noise and is several times too wide."""
    rng, covered = np.random.default_rng(4), 0
    truth = linear_fit(repeated(rng, noise=0.0)[0], repeated(rng)[1])["b"]
    for _ in range(600):
        y, columns, cycles = repeated(rng)
        fit = with_spread(y, columns, *cycles)
        low, high = fit.interval("b")
        covered += low <= truth <= high
    assert 0.93 < covered / 600 < 0.97
    assert linear_fit(y, columns).se("b") > 3 * fit.se("b")


def test_cycles_that_are_no_whole_rows_have_the_sums_that_their_integrals_have():
    period, edges = 250 / 3, 250 / 3 * np.arange(1, 9)
    turn = 2 * np.pi * np.arange(800) / period
    X = np.column_stack([np.cos(turn), np.sin(turn), np.ones(800)])
    found = products_between(X, X, edges[:-1], edges[1:])
    assert found == pytest.approx(np.broadcast_to(np.diag([0.5, 0.5, 1.0]) * period, found.shape), abs=2e-3)


def test_one_stratum_is_statsmodels_cluster_covariance():
    y, columns, cycles = repeated(np.random.default_rng(5))
    groups = np.repeat(np.arange(COUNT), CYCLE)
    fit = with_spread(y, columns, *cycles[:2], np.zeros(COUNT, dtype=np.intp))
    other = sm.OLS(y, np.column_stack(list(columns.values()))).fit(
        cov_type="cluster", cov_kwds={"groups": groups, "use_correction": False}
    )
    assert fit.covariance == pytest.approx(other.cov_params() * COUNT / (COUNT - 1), rel=1e-8, abs=1e-15)


def test_equal_strata_are_worth_the_sum_of_their_degrees_of_freedom_and_one_noisy_stratum_its_own():
    rng = np.random.default_rng(6)
    sums = rng.standard_normal((4000, 1))
    stratum = np.repeat(np.arange(2), 2000)
    _, freedom = between_cycles(sums, stratum)
    assert freedom[0] == pytest.approx(3998, rel=0.01)
    sums[:2000] *= 1e-6
    _, freedom = between_cycles(sums, stratum)
    assert freedom[0] == pytest.approx(1999, rel=0.01)


def test_hac_is_worth_as_many_degrees_of_freedom_as_its_variance_says():
    """The scatter of the variance estimate of white scores: 2/freedom of its square."""
    rng, n, window = np.random.default_rng(7), 600, 60
    variances = [moving_sums(rng.standard_normal((n, 1)), window)[0][0, 0] for _ in range(3000)]
    _, freedom = moving_sums(rng.standard_normal((n, 1)), window)
    assert 2 * np.mean(variances) ** 2 / np.var(variances) == pytest.approx(freedom[0] + 1, rel=0.12)


def test_degrees_of_freedom_of_a_sum_are_those_of_welch_and_satterthwaite():
    assert welch_satterthwaite([1.0, 1.0], [5, 5]) == pytest.approx(10)
    assert welch_satterthwaite([1.0, 2.0], [5, 10]) == pytest.approx(9 / (1 / 5 + 4 / 10))
    np.testing.assert_allclose(welch_satterthwaite([[1.0, 0.0], [0.0, 3.0]], [5, 90]), [5, 90])
    np.testing.assert_array_equal(welch_satterthwaite([[2.0, 0.0]], [5]), [5, np.inf])
    assert welch_satterthwaite([1e-40, 1.0], [5, np.inf]) == np.inf  # a scatter that is rounding of a sum
    assert welch_satterthwaite([1e-4, 1.0], [5, np.inf]) == pytest.approx(5e8, rel=1e-3)
