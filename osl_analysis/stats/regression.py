"""The one linear regression under every fit: rank check, covariance for correlated residuals, diagnostics."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.stats.covariance import Cycles, between_cycles, correlation_samples, moving_sums
from osl_analysis.trial import Array

CONDITION_LIMIT = 1e3
"""Scaled condition number above which estimates mean nothing: an error of 0.1 % in a column becomes one of 100 %."""


@dataclass(frozen=True)
class LinearFit:
    """Result of `linear_fit`: estimates [unit of y per unit of the column], their covariance, diagnostics.

    `vaf` is 100 (1 - var(residual)/var(y)) percent, blind to an offset; `r_squared` is about zero and is not.
    `condition_number` is that of the columns scaled to unit length, `correlation_samples` the number of samples
    over which residuals were allowed to be correlated. `interval_method` says where the covariance is from: `HAC` or
    the spread between `cycles`, else what took its place (`slow_fit`, `fit_response`); `degrees_of_freedom` (p,) how
    much each variance is worth in Student's quantile.
    """

    names: tuple[str, ...]
    estimates: Array
    covariance: Array
    vaf: float
    r_squared: float
    condition_number: float
    correlation_samples: int
    samples: int
    interval_method: str
    degrees_of_freedom: Array
    residual: Array

    def __getitem__(self, name: str) -> float:
        return float(self.estimates[self.names.index(name)])

    def se(self, name: str) -> float:
        """Standard error of one estimate, in its unit."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def cov(self, first: str, second: str) -> float:
        """Covariance of two estimates, in the product of their units."""
        return float(self.covariance[self.names.index(first), self.names.index(second)])

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % interval of one estimate, in its unit (Student's quantile)."""
        half = float(stdtrit(self.degrees_of_freedom[self.names.index(name)], 0.975)) * self.se(name)
        return self[name] - half, self[name] + half


def linear_fit(
    y: Array,
    columns: Mapping[str, Array],
    condition_limit: float = CONDITION_LIMIT,
    cycles: Cycles | None = None,
    instruments: Mapping[str, Array] | None = None,
    lags: int | None = None,
    every: int = 1,
) -> LinearFit:
    """Least squares of y (n,) on named columns (n,) each, with standard errors for correlated residuals.

    Consecutive samples of a filtered signal are not independent. Where the experiment repeats `cycles`, the covariance
    is that of resampling them; without, it is Newey and West's (Econometrica 55, 1987) over `lags` samples, by default
    the bandwidth of Andrews (Econometrica 59, 1991), from each `every`-th sample: so far apart the filter leaves noise
    independent (`LowPass.independent_samples`). With `instruments`, as many as columns, the columns are replaced
    by their projection on these (two-stage least squares): noise in a column that no instrument shares does no harm.

    Raises
    ------
    InputError
        Lengths differ, a value is not finite, or there are not more samples than columns.
    IdentifiabilityError
        The scaled condition number exceeds `condition_limit`; the message names the two columns to blame.
    """
    names = tuple(columns)
    measured = checked_columns(y, columns)
    X = measured if instruments is None else projected(measured, checked_columns(y, instruments))
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
    residual = y - measured @ estimates
    inverse = (Vt.T / singular**2) @ Vt / np.outer(scale, scale)
    window = lags or correlation_samples(residual, every)
    scores = (X * residual[:, None]) @ inverse
    method = "HAC" if cycles is None else "cycles"
    covariance, freedom = (
        moving_sums(scores, window, slow=every > 1) if cycles is None else between_cycles(scores, cycles)
    )
    r_squared = 1 - float(residual @ residual) / max(float(y @ y), np.finfo(float).tiny)
    vaf = variance_accounted_for(y, residual)
    return LinearFit(names, estimates, covariance, vaf, r_squared, condition, window, len(y), method, freedom, residual)


def projected(X: Array, Z: Array) -> Array:
    """Columns X (n, p) as far as the instruments Z (n, q) explain them."""
    Q, _ = np.linalg.qr(Z / np.linalg.norm(Z, axis=0))
    return np.asarray(Q @ (Q.T @ X))


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
