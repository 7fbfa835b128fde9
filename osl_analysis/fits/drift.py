"""Drift of a load cell during a stepped sine: what it does to the mean torque from cycle to cycle."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from osl_analysis.fits.protocol import Segment, cycle_edges
from osl_analysis.trial import Array

FEWEST_CYCLES = 3


def drift_rate(time: Array, torque: Array, segments: Sequence[Segment]) -> float:
    """Slope [N*m/s] of a line through the mean torque [N*m] of each settled cycle; 0 with fewer than three cycles.

    A sine has no mean, so that a slope of its cycles' means is none of the joint's. Left in, a drift of 0.05 N*m/min is
    a tenth of the error of K at 1 Hz, and the same in every cycle: their spread, from which intervals come, misses it.
    """
    cycles = [slice(int(a), int(b)) for segment in segments for a, b in pairwise(cycle_edges(segment))]
    if len(cycles) < FEWEST_CYCLES:
        return 0.0
    middle, level = (np.array([signal[rows].mean() for rows in cycles]) for signal in (time, torque))
    weight = np.sqrt([rows.stop - rows.start for rows in cycles])
    return float(np.polyfit(middle - time.mean(), level, 1, w=weight)[0])
