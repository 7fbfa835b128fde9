"""Linear regression on rows: rank check, covariance for correlated residuals, diagnostics; and a fit as a row of a
result table. The bench fits groups of rows by the same rules (bench/gram.py)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import LowPass
from osl_analysis.stats.covariance import Covariance, hac
from osl_analysis.trial import Array, check_finite, check_measured, rounding_of

CONDITION_LIMIT = 1e3
"""Largest scaled condition number that is accepted. At this limit an error of 0.1 % in a column can cause an error of
100 % in an estimate."""
ROUNDED = 1e6  # condition number from which the inverse of the normal equations is lost in rounding


@dataclass(frozen=True)
class LinearFit:
    """Result of `linear_fit`."""

    names: tuple[str, ...]  # names of the p columns
    estimates: Array  # estimates (p,) [unit of y per unit of the column]
    covariance: Array  # covariance of the estimates (p, p)
    vaf: float  # 100 (1 - var(residual)/var(y)) [percent]. An offset does not change it.
    r_squared: float  # coefficient of determination about zero. An offset does change it.
    condition_number: float  # of the columns, each scaled to unit length, about their means beside an offset
    correlation_samples: int  # number of samples over which the residuals were allowed to be correlated
    samples: int  # number of samples n that were fitted
    interval_method: str
    """Source of the covariance: `HAC`, `cycles`, or the source that its own fit names."""
    degrees_of_freedom: Array  # degrees of freedom (p,) of the estimates' variances, for Student's quantile
    residual: Array  # y minus the fit (n,) [unit of y]
    largest_correlation: float
    """Largest absolute correlation of two estimates under white noise, but for an offset's: from the columns, so that a
    few noisy cycles do not change it; 0 if there is only one. Near 1 only a combination of the two is known."""

    def __getitem__(self, name: str) -> float:
        return float(self.estimates[self.names.index(name)])

    def se(self, name: str) -> float:
        """Standard error of one estimate, in its unit."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def cov(self, first: str, second: str) -> float:
        """Covariance of two estimates, in the product of their units."""
        return float(self.covariance[self.names.index(first), self.names.index(second)])

    def correlation(self, first: str, second: str) -> float:
        """Correlation of two estimates, -1 to 1; near these limits only their combination is known. 0 for an exact
        fit, whose errors are 0."""
        scale = self.se(first) * self.se(second)
        return self.cov(first, second) / scale if scale > 0 else 0.0

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % interval of one estimate, in its unit (Student's quantile)."""
        half = float(scipy.special.stdtrit(self.degrees_of_freedom[self.names.index(name)], 0.975)) * self.se(name)
        return self[name] - half, self[name] + half


def linear_fit(
    y: Array, columns: Mapping[str, Array], covariance_of: Callable[[Array, Array, Array], Covariance] = hac
) -> LinearFit:
    """Least squares of y (n,) on named columns (n,) each, with standard errors for correlated residuals: by Newey and
    West (Econometrica 55, 1987) with the bandwidth of Andrews (Econometrica 59, 1991), or by another covariance with
    the arguments of `hac`. Degrees of freedom are infinite where a variance is 0, as that of an exact fit may be.

    Raises InputError: Lengths differ, a value cannot be measured (`check_measured`), or there are not more samples than
    columns. Raises IdentifiabilityError: The scaled condition number exceeds `CONDITION_LIMIT`; the message names the
    two columns that look alike.
    """
    for name, column in columns.items():
        if np.shape(column) != np.shape(y):
            raise InputError(f"column '{name}' has shape {np.shape(column)}, expected {np.shape(y)} like y")
    X, names = np.array([np.asarray(c, dtype=float) for c in columns.values()]).T, tuple(columns)
    for name, column in zip(names, X.T, strict=True):
        check_measured(f"column '{name}'", column)
    if len(y) <= len(names):
        raise InputError(f"{len(y)} samples cannot determine {len(names)} parameters; use a longer window")
    scale = check_not_zero(names, np.linalg.norm(X, axis=0))
    U, singular, Vt = np.linalg.svd(X / scale, full_matrices=False)
    condition, about_means = float(singular[0] / max(singular[-1], np.finfo(float).tiny)), np.empty((0, 0))
    if condition < ROUNDED:
        inverse = (Vt.T / singular**2) @ Vt / np.outer(scale, scale)
        # beside an offset that of the columns about their means: where the angle has its zero does not matter
        varying = [k for k, column in enumerate(X.T) if column[0] != column[-1] or np.ptp(column)]
        about_means = inverse[np.ix_(varying, varying)]
        condition = scaled_condition(about_means) if len(varying) > 1 else condition
    if condition > CONDITION_LIMIT:
        refuse_unidentifiable(names, Vt[-1], condition)
    check_measured("column 'y'", y)
    estimates = (y @ U) / singular @ Vt / scale
    residual = y - X @ estimates
    covariance, degrees_of_freedom, method, window = covariance_of(X, inverse, residual)
    return LinearFit(
        names,
        estimates,
        covariance,
        variance_accounted_for(y, residual),
        1 - float(residual @ residual) / max(float(y @ y), np.finfo(float).tiny),
        condition,
        window,
        len(y),
        method,
        degrees_of_freedom,
        residual,
        largest_correlation(about_means),
    )


def check_not_zero(names: Sequence[str], lengths: Array) -> Array:
    """Lengths (p,) of columns; one that is zero throughout is refused."""
    if not (lengths > 0).all():
        raise IdentifiabilityError(
            f"'{names[int(np.argmin(lengths))]}' cannot be estimated: its column is zero throughout"
        )
    return lengths


def refuse_unidentifiable(names: tuple[str, ...], direction: Array, condition: float) -> None:
    """Raise an error that names the two columns with the largest weights in `direction`, which cannot be estimated."""
    worst = sorted(np.argsort(np.abs(direction))[-2:])
    first, second = (names[i] for i in worst)
    raise IdentifiabilityError(
        f"{first} and {second} cannot be told apart in these data (scaled condition number {condition:.3g}); "
        "excite more frequencies, lengthen the window or fix one of them"
    )


def scaled_condition(inverse: Array) -> float:
    """Condition number of columns scaled to unit length, from the inverse (p, p) of their normal equations."""
    gram = np.linalg.inv(inverse)
    squares = np.linalg.eigvalsh(gram / np.sqrt(np.outer(np.diag(gram), np.diag(gram))))
    return float(np.sqrt(squares[-1] / max(squares[0], np.finfo(float).eps ** 2 * squares[-1])))


def largest_correlation(covariance: Array) -> float:
    """Largest absolute correlation in a covariance (p, p); 0 for a single estimate."""
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    return float(np.max(np.abs(np.triu(covariance / np.outer(scale, scale), 1)), initial=0.0))


def with_shared_error(fit: LinearFit, change: Array) -> LinearFit:
    """The fit with an error that all its data share: `change` (p,) is what one standard error of a known quantity, such
    as a calibration, does to the estimates; its degrees of freedom are infinite."""
    random = np.diag(fit.covariance)
    covariance = fit.covariance + np.outer(change, change)
    share = np.divide(random, np.diag(covariance), out=np.ones_like(random), where=np.diag(covariance) > 0)
    degrees_of_freedom = np.divide(fit.degrees_of_freedom, share**2, out=np.full_like(share, np.inf), where=share > 0)
    return replace(fit, covariance=covariance, degrees_of_freedom=degrees_of_freedom)


def variance_accounted_for(y: Array, residual: Array) -> float:
    """VAF = 100 (1 - var(residual)/var(y)) [percent], of y and residual (n,); NaN without samples. A y that does not
    vary beyond rounding is accounted for by 100 % if the residual does not vary either, else by 0. Raises InputError: A
    value is not finite or cannot be measured."""
    check_measured("y", y)
    check_finite("the residual", residual)
    if not len(y):
        return float("nan")
    left, varied, rounding = float(np.var(residual)), float(np.var(y)), rounding_of(y)
    if varied > rounding:
        return 100 * (1 - left / varied)
    return 100.0 if left <= rounding else 0.0


Row = dict[str, float | str | None]  # one row of a result table, by column. None becomes an empty field.


def thinned_rows(samples: int, rate_hz: float, low_pass: LowPass) -> NDArray[np.intp]:
    """The rows of a residual at `rate_hz` that are kept for its whiteness: at twice the noise bandwidth of the filter
    that its signals passed. White noise that passed the filter is white again at that rate; thinned to twice the
    cut-off, it would still have an autocorrelation of 0.1, which the test detects in a thousand samples."""
    step = max(rate_hz / (2 * low_pass.noise_bandwidth_hz), 1.0)
    return np.asarray(np.rint(np.arange(0, samples - 0.5, step)), dtype=np.intp)


def whiteness_row(thinned: Array) -> Row:
    """How much a residual (n,), thinned by `thinned_rows`, is correlated with its own past: its autocorrelation after
    one sample, and Ljung and Box's statistic per lag with its p (Biometrika 65, 1978): n (n + 2) sum_k r_k^2 / (n - k)
    over 10 lags, or a fifth of the samples if that is fewer, is chi-squared. All null for a residual of zeros, and of
    fewer than 20 samples, whose autocorrelations are uncertain by 0.2 and more."""
    check_measured("the residual", thinned)
    n, power = len(thinned), float(thinned @ thinned)
    if n < 20 or power == 0:
        return dict.fromkeys(("residual_autocorrelation", "ljung_box_per_lag", "ljung_box_p"))
    lag = np.arange(1, min(10, n // 5) + 1)
    r = np.array([float(thinned[k:] @ thinned[:-k]) for k in lag]) / power
    Q = n * (n + 2) * float(np.sum(r**2 / (n - lag)))
    p = float(scipy.special.chdtrc(len(lag), Q))
    return {"residual_autocorrelation": float(r[0]), "ljung_box_per_lag": Q / len(lag), "ljung_box_p": p}


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


def diagnostics_row(fit: LinearFit, rate_hz: float, white: Row) -> Row:
    """What all tables say of a fit and of its interval; the fitted rows have the rate `rate_hz`, and the whiteness
    `white`. VAF in percent, R2 about zero, the correlation time in seconds."""
    return {
        "interval_method": fit.interval_method,
        "VAF": fit.vaf,
        "R2": fit.r_squared,
        "condition_number": fit.condition_number,
        "largest_correlation": fit.largest_correlation,
        "samples": fit.samples,
        "correlation_s": fit.correlation_samples / rate_hz,
        **white,
    }


def lag_damping_row(lag: float | None, se: float | None, K: float, certain_from: float = 2.0) -> Row:
    """Lag [s] of the torque behind the angle, its standard error, and what it adds to B: -K lag [N*m*s/rad];
    `certain_lag_damping` is 0 for a lag of no more than `certain_from` standard errors. All null without a lag."""
    damping = certain = None
    if lag is not None and se is not None:
        damping = -K * lag
        certain = damping if abs(lag) > certain_from * se else 0.0
    return {"lag_s": lag, "lag_se_s": se, "lag_damping": damping, "certain_lag_damping": certain}
