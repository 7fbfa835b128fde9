"""Covariance of estimates from their scores: what each sample, or each cycle, contributes to the estimates' error."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.stats.degrees_of_freedom import welch_satterthwaite
from osl_analysis.trial import Array

Covariance = tuple[Array, Array]
"""Covariance (p, p) of the estimates, and the degrees of freedom (p,) of its diagonal."""

FEWEST_CYCLES = 5
"""Repetitions at each frequency from which their spread is worth an interval."""
FILTER_SPAN = 8
"""Half periods of the filter's cut-off in the shortest window: a Bartlett window of as many loses 1 % of the noise."""


@dataclass(frozen=True)
class Cycles:
    """Which rows repeat one another: `first` (m,) is the first row of each cycle, `stratum` (m,) what it repeats.

    The rows of a cycle follow one another, and the first cycle begins at row 0. Cycles of one stratum (one frequency
    at one amplitude) are repetitions: what they have in common is no chance error, only what differs is.
    """

    first: NDArray[np.intp]
    stratum: NDArray[np.intp]


def correlation_samples(residual: Array, every: int = 1) -> int:
    """Andrews' plug-in bandwidth for the Bartlett kernel from an AR(1) fit, at most an eighth of the samples.

    Sample by sample, noise behind a low-pass is no AR(1): taken for one, its 30 ms become 2.5 s. So the AR(1) is
    fitted to each `every`-th sample, half a period of the cut-off apart, where such noise is nearly white.
    """
    if every > 1:
        return min(every * max(correlation_samples(residual[::every]), FILTER_SPAN), max(len(residual) // 8, 1))
    n = len(residual)
    power = float(residual[:-1] @ residual[:-1])
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(max(rho, 0.0), 0.9999)
    alpha = 4 * rho**2 / (1 - rho**2) ** 2
    return int(np.clip(np.ceil(1.1447 * (alpha * n) ** (1 / 3)), 1, max(n // 8, 1)))


def moving_sums(scores: Array, window: int, slow: bool = False) -> Covariance:
    """Newey and West's: the long-run covariance of the scores (n, p), Bartlett weights up to `window` - 1 lags.

    The sum over all lags weighted 1 - lag/window equals the sum of squares of moving sums over `window`
    samples, zero beyond the ends, divided by `window`: positive semi-definite by construction. It is worth 1.5
    n/window degrees of freedom (Priestley, Spectral Analysis and Time Series, 1981, table 6.2, at frequency zero).
    The fit has taken p of the n samples, or of the n/window sums where its columns are `slow` beside the window (Kiefer
    and Vogelsang, Econometric Theory 21, 2005, to first order in window/n).
    """
    n, p = scores.shape
    left = max(n - p * window, window) if slow else n - p
    padded = np.vstack([np.zeros((window, p)), scores, np.zeros((window - 1, p))])
    cumulative = np.cumsum(padded, axis=0)
    sums = cumulative[window:] - cumulative[:-window]
    return sums.T @ sums / window * n / left, np.full(p, max(1.5 * n / window - p, 1.0))


def between_cycles(scores: Array, cycles: Cycles) -> Covariance:
    """The spread of the cycles' sums of scores (n, p) about the mean of their stratum.

    It is what a bootstrap that draws cycles anew within each stratum converges to, times m/(m - 1) for the stratum's
    mean that was estimated.
    """
    sums = np.add.reduceat(scores, cycles.first, axis=0)
    members = np.bincount(cycles.stratum).astype(float)
    mean = np.stack([np.bincount(cycles.stratum, column) for column in sums.T], axis=1) / members[:, None]
    spread = (sums - mean[cycles.stratum]) * np.sqrt(members / (members - 1))[cycles.stratum, None]
    shares = np.stack([np.bincount(cycles.stratum, column**2) for column in spread.T], axis=1)
    return spread.T @ spread, welch_satterthwaite(list(shares), members - 1)
