"""Whether a residual is white, behind the filter of its signals."""

import numpy as np
import pytest
from statsmodels.stats.diagnostic import acorr_ljungbox

from osl_analysis.signals import LowPass
from osl_analysis.stats.fit_row import whiteness

RATE, LOW_PASS = 500.0, LowPass(15)


def test_ljung_box_is_statsmodels():
    residual = np.random.default_rng(3).standard_normal(400).cumsum()
    found = whiteness(residual, 2 * LOW_PASS.noise_bandwidth_hz, LOW_PASS)
    other = acorr_ljungbox(residual - residual.mean(), lags=10)
    centred = whiteness(residual - residual.mean(), 2 * LOW_PASS.noise_bandwidth_hz, LOW_PASS)
    assert 10 * centred.per_lag == pytest.approx(other["lb_stat"].iloc[-1])
    short = whiteness(residual[:30] - residual[:30].mean(), 20.0, LOW_PASS)
    other = acorr_ljungbox(residual[:30] - residual[:30].mean(), lags=6)
    assert (6 * short.per_lag, short.p) == pytest.approx(tuple(other.iloc[-1]))
    assert found.autocorrelation > 0.9


def test_white_noise_through_the_filter_passes_as_white_five_times_in_hundred_it_does_not():
    """95 % of 300 seeded records of 60 s, 1600 samples each: a rate of twice the cut-off itself would refuse all."""
    rng, p = np.random.default_rng(4), []
    for _ in range(300):
        found = whiteness(LOW_PASS(rng.standard_normal(round(60 * RATE)), RATE), RATE, LOW_PASS)
        p.append(found.p)
        assert abs(found.autocorrelation) < 0.15
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    assert 0.4 < np.mean(p) < 0.6


def test_a_slow_residual_is_not_white_and_too_short_a_one_is_not_judged():
    t = np.arange(0, 100, 1 / RATE)
    white = LOW_PASS(np.random.default_rng(5).standard_normal(len(t)), RATE)
    slow = whiteness(white + np.sin(t), RATE, LOW_PASS)
    assert slow.autocorrelation > 0.7
    assert slow.per_lag > 100
    assert slow.p < 1e-6
    assert whiteness(white[:300], RATE, LOW_PASS) is None
    assert whiteness(np.zeros(5000), RATE, LOW_PASS) is None
