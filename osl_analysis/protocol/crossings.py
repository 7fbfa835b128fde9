"""Where a joint angle rises through the centre of its motion."""

import numpy as np

from osl_analysis.measured import usual_size
from osl_analysis.signals import run_edges
from osl_analysis.trial import Array

MOVING_S = 0.02
"""Time [s] over which an angle changes measurably where the joint moves."""
DEAD_BAND = 0.02
"""Share of the largest angle that the angle must reach on both sides of its centre; rests and noise stay below."""


def noise_of(theta: Array) -> float:
    """Standard deviation of the noise of an angle (n,), in its unit, by its second differences; 0 of two samples."""
    return usual_size(np.diff(theta, 2)) / (0.6745 * np.sqrt(6)) if len(theta) > 2 else 0.0


def upward_crossings(time: Array, theta: Array, noise: float | None = None) -> Array:
    """Times [s] at which the angle rises through its centre, from below a dead band to above it.

    `noise` is that of `noise_of`, where it is known already.
    """
    x = theta - centre_of_motion(time, theta)
    noise = noise_of(theta) if noise is None else noise
    dead = max(DEAD_BAND * max(float(x.max()), -float(x.min())), 5 * noise)
    high, low = run_edges(x > dead), run_edges(x < -dead)
    last_low = np.append(low[:, 1], 0)[np.searchsorted(low[:, 1], high[:, 0], side="right") - 1]  # 0: never yet
    came_up = high[last_low > np.append(0, high[:-1, 1]), 0]
    rises = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
    before = rises[np.searchsorted(rises, came_up) - 1]
    return np.asarray(time[before] - x[before] * (time[before + 1] - time[before]) / (x[before + 1] - x[before]))


def centre_of_motion(time: Array, theta: Array) -> float:
    """The median angle [rad] where the joint moves; it may rest elsewhere, and for longer."""
    apart = max(round(MOVING_S / float(np.median(np.diff(time)))), 1)
    change = np.abs(theta[apart:] - theta[:-apart])
    if not change.size:  # a recording shorter than that
        return float(np.median(theta))
    moving = change > 0.1 * np.quantile(change, 0.95)
    return float(np.median(theta[apart:][moving] if moving.any() else theta))
