"""Structures of an impedance over frequency that are fitted to lines: Eq. 15 and Eq. 9.

Of Eq. 9 the control gains K_1 and B_1 are free, since a controller sets them and friction changes what they do; the
drivetrain (K_s, n_T, J_m, B_m, B_j, J_j) is that of the parameter file. With all coefficients of the rational function
free, six parameters follow any response in a decade of frequency, and their misfit says nothing on the drivetrain.
"""

from typing import Protocol

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.spectral.period import Spectrum
from osl_analysis.trial import Array

EQ_15, EQ_9 = "Eq. 15", "Eq. 9"
LARGEST_SHARE = 0.99
"""Largest stiffness from which K_1 is started, as a share of the belt's: no gain renders more (Eq. 13)."""


class Structure(Protocol):
    """An impedance Z(s) with p real parameters."""

    name: str
    parameters: tuple[str, ...]

    def start(self, K: float, B: float) -> Array:
        """Parameters (p,) to begin with, from a fit of Eq. 15 [N*m/rad], [N*m*s/rad]."""
        ...

    def impedance(self, x: Array, s: Spectrum) -> Spectrum:
        """Z [N*m/rad] at s [rad/s], shape (m,), for parameters x (p,)."""
        ...

    def derivatives(self, x: Array, s: Spectrum) -> Spectrum:
        """Derivatives of Z by the parameters, shape (p, m)."""
        ...


class SecondOrder:
    """Z = K + s B + s^2 I (Eq. 15)."""

    name = EQ_15
    parameters: tuple[str, ...] = ("K", "B", "I")

    def start(self, K: float, B: float) -> Array:
        """Any point will do: the structure is linear."""
        return np.array([K, B, 0.0])

    def impedance(self, x: Array, s: Spectrum) -> Spectrum:
        """Z [N*m/rad]."""
        return np.asarray(x[0] + x[1] * s + x[2] * s**2)

    def derivatives(self, x: Array, s: Spectrum) -> Spectrum:
        """1, s, s^2."""
        return np.array([np.ones_like(s), s, s**2])


class Drivetrain:
    """Z = P - c/N (Eq. 9), in the letters of `model.drivetrain.joint_admittance`, the joint's inertia included."""

    name = EQ_9
    parameters: tuple[str, ...] = ("K_1", "B_1")

    def __init__(self, p: DrivetrainParameters) -> None:
        self.p = p

    def start(self, K: float, B: float) -> Array:
        """The gain of Eq. 13 for a stiffness K.

        Raises
        ------
        InputError
            The joint is stiffer than the belt, or not stiff.
        """
        if not 0 < K < LARGEST_SHARE * self.p.K_s:
            raise InputError(
                f"K = {K:.4g} N*m/rad is not between 0 and the belt's K_s = {self.p.K_s:g}; Eq. 9 of this parameter "
                "file cannot render it"
            )
        return np.array([K * self.p.K_s / (self.p.n_T**2 * (self.p.K_s - K)), max(B, 0.0) / self.p.n_T**2])

    def _actuator(self, x: Array, s: Spectrum) -> Spectrum:
        return np.asarray(self.p.J_m * s**2 + (self.p.B_m + x[1]) * s + x[0] + self.p.K_s / self.p.n_T**2)

    def impedance(self, x: Array, s: Spectrum) -> Spectrum:
        """Z [N*m/rad]."""
        joint = self.p.J_j * s**2 + self.p.B_j * s + self.p.K_s
        return np.asarray(joint - (self.p.K_s / self.p.n_T) ** 2 / self._actuator(x, s))

    def derivatives(self, x: Array, s: Spectrum) -> Spectrum:
        """c/N^2 and s c/N^2."""
        by_gain = (self.p.K_s / self.p.n_T) ** 2 / self._actuator(x, s) ** 2
        return np.array([by_gain, s * by_gain])
