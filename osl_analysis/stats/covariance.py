"""Covariance of estimates from their scores. A score is the part of the estimates' error that one sample causes.

It comes from the spread between cycles that an experiment repeats, whose edges may lie between two samples, or from the
autocorrelation of the residuals, with what that falls short where few samples decide on an estimate.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import LARGEST_VARIANCE, check_finite, check_measured
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Cycles:
    """Division of the rows of a fit into cycles that the experiment repeats. The rows of a cycle follow one another;
    its edges may lie between two rows. The cycles of one stratum (one frequency at one amplitude) are repetitions: only
    the differences between them count as random error."""

    first: Array  # where each cycle begins, in rows of the fit, shape (m,)
    stop: Array  # where it ends, shape (m,)
    stratum: NDArray[np.intp]  # number of the stratum that each cycle belongs to, from 0 on and rising, shape (m,)

    def sums(self, X: Array, y: Array) -> Array:
        """Sums (m, p) of X times y in each cycle, for columns X (n, p) and y (n,) in the rows of the fit."""
        return self.products(X, y[:, None])[..., 0]

    def products(self, X: Array, Y: Array) -> Array:
        """X'Y (m, p, q) in each cycle, for columns X (n, p) and Y (n, q) in the rows of the fit.

        Where a cycle does not begin at the end of the one before, the rows on both sides are of different stretches of
        the recording: a fraction of a row is read there from rows of its own stretch.
        """
        apart = self.first[1:] != self.stop[:-1]
        begins, ends = np.append(True, apart), np.append(apart, True)
        inwards = np.stack([begins.astype(np.intp), -ends.astype(np.intp)], axis=1).ravel()
        return products_between(X, Y, self.first, self.stop, inwards)


def sums_between(values: Array, first: Array, stop: Array) -> Array:
    """Sums (m, p) of the rows of `values` (n, p) from `first` (m,) to `stop` (m,), which need not be whole numbers. The
    rows follow one another in one recording."""
    rows = np.ones((len(values), 1))
    return products_between(values, rows, first, stop, np.zeros(2 * len(first), dtype=np.intp))[..., 0]


def products_between(X: Array, Y: Array, first: Array, stop: Array, inwards: NDArray[np.intp]) -> Array:
    """X'Y (m, p, q) from each `first` (m,) to each `stop` (m,), which need not be whole numbers.

    A fraction of a row is read from the cubic through the four cumulative sums around it. A cycle whose period is not
    a whole number of rows then has the sum that every other cycle has. `inwards` (2 m,), 1 or -1, are the rows by which
    these four are moved to one side, for the begin and the end of each cycle in turn.
    """
    edges = np.stack([first, stop], axis=1).ravel()
    row = np.clip(np.floor(edges + 1e-9).astype(np.intp), 0, len(Y))
    whole = np.array([X[a:b].T @ Y[a:b] for a, b in row.reshape(-1, 2)])
    parts = fractions_of_rows(X, Y, row, np.maximum(edges - row, 0.0), inwards)
    return np.asarray(whole + parts[1::2] - parts[::2])


def fractions_of_rows(X: Array, Y: Array, row: NDArray[np.intp], share: Array, moved: NDArray[np.intp]) -> Array:
    """X'Y (m, p, q) in a `share` (m,) of each `row` (m,), by the cubic through the cumulative sums one row before it to
    two rows behind, or `moved` (m,) by some rows; beyond the ends there is nothing to sum."""
    at = row + moved + np.array([[-1], [0], [1]])
    inside = np.clip(at, 0, len(Y) - 1)
    weights = cubic_weights(np.where(share < 1e-9, 0.0, share) - moved) - cubic_weights(-moved)
    return np.asarray(np.einsum("km,kmp,kmq->mpq", weights * (at == inside), X[inside], Y[inside]))


def cubic_weights(x: Array | NDArray[np.intp]) -> Array:
    """Weights (3, m) of the rows before, at and behind a row in the sum from its begin over x (m,) rows. That sum is a
    cubic through the cumulative sums at -1, 0, 1 and 2 rows."""
    return np.array([x * (x - 1) * (x - 2), x * (x + 1) * (5 - 2 * x), x * (x + 1) * (x - 1)]) / 6


Covariance = tuple[Array, Array]
"""Covariance (p, p) of the estimates, and the degrees of freedom (p,) of the variances on its diagonal."""
CYCLES = "cycles"  # name of the spread between cycles in the tables
FEWEST_CYCLES = 5  # smallest number of cycles at one frequency whose spread gives an interval
CERTAIN = 1e12  # degrees of freedom from which a variance is certain: the rounding of a sum would decide on more
FILTER_SPAN = 8
"""Shortest window, in half periods of the filter's cut-off. Over this window the Bartlett weights lose 1 % of the
noise's variance."""


@dataclass(frozen=True)
class ResidualCorrelation:
    """How the residuals of a fit are correlated. This decides how the covariance of the estimates is computed."""

    cycles: Cycles | None = None
    """Cycles that the experiment repeats. The covariance then comes from the spread between them. With None it comes
    from the autocorrelation of the residuals."""
    every: int = 1
    """Number of samples after which the low-pass filter leaves noise independent (`LowPass.independent_samples`)."""
    lags: int | None = None
    """Number of samples over which residuals may be correlated. None: the bandwidth that `correlation_samples` finds
    with `every`."""
    filtered_off: Array | None = None
    """What a filter took away from y (n,). Noise that is independent from sample to sample is so only before the
    filter, which smears it over the edge between two cycles: behind it neighbouring cycles are correlated by 0.05
    where a column is not zero at the edge, as the velocity is not, and the spread of cycles is too small by 5 %."""

    @property
    def method(self) -> str:
        """Source of the covariance, as the tables name it: `cycles`, or `HAC` (from the autocorrelation)."""
        return "HAC" if self.cycles is None else CYCLES

    def window(self, residual: Array) -> int:
        """Number of samples over which a residual (n,) may be correlated."""
        return self.lags or correlation_samples(residual, self.every)

    def covariance(self, X: Array, inverse: Array, residual: Array) -> tuple[Array, Array, str]:
        """Covariance of the estimates, its degrees of freedom, and where it comes from. X (n, p) times `inverse` (p, p)
        is by how much each estimate changes with each sample of y; `residual` (n,) is what is left."""
        if self.cycles is None:
            scores = X @ inverse * residual[:, None]
            return *moving_sums(scores, self.window(residual), slow=self.every > 1), self.method
        noise = residual if self.filtered_off is None else residual + self.filtered_off
        return *between_cycles(self.cycles.sums(X, noise) @ inverse, self.cycles.stratum), self.method


NO_REPEATS = ResidualCorrelation()
"""No repeated cycles and no known filter: the bandwidth is computed from the residuals at every sample."""


def correlation_samples(residual: Array, every: int = 1) -> int:
    """Andrews' plug-in bandwidth for the Bartlett kernel from an AR(1) fit, at most an eighth of the samples.

    Low-pass filtered noise is not an AR(1) at the sampling rate. An AR(1) fitted at that rate turns a correlation time
    of 30 ms into 2.5 s. The AR(1) is therefore fitted to every `every`-th sample. These samples are half a period of
    the cut-off apart; at this distance such noise is nearly white.

    Raises InputError: A value is not finite or cannot be measured.
    """
    check_measured("the residual", residual)
    if every > 1:
        return min(every * max(correlation_samples(residual[::every]), FILTER_SPAN), max(len(residual) // 8, 1))
    n = len(residual)
    power = float(residual[:-1] @ residual[:-1])
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(max(rho, 0.0), 0.9999)
    alpha = 4 * rho**2 / (1 - rho**2) ** 2
    return int(np.clip(np.ceil(1.1447 * (alpha * n) ** (1 / 3)), 1, max(n // 8, 1)))


def moving_sums(scores: Array, window: int, slow: bool = False) -> Covariance:
    """Long-run covariance of the scores (n, p) after Newey and West: Bartlett weights up to `window` - 1 lags.

    The sum over all lags with the weights 1 - lag/window equals the sum of squares of moving sums over `window` samples
    (zeros beyond the ends) divided by `window`. It is therefore positive semi-definite. It has 1.5 n/window degrees of
    freedom (Priestley, Spectral Analysis and Time Series, 1981, table 6.2, at frequency zero). The fit uses up p of the
    n samples. If its columns are `slow` compared with the window, it uses up p of the n/window sums (Kiefer and
    Vogelsang, Econometric Theory 21, 2005, to first order in window/n).
    """
    n, p = scores.shape
    left = max(n - p * window, window) if slow else n - p
    cumulative = np.concatenate([np.zeros((window, p)), np.cumsum(scores, axis=0)])
    cumulative = np.concatenate([cumulative, np.repeat(cumulative[-1:], window - 1, axis=0)])
    sums = cumulative[window:] - cumulative[:-window]
    return sums.T @ sums / window * n / left, np.full(p, max(1.5 * n / window - p, 1.0))


def between_cycles(sums: Array, stratum: NDArray[np.intp]) -> Covariance:
    """Covariance from the spread of the cycles' sums of scores (m, p) about the mean of their `stratum` (m,), rising. A
    bootstrap that draws cycles within each stratum converges to this covariance, apart from the factor m/(m - 1) for
    the mean that was estimated from the m cycles of the stratum."""
    members = np.bincount(stratum).astype(float)
    check_repeated(members)
    begins = np.flatnonzero(np.diff(stratum, prepend=-1))
    mean = np.add.reduceat(sums, begins) / members[:, None]
    spread = (sums - mean[stratum]) * np.sqrt(members / (members - 1))[stratum, None]
    return spread.T @ spread, welch_satterthwaite(np.add.reduceat(spread**2, begins), members - 1)


def check_repeated(members: Array) -> None:
    """Refuse strata with fewer than two cycles; `members` (strata,) are their numbers of cycles."""
    if not len(members) or np.min(members) < 2:
        raise InputError("one cycle has no spread to take an interval from; record two or more at each frequency")


def nearest_covariance(matrix: Array) -> Array:
    """The symmetric matrix (p, p) without its negative eigenvalues, which a difference of covariances may have.

    Raises InputError: A value is not finite or beyond `LARGEST_VARIANCE`.
    """
    check_finite("the covariance", matrix, LARGEST_VARIANCE)
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


def welch_satterthwaite(variances: Sequence[ArrayLike] | Array, degrees_of_freedom: ArrayLike) -> Array:
    """Degrees of freedom of the sum of k independent variances (k, ...), each with its `degrees_of_freedom`, (k,) or
    as many as variances.

    Satterthwaite, Biometrics Bulletin 2, 1946; Welch, Biometrika 34, 1947. Infinite where all variances are zero,
    or the uncertain ones vanish beside the others: where there would be more than `CERTAIN`.

    Raises InputError: A variance is not finite or beyond `LARGEST_VARIANCE`.
    """
    summands = np.asarray(variances, dtype=float)
    check_finite("the variance", summands, LARGEST_VARIANCE)
    certainty = 1 / np.asarray(degrees_of_freedom, dtype=float)
    if certainty.ndim < summands.ndim:
        certainty = certainty.reshape(-1, *[1] * (summands.ndim - 1))
    uncertainty = np.sum(certainty * summands**2, axis=0)
    total = np.sum(summands, axis=0) ** 2
    counts = uncertainty > total / CERTAIN
    return np.asarray(np.divide(total, uncertainty, out=np.full_like(total, np.inf), where=counts))
