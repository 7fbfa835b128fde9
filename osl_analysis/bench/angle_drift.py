"""The slow drift of an angle that the torque does not follow, as of a gyro's integrated rate."""

import numpy as np
from numpy.polynomial import legendre

from osl_analysis.bench.analysis import Analysis
from osl_analysis.stats.covariance import products_between
from osl_analysis.trial import Array

SAME_DRIFT = -0.8  # correlation of slow torque and slow angle from which one drift makes both
NOT_FOLLOWED = (0.7, 1.3)  # of K, by which the torque falls short of an angle that drifts
SLOW_POWERS = 4  # of time, which a drift has; the motion has hardly any
FEWEST_GROUPS = 8  # whose means tell a drift
STEADY_LEFT = 0.25  # of what is unexplained of the torque without a steady drift
STEADY_UNEXPLAINED = 0.05  # of the torque's variance; a device with a wide loop tells no drift


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


def steady_drift(theta: Array, torque: Array) -> float:
    """Tell by how much an angle drifts evenly while the torque of a spring does not follow.

    Parameters
    ----------
    theta : Array
        Angle (n,) [rad].
    torque : Array
        Torque (n,) [N*m].

    Returns
    -------
    float
        Last less first drift [rad]; 0 where the torque follows the angle.

    Notes
    -----
    Least squares of torque = K (theta - d t) + offset, with t from 0 to 1.
    """
    share = np.linspace(0.0, 1.0, len(theta))
    columns = np.column_stack([theta, np.ones_like(theta), share])
    unexplained: list[float] = []
    for count in (2, 3):
        estimates = np.linalg.lstsq(columns[:, :count], torque)[0]
        unexplained.append(float(np.var(torque - columns[:, :count] @ estimates) / np.var(torque)))
    without, with_drift = unexplained
    is_told = with_drift < min(STEADY_UNEXPLAINED, STEADY_LEFT * without)
    return float(-estimates[2] / estimates[0]) if is_told else 0.0
