# SPDX-License-Identifier: Apache-2.0
"""How far a torque that no rival explains could move K, B and I.

A sensor's noise is normally distributed, and does not know the motion. So the median of its squares
in the half of the rows that moves least tells its variance in all rows. What the best rival
leaves beyond it is no such noise: values that stand still, drop out or come late now and then, or
that are off in proportion to the torque. In the direction of a column it could move the column's
coefficient by its size over that of the column's own part, and by no more.
"""

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.inference.constants import INEXACTNESS
from osl_analysis.inference.rivals import Search
from osl_analysis.inference.spectra import solve_scaled
from osl_analysis.inference.weighing import Predicted, all_columns
from osl_analysis.inference.whitening import Whitened

# what is left over the noise of the rows that move least and over rounding, up to which it is
# theirs: three standard errors in 20 s of motion to 6 Hz
MOST_NOISE = 1.6


def largest_shifts(
    data: Whitened, best: Predicted, plain_left: float, impedance: Array, rounding: Array
) -> Array:
    """The largest changes of K, B and I (3,) [SI] by torque that no rival explains.

    Parameters
    ----------
    data : Whitened
        The recording.
    best : Predicted
        The most probable one.
    plain_left : float
        Sum of squares that Eq. 15 alone leaves.
    impedance : Array (3,)
        K, B and I of the joint [SI].
    rounding : Array (draws, m)
        Torques that rounding alone makes.
    """
    columns = all_columns(data, best.candidate, best.has_friction)
    torque = best.candidate.torque
    squares = (torque - solve_scaled(columns, torque) @ columns) ** 2

    # a sine is never still in both its torque and the derivative of it
    derivatives = data.columns["derivatives"]
    modelled = np.array([impedance @ derivatives[:3], impedance @ derivatives[1:4]])
    motion = np.sum(modelled**2 / np.mean(modelled**2, axis=1, keepdims=True), axis=0)
    quiet = np.median(squares[motion < np.median(motion)])
    # half of the squares of noise are below this share of its variance
    noise = quiet / scipy.special.chdtri(1, 0.5) * len(squares)
    # shapes of friction are not exactly its formula
    of_friction = INEXACTNESS**2 * (plain_left - best.left)
    of_rounding = np.sum(rounding**2) / len(rounding)
    of_sensors = MOST_NOISE * (noise + of_rounding)
    unexplained = max(squares.sum() - of_sensors - of_friction, 0.0)

    # squares of what the other two leave of a column are 1 over the diagonal of the inverse
    own = Search(data, best.has_friction).rest(data.motion)
    return np.sqrt(unexplained * np.diag(np.linalg.inv(own @ own.T)))
