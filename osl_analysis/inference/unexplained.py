"""How far a torque that no hypothesis explains could move K, B and I.

A sensor's noise is normally distributed, and does not know the motion. Of what the best hypothesis
leaves, two parts are not such noise: that which grows with the motion, as where values are late now
and then, and that which is beyond a normal distribution, as where values stand still or drop out.
The larger of them counts. In the direction of a column it could move the column's coefficient by
its size over that of the column's own part, and by no more.
"""

import numpy as np
import scipy

from osl_analysis.inference.constants import BLOCKS, INEXACTNESS
from osl_analysis.inference.cross_validation import Predicted, all_columns, block_edges
from osl_analysis.inference.hypothesis import Search
from osl_analysis.inference.least_squares import solve_scaled
from osl_analysis.inference.whitening import Whitened
from osl_analysis.trial import Array

# median of the squares of normal noise over their mean
MEDIAN_SQUARE = float(scipy.special.ndtri(0.75)) ** 2
# of the variance that the median tells, up to which noise counts as normal: three standard errors
# in 20 s of motion to 6 Hz, and what rounding adds
MOST_NORMAL = 1.5
CERTAIN = 2.0  # standard errors that are taken off the part that grows with the motion


def largest_shifts(data: Whitened, best: Predicted, plain_left: float, impedance: Array) -> Array:
    """The largest changes of K, B and I (3,) [SI] by torque that no hypothesis explains.

    Parameters
    ----------
    data : Whitened
        The recording.
    best : Predicted
        The most probable hypothesis.
    plain_left : float
        Sum of squares that Eq. 15 alone leaves.
    impedance : Array (3,)
        K, B and I of the joint [SI].
    """
    columns = all_columns(data, best.candidate, best.has_friction)
    torque = best.candidate.torque
    squares = (torque - solve_scaled(columns, torque) @ columns) ** 2
    beyond_normal = 1 - MOST_NORMAL * np.median(squares) / MEDIAN_SQUARE / squares.mean()
    share = max(beyond_normal, min(share_that_grows(squares, motion_of(data, impedance)), 1.0))
    # no mechanism is exactly its formula, and rounding is of the sensor
    of_mechanism = INEXACTNESS**2 * (plain_left - best.left)
    unexplained = max(share * best.left - of_mechanism - best.rounding_left, 0.0)

    search = Search(data, best.has_friction)
    own_squares = [
        search.fit(np.delete(data.motion, k, axis=0), data.motion[k])[0] for k in range(3)
    ]
    return np.asarray(np.sqrt(unexplained / np.array(own_squares)))


def motion_of(data: Whitened, impedance: Array) -> Array:
    """Squares (m,) of the modelled torque and of its derivative, each over its mean."""
    derivatives = data.higher_motion
    modelled = np.array([impedance @ derivatives[:3], impedance @ derivatives[1:4]])
    relative = modelled**2 / np.mean(modelled**2, axis=1, keepdims=True)
    return np.asarray(relative.sum(axis=0))


def share_that_grows(squares: Array, motion: Array) -> float:
    """Part of the mean of squares (m,) that is certainly proportional to a motion (m,), by least
    squares of the one on the other; blocks are left out one at a time (jackknife)."""
    rows = np.array([np.ones_like(motion), motion, motion**2, squares, squares * motion])
    first_rows = block_edges(len(motion))[:-1].astype(np.intp)
    blocks = np.add.reduceat(rows, first_rows, axis=1)
    total = blocks.sum(axis=1, keepdims=True)
    count, sum_of_motion, square_of_motion, sum_of_squares, product = np.hstack(
        [total, total - blocks]
    )
    mean = sum_of_motion / count
    slope = (product - mean * sum_of_squares) / (square_of_motion - mean * sum_of_motion)
    shares = slope * sum_of_motion / sum_of_squares
    deviation = float(np.sqrt((BLOCKS - 1) * np.var(shares[1:])))
    return float(shares[0]) - CERTAIN * deviation
