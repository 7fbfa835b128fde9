"""The mean response of all perturbations, its fit, and what chance could have made of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, stdtrit

from osl_analysis.errors import InputError
from osl_analysis.second_order import ImpedanceFit
from osl_analysis.signals import Motion, differentiate
from osl_analysis.stats.repeats import CommonError
from osl_analysis.trial import Array
from osl_analysis.walking.perturbation import (
    Response,
    fit_without_offset,
    gait_errors,
    jackknife_covariance,
    plate_effects,
    window_rows,
)

SEED = 20
"""Seed of the bootstrap: the same data give the same interval."""


@dataclass(frozen=True)
class EnsembleResponse:
    """Mean over n perturbations, k samples at `time` [s] from the onset: motion, torque [N*m], and its fit."""

    n: int
    time: Array
    motion: Motion
    torque: Array
    fit: ImpedanceFit


@dataclass(frozen=True)
class Bootstrap:
    """Estimates of resampled ensembles, one entry per resample: K, B, I, VAF (units as in `ImpedanceFit`).

    `degrees_of_freedom`: perturbations or unperturbed crossings, whichever are fewer, but one.
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
        """Bounds of the 95 % interval of a quantity: percentiles as far out as Student's (Hesterberg, 2015)."""
        tail = float(ndtr(stdtrit(self.degrees_of_freedom, 0.025)))
        low, high = np.quantile(getattr(self, name), [tail, 1 - tail])
        return float(low), float(high)

    def cov(self, first: str, second: str) -> float:
        """Covariance of two quantities, in the product of their units."""
        return float(np.cov(getattr(self, first), getattr(self, second))[0, 1])


def ensemble_response(responses: Sequence[Response]) -> EnsembleResponse:
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


def check_alike(responses: Sequence[Response]) -> None:
    """Refuse responses that cannot be averaged."""
    if len(responses) < 2:
        raise InputError(f"{len(responses)} perturbation cannot give an ensemble; record at least two")
    first = responses[0]
    for r in responses[1:]:
        shapes = r.thetas.shape, r.plate_errors.shape
        if shapes != (first.thetas.shape, first.plate_errors.shape) or not np.allclose(r.time, first.time):
            raise InputError(
                f"trial {r.name}: its response is sampled otherwise than that of {first.name}, or was isolated from "
                "other unperturbed crossings or with another model of the plate; record all crossings at one marker "
                "rate and rerun the analysis"
            )


def bootstrap(responses: Sequence[Response], samples: int) -> Bootstrap:
    """Refit the ensemble with perturbations, unperturbed crossings and unloaded trials drawn anew, with replacement.

    All are drawn: the mean unperturbed crossing is subtracted from every response and the plate's model stands in every
    torque, so that their chance errors are common to all and would not show in the scatter between perturbations. A
    model from other trials is taken to first order, by the influence of each.
    """
    check_alike(responses)
    random = np.random.default_rng(SEED)
    theta, torque, plate = (
        np.array([getattr(r, name) for r in responses]) for name in ("thetas", "torques", "plate_errors")
    )
    trials = plate.shape[1]
    perturbed, normal, unloaded = (resampling_weights(random, samples, n) for n in (*theta.shape[:2], trials))
    time, rows = responses[0].time, window_rows(responses[0].time, responses[0].timing)
    influence = -(trials - 1) * (plate - plate.mean(axis=1, keepdims=True)) if trials > 1 else plate
    fits = []
    for p, u, w in zip(perturbed, normal, unloaded, strict=True):
        motion = differentiate(time, u @ np.tensordot(p, theta, 1))
        drawn = u @ np.tensordot(p, torque, 1) + w @ np.tensordot(p, influence, 1)
        fits.append(fit_without_offset(motion[rows], drawn[rows]))
    return Bootstrap(
        K=np.array([f.K for f in fits]),
        B=np.array([f.B for f in fits]),
        I=np.array([f.I for f in fits]),
        VAF=np.array([f.fit.vaf for f in fits]),
        degrees_of_freedom=min(theta.shape[:2]) - 1,
    )


def common_errors(responses: Sequence[Response]) -> dict[str, list[CommonError]]:
    """What the mean of K, B and I over the perturbations owes to the unperturbed crossings and to the plate's trials.

    One mean of unperturbed crossings is subtracted from all responses, one model of the plate stands in all torques.
    Their chance errors are that of a mean of n crossings, of which `gait_errors` says what each contributes, and the
    jackknife's over the trials of the plate. Units as in `ImpedanceFit`, squared.
    """
    check_alike(responses)
    fits = [fit_without_offset(r.motion[r.window], r.torque[r.window]) for r in responses]
    gait = np.mean([gait_errors(*each) for each in zip(responses, fits, strict=True)], axis=0)
    plate = np.mean([plate_effects(r) for r in responses], axis=0)
    by_gait, by_plate = np.var(gait, axis=0, ddof=1) / len(gait), np.diag(jackknife_covariance(plate))
    return {
        name: [CommonError(float(g), len(gait) - 1), CommonError(float(p), max(len(plate) - 1, 1))]
        for name, g, p in zip("KBI", by_gait, by_plate, strict=True)
    }


def resampling_weights(random: np.random.Generator, samples: int, n: int) -> Array:
    """Weights (samples, n) with which n items enter a mean when n - 1 are drawn with replacement.

    The mean of n draws would have the variance (n - 1)/n of what it should be, that of n - 1 draws is right
    (Hesterberg, The American Statistician 69, 2015). Of a single item it is the item.
    """
    if n < 2:
        return np.ones((samples, n))
    return random.multinomial(n - 1, np.full(n, 1 / n), size=samples) / (n - 1)
