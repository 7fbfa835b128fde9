"""Whether the residual of a fit to low-pass filtered signals is white: the test of Ljung and Box."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from osl_analysis.measured import check_measured
from osl_analysis.signals import LowPass
from osl_analysis.trial import Array

FEWEST_SAMPLES = 20
"""Smallest number of samples that is judged: with fewer, autocorrelations are uncertain by 0.2 and more."""
MOST_LAGS = 10


@dataclass(frozen=True)
class Whiteness:
    """How much a residual is correlated with its own past."""

    autocorrelation: float
    """Autocorrelation after one sample, -1 to 1."""
    per_lag: float
    """Ljung and Box's statistic divided by the number of lags: about 1 for white noise of any length. For correlated
    noise it grows with the length."""
    p: float
    """Probability that white noise gives a statistic at least as large."""


def whiteness(residual: Array, rate_hz: float, low_pass: LowPass) -> Whiteness | None:
    """Whiteness of a residual (n,) at `rate_hz`, whose signals passed `low_pass`; None where it cannot be judged.

    The residual is thinned to twice the noise bandwidth of the filter (1.8 times the cut-off for order 4). White noise
    that passed the filter is white again at that rate, for any rate of the log. Thinned to twice the cut-off, it would
    still have an autocorrelation of 0.1 from the filter, which the test detects in a thousand samples.

    Ljung and Box (Biometrika 65, 1978): Q = n (n + 2) sum_k r_k^2 / (n - k) over `MOST_LAGS` lags, or over a fifth of
    the samples if that is fewer; chi-squared with as many degrees of freedom. A residual with fewer than
    `FEWEST_SAMPLES` samples left, or of zeros, is not judged.

    Raises
    ------
    InputError
        A value of the residual cannot be measured.
    """
    check_measured("the residual", residual)
    step = max(rate_hz / (2 * low_pass.noise_bandwidth_hz), 1.0)  # not rounded, so that the rate is exact
    thinned = residual[np.rint(np.arange(0, len(residual) - 0.5, step)).astype(np.intp)]
    n, power = len(thinned), float(thinned @ thinned)
    if n < FEWEST_SAMPLES or power == 0:
        return None
    lag = np.arange(1, min(MOST_LAGS, n // 5) + 1)
    r = np.array([float(thinned[k:] @ thinned[:-k]) for k in lag]) / power
    Q = n * (n + 2) * float(np.sum(r**2 / (n - lag)))
    return Whiteness(float(r[0]), Q / len(lag), float(chdtrc(len(lag), Q)))
