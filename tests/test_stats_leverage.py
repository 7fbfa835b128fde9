"""Standard errors from residuals of which the fit took most of the noise, against the scatter of simulated fits."""

import numpy as np
import pytest

from osl_analysis.signals import LowPass
from osl_analysis.stats.covariance import MOST_ROWS, KnownMemory, ResidualCorrelation
from osl_analysis.stats.regression import regressors

RATE, LOW_PASS = 100.0, LowPass(15)
EVERY, MEMORY = LOW_PASS.independent_samples(RATE), LOW_PASS.memory(RATE)


def few_cycles(cycles, frequencies_hz=(1.0, 3.0, 7.0)):
    """Angle, velocity and acceleration of sines one after the other, with a second between, and their samples."""
    parts, position, begin = [], [], 200
    for f in frequencies_hz:
        w, samples = 2 * np.pi * f, round(cycles / f * RATE)
        t = np.arange(samples) / RATE
        parts.append(np.stack([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)], axis=1))
        position.append(begin + np.arange(samples))
        begin += samples + round(RATE)
    return np.concatenate(parts), np.concatenate(position)


def simulated(X, position, residuals, draws=300):
    """Estimates (draws, p) of zero, their variances and degrees of freedom, under white noise behind the filter."""
    noise = LOW_PASS(np.random.default_rng(3).standard_normal((position[-1] + 200, draws)), RATE)[position]
    found = regressors(dict(zip("KBI", X.T, strict=True)), (len(X),))
    fits = [found.fit(y, residuals) for y in noise.T]
    variances = np.array([np.diag(fit.covariance) for fit in fits])
    return np.array([fit.estimates for fit in fits]), variances, fits[0].degrees_of_freedom


def known_memory(position):
    return KnownMemory(every=EVERY, memory=MEMORY, position=position)


@pytest.mark.parametrize("cycles", [2, 4])
def test_standard_errors_of_few_cycles_are_the_scatter_of_the_estimates_and_are_never_lowered(cycles):
    X, position = few_cycles(cycles)
    estimates, plain, freedom = simulated(X, position, ResidualCorrelation(every=EVERY))
    _, first, known = simulated(X, position, known_memory(position), draws=1)
    raised = first[0] / simulated(X, position, ResidualCorrelation(every=EVERY), draws=1)[1][0]
    assert (raised >= 1 - 1e-12).all()
    ratio = np.sqrt(raised * plain.mean(axis=0)) / estimates.std(axis=0)
    assert ratio[2] == pytest.approx(1, abs=0.12)
    assert (ratio > 0.88).all()
    assert (known <= freedom).all()
    assert known[2] < freedom[2]


def test_of_many_cycles_nothing_is_missing_and_the_rows_that_are_kept_do_not_matter():
    X, position = few_cycles(60)
    assert len(X) > MOST_ROWS * EVERY // 2
    _, known, _ = simulated(X, position, known_memory(position), draws=1)
    _, plain, _ = simulated(X, position, ResidualCorrelation(every=EVERY), draws=1)
    assert known == pytest.approx(plain, rel=0.1)


def test_the_memory_of_a_filter_is_the_autocovariance_of_its_noise():
    noise = LOW_PASS(np.random.default_rng(1).standard_normal(200_000), RATE)
    seen = [np.mean(noise * noise), *(np.mean(noise[k:] * noise[:-k]) for k in range(1, 25))]
    np.testing.assert_allclose(MEMORY[:25], seen, atol=0.02 * MEMORY[0])
    assert MEMORY[0] == pytest.approx(2 * LOW_PASS.noise_bandwidth_hz / RATE, rel=0.01)
    assert np.abs(MEMORY[-5:]).max() < 1e-3 * MEMORY[0]
