"""The regression under every fit: exact recovery, intervals that cover, and columns that cannot be told apart."""

import numpy as np
import pytest
import statsmodels.api as sm
from conftest import multisine
from hypothesis import given
from hypothesis import strategies as st
from repeated_cycles import repeated
from scipy.stats import t as student

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.second_order import impedance_columns
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.least_squares import GRAM_LIMIT, decomposed
from osl_analysis.stats.regression import linear_fit, variance_accounted_for

RNG_SEED = 20
T = np.linspace(0, 10, 2000, endpoint=False)
COLUMNS = {"a": np.sin(T), "b": np.cos(3 * T), "offset": np.ones_like(T)}


def correlated_noise(rng, n, rho):
    noise = np.empty(n)
    noise[0] = rng.normal() / np.sqrt(1 - rho**2)
    for i, e in enumerate(rng.normal(size=n - 1), start=1):
        noise[i] = rho * noise[i - 1] + e
    return noise


def up_to(size):
    """Numbers of at most this size, none of them so small that it cannot have been measured."""
    return st.floats(-size, size).map(lambda number: number if abs(number) > 1e-15 else 0.0)


@given(up_to(1e3), up_to(1e-3), up_to(10))
def test_recovers_the_coefficients_that_made_the_data(a, b, offset):
    fit = linear_fit(a * COLUMNS["a"] + b * COLUMNS["b"] + offset, COLUMNS)
    assert fit.estimates == pytest.approx([a, b, offset], rel=1e-8, abs=1e-10)


def test_vaf_and_r_squared_read_what_they_should_when_the_fit_is_not_perfect():
    residual = np.cos(40 * np.pi * T)
    y = 2 * np.cos(20 * np.pi * T) + residual + 10
    fit = linear_fit(y, {"c": np.cos(20 * np.pi * T), "offset": np.ones_like(T)})
    assert fit.vaf == pytest.approx(80)
    assert fit.r_squared == pytest.approx(1 - 0.5 / (2 + 0.5 + 100))


def test_vaf_is_blind_to_an_offset_of_the_residual():
    y = np.sin(T)
    assert variance_accounted_for(y, np.full_like(y, 3.0)) == pytest.approx(100)


def test_covariance_is_statsmodels_hac_at_the_same_bandwidth():
    rng = np.random.default_rng(RNG_SEED)
    y = COLUMNS["a"] + correlated_noise(rng, len(T), 0.9)
    fit = linear_fit(y, COLUMNS)
    other = sm.OLS(y, np.column_stack(list(COLUMNS.values()))).fit(
        cov_type="HAC", cov_kwds={"maxlags": fit.correlation_samples - 1, "use_correction": True}
    )
    assert fit.correlation_samples > 10
    assert fit.covariance == pytest.approx(other.cov_params(), rel=1e-8)


def test_names_the_two_columns_that_cannot_be_told_apart():
    columns = {"K": np.sin(T), "B": np.cos(T), "I": -4 * np.sin(T)}
    with pytest.raises(IdentifiabilityError, match="K and I cannot be told apart"):
        linear_fit(np.sin(T), columns)


def test_condition_number_does_not_depend_on_units():
    y = COLUMNS["a"]
    scaled = {name: column * scale for (name, column), scale in zip(COLUMNS.items(), (1, 1e6, 1e-6), strict=True)}
    assert linear_fit(y, COLUMNS).condition_number == pytest.approx(linear_fit(y, scaled).condition_number)


@pytest.mark.parametrize(
    ("y", "columns", "message"),
    [
        (np.ones(5), {"a": np.ones(4)}, "column 'a' has shape"),
        (np.array([1, np.nan, 3]), {"a": np.ones(3)}, "column 'y' is not finite at sample 1"),
        (np.ones(2), {"a": np.ones(2), "b": np.arange(2.0)}, "2 samples cannot determine 2 parameters"),
    ],
)
def test_unusable_input_is_named(y, columns, message):
    with pytest.raises(InputError, match=message):
        linear_fit(y, columns)


def test_a_column_of_zeros_is_refused_by_name():
    with pytest.raises(IdentifiabilityError, match="'b' cannot be estimated"):
        linear_fit(np.sin(T), {"a": np.sin(T), "b": np.zeros_like(T)})


def test_the_interval_is_students():
    y, columns, cycles = repeated(np.random.default_rng(8))
    fit = linear_fit(y, columns, ResidualCorrelation(cycles))
    low, high = fit.interval("b")
    half = student.ppf(0.975, fit.degrees_of_freedom[1]) * fit.se("b")
    assert (low, high) == pytest.approx((fit["b"] - half, fit["b"] + half))
    assert fit.cov("a", "b") == fit.covariance[0, 1]


def test_estimates_that_lean_on_one_another_show_in_their_correlation():
    motion = multisine(2.0, 2.4)
    near = linear_fit(motion.theta + np.random.default_rng(5).standard_normal(5000), impedance_columns(motion))
    wide = multisine(0.5, 5.0)
    apart = linear_fit(wide.theta + np.random.default_rng(5).standard_normal(5000), impedance_columns(wide))
    assert near.largest_correlation > 0.95 > apart.largest_correlation


def test_the_correlation_of_estimates_is_that_of_the_columns_and_not_of_the_scatter_of_a_few_noisy_rows():
    """Noise that shares the sign of both columns would correlate the estimates, which the columns do not."""
    rng = np.random.default_rng(3)
    a, b, noise = rng.standard_normal((3, 4000))
    columns, y = {"a": a, "b": b}, 2 * a + b + 3 * noise * np.abs(a + b)
    assert abs(linear_fit(y, columns).correlation("a", "b")) > 0.3
    assert linear_fit(y, columns).largest_correlation < 0.05


def conditioned(condition, n=5000):
    """Three columns whose scaled condition number is about `condition`, and a y with known coefficients and noise."""
    rng = np.random.default_rng(12)
    Q, _ = np.linalg.qr(rng.standard_normal((n, 3)))
    X = Q @ np.diag([1.0, 0.5, 1 / condition]) @ np.linalg.qr(rng.standard_normal((3, 3)))[0] * [1.0, 1e3, 1e-4]
    return X @ [3.0, 2e-3, 5e4] + 1e-3 * rng.standard_normal(n), {"a": X[:, 0], "b": X[:, 1], "c": X[:, 2]}


@pytest.mark.parametrize("condition", [2, 30, 90, 300])
def test_normal_equations_of_many_rows_are_as_exact_as_a_decomposition_of_the_columns(condition):
    """The reference is QR. Rounding of 1e-16 grows by the condition number, or its square for the covariance."""
    y, columns = conditioned(condition)
    fit, X = linear_fit(y, columns), np.stack(list(columns.values()), axis=1)
    scaled = X / np.linalg.norm(X, axis=0)
    U, _ = decomposed(X, np.linalg.norm(X, axis=0))[:2]
    assert (U is None) == (np.linalg.cond(scaled) < GRAM_LIMIT)
    Q, R = np.linalg.qr(scaled)
    exact = np.linalg.solve(R, Q.T @ y) / np.linalg.norm(X, axis=0)
    assert fit.estimates == pytest.approx(exact, rel=1e-14 * condition**1.5)
    assert fit.condition_number == pytest.approx(np.linalg.cond(scaled), rel=1e-15 * condition**2)
    few = linear_fit(y[:140], {name: column[:140] for name, column in columns.items()})
    assert few.estimates == pytest.approx(np.linalg.lstsq(X[:140], y[:140], rcond=None)[0], rel=1e-9)
