"""The random numbers of a simulated campaign."""

import zlib

import numpy as np


def generator_of(seed: int, trial: str, effect: str) -> np.random.Generator:
    """Make the random generator of one effect in one trial, which depends on nothing else.

    A trial that is simulated alone equals the campaign's, and switching one effect off leaves the
    random numbers of the others.
    """
    return np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(effect.encode())])
