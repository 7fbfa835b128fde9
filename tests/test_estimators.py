"""Estimators side by side, and what makes a fit doubtful."""

import numpy as np
import pytest
from conftest import multisine
from scipy.signal import lfilter
from statsmodels.tsa.ar_model import AutoReg

from osl_analysis.bench.diagnostics import (
    nonlinearity,
    torque_lag,
)
from osl_analysis.bench.estimators import (
    ESTIMATORS,
    CovarianceChoice,
    autoregression,
    modulating_function,
)
from osl_analysis.bench.protocol import Block, SteppedSineProtocol, block_segments, settled
from osl_analysis.bench.stepped_sine import RawSignals
from osl_analysis.errors import InputError
from osl_analysis.second_order import impedance_columns, impedance_torque
from osl_analysis.signals import LowPass, Motion
from osl_analysis.stats.comparison import held_out_vaf
from osl_analysis.stats.regression import linear_fit
from osl_analysis.stats.sinusoid import fit_sinusoid

RATE, LOW_PASS = 500.0, LowPass(15)
PROTOCOL = SteppedSineProtocol((0.1,), (1.0, 3.0, 5.0), 9)


def record(rng=None, angle_noise=0.0, torque_noise=0.0, command=True):
    """K 200, B 4, I 0.05, offset 1 by formula, each frequency from phase 0."""
    segments = block_segments(500, 0.1, PROTOCOL, RATE)
    time = np.arange(segments[-1].stop + 500) / RATE
    theta, omega, alpha = np.zeros((3, len(time)))
    for s in segments:
        w, phase = (
            2 * np.pi * s.frequency_hz,
            2 * np.pi * s.frequency_hz * (np.arange(s.start, s.stop) - s.start) / RATE,
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


def test_a_lag_is_told_from_coulomb_friction_by_the_linear_model():
    frequency, theta = np.tile([1.0, 2, 3, 4, 5], 3), np.repeat([0.03, 0.07, 0.1], 5)
    s = 2j * np.pi * frequency
    expected = 300 + 5 * s + 0.05 * s**2
    friction = 4j * 0.1 / (np.pi * theta)
    measured = (expected + friction) * np.exp(-s * 2e-3)
    lag = torque_lag(frequency, theta, measured, expected)
    assert lag.lag == pytest.approx(2e-3, rel=0.02)
    assert abs(torque_lag(frequency, theta, expected + friction, expected).lag) < 1e-4


def test_harmonics_of_coulomb_friction_give_its_size_and_what_it_adds_to_the_damping():
    t, w, A, T_C = np.arange(0, 10, 1e-3), 2 * np.pi, 0.1, 0.4
    omega = A * w * np.cos(w * t)
    torque = 200 * A * np.sin(w * t) + 3 * omega + T_C * np.sign(omega)
    phasor = fit_sinusoid(t, torque, 1.0)
    found = nonlinearity(np.array([1.0]), np.array([A]), phasor.amplitudes[None])
    assert found.coulomb == pytest.approx(T_C, rel=0.01)
    fitted = linear_fit(torque, {"K": A * np.sin(w * t), "B": omega})
    assert found.coulomb_damping == pytest.approx(fitted["B"] - 3, rel=0.02)
    assert found.odd == pytest.approx(4 * T_C / np.pi * np.hypot(1 / 3, 1 / 5) / phasor.amplitudes[0], rel=0.01)
    assert found.even < 0.01


def test_estimates_that_lean_on_one_another_show_in_their_correlation():
    motion = multisine(2.0, 2.4)
    near = linear_fit(motion.theta + np.random.default_rng(5).standard_normal(5000), impedance_columns(motion))
    wide = multisine(0.5, 5.0)
    apart = linear_fit(wide.theta + np.random.default_rng(5).standard_normal(5000), impedance_columns(wide))
    assert near.largest_correlation > 0.95 > apart.largest_correlation


def test_held_out_vaf_is_that_of_the_other_data():
    motion = multisine(1.0, 3.0)
    fit = linear_fit(impedance_torque(100, 2, 0.1, motion), impedance_columns(motion))
    other = multisine(1.0, 3.0, amplitude=0.2)
    torque = impedance_torque(100, 2, 0.1, other)
    assert held_out_vaf(fit, impedance_columns(other), torque) == pytest.approx(100)
    assert held_out_vaf(fit, impedance_columns(other), 2 * torque) == pytest.approx(75)
