"""The one linear regression under every fit: rank check, covariance for correlated residuals, diagnostics."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.trial import Array

CONDITION_LIMIT = 1e3
"""Scaled condition number above which estimates mean nothing: an error of 0.1 % in a column becomes one of 100 %."""


@dataclass(frozen=True)
class LinearFit:
    """Result of `linear_fit`: estimates [unit of y per unit of the column], their covariance, diagnostics.

    `vaf` is 100 (1 - var(residual)/var(y)) percent, blind to an offset; `r_squared` is about zero and is not.
    `condition_number` is that of the columns scaled to unit length, `correlation_samples` the number of samples
    over which residuals were allowed to be correlated.
    """

    names: tuple[str, ...]
    estimates: Array
    covariance: Array
    vaf: float
    r_squared: float
    condition_number: float
    correlation_samples: int
    samples: int

    def __getitem__(self, name: str) -> float:
        return float(self.estimates[self.names.index(name)])

    def se(self, name: str) -> float:
        """Standard error of one estimate, in its unit."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))


def linear_fit(y: Array, columns: Mapping[str, Array], condition_limit: float = CONDITION_LIMIT) -> LinearFit:
    """Least squares of y (n,) on named columns (n,) each, with standard errors for correlated residuals.

    Consecutive samples of a filtered signal are not independent, so the covariance is Newey and West's
    (Econometrica 55, 1987) with the bandwidth of Andrews (Econometrica 59, 1991).

    Raises
    ------
    InputError
        Lengths differ, a value is not finite, or there are not more samples than columns.
    IdentifiabilityError
        The scaled condition number exceeds `condition_limit`; the message names the two columns to blame.
    """
    names = tuple(columns)
    X = checked_columns(y, columns)
    scale = np.linalg.norm(X, axis=0)
    if not (scale > 0).all():
        raise IdentifiabilityError(
            f"'{names[int(np.argmin(scale))]}' cannot be estimated: its column is zero throughout"
        )
    U, singular, Vt = np.linalg.svd(X / scale, full_matrices=False)
    condition = float(singular[0] / max(singular[-1], np.finfo(float).tiny))
    if condition > condition_limit:
        refuse(names, Vt[-1], condition)
    estimates = (Vt.T @ ((U.T @ y) / singular)) / scale
    residual = y - X @ estimates
    lags = correlation_samples(residual)
    inverse = (Vt.T / singular**2) @ Vt / np.outer(scale, scale)
    covariance = inverse @ score_covariance(X * residual[:, None], lags) @ inverse * len(y) / (len(y) - len(names))
    r_squared = 1 - float(residual @ residual) / max(float(y @ y), np.finfo(float).tiny)
    return LinearFit(
        names, estimates, covariance, variance_accounted_for(y, residual), r_squared, condition, lags, len(y)
    )


def checked_columns(y: Array, columns: Mapping[str, Array]) -> Array:
    """The columns as a matrix (n, p), once lengths, finiteness and the number of samples are in order."""
    for name, column in {**columns, "y": y}.items():
        if np.shape(column) != np.shape(y):
            raise InputError(f"column '{name}' has shape {np.shape(column)}, expected {np.shape(y)} like y")
        if not np.isfinite(column).all():
            raise InputError(f"column '{name}' is not finite at sample {int(np.argmin(np.isfinite(column)))}")
    if len(y) <= len(columns):
        raise InputError(f"{len(y)} samples cannot determine {len(columns)} parameters; use a longer window")
    return np.column_stack([np.asarray(c, dtype=float) for c in columns.values()])


def refuse(names: tuple[str, ...], direction: Array, condition: float) -> None:
    """Name the two columns that weigh most in the direction that the data cannot see."""
    worst = sorted(np.argsort(np.abs(direction))[-2:])
    first, second = (names[i] for i in worst)
    raise IdentifiabilityError(
        f"{first} and {second} cannot be told apart in these data (scaled condition number {condition:.3g}); "
        "excite more frequencies, lengthen the window or fix one of them"
    )


def variance_accounted_for(y: Array, residual: Array) -> float:
    """VAF = 100 (1 - var(residual)/var(y)) [percent]; NaN for a constant y."""
    variance = float(np.var(y))
    return 100 * (1 - float(np.var(residual)) / variance) if variance > 0 else float("nan")


def correlation_samples(residual: Array) -> int:
    """Andrews' plug-in bandwidth for the Bartlett kernel from an AR(1) fit, at most an eighth of the samples."""
    n = len(residual)
    power = float(residual[:-1] @ residual[:-1])
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(max(rho, 0.0), 0.9999)
    alpha = 4 * rho**2 / (1 - rho**2) ** 2
    return int(np.clip(np.ceil(1.1447 * (alpha * n) ** (1 / 3)), 1, max(n // 8, 1)))


def score_covariance(scores: Array, window: int) -> Array:
    """Long-run covariance (p, p) of the scores (n, p), summed over samples, Bartlett weights up to `window` - 1 lags.

    The sum over all lags weighted 1 - lag/window equals the sum of squares of moving sums over `window`
    samples, zero beyond the ends, divided by `window`: positive semi-definite by construction.
    """
    padded = np.vstack([np.zeros((window, scores.shape[1])), scores, np.zeros((window - 1, scores.shape[1]))])
    cumulative = np.cumsum(padded, axis=0)
    moving_sums = cumulative[window:] - cumulative[:-window]
    return np.asarray(moving_sums.T @ moving_sums / window)
