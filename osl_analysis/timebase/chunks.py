"""A slope and a standard error that holds where neighbouring samples are alike."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from osl_analysis.pieces import pieces
from osl_analysis.trial import Array

CHUNKS, FEWEST_CHUNKS = 20, 5
COARSE = 1 << 10
"""Samples of which only the sum is kept until the edge of a chunk is sought among them."""


def chunked_slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y on x, (n,) each, through the origin, and its standard error from the scatter of 20 chunks.

    The chunks carry equal shares of x^2. Where fewer than five can be made, since a few samples carry everything, or x
    is zero, the error is infinite.
    """
    edges = chunk_edges(x)
    if edges is None:
        return 0.0, np.inf
    slope, left = chunk_scatter(x, y, edges)
    return slope, float(np.sqrt(left @ left * len(left) / (len(left) - 1)) / (x @ x))


def chunk_edges(x: Array, chunks: int = CHUNKS) -> list[int] | None:
    """First rows of chunks of x (n,) with equal shares of x^2, and n; None where fewer than five can be made."""
    weight = np.cumsum([x[rows] @ x[rows] for rows in pieces(len(x), COARSE)])
    if not len(x) or not weight[-1] > 0:
        return None
    edges = first_rows(x, weight, float(weight[-1]) * np.arange(chunks) / chunks)
    return None if len(edges) < FEWEST_CHUNKS else [*edges.tolist(), len(x)]


def chunk_scatter(x: Array, y: Array, edges: list[int]) -> tuple[float, Array]:
    """Slope of y on x, (n,) each, and the sums (chunks,) of x times what it leaves of y."""
    slope = float(x @ y) / float(x @ x)
    chunks = (slice(*ends) for ends in pairwise(edges))
    return slope, np.array([x[rows] @ (y[rows] - slope * x[rows]) for rows in chunks])


def first_rows(x: Array, weight: Array, shares: Array) -> NDArray[np.intp]:
    """The rows in which the sum of x^2 (n,) reaches shares of it; `weight` is that sum behind each `COARSE` rows."""
    block = np.searchsorted(weight, shares)
    rows = block[:, None] * COARSE + np.arange(COARSE)
    reached = np.append(0.0, weight)[block][:, None] + np.cumsum(x.take(rows, mode="clip") ** 2, axis=1)
    first = block * COARSE + np.count_nonzero(reached < shares[:, None], axis=1)
    return np.unique(np.minimum(first, len(x) - 1))
