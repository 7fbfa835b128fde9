"""The period of a motion that repeats itself, its realisations, and Eq. 15 on their lines."""

import numpy as np
import pytest

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.equation_error import fit_periodic
from osl_analysis.spectral.realisations import distinct, lines_of, period_spectra, periodic_motion

RATE, PERIOD, LOW_PASS = 250.0, 4.0, LowPass(15)
LINES = np.array([3, 5, 9, 11, 13, 17, 21, 23, 27, 29])
K, B, I = 200.0, 4.0, 0.05


def multisine(seed: int, periods: float = 5, ppm: float = 0.0, lines=LINES):
    """theta, omega, alpha (n,) of a random-phase multisine on a clock that is fast by ppm; derivatives by hand."""
    t = np.arange(round(periods * PERIOD * RATE)) / RATE * (1 + 1e-6 * ppm)
    w, phase = 2 * np.pi * lines / PERIOD, np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    turn, size = np.outer(t, w) + phase, 0.05 / np.sqrt(len(lines))
    return np.array([size * np.cos(turn).sum(1), -size * np.sin(turn) @ w, -size * np.cos(turn) @ w**2])


def record(seed: int, *motions, noise: float = 0.0):
    """Angle and torque (n,) of motions one after another, each after a second of rest and a ramp of a second."""
    rest, parts = np.zeros((3, round(RATE))), []
    for motion in motions:
        parts += [rest, np.minimum(np.arange(motion.shape[1]) / RATE, 1.0) * motion]
    theta, omega, alpha = np.hstack([*parts, rest])
    rng = np.random.default_rng(seed)
    torque = K * theta + B * omega + I * alpha + noise * rng.standard_normal(len(theta))
    return theta + 1e-5 * rng.standard_normal(len(theta)), torque


@pytest.mark.parametrize("ppm", [0.0, 100.0, -100.0])
def test_the_period_is_found_within_a_millionth_on_a_clock_that_is_off(ppm):
    found = periodic_motion(*record(1, multisine(1, 6, ppm)), RATE, 10.0)
    assert found.period == pytest.approx(PERIOD / (1 + 1e-6 * ppm), rel=4e-7)
    assert [r.periods for r in found.realisations] == [5]


@pytest.mark.parametrize("seed", range(4))
def test_a_multiple_of_the_period_is_not_taken_for_it(seed):
    theta, torque = record(seed, multisine(seed, 9))
    noisy = theta + 1e-3 * np.random.default_rng(seed).standard_normal(len(theta))
    assert periodic_motion(noisy, torque, RATE, 10.0).period == pytest.approx(PERIOD, rel=1e-4)


def test_a_record_of_three_motions_with_one_period_has_three_realisations():
    found = periodic_motion(*record(2, *(multisine(seed) for seed in (1, 2, 3))), RATE, 10.0)
    assert [r.periods for r in found.realisations] == [4, 4, 4]
    starts = [r.start for r in found.realisations]  # after a second of rest, and a ramp within the first period
    assert np.diff(starts) == pytest.approx([21, 21], abs=0.2)
    ends = [r.start + r.periods * PERIOD for r in found.realisations]
    assert ends == pytest.approx([21, 42, 63], abs=0.3)  # what is over is left out in the transient
    assert 2 < starts[0] < 1 + PERIOD + 0.1


def test_the_same_motion_recorded_twice_is_one_realisation():
    once, other = multisine(1), multisine(2)
    found = periodic_motion(*record(3, once, other, np.roll(once, 300, axis=1)), RATE, 10.0)
    assert [r.periods for r in distinct(found.realisations)] == [8, 4]
    theta = distinct(found.realisations)[0].theta[:, LINES]
    assert np.abs(theta - theta.mean(0)).max() < 1e-3 * np.abs(theta).min()


@pytest.mark.parametrize("motion", ["chirp", "noise", "rest", "once", "by hand"])
def test_what_does_not_repeat_itself_has_no_period(motion):
    t, rng = np.arange(round(40 * RATE)) / RATE, np.random.default_rng(4)
    walk = np.convolve(rng.standard_normal(len(t)), np.hanning(60), "same")
    made = {"chirp": np.sin(np.pi * 0.1 * t**2), "noise": walk, "rest": np.zeros(len(t)), "once": multisine(5, 1.5)[0]}
    made["by hand"] = np.sin(2 * np.pi * 1.2 * t + 2e-2 * np.cumsum(walk) / RATE)  # a sine whose period changes by 5 %
    assert periodic_motion(made[motion], made[motion], RATE, 10.0) is None


def test_a_period_is_found_beside_a_drift_of_the_angle():
    theta, torque = record(11, multisine(1))
    drifting = theta + 0.004 * np.arange(len(theta)) / RATE
    assert periodic_motion(drifting, torque, RATE, 10.0).period == pytest.approx(PERIOD, rel=1e-5)


def test_lines_are_those_that_were_excited_and_the_others_odd_and_even():
    lines = lines_of(periodic_motion(*record(6, multisine(1)), RATE, 10.0).realisations)
    assert list(np.flatnonzero(lines.excited)) == list(LINES)
    assert list(np.flatnonzero(lines.odd)) == [7, 15, 19, 25]
    assert lines.only_odd
    assert list(np.flatnonzero(lines.even)) == list(range(2, 29, 2))


def test_spectra_of_a_period_that_is_no_whole_number_of_samples_leak_nothing():
    samples, k = 333.37, np.array([2, 7])
    t = np.arange(2000)
    y = 3 + 0.5 * np.cos(2 * np.pi * 2 * t / samples + 0.3) + 0.1 * np.sin(2 * np.pi * 7 * t / samples)
    X = period_spectra(y, 100.6, samples, 4, 20)
    expected = np.array([0.5 * np.exp(0.3j), -0.1j]) * np.exp(2j * np.pi * k * 100.6 / samples)
    assert X[0, k] == pytest.approx(expected, abs=1e-6)
    assert X[:, 0] == pytest.approx(3, abs=1e-6)
    turns = np.exp(2j * np.pi * np.outer(np.arange(4), k))  # every period begins at the same phase
    assert X[:, k] == pytest.approx(expected * turns, abs=1e-6)


def test_drift_of_the_load_cell_does_not_reach_the_lines():
    theta, torque = record(7, multisine(1))
    drift = 0.2 * np.arange(len(torque)) / RATE
    still, moved = (
        fit_periodic(periodic_motion(theta, y, RATE, 10.0).realisations, LOW_PASS) for y in (torque, torque + drift)
    )
    assert moved.estimates[:3] == pytest.approx(still.estimates[:3], rel=1e-6)


@pytest.mark.parametrize("seeds", [(1,), (1, 2), (1, 2, 3, 4)])
def test_the_impedance_that_made_the_torque_is_recovered_within_its_interval(seeds):
    found = periodic_motion(*record(8, *map(multisine, seeds), noise=0.02), RATE, 10.0)
    fit = fit_periodic(found.realisations, LOW_PASS)
    assert fit.interval_method == ("detection lines" if len(seeds) < 4 else "realisations")
    for name, true in (("K", K), ("B", B), ("I", I)):
        assert abs(fit[name] - true) < 4.5 * fit.se(name) < 0.01 * true
    assert fit.vaf > 99.99


def test_one_line_does_not_tell_stiffness_from_inertia():
    with pytest.raises((IdentifiabilityError, InputError), match=r"two frequencies|cannot be told apart"):
        fit_periodic(periodic_motion(*record(10, multisine(1, lines=np.array([5]))), RATE, 10.0).realisations, LOW_PASS)
