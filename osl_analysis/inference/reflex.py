"""A person's stretch reflex: the torque of a muscle that answers half-waves of the velocity.

The parallel pathway of Kearney, Stein and Parameswaran (IEEE Trans. Biomed. Eng. 44, 1997), here for
both directions. What the muscle makes of a stretch differs from person to person: its response is a
sum of critically damped low-passes of second order, whose corners cover those that were measured.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.inference.constants import MUSCLE_CORNERS
from osl_analysis.inference.spectra import Spectra, Spectrum
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Reflex:
    """A reflex at one delay.

    Attributes
    ----------
    delay : float
        Time from stretch to answer [s].
    columns : Array (2 c, m)
        Whitened answers of each corner, first to a rising, then to a falling angle.
    """

    delay: float
    columns: Array

    def gains(self, coefficients: Array, covariance: Array) -> tuple[Array, Array]:
        """Torque over a lasting speed in either direction, and standard errors (2,) [N*m*s/rad]."""
        corners = len(MUSCLE_CORNERS)
        sums = np.kron(np.eye(2), np.ones(corners))
        variances = np.diag(sums @ covariance @ sums.T)
        return sums @ coefficients, np.sqrt(np.maximum(variances, 0.0))


def half_waves(spectra: Spectra) -> Array:
    """Velocity (2, p) while the angle rises, and while it falls [rad/s]."""
    return np.array([np.maximum(spectra.omega, 0.0), np.minimum(spectra.omega, 0.0)])


def muscle_answers(spectra: Spectra, waves: Spectrum, delay: float) -> Spectrum:
    """Spectra (2 c, f) of the answers to half-waves (2, f), of muscles with a gain of 1."""
    late = np.exp(-delay * spectra.s)
    muscles = [late / (1 + spectra.s / (2 * np.pi * hz)) ** 2 for hz in MUSCLE_CORNERS]
    return np.concatenate([wave * np.array(muscles) for wave in waves])
