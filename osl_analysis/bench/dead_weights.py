# SPDX-License-Identifier: Apache-2.0
"""Scale and zero of a load cell by masses that hang at a horizontal arm.

    counts = zero + m g r / scale                                        [N*m]

The scatter about this line, the arm, the masses and gravity make the gain uncertain; the latter
three alike in all rows, so that no number of rows averages them (JCGM 100:2008, 5.2).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.base.errors import InputError
from osl_analysis.base.measured import rms
from osl_analysis.base.trial import Array
from osl_analysis.stats.budget import NORMAL_HALF_WIDTH
from osl_analysis.stats.linear_fit import LinearFit, linear_fit

STANDARD_GRAVITY = 9.80665  # [m/s^2] (CGPM 1901)
# [m/s^2] standard uncertainty where the local one is not stated: from 9.780 at the equator to 9.832
# at the poles (WGS 84), a rectangular distribution
GRAVITY_ERROR = (9.832 - 9.780) / np.sqrt(12)
FEWEST_ROWS = 3  # a line through two leaves no scatter


@dataclass(frozen=True)
class CellGain:
    """A load cell's gain by dead weights.

    Attributes
    ----------
    scale
        [N*m per count]; negative where counts fall as the torque rises.
    zero
        Counts without torque.
    scatter_torque
        RMS of the rows about the line [N*m].
    shares
        Relative standard uncertainty of the scale by source: `scatter`, `arm`, `mass`, `gravity`.
    zero_error
        Standard uncertainty of the zero [counts].
    """

    scale: float
    zero: float
    scatter_torque: float
    shares: Mapping[str, float]
    zero_error: float

    @property
    def gain_error(self) -> float:
        """Relative standard uncertainty of the scale, the `torque_gain` of a bench."""
        return float(np.hypot.reduce([*self.shares.values()]))


def gain_of_weights(
    arm: Array,
    mass: Array,
    counts: Array,
    arm_error: float = 0.0,
    mass_error: float = 0.0,
    gravity: float | None = None,
) -> CellGain:
    """Fit scale and zero of a load cell.

    Parameters
    ----------
    arm
        Horizontal distance of the mass from the axis, shape (n,) [m]; negative on the other side.
    mass
        Shape (n,) [kg]; 0 of a row without any.
    counts
        Readings of the cell, shape (n,), as it records them.
    arm_error, mass_error
        Standard uncertainties [m], [kg], that all rows share.
    gravity
        [m/s^2] of the place; None: the standard one, with the uncertainty of all places.

    Raises
    ------
    InputError
        Rows are few, or hold one torque, or one reading.
    """
    standard = STANDARD_GRAVITY if gravity is None else gravity
    torque = standard * mass * arm
    if counts.size < FEWEST_ROWS or not np.ptp(torque) or not np.ptp(counts):
        raise InputError(
            f"{counts.size} rows with torques from {torque.min():.4g} to {torque.max():.4g} N*m and"
            f" {np.ptp(counts):.4g} counts between them tell no gain",
            f"hang {FEWEST_ROWS} masses or more, one of them 0",
        )
    line = line_of(torque, counts)
    slope = line["slope"]
    # for few rows the scatter is known badly: the normal error with the same 95 % interval
    widened = float(scipy.special.stdtrit(counts.size - 2, 0.975)) / NORMAL_HALF_WIDTH
    longer = standard * mass * (arm + np.copysign(arm_error, arm))
    heavier = standard * np.where(mass > 0, mass + mass_error, 0.0) * arm
    shares = {
        "scatter": widened * line.se("slope") / abs(slope),
        "arm": abs(line_of(longer, counts)["slope"] / slope - 1),
        "mass": abs(line_of(heavier, counts)["slope"] / slope - 1),
        "gravity": GRAVITY_ERROR / STANDARD_GRAVITY if gravity is None else 0.0,
    }
    return CellGain(
        scale=1 / slope,
        zero=line["zero"],
        scatter_torque=rms(counts - line["zero"] - slope * torque) / abs(slope),
        shares=shares,
        zero_error=widened * line.se("zero"),
    )


def line_of(torque: Array, counts: Array) -> LinearFit:
    """The line of counts (n,) over torques (n,) [N*m]."""
    return linear_fit(counts, {"slope": torque, "zero": np.ones_like(torque)})
