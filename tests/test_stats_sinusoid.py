"""Sinusoids: phasor, distortion, and complex estimates with their intervals."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

from osl_analysis.errors import InputError
from osl_analysis.stats.sinusoid import (
    complex_from_row,
    complex_mean,
    complex_quotient,
    complex_row,
    fit_sinusoid,
    polar_row,
)


def test_phasor_agrees_with_a_nonlinear_least_squares_fit():
    t = np.arange(0, 5, 1e-3)
    rng = np.random.default_rng(3)
    y = 0.4 * np.cos(2 * np.pi * 2 * t + 0.7) + 1.0 + rng.normal(0, 0.05, len(t))
    phasor = fit_sinusoid(t, y, 2.0)

    def sine(t, a, phase, offset):
        return a * np.cos(2 * np.pi * 2 * t + phase) + offset

    (a, phase, _), covariance = curve_fit(sine, t, y, p0=(0.3, 0.5, 0.0))
    assert (abs(phasor.value), np.angle(phasor.value)) == pytest.approx((a, phase), rel=2e-3)
    assert np.sqrt(np.trace(phasor.covariance) / 2) == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.3)


def test_distortion_is_the_share_of_the_harmonics():
    t = np.arange(0, 4, 1e-3)
    y = np.cos(2 * np.pi * t) + 0.03 * np.cos(6 * np.pi * t) + 0.04 * np.sin(10 * np.pi * t)
    assert fit_sinusoid(t, y, 1.0).distortion == pytest.approx(0.05)


def test_intervals_of_a_response_and_of_its_mean_over_amplitudes_cover_with_few_cycles():
    """95 % of 500 seeded records of six cycles, amplitudes of unequal noise; a normal quantile would reach 90 %."""
    t, w, rng, true, covered = np.arange(0, 6, 1e-2), 2 * np.pi, np.random.default_rng(6), 1 / (200 + 40j), []
    for _ in range(500):
        pair = []
        for noise in (0.5, 2.0):
            theta = 0.05 * np.sin(w * t)
            torque = 0.05 * np.abs(1 / true) * np.sin(w * t - np.angle(true)) + rng.normal(0, noise, len(t))
            pair.append(complex_quotient(fit_sinusoid(t, theta, 1.0), fit_sinusoid(t, torque, 1.0)))
        rows = [polar_row(found) for found in (pair[1], complex_mean(pair))]
        covered.append([
            (row["magnitude_low"] <= abs(true) <= row["magnitude_high"])
            + 1j * (row["phase_low_deg"] <= np.rad2deg(np.angle(true)) <= row["phase_high_deg"])
            for row in rows
        ])  # fmt: skip
    share = np.mean(covered, axis=0)
    assert ((share.real > 0.925) & (share.real < 0.975)).all()
    assert ((share.imag > 0.925) & (share.imag < 0.975)).all()


def test_a_phasor_survives_its_row_of_a_table():
    t = np.arange(0, 8, 1e-2)
    found = fit_sinusoid(t, np.sin(7 * t) + np.random.default_rng(7).normal(0, 0.1, len(t)), 1.0)
    again = complex_from_row("theta", complex_row("theta", found))
    assert (again.value, again.degrees_of_freedom) == (found.value, found.degrees_of_freedom)
    np.testing.assert_array_equal(again.covariance, found.covariance)


def test_sinusoid_refuses_too_short_a_record_and_too_slow_a_sampling():
    t = np.arange(0, 1, 1e-3)
    with pytest.raises(InputError, match=r"less than one cycle at 0\.5 Hz"):
        fit_sinusoid(t, np.sin(t), 0.5)
    with pytest.raises(InputError, match="too long for harmonic 5 of 60 Hz"):
        fit_sinusoid(np.arange(0, 1, 2e-3), np.zeros(500), 60.0)


def test_amplitudes_that_differ_from_cycle_to_cycle_leave_the_phase_certain():
    """A phasor at 40 degrees then scatters along itself: errors of its real and imaginary part have the same sign."""
    rng, t, phase = np.random.default_rng(9), np.arange(0, 40, 1e-2), np.deg2rad(40)
    size = 1 + 0.1 * np.repeat(rng.standard_normal(40), 100)
    phasor = fit_sinusoid(t, size * np.cos(2 * np.pi * t + phase) + 1e-3 * rng.standard_normal(len(t)), 1.0)
    assert phasor.covariance[0, 1] > 0
    assert phasor.magnitude_se == pytest.approx(0.1 / np.sqrt(40), rel=0.3)
    assert phasor.phase_se < 0.02 * phasor.magnitude_se
