"""Covariance of correlated residuals: the spread of cycles, autocorrelation behind a filter, degrees of freedom."""

from itertools import pairwise

import numpy as np
import pytest
import statsmodels.api as sm
from conftest import filtered_noise
from repeated_cycles import COUNT, CYCLE, repeated

from osl_analysis.second_order import fit_impedance, impedance_torque
from osl_analysis.signals import LowPass, differentiate
from osl_analysis.stats.covariance import (
    FILTER_SPAN,
    Cycles,
    ResidualCorrelation,
    between_cycles,
    correlation_samples,
    moving_sums,
    welch_satterthwaite,
)
from osl_analysis.stats.regression import linear_fit

N, RATE = 3000, 1000.0
LOW_PASS = LowPass(15)
EVERY = LOW_PASS.independent_samples(RATE)


def test_the_spread_of_cycles_covers_where_friction_fools_hac():
    """95 % of 600 seeded records; HAC takes the friction for noise and is several times too wide."""
    rng, covered = np.random.default_rng(4), 0
    truth = linear_fit(repeated(rng, noise=0.0)[0], repeated(rng)[1])["b"]
    for _ in range(600):
        y, columns, cycles = repeated(rng)
        fit = linear_fit(y, columns, ResidualCorrelation(cycles))
        low, high = fit.interval("b")
        covered += low <= truth <= high
    assert 0.93 < covered / 600 < 0.97
    assert linear_fit(y, columns).se("b") > 3 * fit.se("b")


def test_one_stratum_is_statsmodels_cluster_covariance():
    y, columns, cycles = repeated(np.random.default_rng(5))
    groups = np.repeat(np.arange(COUNT), CYCLE)
    fit = linear_fit(y, columns, ResidualCorrelation(Cycles(cycles.first, cycles.stop, np.zeros(COUNT, dtype=np.intp))))
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


def test_filtered_noise_is_not_given_a_memory_of_seconds_and_what_lasts_longer_is():
    """Andrews sample by sample takes 30 ms behind a 15 Hz filter for 2.5 s; a residual of 1 s keeps its window."""
    rng = np.random.default_rng(18)
    noise = filtered_noise(rng, n=60_000)
    assert correlation_samples(noise) > 1500
    assert correlation_samples(noise, EVERY) == FILTER_SPAN * EVERY
    lasting = np.convolve(rng.standard_normal(61_000), 0.999 ** np.arange(3000), "same")[:60_000]
    assert correlation_samples(lasting, EVERY) > 4 * FILTER_SPAN * EVERY
    assert correlation_samples(noise[:800], EVERY) == 100


def test_what_a_fit_of_slow_columns_takes_from_the_sums_of_its_scores_is_given_back():
    """Seven tones below 1.5 Hz behind 15 Hz: their variance in 300 seeded records, which counting samples misses."""
    rng, time, variances = np.random.default_rng(20), np.arange(6000) / RATE, []
    columns = {f"{f}": np.sin(2 * np.pi * f / 6 * time) for f in range(1, 8)}
    for _ in range(300):
        fits = [linear_fit(filtered_noise(rng, n=6000), columns, ResidualCorrelation(every=EVERY))]
        fits += [linear_fit(fits[0].residual, columns, ResidualCorrelation(lags=FILTER_SPAN * EVERY))]
        variances.append([fit.covariance[3, 3] for fit in fits])
    slow, fast = np.mean(variances, axis=0) / (0.05**2 * 2 / 6000)
    assert slow == pytest.approx(1, abs=0.1)
    assert fast < 0.8


def test_a_record_of_few_cycles_has_an_interval_that_holds_behind_the_filter():
    """Four cycles, of which one is left at each frequency: 150 seeded records, 95 % +- 3 Monte Carlo errors of 1.8 %.
    With Andrews' AR(1) fitted sample by sample, K, B and I were covered in 87 to 94 %."""
    rng, low_pass, rate, covered = np.random.default_rng(12), LowPass(15), 500.0, []
    pieces = [np.sin(2 * np.pi * f * np.arange(round(4 / f * rate)) / rate) for f in (1, 2, 3, 4, 5)]
    theta = low_pass(np.concatenate([np.zeros(250), 0.07 * np.concatenate(pieces), np.zeros(250)]), rate)
    time = np.arange(len(theta)) / rate
    motion = differentiate(time, theta)
    ends = 250 + np.cumsum([0, *(len(piece) for piece in pieces)])
    rows = np.concatenate([np.arange(a + (b - a) // 2, b - (b - a) // 4) for a, b in pairwise(ends)])
    torque = impedance_torque(300, 5, 0.02, motion)
    for _ in range(150):
        noisy = torque + low_pass(rng.normal(0, 0.05, len(time)), rate)
        fit = fit_impedance(
            motion[rows], noisy[rows], ResidualCorrelation(every=low_pass.independent_samples(rate))
        ).fit
        assert fit.interval_method == "HAC"
        bounds = [fit.interval(name) for name in ("K", "B", "I")]
        covered += [low <= truth <= high for (low, high), truth in zip(bounds, (300, 5, 0.02), strict=True)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.045)


def test_cycles_that_a_filter_correlates_have_the_spread_of_the_noise_before_it():
    """2000 seeded records of five cycles of 5 Hz: the filter smears noise over the edges, where a cosine is largest.
    The standard error is 6 % too small from the filtered residual; Monte Carlo errors are 1 %."""
    low_pass, rng, f = LowPass(15), np.random.default_rng(9), 5.0
    t = np.arange(2000) / RATE
    inside = slice(500, 1500)
    columns = {"cosine": np.cos(2 * np.pi * f * t)[inside], "offset": np.ones(1000)}
    edges = 200.0 * np.arange(6)
    cycles = Cycles(edges[:-1], edges[1:], np.zeros(5, dtype=np.intp))
    variances, errors = {"before": [], "behind": []}, []
    for _ in range(2000):
        noise = rng.standard_normal(len(t))
        filtered = low_pass(noise, RATE)
        taken = {"behind": None, "before": (noise - filtered)[inside]}
        for name, off in taken.items():
            fit = linear_fit(filtered[inside], columns, ResidualCorrelation(cycles, filtered_off=off))
            variances[name].append(fit.se("cosine") ** 2)
        errors.append(fit["cosine"])
    ratio = {name: np.sqrt(np.mean(each)) / np.std(errors) for name, each in variances.items()}
    assert ratio["before"] == pytest.approx(1, abs=0.05)
    assert ratio["behind"] < 0.96
