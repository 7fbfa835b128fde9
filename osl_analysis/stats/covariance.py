"""Covariance of estimates from their scores. A score is the part of the estimates' error that one sample causes.

It comes from the spread between cycles that an experiment repeats, whose edges may lie between two samples, or from the
autocorrelation of the residuals, with what that falls short where few samples decide on an estimate.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.trial import LARGEST_VARIANCE, Array, check_finite, check_measured


def products_between(X: Array, Y: Array, first: Array, stop: Array) -> Array:
    """X'Y (m, p, q) of columns X (n, p) and Y (n, q) from each `first` (m,) to each `stop` (m,), which need not be
    whole numbers. A fraction of a row is read from the cubic through the four cumulative sums around it, so that a
    cycle of a fractional period has the sum that every other cycle has. Beyond the ends there is nothing to sum."""
    edges = np.stack([first, stop], axis=1).ravel()
    row = np.clip(np.floor(edges + 1e-9).astype(np.intp), 0, len(Y))
    whole = np.array([X[a:b].T @ Y[a:b] for a, b in row.reshape(-1, 2)])
    share = np.maximum(edges - row, 0.0)
    at = row + np.array([[-1], [0], [1]])
    inside = np.clip(at, 0, len(Y) - 1)
    x = np.where(share < 1e-9, 0.0, share)
    weights = np.array([x * (x - 1) * (x - 2), x * (x + 1) * (5 - 2 * x), x * (x + 1) * (x - 1)]) / 6 * (at == inside)
    parts = (weights[:, :, None] * X[inside]).transpose(1, 2, 0) @ Y[inside].transpose(1, 0, 2)
    return np.asarray(whole + parts[1::2] - parts[::2])


FEWEST_CYCLES = 5  # smallest number of cycles at one frequency whose spread gives an interval
Covariance = tuple[Array, Array, str, int]
"""Covariance (p, p) of estimates, its degrees of freedom (p,), where it comes from, as the tables name it, and the
number of samples over which the residual may be correlated."""


def hac(X: Array, inverse: Array, residual: Array) -> Covariance:
    """The covariance by the autocorrelation of the residual (n,). X (n, p) times `inverse` (p, p) is by how much each
    estimate changes with each sample of y.

    The window is Andrews' plug-in bandwidth for the Bartlett kernel from an AR(1) fit, at most an eighth of the
    samples. Low-pass filtered noise is not an AR(1) at the sampling rate: 30 ms of it are taken for 2.5 s. Raises
    InputError: A value is not finite or cannot be measured."""
    check_measured("the residual", residual)
    n, power = len(residual), float(residual[:-1] @ residual[:-1])
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(max(rho, 0.0), 0.9999)
    alpha = 4 * rho**2 / (1 - rho**2) ** 2
    window = int(np.clip(np.ceil(1.1447 * (alpha * n) ** (1 / 3)), 1, max(n // 8, 1)))
    return *moving_sums(X @ inverse * residual[:, None], window), "HAC", window


def moving_sums(scores: Array, window: int) -> tuple[Array, Array]:
    """Long-run covariance (p, p) of the scores (n, p), and the degrees of freedom (p,) of its variances, after Newey
    and West: Bartlett weights 1 - lag/window. The sum over all lags equals the sum of squares of moving sums over
    `window` samples (zeros beyond the ends) divided by `window`, and is therefore positive semi-definite. It has 1.5
    n/window degrees of freedom (Priestley, Spectral Analysis and Time Series, 1981, table 6.2, at frequency zero). The
    fit uses up p of the n samples."""
    n, p = scores.shape
    cumulative = np.concatenate([np.zeros((window, p)), np.cumsum(scores, axis=0)])
    cumulative = np.concatenate([cumulative, np.repeat(cumulative[-1:], window - 1, axis=0)])
    sums = cumulative[window:] - cumulative[:-window]
    return sums.T @ sums / window * n / (n - p), np.full(p, max(1.5 * n / window - p, 1.0))


def between_cycles(sums: Array, stratum: NDArray[np.intp]) -> tuple[Array, Array]:
    """Covariance (p, p), with the degrees of freedom (p,) of its variances, from the spread of the cycles' sums of
    scores (m, p) about the mean of their `stratum` (m,), rising. A bootstrap that draws cycles within each stratum
    converges to it, apart from the factor m/(m - 1) for the mean that was estimated from the m cycles of the stratum,
    two or more."""
    members = np.bincount(stratum).astype(float)
    begins = np.flatnonzero(np.diff(stratum, prepend=-1))
    mean = np.add.reduceat(sums, begins) / members[:, None]
    spread = (sums - mean[stratum]) * np.sqrt(members / (members - 1))[stratum, None]
    return spread.T @ spread, welch_satterthwaite(np.add.reduceat(spread**2, begins), members - 1)


def less(covariance: Array, variances: Array) -> Array:
    """A covariance (p, p) without some of its variances (p,), its correlations kept."""
    share = np.maximum(variances, 0.0) / np.maximum(np.diag(covariance), np.finfo(float).tiny)
    left = np.sqrt(np.maximum(1 - share, 0.0))
    return np.asarray(covariance * np.outer(left, left))


def welch_satterthwaite(variances: Sequence[ArrayLike] | Array, degrees_of_freedom: ArrayLike) -> Array:
    """Degrees of freedom of the sum of k independent variances (k, ...), each with its `degrees_of_freedom`, (k,) or
    as many as variances (Satterthwaite, Biometrics Bulletin 2, 1946; Welch, Biometrika 34, 1947). Infinite where all
    variances are zero, or the uncertain ones vanish beside the others: the rounding of a sum would decide on more than
    1e12. Raises InputError: A variance is not finite or beyond `LARGEST_VARIANCE`."""
    summands = np.asarray(variances, dtype=float)
    check_finite("the variance", summands, LARGEST_VARIANCE)
    certainty = 1 / np.asarray(degrees_of_freedom, dtype=float)
    if certainty.ndim < summands.ndim:
        certainty = certainty.reshape(-1, *[1] * (summands.ndim - 1))
    uncertainty = np.sum(certainty * summands**2, axis=0)
    total = np.sum(summands, axis=0) ** 2
    counts = uncertainty > total / 1e12
    return np.asarray(np.divide(total, uncertainty, out=np.full_like(total, np.inf), where=counts))
