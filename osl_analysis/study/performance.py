"""Is an interval honest? Bias, error against the Cramer-Rao bound and coverage over simulated trials."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array


@dataclass(frozen=True)
class Performance:
    """Over n trials: bias in standard deviations of the estimate, RMSE in the estimate's unit and over the bound,
    stated over true standard error, share of intervals that hold the truth; each with its Monte Carlo error."""

    n: int
    bias: float
    bias_mc: float
    rmse: float
    rmse_over_bound: float
    rmse_over_bound_mc: float
    se_over_sd: float
    coverage: float
    coverage_mc: float


def performance(error: Array, se: Array, covered: NDArray[np.bool_], bound: Array) -> Performance:
    """From errors (n,) about the truth, stated standard errors, whether the interval held it, and the bound's root."""
    n, sd = len(error), float(np.std(error, ddof=1))
    ratio = float(np.sqrt(np.mean((error / bound) ** 2)))
    kurtosis = float(np.mean(error**4) / np.mean(error**2) ** 2)
    share = (float(np.sum(covered)) + 2) / (n + 4)  # Agresti and Coull: no error of zero where all are covered
    return Performance(
        n=n,
        bias=float(np.mean(error)) / sd,
        bias_mc=1 / float(np.sqrt(n)),
        rmse=float(np.sqrt(np.mean(error**2))),
        rmse_over_bound=ratio,
        rmse_over_bound_mc=ratio * float(np.sqrt(max(kurtosis - 1, 0.0) / (4 * n))),
        se_over_sd=float(np.sqrt(np.mean(se**2))) / sd,
        coverage=float(np.mean(covered)),
        coverage_mc=float(np.sqrt(share * (1 - share) / (n + 4))),
    )


def regression_bound(columns: Mapping[str, Array], noise: float, drift: Array | None = None) -> dict[str, float]:
    """Smallest standard error of any unbiased estimate of y = X b + e, for exactly known columns (n,) each.

    e is Gaussian: white of standard deviation `noise`, plus a chance multiple of the standard deviation `drift` (n,),
    as a drift in time is. Cramer and Rao: cov(b) >= (X' V^-1 X)^-1 with V = noise^2 I + drift drift', whose inverse is
    Sherman and Morrison's. A filter that passes the columns leaves it as it is: per frequency the information is
    |H X|^2/(|H|^2 noise^2), and H cancels.
    """
    X = np.column_stack(list(columns.values()))
    drift = np.zeros(len(X)) if drift is None else drift
    seen = X.T @ drift
    information = (X.T @ X - np.outer(seen, seen) / (noise**2 + drift @ drift)) / noise**2
    covariance = np.linalg.inv(information)
    return dict(zip(columns, np.sqrt(np.diag(covariance)).tolist(), strict=True))
