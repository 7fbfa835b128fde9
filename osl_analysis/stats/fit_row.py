"""A fit as a row of a result table: estimates, standard errors, and the diagnostics that all tables share."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from osl_analysis.measured import check_measured
from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

FEWEST_SAMPLES = 20
"""Smallest number of samples that is judged: with fewer, autocorrelations are uncertain by 0.2 and more."""
MOST_LAGS = 10


@dataclass(frozen=True)
class Whiteness:
    """How much a residual is correlated with its own past."""

    autocorrelation: float  # autocorrelation after one sample, -1 to 1
    per_lag: float
    """Ljung and Box's statistic divided by the number of lags: about 1 for white noise of any length. For correlated
    noise it grows with the length."""
    p: float  # probability that white noise gives a statistic at least as large


def whiteness(residual: Array, rate_hz: float, low_pass: LowPass) -> Whiteness | None:
    """Whiteness of a residual (n,) at `rate_hz`, whose signals passed `low_pass`; None where it cannot be judged.

    The residual is thinned to twice the noise bandwidth of the filter (1.8 times the cut-off for order 4). White noise
    that passed the filter is white again at that rate, for any rate of the log. Thinned to twice the cut-off, it would
    still have an autocorrelation of 0.1 from the filter, which the test detects in a thousand samples.

    Ljung and Box (Biometrika 65, 1978): Q = n (n + 2) sum_k r_k^2 / (n - k) over `MOST_LAGS` lags, or over a fifth of
    the samples if that is fewer; chi-squared with as many degrees of freedom. A residual with fewer than
    `FEWEST_SAMPLES` samples left, or of zeros, is not judged.
    """
    check_measured("the residual", residual)
    return whiteness_of(residual[thinned_rows(len(residual), rate_hz, low_pass)])


def thinned_rows(samples: int, rate_hz: float, low_pass: LowPass) -> NDArray[np.intp]:
    """The rows of a residual that are kept for its whiteness; the step is not rounded, so that the rate is exact."""
    step = max(rate_hz / (2 * low_pass.noise_bandwidth_hz), 1.0)
    return np.asarray(np.rint(np.arange(0, samples - 0.5, step)), dtype=np.intp)


def whiteness_of(thinned: Array) -> Whiteness | None:
    """As `whiteness`, of a residual that was thinned already."""
    n, power = len(thinned), float(thinned @ thinned)
    if n < FEWEST_SAMPLES or power == 0:
        return None
    lag = np.arange(1, min(MOST_LAGS, n // 5) + 1)
    r = np.array([float(thinned[k:] @ thinned[:-k]) for k in lag]) / power
    Q = n * (n + 2) * float(np.sum(r**2 / (n - lag)))
    return Whiteness(float(r[0]), Q / len(lag), float(chdtrc(len(lag), Q)))


Row = dict[str, float | str | None]  # one row of a result table, by column. None becomes an empty field.


def estimates_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`name`, `name_se` and the bounds `name_low` and `name_high` of the 95 % interval for each name, in SI units."""
    row: dict[str, float] = {}
    for name in names:
        low, high = fit.interval(name)
        row |= {name: fit[name], f"{name}_se": fit.se(name), f"{name}_low": low, f"{name}_high": high}
    return row


def covariance_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`cov_A_B` for each pair of names, in the product of their units."""
    return {f"cov_{a}_{b}": fit.cov(a, b) for a, b in combinations(names, 2)}


def diagnostics_row(fit: LinearFit, rate_hz: float, low_pass: LowPass) -> Row:
    """Diagnostics of the fit and of its interval. The source of the interval, VAF [percent], R2 about zero, the scaled
    condition number, the largest correlation of two estimates, the number of samples, the correlation time [s] of the
    residuals, and their whiteness. The fitted rows have the rate `rate_hz`; their signals passed `low_pass`."""
    return judged_row(fit, rate_hz, whiteness(fit.residual, rate_hz, low_pass))


def judged_row(fit: LinearFit, rate_hz: float, judged: Whiteness | None) -> Row:
    """As `diagnostics_row`, with the whiteness of a residual that is not kept in the fit."""
    return {
        "interval_method": fit.interval_method,
        "VAF": fit.vaf,
        "R2": fit.r_squared,
        "condition_number": fit.condition_number,
        "largest_correlation": fit.largest_correlation,
        "samples": fit.samples,
        "correlation_s": fit.correlation_samples / rate_hz,
        "residual_autocorrelation": None if judged is None else judged.autocorrelation,
        "ljung_box_per_lag": None if judged is None else judged.per_lag,
        "ljung_box_p": None if judged is None else judged.p,
    }


def lag_damping_row(lag: float | None, se: float | None, K: float, certain_from: float = 2.0) -> Row:
    """Lag [s] of the torque behind the angle, its standard error, and what it adds to B: -K lag [N*m*s/rad].
    `certain_lag_damping` is the same if the lag is larger than `certain_from` standard errors, else 0. All null without
    a lag."""
    damping = certain = None
    if lag is not None and se is not None:
        damping = -K * lag
        certain = damping if abs(lag) > certain_from * se else 0.0
    return {"lag_s": lag, "lag_se_s": se, "lag_damping": damping, "certain_lag_damping": certain}
