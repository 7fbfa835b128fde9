# SPDX-License-Identifier: Apache-2.0
"""Filter and derivatives: no phase, known gain, known derivative, clear refusals."""

import numpy as np
import pytest
import scipy
from conftest import refused_with

from osl_analysis.signals.filters import (
    LowPass,
    differentiate,
    longest_run,
    runs,
    sampling_rate,
    seven_point_motion,
    unfollowed_density,
)


def response_to_an_impulse(low_pass: LowPass) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz], and the spectrum of the filter's answer to an impulse at time 0, by samples
    at 4 kHz."""
    n = 2**15
    impulse = np.zeros(n)
    impulse[n // 2] = 1.0
    answer = np.roll(low_pass(impulse, 4000.0), -n // 2)
    return np.fft.rfftfreq(n, 1 / 4000.0), np.fft.rfft(answer)


@pytest.mark.parametrize("order", [2, 4])
def test_a_filter_has_no_phase_and_the_gain_of_the_impulse_s_answer(order):
    """What the analysis knows of the filter, whatever its design: 4 kHz are far above 15 Hz."""
    low_pass = LowPass(15.0, order)
    frequency, spectrum = response_to_an_impulse(low_pass)
    low = frequency < 60

    gain = low_pass.gain(frequency)

    assert gain[low] == pytest.approx(spectrum.real[low], abs=2e-3)
    assert spectrum.imag == pytest.approx(0, abs=1e-9)


def test_the_gain_at_the_cut_off_is_one_half_after_both_runs():
    gain = LowPass(15.0).gain(np.array([15.0]))

    assert gain[0] == pytest.approx(0.5)


def test_a_straight_line_passes_the_low_pass_unchanged_up_to_both_ends():
    """The filter settles within three periods of the cut-off beyond each end: to 1 % of the line's
    rise per sample."""
    rise = 0.01
    line = 3.0 + rise * np.arange(2000)

    filtered = LowPass(15.0)(line, rate_hz=1000.0)

    np.testing.assert_allclose(filtered, line, rtol=0, atol=0.01 * rise)


@pytest.mark.parametrize("rate", [100.0, 500.0, 890.0, 900.0, 1000.0, 4000.0])
def test_derivatives_of_a_filtered_sine_are_its_own_at_any_rate(rate):
    """5 Hz behind a filter of 15 Hz: the spline below 890 Hz loses (w/rate)^4/720, 1.4e-5 at 100
    Hz; above, nothing."""
    w = 2 * np.pi * 5
    time = np.arange(round(6 * rate)) / rate
    theta = 0.1 * np.sin(w * time)

    motion = seven_point_motion(LowPass(15)(theta, rate), rate)

    settled = slice(round(2 * rate), round(4 * rate))
    sine = theta[settled]
    gain = motion.theta[settled] @ sine / (sine @ sine)
    velocity = gain * 0.1 * w * np.cos(w * time[settled])
    acceleration = -(w**2) * gain * sine
    lost = 1e-9 if rate > 890 else 1.2 * (w / rate) ** 4 / 720
    assert motion.omega[settled] == pytest.approx(velocity, abs=0.1 * w * (lost + 1e-9))
    assert motion.alpha[settled] == pytest.approx(acceleration, abs=0.1 * w**2 * (lost + 1e-9))


def test_the_rate_is_that_of_uniform_stamps():
    assert sampling_rate(np.arange(100) / 100) == pytest.approx(100)


TIME = np.arange(100) / 100
WITH_A_GAP = np.where(TIME < 0.5, TIME, TIME + 0.02)
WITH_A_SHORT_STEP = np.where(TIME < 0.5, TIME, TIME - 0.003)
WITH_A_REPEATED_STAMP = TIME[[0, 1, 2, 3, 4, 4, 5]]


@pytest.mark.parametrize(
    ("refused", "says"),
    [
        (lambda: sampling_rate(WITH_A_GAP), r"step.*0\.4900 s.*30\.000 ms"),
        (lambda: sampling_rate(WITH_A_SHORT_STEP), r"step.*0\.4900 s.*7\.000 ms"),
        (lambda: LowPass(60.0)(TIME, 100.0), "60 Hz.*0.*rate.*100 Hz"),
        (lambda: LowPass(5.0)(TIME[:60], 100.0), r"60 samples.*5 Hz;.*0\.6 s"),
        (lambda: differentiate(WITH_A_REPEATED_STAMP, TIME[:7]), "7 samples"),
    ],
)
def test_refuses_stamps_and_records_without_a_rate_or_a_slope(refused, says):
    with refused_with(says):
        refused()


def test_six_samples_tell_the_slope_of_a_quintic():
    time = TIME[:6]

    assert differentiate(time, time**5).omega == pytest.approx(5 * time**4, abs=1e-12)


def test_runs_are_the_stretches_of_true_samples_and_the_longest_of_them():
    mask = np.array([1, 1, 0, 0, 1, 1, 1, 0, 1], dtype=bool)

    assert runs(mask) == [slice(0, 2), slice(4, 7), slice(8, 9)]
    assert longest_run(mask) == slice(4, 7)
    assert longest_run(~mask[:2]) == slice(0, 0)


def test_what_another_signal_follows_is_taken_off_a_density_by_the_coherence():
    """SciPy's own coherence of a signal with a delayed copy in noise; of independent ones all is
    left."""
    random = np.random.default_rng(4)
    signal, noise = random.standard_normal((2, 40_000))
    follower = np.roll(signal, 3) + 0.5 * noise
    options = {"fs": 100.0, "nperseg": 200, "noverlap": 100, "detrend": "constant"}
    of_scipy = scipy.signal.welch(signal, **options)[1]
    coherence = scipy.signal.coherence(signal, follower, **options)[1]

    _, left = unfollowed_density(signal, follower, 100.0, 200, 1e-3)
    _, all_of_it = unfollowed_density(signal, noise, 100.0, 200, 1e-9)

    inside = slice(1, -1)  # a constant, and half of the rate, have one line
    assert left[inside] == pytest.approx((of_scipy * (1 - coherence))[inside], rel=1e-6)
    assert all_of_it[inside] == pytest.approx(of_scipy[inside], rel=1e-6)
