"""Fit to one slow motion without repeats. Its standard errors come from the noise and from a sensor's drift."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from osl_analysis.measured import check_measured
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array


def fit_slow_motion(
    y: Array, columns: Mapping[str, Array], richer: Mapping[str, Array], every: int = 1, drift: float = 0.0
) -> LinearFit:
    """`linear_fit` of y (n,) on slow columns (n,) each, with standard errors for noise and drift.

    What the columns fail to describe is the same in every trial and is not random. The noise is therefore taken from a
    second fit that also has the columns `richer`. Least squares on slow columns have the covariance S (X'X)^-1, where
    S is the spectral density of the noise at frequency zero (Grenander and Rosenblatt, Statistical Analysis of
    Stationary Time Series, 1957): the variance of the noise times `memory_samples`. Noise is independent after `every`
    samples (`LowPass.independent_samples`).

    A sensor's drift is linear in time with the standard deviation `drift` [unit of y per sample]. It looks like a slow
    column, and no residual shows it. It is added as a component of type B (JCGM 100:2008, 4.3) of known size.

    Raises InputError, IdentifiabilityError: As `linear_fit`.
    """
    fit, samples = linear_fit(y, columns), np.arange(len(y), dtype=float)
    everything = np.column_stack([*columns.values(), *richer.values()])
    estimates, _, rank, _ = np.linalg.lstsq(everything, y, rcond=None)
    noise = y - everything @ estimates
    memory = memory_samples(noise, every)
    degrees_of_freedom = max(len(y) / memory - float(rank), 1.0)
    solution = np.linalg.pinv(np.column_stack(list(columns.values())))
    by_noise, shift = float(noise @ noise) / degrees_of_freedom * solution @ solution.T, drift * solution @ samples
    return replace(
        fit,
        covariance=by_noise + np.outer(shift, shift),
        degrees_of_freedom=welch_satterthwaite([np.diag(by_noise), shift**2], [degrees_of_freedom, np.inf]),
        correlation_samples=int(np.ceil(memory)),
        interval_method="noise + drift" if drift else "noise",
    )


def memory_samples(noise: Array, every: int) -> float:
    """Number of samples of a noise (n,) that count as one independent sample: every (1 + rho)/(1 - rho). rho is the
    autocorrelation after `every` samples, 0 for a noise of zeros. The noise is modelled as an AR(1) at this step."""
    check_measured("the noise", noise)
    power = float(noise @ noise)
    rho = float(noise[every:] @ noise[:-every]) / power if power > 0 else 0.0
    return every * (1 + max(rho, 0.0)) / (1 - max(rho, 0.0))
