"""Covariance of the estimates of a regression whose residual is correlated.

The covariance comes from scores; a score is the part of the estimates' error due to one sample. It
is computed from the spread between repeated cycles, whose edges may lie between two samples, or
from the autocorrelation of the residual, with a correction for the degrees of freedom that the fit
uses up."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.measured import LARGEST_VARIANCE, check_finite, check_measured
from osl_analysis.trial import Array

SAME_ROW = 1e-9  # of a row, within which an edge lies on it


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


LARGEST_AR1 = 0.9999  # autocorrelation of a residual after one sample, beyond which none is fitted


def hac(X: Array, inverse: Array, residual: Array) -> tuple[Array, Array, int]:
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

    Returns
    -------
    covariance : Array (p, p)
        Of the estimates.
    degrees_of_freedom : Array (p,)
        Of its variances.
    window : int
        Samples over which the residual may be correlated.

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
    return *moving_sums(scores, window), window


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
    spread = (sums - mean[stratum]) * for_mean[stratum][:, None]
    variances = np.add.reduceat(spread**2, begins)
    return spread.T @ spread, welch_satterthwaite(variances, members - 1)


MOST_FREEDOM = 1e12  # degrees of freedom


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
