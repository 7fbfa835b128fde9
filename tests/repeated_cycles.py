"""Cycles that repeat a residual, for the tests of regression and covariance."""

import numpy as np

CYCLE, COUNT = 50, 24


def repeated(rng, noise=0.3):
    """A friction-like residual that every cycle repeats, different in the two strata, and white noise."""
    n = CYCLE * COUNT
    t = np.arange(n) / CYCLE
    columns = {"a": np.sin(2 * np.pi * t), "b": np.cos(2 * np.pi * t), "offset": np.ones(n)}
    friction = np.sign(columns["b"]) * np.where(t < COUNT / 2, 1.0, 2.0)
    edges = np.arange(COUNT + 1.0) * CYCLE
    cycles = edges[:-1], edges[1:], np.repeat([0, 1], COUNT // 2)
    return 3 * columns["a"] + friction + noise * rng.standard_normal(n), columns, cycles
