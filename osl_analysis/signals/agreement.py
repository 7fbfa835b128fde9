# SPDX-License-Identifier: Apache-2.0
"""How far two channels turn in the same short times: a speed as far as its angle, or one of both
has a wrong scale; both sides of a gear in its ratio."""

import numpy as np

from osl_analysis.base.measured import varies
from osl_analysis.base.trial import Array

# s, over which both are compared: a filter of 20 Hz takes 1 % of what moves so slowly
COMPARED_S = 0.25
LEAST_FOLLOWED = 0.9  # correlation of a speed with its angle's change; less is of another, or noise


def turns(time: Array, readings: Array, is_speed: bool) -> Array:
    """How far a channel turns within each of overlapping `COMPARED_S`.

    Parameters
    ----------
    time
        Shape (n,) [s].
    readings
        Angles (n,), or speeds, per second; NaN is left out.

    Returns
    -------
    Array
        Shape (spans,), the same number for all channels of these times.
    """
    known = np.isfinite(readings)
    if not known.any():
        return np.empty(0)
    begins = np.arange(time[0], time[-1] - COMPARED_S, COMPARED_S / 10)
    if not known.all():  # a copy of an hour takes as long as what is done here
        time = time[known]
        readings = readings[known]
    if is_speed:
        readings = np.append(0.0, np.cumsum(readings[1:] * np.diff(time)))
    return np.interp(begins + COMPARED_S, time, readings) - np.interp(begins, time, readings)


def turn_ratio(turned: Array, other_turned: Array) -> float:
    """How many times as far others (spans,) turn, without a sign; NaN where they do not follow."""
    if not (turned.size == other_turned.size > 0 and varies(turned) and varies(other_turned)):
        return np.nan
    is_followed = abs(np.corrcoef(turned, other_turned)[0, 1]) > LEAST_FOLLOWED
    return float(other_turned.std() / turned.std()) if is_followed else np.nan
