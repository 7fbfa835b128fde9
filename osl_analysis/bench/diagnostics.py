"""What makes a fit doubtful: estimates that lean on one another, residuals with a structure, delay, friction."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import LinearFit, linear_fit, variance_accounted_for
from osl_analysis.trial import Array

Phasors = NDArray[np.complex128]

FEWEST_FOR_WHITENESS = 20
WHITENESS_LAGS = 10


def largest_correlation(fit: LinearFit) -> float:
    """Largest absolute correlation between two of the estimates; 0 where there is one."""
    scale = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
    return float(np.max(np.abs(np.triu(fit.covariance / np.outer(scale, scale), 1))))


@dataclass(frozen=True)
class Whiteness:
    """What structure a residual has: autocorrelation after one sample, Ljung and Box's statistic per lag, its p-value.

    The statistic is 1 per lag for white noise, whatever its length, and grows with the length for anything else.
    """

    autocorrelation: float
    per_lag: float
    p: float


def whiteness(residual: Array, rate_hz: float, low_pass: LowPass) -> Whiteness | None:
    """Whiteness of a residual (n,), thinned to twice the noise bandwidth of the filter that its signals passed.

    At that rate, 1.8 times the cut-off, white noise comes out of the filter white, whatever the log's own rate: a test
    at twice the cut-off would find the filter (0.1 of autocorrelation, certain with a thousand samples). Ljung and Box
    (Biometrika 65, 1978): Q = n (n + 2) sum_k r_k^2 / (n - k) over `WHITENESS_LAGS` lags, or a fifth of the samples if
    these are fewer; chi-squared with as many degrees of freedom. None with fewer than `FEWEST_FOR_WHITENESS` samples,
    whose autocorrelations are uncertain by 0.2 and more, and for a residual of zeros.
    """
    step = max(rate_hz / (2 * low_pass.noise_bandwidth_hz), 1.0)  # samples, no whole number: the rate is to be exact
    thinned = residual[np.rint(np.arange(0, len(residual) - 0.5, step)).astype(np.intp)]
    n, power = len(thinned), float(thinned @ thinned)
    if n < FEWEST_FOR_WHITENESS or power == 0:
        return None
    lag = np.arange(1, min(WHITENESS_LAGS, n // 5) + 1)
    r = np.array([float(thinned[k:] @ thinned[:-k]) for k in lag]) / power
    Q = n * (n + 2) * float(np.sum(r**2 / (n - lag)))
    return Whiteness(float(r[0]), Q / len(lag), float(chdtrc(len(lag), Q)))


@dataclass(frozen=True)
class Delay:
    """Lag [s] of the torque behind the angle, with its standard error."""

    lag: float
    se: float


def torque_lag(frequency_hz: Array, theta: Array, impedance: Phasors, expected: Phasors) -> Delay:
    """Lag of the torque from complex impedances torque/theta (n,) at amplitudes theta (n,) [rad] and frequencies [Hz].

    `expected` (n,) are the impedances of the linear model with the same gains: without them a lag d is a damping of
    -K d, and nothing tells the two apart. The phase beyond the model's is -w d, and Coulomb friction T_C adds
    4 T_C/(pi theta) Re(1/expected) to it, by its describing function.

    Raises
    ------
    InputError, IdentifiabilityError
        Two points or fewer, or too much alike to tell lag from friction.
    """
    w = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
    beyond = np.asarray(np.angle(impedance / expected))
    fit = linear_fit(beyond, {"lag": -w, "T_C": 4 / (np.pi * theta) * (1 / expected).real}, lags=1)
    return Delay(fit["lag"], fit.se("lag"))


@dataclass(frozen=True)
class Nonlinearity:
    """Share of even and of odd harmonics (2, 4 and 3, 5) in the torque, and the Coulomb friction [N*m] that makes
    the third one, with the damping [N*m*s/rad] that its describing function adds to B."""

    even: float
    odd: float
    coulomb: float
    coulomb_damping: float


def nonlinearity(frequency_hz: Array, theta: Array, torque: Array) -> Nonlinearity:
    """From amplitudes of angle (n,) [rad] and of the torque's harmonics 1 to 5, shape (n, 5) [N*m], at n frequencies.

    Coulomb friction T_C sign(omega) has harmonics 4 T_C/(k pi), k odd; its first is a damping 4 T_C/(pi w |theta|) at
    that frequency, which a fit weights with duration times velocity squared, cycles being equally many.
    """
    w = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
    size = np.sqrt(np.sum(torque**2, axis=0))
    coulomb = 0.75 * np.pi * float(np.mean(torque[:, 2]))
    damping = 4 * coulomb / np.pi * float(np.sum(theta) / np.sum(w * theta**2))
    return Nonlinearity(float(np.hypot(size[1], size[3]) / size[0]), float(np.hypot(size[2], size[4]) / size[0]),
                        coulomb, damping)  # fmt: skip


def held_out_vaf(fit: LinearFit, columns: Mapping[str, Array], torque: Array) -> float:
    """VAF [percent] of a fit for a torque (n,) that it did not see, with its columns (n,) there."""
    modelled = np.sum([fit[name] * column for name, column in columns.items()], axis=0)
    return variance_accounted_for(torque, torque - modelled)
