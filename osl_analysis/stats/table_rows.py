"""A fit as columns of a result table: estimates, covariances, diagnostics, whiteness."""

from itertools import combinations

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.measured import check_measured
from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

# one row of a result table, by column. None becomes an empty field.
Row = dict[str, float | str | None]

INTERVAL_ENDS = ("", "_se", "_low", "_high")
"""Endings of the columns of an estimate: its value, standard error and 95 % interval."""


def estimates_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`name`, `name_se` and the bounds `name_low` and `name_high` of the 95 % interval for each
    name, in SI units."""
    row: dict[str, float] = {}
    for name in names:
        low, high = fit.interval(name)
        row[name] = fit[name]
        row[f"{name}_se"] = fit.se(name)
        row[f"{name}_low"] = low
        row[f"{name}_high"] = high
    return row


def covariance_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`cov_A_B` for each pair of names, in the product of their units."""
    return {f"cov_{a}_{b}": fit.cov(a, b) for a, b in combinations(names, 2)}


def diagnostics_row(fit: LinearFit, interval_method: str, rate_hz: float, white: Row) -> Row:
    """The diagnostics of a fit and its interval in all tables; `rate_hz` is the rate of the fitted
    rows, `white` their whiteness. VAF in percent, R2 about zero, the correlation time in
    seconds."""
    return {
        "interval_method": interval_method,
        "VAF": fit.vaf,
        "R2": fit.r_squared,
        "condition_number": fit.condition_number,
        "largest_correlation": fit.largest_correlation,
        "samples": fit.samples,
        "correlation_s": fit.correlation_samples / rate_hz,
        **white,
    }


FEWEST_FOR_WHITENESS = 20  # samples; of fewer, autocorrelations are uncertain by 0.2 and more


def thinned_rows(samples: int, rate_hz: float, low_pass: LowPass) -> NDArray[np.intp]:
    """The rows of a residual at `rate_hz` that are kept for its whiteness: at twice the noise
    bandwidth of the filter that its signals passed. White noise that passed the filter is white
    again at that rate; thinned to twice the cut-off, it would still have an autocorrelation of 0.1,
    which the test detects in a thousand samples."""
    step = max(rate_hz / (2 * low_pass.noise_bandwidth_hz), 1.0)
    return np.asarray(np.rint(np.arange(0, samples - 0.5, step)), dtype=np.intp)


def whiteness_row(thinned: Array) -> Row:
    """How much a residual (n,), thinned by `thinned_rows`, is correlated with its own past: its
    autocorrelation after one sample, and Ljung and Box's statistic per lag with its p (Biometrika
    65, 1978): n (n + 2) sum_k r_k^2 / (n - k) over 10 lags, or a fifth of the samples if that is
    fewer, is chi-squared. All null for a residual of zeros, and of fewer than 20 samples, whose
    autocorrelations are uncertain by 0.2 and more."""
    check_measured("the residual", thinned)
    n = len(thinned)
    power = float(thinned @ thinned)
    if n < FEWEST_FOR_WHITENESS or power == 0:
        return dict.fromkeys(("residual_autocorrelation", "ljung_box_per_lag", "ljung_box_p"))
    lag = np.arange(1, min(10, n // 5) + 1)
    r = np.array([float(thinned[k:] @ thinned[:-k]) for k in lag]) / power
    Q = n * (n + 2) * float(np.sum(r**2 / (n - lag)))
    p = float(scipy.special.chdtrc(len(lag), Q))
    return {
        "residual_autocorrelation": float(r[0]),
        "ljung_box_per_lag": Q / len(lag),
        "ljung_box_p": p,
    }


def lag_damping_row(lag: float | None, se: float | None, is_certain: bool, K: float) -> Row:
    """Lag [s] of the torque behind the angle, its standard error, and what it adds to B: -K lag
    [N*m*s/rad]; `certain_lag_damping` is 0 where the lag is not certain. All null without a lag."""
    damping = None
    certain = None
    if lag is not None:
        damping = -K * lag
        certain = damping if is_certain else 0.0
    return {"lag_s": lag, "lag_se_s": se, "lag_damping": damping, "certain_lag_damping": certain}
