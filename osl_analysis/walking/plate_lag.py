"""By how much the plate's channels lag behind the markers, from the force of the plate's own mass.

A lag d of the torque against the angle moves the damping by -K d and leaves the VAF as it is, so that the walking data
themselves cannot show it. The unloaded plate can: its inertial force must peak when its acceleration does.
"""

from collections.abc import Callable

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.kinematics import BodyMotion
from osl_analysis.walking.moving_plate import Wrench
from osl_analysis.walking.plate_inertia import LEVER, centred, identify_plate_inertia, rms

LARGEST_S = 0.012
STEP_S = 0.002
"""Lags that are tried [s]; in between a parabola is exact to 1 % for motions below 20 Hz."""
LIGHT = 0.1
"""RMS [N*m] of an unloaded wrench, forces with their lever, below which a plate is too light to tell a lag by."""


def find_plate_lag(motion: BodyMotion, wrench_at: Callable[[float], Wrench], smooth: Callable[[Array], Array]) -> float:
    """Lag [s] of the plate behind the markers in one unloaded recording, positive if the plate is late.

    `wrench_at` gives the wrench as read a lag [s] later, with the low-pass `smooth` that the motion did not pass. The
    lag is the minimum of the misfit of `identify_plate_inertia`; NaN where the plate is so light that nothing shows in
    the wrench.

    Raises
    ------
    InputError
        No lag in the range that is tried explains the wrench: the clocks are not synchronised.
    """
    lags = np.arange(-LARGEST_S, LARGEST_S + STEP_S / 2, STEP_S)
    misfit = np.array([unexplained(motion, wrench_at(float(lag)), smooth) for lag in lags])
    best = int(np.argmin(misfit))
    read = wrench_at(float(lags[best]))
    size = weighted(rms(centred(np.hstack([read.force, read.moment]))))
    if size < LIGHT**2:
        return float("nan")
    if misfit[best] > 0.5 * size or best in (0, len(lags) - 1):
        raise InputError(
            f"the unloaded plate's wrench does not follow its motion within {LARGEST_S * 1e3:g} ms; synchronise the "
            "recorders, check the platform's markers and the plate's channels, or set correct_plate_lag to false"
        )
    before, least, after = misfit[best - 1 : best + 2]
    return float(lags[best] + 0.5 * STEP_S * (before - after) / (before - 2 * least + after))


def unexplained(motion: BodyMotion, wrench: Wrench, smooth: Callable[[Array], Array]) -> float:
    """Mean square [N^2*m^2] of the unloaded wrench that the plate's own inertia does not explain."""
    return weighted(identify_plate_inertia([(motion, wrench)], smooth).rms_after)


def weighted(size: Array) -> float:
    """Sum of squares of RMS forces and moments (6,), the forces with the lever that the identification gives them."""
    return float(np.sum((size[:3] * LEVER) ** 2) + np.sum(size[3:] ** 2))
