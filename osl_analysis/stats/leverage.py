"""How far the variance of an estimate from autocorrelated residuals falls short where few samples decide on it.

The inertia of a stepped sine comes from its fastest segment, which may last for half a second. The fit follows the
noise there, so that little of it is left in the residuals: of four cycles at 1, 3 and 7 Hz the standard error of I was
too small by a fifth, and the variance had not 28 degrees of freedom but five. What noise of a known memory leaves is
computed here (Bell and McCaffrey, Survey Methodology 28, 2002; Imbens and Kolesar, Review of Economics and Statistics
98, 2016).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.stats.covariance import Covariance, ResidualCorrelation
from osl_analysis.trial import Array

MOST_ROWS = 600
"""Rows of a fit that are kept for this: the work grows with their third power."""


@dataclass(frozen=True)
class KnownMemory(ResidualCorrelation):
    """Covariance from the autocorrelation of residuals, raised by what white noise behind a filter leaves too little.

    It is not lowered: residuals may be other than noise.
    """

    memory: Array | None = None
    """Autocovariance of the noise at 0, 1, 2 ... samples, shape (m,); 0 beyond."""
    position: NDArray[np.intp] | None = None
    """Sample of the recording that each row of the fit is, shape (n,)."""

    def spread(self, X: Array, inverse: Array, residual: Array) -> Covariance:
        """As `ResidualCorrelation.spread`."""
        covariance, degrees_of_freedom = super().spread(X, inverse, residual)
        if self.memory is None or self.position is None:
            return covariance, degrees_of_freedom
        step = max(self.every // 2, -(-len(X) // MOST_ROWS))
        window = self.window(residual) / step
        if window < 2:  # the rows that are kept are further apart than the noise remembers
            return covariance, degrees_of_freedom
        short, known = shortfall(X[::step], self.position[::step], self.memory, window)
        raised = np.sqrt(np.maximum(short, 1.0))
        return covariance * np.outer(raised, raised), np.minimum(degrees_of_freedom, known)


def shortfall(X: Array, position: NDArray[np.intp], memory: Array, window: float) -> Covariance:
    """By which factor (p,) `moving_sums` over a window underestimate the variances of a fit, and their degrees of
    freedom (p,), if the noise has this memory.

    The columns X (n, p) belong to samples at `position` (n,); the window counts rows of X. With scores c of an
    estimate, Bartlett weights W and residuals of covariance R, the expected variance is the sum of W c c' R. As a
    quadratic form it has trace^2/trace of the square degrees of freedom.
    """
    n, p = X.shape
    columns = X / np.linalg.norm(X, axis=0)
    scores = columns @ np.linalg.inv(columns.T @ columns)
    apart = np.abs(np.subtract.outer(position, position))
    noise = np.where(apart < len(memory), memory[np.minimum(apart, len(memory) - 1)], 0.0)
    residual = noise - scores @ (columns.T @ noise)
    residual -= (residual @ columns) @ scores.T
    weights = np.maximum(1 - np.abs(np.subtract.outer(np.arange(n), np.arange(n))) / window, 0.0)
    used = n / max(n - p * window, window)
    factor, degrees_of_freedom = np.empty(p), np.empty(p)
    for k, c in enumerate(scores.T):
        form = (weights * np.outer(c, c)) @ residual
        seen = float(np.trace(form))
        factor[k] = float(c @ noise @ c) / (used * seen)
        degrees_of_freedom[k] = seen**2 / float(np.sum(form * form.T))
    return factor, degrees_of_freedom
