"""The drift of a load cell is seen in the means of cycles, and nothing else is."""

import numpy as np
import polars as pl
import pytest
from bench_synthetic import second_order, stepped_sine

from osl_analysis.bench.impedance import impedance_of, impedance_table, trial_phasors
from osl_analysis.bench.segments import Segment
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.bench.stepped_sine import drift_rate, stepped_sine_trial, without_angle
from osl_analysis.protocol.runs import SteppedSineProtocol
from osl_analysis.second_order import impedance_columns
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.regression import linear_fit
from osl_analysis.trial import Trial

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


def test_a_sine_that_decays_has_means_which_are_no_drift():
    """By 1 % in a second at 300 N*m/rad and 6 deg; 0.005 N*m/s of drift is found under it all the same."""
    theta = sines(np.deg2rad(6))
    for segment in SEGMENTS:
        theta[segment.rows] *= np.exp(-0.01 * (TIME[segment.rows] - TIME[segment.start]))
    assert abs(drift_rate(TIME, 300 * theta, SEGMENTS)) > 1e-3
    assert drift_rate(TIME, without_angle(theta, 300 * theta), SEGMENTS) == pytest.approx(0, abs=1e-12)
    drifting = without_angle(theta, 300 * theta + 0.005 * TIME)
    assert drift_rate(TIME, drifting, SEGMENTS) == pytest.approx(0.005, rel=0.02)


def test_a_trial_is_read_without_its_drift_which_the_table_gives_per_minute():
    """A joint of 100 N*m/rad and 2 N*m*s/rad under a load cell that drifts by 0.6 N*m/min."""
    settings = DynamometerAnalysis(
        cutoff_hz=15, order=4, amplitudes_deg=[4], frequencies_hz=[2, 4], cycles=10, settle_cycles=2
    )
    theta = np.zeros_like(TIME)
    for segment in SEGMENTS:
        t = TIME[segment.rows] - TIME[segment.start]
        theta[segment.rows] = np.sin(2 * np.pi * segment.frequency_hz * t)
    theta *= np.deg2rad(4)
    torque = 100 * theta + 2 * np.gradient(theta, TIME) + 3.0
    samples = pl.DataFrame({"time": TIME, "theta": theta, "torque": torque + 0.01 * (TIME - TIME.mean())})
    record = stepped_sine_trial(Trial("a", samples), settings)
    np.testing.assert_allclose(record.torque, torque, atol=2e-3)
    whole = impedance_table(record, trial_phasors(record)).row(-1, named=True)
    assert whole["load_cell_drift"] == pytest.approx(0.6, rel=0.02)
    assert whole["K"] == pytest.approx(100, rel=0.01)


def test_the_standard_error_of_few_cycles_has_what_the_fit_took_of_the_noise():
    """Two cycles are fitted at each frequency, and at 7 Hz the fit follows most of their noise."""
    record = stepped_sine(second_order, 0.03, SteppedSineProtocol((0.05,), (1.0, 3.0, 7.0), 5))
    fit, (motion, torque) = impedance_of(record, None), record.part(None)
    plain = linear_fit(torque, impedance_columns(motion), ResidualCorrelation(every=record.independent_samples))
    assert fit.interval_method == "HAC"
    assert fit.se("I") > 1.15 * plain.se("I")
    assert fit.degrees_of_freedom[2] < 0.8 * plain.degrees_of_freedom[2]
