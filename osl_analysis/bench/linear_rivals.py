"""Linear rival models of one torque: each is a choice of columns, fitted to some data and tested on others."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.bench.belt_fit import loaded_rows
from osl_analysis.signals import Motion
from osl_analysis.stats.comparison import Candidate, Score, score_models
from osl_analysis.stats.least_squares import GRAM_LIMIT
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

Terms = Mapping[str, tuple[str, ...]]
"""Names of the columns of each model, by the model's name."""
BELT_MODELS: Terms = {
    "M1": ("K_s",),
    "M2": ("K_s", "K_s2"),
    "M3": ("K_s", "T_h"),
    "M4": ("K_s", "K_s2", "T_h"),
}
"""T_h [N*m] is half the torque by which loading and unloading differ."""
TRANSMISSION_MODELS: Terms = {"M1": ("B_j", "J_j"), "M2": ("B_j", "J_j", "T_C")}
SECOND_ORDER_MODELS: Terms = {"M1": ("K", "B", "I")}
TURN = 0.1
"""Share of the peak deflection, at both ends, in which the belt's hysteresis may still reverse."""


@dataclass(frozen=True)
class Fold:
    """The data of one trial or one amplitude, without its own offset (and drift, where `nuisance` says so)."""

    torque: Array
    """Resisting torque [N*m], shape (n,)."""
    columns: Mapping[str, Array]
    """Every column that a model may use, shape (n,) each."""


def fold_without(torque: Array, columns: Mapping[str, Array], nuisance: Array) -> Fold:
    """The fold of a torque (n,) and its columns (n,) each, after least squares has removed the nuisance (n, k)."""
    return Fold(without(torque, nuisance), {name: without(column, nuisance) for name, column in columns.items()})


def without(signal: Array, nuisance: Array) -> Array:
    """What least squares on the nuisance (n, k) leaves of a signal (n,)."""
    basis, _ = np.linalg.qr(nuisance)
    return np.asarray(signal - basis @ (basis.T @ signal))


def offset_and_drift(n: int) -> Array:
    """A constant and a ramp over n uniform samples, as columns (n, 2)."""
    return np.column_stack([np.ones(n), np.linspace(-1, 1, n)])


def belt_fold(theta_s: Array, torque: Array) -> Fold:
    """One load-unload cycle: belt deflection [rad] and torque [N*m] (n,), without the ends where hysteresis reverses.

    Both branches cover the same deflections; otherwise their difference would look like curvature. Only the offset is
    removed: a drift is too similar to loading followed by unloading.
    """
    deflection = theta_s - theta_s[0]
    onset, peak, release = loaded_rows(deflection)
    share = np.abs(deflection / deflection[peak])
    rows = np.arange(onset, release)
    rows = rows[(share[rows] > TURN) & (share[rows] < 1 - TURN)]
    x, side = deflection[rows], np.where(rows <= peak, 1.0, -1.0) * np.sign(deflection[peak])
    return fold_without(torque[rows], {"K_s": x, "K_s2": x * np.abs(x), "T_h": side}, np.ones((len(rows), 1)))


def transmission_fold(motion: Motion, direction: Array, torque: Array) -> Fold:
    """One trial with the motor detached; `direction` is the smooth sign of omega, filtered as the torque was."""
    columns = {"B_j": motion.omega, "J_j": motion.alpha, "T_C": direction}
    return fold_without(torque, columns, offset_and_drift(len(torque)))


def impedance_fold(motion: Motion, torque: Array) -> Fold:
    """One amplitude of a trial against the controller, for Eq. 15."""
    columns = {"K": motion.theta, "B": motion.omega, "I": motion.alpha}
    return fold_without(torque, columns, offset_and_drift(len(torque)))


def scores_against_others(folds: Sequence[Fold], models: Terms) -> list[list[Score]]:
    """Each model on each trial: fitted to it for the BIC, and to all other trials for the VAF on data held out.

    With a single trial the VAF on data held out is NaN.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    own = {model: [fold_residual(f, fit_folds([f], terms)) for f in folds] for model, terms in models.items()}
    held_out = {model: held_out_residuals(folds, terms) for model, terms in models.items()}
    return [
        score_models(
            fold.torque,
            [
                Candidate(model, " + ".join(terms), len(terms), own[model][k], held_out[model][k])
                for model, terms in models.items()
            ],
        )
        for k, fold in enumerate(folds)
    ]


def held_out_by_amplitude(folds: Sequence[Fold], model: str, terms: tuple[str, ...]) -> Candidate:
    """A linear model of one trial whose folds are its amplitudes, each predicted by a fit to the others."""
    whole = fit_folds(folds, terms)
    return Candidate(
        model,
        " + ".join(terms),
        len(terms),
        np.concatenate([fold_residual(f, whole) for f in folds]),
        np.concatenate(held_out_residuals(folds, terms)),
    )


def held_out_residuals(folds: Sequence[Fold], terms: tuple[str, ...]) -> list[Array]:
    """What the fit to all other folds leaves of each fold's torque [N*m]; NaN if it is the only one.

    The normal equations of a fit are sums over its folds. Those of the others are the sum of the ones before and the
    sum of the ones behind, so that the time grows with the number of folds and not with its square, and no difference
    loses digits. Columns that are too alike for normal equations (`GRAM_LIMIT`) are fitted by `linear_fit`.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    if len(folds) == 1:
        return [np.full_like(folds[0].torque, np.nan)]
    matrices = [np.column_stack([fold.columns[name] for name in terms]) for fold in folds]
    grams = sums_of_others(np.array([X.T @ X for X in matrices]))
    moments = sums_of_others(np.array([X.T @ fold.torque for X, fold in zip(matrices, folds, strict=True)]))
    residuals = []
    for k, fold in enumerate(folds):
        lengths = np.sqrt(np.diag(grams[k]))
        if lengths.all() and np.linalg.cond(scaled := grams[k] / np.outer(lengths, lengths)) < GRAM_LIMIT**2:
            estimates = np.linalg.solve(scaled, moments[k] / lengths) / lengths
            residuals.append(fold.torque - matrices[k] @ estimates)
        else:
            others = fit_folds([other for other in folds if other is not fold], terms)
            residuals.append(fold_residual(fold, others))
    return residuals


def sums_of_others(values: Array) -> Array:
    """For each of the values (n, ...) the sum of all the others, (n, ...)."""
    none = np.zeros_like(values[:1])
    before = np.concatenate([none, np.cumsum(values[:-1], axis=0)])
    behind = np.concatenate([np.cumsum(values[:0:-1], axis=0)[::-1], none])
    return np.asarray(before + behind)


def fit_folds(folds: Iterable[Fold], terms: tuple[str, ...]) -> LinearFit:
    """One regression on these columns of all folds."""
    folds = list(folds)
    columns = {name: np.concatenate([f.columns[name] for f in folds]) for name in terms}
    return linear_fit(np.concatenate([f.torque for f in folds]), columns)


def fold_residual(fold: Fold, fit: LinearFit) -> Array:
    """What a fit leaves of a fold's torque [N*m]."""
    return fold.torque - fit.predicted(fold.columns)
