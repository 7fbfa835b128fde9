"""Rounding of the encoder in the interval of a sweep, in which the joint turns round at places that change slowly."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from osl_analysis.bench.moving_record import eq15_columns, fit_of, moving_record, with_rounding
from osl_analysis.bench.settings import BenchStiffness, DynamometerAnalysis
from osl_analysis.signals import filtered_motion
from osl_analysis.trial import Trial

SETTINGS = DynamometerAnalysis(
    cutoff_hz=15, order=4, amplitudes_deg=[4], frequencies_hz=[1], cycles=10, settle_cycles=2
)
TRUTH = np.array([300.0, 5.0, 0.02])
STEP = 2 * np.pi / 2**12


def swept(seed, dither=0.0, compliance=0.0):
    """Sweep from 6 to 0.5 Hz in 20 s of an exact joint, by formula; the encoder is at the bench."""
    rng, t = np.random.default_rng(seed), np.arange(5000) / 250
    w = 2 * np.pi * (6 - 5.5 * t / 20)
    phase = 2 * np.pi * (6 * t - 5.5 * t**2 / 40)
    theta, omega = 0.05 * np.sin(phase), 0.05 * w * np.cos(phase)
    alpha = -0.05 * w**2 * np.sin(phase) - 0.05 * 2 * np.pi * 5.5 / 20 * np.cos(phase)
    torque = TRUTH @ [theta, omega, alpha] + 0.02 * rng.standard_normal(len(t))
    read = theta + compliance * torque + STEP * (dither * rng.standard_normal(len(t)) + rng.random())
    return Trial("made", pl.DataFrame({"time": t, "theta": STEP * np.rint(read / STEP), "torque": torque}))


@pytest.mark.parametrize("compliance", [0.0, 1 / 2000])
def test_rounding_is_in_the_interval_of_a_sweep(compliance):
    """12 bits: the errors of 12 zeros of the encoder, also where the bench yields by ten steps below it."""
    bench = BenchStiffness(value="2000 N*m/rad") if compliance else None
    settings = SETTINGS.model_copy(update={"bench_stiffness": bench})
    fits = [moving_record(swept(seed, compliance=compliance), settings).fit for seed in range(12)]
    true = np.sqrt(np.mean([(fit.estimates[:3] - TRUTH) ** 2 for fit in fits], axis=0))
    stated = np.sqrt(np.mean([np.diag(fit.covariance)[:3] for fit in fits], axis=0)) / true
    assert {fit.interval_method for fit in fits} == {"HAC + rounding"}
    assert stated.min() > 0.7
    assert stated.max() < 2.5


def test_noise_that_dithers_the_encoder_leaves_the_interval_of_a_sweep_as_it_is():
    record = moving_record(swept(1, dither=0.8), SETTINGS)
    assert record.steps[0] == pytest.approx(STEP)
    assert record.fit.interval_method == "HAC"
    np.testing.assert_array_equal(record.fit.covariance, fit_of(record).covariance)


def test_the_component_of_rounding_is_what_rounding_with_every_zero_does_to_a_fit():
    """By brute force: the smooth angle rounded with 32 zeros, filtered, and fitted; two stretches.

    The joint is far damped, or heavy, so that the error's derivatives count. By parts nothing is known of the error at
    the stretches' ends, nor of what the filter takes off it near the cut-off, where a heavy joint has it: too wide.
    """
    record = moving_record(swept(1), SETTINGS)
    record = replace(record, pieces=(slice(500, 2300), slice(2600, 4500)))
    alone = fit_of(record)
    for estimates, widest in (([300.0, 30.0, 0.02, 0, 0], 1.05), ([300.0, 5.0, 0.2, 0, 0], 2.0)):
        fit = replace(alone, estimates=np.array(estimates))
        X, changes = np.array(list(eq15_columns(record).values())).T[record.rows], []
        for zero in (np.arange(32) + 0.5) / 32:
            place = record.motion.theta / STEP + zero
            error = filtered_motion(record.time, STEP * (np.rint(place) - place), record.torque, record.low_pass)[0]
            torque = estimates[0] * error.theta + estimates[1] * error.omega + estimates[2] * error.alpha
            changes.append(np.linalg.lstsq(X, record.part(torque))[0])
        found = np.diag(with_rounding(fit, record).covariance - alone.covariance)[:3]
        true = np.mean(np.square(changes), axis=0)[:3]
        ratio = np.sqrt(found / true)
        assert ratio.min() > 0.8
        assert ratio.max() < widest
