"""Whether a speed is that of an angle: one of both may have a wrong scale, or be of another side of
a gear."""

import numpy as np

from osl_analysis.measured import varies
from osl_analysis.trial import Array

# s, over which both are compared: a filter of 20 Hz takes 1 % of what moves so slowly
WINDOW_S = 0.25
LEAST_FOLLOWED = 0.9  # correlation of a speed with its angle's change; less is of another, or noise
FEWEST_COMPARED = 100  # samples


def speed_factor(time: Array, angle: Array, speed: Array) -> float | None:
    """The size of a speed over that of the change of an angle: 1 where both are right.

    Parameters
    ----------
    time, angle, speed
        Shape (n,) [s, rad, rad/s], finite.

    Returns
    -------
    float or None
        Without a sign; None where the speed does not follow the angle.
    """
    if time.size < FEWEST_COMPARED or time[-1] == time[0]:
        return None
    step_s = (time[-1] - time[0]) / (time.size - 1)
    rows = max(round(WINDOW_S / step_s), 1)
    way = np.cumsum(speed[1:] * np.diff(time))
    turns = (angle[1 + rows :] - angle[1:-rows]) if rows < time.size - 1 else angle[:0]
    ways = way[rows:] - way[:-rows]
    if not (varies(turns) and varies(ways)):
        return None
    is_followed = abs(np.corrcoef(turns, ways)[0, 1]) > LEAST_FOLLOWED
    return float(ways.std() / turns.std()) if is_followed else None
