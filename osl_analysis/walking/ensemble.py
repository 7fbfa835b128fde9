# SPDX-License-Identifier: Apache-2.0
"""Step 7 for a group of crossings: the mean response, and which gait is subtracted from it.

The headline subtracts the mean unperturbed gait, as the paper does. Predicted gait stands beside
it: a crossing that is unlike the mean before the onset stays so for a while. The unperturbed
crossings tell how: their deviations in the window are regressed on level and slope of angle and
torque before the onset. Cross-validation over unperturbed crossings decides which of these
predictors count, or none. What contributes to the uncertainty of both stands in `tables`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.walking.impedance_fit import gait_torque
from osl_analysis.walking.isolated_response import (
    BEHAVIOUR,
    PerturbationResponse,
    Predictors,
    regressors,
)

ESTIMATED = ("K", "B", "I")
ENSEMBLE = "ensemble"

PREDICTOR_SETS: tuple[Predictors, ...] = ((), ("angle_slope",), ("angle", "torque"), BEHAVIOUR)


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
    """The sets that so many unperturbed crossings can tell: one of q predictors needs 3 q + 4."""
    return [chosen for chosen in PREDICTOR_SETS if not chosen or crossings >= 3 * len(chosen) + 4]


def best_predictors(
    mean: PerturbationResponse, fit: LinearFit, choices: Sequence[Predictors]
) -> Predictors:
    """Find the predictors that predict unperturbed crossings best, by leaving out each of them.

    Predicted is, from the others, the torque that each of them adds to the residual of a fit.
    """
    curves = gait_torque(mean, fit)[:, mean.window]
    errors = {}
    for predictors in choices:
        X = regressors(mean.behaviour, predictors)
        hat = X @ np.linalg.pinv(X)
        # 0 for a curve that determines a coefficient alone
        free_share = np.maximum(1 - np.diag(hat), 1e-9)
        predicted = (curves - hat @ curves) / free_share[:, None]
        errors[predictors] = np.sum(predicted**2)
    return min(errors, key=lambda predictors: errors[predictors])
