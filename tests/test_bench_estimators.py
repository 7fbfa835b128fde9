"""Estimators of Eq. 15 side by side."""

import numpy as np
import polars as pl
import pytest
from bench_synthetic import second_order, stepped_sine
from scipy.signal import lfilter
from statsmodels.tsa.ar_model import AutoReg

from osl_analysis.bench.estimators import (
    ESTIMATORS,
    CovarianceChoice,
    autoregression,
    estimator_table,
    modulating_function,
)
from osl_analysis.bench.segments import Block, Segment, settled
from osl_analysis.bench.settled_signals import RawSignals
from osl_analysis.errors import InputError
from osl_analysis.protocol.commanded import SteppedSineProtocol
from osl_analysis.second_order import impedance_torque
from osl_analysis.signals import LowPass, Motion
from osl_analysis.stats.covariance import FILTER_SPAN, correlation_samples

RATE, LOW_PASS = 500.0, LowPass(15)


PROTOCOL = SteppedSineProtocol((0.1,), (1.0, 3.0, 5.0), 9)


def record(rng=None, angle_noise=0.0, torque_noise=0.0, command=True):
    """K 200, B 4, I 0.05, offset 1 by formula, each frequency from phase 0."""
    ends = 500 + RATE * np.cumsum([0, *(PROTOCOL.cycles / f for f in PROTOCOL.frequencies_hz)])
    segments = tuple(
        Segment(0.1, f, a, b, PROTOCOL.cycles) for f, a, b in zip(PROTOCOL.frequencies_hz, ends, ends[1:], strict=False)
    )
    time = np.arange(round(segments[-1].stop) + 500) / RATE
    theta, omega, alpha = np.zeros((3, len(time)))
    for s in segments:
        w, phase = (
            2 * np.pi * s.frequency_hz,
            2 * np.pi * s.frequency_hz * (s.rows - s.start) / RATE,
        )
        theta[s.rows] = 0.1 * np.sin(phase)
        omega[s.rows], alpha[s.rows] = 0.1 * w * np.cos(phase), -0.1 * w**2 * np.sin(phase)
    torque = impedance_torque(200, 4, 0.05, Motion(theta, omega, alpha)) + 1
    if rng is not None:
        torque = torque + torque_noise * rng.standard_normal(len(time))
    measured = theta if rng is None else theta + angle_noise * rng.standard_normal(len(time))
    return RawSignals(time, measured, theta if command else None, torque, RATE, settled([Block(0.1, segments)], 2))


@pytest.mark.parametrize(("name", "B_error"), [(n, 0.08 if n == "Savitzky-Golay" else 0.02) for n in ESTIMATORS])
def test_every_estimator_recovers_the_impedance_that_made_the_torque(name, B_error):
    """Savitzky and Golay's first derivative is not the derivative of their smoothed angle: B reads 1-2 % low."""
    fit = ESTIMATORS[name](record(), LOW_PASS, CovarianceChoice())
    assert (fit["K"], fit["I"], fit["offset"]) == pytest.approx((200, 0.05, 1), rel=2e-3)
    assert fit["B"] == pytest.approx(4, abs=B_error)


def test_the_weak_form_weighs_the_function_and_its_derivatives_as_integration_by_parts_says():
    phi, first, second = modulating_function(0.1, 1000.0)
    t = (np.arange(len(phi)) - len(phi) // 2) / 1000
    assert (phi.sum(), first.sum(), second.sum()) == pytest.approx((1, 0, 0), abs=1e-6)
    # convolved with t and t^2, at 0: their first and second derivatives there, averaged with phi
    assert (-t) @ first == pytest.approx(1, rel=1e-6)
    assert t**2 @ second == pytest.approx(2, rel=1e-6)


def test_noise_of_the_angle_biases_a_differentiated_wide_band_and_not_the_instruments():
    noisy, wide = record(np.random.default_rng(1), angle_noise=5e-3), LowPass(60)
    ordinary, instrumental = (ESTIMATORS[n](noisy, wide, CovarianceChoice()) for n in ("filtered", "instrumental"))
    assert ordinary["I"] < 0.04
    assert instrumental["I"] == pytest.approx(0.05, abs=4 * instrumental.se("I"))


def test_instruments_need_a_commanded_angle():
    with pytest.raises(InputError, match="theta_command"):
        ESTIMATORS["instrumental"](record(command=False), LOW_PASS, CovarianceChoice())


def test_the_whitening_filter_is_statsmodels_autoregression_and_leaves_white_noise():
    rng = np.random.default_rng(2)
    series = lfilter([1], [1, -1.2, 0.5], rng.standard_normal(4000))
    ar = autoregression([series], 3)
    assert -ar[1:] == pytest.approx(AutoReg(series, 3, trend="n").fit().params, rel=1e-6)
    white = np.convolve(series, ar, "valid")
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.05


def test_pieces_of_a_series_are_not_joined_by_the_whitening_filter():
    series = lfilter([1], [1, -0.9], np.random.default_rng(3).standard_normal(3000))
    assert autoregression([series[:1500] + 50, series[1500:] - 50], 1)[1] != pytest.approx(-0.9, abs=0.05)
    assert autoregression([series[:1500], series[1500:]], 1)[1] == pytest.approx(-0.9, abs=0.05)


def test_without_cycles_noise_counts_as_independent_only_half_a_period_of_the_cutoff_apart():
    """White noise behind 15 Hz has the shortest window, eight half periods; sample by sample it would be far longer."""
    fit = ESTIMATORS["filtered"](record(np.random.default_rng(6), torque_noise=0.5), LOW_PASS, CovarianceChoice(False))
    assert fit.correlation_samples == FILTER_SPAN * LOW_PASS.independent_samples(RATE)
    assert correlation_samples(fit.residual) > 3 * fit.correlation_samples


def test_the_whitening_estimator_fits_four_samples_per_period_of_the_cutoff():
    """One in eight at 500 Hz; the whitening filter of order 8 uses up the first eight of each segment."""
    raw = record(np.random.default_rng(7), torque_noise=0.5)
    fit = ESTIMATORS["whitened"](raw, LOW_PASS, CovarianceChoice())
    assert fit.samples == sum(-(-len(s.rows) // 8) - 8 for s in raw.segments)
    assert fit["K"] == pytest.approx(200, abs=4 * fit.se("K"))


def test_an_estimator_that_thins_its_rows_has_its_times_told_in_seconds_all_the_same():
    """The whitening estimator keeps one row in eight; what is left of white noise is white for both."""
    table = estimator_table(stepped_sine(second_order, noise=0.5))
    filtered, whitened = (
        table.row(by_predicate=pl.col("estimator") == name, named=True) for name in ("filtered", "whitened")
    )
    assert whitened["samples"] < filtered["samples"] / 7
    lag = whitened["correlation_s"] * RATE / 8
    assert lag == pytest.approx(round(lag), abs=0.05 * lag)
    assert min(filtered["ljung_box_p"], whitened["ljung_box_p"]) > 0.01
