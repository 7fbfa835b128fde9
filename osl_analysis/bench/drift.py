"""Drift of a load cell during a stepped sine: what it does to the mean torque from cycle to cycle."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from osl_analysis.bench.protocol import Segment, cycle_edges
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.trial import Array


def drift_rate(time: Array, torque: Array, segments: Sequence[Segment]) -> float:
    """Slope [N*m/s] that the settled cycles' mean torques [N*m] have in common within each amplitude.

    A sine has no mean, so that a slope of its cycles' means is none of the joint's. Left in, a drift of 0.05 N*m/min is
    a tenth of the error of K at 1 Hz, and the same in every cycle: their spread, from which intervals come, misses it.
    Each amplitude has a level of its own: an asymmetric joint's mean torque grows with the amplitude, and amplitudes
    with time. 0 where no amplitude has the five cycles that an interval needs: transients would pass for drift.
    """
    along = across = 0.0
    for amplitude in dict.fromkeys(segment.amplitude for segment in segments):
        alike = (segment for segment in segments if segment.amplitude == amplitude)
        cycles = [slice(int(a), int(b)) for segment in alike for a, b in pairwise(cycle_edges(segment))]
        if len(cycles) >= FEWEST_CYCLES:
            middle, level = (np.array([signal[rows].mean() for rows in cycles]) for signal in (time, torque))
            samples = np.array([rows.stop - rows.start for rows in cycles])
            middle -= np.average(middle, weights=samples)
            along += float(np.sum(samples * middle**2))
            across += float(np.sum(samples * middle * level))
    return across / along if along else 0.0


def without_drift(time: Array, torque: Array, rate: float) -> Array:
    """The torque (n,) [N*m] at times [s] without a drift of `rate` [N*m/s]; its mean over the record stays."""
    return np.asarray(torque - rate * (time - time.mean()))
