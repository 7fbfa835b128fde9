# SPDX-License-Identifier: Apache-2.0
"""The regression under every fit, covariance of correlated residuals, and means over trials."""

import importlib  # statsmodels takes half a second of each process that collects tests
from contextlib import nullcontext

import numpy as np
import polars as pl
import pytest
from conftest import white_noise
from scipy.stats import t as student

from osl_analysis.base.errors import IdentifiabilityError, InputError
from osl_analysis.stats import linear_fit as regression
from osl_analysis.stats import repeats
from osl_analysis.stats.budget import welch_satterthwaite
from osl_analysis.stats.linear_fit import between_cycles, products_between

T = np.linspace(0, 10, 2000, endpoint=False)
COLUMNS = {"a": np.sin(T), "b": np.cos(3 * T), "offset": np.ones_like(T)}


def test_vaf_is_that_of_an_imperfect_fit():
    y = 2 * np.cos(20 * np.pi * T) + np.cos(40 * np.pi * T) + 10
    fit = regression.linear_fit(y, {"c": np.cos(20 * np.pi * T), "offset": np.ones_like(T)})
    assert fit.vaf == pytest.approx(80)
    # blind to an offset; a y of zeros by zeros, and by others
    pairs = ((y, 0 * y + 3), (0 * y, 0 * y), (0 * y, y))
    assert [regression.variance_accounted_for(*pair) for pair in pairs] == pytest.approx(
        [100, 100, 0]
    )


def test_one_effect_of_noise_in_a_thousand_is_certain():
    """Of 12 degrees of freedom."""
    errors = student.ppf((np.arange(3000) + 0.5) / 3000, 12)  # over their standard error

    effects = [
        regression.LinearFit(
            ("a",), np.array([2 * error]), np.array([[4.0]]), 0.0, "white noise", np.array([12.0])
        )
        for error in errors
    ]

    assert sum(effect.certain("a") for effect in effects) == pytest.approx(3, abs=1)


def fit_of_statsmodels(y, columns, **covariance):
    return (
        importlib.import_module("statsmodels.api")
        .OLS(y, np.column_stack([*columns.values()]))
        .fit(**covariance)
    )


def test_covariance_of_white_noise_is_statsmodels():
    y = COLUMNS["a"] + white_noise(len(T), 20)
    fit = regression.linear_fit(y, COLUMNS)
    assert fit.covariance == pytest.approx(fit_of_statsmodels(y, COLUMNS).cov_params(), rel=1e-8)
    assert fit.degrees_of_freedom[0] == len(T) - 3


@pytest.mark.parametrize(
    ("y", "columns", "message"),
    [
        (np.array([1, np.nan, 3]), {"a": np.ones(3)}, "'y'.*sample 1"),
        (np.ones(2), {"a": np.ones(2), "b": np.arange(2.0)}, "2 samples.*2 parameters"),
        (np.sin(T), {"K": np.sin(T), "B": np.cos(T), "I": -4 * np.sin(T)}, "K.*I.*apart"),
        (np.sin(T), {"a": np.sin(T), "b": np.zeros_like(T)}, "'b'"),
    ],
)
def test_columns_that_determine_nothing_are_named(y, columns, message):
    with pytest.raises((InputError, IdentifiabilityError), match=message):
        regression.linear_fit(y, columns)


def test_a_derivative_that_is_noise_alone_is_refused():
    with pytest.raises(IdentifiabilityError, match=r"'snap'.*noise"):
        regression.solved(np.diag([1.0, -1e-9]), np.ones(2), ("K", "snap"))


CYCLE = 50
COUNT = 24


def repeated(rng):
    """A friction-like residual that every cycle repeats, and white noise."""
    n = CYCLE * COUNT
    t = np.arange(n) / CYCLE
    columns = {"a": np.sin(2 * np.pi * t), "b": np.cos(2 * np.pi * t), "offset": np.ones(n)}
    friction = np.sign(columns["b"])
    return 3 * columns["a"] + friction + 0.3 * rng.standard_normal(n), columns


def test_one_stratum_is_statsmodels_cluster_covariance():
    y, columns = repeated(np.random.default_rng(5))
    groups = {"groups": np.repeat(np.arange(COUNT), CYCLE), "use_correction": False}
    X = np.column_stack(list(columns.values()))
    residual = y - X @ regression.linear_fit(y, columns).estimates
    of_cycles = (X * residual[:, None]).reshape(COUNT, CYCLE, 3).sum(axis=1)

    covariance, _ = between_cycles(of_cycles @ np.linalg.inv(X.T @ X), np.zeros(COUNT, dtype=int))

    other = fit_of_statsmodels(y, columns, cov_type="cluster", cov_kwds=groups)
    expected = other.cov_params() * COUNT / (COUNT - 1)
    assert covariance == pytest.approx(expected, rel=1e-8, abs=1e-15)


@pytest.mark.parametrize(
    ("variances", "freedom", "of_sum"),
    [
        ([1.0, 2.0], [5, 10], 9 / (1 / 5 + 4 / 10)),
        ([[1.0, 0.0], [0.0, 3.0]], [5, 90], [5, 90]),
        ([[2.0, 0.0]], [5], [5, np.inf]),
        ([1e-40, 1.0], [5, np.inf], np.inf),  # a scatter that is rounding of a sum
        ([1e-4, 1.0], [5, np.inf], 5e8),
    ],
)
def test_freedom_of_a_sum_is_that_of_welch_and_satterthwaite(variances, freedom, of_sum):
    found = welch_satterthwaite(variances, freedom)
    np.testing.assert_allclose(found, of_sum, rtol=1e-3)


def over_repeats(values, half=0.0):
    """The summary of trials with intervals of their own."""
    trials = pl.DataFrame({"x": values}).with_columns(
        x_low=pl.col("x") - half, x_high=pl.col("x") + half
    )
    return repeats.summary_row(trials, "x")


@pytest.mark.parametrize("between", [0.0, 3.0])
def test_two_trials_that_agree_by_luck_are_covered_as_often_as_others(between):
    """Trials with own errors of 2 and scatter between them: mean and difference are independent, so
    that of those that agree Student's interval alone covers next to none."""
    draws = white_noise((1000, 2), 5) * np.hypot(2.0, between)
    found = [over_repeats(pair, half=1.959964 * 2.0) for pair in draws]
    covers = np.array([one["low"] < 0 < one["high"] for one in found])
    alike = np.abs(np.diff(draws))[:, 0] < 0.2
    student_alone = [over_repeats(pair) for pair in draws[alike]]
    assert covers.mean() > 0.93  # of 1000, with a standard error of 0.007
    assert np.mean([one["low"] < 0 < one["high"] for one in student_alone]) < 0.5
    assert between or covers[alike].mean() > 0.9
    narrowest = min(one["high"] - one["mean"] for one in found)
    assert narrowest == pytest.approx(1.959964 * 2 / np.sqrt(2))


def test_an_error_that_trials_share_is_once_in_the_interval_of_a_mean():
    """Of two trials that agree, each with its own SD of 3 beside the bench's of 4."""
    own = {"x_low": 1 - 1.959964 * 5, "x_high": 1 + 1.959964 * 5, "x_se_bench": 4.0}

    row = repeats.summary_row(pl.DataFrame({"x": [1.0, 1.0], **own}), "x")

    half = row["high"] - row["mean"]
    assert half == pytest.approx(1.959964 * np.hypot(3 / np.sqrt(2), 4))


def test_intervals_over_trials_are_students():
    values = np.array([1.0, 2.0, 4.0, 7.0])
    own = over_repeats(values)
    assert own["high"] - own["mean"] == pytest.approx(
        student.ppf(0.975, 3) * np.std(values, ddof=1) / 2
    )
    assert own["mean"] == 3.5
    rows = [
        repeats.summary_row(pl.DataFrame({"x": one}), "x") for one in ([1.0, None, 3.0, np.nan], [])
    ]
    found = [(row["n"], row["mean"], row["sd"], row["interval_method"]) for row in rows]
    assert found == [
        (2, 2.0, pytest.approx(np.sqrt(2)), "Student"),
        (0, None, None, None),
    ]


def test_a_condition_number_is_that_of_the_columns_not_of_what_noise_leaves():
    """Noise that is taken off leaves next to nothing of two columns that are far from alike."""
    columns = np.array([[1.0, 0.2], [0.2, 1.0]])
    noise = np.diag([0.0, 0.96 - 1e-9])
    limit = regression.CONDITION_LIMIT
    equations = (columns - noise, np.ones(2), ("K", "I"), (0, 1), limit)

    with pytest.raises(IdentifiabilityError, match="behind noise of the angle"):
        regression.solved(*equations, noise)
    with pytest.raises(IdentifiabilityError, match="condition number"):
        regression.solved(*equations)


@pytest.mark.parametrize(("condition", "is_refused"), [(900, False), (1100, True)])
def test_columns_in_which_a_thousandth_makes_the_whole_of_an_estimate_are_refused(
    condition, is_refused
):
    """Two unit columns with a cosine of c have the condition number sqrt((1 + c) / (1 - c))."""
    cosine = (condition**2 - 1) / (condition**2 + 1)
    first = np.tile([1.0, 0.0], 50)
    second = cosine * first + np.sqrt(1 - cosine**2) * np.tile([0.0, 1.0], 50)
    columns = {"K": first, "I": second}

    with pytest.raises(IdentifiabilityError) if is_refused else nullcontext():
        regression.linear_fit(first + second + 1e-6 * white_noise(100, 1), columns)


def test_of_columns_that_are_one_the_condition_number_ends_at_rounding():
    one_column = np.ones((2, 2))

    assert regression.scaled_condition(one_column, (0, 1)) > 1e6


def test_noise_alone_is_told_as_a_scatter_in_one_of_a_hundred_cases():
    random = np.random.default_rng(1)
    scatters = [
        repeats.scatter_beyond_noise(random.standard_normal(5), np.ones(5)) for _ in range(8000)
    ]

    told = np.mean(np.array(scatters) > 0)
    assert told == pytest.approx(0.01, abs=3 * np.sqrt(0.01 / 8000))


def test_cycles_of_no_whole_rows_have_the_sums_of_their_integrals():
    turn = 2 * np.pi * np.arange(800) / (250 / 3)
    edges = 250 / 3 * np.arange(1, 9)
    X = np.column_stack([np.cos(turn), np.sin(turn), np.ones(800)])

    products = products_between(X, X, edges[:-1], edges[1:])

    of_cycle = np.diag([0.5, 0.5, 1.0]) * 250 / 3
    assert products == pytest.approx(np.broadcast_to(of_cycle, products.shape), abs=2e-3)


def test_a_known_error_as_large_as_that_by_chance_doubles_the_variance():
    """It has infinite degrees of freedom: those of the sum are four times those of the scatter, by
    Welch and Satterthwaite."""
    x = np.arange(12.0)
    fit = regression.linear_fit(x + np.cos(x), {"a": x})

    shared = fit.with_known_error("known", np.array([fit.se("a")]))

    assert shared.se("a") == pytest.approx(np.sqrt(2) * fit.se("a"))
    assert shared.budget("a").spread()[1] == pytest.approx(4 * fit.budget("a").spread()[1])


def test_a_unit_changes_nothing_of_whether_columns_are_told_apart():
    """Two columns 0.1 apart, whose condition number is 20, in units a million times as large."""
    a, b, noise = white_noise((3, 4000), 3)
    columns = {"a": a, "b": a + 0.1 * b}
    scaled = {"a": 1e6 * columns["a"], "b": 1e-6 * columns["b"]}

    fits = [regression.linear_fit(a + noise, each) for each in (columns, scaled)]

    shares = [[fit.se(name) / fit[name] for name in "ab"] for fit in fits]
    assert shares[1] == pytest.approx(shares[0], rel=1e-6)


def test_a_noisy_stratum_has_its_own_freedom():
    sums = white_noise((4000, 1), 6)
    stratum = np.repeat(np.arange(2), 2000)
    sums[:2000] *= 1e-6

    _, freedom = between_cycles(sums, stratum)

    assert freedom[0] == pytest.approx(1999, rel=0.01)
