"""Intervals of torque and stiffness of a branch, against formulas and against scatter."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t as student

from osl_analysis.bench.branch_curve import (
    LocalParabola,
    branch_curve,
    half_widths_by_noise,
    local_parabola,
)

K = 200.0
AT_DEG = np.array([5.0])
STEP = np.deg2rad(0.1)
WINDOW = 10 * STEP  # 21 samples
THETA = np.deg2rad(5.0) + STEP * np.arange(-30, 31)


def test_several_cycles_have_the_interval_of_their_mean():
    offsets, stiffer = np.array([0.0, 0.3, -0.1]), np.array([2.0, -1.0, 5.0])
    angle = THETA - np.deg2rad(5.0)
    cycles = [(THETA, (K + d) * angle + a) for a, d in zip(offsets, stiffer, strict=True)]

    curve = branch_curve(cycles, AT_DEG, WINDOW, 1)

    of_mean = student.ppf(0.975, 2) / np.sqrt(3)
    half = curve["torque_high"][0] - curve["torque"][0]
    of_slope = curve["stiffness_high"][0] - curve["stiffness"][0]
    assert curve["torque"][0] == pytest.approx(np.mean(offsets))
    assert half == pytest.approx(of_mean * np.std(offsets, ddof=1))
    assert curve["stiffness"][0] == pytest.approx(K + np.mean(stiffer))
    assert of_slope == pytest.approx(of_mean * np.std(stiffer, ddof=1))
    assert curve["change"][0] == pytest.approx(-0.1)


def test_one_cycle_s_interval_has_the_mean_density_of_its_noise():
    """With 6 degrees of freedom the median of densities is 11 % below their mean."""
    freedom, noise = 6.0, 0.2
    densities = noise**2 * np.random.default_rng(1).chisquare(freedom, 20_000) / freedom
    fits = [LocalParabola(0, 0, 0.5, 4.0, density, freedom) for density in densities]

    of_torque, of_slope = half_widths_by_noise(fits)

    assert of_torque[0] == pytest.approx(1.96 * noise * np.sqrt(0.5), rel=0.01)
    assert of_slope[0] == pytest.approx(1.96 * noise * np.sqrt(4.0), rel=0.01)


def test_the_variance_of_torque_is_that_of_savitzky_and_golay():
    n = 21

    fit = local_parabola(THETA, K * THETA, np.deg2rad(5.0), 1.0001 * WINDOW, 1)

    assert fit.torque_variance == pytest.approx(3 * (3 * n**2 - 7) / (4 * n * (n**2 - 4)))


def test_noise_that_is_correlated_widens_the_interval_as_estimates_scatter():
    rng = np.random.default_rng(2)
    theta = np.deg2rad(5.0) + STEP * np.arange(-1000, 1001)
    window, independent = 900 * STEP, 5
    values, squared_errors = [], []

    for _ in range(300):
        noise = lfilter([1.0], [1.0, -0.9], rng.standard_normal(len(theta)))
        fit = local_parabola(theta, K * theta + noise, np.deg2rad(5.0), window, independent)
        values.append(fit.torque)
        squared_errors.append(fit.density * fit.torque_variance)

    assert np.sqrt(np.mean(squared_errors)) == pytest.approx(np.std(values), rel=0.25)
