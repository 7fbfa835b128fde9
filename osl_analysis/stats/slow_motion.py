"""Fit to one slow motion that nothing repeats: its error from the noise, and from a drift that the motion hides."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from osl_analysis.stats.degrees_of_freedom import welch_satterthwaite
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array


def slow_fit(
    y: Array, columns: Mapping[str, Array], richer: Mapping[str, Array], every: int = 1, drift: float = 0.0
) -> LinearFit:
    """`linear_fit` of y (n,) on slow columns (n,), with the errors that chance makes.

    What the columns miss in every trial alike is no chance: noise is what a fit that also has the columns `richer`
    leaves. Least squares on slow columns have the covariance S (X'X)^-1, S the noise's spectral density at frequency
    zero (Grenander and Rosenblatt, Statistical Analysis of Stationary Time Series, 1957): its variance times
    `memory_samples`, of which the record has n/memory.

    A sensor's drift, linear in time with the standard deviation `drift` [unit of y per sample], passes for a slow
    column: no residual shows it. It is counted in as a component of type B (JCGM 100:2008, 4.3), its size taken as
    known.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    fit, samples = linear_fit(y, columns), np.arange(len(y), dtype=float)
    everything = np.column_stack([*columns.values(), *richer.values()])
    estimates, _, rank, _ = np.linalg.lstsq(everything, y, rcond=None)
    noise = y - everything @ estimates
    memory = memory_samples(noise, every)
    freedom = max(len(y) / memory - float(rank), 1.0)
    solution = np.linalg.pinv(np.column_stack(list(columns.values())))
    by_noise, shift = float(noise @ noise) / freedom * solution @ solution.T, drift * solution @ samples
    covariance = by_noise + np.outer(shift, shift)
    variances = [np.diag(by_noise), shift**2]
    return replace(
        fit,
        covariance=covariance,
        degrees_of_freedom=welch_satterthwaite(variances, [freedom, np.inf]),
        correlation_samples=int(np.ceil(memory)),
        interval_method="noise + drift" if drift else "noise",
    )


def memory_samples(noise: Array, every: int) -> float:
    """Samples of a noise (n,) that are worth one independent one: every (1 + rho)/(1 - rho).

    rho is the autocorrelation at `every` samples, from where on the noise is taken for an AR(1).
    """
    power = float(noise @ noise)
    rho = float(noise[every:] @ noise[:-every]) / power if power > 0 else 0.0
    return every * (1 + max(rho, 0.0)) / (1 - max(rho, 0.0))
