"""The lag of the force plate behind the markers, from a plate that moves unloaded.

A lag d of the torque behind the angle changes the damping by -K d. It does not change the VAF, so that walking data do
not show it. The unloaded plate shows it: its inertial force and its acceleration must peak at the same time.
"""

from collections.abc import Callable

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.cluster import BodyMotion
from osl_analysis.walking.plate import PlateWrench
from osl_analysis.walking.plate_inertia import (
    LEVER,
    WEIGHT,
    centred,
    excited_parameters,
    identify_plate_inertia,
    regressors,
    rms,
    stacked_columns,
)

LARGEST_PLATE_LAG_S = 0.012
PLATE_LAG_STEP_S = 0.002
"""Step [s] between the lags that are tried. A parabola between them is exact to 1 % for motions below 20 Hz."""
LIGHT = 0.1
"""RMS [N*m] of an unloaded wrench, forces with their lever, below which a plate is too light to show its lag."""


def plate_lag(motion: BodyMotion, wrench_at: Callable[[float], PlateWrench], smooth: Callable[[Array], Array]) -> float:
    """Lag [s] of the plate behind the markers in one unloaded recording, positive if the plate is late.

    `wrench_at` returns the wrench read a lag [s] later, filtered with `smooth`. The motion has not passed this filter.
    The estimated lag minimises the misfit of `identify_plate_inertia`. It is NaN if the plate is too light to show a
    lag.

    Raises
    ------
    InputError
        No lag within the search explains the wrench: the recorders are not synchronised.
    """
    lags = np.arange(-LARGEST_PLATE_LAG_S, LARGEST_PLATE_LAG_S + PLATE_LAG_STEP_S / 2, PLATE_LAG_STEP_S)
    readings = [wrench_at(float(lag)) for lag in lags]
    columns = centred(smooth(regressors(motion)))
    names = identify_plate_inertia([(motion, readings[len(lags) // 2])], smooth).identified
    names = names or excited_parameters([motion])  # an exact fit has standard errors of 0
    basis = np.linalg.qr(stacked_columns(columns, names))[0]
    misfit = [least_misfit(basis, (centred(w.components()) * WEIGHT).T.ravel()) for w in readings]
    best = int(np.argmin(misfit))
    size = weighted_square(rms(centred(readings[best].components())))
    if size < LIGHT**2:
        return float("nan")
    if misfit[best] > 0.5 * size or best in (0, len(lags) - 1):
        raise InputError(
            f"the unloaded plate's wrench does not follow its motion within {LARGEST_PLATE_LAG_S * 1e3:g} ms; "
            "synchronise the recorders, check the platform's markers and the plate's channels, or set "
            "correct_plate_lag to false"
        )
    before, least, after = misfit[best - 1 : best + 2]
    return float(lags[best] + 0.5 * PLATE_LAG_STEP_S * (before - after) / (before - 2 * least + after))


def least_misfit(basis: Array, wrench: Array) -> float:
    """Mean over n of the squared residual [N^2*m^2] of a weighted wrench (6 n,) on orthonormal columns (6 n, p)."""
    return float(6 * np.mean((wrench - basis @ (basis.T @ wrench)) ** 2))


def weighted_square(size: Array) -> float:
    """Sum of squares [N^2*m^2] of RMS forces and moments (6,), forces with the lever of the identification."""
    return float(np.sum((size[:3] * LEVER) ** 2) + np.sum(size[3:] ** 2))
