"""The mean response of all perturbations, its fit, and the bootstrap of that fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, stdtrit

from osl_analysis.errors import InputError
from osl_analysis.second_order import ImpedanceFit
from osl_analysis.signals import Motion, differentiate
from osl_analysis.stats.repeats import CommonError
from osl_analysis.trial import Array
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
    degrees_of_freedom: the smaller of the numbers of perturbations and unperturbed crossings, minus 1.
    """

    K: Array
    B: Array
    I: Array
    VAF: Array
    degrees_of_freedom: int

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


def ensemble_response(responses: Sequence[PerturbationResponse]) -> EnsembleResponse:
    """Mean response and its fit in the common window.

    Raises
    ------
    InputError
        Fewer than two responses, or their time grids or numbers of unperturbed crossings differ.
    """
    check_alike(responses)
    first = responses[0]
    theta = np.mean([r.motion.theta for r in responses], axis=0)
    torque = np.mean([r.torque for r in responses], axis=0)
    motion = differentiate(first.time, theta)
    rows = first.window
    return EnsembleResponse(len(responses), first.time, motion, torque, fit_without_offset(motion[rows], torque[rows]))


def check_alike(responses: Sequence[PerturbationResponse]) -> None:
    """Refuse responses that cannot be averaged."""
    if len(responses) < 2:
        raise InputError(f"perturbations in the ensemble: {len(responses)}, expected 2 or more; record more")
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


def bootstrap(responses: Sequence[PerturbationResponse], samples: int) -> Bootstrap:
    """Refit the ensemble with perturbations, unperturbed crossings and plate trials resampled with replacement.

    All three are resampled. The mean unperturbed gait is subtracted from every response, and the plate's model is part
    of every torque: their errors are common to all responses and do not show in the scatter between perturbations. The
    plate's model is resampled to first order, by the influence of each trial on the torque.
    """
    check_alike(responses)
    random = np.random.default_rng(SEED)
    theta, torque, plate = (
        np.array([getattr(r, name) for r in responses]) for name in ("thetas", "torques", "plate_errors")
    )
    trials = plate.shape[1]
    weights = [resampling_weights(random, samples, n) for n in (*theta.shape[:2], trials)]
    time, rows = responses[0].time, window_samples(responses[0].time, responses[0].timing)
    influence = -(trials - 1) * (plate - plate.mean(axis=1, keepdims=True)) if trials > 1 else plate
    fits = []
    for perturbed, unperturbed, unloaded in zip(*weights, strict=True):
        motion = differentiate(time, unperturbed @ np.tensordot(perturbed, theta, 1))
        plate_torque = unloaded @ np.tensordot(perturbed, influence, 1)
        resampled = unperturbed @ np.tensordot(perturbed, torque, 1) + plate_torque
        fits.append(fit_without_offset(motion[rows], resampled[rows]))
    return Bootstrap(
        K=np.array([f.K for f in fits]),
        B=np.array([f.B for f in fits]),
        I=np.array([f.I for f in fits]),
        VAF=np.array([f.fit.vaf for f in fits]),
        degrees_of_freedom=min(theta.shape[:2]) - 1,
    )


def common_errors(responses: Sequence[PerturbationResponse]) -> dict[str, list[CommonError]]:
    """Errors of K, B and I that all perturbations share: those of the mean unperturbed gait and of the plate's model.

    The first is the error of a mean of n crossings; `gait_errors` gives the part of each crossing. The second is the
    jackknife's over the plate trials. Variances are in the squared units of `ImpedanceFit`.
    """
    check_alike(responses)
    fits = [fit_without_offset(r.fitted_motion, r.fitted_torque) for r in responses]
    gait = np.mean([gait_errors(*each) for each in zip(responses, fits, strict=True)], axis=0)
    plate = np.mean([plate_errors(r) for r in responses], axis=0)
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
