# SPDX-License-Identifier: Apache-2.0
"""Whether a speed is that of an angle: one of both may have a wrong scale, or be of another side of
a gear."""

import numpy as np

from osl_analysis.base.measured import varies
from osl_analysis.base.trial import Array

# s, over which both are compared: a filter of 20 Hz takes 1 % of what moves so slowly
COMPARED_S = 0.25
LEAST_FOLLOWED = 0.9  # correlation of a speed with its angle's change; less is of another, or noise


def speed_factor(time: Array, angle: Array, speed: Array) -> float:
    """The size of a speed over that of the change of an angle: 1 where both are right.

    Parameters
    ----------
    time, angle, speed
        Shape (n,) [s, rad, rad/s]; NaN is left out.

    Returns
    -------
    float
        Without a sign; NaN where the speed does not follow the angle.
    """
    known = np.isfinite(angle + speed)
    if not known.all():
        time, angle, speed = time[known], angle[known], speed[known]
    if not time.size:
        return np.nan
    begins = np.arange(time[0], time[-1] - COMPARED_S, COMPARED_S / 10)
    way = np.append(0.0, np.cumsum(speed[1:] * np.diff(time)))
    turns = np.interp(begins + COMPARED_S, time, angle) - np.interp(begins, time, angle)
    ways = np.interp(begins + COMPARED_S, time, way) - np.interp(begins, time, way)
    if not (varies(turns) and varies(ways)):
        return np.nan
    is_followed = abs(np.corrcoef(turns, ways)[0, 1]) > LEAST_FOLLOWED
    return float(ways.std() / turns.std()) if is_followed else np.nan
