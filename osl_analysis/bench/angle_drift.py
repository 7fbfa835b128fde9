"""The slow drift of an angle that the torque does not follow, as of a gyro's integrated rate."""

import numpy as np
from numpy.polynomial import legendre

from osl_analysis.bench.analysis import Analysis
from osl_analysis.stats.covariance import products_between

SAME_DRIFT = -0.9  # correlation of slow torque and slow angle from which one drift makes both
NOT_FOLLOWED = (0.7, 1.3)  # of K, by which the torque falls short of an angle that drifts
SLOW_POWERS = 4  # of time, which a drift has; the motion has hardly any
FEWEST_GROUPS = 8  # whose means tell a drift


def angle_drift_deg(analysis: Analysis) -> float | None:
    """Find the range over which the angle drifts without the joint.

    Returns
    -------
    float or None
        Largest less smallest slow angle [deg]; 0 where the torque follows it, so that the joint
        turned, or where the load cell drifts; None of too few groups of rows.

    Notes
    -----
    Of an angle theta + d the torque misses K d: the torque less that of Eq. 15 falls by K with the
    angle. A joint that turns leaves nothing, a load cell that drifts does not turn. Both are means
    of the groups of rows, of which polynomials of time are taken. K is that of the fast motion.
    """
    record, fit = analysis.record, analysis.whole
    groups = record.groups
    rows = groups.stop - groups.first
    if len(rows) < FEWEST_GROUPS:
        return None
    motion = record.motion
    recorded = record.filtered_torque + record.drift * (record.time - record.time.mean())
    explained = fit["K"] * motion.theta + fit["B"] * motion.omega + fit["I"] * motion.alpha
    signals = np.column_stack([motion.theta, recorded - explained])
    ones = np.ones((len(signals), 1))
    means = products_between(signals, ones, groups.first, groups.stop)[..., 0] / rows[:, None]
    middle = (groups.first + groups.stop) / 2
    powers = legendre.legvander(2 * middle / len(record.time) - 1, SLOW_POWERS)
    orthogonal, _ = np.linalg.qr(powers)
    slow = orthogonal[:, 1:] @ (orthogonal[:, 1:].T @ means)  # without the mean
    theta, missed = slow.T

    size = float(np.sqrt(np.sum(theta**2) * np.sum(missed**2)))
    if not size or theta @ missed / size > SAME_DRIFT:
        return 0.0
    share = -float(theta @ missed / (theta @ theta)) / fit["K"]
    least, most = NOT_FOLLOWED
    return float(np.rad2deg(np.ptp(theta))) if least < share < most else 0.0
