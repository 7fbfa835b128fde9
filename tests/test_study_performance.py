"""What the Monte Carlo study measures, and the bounds that it compares with."""

import numpy as np
import pytest

from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.regression import linear_fit
from osl_analysis.study.performance import performance, regression_bound


def test_bound_of_a_sinusoid_is_the_published_one():
    """Rife and Boorstyn, IEEE Trans. Inf. Theory 20, 1974: var(A) >= 2 s^2/N and var(phase) >= 2 s^2/(A^2 N)."""
    N, noise, phase = 1000, 0.3, 2 * np.pi * np.arange(1000) / 50
    bound = regression_bound({"cos": np.cos(phase), "sin": np.sin(phase), "offset": np.ones(N)}, noise)
    assert bound["cos"] == pytest.approx(noise * np.sqrt(2 / N))
    assert bound["sin"] == pytest.approx(noise * np.sqrt(2 / N))
    assert bound["offset"] == pytest.approx(noise / np.sqrt(N))


@pytest.mark.parametrize("drift", [2e-4, 0.3])
def test_bound_with_a_drift_is_that_of_the_dense_inverse(drift):
    noise, n = 0.3, 120
    columns = {"ramp": np.linspace(0, 2, n) ** 1.5, "wave": np.sin(np.arange(n) / 9), "offset": np.ones(n)}
    X, moved = np.column_stack(list(columns.values())), drift * np.arange(n)
    dense = np.linalg.inv(X.T @ np.linalg.inv(noise**2 * np.eye(n) + np.outer(moved, moved)) @ X)
    bound = regression_bound(columns, noise, moved)
    assert [bound[name] for name in columns] == pytest.approx(np.sqrt(np.diag(dense)), rel=1e-8)
    assert regression_bound(columns, noise, 0 * moved) == pytest.approx(regression_bound(columns, noise))


def test_a_drift_that_has_a_column_of_its_own_costs_the_other_columns_nothing():
    time = np.arange(120.0)
    columns = {"wave": np.sin(time / 9), "offset": np.ones(120), "drift": time}
    alone, with_drift = regression_bound(columns, 0.3), regression_bound(columns, 0.3, 0.01 * time)
    assert (with_drift["wave"], with_drift["offset"]) == pytest.approx((alone["wave"], alone["offset"]))
    assert with_drift["drift"] == pytest.approx(np.hypot(alone["drift"], 0.01))


def test_least_squares_reaches_the_bound_in_white_noise_and_the_study_says_so():
    rng, noise, n = np.random.default_rng(10), 0.5, 1500
    columns = {"a": np.sin(np.arange(200) / 7), "offset": np.ones(200)}
    bound = regression_bound(columns, noise)["a"]
    fits = [
        linear_fit(2 * columns["a"] + noise * rng.standard_normal(200), columns, ResidualCorrelation(lags=1))
        for _ in range(n)
    ]
    error, se = np.array([f["a"] - 2 for f in fits]), np.array([f.se("a") for f in fits])
    found = performance(error, se, np.abs(error) < 1.96 * se, np.full(n, bound))
    assert abs(found.bias) < 3 * found.bias_mc
    assert abs(found.rmse_over_bound - 1) < 3 * found.rmse_over_bound_mc
    assert found.rmse_over_bound_mc == pytest.approx(1 / np.sqrt(2 * n), rel=0.1)
    assert abs(found.coverage - 0.95) < 3 * found.coverage_mc
    assert found.se_over_sd == pytest.approx(1, rel=0.06)


def test_the_study_measures_bias_in_standard_deviations_and_coverage_as_a_share():
    found = performance(np.array([1.0, 2.0, 3.0]), np.ones(3), np.array([True, False, False]), np.full(3, 2.0))
    assert (found.bias, found.coverage, found.n) == pytest.approx((2.0, 1 / 3, 3))
    assert (found.rmse, found.rmse_over_bound) == pytest.approx((np.sqrt(14 / 3), np.sqrt(14 / 12)))
