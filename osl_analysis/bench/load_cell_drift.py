"""Drift of the load cell in a stepped sine: what the mean torques of its cycles share, taken off the torque."""

from collections.abc import Sequence

import numpy as np

from osl_analysis.bench.segments import Segment
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.stats.cycle_sums import sums_between
from osl_analysis.trial import Array


def drift_rate(time: Array, torque: Array, segments: Sequence[Segment]) -> float:
    """Drift of the load cell [N*m/s]: the slope that the settled cycles' mean torques have in common.

    A sine has no mean, so that the joint's own torque does not cause a slope of its cycles' means. A drift of
    0.05 N*m/min that is not subtracted is a tenth of the error of K at 1 Hz. It is the same in every cycle, so that the
    spread between cycles, from which intervals come, does not contain it.

    Each amplitude has a mean torque of its own: that of an asymmetric joint grows with the amplitude, and amplitudes
    may grow with time. The drift is 0 if no amplitude has the five cycles that an interval needs, because transients
    could then pass for drift. The times [s] are uniform.
    """
    along = across = 0.0
    for amplitude in dict.fromkeys(segment.amplitude for segment in segments):
        alike = [segment for segment in segments if segment.amplitude == amplitude]
        first, stop = (np.concatenate([s.edges[s.used + end] for s in alike]) for end in (0, 1))
        if len(first) >= FEWEST_CYCLES:
            samples = stop - first
            level = sums_between(torque[:, None], first, stop)[:, 0] / samples
            middle = (first + stop) / 2 * (time[-1] - time[0]) / (len(time) - 1)
            middle -= np.average(middle, weights=samples)
            along += float(np.sum(samples * middle**2))
            across += float(np.sum(samples * middle * level))
    return across / along if along else 0.0


def without_angle(theta: Array, torque: Array) -> Array:
    """The torque (n,) [N*m] minus what is proportional to the angle (n,) [rad].

    A sine whose amplitude decays has a mean, of another size at each frequency. What the joint makes of it would pass
    for drift.
    """
    moved = theta - theta.mean()
    moved *= -float(moved @ torque) / max(float(moved @ moved), np.finfo(float).tiny)
    moved += torque
    return np.asarray(moved)


def without_drift(time: Array, torque: Array, rate: float) -> Array:
    """The torque (n,) [N*m] at times [s] minus a drift of `rate` [N*m/s]; the mean over all samples is kept."""
    drifted = time - time.mean()
    drifted *= -rate
    drifted += torque
    return np.asarray(drifted)
