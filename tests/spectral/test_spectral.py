# SPDX-License-Identifier: Apache-2.0
"""The period of a motion that repeats itself, and its realisations."""

import numpy as np
import pytest
from conftest import white_noise

from osl_analysis.bench.motion import BENCH_SCATTER
from osl_analysis.spectral.periodic import likely_lags, periodic_motion

RATE = 250.0
PERIOD = 4.0
LINES = np.array([3, 5, 9, 11, 13, 17, 21, 23, 27, 29])


# ---- Records of a joint in closed form


def multisine(seed: int, periods: float = 5, ppm: float = 0.0):
    """Angle (n,) of a random-phase multisine on a clock that is fast by ppm."""
    time = np.arange(round(periods * PERIOD * RATE)) / RATE * (1 + 1e-6 * ppm)
    phase = np.outer(time, 2 * np.pi * LINES / PERIOD)
    phase = phase + np.random.default_rng(seed).uniform(0, 2 * np.pi, len(LINES))
    return 0.05 / np.sqrt(len(LINES)) * np.cos(phase).sum(axis=1)


def record(seed, *motions):
    """Angle (n,) of motions one after another, each after a second of rest and a ramp of a
    second."""
    rest = np.zeros(round(RATE))
    parts = []
    for motion in motions:
        ramp = np.minimum(np.arange(len(motion)) / RATE, 1.0)
        parts.extend([rest, ramp * motion])
    theta = np.concatenate([*parts, rest])
    return theta + 1e-5 * white_noise(len(theta), seed)


def motion_of(theta):
    return periodic_motion(theta, RATE, np.ones(len(theta), dtype=bool))


def smooth_noise(seed, n):
    return np.convolve(white_noise(n, seed), np.hanning(60), "same")


# ---- The period


@pytest.mark.parametrize("ppm", [100.0, -100.0])
def test_the_period_on_a_wrong_clock_is_found_to_less_than_a_millionth(ppm):
    theta = record(1, multisine(1, 6, ppm))

    motion = motion_of(theta)

    assert motion.realisation.tolist() == [0] * 5
    error_ppm = 1e6 * (motion.period / PERIOD * (1 + 1e-6 * ppm) - 1)
    assert abs(error_ppm) < 1


def test_noise_of_a_sixth_of_a_motion_hides_no_period():
    theta = multisine(1, 6)

    motion = motion_of(theta + 0.17 * np.std(theta) * white_noise(len(theta), 2))

    assert motion is not None
    assert motion.period == pytest.approx(PERIOD, rel=1e-3)


T = np.arange(round(40 * RATE)) / RATE
WITHOUT_PERIOD = {
    "chirp": np.sin(np.pi * 0.1 * T**2),
    "noise": smooth_noise(4, len(T)),
    "once": multisine(5, 1.5),
    # a sine whose period changes by 5 %
    "by hand": np.sin(2 * np.pi * 1.2 * T + 2e-2 * np.cumsum(smooth_noise(4, len(T))) / RATE),
}


@pytest.mark.parametrize("theta", WITHOUT_PERIOD.values(), ids=WITHOUT_PERIOD)
def test_what_does_not_repeat_itself_has_no_period(theta):
    motion = motion_of(theta)
    assert motion is None or motion.scatter > BENCH_SCATTER


@pytest.mark.parametrize(
    ("periods", "other_s", "size", "repeats"),
    [
        (5, 10.0, 0.6, True),
        (3, 22.0, 0.6, False),
        (3, 22.0, 0.05, True),
    ],
)
def test_a_motion_has_a_period_if_it_repeats_itself_half_of_its_time(
    periods, other_s, size, repeats
):
    """A multisine, 20 s of 30 or 12 s of 34, and then noise that repeats nothing, of this part of
    its size. A twentieth is a rest."""
    repeated = multisine(1, periods)
    noise = smooth_noise(2, round(other_s * RATE))
    noise *= size * np.std(repeated) / np.std(noise)
    theta = np.concatenate([repeated, noise])

    found = motion_of(theta)

    assert (found is not None) == repeats
    if found is not None:
        assert found.period == pytest.approx(PERIOD, rel=1e-3)


def test_of_a_long_sine_sixty_lags_are_tried():
    assert len(likely_lags(np.sin(np.arange(20000.0) / 10))) == 60


# ---- Realisations


@pytest.fixture(scope="module")
def three_motions():
    """Two motions of one period, the first of them again, shifted."""
    first = multisine(1)
    theta = record(3, first, multisine(2), np.roll(first, 300))
    return motion_of(theta)


def test_a_realisation_begins_after_the_rest_and_ends_with_its_motion(three_motions):
    """After a second of rest, and a ramp within the first period; what is over is left out."""
    starts = three_motions.begins[three_motions.realisation.searchsorted([0, 1, 2])]

    assert np.diff(starts) == pytest.approx([21, 21], abs=0.2)
    assert starts + 4 * PERIOD == pytest.approx([21, 42, 63], abs=0.2)
    assert 2 < starts[0] < 1 + PERIOD + 0.1


TRANSIENT = np.pad(np.hanning(200), (100, 5700))
QUIET = np.tile(multisine(1, 1), 6) + 1e-4 * white_noise(6000, 3)


@pytest.mark.parametrize(
    ("theta", "periods"),
    [
        (record(3, multisine(1, 2.35), multisine(2, 2.35)), [2, 2]),
        (record(1, multisine(1), 0.3 * multisine(2)), [4, 4]),
        # 4 and 7 times the noise
        (QUIET + 4e-4 * TRANSIENT, [6]),
        (QUIET + 7e-4 * TRANSIENT, [5]),
        # an end is known to 30 ms
        (np.pad(multisine(1, 5.02), (250, 0)), [4]),
        (np.pad(multisine(1, 5.03), (250, 0)), [5]),
    ],
)
def test_a_realisation_has_its_settled_periods_and_may_be_smaller(theta, periods):
    assert np.bincount(motion_of(theta).realisation).tolist() == periods
