"""Random numbers that depend on the seed, the trial and the effect, and on nothing else."""

import zlib

import numpy as np


def stream(seed: int, trial: str, effect: str) -> np.random.Generator:
    """Generator of one effect in one trial.

    A trial simulated alone equals the same trial in a campaign, and switching one effect off leaves the
    draws of the others as they were.
    """
    return np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(effect.encode())])
