"""A person's stretch reflex: the torque of a muscle that answers half-waves of the velocity.

The parallel pathway of Kearney, Stein and Parameswaran (IEEE Trans. Biomed. Eng. 44, 1997), here
for both directions. What the muscle makes of a stretch differs from person to person: its response
is a sum of critically damped low-passes of second order, whose corners cover those that were
measured.
"""

from collections.abc import Sequence
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

    @property
    def unrectified(self) -> Array:
        """What the muscle would answer to the velocity itself (c, m).

        A joint with any linear memory does that, too, as behind a filter: only what differs between
        the directions tells a reflex.
        """
        corners = len(MUSCLE_CORNERS)
        return np.asarray(self.columns[:corners] + self.columns[corners:])

    def gains(self, coefficients: Array, covariance: Array) -> tuple[Array, Array]:
        """Torque over a lasting speed in either direction, and standard errors (2,) [N*m*s/rad]."""
        corners = len(MUSCLE_CORNERS)
        sums = np.kron(np.eye(2), np.ones(corners))
        variances = np.diag(sums @ covariance @ sums.T)
        return sums @ coefficients, np.sqrt(np.maximum(variances, 0.0))

    def rectified_evidence(self, coefficients: Array, covariance: Array) -> float:
        """By how many nats the two directions differ, given all errors of the coefficients.

        These hold what rounding alone makes, which repeats itself in every step between two levels.
        """
        corners = len(MUSCLE_CORNERS)
        contrast = np.hstack([np.eye(corners), -np.eye(corners)])
        difference = contrast @ coefficients
        of_difference = contrast @ covariance @ contrast.T
        scale = np.sqrt(np.maximum(np.diag(of_difference), 1e-300))
        of_unit = of_difference / np.outer(scale, scale)
        scaled = difference / scale
        return float(scaled @ np.linalg.pinv(of_unit, rcond=1e-9, hermitian=True) @ scaled) / 2


def half_waves(spectra: Spectra) -> Array:
    """Velocity (2, p) while the angle rises, and while it falls [rad/s]."""
    return np.array([np.maximum(spectra.omega, 0.0), np.minimum(spectra.omega, 0.0)])


def muscle_answers(
    spectra: Spectra, waves: Spectrum, delay: float, corners: Sequence[float] = MUSCLE_CORNERS
) -> Spectrum:
    """Spectra (2 c, f) of the answers to half-waves (2, f), of muscles with a gain of 1 and corners
    (c,) [Hz]."""
    late = np.exp(-delay * spectra.s)
    muscles = [late / (1 + spectra.s / (2 * np.pi * hz)) ** 2 for hz in corners]
    return np.concatenate([wave * np.array(muscles) for wave in waves])
