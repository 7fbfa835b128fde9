"""A single slow motion: noise about a richer model, how long it lasts, and a drift that no residual shows."""

import numpy as np
import pytest
import statsmodels.api as sm
from conftest import filtered_noise

from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import linear_fit
from osl_analysis.stats.slow_motion import fit_slow_motion, memory_samples

N, RATE = 3000, 1000.0
LOW_PASS = LowPass(15)
EVERY = LOW_PASS.independent_samples(RATE)
RAMP = {"slope": (1 - np.cos(np.pi * np.arange(N) / N)) / 2, "offset": np.ones(N)}
BUMP = {"bump": np.gradient(RAMP["slope"])}


def test_the_interval_of_a_ramp_covers_the_truth_where_hac_takes_for_chance_what_every_trial_repeats():
    """95 % of 600 seeded ramps within three Monte Carlo errors of 0.9 %, although the line misses a bump."""
    rng, drift, found = np.random.default_rng(11), 1e-6, []
    repeated = 200 * BUMP["bump"]
    truth = linear_fit(repeated, RAMP)["slope"]
    for _ in range(600):
        y = repeated + filtered_noise(rng) + drift * rng.standard_normal() * np.arange(N)
        fit = fit_slow_motion(y, RAMP, BUMP, EVERY, drift)
        low, high = fit.interval("slope")
        found.append((fit["slope"] - truth, fit.se("slope"), low <= truth <= high, linear_fit(y, RAMP).se("slope")))
    error, se, covered, hac = np.array(found).T
    assert np.mean(covered) == pytest.approx(0.95, abs=0.027)
    assert np.sqrt(np.mean(se**2)) == pytest.approx(np.std(error), rel=0.1)
    assert np.median(hac) > 1.5 * np.median(se)


def test_noise_that_lasts_longer_than_the_filter_widens_the_interval():
    """An AR(1) of 50 ms behind the filter: its spectrum at zero is three times that of white noise of its variance."""
    rng, errors, stated = np.random.default_rng(12), [], []
    for _ in range(300):
        red = np.convolve(rng.standard_normal(N + 1399), 0.98 ** np.arange(400), "valid")
        fit = fit_slow_motion(LOW_PASS(red, RATE)[500:-500], RAMP, {}, EVERY)
        errors.append(fit["slope"])
        stated.append(fit.se("slope"))
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(np.std(errors), rel=0.2)


def test_white_noise_without_a_filter_gives_statsmodels_ordinary_covariance():
    rng = np.random.default_rng(13)
    y = 3 * RAMP["slope"] + rng.standard_normal(N)
    fit = fit_slow_motion(y, RAMP, {})
    memory = memory_samples(fit.residual, 1)
    other = sm.OLS(y, np.column_stack(list(RAMP.values()))).fit()
    freedom = N / memory - 2
    assert fit.covariance == pytest.approx(other.cov_params() * (N - 2) / freedom, rel=1e-8)
    assert fit.degrees_of_freedom == pytest.approx([freedom] * 2)
    assert memory == pytest.approx(1, abs=0.1)
    assert fit.interval_method == "noise"


def test_a_drift_that_the_line_takes_up_is_its_slope_in_time_over_that_of_the_column():
    """Nothing but the drift is left of the variance: its share of the estimate is a hand-written slope."""
    fit = fit_slow_motion(3 * RAMP["slope"], RAMP, {}, drift=2e-5)
    time, column = np.arange(N) - (N - 1) / 2, RAMP["slope"] - RAMP["slope"].mean()
    assert fit.se("slope") == pytest.approx(2e-5 * (column @ time) / (column @ column), rel=1e-6)
    assert fit.interval_method == "noise + drift"
    assert fit.estimates == pytest.approx([3, 0], abs=1e-12)


def test_a_known_drift_is_worth_more_degrees_of_freedom_than_the_noise_alone():
    y = filtered_noise(np.random.default_rng(14))
    alone, both = fit_slow_motion(y, RAMP, {}, EVERY), fit_slow_motion(y, RAMP, {}, EVERY, drift=2e-6)
    ratio = (both.se("slope") / alone.se("slope")) ** 2
    assert ratio > 1.2
    assert both.degrees_of_freedom[0] == pytest.approx(alone.degrees_of_freedom[0] * ratio**2)
