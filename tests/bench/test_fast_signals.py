# SPDX-License-Identifier: Apache-2.0
"""Signals without what is slower than the motion, and the angle's noise in their products."""

import numpy as np
import pytest
import scipy

from osl_analysis.bench.regression import (
    DERIVATIVES,
    noise_products,
    running_mean,
    with_gain,
    without_slower,
)


@pytest.mark.parametrize("period", [0.4, 1.0, 7.0, 8.0, 12.34, 49.0, 49.5, 50.0, 80.0])
def test_a_running_mean_is_that_of_a_period_about_each_row_within_the_rows(period):
    n = 50
    signals = np.random.default_rng(1).normal(size=(2, n))
    length = min(period, n)
    begins = np.clip(np.arange(n) + 0.5 - length / 2, 0, n - length)
    # the integral of a signal that is constant in each row
    integral = scipy.interpolate.make_interp_spline(
        np.arange(n + 1), np.pad(np.cumsum(signals, axis=1), ((0, 0), (1, 0))), k=1, axis=1
    )
    expected = (integral(begins + length) - integral(begins)) / length

    means = running_mean(signals, period)

    np.testing.assert_allclose(means, expected, atol=1e-13)


def test_noise_of_the_angle_has_the_products_of_its_derivatives():
    """Truth: a sum of sines of random phases, differentiated by hand, over whole periods."""
    rng = np.random.default_rng(2)
    frequency_hz = np.array([1.0, 2.0, 5.0])
    power = np.array([3.0, 2.0, 0.5])
    t = np.arange(1000) / 1000
    phases = 2 * np.pi * (np.outer(frequency_hz, t) + rng.random((3, 1)))
    lines = np.sqrt(2 * power)[:, None] * np.exp(1j * phases)
    s = 2j * np.pi * frequency_hz[:, None]
    names = ["one", *DERIVATIVES, "torque"]
    columns = np.array([0 * t, *[np.sum(s**k * lines, axis=0).real for k in range(5)], 0 * t])

    products = noise_products(names, frequency_hz, power)

    expected = columns @ columns.T / len(t)
    np.testing.assert_allclose(products, expected, atol=1e-9 * expected.max())


@pytest.mark.parametrize("rows", [100, 997, 1000])
def test_a_filter_by_lines_keeps_constants_and_linear_relations_at_any_length(rows):
    """997 is prime: its signals are continued by their mirror image."""
    theta, omega = np.random.default_rng(3).normal(size=(2, rows))
    signals = np.array([theta, omega, 3 * theta - 2 * omega, np.ones(rows)])

    slow = with_gain(signals, lambda frequency: 1 / (1 + (frequency / 0.05) ** 8))

    np.testing.assert_allclose(slow[2], 3 * slow[0] - 2 * slow[1], atol=1e-12)
    np.testing.assert_allclose(slow[3], 1.0, atol=1e-12)


def test_signals_of_a_prime_length_are_transformed_at_a_fast_one(monkeypatch):
    lengths = []

    def noting(transform):
        def transformed(signals, **options):
            lengths.append(signals.shape[-1])
            return transform(signals, **options)

        return transformed

    for name in ("dct", "idct"):
        monkeypatch.setattr(scipy.fft, name, noting(getattr(scipy.fft, name)))
    sine = np.sin(2 * np.pi * 0.05 * np.arange(9973.0))

    fast = without_slower(sine[None, :], slow=0.001)

    assert lengths == [scipy.fft.next_fast_len(9973, real=True)] * 2
    # far from the ends a sine that is 50 times as fast stays as it is
    np.testing.assert_allclose(fast[0, 2000:-2000], sine[2000:-2000], atol=1e-6)
