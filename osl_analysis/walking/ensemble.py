"""The result of one group of crossings: the mean response of its perturbations, its fit and bootstrap, both directions.

Responses to turns in both directions are joined by half their difference, mean up minus mean down over 2. What a person
does after either turn, whichever its direction, and the error of the mean unperturbed gait cancel in it.

The draft subtracts the mean unperturbed gait. A crossing that is unlike the mean before the onset stays so for a while.
The unperturbed crossings tell how: their deviations in the window are regressed on their level and slope of angle and
torque before the onset. Which of these count, or none, is decided by cross-validation over the unperturbed crossings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from osl_analysis.errors import InputError
from osl_analysis.measured import EXACT_FIT_SHARE
from osl_analysis.second_order import ImpedanceFit
from osl_analysis.signals import Motion, differentiate
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.repeats import CommonError
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.gait import UnperturbedGait
from osl_analysis.walking.response import (
    BEHAVIOUR,
    PerturbationResponse,
    estimate_changes,
    fit_without_offset,
    gait_torque,
    isolate_response,
    jackknife_covariance,
)
from osl_analysis.walking.settings import EnsembleSettings
from osl_analysis.walking.setup import DOWN, UP

Predictors = tuple[str, ...]
CANDIDATES: tuple[Predictors, ...] = ((), ("angle_slope",), ("angle", "torque"), BEHAVIOUR)
"""Sets of predictors among which cross-validation chooses; with none the prediction is the mean."""


@dataclass(frozen=True)
class Prediction:
    """The predictors that were chosen, of `BEHAVIOUR`; none: the mean is at least as good. And the share, as a mean
    square of the torque added to the residual of Eq. 15, of the crossings' deviations that they predict."""

    predictors: Predictors = ()
    share: float = 0.0


@dataclass(frozen=True)
class EnsembleResponse:
    """Mean over n perturbations, k samples from the onset [s]: angle [rad], torque [N*m], and Eq. 15 in the window."""

    n: int
    time: Array
    motion: Motion
    torque: Array
    fit: ImpedanceFit


@dataclass(frozen=True)
class Bootstrap:
    """Estimates of resampled ensembles, one entry per sample, VAF in percent, and the degrees of freedom: the smaller
    of those of the perturbations (`freedom_of`) and of the unperturbed crossings."""

    K: Array
    B: Array
    I: Array
    VAF: Array
    degrees_of_freedom: float

    def se(self, name: str) -> float:
        """Standard error of a quantity, in its unit."""
        return float(np.std(getattr(self, name), ddof=1))

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % interval of a quantity: percentiles, widened as Student's quantiles (Hesterberg, 2015)."""
        tail = float(ndtr(stdtrit(self.degrees_of_freedom, 0.025)))
        low, high = np.quantile(getattr(self, name), [tail, 1 - tail])
        return float(low), float(high)

    def cov(self, first: str, second: str) -> float:
        """Covariance of two quantities, in the product of their units."""
        return float(np.cov(getattr(self, first), getattr(self, second))[0, 1])


def signs_of(responses: Sequence[PerturbationResponse]) -> NDArray[np.int_]:
    """Directions (n,) of responses: 1 or -1 if there are two, else all 1."""
    signs = np.array([r.sign for r in responses])
    return signs if len(np.unique(signs)) > 1 else np.ones_like(signs)


def joining_weights(signs: NDArray[np.int_]) -> Array:
    """Weights (n,) of responses with `signs` (n,) in their mean, or in half the difference of two directions."""
    count = np.where(signs > 0, np.sum(signs > 0), np.sum(signs < 0))
    return np.asarray(signs / count / len(np.unique(signs)))


def freedom_of(signs: NDArray[np.int_]) -> float:
    """Degrees of freedom of a mean of perturbations, or of a difference of two means (Welch, equal variances)."""
    counts = np.unique(signs, return_counts=True)[1].tolist()
    if len(counts) == 1:
        return float(counts[0] - 1)
    return float(welch_satterthwaite([1 / n for n in counts], [n - 1 for n in counts]))


def resampling_weights(random: np.random.Generator, samples: int, n: int) -> Array:
    """Weights (samples, n) of n items in the mean of n - 1 items drawn with replacement: the mean of n draws has a
    variance that is too small by (n - 1)/n (Hesterberg, The American Statistician 69, 2015). A single item has 1."""
    if n < 2:
        return np.ones((samples, n))
    return random.multinomial(n - 1, np.full(n, 1 / n), size=samples) / (n - 1)


class Ensemble:
    """The n responses of a group to c unperturbed crossings, k samples, stacked: theta and torque (n, c, k), behaviour
    (n, 4, c), directions (n,), and the influence (n, m, k) of each of m plate trials on the torque."""

    def __init__(self, responses: Sequence[PerturbationResponse]) -> None:
        check_joinable(responses)
        self.theta, self.torque, self.behaviour, plate = (
            np.array([getattr(r, name) for r in responses])
            for name in ("thetas", "torques", "behaviour", "plate_errors")
        )
        self.signs, self.time, self.window = signs_of(responses), responses[0].time, responses[0].window
        trials = plate.shape[1]
        self.influence = -(trials - 1) * (plate - plate.mean(axis=1, keepdims=True)) if trials > 1 else plate

    def joined(self, weights: Array, unperturbed: Array, predictors: Predictors = ()) -> tuple[Array, Array]:
        """Angle and torque (k,) each, of the responses joined with `weights` (n,), whose baseline is the mean of the
        unperturbed crossings with weights (c,), or what the predictors tell for each direction."""
        if not predictors:
            theta, torque = (np.tensordot(weights, curves, 1) for curves in (self.theta, self.torque))
            return unperturbed @ theta, unperturbed @ torque
        chosen, parts = [BEHAVIOUR.index(name) for name in predictors], []
        for sign in np.unique(self.signs[weights != 0]):
            own = np.where(self.signs == sign, weights, 0.0)
            baseline = predicting_weights(np.tensordot(own, self.behaviour, 1)[chosen], unperturbed)
            parts.append((baseline @ np.tensordot(own, self.theta, 1), baseline @ np.tensordot(own, self.torque, 1)))
        theta, torque = np.sum(parts, axis=0)
        return theta, torque

    def fitted(self, predictors: Predictors = ()) -> EnsembleResponse:
        """Mean response, or half the difference of two directions, and its fit in the common window."""
        crossings = self.theta.shape[1]
        alike = np.full(crossings, 1 / crossings)
        theta, torque = self.joined(joining_weights(self.signs), alike, predictors)
        motion = differentiate(self.time, theta)
        fit = fit_without_offset(motion[self.window], torque[self.window])
        return EnsembleResponse(len(self.signs), self.time, motion, torque, fit)

    def resampled(
        self, samples: int, predictors: Predictors = (), sign: int = 0, freedom: float | None = None
    ) -> Bootstrap:
        """The ensemble refitted with perturbations, within their direction, unperturbed crossings and plate trials (to
        first order) resampled with replacement: the errors of mean gait and plate are common to all responses and do
        not show in the scatter between perturbations. With a `sign` the mean of that direction alone, from the same
        draws."""
        random, signs = np.random.default_rng(20), self.signs  # the same data give the same interval
        perturbed = np.empty((samples, len(signs)))
        for each in np.unique(signs)[::-1]:
            perturbed[:, signs == each] = resampling_weights(random, samples, int(np.sum(signs == each)))
        of_gait, of_plate = (
            resampling_weights(random, samples, each.shape[1]) for each in (self.theta, self.influence)
        )
        weights = perturbed * (signs == sign) if sign else perturbed * signs / len(np.unique(signs))
        angles, torques = np.empty((2, len(self.time), samples))
        for i, (w, unperturbed, unloaded) in enumerate(zip(weights, of_gait, of_plate, strict=True)):
            angles[:, i], torques[:, i] = self.joined(w, unperturbed, predictors)
            torques[:, i] += unloaded @ np.tensordot(w, self.influence, 1)
        own = freedom_of(signs[signs == sign] if sign else signs)
        freedom = min(own, self.theta.shape[1] - 1 - len(predictors))
        return Bootstrap(*fits_of_samples(differentiate(self.time, angles)[self.window], torques[self.window]), freedom)


def ensemble_response(responses: Sequence[PerturbationResponse], predictors: Predictors = ()) -> EnsembleResponse:
    """Mean response, or half the difference of two directions, and its fit, with what predictors tell of the
    baseline."""
    return Ensemble(responses).fitted(predictors)


def bootstrap(responses: Sequence[PerturbationResponse], samples: int, predictors: Predictors = ()) -> Bootstrap:
    """`ensemble_response` of resampled perturbations, unperturbed crossings and plate trials."""
    return Ensemble(responses).resampled(samples, predictors)


def check_joinable(responses: Sequence[PerturbationResponse]) -> None:
    """Refuse responses that cannot be averaged."""
    if len(responses) < 2:
        raise InputError(f"perturbations in the ensemble: {len(responses)}, expected 2 or more; record more")
    signs = signs_of(responses)
    for sign, word in ((1, "up"), (-1, "down")):
        if np.sum(signs == sign) == 1:
            raise InputError(
                f"1 perturbation turns the toes {word} and {len(signs) - 1} the other way, expected 2 or more of each "
                "to join them; record more, or exclude it in the sheet"
            )
    first = responses[0]
    for r in responses[1:]:
        shapes = r.thetas.shape, r.plate_errors.shape
        if shapes != (first.thetas.shape, first.plate_errors.shape) or not np.allclose(r.time, first.time):
            raise InputError(
                f"trial {r.name}: {len(r.time)} samples from {len(r.thetas)} unperturbed crossings and "
                f"{len(r.plate_errors)} plate trials, but trial {first.name} has {len(first.time)} from "
                f"{len(first.thetas)} and {len(first.plate_errors)}, or other sampling times; record all crossings at "
                "one marker rate and run the analysis again"
            )


def fits_of_samples(motion: Motion, torques: Array) -> tuple[Array, Array, Array, Array]:
    """K, B, I and VAF (`variance_accounted_for`), (samples,) each, of motions and torques (k, samples):
    `fit_without_offset` of all at once."""
    columns = np.stack([motion.theta.T, motion.omega.T, motion.alpha.T], axis=-1)
    sizes = np.linalg.norm(columns, axis=1, keepdims=True)
    estimates = np.linalg.pinv(columns / sizes) @ torques.T[..., None] / sizes.swapaxes(1, 2)
    residuals = torques.T - (columns @ estimates)[..., 0]
    left, variance, rounding = residuals.var(axis=1), torques.var(axis=0), EXACT_FIT_SHARE * np.mean(torques**2, axis=0)
    share = np.divide(left, variance, out=(left > rounding).astype(float), where=variance > rounding)
    return estimates[:, 0, 0], estimates[:, 1, 0], estimates[:, 2, 0], 100 * (1 - share)


def predicting_weights(behaviour: Array, weights: Array) -> Array:
    """Weights (c,) of c unperturbed crossings in what a perturbed one would have done: of the weighted regression of
    their curves on `behaviour` (q, c), the perturbed one's minus theirs, at 0. `weights` where too few are not 0."""
    used = weights > 0
    if not len(behaviour) or used.sum() < len(behaviour) + 2:
        return weights
    root = np.sqrt(weights)
    sizes = np.sqrt(np.mean(behaviour**2, axis=1, keepdims=True))
    columns = np.column_stack([np.ones_like(weights), (behaviour / np.where(sizes > 0, sizes, 1.0)).T])
    return np.asarray(root * np.linalg.pinv(root[:, None] * columns)[0])


def cross_validated(responses: Sequence[PerturbationResponse], impedance: ImpedanceFit) -> Prediction:
    """The predictors that predict best what each unperturbed crossing adds to the residual, from the others; none is
    the mean. `impedance` is the fit to the mean response."""
    curves = np.mean([gait_torque(r, impedance)[:, responses[0].window] for r in responses], axis=0)
    behaviour, missed = np.mean([r.behaviour for r in responses], axis=0), {}
    for predictors in CANDIDATES:
        if predictors and len(curves) < 3 * len(predictors) + 4:  # the bootstrap's regressions were undetermined
            continue
        some = behaviour[[BEHAVIOUR.index(name) for name in predictors]]
        columns = np.column_stack([np.ones(len(curves)), (some - some.mean(axis=1, keepdims=True)).T])
        sizes = np.sqrt(np.mean(columns**2, axis=0))
        columns = columns / np.where(sizes > 0, sizes, 1.0)
        hat = columns @ np.linalg.pinv(columns)
        alone = np.maximum(1 - np.diag(hat), 1e-9)  # a curve that alone determines a coefficient cannot be predicted
        missed[predictors] = float(np.mean(((curves - hat @ curves) / alone[:, None]) ** 2))
    best = min(missed, key=lambda predictors: missed[predictors])
    return Prediction(best, 1 - missed[best] / missed[()] if best else 0.0)


def common_errors(responses: Sequence[PerturbationResponse]) -> dict[str, list[CommonError]]:
    """Errors of K, B and I that all perturbations share, as variances: of a mean of n unperturbed crossings, and of the
    plate's model, the jackknife's over the plate trials."""
    check_joinable(responses)
    shares, changes = np.abs(joining_weights(signs_of(responses))), []
    for r in responses:
        impedance = fit_without_offset(r.fitted_motion, r.fitted_torque)
        changes.append((estimate_changes(gait_torque(r, impedance), r), estimate_changes(r.plate_errors, r)))
    gait, plate = (np.average(each, axis=0, weights=shares) for each in zip(*changes, strict=True))
    gait_variances, plate_variances = np.var(gait, axis=0, ddof=1) / len(gait), np.diag(jackknife_covariance(plate))
    return {
        name: [CommonError(float(g), len(gait) - 1), CommonError(float(p), max(len(plate) - 1, 1))]
        for name, g, p in zip("KBI", gait_variances, plate_variances, strict=True)
    }


Result = tuple[EnsembleResponse, Bootstrap]
UP_MINUS_DOWN = "up minus down"
Direction = tuple[dict[str, float], Bootstrap, int]
"""One direction of the platform, or up minus down: K, B and I, the same of resampled ones, number of perturbations."""


@dataclass(frozen=True)
class GroupHeadline:
    """Result of one group; `ensemble` and `resampled` with the baseline that the settings name."""

    responses: Sequence[PerturbationResponse]
    common: Mapping[str, Sequence[CommonError]]  # errors that all single fits share, by quantity
    directions: Mapping[str, Direction]  # `up`, `down` and `UP_MINUS_DOWN`; empty if there is one only
    baseline: str  # `mean` or `predicted`: which of both the settings name
    prediction: Prediction  # how the behaviour before the onset predicts the unperturbed course
    mean_gait: Result  # the ensemble and its bootstrap with this baseline
    predicted_gait: Result

    @property
    def ensemble(self) -> EnsembleResponse:
        return (self.predicted_gait if self.baseline == "predicted" else self.mean_gait)[0]

    @property
    def resampled(self) -> Bootstrap:
        return (self.predicted_gait if self.baseline == "predicted" else self.mean_gait)[1]


def group_headline(perturbed: Sequence[Crossing], gait: UnperturbedGait, settings: EnsembleSettings) -> GroupHeadline:
    """The result of the perturbed crossings of one group, whose mean unperturbed gait is `gait`."""
    responses = [isolate_response(c, gait, settings.timing, settings.perturbed_stance) for c in perturbed]
    ensemble, samples = Ensemble(responses), settings.bootstrap_samples
    mean_gait = ensemble.fitted(), ensemble.resampled(samples)
    prediction = cross_validated(responses, mean_gait[0].fit)
    names = prediction.predictors
    predicted_gait = (ensemble.fitted(names), ensemble.resampled(samples, names)) if names else mean_gait
    common, directions = common_errors(responses), compare_directions(responses, samples)
    return GroupHeadline(responses, common, directions, settings.baseline, prediction, mean_gait, predicted_gait)


def compare_directions(responses: Sequence[PerturbationResponse], samples: int) -> dict[str, Direction]:
    """Fits to the mean responses up and down, and their difference; empty if the platform always turned one way. Both
    are resampled together: the error of the mean unperturbed gait does not cancel in the difference."""
    ensemble, found = Ensemble(responses), dict[str, Direction]()
    if len(np.unique(ensemble.signs)) < 2:
        return found
    for name, sign in ((UP, 1), (DOWN, -1)):
        chosen = [r for r in responses if r.sign == sign]
        motion = differentiate(chosen[0].time, np.mean([r.motion.theta for r in chosen], axis=0))
        torque, rows = np.mean([r.torque for r in chosen], axis=0), chosen[0].window
        fit = fit_without_offset(motion[rows], torque[rows])
        found[name] = {"K": fit.K, "B": fit.B, "I": fit.I}, ensemble.resampled(samples, sign=sign), len(chosen)
    (up, ups, n_up), (down, downs, n_down) = found.values()
    K, B, I, VAF = (getattr(ups, name) - getattr(downs, name) for name in ("K", "B", "I", "VAF"))
    difference = Bootstrap(K, B, I, VAF, min(ups.degrees_of_freedom, downs.degrees_of_freedom))
    return found | {UP_MINUS_DOWN: ({name: up[name] - down[name] for name in up}, difference, n_up + n_down)}
