"""Where a joint angle rises through the centre of its motion."""

import numpy as np

from osl_analysis.measured import usual_size
from osl_analysis.pieces import pieces
from osl_analysis.trial import Array

MOVING_S = 0.02
"""Time [s] over which an angle changes measurably where the joint moves."""
DEAD_BAND = 0.02
"""Share of the largest angle that the angle must reach on both sides of its centre; rests and noise stay below."""
MANY = 1 << 18
"""Rows that are searched for crossings at a time."""


def upward_crossings(time: Array, theta: Array) -> Array:
    """Times [s] at which the angle rises through its centre, from below a dead band to above it."""
    x = theta - centre_of_motion(time, theta)
    noise = usual_size(np.diff(x, 2)) / (0.6745 * np.sqrt(6))
    dead = max(DEAD_BAND * max(float(x.max()), -float(x.min())), 5 * noise)
    found, start = [], 0
    for rows in pieces(len(x), MANY):
        part = x[start : rows.stop]  # from the last row on that was beyond the dead band
        certain = np.flatnonzero(np.abs(part) > dead)
        up = (part[certain[1:]] > 0) & (part[certain[:-1]] < 0)
        below = np.flatnonzero(part <= 0)
        # the last row that is not above the centre
        found.append(start + below[np.searchsorted(below, certain[1:][up]) - 1])
        start += int(certain[-1]) if certain.size else 0
    before = np.concatenate(found)
    return np.asarray(time[before] - x[before] * (time[before + 1] - time[before]) / (x[before + 1] - x[before]))


def centre_of_motion(time: Array, theta: Array) -> float:
    """The median angle [rad] where the joint moves; it may rest elsewhere, and for longer."""
    apart = max(round(MOVING_S / float(np.median(np.diff(time), overwrite_input=True))), 1)
    change = theta[apart:] - theta[:-apart]
    if not change.size:  # a recording shorter than that
        return float(np.median(theta))
    np.abs(change, out=change)
    moving = change > 0.1 * np.percentile(change, 95)
    del change
    return float(np.median(theta[apart:][moving], overwrite_input=True)) if moving.any() else float(np.median(theta))
