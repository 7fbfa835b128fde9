"""How far the estimates of single periods scatter: a device that changes while it is recorded shows it there.

Lines without excitation hardly see a stiffness that creeps or jumps. The interval from them would then be far too
narrow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import f

from osl_analysis.spectral.period import Spectrum
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

PERIODS = "periods"
"""Source of an interval: the scatter of periods."""
CERTAINLY_MORE = 1 - 1e-6
"""Probability with which the ratio of two variances of one size is below the limit (F distribution)."""


def at_least_of_periods(fit: LinearFit, columns: Mapping[str, Array], errors: Sequence[Spectrum]) -> LinearFit:
    """The fit with the scatter of its periods added to its covariance, if one of its variances is certainly larger.

    `columns` (n,) are those of the fit to the mean periods: real, then imaginary parts of the lines, realisation by
    realisation. `errors` are the equation errors of the single periods, shape (periods, lines) for each realisation,
    weighted as its rows are.
    """
    X = np.column_stack([columns[name] for name in fit.names])
    influence = (X @ np.linalg.inv(X.T @ X)).reshape(len(errors), -1, len(fit.names))
    covariance, freedom = np.zeros((len(fit.names), len(fit.names))), 0
    for own, error in zip(influence, errors, strict=True):
        of_periods = np.concatenate([error.real, error.imag], axis=1) @ own
        covariance += np.cov(of_periods, rowvar=False) / len(error)
        freedom += len(error) - 1
    ratio = np.diag(covariance) / np.maximum(np.diag(fit.covariance), np.finfo(float).tiny)
    if np.all(ratio < f.ppf(CERTAINLY_MORE, freedom, np.minimum(fit.degrees_of_freedom, 1e6))):
        return fit
    return replace(
        fit,
        covariance=fit.covariance + covariance,
        degrees_of_freedom=np.minimum(fit.degrees_of_freedom, freedom),
        interval_method=PERIODS,
    )
