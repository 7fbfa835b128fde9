"""Second-order impedance: torque = K theta + B omega + I alpha + offset (Eq. 15), on the bench and while walking."""

import numpy as np

from osl_analysis.signals import Motion
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array


def impedance_torque(K: float, B: float, I: float, motion: Motion) -> Array:
    """Resisting torque [N*m] of a second-order impedance for a motion (n,) (Eq. 15)."""
    return K * motion.theta + B * motion.omega + I * motion.alpha


def impedance_columns(motion: Motion) -> dict[str, Array]:
    """Columns of Eq. 15 with offset, of a motion (n,)."""
    return {"K": motion.theta, "B": motion.omega, "I": motion.alpha, "offset": np.ones_like(motion.theta)}


def fit_second_order(motion: Motion, torque: Array) -> LinearFit:
    """Fit Eq. 15 to a motion and resisting torque [N*m] of shape (n,): K [N*m/rad], B [N*m*s/rad], I [kg*m^2], offset
    [N*m]. Both must have passed the same filter: if only the angle is filtered at 15 Hz, B is 3.43 instead of 3.

    Raises InputError, IdentifiabilityError: As `linear_fit`; from a single sine K and I cannot be told apart.
    """
    return linear_fit(torque, impedance_columns(motion))
