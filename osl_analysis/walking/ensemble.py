# SPDX-License-Identifier: Apache-2.0
"""Step 7 for a group of crossings: Eq. 15 fitted to the mean response.

The headline subtracts the mean unperturbed gait, as the paper does. Predicted gait stands beside
it: a crossing that is unlike the mean before the onset stays so for a while. The unperturbed
crossings tell how: their deviations in the window are regressed on level and slope of angle and
torque before the onset. Cross-validation over unperturbed crossings decides which of these
predictors count, or none. What contributes to the uncertainty of both stands in `contributions`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import Motion, differentiate
from osl_analysis.stats.linear_fit import LinearFit
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


@dataclass(frozen=True)
class PredictorChoice:
    """Which predictors predict unperturbed crossings best, by leaving out each of them.

    Predicted is, from the others, the torque that each of them adds to the residual of the mean's
    fit. A set of q predictors needs 3 q + 4 crossings.
    """

    curves: Array  # (c, k) torque that each crossing adds [N*m]
    behaviour: Array  # (4, c)

    def best(self, left_out: int | None = None) -> Predictors:
        """The best set, of all crossings or without one of them."""
        kept = np.arange(len(self.curves)) != left_out
        curves = self.curves[kept]
        errors = {}
        for predictors in PREDICTOR_SETS:
            if predictors and len(self.curves) < 3 * len(predictors) + 4:
                continue
            X = regressors(self.behaviour[:, kept], predictors)
            hat = X @ np.linalg.pinv(X)
            # 0 for a curve that determines a coefficient alone
            free_share = np.maximum(1 - np.diag(hat), 1e-9)
            predicted = (curves - hat @ curves) / free_share[:, None]
            errors[predictors] = np.sum(predicted**2)
        return min(errors, key=lambda predictors: errors[predictors])


def regressors(behaviour: Array, predictors: Predictors) -> Array:
    """Columns (c, q + 1) of the regression on some of the behaviour (4, c): 1, and each at unit
    size."""
    chosen = behaviour[[BEHAVIOUR.index(name) for name in predictors]]
    sizes = np.sqrt(np.mean(chosen**2, axis=1, keepdims=True))
    scaled = chosen / np.where(sizes > 0, sizes, 1.0)
    return np.column_stack([np.ones(chosen.shape[1]), scaled.T])


@dataclass(frozen=True)
class Ensemble:
    """The n responses of a group against c unperturbed crossings, k samples, stacked."""

    time: Array  # (k,) [s] from the onset
    window: slice
    theta: Array  # (n, c, k) [rad]
    torque: Array  # (n, c, k) [N*m]
    behaviour: Array  # (n, 4, c)

    def fitted(self, predictors: Predictors = ()) -> EnsembleResponse:
        """Fit Eq. 15 to the mean response. From predictors, unperturbed gait is predicted: by the
        regression of the curves at the behaviour of the perturbed crossings."""
        X = regressors(self.behaviour.mean(axis=0), predictors)
        weights = np.linalg.pinv(X)[0]
        torque = weights @ self.torque.mean(axis=0)
        motion = differentiate(self.time, weights @ self.theta.mean(axis=0))
        fit = fit_without_offset(motion[self.window], torque[self.window])
        return EnsembleResponse(motion, torque, self.window, fit)

    def without(self, i: int, axis: int) -> "Ensemble":
        """Without the i-th perturbed crossing (axis 0), or the i-th unperturbed one (axis 1)."""
        return replace(
            self,
            theta=np.delete(self.theta, i, axis),
            torque=np.delete(self.torque, i, axis),
            behaviour=np.delete(self.behaviour, i, 2 * axis),
        )


def stacked(responses: Sequence[PerturbationResponse]) -> Ensemble:
    """Stack responses. Raises InputError: their samples differ."""
    first = responses[0]
    for response in responses:
        is_alike = response.thetas.shape == first.thetas.shape
        if not is_alike or not np.allclose(response.time, first.time):
            raise InputError(
                f"trial {response.name} is sampled otherwise than trial {first.name}",
                "record all crossings at one marker rate and run the analysis again",
            )
    return Ensemble(
        first.time,
        first.window,
        theta=np.array([response.thetas for response in responses]),
        torque=np.array([response.torques for response in responses]),
        behaviour=np.array([response.behaviour for response in responses]),
    )


def mean_gait_torque(responses: Sequence[PerturbationResponse], fit: LinearFit) -> Array:
    """Torque (crossings, window) [N*m] of ordinary gait beside a fit, the mean over responses."""
    window = responses[0].window
    return np.mean([gait_torque(response, fit)[:, window] for response in responses], axis=0)
