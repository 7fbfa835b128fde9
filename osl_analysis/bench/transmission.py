"""Transmission losses with the motor detached: torque = B_j omega + J_j alpha + offset (Eq. 4 with theta_s = 0)."""

import numpy as np

from osl_analysis.signals import Motion
from osl_analysis.stats.covariance import Cycles
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array


def fit_transmission(motion: Motion, torque: Array, cycles: Cycles | None = None, every: int = 1) -> LinearFit:
    """Fit `B_j` [N*m*s/rad], `J_j` [kg*m^2] and `offset` [N*m] to a motion and resisting torque of shape (n,).

    The covariance is as `linear_fit` takes it: between `cycles`, or from each `every`-th sample.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    return linear_fit(torque, transmission_columns(motion), cycles=cycles, every=every)


def transmission_columns(motion: Motion) -> dict[str, Array]:
    """Columns of Eq. 4 with offset, of a motion (n,)."""
    return {"B_j": motion.omega, "J_j": motion.alpha, "offset": np.ones_like(motion.omega)}


def fit_transmission_with_coulomb(
    motion: Motion, torque: Array, width: float = 0.05, cycles: Cycles | None = None, every: int = 1
) -> LinearFit:
    """The same with Coulomb friction `T_C` [N*m] times tanh(omega/width), width in rad/s, for comparison."""
    columns = transmission_columns(motion) | {"T_C": np.tanh(motion.omega / width)}
    return linear_fit(torque, columns, cycles=cycles, every=every)
