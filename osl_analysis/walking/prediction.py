"""What a perturbed crossing would have done: predicted from its own behaviour before the onset.

The draft subtracts the mean unperturbed gait. A crossing that is unlike the mean before the onset stays so for a while.
The unperturbed crossings tell how: their deviations in the window are regressed on their level and slope of angle and
torque before the onset. Which of these count, or none, is decided by cross-validation over the unperturbed crossings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.second_order import ImpedanceFit
from osl_analysis.trial import Array
from osl_analysis.walking.response import BEHAVIOUR, PerturbationResponse
from osl_analysis.walking.response_fit import gait_torque

Predictors = tuple[str, ...]
CANDIDATES: tuple[Predictors, ...] = ((), ("angle_slope",), ("angle", "torque"), BEHAVIOUR)
"""Sets of predictors among which cross-validation chooses; with none the prediction is the mean."""
CROSSINGS_PER_PREDICTOR, CROSSINGS_BESIDE = 3, 4
"""A set of q predictors needs 3 q + 4 unperturbed crossings: fewer leave the bootstrap's regressions undetermined."""


@dataclass(frozen=True)
class Prediction:
    """What was chosen.

    predictors: names in `BEHAVIOUR`; none: the mean is at least as good.
    share: share of the unperturbed crossings' deviations in the window, as a mean square of the torque that they add to
        the residual of Eq. 15, that is predicted for crossings without which the regression was computed.
    """

    predictors: Predictors = ()
    share: float = 0.0


@dataclass(frozen=True)
class Stacked:
    """The n responses of an ensemble to c unperturbed crossings, k samples.

    theta, torque: (n, c, k).
    behaviour: (n, 4, c), as in `PerturbationResponse`.
    signs: direction of each response (n,).
    """

    theta: Array
    torque: Array
    behaviour: Array
    signs: NDArray[np.int_]

    @classmethod
    def of(cls, responses: Sequence[PerturbationResponse], signs: NDArray[np.int_]) -> "Stacked":
        """The responses, with `signs` (n,)."""
        theta, torque, behaviour = (
            np.array([getattr(r, name) for r in responses]) for name in ("thetas", "torques", "behaviour")
        )
        return cls(theta, torque, behaviour, signs)

    def joined(self, weights: Array, unperturbed: Array, predictors: Predictors = ()) -> tuple[Array, Array]:
        """Angle and torque (k,) each, of the responses joined with `weights` (n,), whose baseline is the mean of the
        unperturbed crossings with weights (c,), or what the predictors tell for each direction."""
        if not predictors:
            return unperturbed @ np.tensordot(weights, self.theta, 1), unperturbed @ np.tensordot(
                weights, self.torque, 1
            )
        chosen, parts = [BEHAVIOUR.index(name) for name in predictors], []
        for sign in np.unique(self.signs[weights != 0]):
            own = np.where(self.signs == sign, weights, 0.0)
            behaviour = np.tensordot(own, self.behaviour, 1)[chosen]
            baseline = predicting_weights(behaviour, unperturbed)
            parts.append((baseline @ np.tensordot(own, self.theta, 1), baseline @ np.tensordot(own, self.torque, 1)))
        theta, torque = np.sum(parts, axis=0)
        return theta, torque


def predicting_weights(behaviour: Array, weights: Array) -> Array:
    """Weights (c,) of c unperturbed crossings in what a perturbed one would have done.

    behaviour: what the perturbed one did before the onset minus what each unperturbed one did, (q, c).
    weights: of the unperturbed crossings (c,) in the regression, not negative.

    The weighted regression of the crossings' curves on `behaviour`, with an intercept, at a difference of 0: the
    weights nearest to `weights` whose sum is 1 and whose mean difference is 0. `weights` where too few are not 0.
    """
    used = weights > 0
    if not len(behaviour) or used.sum() < len(behaviour) + 2:
        return weights
    root = np.sqrt(weights)
    sizes = np.sqrt(np.mean(behaviour**2, axis=1, keepdims=True))
    columns = np.column_stack([np.ones_like(weights), (behaviour / np.where(sizes > 0, sizes, 1.0)).T])
    return np.asarray(root * np.linalg.pinv(root[:, None] * columns)[0])


def cross_validated(responses: Sequence[PerturbationResponse], impedance: ImpedanceFit) -> Prediction:
    """The predictors that predict best what each unperturbed crossing adds to the residual, from the others.

    `impedance` is the fit to the mean response. The mean counts as a prediction too.
    """
    rows = responses[0].window
    left = np.mean([gait_torque(r, impedance)[:, rows] for r in responses], axis=0)
    behaviour = np.mean([r.behaviour for r in responses], axis=0)
    missed = {}
    for predictors in CANDIDATES:
        if len(left) < CROSSINGS_PER_PREDICTOR * len(predictors) + CROSSINGS_BESIDE * bool(predictors):
            continue
        missed[predictors] = left_out_error(behaviour[[BEHAVIOUR.index(name) for name in predictors]], left)
    best = min(missed, key=lambda predictors: missed[predictors])
    return Prediction(best, 1 - missed[best] / missed[()] if best else 0.0)


def left_out_error(behaviour: Array, curves: Array) -> float:
    """Mean square error of the regression of curves (c, k) on `behaviour` (q, c), for each curve without itself."""
    columns = np.column_stack([np.ones(len(curves)), (behaviour - behaviour.mean(axis=1, keepdims=True)).T])
    sizes = np.sqrt(np.mean(columns**2, axis=0))
    columns = columns / np.where(sizes > 0, sizes, 1.0)
    hat = columns @ np.linalg.pinv(columns)
    alone = np.maximum(1 - np.diag(hat), 1e-9)  # a curve that alone determines a coefficient cannot be predicted
    return float(np.mean(((curves - hat @ curves) / alone[:, None]) ** 2))
