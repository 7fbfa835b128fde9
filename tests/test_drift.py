"""The drift of a load cell is seen in the means of cycles, and nothing else is."""

import numpy as np
import pytest

from osl_analysis.fits.drift import drift_rate
from osl_analysis.fits.protocol import Segment

RATE = 500.0
SEGMENTS = [Segment(0.1, 2.0, 250, 2750, 10), Segment(0.1, 4.0, 2750, 4000, 10)]
TIME = np.arange(4500) / RATE


def sines(amplitude=20.0):
    """Whole cycles of two frequencies, rest before and after."""
    signal = np.zeros_like(TIME)
    for segment in SEGMENTS:
        t = TIME[segment.rows] - TIME[segment.start]
        signal[segment.rows] = amplitude * np.sin(2 * np.pi * segment.frequency_hz * t + 1.0)
    return signal


def test_a_sine_of_any_phase_has_no_drift_and_a_drift_is_found_under_it():
    assert drift_rate(TIME, sines() + 3.0, SEGMENTS) == pytest.approx(0, abs=1e-12)
    # the sine sees its own phase against the ramp within each cycle alike: only the means tell
    assert drift_rate(TIME, sines() + 3.0 + 0.02 * TIME, SEGMENTS) == pytest.approx(0.02, rel=1e-9)


def test_the_drift_s_error_is_that_of_a_line_through_all_settled_samples():
    """Weighted means of cycles lose 1 % of what all samples know: var = sigma^2/sum (t - mean)^2."""
    rng, t = np.random.default_rng(2), TIME[250:4000]
    found = [drift_rate(TIME, sines() + rng.normal(0, 0.5, len(TIME)), SEGMENTS) for _ in range(800)]
    assert np.std(found) == pytest.approx(0.5 / np.sqrt(np.sum((t - t.mean()) ** 2)), rel=0.08)


def test_rests_and_transients_do_not_count():
    torque = sines() + 0.02 * TIME
    torque[:250], torque[4000:] = 100.0, -100.0
    assert drift_rate(TIME, torque, SEGMENTS) == pytest.approx(0.02)


def test_four_cycles_tell_no_drift():
    assert drift_rate(TIME, 0.02 * TIME, [Segment(0.1, 2.0, 250, 1250, 4)]) == 0.0


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_a_mean_torque_that_grows_with_the_amplitude_is_no_drift(drift):
    """As of an asymmetric joint, in a protocol whose amplitudes grow: 200 theta^2 read 0.56 N*m/min and K 12 SE off."""
    larger = [Segment(0.2, 2.0, 2750, 4000, 5)]
    torque = np.where(np.arange(len(TIME)) < 2750, 1.0, 4.0) + drift * TIME
    assert drift_rate(TIME, torque, SEGMENTS[:1] + larger) == pytest.approx(drift, abs=1e-12)
