"""Filter and derivatives: no phase, known gain, known derivative, clear refusals."""

import numpy as np
import pytest

from osl_analysis.errors import InputError
from osl_analysis.model.multisine import odd_lines, odd_multisine
from osl_analysis.signals import LowPass, differentiate, filtered_motion, sampling_rate


@pytest.mark.parametrize("order", [2, 4])
def test_a_filter_has_no_phase_and_the_gain_and_noise_bandwidth_that_its_impulse_shows(order):
    """What the analysis knows of the filter, whatever its design: 4 kHz are far above the cut-off
    of 15 Hz."""
    n, rate, low_pass = 2**15, 4000.0, LowPass(15.0, order)
    impulse = np.where(np.arange(n) == n // 2, 1.0, 0.0)
    f, seen = np.fft.rfftfreq(n, 1 / rate), np.fft.rfft(np.roll(low_pass(impulse, rate), -n // 2))
    assert seen.imag == pytest.approx(0, abs=1e-9)
    assert low_pass.gain(f[f < 60]) == pytest.approx(seen.real[f < 60], abs=2e-3)
    assert (low_pass.gain(np.array([15.0]))[0], low_pass.independent_samples(rate)) == (
        pytest.approx(0.5),
        133,
    )
    assert low_pass.noise_bandwidth_hz == pytest.approx(np.trapezoid(seen.real**2, f), rel=2e-3)


@pytest.mark.parametrize("rate", [100.0, 500.0, 890.0, 900.0, 1000.0, 4000.0])
def test_derivatives_of_a_filtered_angle_are_those_of_its_sine_at_any_rate(rate):
    """5 Hz behind a filter of 15 Hz: the spline below 890 Hz loses (w/rate)^4/720, 1.4e-5 at 100
    Hz; above, nothing."""
    time, w = np.arange(round(6 * rate)) / rate, 2 * np.pi * 5
    theta = 0.1 * np.sin(w * time)
    motion, torque = filtered_motion(time, theta, 2 * theta, LowPass(15))
    settled = slice(round(2 * rate), round(4 * rate))
    gain = motion.theta[settled] @ theta[settled] / (theta[settled] @ theta[settled])
    bound, velocity = (
        1e-9 if rate > 890 else 1.2 * (w / rate) ** 4 / 720,
        gain * 0.1 * w * np.cos(w * time[settled]),
    )
    assert motion.omega[settled] == pytest.approx(velocity, abs=0.1 * w * (bound + 1e-9))
    assert motion.alpha[settled] == pytest.approx(
        -(w**2) * gain * theta[settled], abs=0.1 * w**2 * (bound + 1e-9)
    )
    assert np.array_equal(torque, 2 * motion.theta)


@pytest.mark.parametrize(("make", "message"), [
    (lambda t: sampling_rate(np.where(t < 0.5, t, t + 0.02)),
     r"the step at 0\.4900 s is 30\.000 ms"),
    (lambda t: LowPass(60.0)(t, 100.0),
     "60 Hz must lie between 0 and half the sampling rate of 100 Hz"),
    (lambda t: LowPass(5.0)(t[:60], 100.0),
     "60 samples cannot be filtered at 5 Hz; record over 0.6 s"),
    (lambda t: sampling_rate(np.where(t < 0.5, t, t - 0.003)),
     r"the step at 0\.4900 s is 7\.000 ms"),
    (lambda t: differentiate(t[[0, 1, 2, 3, 4, 4, 5]], t[:7]), "each later than the one before"),
])  # fmt: skip
def test_refuses_irregular_stamps_a_cut_off_beyond_half_the_rate_and_a_record_shorter_than_its_edge(
    make, message
):
    t = np.arange(100) / 100
    assert sampling_rate(t) == pytest.approx(100)
    with pytest.raises(InputError, match=message):
        make(t)


DEFAULT = odd_multisine(8.0, (0.5, 6.0), np.deg2rad(2), seed=3)


def test_only_odd_lines_move_all_alike_with_the_stated_size_and_derivatives():
    n = 4096
    size = 2 * np.abs(np.fft.rfft(DEFAULT.angle(DEFAULT.period_s * np.arange(n) / n))) / n
    moved = np.flatnonzero(size > 1e-12)
    np.testing.assert_array_equal(moved, DEFAULT.lines)
    assert (moved % 2 == 1).all()
    np.testing.assert_allclose(size[moved], size[moved[0]])
    assert np.rad2deg(
        np.sqrt(np.mean(DEFAULT.angle(DEFAULT.period_s * np.arange(n) / n) ** 2))
    ) == pytest.approx(2)
    time, h = np.linspace(0, 8, 50), 1e-4
    for k in (0, 1):
        slope = (DEFAULT.angle(time + h, k) - DEFAULT.angle(time - h, k)) / (2 * h)
        np.testing.assert_allclose(
            DEFAULT.angle(time, k + 1), slope, atol=1e-4 * np.abs(slope).max()
        )


def test_one_odd_line_in_four_is_left_out_and_none_at_the_ends():
    for seed in range(40):
        lines, left_out = odd_lines(8.0, (0.5, 6.0), seed)
        np.testing.assert_array_equal(np.union1d(lines, left_out), np.arange(5, 48, 2))
        np.testing.assert_array_equal((left_out - 5) // 8, np.arange(5))  # of each group of four
        assert lines[[0, -1]].tolist() == [5, 47]
        # 20 lines: the last group is a whole one
        assert odd_lines(8.0, (0.5, 5.5), seed)[0][-1] == 43


@pytest.mark.parametrize(
    ("period", "band", "rms"),
    [(8, (6, 0.5), 0.1), (0.5, (0.5, 6), 0.1), (0, (1, 2), 0.1), (8, (0.5, 6), 0)],
)
def test_what_moves_nothing_or_has_too_few_lines_is_refused(period, band, rms):
    with pytest.raises(InputError):
        odd_multisine(period, band, rms, seed=1)


def test_a_straight_line_passes_the_low_pass_unchanged_up_to_both_ends():
    """The filter settles within three periods of the cut-off beyond each end: to 1 % of the line's
    rise per sample."""
    rise = 0.01
    line = 3.0 + rise * np.arange(2000)

    filtered = LowPass(15.0)(line, rate_hz=1000.0)

    np.testing.assert_allclose(filtered, line, rtol=0, atol=0.01 * rise)
