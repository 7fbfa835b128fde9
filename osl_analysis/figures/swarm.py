"""Swarms: points of one condition beside each other where they would overlap, as in Figs. 6 and 9."""

import numpy as np

from osl_analysis.trial import Array


def swarm_positions(values: Array, width: float) -> Array:
    """Sideways offsets (n,) at which points of diameter `width` at heights `values` (n,) do not overlap; in one unit.

    From the lowest value up, each point takes the free place that is nearest to the middle. Of two equally near places
    it takes the right and the left one in turn.
    """
    offsets = np.zeros(len(values))
    order = np.argsort(values, kind="stable")
    for rank, point in enumerate(order):
        below = order[:rank][np.abs(values[order[:rank]] - values[point]) < width]
        reach = np.sqrt(width**2 - (values[below] - values[point]) ** 2) * (1 + 1e-9)
        candidates = np.concatenate([[0.0], offsets[below] - reach, offsets[below] + reach])
        free = [c for c in candidates if (np.abs(c - offsets[below]) >= reach * (1 - 1e-9)).all()]
        side = 1 if rank % 2 else -1
        offsets[point] = min(free, key=lambda c: (round(abs(c) / width, 6), side * c))
    return offsets


def squeezed(offsets: Array, reach: float) -> Array:
    """Sideways offsets (n,), as much closer together as they need to be no farther than `reach` from the middle."""
    return np.asarray(offsets * min(1.0, reach / max(float(np.max(np.abs(offsets), initial=0)), 1e-9)))
