"""Rival models of one torque side by side: what they predict of data held out, and what their parameters cost."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.bench.belt import loaded_rows
from osl_analysis.signals import Motion
from osl_analysis.stats.regression import LinearFit, linear_fit, variance_accounted_for
from osl_analysis.trial import Array

Terms = Mapping[str, tuple[str, ...]]
BELT: Terms = {
    "M1": ("K_s",),
    "M2": ("K_s", "K_s2"),
    "M3": ("K_s", "T_h"),
    "M4": ("K_s", "K_s2", "T_h"),
}
"""T_h [N*m]: half the torque by which loading and unloading differ."""
TRANSMISSION: Terms = {"M1": ("B_j", "J_j"), "M2": ("B_j", "J_j", "T_C")}
SECOND_ORDER: Terms = {"M1": ("K", "B", "I")}
TURN = 0.1
"""Share of the peak deflection over which the belt's hysteresis may turn round, at both ends."""
LAGS = 0.1
"""Share of the samples up to which the residual's autocorrelation is looked at."""
ROUNDING = 1e-24
"""Mean square of what rounding leaves of an exact fit, as a share of the torque's; it depends on the processor."""


@dataclass(frozen=True)
class Fold:
    """One trial or amplitude: torque [N*m] and every column that a model may use, shape (n,) each.

    An offset, and a drift where it says so, are taken out of all of them: each fold has its own, as a load cell has.
    """

    torque: Array
    columns: Mapping[str, Array]


@dataclass(frozen=True)
class Candidate:
    """What one model leaves of the torque, shape (n,) [N*m]: when fitted to all of it, and when to other data only.

    `terms` says of what the model is made; `parameters` counts what was fitted, offset and drift left out: all models
    of a torque have the same.
    """

    model: str
    terms: str
    parameters: int
    residual: Array
    held_out_residual: Array


@dataclass(frozen=True)
class Score:
    """A model's VAF [percent], also on data held out, its BIC (lower is better), and its rank by that, from 1 on."""

    model: str
    terms: str
    parameters: int
    vaf: float
    vaf_held_out: float
    bic: float
    effective_samples: float
    rank: int


def fold(torque: Array, columns: Mapping[str, Array], nuisance: Array) -> Fold:
    """A fold without what `nuisance` (n, k) explains of its torque and columns."""
    return Fold(without(torque, nuisance), {name: without(column, nuisance) for name, column in columns.items()})


def without(signal: Array, nuisance: Array) -> Array:
    """What least squares on the nuisance (n, k) leaves of a signal (n,)."""
    basis, _ = np.linalg.qr(nuisance)
    return np.asarray(signal - basis @ (basis.T @ signal))


def offset_and_drift(n: int) -> Array:
    """A constant and a ramp over n uniform samples, as columns."""
    return np.column_stack([np.ones(n), np.linspace(-1, 1, n)])


def belt_fold(theta_s: Array, torque: Array) -> Fold:
    """One load-unload cycle: belt deflection [rad] and torque [N*m], without where the hysteresis turns.

    Both branches cover the same deflections, or what differs between them would pass for curvature. The offset is the
    only nuisance: a drift looks too much like loading followed by unloading.
    """
    deflection = theta_s - theta_s[0]
    onset, peak, release = loaded_rows(deflection)
    share = np.abs(deflection / deflection[peak])
    rows = np.arange(onset, release)
    rows = rows[(share[rows] > TURN) & (share[rows] < 1 - TURN)]
    x, side = deflection[rows], np.where(rows <= peak, 1.0, -1.0) * np.sign(deflection[peak])
    return fold(torque[rows], {"K_s": x, "K_s2": x * np.abs(x), "T_h": side}, np.ones((len(rows), 1)))


def transmission_fold(motion: Motion, direction: Array, torque: Array) -> Fold:
    """One trial with the motor detached; `direction` is the smooth sign of omega, filtered as the torque was."""
    columns = {"B_j": motion.omega, "J_j": motion.alpha, "T_C": direction}
    return fold(torque, columns, offset_and_drift(len(torque)))


def impedance_fold(motion: Motion, torque: Array) -> Fold:
    """One amplitude of a trial against the controller, for Eq. 15."""
    columns = {"K": motion.theta, "B": motion.omega, "I": motion.alpha}
    return fold(torque, columns, offset_and_drift(len(torque)))


def held_out_repeats(folds: Sequence[Fold], models: Terms, k: int) -> list[Score]:
    """Each model on fold k: fitted to it for the BIC, and to all the others for the VAF on data held out.

    A fold that is alone has no such VAF: it is NaN.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    others = [f for i, f in enumerate(folds) if i != k]
    candidates = [
        Candidate(
            model,
            " + ".join(terms),
            len(terms),
            residual(folds[k], fitted([folds[k]], terms)),
            residual(folds[k], fitted(others, terms)) if others else np.full_like(folds[k].torque, np.nan),
        )
        for model, terms in models.items()
    ]
    return compare(folds[k].torque, candidates)


def held_out_parts(folds: Sequence[Fold], model: str, terms: tuple[str, ...]) -> Candidate:
    """A linear model of one trial whose folds are its amplitudes, each predicted by a fit to the others."""
    whole = fitted(folds, terms)
    held_out = [residual(f, fitted([other for other in folds if other is not f], terms)) for f in folds]
    return Candidate(
        model,
        " + ".join(terms),
        len(terms),
        np.concatenate([residual(f, whole) for f in folds]),
        np.concatenate(held_out),
    )


def fitted(folds: Iterable[Fold], terms: tuple[str, ...]) -> LinearFit:
    """The one regression on these columns of all folds."""
    folds = list(folds)
    columns = {name: np.concatenate([f.columns[name] for f in folds]) for name in terms}
    return linear_fit(np.concatenate([f.torque for f in folds]), columns)


def residual(data: Fold, fit: LinearFit) -> Array:
    """What a fit leaves of a fold's torque [N*m]."""
    return data.torque - sum((fit[name] * data.columns[name] for name in fit.names), np.zeros_like(data.torque))


def compare(torque: Array, candidates: Sequence[Candidate]) -> list[Score]:
    """Scores of models of the same torque (n,), in the order given; `rank` is by BIC.

    BIC = m ln(mean squared residual) + p ln m (Schwarz, Ann. Stat. 6, 1978), with m effective samples for n: a filtered
    signal has far fewer independent ones, and n of them would buy any term that is not exactly 0. One m serves
    all models of a torque: that of the smallest residual, which has least of a model's own faults in it. Residuals
    below rounding count as rounding: of models that fit exactly, the one with fewest parameters ranks first.
    """
    rounding = max(ROUNDING * float(np.mean(torque**2)), np.finfo(float).tiny)
    power = [max(float(np.mean(c.residual**2)), rounding) for c in candidates]
    m = effective_samples(candidates[int(np.argmin(power))].residual)
    bic = [m * np.log(s) + c.parameters * np.log(m) for s, c in zip(power, candidates, strict=True)]
    return [
        Score(
            c.model,
            c.terms,
            c.parameters,
            variance_accounted_for(torque, c.residual),
            variance_accounted_for(torque, c.held_out_residual),
            float(b),
            m,
            1 + sum(bool(other < b) for other in bic),
        )
        for c, b in zip(candidates, bic, strict=True)
    ]


def effective_samples(residual: Array) -> float:
    """Number of independent samples whose mean square is as sure as that of these correlated ones (n,).

    n / sum of rho_k^2 over all lags k (Bayley and Hammersley, J. R. Stat. Soc. Suppl. 8, 1946); the autocorrelation rho
    is looked at up to a tenth of the record, less the squares that it would have by chance. A residual that does not
    vary at all (an exact fit) counts as n independent samples.
    """
    n, lags = len(residual), int(LAGS * len(residual))
    centred = residual - np.mean(residual)
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    covariance = np.fft.irfft(spectrum)[: lags + 1]
    if covariance[0] <= n * ROUNDING * float(np.mean(residual**2)):
        return float(n)
    rho = covariance / covariance[0]
    return float(np.clip(n * (1 + 2 * LAGS) / (1 + 2 * np.sum(rho[1:] ** 2)), 2.0, n))
