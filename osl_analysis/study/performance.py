"""Performance of estimates and intervals over simulated trials: bias, error over the Cramer-Rao bound, coverage."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.trial import Array

KEYS = ("experiment", "estimator", "interval_method", "quantity")
"""Columns that the rows of one performance have in common."""


@dataclass(frozen=True)
class Performance:
    """Performance of an estimator over n simulated trials. Names in `_mc` are Monte Carlo standard errors.

    Attributes
    ----------
    n
        Number of trials.
    bias, bias_mc
        Mean error divided by the standard deviation of the estimates.
    rmse
        Root mean square error, in the unit of the estimate.
    rmse_over_bound, rmse_over_bound_mc
        Root mean square error divided by the Cramer-Rao bound.
    se_over_sd
        Stated standard error (root mean square) divided by the standard deviation of the estimates.
    coverage, coverage_mc
        Share of the 95 % intervals that contain the truth.
    """

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
    """Performance from errors about the truth, stated standard errors, coverage and bounds, shape (n,) each.

    `covered` says whether the interval contains the truth. `bound` is the smallest possible standard error.
    """
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
    """Smallest standard error of any unbiased estimate of y = X b + e, for exactly known columns, shape (n,) each.

    The error e is Gaussian. It is white with standard deviation `noise`, plus a random multiple of `drift`, shape (n,),
    which is the standard deviation of a drift in time. Cramer and Rao: cov(b) >= (X' V^-1 X)^-1 with
    V = noise^2 1 + drift drift'. Its inverse is Sherman and Morrison's. A filter that passes the columns does not
    change the bound: per frequency the information is |H X|^2/(|H|^2 noise^2), and H cancels.
    """
    X = np.column_stack(list(columns.values()))
    drift = np.zeros(len(X)) if drift is None else drift
    seen = X.T @ drift
    information = (X.T @ X - np.outer(seen, seen) / (noise**2 + drift @ drift)) / noise**2
    covariance = np.linalg.inv(information)
    return dict(zip(columns, np.sqrt(np.diag(covariance)).tolist(), strict=True))


def performance_table(estimates: pl.DataFrame) -> pl.DataFrame:
    """Performance for each experiment, estimator, kind of interval and quantity, from a row per estimate."""
    rows = []
    for key, group in estimates.group_by(KEYS, maintain_order=True):
        value, truth, model_truth, low, high, se, bound = (
            group[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
            for name in ("value", "truth", "model_truth", "low", "high", "se", "bound")
        )
        judged = performance(value - truth, se, (low <= truth) & (truth <= high), bound)
        model = {
            "model_coverage": float(np.mean((low <= model_truth) & (model_truth <= high))),
            "model_error": group["model_error"].cast(pl.Float64).mean(),
        }
        rows.append({**dict(zip(KEYS, key, strict=True)), **asdict(judged), **model})
    return pl.DataFrame(rows, infer_schema_length=None).fill_nan(None)
