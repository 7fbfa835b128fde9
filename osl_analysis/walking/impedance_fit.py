# SPDX-License-Identifier: Apache-2.0
"""Step 7, K, B, I: Eq. 15 fitted to an isolated response in the window, or to the mean of several.

    torque = K theta + B omega + I alpha

Single responses have no interval: their residual has a few correlated samples and shows neither of
the two errors that matter. A perturbed crossing deviates from the mean gait as an unperturbed one
does, and the plate's model depends on its trials. `tables` has both in the budget of the mean
response.

The headline subtracts the mean unperturbed gait, as the paper does. A second fit subtracts
predicted gait, since a crossing that differs from the mean before the onset differs for a while.
Deviations of unperturbed crossings in the window are regressed on level and slope of angle and
torque before the onset. Cross-validation over unperturbed crossings chooses the predictors, or
none.

Example: `fit_response(mean_response(responses))["K"]`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import Motion, differentiate
from osl_analysis.stats.linear_fit import LinearFit, linear_fit
from osl_analysis.walking.isolated_response import (
    BEHAVIOUR,
    PerturbationResponse,
    Predictors,
    regressors,
)

ENSEMBLE = "ensemble"
# smallest free share; that of a curve that determines a coefficient alone is 0
FREE_SHARE_ROUNDING = 1e-9

PREDICTOR_SETS: tuple[Predictors, ...] = ((), ("angle_slope",), ("angle", "torque"), BEHAVIOUR)


def fit_without_offset(motion: Motion, torque: Array) -> LinearFit:
    """Fit Eq. 15 where the zeros of angle and torque are known.

    Angle and torque must have passed the same filter: if only the angle is filtered at 15 Hz, B is
    3.43 instead of 3.

    Parameters
    ----------
    motion : Motion
        Angle with its derivatives, (n,) each.
    torque : Array
        (n,) [N*m].

    Returns
    -------
    LinearFit
        K [N*m/rad], B [N*m*s/rad], I [kg*m^2].

    Notes
    -----
    An offset would absorb torque that is not of second order: K = 321 N*m/rad instead of 334 on the
    exact response of the simulated drivetrain.
    """
    columns = {"K": motion.theta, "B": motion.omega, "I": motion.alpha}
    return linear_fit(torque, columns)


def fit_response(response: PerturbationResponse) -> LinearFit:
    """Fit Eq. 15 to a response in its window."""
    with naming(f"trial {response.name}"):
        return fit_without_offset(response.fitted_motion, response.fitted_torque)


def gait_torque(response: PerturbationResponse, fit: LinearFit) -> Array:
    """Torque (crossings, k) [N*m] that each unperturbed crossing's deviation from their mean adds.

    It is the deviation of its torque, less what Eq. 15 explains by the deviation of its angle.
    """
    deviation = differentiate(response.time, (response.motion.theta - response.thetas).T)
    K, B, I = fit.estimates
    explained = K * deviation.theta + B * deviation.omega + I * deviation.alpha
    return response.torque - response.torques - explained.T


def jackknife_ses(without_each: Sequence[Array] | Array) -> Array:
    """Tukey's standard errors (p,) from estimates (m, p), or their changes, without each of m
    items."""
    m = len(without_each)
    return (m - 1) / np.sqrt(m) * np.std(without_each, axis=0, ddof=1)


def mean_response(responses: Sequence[PerturbationResponse]) -> PerturbationResponse:
    """The mean over perturbations. Raises InputError: their samples differ."""
    first = responses[0]
    for response in responses:
        is_alike = response.thetas.shape == first.thetas.shape
        if not is_alike or not np.allclose(response.time, first.time):
            raise InputError(
                f"trial {response.name} is sampled otherwise than trial {first.name}",
                "record all crossings at one marker rate and run the analysis again",
            )
    averaged = ("thetas", "torques", "changes", "behaviour", "pace_change")
    means = {
        name: np.mean([getattr(response, name) for response in responses], axis=0)
        for name in averaged
    }
    return replace(first, name=ENSEMBLE, **means)


def predictor_sets(crossings: int) -> list[Predictors]:
    """The sets that so many unperturbed crossings can determine: q predictors need 3 q + 4."""
    return [chosen for chosen in PREDICTOR_SETS if not chosen or crossings >= 3 * len(chosen) + 4]


def best_predictors(
    mean: PerturbationResponse, fit: LinearFit, choices: Sequence[Predictors]
) -> Predictors:
    """Find the predictors that predict unperturbed crossings best, by leaving out each of them.

    The torque that a crossing adds to the residual of a fit is predicted from the other crossings.
    """
    curves = gait_torque(mean, fit)[:, mean.window]
    errors = {}
    for predictors in choices:
        X = regressors(mean.behaviour, predictors)
        hat = X @ np.linalg.pinv(X)
        free_share = np.maximum(1 - np.diag(hat), FREE_SHARE_ROUNDING)
        predicted = (curves - hat @ curves) / free_share[:, None]
        errors[predictors] = np.sum(predicted**2)
    return min(errors, key=errors.__getitem__)
