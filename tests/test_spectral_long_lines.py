"""The lowest lines of a long signal are those of a Fourier transform of all of it, whatever its length."""

import numpy as np
import pytest

from osl_analysis.spectral import long_lines

PRIME = 4999


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setattr(long_lines, "SHORT", 100)


@pytest.mark.parametrize(("n", "period"), [(PRIME, PRIME), (PRIME, 2 * PRIME), (4096, 4096), (777, 800)])
def test_lines_are_those_of_the_whole_transform(n, period):
    signal, count = 3.0 + np.random.default_rng(1).standard_normal(n), period // 10
    expected = np.fft.rfft(signal, period)[:count]
    np.testing.assert_allclose(long_lines.lines(signal, period, count), expected, atol=1e-13 * abs(expected).max())


@pytest.mark.parametrize("period", [PRIME, 4096])
def test_a_signal_comes_back_from_its_lines(period):
    signal = 3.0 + np.random.default_rng(2).standard_normal(period)
    every = np.fft.rfft(signal)
    np.testing.assert_allclose(long_lines.from_lines(every, period, period), signal, atol=1e-12)
    low = np.where(np.arange(len(every)) < 300, every, 0.0)
    expected = np.fft.irfft(low, period)[:1000]
    np.testing.assert_allclose(long_lines.from_lines(every[:300], period, 1000), expected, atol=1e-12)
