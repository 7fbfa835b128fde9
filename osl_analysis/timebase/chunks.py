"""A slope and a standard error that holds where neighbouring samples are alike."""

import numpy as np

from osl_analysis.trial import Array

CHUNKS, FEWEST_CHUNKS = 20, 5


def chunked_slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y on x, (n,) each, through the origin, and its standard error from the scatter of 20 chunks.

    The chunks carry equal shares of x^2. Where fewer than five can be made, since a few samples carry everything, or x
    is zero, the error is infinite.
    """
    weight = x * x
    np.cumsum(weight, out=weight)
    if not len(x) or not weight[-1] > 0:
        return 0.0, np.inf
    edges = np.searchsorted(weight, weight[-1] * np.arange(CHUNKS) / CHUNKS)
    edges = np.unique(np.minimum(edges, len(x) - 1))
    if len(edges) < FEWEST_CHUNKS:
        return 0.0, np.inf
    total = float(weight[-1])
    slope = float(x @ y) / total
    rest = np.multiply(x, -slope, out=weight)
    rest += y
    rest *= x
    left = np.add.reduceat(rest, edges)
    return slope, float(np.sqrt(left @ left * len(edges) / (len(edges) - 1)) / total)
