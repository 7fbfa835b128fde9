"""The regression under every fit: exact recovery, intervals that cover, and columns that cannot be told apart."""

import numpy as np
import pytest
import statsmodels.api as sm
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit
from statsmodels.stats.diagnostic import acorr_ljungbox

from osl_analysis.bench.phasors import (
    complex_mean,
    complex_quotient,
    fit_sinusoid,
    polar_row,
    sines_at,
)
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import LowPass
from osl_analysis.stats.fit_row import thinned_rows, whiteness_row
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
    assert variance_accounted_for(y, np.full_like(y, 3.0)) == pytest.approx(100), "blind to an offset"


def test_covariance_is_statsmodels_hac_at_the_same_bandwidth():
    rng = np.random.default_rng(RNG_SEED)
    y = COLUMNS["a"] + correlated_noise(rng, len(T), 0.9)
    fit = linear_fit(y, COLUMNS)
    other = sm.OLS(y, np.column_stack(list(COLUMNS.values()))).fit(
        cov_type="HAC", cov_kwds={"maxlags": fit.correlation_samples - 1, "use_correction": True}
    )
    assert fit.correlation_samples > 10
    assert fit.covariance == pytest.approx(other.cov_params(), rel=1e-8)


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
        (np.sin(T), {"K": np.sin(T), "B": np.cos(T), "I": -4 * np.sin(T)}, "K and I cannot be told apart"),
        (np.sin(T), {"a": np.sin(T), "b": np.zeros_like(T)}, "'b' cannot be estimated"),
    ],
)
def test_columns_that_determine_nothing_are_named(y, columns, message):
    with pytest.raises((InputError, IdentifiabilityError), match=message):
        linear_fit(y, columns)


def test_the_correlation_of_estimates_is_that_of_the_columns_and_not_of_the_scatter_of_a_few_noisy_rows():
    """Noise that shares the sign of both columns would correlate the estimates, which the columns do not."""
    rng = np.random.default_rng(3)
    a, b, noise = rng.standard_normal((3, 4000))
    columns, y = {"a": a, "b": b}, 2 * a + b + 3 * noise * np.abs(a + b)
    assert abs(linear_fit(y, columns).correlation("a", "b")) > 0.3
    assert linear_fit(y, columns).largest_correlation < 0.05
    leaning = columns | {"b": a + 0.1 * b}
    assert linear_fit(y, leaning).largest_correlation > 0.95


RATE, LOW_PASS = 500.0, LowPass(15)


def whiteness(residual):
    """Autocorrelation after one sample, Ljung and Box's statistic per lag, and its p, of a residual at `RATE`."""
    return tuple(whiteness_row(residual[thinned_rows(len(residual), RATE, LOW_PASS)]).values())


@pytest.mark.parametrize(("samples", "lags"), [(400, 10), (30, 6)])
def test_ljung_box_is_statsmodels(samples, lags):
    residual = np.random.default_rng(3).standard_normal(400).cumsum()[:samples]
    autocorrelation, per_lag, p = whiteness_row(residual - residual.mean()).values()
    other = acorr_ljungbox(residual - residual.mean(), lags=lags)
    assert (lags * per_lag, p) == pytest.approx(tuple(other.iloc[-1]))
    assert autocorrelation > 0.5


def test_white_noise_through_the_filter_passes_as_white_five_times_in_hundred_it_does_not():
    """95 % of 300 seeded records of 60 s, 1600 samples each: a rate of twice the cut-off itself would refuse all."""
    rng, ps = np.random.default_rng(4), []
    for _ in range(300):
        autocorrelation, _, p = whiteness(LOW_PASS(rng.standard_normal(round(60 * RATE)), RATE))
        ps.append(p)
        assert abs(autocorrelation) < 0.15
    assert 0.02 < np.mean(np.array(ps) < 0.05) < 0.09
    assert 0.4 < np.mean(ps) < 0.6


def test_a_slow_residual_is_not_white_and_too_short_a_one_is_not_judged():
    t = np.arange(0, 100, 1 / RATE)
    white = LOW_PASS(np.random.default_rng(5).standard_normal(len(t)), RATE)
    autocorrelation, per_lag, p = whiteness(white + np.sin(t))
    assert (autocorrelation > 0.7, per_lag > 100, p < 1e-6) == (True, True, True)
    assert whiteness(white[:300]) == whiteness(np.zeros(5000)) == (None, None, None)


def test_phasor_agrees_with_a_nonlinear_least_squares_fit():
    t = np.arange(0, 5, 1e-3)
    rng = np.random.default_rng(3)
    y = 0.4 * np.cos(2 * np.pi * 2 * t + 0.7) + 1.0 + rng.normal(0, 0.05, len(t))
    phasor = fit_sinusoid(y, sines_at(t, 2.0))

    def sine(t, a, phase, offset):
        return a * np.cos(2 * np.pi * 2 * t + phase) + offset

    (a, phase, _), covariance = curve_fit(sine, t, y, p0=(0.3, 0.5, 0.0))
    assert (abs(phasor.value), np.angle(phasor.value)) == pytest.approx((a, phase), rel=2e-3)
    assert np.sqrt(np.trace(phasor.covariance) / 2) == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.3)


def test_a_phasor_is_that_of_the_cycles_it_is_given_and_its_distortion_the_share_of_the_harmonics():
    t = np.arange(0, 6, 1e-3)
    y = np.cos(2 * np.pi * t + 0.3) + np.where((t > 2) & (t < 3), 5.0, 0.0)
    first = np.array([0.0, 1000, 3000, 4000, 5000])
    phasor = fit_sinusoid(y, sines_at(t, 1.0, (first, first + 1000)))
    assert (phasor.magnitude, phasor.phase, phasor.interval_method) == (pytest.approx(1), pytest.approx(0.3), "cycles")
    y = np.cos(2 * np.pi * t) + 0.03 * np.cos(6 * np.pi * t) + 0.04 * np.sin(10 * np.pi * t)
    assert fit_sinusoid(y, sines_at(t, 1.0)).distortion == pytest.approx(0.05)


def test_intervals_of_a_response_and_of_its_mean_over_amplitudes_cover_with_few_cycles():
    """95 % of 500 seeded records of six cycles, amplitudes of unequal noise; a normal quantile would reach 90 %."""
    t, w, rng, true, covered = np.arange(0, 6, 1e-2), 2 * np.pi, np.random.default_rng(6), 1 / (200 + 40j), []
    for _ in range(500):
        pair = []
        for noise in (0.5, 2.0):
            theta = 0.05 * np.sin(w * t)
            torque = 0.05 * np.abs(1 / true) * np.sin(w * t - np.angle(true)) + rng.normal(0, noise, len(t))
            pair.append(complex_quotient(fit_sinusoid(theta, sines_at(t, 1.0)), fit_sinusoid(torque, sines_at(t, 1.0))))
        rows = [polar_row(found) for found in (pair[1], complex_mean(pair))]
        covered.append([
            (row["magnitude_low"] <= abs(true) <= row["magnitude_high"])
            + 1j * (row["phase_low_deg"] <= np.rad2deg(np.angle(true)) <= row["phase_high_deg"])
            for row in rows
        ])  # fmt: skip
    share = np.mean(covered, axis=0)
    assert ((share.real > 0.925) & (share.real < 0.975)).all()
    assert ((share.imag > 0.925) & (share.imag < 0.975)).all()


@pytest.mark.parametrize(
    ("rate", "frequency", "message"),
    [(1e3, 0.5, r"less than one cycle at 0\.5 Hz"), (500.0, 60.0, "too long for harmonic 5 of 60 Hz")],
)
def test_sinusoid_refuses_too_short_a_record_and_too_slow_a_sampling(rate, frequency, message):
    t = np.arange(0, 1, 1 / rate)
    with pytest.raises(InputError, match=message):
        fit_sinusoid(np.sin(t), sines_at(t, frequency))


def test_amplitudes_that_differ_from_cycle_to_cycle_leave_the_phase_certain():
    """A phasor at 40 degrees then scatters along itself: errors of its real and imaginary part have the same sign."""
    rng, t, phase = np.random.default_rng(9), np.arange(0, 40, 1e-2), np.deg2rad(40)
    size = 1 + 0.1 * np.repeat(rng.standard_normal(40), 100)
    phasor = fit_sinusoid(size * np.cos(2 * np.pi * t + phase) + 1e-3 * rng.standard_normal(len(t)), sines_at(t, 1.0))
    assert phasor.covariance[0, 1] > 0
    assert phasor.magnitude_se == pytest.approx(0.1 / np.sqrt(40), rel=0.3)
    assert phasor.phase_se < 0.02 * phasor.magnitude_se
