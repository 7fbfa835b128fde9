# SPDX-License-Identifier: Apache-2.0
"""Step 7 for a group of crossings: the mean response, its fit, and a bootstrap interval.

The headline subtracts the mean unperturbed gait, as the paper does. Predicted gait stands beside
it: a crossing that is unlike the mean before the onset stays so for a while. The unperturbed
crossings tell how: their deviations in the window are regressed on level and slope of angle and
torque before the onset. Cross-validation over unperturbed crossings decides which of these
predictors count, or none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.signals import Motion, differentiate
from osl_analysis.stats.linear_fit import LinearFit, vaf_by_moments
from osl_analysis.stats.repeats import CommonError
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.impedance_fit import (
    estimate_changes,
    fit_without_offset,
    gait_torque,
    jackknife_covariance,
)
from osl_analysis.walking.isolated_response import (
    BEHAVIOUR,
    PerturbationResponse,
    UnperturbedGait,
    isolate_response,
)
from osl_analysis.walking.walking_settings import EnsembleSettings

SEED = 20  # the same data give the same interval
ESTIMATED = ("K", "B", "I")

Predictors = tuple[str, ...]
"""Some of `BEHAVIOUR`; if empty, the prediction is the mean unperturbed gait."""
PREDICTOR_SETS: tuple[Predictors, ...] = ((), ("angle_slope",), ("angle", "torque"), BEHAVIOUR)


@dataclass(frozen=True)
class EnsembleResponse:
    """Mean over the perturbations, k samples, and Eq. 15 in the window."""

    motion: Motion
    torque: Array  # (k,) [N*m]
    fit: LinearFit


@dataclass(frozen=True)
class Bootstrap:
    """Estimates of resampled ensembles."""

    draws: Mapping[str, Array]  # K, B, I and VAF [percent] of each sample
    # The smaller of those of perturbations and unperturbed crossings
    degrees_of_freedom: float

    def se(self, quantity: str) -> float:
        """Standard error of a quantity, in its unit."""
        return float(np.std(self.draws[quantity], ddof=1))

    def interval(self, quantity: str) -> tuple[float, float]:
        """Bounds of the 95 % interval: percentiles, widened for Student's t (Hesterberg, 2015)."""
        t = scipy.special.stdtrit(self.degrees_of_freedom, 0.025)
        tail = scipy.special.ndtr(t)
        low, high = np.quantile(self.draws[quantity], [tail, 1 - tail])
        return low, high


def resampling_weights(random: np.random.Generator, samples: int, n: int) -> Array:
    """Draw the weights (samples, n) of n items in the mean of n - 1 draws with replacement.

    The mean of n draws would have a variance too small by (n - 1)/n (Hesterberg, The American
    Statistician 69, 2015). A single item has weight 1.
    """
    if n < 2:
        return np.ones((samples, n))
    return random.multinomial(n - 1, equal_weights(n), size=samples) / (n - 1)


def equal_weights(n: int) -> Array:
    return np.full(n, 1 / n)


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
    influence : Array
        Pseudo-values of the torque (n, m, k) [N*m], one for each of m plate trials: drawing them
        with replacement gives the jackknife's variance (Tukey).

    Raises
    ------
    InputError
        There are fewer than two responses, or they cannot be stacked.
    """

    def __init__(self, responses: Sequence[PerturbationResponse]) -> None:
        check_stackable(responses)
        self.time = responses[0].time
        self.window = responses[0].window
        self.theta = np.array([response.thetas for response in responses])
        self.torque = np.array([response.torques for response in responses])
        self.behaviour = np.array([response.behaviour for response in responses])
        changes = np.array([response.plate_errors for response in responses])
        trials = changes.shape[1]
        self.influence = changes
        if trials > 1:
            self.influence = -(trials - 1) * (changes - changes.mean(axis=1, keepdims=True))

    def joined(
        self, weights: Array, unperturbed: Array, predictors: Predictors = ()
    ) -> tuple[Array, Array]:
        """Join responses to one angle (k,) [rad] and torque (k,) [N*m].

        With `weights` (n,) of the responses, and `unperturbed` (c,) of the unperturbed crossings.
        From predictors, unperturbed gait is predicted.
        """
        if predictors:
            behaviour = np.tensordot(weights, self.behaviour, 1)
            unperturbed = predicting_weights(behaviour, unperturbed, predictors)
        theta = np.tensordot(weights, self.theta, 1)
        torque = np.tensordot(weights, self.torque, 1)
        return unperturbed @ theta, unperturbed @ torque

    def fitted(self, predictors: Predictors = ()) -> EnsembleResponse:
        """Fit Eq. 15 to the mean response."""
        n, crossings = self.theta.shape[:2]
        theta, torque = self.joined(equal_weights(n), equal_weights(crossings), predictors)
        motion = differentiate(self.time, theta)
        fit = fit_without_offset(motion[self.window], torque[self.window])
        return EnsembleResponse(motion, torque, fit)

    def resampled(self, samples: int, choice: PredictorChoice | None = None) -> Bootstrap:
        """Fit Eq. 15 to draws of perturbations, unperturbed crossings and plate trials.

        Errors of mean gait and plate are common to all responses: the responses' scatter does not
        show them. Those of the plate are drawn to first order. With a `choice`, each draw chooses
        its predictors anew, since another campaign would.
        """
        n, crossings = self.theta.shape[:2]
        trials = self.influence.shape[1]
        random = np.random.default_rng(SEED)
        weights = resampling_weights(random, samples, n)
        of_gait = resampling_weights(random, samples, crossings)
        of_plate = resampling_weights(random, samples, trials)

        thetas = np.empty((len(self.time), samples))
        torques = np.empty((len(self.time), samples))
        for i in range(samples):
            predictors = choice.best(of_gait[i]) if choice is not None else ()
            theta, torque = self.joined(weights[i], of_gait[i], predictors)
            thetas[:, i] = theta
            torques[:, i] = torque + of_plate[i] @ np.tensordot(weights[i], self.influence, 1)
        motion = differentiate(self.time, thetas)[self.window]
        used = len(choice.of_all) if choice is not None else 0
        return Bootstrap(
            fitted_draws(motion, torques[self.window]), min(n - 1, crossings - 1 - used)
        )


def check_stackable(responses: Sequence[PerturbationResponse]) -> None:
    """Refuse responses that cannot be joined."""
    if len(responses) < 2:
        raise InputError(
            f"perturbations in the ensemble: {len(responses)}, expected 2 or more; record more"
        )
    first = responses[0]
    for response in responses[1:]:
        same_shapes = (
            response.thetas.shape == first.thetas.shape
            and response.plate_errors.shape == first.plate_errors.shape
        )
        if not same_shapes or not np.allclose(response.time, first.time):
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


def fitted_draws(motion: Motion, torque: Array) -> dict[str, Array]:
    """Fit Eq. 15 to all samples (k, samples) at once, as `fit_without_offset` does to one."""
    X = np.stack([motion.theta.T, motion.omega.T, motion.alpha.T], axis=-1)  # (samples, k, 3)
    y = torque.T
    sizes = np.linalg.norm(X, axis=1, keepdims=True)
    estimates = np.linalg.pinv(X / sizes) @ y[..., None] / sizes.swapaxes(1, 2)

    unexplained = (y - (X @ estimates)[..., 0]).var(axis=1)
    vaf = vaf_by_moments(unexplained, y.var(axis=1), np.mean(y**2, axis=1))
    K, B, I = estimates[:, :, 0].T
    return {"K": K, "B": B, "I": I, "VAF": vaf}


def predictor_choice(responses: Sequence[PerturbationResponse], fit: LinearFit) -> PredictorChoice:
    """The curves and the behaviour that predictors are chosen by, with the `fit` to the mean."""
    behaviour = np.mean([response.behaviour for response in responses], axis=0)
    return PredictorChoice(mean_gait_torque(responses, fit), behaviour)


def mean_gait_torque(responses: Sequence[PerturbationResponse], fit: LinearFit) -> Array:
    """Torque (crossings, window) [N*m] of ordinary gait beside a fit, the mean over responses."""
    window = responses[0].window
    return np.mean([gait_torque(response, fit)[:, window] for response in responses], axis=0)


@dataclass(frozen=True)
class SharedErrors:
    """Errors of K, B and I by gait and plate."""

    # By source and quantity, variances that all perturbations share, with degrees of freedom
    by_source: Mapping[str, Mapping[str, CommonError]]
    # Variance of one perturbation as unperturbed crossings scatter
    of_one: Mapping[str, float]

    @property
    def common(self) -> dict[str, list[CommonError]]:
        """By quantity, those of all sources."""
        return {
            name: [of_source[name] for of_source in self.by_source.values()] for name in self.of_one
        }


def shared_errors(responses: Sequence[PerturbationResponse]) -> SharedErrors:
    """Compute the errors that all perturbations share, and those of one."""
    changes = [
        estimate_changes(
            response, fit_without_offset(response.fitted_motion, response.fitted_torque)
        )
        for response in responses
    ]
    of_one = np.mean([np.var(change.by_gait, axis=0, ddof=1) for change in changes], axis=0)
    by_gait = np.mean([change.by_gait for change in changes], axis=0)
    by_plate = np.mean([change.by_plate for change in changes], axis=0)
    of_mean_gait = np.var(by_gait, axis=0, ddof=1) / len(by_gait)
    of_plate = np.diag(jackknife_covariance(by_plate))
    sources = {
        "mean gait": (of_mean_gait, len(by_gait) - 1),
        "plate inertia": (of_plate, max(len(by_plate) - 1, 1)),
    }
    by_source = {
        source: {name: (variances[k], freedom) for k, name in enumerate(ESTIMATED)}
        for source, (variances, freedom) in sources.items()
    }
    return SharedErrors(by_source, dict(zip(ESTIMATED, of_one, strict=True)))


@dataclass(frozen=True)
class GroupHeadline:
    """The result of one group of perturbed crossings."""

    responses: Sequence[PerturbationResponse]
    errors: SharedErrors
    ensemble: EnsembleResponse  # minus the mean unperturbed gait
    resampled: Bootstrap
    predicted: EnsembleResponse  # minus predicted gait
    predicted_resampled: Bootstrap


def group_headline(
    perturbed: Sequence[Crossing], gait: UnperturbedGait, settings: EnsembleSettings
) -> GroupHeadline:
    """Compute the result of the perturbed crossings of one group, whose unperturbed gait is `gait`.

    Raises
    ------
    InputError
        A response cannot be isolated, or there are too few.
    """
    responses = [isolate_response(crossing, gait, settings) for crossing in perturbed]
    stacked = Ensemble(responses)
    samples = settings.bootstrap_samples
    mean_gait = stacked.fitted()
    choice = predictor_choice(responses, mean_gait.fit)
    return GroupHeadline(
        responses,
        errors=shared_errors(responses),
        ensemble=mean_gait,
        resampled=stacked.resampled(samples),
        predicted=stacked.fitted(choice.of_all),
        predicted_resampled=stacked.resampled(samples, choice),
    )
