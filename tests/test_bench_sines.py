"""The sine of a segment before an encoder rounded it, and the intervals of K that rest on it."""

from dataclasses import replace

import numpy as np
import pytest
from bench_synthetic import LOW_PASS, second_order, stepped_sine

from osl_analysis.bench.impedance import impedance_of
from osl_analysis.bench.sines import with_sines
from osl_analysis.protocol.commanded import SteppedSineProtocol
from osl_analysis.signals import filtered_motion

STEP = 2 * np.pi / 2**12
SLOW = SteppedSineProtocol((0.07,), (1.0, 2.0, 5.0), 9)


def test_peaks_are_known_to_a_twentieth_of_a_step_where_the_filtered_angle_stays_on_the_step():
    record = stepped_sine(second_order, protocol=SLOW)
    rounded = STEP * np.rint(record.theta / STEP + 0.3)
    filtered = filtered_motion(record.time, rounded, record.torque, LOW_PASS)[0].theta
    found = with_sines(filtered, record.time, record.segments(None))
    slowest = record.segments(None)[0]
    error = np.array([slowest.part(x - record.theta) for x in (found, filtered)])
    error = np.ptp(error - error.mean(axis=1)[:, None], axis=1)
    assert error[0] < 0.1 * STEP
    assert error[1] > 3 * error[0]
    between = np.ones(len(found), dtype=bool)
    for segment in record.segments(None):
        between[segment.rows] = False
    assert between.any()
    np.testing.assert_array_equal(found[between], filtered[between])


def test_a_motion_with_a_third_harmonic_is_kept():
    record = stepped_sine(second_order, protocol=SLOW)
    segment, time = record.segments(None)[1], record.time
    bent = 0.07 * np.sin(4 * np.pi * time + 0.3) + 0.01 * np.cos(12 * np.pi * time) + 0.2
    found = with_sines(bent, time, [segment])
    np.testing.assert_allclose(segment.part(found), segment.part(bent), atol=1e-9)


@pytest.mark.parametrize("amplitude", [0.07, 0.0704])
def test_the_standard_error_of_k_at_12_bits_does_not_hang_on_where_the_zero_of_the_encoder_is(amplitude):
    """Rounding makes nearly all of it; its size belongs to the motion, whatever the zero happens to be."""
    found = []
    for zero in np.arange(8) / 8:
        record = rounded_trial(amplitude, zero)
        fit = impedance_of(record, None)
        found.append((fit["K"] - 200, fit.se("K")))
    errors, standard = np.array(found).T
    assert standard.std() < 0.25 * standard.mean()
    assert np.abs(errors).max() < 2 * standard.mean()


def rounded_trial(amplitude, zero):
    """A trial whose angle is rounded to 12 bits from some zero, of a joint that moves without rounding."""
    record = stepped_sine(second_order, 0.003, SteppedSineProtocol((amplitude,), (1.0, 2.0, 5.0), 9))
    theta = STEP * np.rint(record.theta / STEP + zero)
    motion, torque = filtered_motion(record.time, theta, record.torque, LOW_PASS)
    return replace(record, theta=theta, motion=motion, filtered_torque=torque, steps=(STEP, None))
