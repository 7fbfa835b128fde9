"""Noise of a filtered torque as it was before the filter, from which intervals of any excitation come."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.signals import LowPass
from osl_analysis.stats.covariance import ResidualCorrelation, score_sums
from osl_analysis.trial import Array

TERMS = 5
"""Terms by which a signal is found from what a filter left of it: up to the cut-off 97 % of it."""


@dataclass(frozen=True)
class UnfilteredNoise(ResidualCorrelation):
    """Covariance from the autocorrelation of the noise before the filter, HAC.

    The columns are slow, so that the estimates do not change if the filter is taken off the noise. Behind the filter it
    is correlated with both signs at the frequencies of the columns: Bartlett's weights then lose up to a tenth of it.
    """

    def covariance(self, X: Array, inverse: Array, residual: Array) -> tuple[Array, Array, str]:
        """As `ResidualCorrelation.covariance`."""
        noise = residual if self.filtered_off is None else residual + self.filtered_off
        return *score_sums(X, inverse, noise, self.window(residual), slow=True), self.method


def noise_beyond(taken_off: Array, signal: Array, low_pass: LowPass, rate_hz: float) -> Array:
    """What a filter H took off a noisy signal (n,), without the part of the `signal` itself, which is known behind H.

    Both are in the unit of the signal, sampled at `rate_hz`; `taken_off` is the noisy signal minus the same behind H.
    The filter took off (1 - H) of the signal s, of which H s is known: s = H s + (1 - H) H s + (1 - H)^2 H s + ...

    Raises
    ------
    InputError
        As the filter.
    """
    whole, part = signal.copy(), signal.copy()
    for _ in range(TERMS - 1):
        part -= low_pass(part, rate_hz)
        whole += part
    del part
    whole -= low_pass(whole, rate_hz)
    return np.asarray(np.subtract(taken_off, whole, out=whole))
