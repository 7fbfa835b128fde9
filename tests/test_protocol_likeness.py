"""A stepped sine, sound or damaged, is told from every other motion of the joint."""

import numpy as np
import pytest
from any_motion import RATE, chirp, multisine, noise
from bench_synthetic import unit_block

from osl_analysis.protocol.stepped_sine import Likeness, SteppedSineProtocol, moving_bins

PROTOCOL = SteppedSineProtocol(tuple(np.deg2rad([2.0, 4.0, 6.0])), (1.0, 2.0, 3.0, 4.0, 5.0), 8)


def stepped(protocol=PROTOCOL):
    rest = np.zeros(round(RATE))
    return np.concatenate([rest, *(x for a in protocol.amplitudes for x in (a * unit_block(protocol, RATE), rest))])


def kind_of(theta, rng):
    theta = theta + 1e-5 * rng.standard_normal(len(theta))
    return Likeness(np.arange(len(theta)) / RATE, theta, PROTOCOL).kind


DAMAGE = {
    "sound": lambda x, _: (x, "stepped sine"),
    "in degrees": lambda x, _: (57.3 * x, "stepped sine"),
    "half of it at rest": lambda x, _: (np.where(np.arange(len(x)) < len(x) / 2, x, 0), "stepped sine"),
    "clipped": lambda x, _: (np.clip(x, -0.03, 0.03), "stepped sine"),
    "freezes": lambda x, _: (np.where(np.arange(len(x)) % 7500 < 1500, 0.02, x), "stepped sine"),
    "spikes": lambda x, rng: (np.where(rng.random(len(x)) < 0.01, 0.15 * rng.standard_normal(len(x)), x), "unclear"),
    "wanders": lambda x, _: (x + 0.05 * np.sin(0.8 * np.arange(len(x)) / RATE), "unclear"),
    "hum": lambda x, _: (x + 0.05 * np.sin(314 * np.arange(len(x)) / RATE), "unclear"),
    "still": lambda x, _: (0 * x, "unclear"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_stepped_sine_is_not_taken_for_another_motion(damage):
    rng = np.random.default_rng(4)
    theta, expected = DAMAGE[damage](stepped(), rng)
    assert kind_of(theta, rng) == expected


@pytest.mark.parametrize("move", [multisine, noise, chirp])
@pytest.mark.parametrize("band", [(0.5, 3.0), (0.5, 6.0), (0.5, 10.0), (0.2, 2.0)])
def test_multisine_noise_and_sweep_are_other_motions_at_the_commanded_amplitudes(move, band):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        _, (theta, *_) = move(rng, band=band)
        assert kind_of(np.deg2rad(4) * theta / theta.max(), rng) == "other"


def test_ramps_and_a_binary_sequence_are_other_motions():
    rng = np.random.default_rng(2)
    time = np.arange(0, 40, 1 / RATE)
    ramps = 0.09 * (2 * np.abs(2 * (0.3 * time % 1) - 1) - 1)
    sequence = np.convolve(np.repeat(rng.choice([-0.06, 0.06], 400), 50), np.hanning(25) / 12, "same")
    assert kind_of(ramps, rng) == kind_of(sequence, rng) == "other"


def test_rests_do_not_count_as_moving_and_slow_turns_do():
    time = np.arange(0, 20, 1 / RATE)
    theta = np.where((time > 5) & (time < 15), 0.1 * np.sin(2 * np.pi * 0.5 * (time - 5)), 0.0)
    moving = moving_bins(time, theta + 2e-5 * np.random.default_rng(1).standard_normal(len(time)))
    assert moving[(time > 5.3) & (time < 14.7)].mean() > 0.95
    assert not moving[(time < 4.9) | (time > 15.3)].any()
