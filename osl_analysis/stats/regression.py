"""Linear regression on rows: rank check, covariance for correlated residuals, diagnostics; and a
fit as a row of a result table. The bench fits groups of rows by the same rules
(bench/group_fit.py).

The covariance of estimates comes from their scores; a score is the part of the estimates' error due
to one sample. It is computed from the spread between repeated cycles, whose edges may lie between
two samples, or from the autocorrelation of the residuals, with a correction for the degrees of
freedom that the fit uses up."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import LARGEST_VARIANCE, check_finite, check_measured, rounding_of
from osl_analysis.signals import LowPass
from osl_analysis.trial import Array


def products_between(X: Array, Y: Array, first: Array, stop: Array) -> Array:
    """Sum the products of columns over stretches that may begin and end between two rows.

    A fraction of a row is read from the cubic through the four cumulative sums around it, so that
    all cycles of a fractional period have equal sums. Beyond the ends there is nothing to sum.

    Parameters
    ----------
    X : Array (n, p)
        Columns.
    Y : Array (n, q)
        Further columns.
    first, stop : Array (m,)
        Rows at which the m stretches begin and end.

    Returns
    -------
    Array (m, p, q)
        X'Y of each.
    """
    edges = np.stack([first, stop], axis=1).ravel()
    row = np.clip(np.floor(edges + SAME_ROW).astype(np.intp), 0, len(Y))
    of_whole_rows = np.array([X[a:b].T @ Y[a:b] for a, b in row.reshape(-1, 2)])

    share = np.maximum(edges - row, 0.0)
    x = np.where(share < SAME_ROW, 0.0, share)
    around = row + np.array([[-1], [0], [1]])
    inside = np.clip(around, 0, len(Y) - 1)
    lagrange = np.array([x * (x - 1) * (x - 2), x * (x + 1) * (5 - 2 * x), x * (x + 1) * (x - 1)])
    weights = lagrange / 6 * (around == inside)
    of_parts = (weights[:, :, None] * X[inside]).transpose(1, 2, 0) @ Y[inside].transpose(1, 0, 2)
    return np.asarray(of_whole_rows + of_parts[1::2] - of_parts[::2])


SAME_ROW = 1e-9  # of a row, within which an edge lies on it
FEWEST_CYCLES = 5  # smallest number of cycles at one frequency whose spread gives an interval
LARGEST_AR1 = 0.9999  # autocorrelation of a residual after one sample, beyond which none is fitted


class Covariance(NamedTuple):
    """The covariance of p estimates, and where it comes from."""

    matrix: Array  # (p, p)
    degrees_of_freedom: Array  # of its variances (p,)
    source: str  # as tables name it
    correlation_samples: int  # over which the residual may be correlated


def hac(X: Array, inverse: Array, residual: Array) -> Covariance:
    """Find the covariance from the autocorrelation of the residual (Newey and West, Econometrica
    55, 1987).

    The window is Andrews' plug-in bandwidth for the Bartlett kernel from an AR(1) fit (Econometrica
    59, 1991), at most an eighth of the samples. Low-pass filtered noise is no AR(1) at the sampling
    rate: 30 ms of correlation give a window of 2.5 s.

    Parameters
    ----------
    X : Array (n, p)
        Columns.
    inverse : Array (p, p)
        X times it is the change of each estimate per sample of y.
    residual : Array (n,)
        What the fit leaves.

    Raises
    ------
    InputError
        A value is not finite or cannot be measured.
    """
    check_measured("the residual", residual)
    n = len(residual)
    power = float(residual[:-1] @ residual[:-1])
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(max(rho, 0.0), LARGEST_AR1)
    alpha = 4 * rho**2 / (1 - rho**2) ** 2
    window = int(np.clip(np.ceil(1.1447 * (alpha * n) ** (1 / 3)), 1, max(n // 8, 1)))
    scores = X @ inverse * residual[:, None]
    return Covariance(*moving_sums(scores, window), "HAC", window)


def moving_sums(scores: Array, window: int) -> tuple[Array, Array]:
    """Long-run covariance (p, p) of the scores (n, p), and the degrees of freedom (p,) of its
    variances, after Newey and West: Bartlett weights 1 - lag/window. The sum over all lags equals
    the sum of squares of moving sums over `window` samples (zeros beyond the ends) divided by
    `window`, and is therefore positive semi-definite. It has 1.5 n/window degrees of freedom
    (Priestley, Spectral Analysis and Time Series, 1981, table 6.2, at frequency zero). The fit uses
    up p of the n samples."""
    n, p = scores.shape
    cumulative = np.concatenate([np.zeros((window, p)), np.cumsum(scores, axis=0)])
    cumulative = np.concatenate([cumulative, np.repeat(cumulative[-1:], window - 1, axis=0)])
    sums = cumulative[window:] - cumulative[:-window]
    return sums.T @ sums / window * n / (n - p), np.full(p, max(1.5 * n / window - p, 1.0))


def between_cycles(sums: Array, stratum: NDArray[np.intp]) -> tuple[Array, Array]:
    """Find the covariance from the spread of repeated cycles.

    A bootstrap that draws cycles within each stratum converges to it, apart from the factor m/(m -
    1) for the mean that was estimated from the m cycles of the stratum, two or more.

    Parameters
    ----------
    sums : Array (m, p)
        Sums of scores of each cycle.
    stratum : Array (m,)
        Which cycles repeat one another; rising.

    Returns
    -------
    covariance : Array (p, p)
        From the spread about the mean of each stratum.
    degrees_of_freedom : Array (p,)
        Of its variances.
    """
    members = np.bincount(stratum).astype(float)
    begins = np.flatnonzero(np.diff(stratum, prepend=-1))
    mean = np.add.reduceat(sums, begins) / members[:, None]
    for_mean = np.sqrt(members / (members - 1))
    spread = (sums - mean[stratum]) * for_mean[stratum, None]
    variances = np.add.reduceat(spread**2, begins)
    return spread.T @ spread, welch_satterthwaite(variances, members - 1)


def less(covariance: Array, variances: Array) -> Array:
    """A covariance (p, p) less some of its variances (p,); correlations are kept."""
    share = np.maximum(variances, 0.0) / np.maximum(np.diag(covariance), np.finfo(float).tiny)
    left = np.sqrt(np.maximum(1 - share, 0.0))
    return np.asarray(covariance * np.outer(left, left))


def welch_satterthwaite(
    variances: Sequence[ArrayLike] | Array, degrees_of_freedom: ArrayLike
) -> Array:
    """Find the degrees of freedom of a sum of k independent variances (Satterthwaite, Biometrics
    Bulletin 2, 1946; Welch, Biometrika 34, 1947).

    Parameters
    ----------
    variances : (k, ...)
        The summands.
    degrees_of_freedom : (k,) or (k, ...)
        Of each.

    Returns
    -------
    Array (...)
        Infinite where all variances are zero, or the uncertain ones vanish beside the others: the
        rounding of a sum would decide on more than `MOST_FREEDOM`.

    Raises
    ------
    InputError
        A variance is not finite or beyond `LARGEST_VARIANCE`.
    """
    summands = np.asarray(variances, dtype=float)
    check_finite("the variance", summands, LARGEST_VARIANCE)
    certainty = 1 / np.asarray(degrees_of_freedom, dtype=float)
    if certainty.ndim < summands.ndim:
        certainty = certainty.reshape(-1, *[1] * (summands.ndim - 1))
    uncertainty = np.sum(certainty * summands**2, axis=0)
    square_of_sum = np.sum(summands, axis=0) ** 2
    is_finite = uncertainty > square_of_sum / MOST_FREEDOM
    infinite = np.full_like(square_of_sum, np.inf)
    return np.asarray(np.divide(square_of_sum, uncertainty, out=infinite, where=is_finite))


MOST_FREEDOM = 1e12  # degrees of freedom
CONDITION_LIMIT = 1e3
"""Largest scaled condition number that is accepted. At this limit an error of 0.1 % in a column can
cause an error of 100 % in an estimate."""
ROUNDED = 1e6  # condition number above which rounding destroys the inverse of the normal equations


@dataclass(frozen=True)
class LinearFit:
    """A least-squares fit of p columns to y (n,)."""

    names: tuple[str, ...]  # names of the p columns
    estimates: Array  # estimates (p,) [unit of y per unit of the column]
    covariance: Array  # covariance of the estimates (p, p)
    vaf: float  # 100 (1 - var(residual)/var(y)) [percent]. An offset does not change it.
    r_squared: float  # coefficient of determination about zero. An offset does change it.
    # of the columns, each scaled to unit length, about their means beside an offset
    condition_number: float
    # number of samples over which the residuals were allowed to be correlated
    correlation_samples: int
    samples: int  # number of samples n that were fitted
    interval_method: str
    """Source of the covariance: `HAC`, `cycles`, or the source that its own fit names."""
    # degrees of freedom (p,) of the estimates' variances, for Student's quantile
    degrees_of_freedom: Array
    residual: Array  # y minus the fit (n,) [unit of y]
    largest_correlation: float
    """Largest absolute correlation of two estimates under white noise, without an offset's. It is
    computed from the columns: a few noisy cycles do not change it. 0 if there is only one; near 1
    only a combination is known."""

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
        """Correlation of two estimates, -1 to 1, where only their combination is known. 0 for an
        exact fit."""
        scale = self.se(first) * self.se(second)
        return self.cov(first, second) / scale if scale > 0 else 0.0

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % interval of one estimate, in its unit (Student's quantile)."""
        freedom = self.degrees_of_freedom[self.names.index(name)]
        half_width = float(scipy.special.stdtrit(freedom, 0.975)) * self.se(name)
        return self[name] - half_width, self[name] + half_width


def linear_fit(
    y: Array,
    columns: Mapping[str, Array],
    covariance_of: Callable[[Array, Array, Array], Covariance] = hac,
) -> LinearFit:
    """Fit columns to y by least squares, with standard errors for correlated residuals.

    Parameters
    ----------
    y : Array (n,)
        What is explained.
    columns : Mapping of Array (n,)
        By name.
    covariance_of
        Where the standard errors come from; it takes the arguments of `hac`.

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
    covariance = covariance_of(X, inverse, residual)
    square = max(float(y @ y), np.finfo(float).tiny)
    return LinearFit(
        names=names,
        estimates=estimates,
        covariance=covariance.matrix,
        vaf=variance_accounted_for(y, residual),
        r_squared=1 - float(residual @ residual) / square,
        condition_number=condition,
        correlation_samples=covariance.correlation_samples,
        samples=len(y),
        interval_method=covariance.source,
        degrees_of_freedom=covariance.degrees_of_freedom,
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
    left, varied = float(np.var(residual)), float(np.var(y))
    rounding = rounding_of(y)
    if varied > rounding:
        return 100 * (1 - left / varied)
    return 100.0 if left <= rounding else 0.0


# one row of a result table, by column. None becomes an empty field.
Row = dict[str, float | str | None]


def thinned_rows(samples: int, rate_hz: float, low_pass: LowPass) -> NDArray[np.intp]:
    """The rows of a residual at `rate_hz` that are kept for its whiteness: at twice the noise
    bandwidth of the filter that its signals passed. White noise that passed the filter is white
    again at that rate; thinned to twice the cut-off, it would still have an autocorrelation of 0.1,
    which the test detects in a thousand samples."""
    step = max(rate_hz / (2 * low_pass.noise_bandwidth_hz), 1.0)
    return np.asarray(np.rint(np.arange(0, samples - 0.5, step)), dtype=np.intp)


FEWEST_FOR_WHITENESS = 20  # samples; of fewer, autocorrelations are uncertain by 0.2 and more


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


def lag_damping_row(lag: float | None, se: float | None, is_certain: bool, K: float) -> Row:
    """Lag [s] of the torque behind the angle, its standard error, and what it adds to B: -K lag
    [N*m*s/rad]; `certain_lag_damping` is 0 where the lag is not certain. All null without a lag."""
    damping = None
    certain = None
    if lag is not None:
        damping = -K * lag
        certain = damping if is_certain else 0.0
    return {"lag_s": lag, "lag_se_s": se, "lag_damping": damping, "certain_lag_damping": certain}
