"""Filter and derivatives: no phase, known gain, known derivative, clear refusals."""

import numpy as np
import pytest
from conftest import multisine

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, differentiate, longest_run, runs, sampling_rate


@pytest.mark.parametrize("f", [2.0, 15.0, 25.0])
def test_zero_phase_filter_has_the_squared_butterworth_gain_and_no_phase(f):
    rate, t = 1000.0, np.arange(0, 20, 1e-3)
    warped = np.tan(np.pi * f / rate) / np.tan(np.pi * 15 / rate)
    out = LowPass(cutoff_hz=15, order=4)(np.cos(2 * np.pi * f * t), rate)
    gain = 1 / (1 + warped**8)
    assert out[8000:12000] == pytest.approx(gain * np.cos(2 * np.pi * f * t[8000:12000]), abs=1e-6)


def test_derivatives_at_the_marker_rate_keep_a_20_hz_motion():
    t = np.arange(300) / 300
    exact = multisine(20.0, duration=1, rate=300)
    found = differentiate(t, exact.theta)
    inner = slice(20, -20)
    assert found.omega[inner] == pytest.approx(exact.omega[inner], abs=1e-3 * np.max(exact.omega))
    assert found.alpha[inner] == pytest.approx(exact.alpha[inner], abs=5e-3 * np.max(np.abs(exact.alpha)))


def test_runs_are_the_stretches_of_true_samples():
    mask = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], dtype=bool)
    assert runs(mask) == [slice(0, 2), slice(3, 4), slice(6, 9)]
    assert longest_run(mask) == slice(6, 9)
    assert (runs(~mask[:1]), longest_run(np.zeros(3, dtype=bool))) == ([], slice(0, 0))


def test_refuses_irregular_stamps_by_time():
    t = np.arange(100) / 100
    assert sampling_rate(t) == pytest.approx(100)
    with pytest.raises(InputError, match=r"the step at 0\.4900 s is 30\.000 ms"):
        sampling_rate(np.concatenate([t[:50], t[50:] + 0.02]))


def test_refuses_a_cut_off_beyond_half_the_rate_and_a_record_shorter_than_its_edge():
    with pytest.raises(InputError, match="60 Hz must lie between 0 and half the sampling rate of 100 Hz"):
        LowPass(60.0)(np.zeros(1000), 100.0)
    with pytest.raises(InputError, match="too few for a 5 Hz filter"):
        LowPass(5.0)(np.zeros(50), 100.0)
