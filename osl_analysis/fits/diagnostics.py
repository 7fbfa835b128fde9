"""What makes a fit doubtful: estimates that lean on one another, residuals with a structure, delay, friction."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.fits.regression import LinearFit, linear_fit, variance_accounted_for
from osl_analysis.trial import Array

Phasors = NDArray[np.complex128]


def largest_correlation(fit: LinearFit) -> float:
    """Largest absolute correlation between two of the estimates; 0 where there is one."""
    scale = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
    return float(np.max(np.abs(np.triu(fit.covariance / np.outer(scale, scale), 1))))


def residual_autocorrelation(residual: Array, rate_hz: float, cutoff_hz: float) -> float:
    """Autocorrelation of a residual (n,) after one sample of a series at twice the filter's cut-off.

    White noise through the filter is nearly white at that rate, whatever the log's own: what remains is structure.
    """
    thinned = residual[:: max(round(rate_hz / (2 * cutoff_hz)), 1)]
    power = float(thinned @ thinned)
    return float(thinned[1:] @ thinned[:-1]) / power if power > 0 else 0.0


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


def doubts(row: Mapping[str, object], largest: Mapping[str, float], smallest: Mapping[str, float]) -> str:
    """Why a row of a table is doubtful: each column that passes its limit, with its value; empty where none does."""
    reasons = []
    for limits, sign, word in ((largest, 1.0, "above"), (smallest, -1.0, "below")):
        for name, limit in limits.items():
            value = row.get(name)
            if isinstance(value, float) and sign * (abs(value) if sign > 0 else value) > sign * limit:
                reasons.append(f"{name} {value:.3g} is {word} {limit:g}")
    return "; ".join(reasons)
