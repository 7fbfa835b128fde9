"""Whether the torque goes on to change at its peaks as Eq. 15 does there, or stands still: then it is clipped.

A sensor at the end of its range repeats one value (`rails.py`). Noise that is added behind an amplifier hides that.
"""

import numpy as np

from osl_analysis.bench.moving_record import MovingRecord
from osl_analysis.second_order import impedance_torque
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

SHARES = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Shares of the rows with the highest modelled torque that are compared, from sharp peaks of noise to sines."""
LEAST_RANGE = 0.03
"""Least range of the modelled torque in such rows, as a share of its peak: the top of a sine is flat and noisy."""


def torque_at_peaks(record: MovingRecord, fit: LinearFit) -> float | None:
    """Smallest ratio of `ratio_at_peaks` over the fitted rows of a record."""
    modelled = impedance_torque(fit["K"], fit["B"], fit["I"], record.motion)
    return ratio_at_peaks(record.part(record.filtered_torque), record.part(modelled))


def ratio_at_peaks(measured: Array, modelled: Array) -> float | None:
    """Smallest SD of the measured torque over that of the modelled one, where the latter is at its peaks.

    Both (n,) [N*m], filtered alike; offsets do not matter. The peaks are the highest and the lowest `SHARES` of the
    modelled torque. The ratio is 1 for a joint of Eq. 15. Noise and distortion of the torque raise it. Friction lowers
    it to 0.7. It is near 0 where the torque is clipped, however noisy the plateau is: equal samples, by which a clipped
    sensor is told, are not needed. None where no peak has the range for a comparison.
    """
    found, ordered = [], np.sort(modelled)
    ends = (float(ordered[-1]), True), (float(ordered[0]), False)
    middle = float(np.median(ordered, overwrite_input=True))
    for top, highest in ends:
        for share in SHARES:
            level = float(np.quantile(ordered, 1 - share if highest else share, overwrite_input=True))
            if abs(top - level) > LEAST_RANGE * abs(top - middle):
                rows = modelled >= level if highest else modelled <= level
                found.append(float(np.std(measured[rows]) / np.std(modelled[rows])))
    return min(found, default=None)
