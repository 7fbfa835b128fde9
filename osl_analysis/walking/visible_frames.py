"""Frames of a stance in which every marker cluster is seen, and how far hidden ones may be interpolated."""

from collections.abc import Mapping

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import longest_run
from osl_analysis.trial import Array
from osl_analysis.walking.cluster import Poses, gap_duration
from osl_analysis.walking.events import Stance

EDGE_S = 0.1
"""Length [s] of the recording before and after a stance that the low-pass needs, where it is available."""


def rms_residual(poses: Poses) -> float:
    """RMS distance [m] of the markers from their rigid body, over the frames in which they were seen."""
    return float(np.sqrt(np.nanmean(poses.residual**2))) if np.isfinite(poses.residual).any() else float("nan")


def rows_of_stance(time: Array, poses: Mapping[str, Poses], stance: Stance) -> slice:
    """Frames of the stance and up to 0.1 s before and after it. Every cluster is seen in all of these frames.

    Raises
    ------
    InputError
        A cluster is hidden within the stance for longer than gaps are interpolated.
    """
    inside = (time >= stance.heel_strike) & (time <= stance.toe_off)
    for name, pose in poses.items():
        hidden = np.flatnonzero(inside & ~pose.seen())
        if len(hidden):
            raise InputError(
                f"the {name} markers cannot be followed at {time[hidden[0]]:.3f} s, in {len(hidden)} frames of stance; "
                "fill the gap in Nexus, raise longest_gap_s, or exclude the trial"
            )
    seen = np.all([pose.seen() for pose in poses.values()], axis=0)
    first = int(np.searchsorted(time, stance.heel_strike))
    last = int(np.searchsorted(time, stance.toe_off, side="right")) - 1
    while first > 0 and seen[first - 1] and time[first - 1] >= stance.heel_strike - EDGE_S:
        first -= 1
    while last < len(time) - 1 and seen[last + 1] and time[last + 1] <= stance.toe_off + EDGE_S:
        last += 1
    return slice(first, last + 1)


def check_gaps(name: str, time: Array, poses: Poses, window: tuple[float, float], longest: float) -> None:
    """Refuse a cluster that is interpolated for more than `longest` [s] within the fitted `window` [s].

    The rest of stance is slow enough to be interpolated. In the fitted window Eq. 15 would be fitted to the
    interpolation.
    """
    inside = (time >= window[0]) & (time <= window[1])
    gap = longest_run(poses.bridged & inside)
    if gap_duration(time, gap) > longest:
        hidden = (gap.stop - gap.start) * (time[1] - time[0])
        raise InputError(
            f"the {name} markers are hidden for {1e3 * hidden:.0f} ms from {time[gap.start]:.3f} s, while the "
            f"perturbation is fitted, expected {1e3 * longest:g} ms or less; fill the gap in Nexus, raise "
            "longest_fitted_gap_s, or exclude the trial"
        )
