# SPDX-License-Identifier: Apache-2.0
"""Step 7 for a group of crossings: Eq. 15 fitted to the mean response.

The headline subtracts the mean unperturbed gait, as the paper does. Predicted gait stands beside
it: a crossing that is unlike the mean before the onset stays so for a while. The unperturbed
crossings tell how: their deviations in the window are regressed on level and slope of angle and
torque before the onset. Cross-validation over unperturbed crossings decides which of these
predictors count, or none. What contributes to the uncertainty of both stands in `contributions`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import Motion, differentiate
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.trial import Array
from osl_analysis.walking.impedance_fit import fit_without_offset, gait_torque
from osl_analysis.walking.isolated_response import BEHAVIOUR, PerturbationResponse

ESTIMATED = ("K", "B", "I")

Predictors = tuple[str, ...]
"""Some of `BEHAVIOUR`; if empty, the prediction is the mean unperturbed gait."""
PREDICTOR_SETS: tuple[Predictors, ...] = ((), ("angle_slope",), ("angle", "torque"), BEHAVIOUR)


@dataclass(frozen=True)
class EnsembleResponse:
    """Mean over the perturbations, k samples, and Eq. 15 in the window."""

    motion: Motion
    torque: Array  # (k,) [N*m]
    window: slice
    fit: LinearFit

    def estimates_in(self, window: slice) -> Array:
        """K, B and I (3,) in another window."""
        return fit_without_offset(self.motion[window], self.torque[window]).estimates


def equal_weights(n: int) -> Array:
    return np.full(n, 1 / n)


def weights_without_each(n: int) -> Array:
    """Weights (n, n) of n items in their mean, the i-th row without the i-th."""
    return (1 - np.eye(n)) / (n - 1)


@dataclass(frozen=True)
class PredictorChoice:
    """Which predictors predict unperturbed crossings best, by leaving out each of them.

    Predicted is, from the others, the torque that each of them adds to the residual of the mean's
    fit. A set of q predictors needs 3 q + 4 crossings.
    """

    curves: Array  # (c, k) torque that each crossing adds [N*m]
    behaviour: Array  # (4, c)

    @cached_property
    def of_all(self) -> Predictors:
        """The best set where all crossings count alike."""
        return self.best(equal_weights(len(self.curves)))

    def best(self, weights: Array) -> Predictors:
        """The best set where the crossings have these weights (c,), whose sum is 1."""
        is_drawn = weights > 0
        errors = {}
        for predictors in PREDICTOR_SETS:
            is_known = is_drawn.sum() > len(predictors) + 2
            if predictors and not (is_known and len(weights) >= 3 * len(predictors) + 4):
                continue
            chosen = self.behaviour[[BEHAVIOUR.index(name) for name in predictors]]
            centred = chosen - chosen @ weights[:, None]
            X = np.column_stack([np.ones(len(weights)), centred.T])
            sizes = np.sqrt(np.mean(X**2, axis=0))
            root = np.sqrt(weights)[:, None]
            X = root * X / np.where(sizes > 0, sizes, 1.0)
            hat = X @ np.linalg.pinv(X)
            # 0 for a curve that determines a coefficient alone
            free_share = np.maximum(1 - np.diag(hat), 1e-9)
            left_out = (root * self.curves - hat @ (root * self.curves)) / free_share[:, None]
            errors[predictors] = np.sum(left_out[is_drawn] ** 2)
        return min(errors, key=lambda predictors: errors[predictors])


class Ensemble:
    """The n responses of a group against c unperturbed crossings, k samples, stacked.

    Attributes
    ----------
    time, window
        As of each response.
    theta, torque : Array
        (n, c, k) [rad], [N*m].
    behaviour : Array
        (n, 4, c).

    Raises
    ------
    InputError
        There are fewer than two responses, or they cannot be stacked.
    """

    def __init__(self, responses: Sequence[PerturbationResponse]) -> None:
        check_stackable(responses)
        self.responses = responses
        self.time = responses[0].time
        self.window = responses[0].window
        self.theta = np.array([response.thetas for response in responses])
        self.torque = np.array([response.torques for response in responses])
        self.behaviour = np.array([response.behaviour for response in responses])

    @cached_property
    def choice(self) -> PredictorChoice:
        """By the curves and the behaviour of the unperturbed crossings beside the mean's fit."""
        curves = mean_gait_torque(self.responses, self.fitted().fit)
        return PredictorChoice(curves, self.behaviour.mean(axis=0))

    def fitted(
        self,
        predictors: Predictors = (),
        weights: Array | None = None,
        unperturbed: Array | None = None,
    ) -> EnsembleResponse:
        """Fit Eq. 15 to the mean response.

        With `weights` (n,) of the responses, and `unperturbed` (c,) of the unperturbed crossings;
        alike by default. From predictors, unperturbed gait is predicted.
        """
        n, crossings = self.theta.shape[:2]
        of_responses = equal_weights(n) if weights is None else weights
        of_gait = equal_weights(crossings) if unperturbed is None else unperturbed
        if predictors:
            behaviour = np.tensordot(of_responses, self.behaviour, 1)
            of_gait = predicting_weights(behaviour, of_gait, predictors)
        torque = of_gait @ np.tensordot(of_responses, self.torque, 1)
        theta = of_gait @ np.tensordot(of_responses, self.theta, 1)
        motion = differentiate(self.time, theta)
        fit = fit_without_offset(motion[self.window], torque[self.window])
        return EnsembleResponse(motion, torque, self.window, fit)


def check_stackable(responses: Sequence[PerturbationResponse]) -> None:
    """Refuse responses that cannot be joined."""
    if len(responses) < 2:
        raise InputError(
            f"perturbations in the ensemble: {len(responses)}, expected 2 or more; record more"
        )
    first = responses[0]
    for response in responses[1:]:
        is_alike = response.thetas.shape == first.thetas.shape
        if not is_alike or not np.allclose(response.time, first.time):
            raise InputError(
                f"trial {response.name} is sampled otherwise than trial {first.name}; record all"
                " crossings at one marker rate and run the analysis again"
            )


def predicting_weights(behaviour: Array, unperturbed: Array, predictors: Predictors) -> Array:
    """Weights (c,) of the unperturbed crossings in the gait that behaviour predicts.

    The prediction is the weighted regression of the curves at behaviour 0: `behaviour` (4, c) is
    the perturbed crossing's minus the unperturbed one's. With too few crossings it is their mean.
    """
    if np.sum(unperturbed > 0) < len(predictors) + 2:
        return unperturbed
    chosen = behaviour[[BEHAVIOUR.index(name) for name in predictors]]
    sizes = np.sqrt(np.mean(chosen**2, axis=1, keepdims=True))
    scaled = chosen / np.where(sizes > 0, sizes, 1.0)
    X = np.column_stack([np.ones_like(unperturbed), scaled.T])
    root = np.sqrt(unperturbed)
    return root * np.linalg.pinv(root[:, None] * X)[0]


def mean_gait_torque(responses: Sequence[PerturbationResponse], fit: LinearFit) -> Array:
    """Torque (crossings, window) [N*m] of ordinary gait beside a fit, the mean over responses."""
    window = responses[0].window
    return np.mean([gait_torque(response, fit)[:, window] for response in responses], axis=0)
