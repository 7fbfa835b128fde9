"""The mean response of all perturbations, its fit, and the bootstrap of that fit.

Responses to turns in both directions are joined by half their difference, mean up minus mean down over 2. What a person
does after either turn, whichever its direction, and the error of the mean unperturbed gait cancel in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from osl_analysis.errors import InputError
from osl_analysis.measured import ROUNDING
from osl_analysis.second_order import ImpedanceFit
from osl_analysis.signals import Motion, differentiate
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.repeats import CommonError
from osl_analysis.trial import Array
from osl_analysis.walking.prediction import Predictors, Stacked
from osl_analysis.walking.response import PerturbationResponse, window_samples
from osl_analysis.walking.response_fit import fit_without_offset, gait_errors, jackknife_covariance, plate_errors

SEED = 20
"""Seed of the bootstrap: the same data give the same interval."""


@dataclass(frozen=True)
class EnsembleResponse:
    """Mean over perturbations, k samples.

    n: number of perturbations.
    time: time (k,) [s] from the onset.
    motion: mean angle [rad] and its derivatives, (k,) each.
    torque: mean torque (k,) [N*m].
    fit: Eq. 15 in the window.
    """

    n: int
    time: Array
    motion: Motion
    torque: Array
    fit: ImpedanceFit


@dataclass(frozen=True)
class Bootstrap:
    """Estimates of resampled ensembles, one entry per sample.

    K, B, I, VAF: units as in `ImpedanceFit`, VAF in percent.
    degrees_of_freedom: the smaller of those of the perturbations (`freedom_of`) and of the unperturbed crossings.
    """

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


def ensemble_response(responses: Sequence[PerturbationResponse], predictors: Predictors = ()) -> EnsembleResponse:
    """Mean response, or half the difference of two directions, and its fit in the common window.

    With predictors, what the crossings would have done is predicted from their behaviour before the onset.

    Raises
    ------
    InputError
        Fewer than two responses of a direction, or their time grids or numbers of unperturbed crossings differ.
    """
    check_alike(responses)
    signs, first, crossings = signs_of(responses), responses[0], len(responses[0].thetas)
    alike = np.full(crossings, 1 / crossings)
    theta, torque = Stacked.of(responses, signs).joined(joining_weights(signs), alike, predictors)
    motion = differentiate(first.time, theta)
    rows = first.window
    return EnsembleResponse(len(responses), first.time, motion, torque, fit_without_offset(motion[rows], torque[rows]))


def freedom_of(signs: NDArray[np.int_]) -> float:
    """Degrees of freedom of a mean of perturbations, or of a difference of two means (Welch, equal variances)."""
    counts = np.unique(signs, return_counts=True)[1].tolist()
    return (
        float(welch_satterthwaite([1 / n for n in counts], [n - 1 for n in counts]))
        if len(counts) > 1
        else float(counts[0] - 1)
    )


def check_alike(responses: Sequence[PerturbationResponse]) -> None:
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


def bootstrap(responses: Sequence[PerturbationResponse], samples: int, predictors: Predictors = ()) -> Bootstrap:
    """Refit the ensemble with perturbations, unperturbed crossings and plate trials resampled with replacement.

    All three are resampled. The mean unperturbed gait is subtracted from every response, and the plate's model is part
    of every torque: their errors are common to all responses and do not show in the scatter between perturbations. The
    plate's model is resampled to first order, by the influence of each trial on the torque. Perturbations are drawn
    within their direction. With predictors, the regression is computed anew in each sample.
    """
    check_alike(responses)
    signs = signs_of(responses)
    draws = Draws.of(responses, samples)
    return draws.refitted(draws.perturbed * signs / len(np.unique(signs)), freedom_of(signs), predictors)


@dataclass(frozen=True)
class Draws:
    """Resampled perturbations, unperturbed crossings and plate trials of a bootstrap.

    responses: the n responses.
    perturbed: (samples, n) weights with a sum of 1 within each direction.
    unperturbed: (samples, crossings).
    unloaded: (samples, m).
    """

    responses: Sequence[PerturbationResponse]
    perturbed: Array
    unperturbed: Array
    unloaded: Array

    @classmethod
    def of(cls, responses: Sequence[PerturbationResponse], samples: int) -> "Draws":
        """Draws of checked responses, with the seed of every bootstrap."""
        random, signs = np.random.default_rng(SEED), signs_of(responses)
        perturbed = np.empty((samples, len(signs)))
        for sign in np.unique(signs)[::-1]:
            perturbed[:, signs == sign] = resampling_weights(random, samples, int(np.sum(signs == sign)))
        crossings, trials = len(responses[0].thetas), len(responses[0].plate_errors)
        return cls(responses, perturbed, *(resampling_weights(random, samples, n) for n in (crossings, trials)))

    def refitted(self, weights: Array, perturbations_freedom: float, predictors: Predictors = ()) -> Bootstrap:
        """Fits to the responses joined with `weights` (samples, n), which follow from `perturbed`."""
        stacked = Stacked.of(self.responses, signs_of(self.responses))
        plate = np.array([r.plate_errors for r in self.responses])
        trials, first = plate.shape[1], self.responses[0]
        influence = -(trials - 1) * (plate - plate.mean(axis=1, keepdims=True)) if trials > 1 else plate
        angles, torques = np.empty((2, len(first.time), len(weights)))
        for i, (w, unperturbed, unloaded) in enumerate(zip(weights, self.unperturbed, self.unloaded, strict=True)):
            angles[:, i], torques[:, i] = stacked.joined(w, unperturbed, predictors)
            torques[:, i] += unloaded @ np.tensordot(w, influence, 1)
        rows = window_samples(first.time, first.timing)
        freedom = min(perturbations_freedom, self.unperturbed.shape[1] - 1 - len(predictors))
        return Bootstrap(*fits_of_samples(differentiate(first.time, angles)[rows], torques[rows]), freedom)


def fits_of_samples(motion: Motion, torques: Array) -> tuple[Array, Array, Array, Array]:
    """K, B, I and VAF, (samples,) each, of motions and torques (k, samples): `fit_without_offset` of all at once.

    VAF is that of `variance_accounted_for`.
    """
    columns = np.stack([motion.theta.T, motion.omega.T, motion.alpha.T], axis=-1)
    sizes = np.linalg.norm(columns, axis=1, keepdims=True)
    estimates = np.linalg.pinv(columns / sizes) @ torques.T[..., None] / sizes.swapaxes(1, 2)
    residuals = torques.T - (columns @ estimates)[..., 0]
    left, variance, rounding = residuals.var(axis=1), torques.var(axis=0), ROUNDING * np.mean(torques**2, axis=0)
    share = np.divide(left, variance, out=(left > rounding).astype(float), where=variance > rounding)
    return estimates[:, 0, 0], estimates[:, 1, 0], estimates[:, 2, 0], 100 * (1 - share)


def common_errors(responses: Sequence[PerturbationResponse]) -> dict[str, list[CommonError]]:
    """Errors of K, B and I that all perturbations share: those of the mean unperturbed gait and of the plate's model.

    The first is the error of a mean of n crossings; `gait_errors` gives the part of each crossing. The second is the
    jackknife's over the plate trials. Variances are in the squared units of `ImpedanceFit`.
    """
    check_alike(responses)
    shares = np.abs(joining_weights(signs_of(responses)))
    fits = [fit_without_offset(r.fitted_motion, r.fitted_torque) for r in responses]
    gait = np.average([gait_errors(*each) for each in zip(responses, fits, strict=True)], axis=0, weights=shares)
    plate = np.average([plate_errors(r) for r in responses], axis=0, weights=shares)
    gait_variances, plate_variances = np.var(gait, axis=0, ddof=1) / len(gait), np.diag(jackknife_covariance(plate))
    return {
        name: [CommonError(float(g), len(gait) - 1), CommonError(float(p), max(len(plate) - 1, 1))]
        for name, g, p in zip("KBI", gait_variances, plate_variances, strict=True)
    }


def resampling_weights(random: np.random.Generator, samples: int, n: int) -> Array:
    """Weights (samples, n) of n items in the mean of n - 1 items drawn with replacement.

    The mean of n draws has a variance that is too small by the factor (n - 1)/n. The mean of n - 1 draws has the
    correct variance (Hesterberg, The American Statistician 69, 2015). A single item always has the weight 1.
    """
    if n < 2:
        return np.ones((samples, n))
    return random.multinomial(n - 1, np.full(n, 1 / n), size=samples) / (n - 1)
