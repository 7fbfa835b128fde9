"""Second-order impedance: torque = K theta + B omega + I alpha + offset (Eq. 15)."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.signals import Motion
from osl_analysis.stats.covariance import Cycles
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array


@dataclass(frozen=True)
class ImpedanceFit:
    """Stiffness [N*m/rad], damping [N*m*s/rad], inertia [kg*m^2], offset [N*m], and the regression behind them."""

    K: float
    B: float
    I: float
    offset: float
    fit: LinearFit

    def torque(self, motion: Motion) -> Array:
        """Torque [N*m] of the fitted system for a motion (n,), Eq. 15 with the offset."""
        return impedance_torque(self.K, self.B, self.I, motion) + self.offset


def impedance_torque(K: float, B: float, I: float, motion: Motion) -> Array:
    """Resisting torque [N*m] of a second-order impedance for a motion (n,) (Eq. 15)."""
    return K * motion.theta + B * motion.omega + I * motion.alpha


def fit_impedance(motion: Motion, torque: Array, cycles: Cycles | None = None, every: int = 1) -> ImpedanceFit:
    """Fit Eq. 15 with an offset to a motion and resisting torque [N*m] of shape (n,).

    Angle and torque must have passed the same filter: filtering only the angle at 15 Hz reads B 3.43 for 3.
    The covariance is as `linear_fit` takes it: between `cycles` where there are some, else from each `every`-th sample.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`; one sine cannot tell K from I.
    """
    fit = linear_fit(torque, impedance_columns(motion), cycles=cycles, every=every)
    return ImpedanceFit(fit["K"], fit["B"], fit["I"], fit["offset"], fit)


def impedance_columns(motion: Motion) -> dict[str, Array]:
    """Columns of Eq. 15 with offset, of a motion (n,)."""
    return {"K": motion.theta, "B": motion.omega, "I": motion.alpha, "offset": np.ones_like(motion.theta)}
