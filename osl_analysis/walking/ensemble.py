"""The mean response of all perturbations, its fit, and what chance could have made of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.fits.impedance import ImpedanceFit
from osl_analysis.signals import Motion, differentiate
from osl_analysis.trial import Array
from osl_analysis.walking.perturbation import Response, fit_without_offset, window_rows

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
    """Estimates of resampled ensembles, one entry per resample: K, B, I, VAF (units as in `ImpedanceFit`)."""

    K: Array
    B: Array
    I: Array
    VAF: Array


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
        if r.thetas.shape != first.thetas.shape or not np.allclose(r.time, first.time):
            raise InputError(
                f"trial {r.name}: its response is sampled otherwise than that of {first.name}, or was isolated from "
                "other unperturbed crossings; record all crossings at one marker rate and rerun the analysis"
            )


def bootstrap(responses: Sequence[Response], samples: int) -> Bootstrap:
    """Refit the ensemble with perturbations and unperturbed crossings drawn anew, with replacement.

    Both are drawn: the mean unperturbed crossing is subtracted from every response, so that its chance error is
    common to all and would not show in the scatter between perturbations.
    """
    check_alike(responses)
    random = np.random.default_rng(SEED)
    theta, torque = (np.array([getattr(r, name) for r in responses]) for name in ("thetas", "torques"))
    perturbed, normal = (resampling_weights(random, samples, n) for n in theta.shape[:2])
    time, rows = responses[0].time, window_rows(responses[0].time, responses[0].timing)
    fits = []
    for p, u in zip(perturbed, normal, strict=True):
        motion = differentiate(time, u @ np.tensordot(p, theta, 1))
        fits.append(fit_without_offset(motion[rows], (u @ np.tensordot(p, torque, 1))[rows]))
    return Bootstrap(
        K=np.array([f.K for f in fits]),
        B=np.array([f.B for f in fits]),
        I=np.array([f.I for f in fits]),
        VAF=np.array([f.fit.vaf for f in fits]),
    )


def variance_of_normal_gait(responses: Sequence[Response]) -> dict[str, float]:
    """Variance that the choice of unperturbed crossings gives to the mean of K, B and I over the perturbations.

    Jackknife: each unperturbed crossing is left out in turn, of all responses at once, which have its chance error in
    common. Units as in `ImpedanceFit`, squared.
    """
    check_alike(responses)
    rows, n = responses[0].window, len(responses[0].thetas)
    left_out = []
    for j in range(n):
        fits = []
        for r in responses:
            theta, torque = ((curves.sum(axis=0) - curves[j]) / (n - 1) for curves in (r.thetas, r.torques))
            fits.append(fit_without_offset(differentiate(r.time, theta)[rows], torque[rows]))
        left_out.append([np.mean([getattr(f, name) for f in fits]) for name in "KBI"])
    variance = (n - 1) * np.var(left_out, axis=0)
    return dict(zip("KBI", variance.tolist(), strict=True))


def resampling_weights(random: np.random.Generator, samples: int, n: int) -> Array:
    """Weights (samples, n) with which n items enter a mean when n are drawn with replacement."""
    return random.multinomial(n, np.full(n, 1 / n), size=samples) / n
