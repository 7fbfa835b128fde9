"""Linear regression on rows: rank check, estimates with covariance, VAF.

The bench fits groups of rows by the same rules (bench/regression.py)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import EXACT_FIT_SHARE, check_finite, check_measured
from osl_analysis.stats.covariance import hac
from osl_analysis.trial import Array

CONDITION_LIMIT = 1e3
"""Largest scaled condition number that is accepted. At this limit an error of 0.1 % in a column can
cause an error of 100 % in an estimate."""

NORMAL_HALF_WIDTH = 1.959964  # standard errors of a 95 % interval where their size is known

ROUNDED = 1e6  # condition number above which rounding destroys the inverse of the normal equations


@dataclass(frozen=True)
class LinearFit:
    """A least-squares fit of p columns to y (n,)."""

    names: tuple[str, ...]  # names of the p columns
    estimates: Array  # estimates (p,) [unit of y per unit of the column]
    covariance: Array  # covariance of the estimates (p, p)
    vaf: float  # 100 (1 - var(residual)/var(y)) [percent]. An offset does not change it.
    # of the columns, each scaled to unit length, about their means beside an offset
    condition_number: float
    interval_method: str
    """Source of the covariance: `HAC`, `cycles`, or the source that its own fit names."""
    # degrees of freedom (p,) of the estimates' variances, for Student's quantile
    degrees_of_freedom: Array
    largest_correlation: float
    """Largest absolute correlation of two estimates under white noise, without an offset's. It is
    computed from the columns: a few noisy cycles do not change it. 0 if there is only one; near 1
    only a combination is known."""

    # number of samples over which the residuals were allowed to be correlated; 0 of sums
    correlation_samples: int = 0
    # y minus the fit (n,) [unit of y]; empty of sums
    residual: Array = field(default_factory=lambda: np.empty(0))

    def __getitem__(self, name: str) -> float:
        return float(self.estimates[self.names.index(name)])

    def se(self, name: str) -> float:
        """Standard error of one estimate, in its unit."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % interval of one estimate, in its unit (Student's quantile)."""
        freedom = self.degrees_of_freedom[self.names.index(name)]
        half_width = float(scipy.special.stdtrit(freedom, 0.975)) * self.se(name)
        return self[name] - half_width, self[name] + half_width


def linear_fit(y: Array, columns: Mapping[str, Array]) -> LinearFit:
    """Fit columns to y by least squares, with standard errors for correlated residuals.

    Parameters
    ----------
    y : Array (n,)
        What is explained.
    columns : Mapping of Array (n,)
        By name.

    Returns
    -------
    LinearFit
        Degrees of freedom are infinite where a variance is 0, as that of an exact fit may be.

    Raises
    ------
    InputError
        Lengths differ, a value cannot be measured (`check_measured`), or there are not more samples
        than columns.
    IdentifiabilityError
        The scaled condition number exceeds `CONDITION_LIMIT`; the message names the two columns
        that look alike.
    """
    names = tuple(columns)
    for name, column in columns.items():
        if np.shape(column) != np.shape(y):
            raise InputError(
                f"column '{name}' has shape {np.shape(column)}, expected {np.shape(y)} like y"
            )
    X = np.array([np.asarray(column, dtype=float) for column in columns.values()]).T
    for name, column in zip(names, X.T, strict=True):
        check_measured(f"column '{name}'", column)
    if len(y) <= len(names):
        raise InputError(
            f"{len(y)} samples cannot determine {len(names)} parameters; use a longer window"
        )

    scale = check_not_zero(names, np.linalg.norm(X, axis=0))
    U, singular, Vt = np.linalg.svd(X / scale, full_matrices=False)
    condition = float(singular[0] / max(singular[-1], np.finfo(float).tiny))
    about_means = np.empty((0, 0))
    if condition < ROUNDED:
        inverse = (Vt.T / singular**2) @ Vt / np.outer(scale, scale)
        # beside an offset, of the columns about their means, so that the zero of the angle does not
        # matter
        varying = [k for k, column in enumerate(X.T) if column[0] != column[-1] or np.ptp(column)]
        about_means = inverse[np.ix_(varying, varying)]
        if len(varying) > 1:
            condition = scaled_condition(about_means)
    if condition > CONDITION_LIMIT:
        refuse_unidentifiable(names, Vt[-1], condition)

    check_measured("column 'y'", y)
    estimates = (y @ U) / singular @ Vt / scale
    residual = y - X @ estimates
    covariance, freedom, window = hac(X, inverse, residual)
    return LinearFit(
        names=names,
        estimates=estimates,
        covariance=covariance,
        vaf=variance_accounted_for(y, residual),
        condition_number=condition,
        correlation_samples=window,
        interval_method="HAC",
        degrees_of_freedom=freedom,
        residual=residual,
        largest_correlation=largest_correlation(about_means),
    )


def check_not_zero(names: Sequence[str], lengths: Array) -> Array:
    """Lengths (p,) of columns; one that is zero throughout is refused."""
    if not (lengths > 0).all():
        raise IdentifiabilityError(
            f"'{names[int(np.argmin(lengths))]}' cannot be estimated: its column is zero throughout"
        )
    return lengths


def refuse_unidentifiable(names: tuple[str, ...], direction: Array, condition: float) -> None:
    """Raise an error that names the two columns with the largest weights in `direction`, which
    cannot be estimated."""
    worst = sorted(np.argsort(np.abs(direction))[-2:])
    first, second = (names[i] for i in worst)
    raise IdentifiabilityError(
        f"{first} and {second} cannot be told apart in these data (scaled condition number"
        f" {condition:.3g}); excite more frequencies, lengthen the window or fix one of them"
    )


def scaled_condition(inverse: Array) -> float:
    """Condition number of columns scaled to unit length, from the inverse (p, p) of their normal
    equations."""
    gram = np.linalg.inv(inverse)
    squares = np.linalg.eigvalsh(gram / np.sqrt(np.outer(np.diag(gram), np.diag(gram))))
    return float(np.sqrt(squares[-1] / max(squares[0], np.finfo(float).eps ** 2 * squares[-1])))


def largest_correlation(covariance: Array) -> float:
    """Largest absolute correlation in a covariance (p, p); 0 for a single estimate."""
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    return float(np.max(np.abs(np.triu(covariance / np.outer(scale, scale), 1)), initial=0.0))


def without(fixed: Array) -> Callable[[Array], Array]:
    """A function: the residual of columns (n, ...) on fixed ones (n, p). Beside these, a fit is
    then small algebra."""
    Q = np.linalg.qr(fixed)[0]
    return lambda columns: np.asarray(columns - Q @ (Q.T @ columns))


def with_shared_error(fit: LinearFit, change: Array) -> LinearFit:
    """Add an error that all data of a fit share.

    Parameters
    ----------
    fit
        Without it.
    change : Array (p,)
        Effect on the estimates of one standard error of a known quantity, such as a calibration,
        with infinite degrees of freedom.
    """
    random = np.diag(fit.covariance)
    covariance = fit.covariance + np.outer(change, change)
    total = np.diag(covariance)
    share = np.divide(random, total, out=np.ones_like(random), where=total > 0)
    infinite = np.full_like(share, np.inf)
    freedom = np.divide(fit.degrees_of_freedom, share**2, out=infinite, where=share > 0)
    return replace(fit, covariance=covariance, degrees_of_freedom=freedom)


def variance_accounted_for(y: Array, residual: Array) -> float:
    """VAF = 100 (1 - var(residual)/var(y)) [percent], of y and residual (n,); NaN without samples.
    A y that does not vary beyond rounding is accounted for by 100 % if the residual does not vary
    either, else by 0. Raises InputError: A value is not finite or cannot be measured."""
    check_measured("y", y)
    check_finite("the residual", residual)
    if not len(y):
        return float("nan")
    return float(vaf_by_moments(np.var(residual), np.var(y), np.mean(y**2)))


def vaf_by_moments(unexplained: ArrayLike, variance: ArrayLike, mean_square: ArrayLike) -> Array:
    """`variance_accounted_for` [percent] by the variance of the residual, and the variance and the
    mean square of y, of (k,) fits or of one."""
    unexplained, variance = np.asarray(unexplained), np.asarray(variance)
    rounding = EXACT_FIT_SHARE * np.asarray(mean_square)
    of_constant = np.where(unexplained > rounding, 1.0, 0.0)
    share = np.divide(unexplained, variance, out=of_constant, where=variance > rounding)
    return np.asarray(100 * (1 - share))
