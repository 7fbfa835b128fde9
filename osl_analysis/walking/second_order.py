"""Second-order impedance: torque = K theta + B omega + I alpha + offset (Eq. 15), on the bench and while walking."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.signals import Motion
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array


@dataclass(frozen=True)
class ImpedanceFit:
    """A fit of Eq. 15."""

    K: float  # stiffness [N*m/rad]
    B: float  # damping [N*m*s/rad]
    I: float  # inertia [kg*m^2]
    offset: float  # offset of the torque [N*m]
    fit: LinearFit  # the regression that gave these estimates

    def torque(self, motion: Motion) -> Array:
        return impedance_torque(self.K, self.B, self.I, motion) + self.offset


def impedance_torque(K: float, B: float, I: float, motion: Motion) -> Array:
    """Resisting torque [N*m] of a second-order impedance for a motion (n,) (Eq. 15)."""
    return K * motion.theta + B * motion.omega + I * motion.alpha


def fit_impedance(motion: Motion, torque: Array) -> ImpedanceFit:
    """Fit Eq. 15 with an offset to a motion and resisting torque [N*m] of shape (n,).

    Angle and torque must have passed the same filter. If only the angle is filtered at 15 Hz, B is estimated as 3.43
    instead of 3.

    Raises InputError, IdentifiabilityError: As `linear_fit`; from a single sine K and I cannot be told apart.
    """
    fit = linear_fit(torque, impedance_columns(motion))
    return ImpedanceFit(fit["K"], fit["B"], fit["I"], fit["offset"], fit)


def impedance_columns(motion: Motion) -> dict[str, Array]:
    """Columns of Eq. 15 with offset, of a motion (n,)."""
    return {"K": motion.theta, "B": motion.omega, "I": motion.alpha, "offset": np.ones_like(motion.theta)}
