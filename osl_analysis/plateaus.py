"""Plateaus of a channel: how long it stands at its lowest or highest value, and whether it was clipped there."""

import numpy as np

from osl_analysis.signals import longest_run
from osl_analysis.trial import Array

NEAR_ZERO = 0.05  # share of a channel's range: an extreme this close to zero is an unloaded sensor and not clipped
AWAY = 0.25
"""Share of a channel's range: an extreme this close to the median is where the channel mostly is, and not clipped."""
EDGE = 5  # samples before and after a plateau from which the slopes at its ends are read
CUT_OFF = 3.0  # steps of the converter by which a signal would have gone beyond a plateau, had it not been clipped


def run_at_extreme(values: Array) -> slice:
    """Longest run of a noisy channel (n,) at its lowest or highest value, away from zero and from the median.

    Every noisy channel has one sample at its extreme; a clipped one has many in a row. The peak of a slow signal also
    repeats a value for as long as it stays within one step of its converter. It is not clipped: the parabola that has
    the slopes at the ends of the plateau rises by less than `CUT_OFF` steps. Empty for a channel that is not finite.
    """
    if not values.size or not np.isfinite(values).all():
        return slice(0, 0)
    low, high = float(values.min()), float(values.max())
    span, middle = high - low, float(np.median(values))
    extremes = [e for e in (low, high) if abs(e) > NEAR_ZERO * span and abs(e - middle) > AWAY * span]
    found = [longest_run(values == e) for e in extremes]
    steps = np.abs(np.diff(values))
    step = float(steps[steps > 0].min(initial=np.inf))
    cut = [run for run in found if run.stop - run.start == 1 or cut_off(values, run) > CUT_OFF * step]
    return max(cut, key=lambda run: run.stop - run.start, default=slice(0, 0))


def cut_off(values: Array, plateau: slice) -> float:
    """How far a signal (n,) would have gone beyond a plateau of m samples: m/4 times the smaller slope at its ends."""
    level, length = values[plateau.start], plateau.stop - plateau.start
    sides = values[max(plateau.start - EDGE, 0) : plateau.start], values[plateau.stop : plateau.stop + EDGE]
    slopes = [float(np.abs(side - level).max()) / side.size for side in sides if side.size]
    return float(min(slopes, default=0.0) * length / 4)


def longest_at_extreme(values: Array) -> int:
    """Length [samples] of `run_at_extreme`."""
    run = run_at_extreme(values)
    return int(run.stop - run.start)
