"""Rival models of belt, transmission and rendered impedance: scores per trial, and a comparison over trials.

A linear rival is a choice of columns. The drivetrain of Eq. 9 predicts the torque from the measured angle. Compensated
beside uncompensated, every difference is that of two trials that were asked for the same impedance.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.components import PLACE, loaded_rows
from osl_analysis.bench.prediction import predicted_torque
from osl_analysis.bench.record import Record
from osl_analysis.model.compensator import CONTROLLERS, Controller, Gains
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.stats.regression import linear_fit
from osl_analysis.stats.repeats import (
    Candidate,
    alike_sizes,
    loss_behind_best,
    mean_over_trials,
    rank_words,
    score_models,
)
from osl_analysis.trial import Array

Terms = Mapping[str, tuple[str, ...]]  # names of the columns of each model, by the model's name
BELT_MODELS: Terms = {"M1": ("K_s",), "M2": ("K_s", "K_s2"), "M3": ("K_s", "T_h"), "M4": ("K_s", "K_s2", "T_h")}
"""T_h [N*m] is half the torque by which loading and unloading differ."""
TRANSMISSION_MODELS: Terms = {"M1": ("B_j", "J_j"), "M2": ("B_j", "J_j", "T_C")}
SCORE_COLUMNS = ("experiment", "controller", "trial", "model", "VAF_held_out", "BIC")
"""Columns of `model_comparison.csv` that its summary uses."""
GIVEN = np.ones(3)
"""The three fitted numbers of Eq. 9 at their given values: K_1 divided by its given value, 1 plus the change of B_1
divided by (K_1 J_m)^1/2, and friction divided by that of the parameter file."""


@dataclass(frozen=True)
class Fold:
    """Torque (n,) [N*m] and every column (n,) that a model may use, of one trial or one amplitude."""

    torque: Array
    columns: Mapping[str, Array]


def fold_of(torque: Array, columns: Mapping[str, Array], drifts: bool = True) -> Fold:
    """The fold after least squares has removed an offset of its own, and drift where it may have one."""
    return Fold(without_offset(torque, drifts), {name: without_offset(x, drifts) for name, x in columns.items()})


def without_offset(signal: Array, drifts: bool = True) -> Array:
    """A signal (n,) without an offset and a ramp over its uniform samples."""
    n = len(signal)
    basis, _ = np.linalg.qr(np.column_stack([np.ones(n), *([np.linspace(-1, 1, n)] if drifts else [])]))
    return np.asarray(signal - basis @ (basis.T @ signal))


def belt_fold(theta_s: Array, torque: Array) -> Fold:
    """One load-unload cycle: belt deflection [rad] and torque [N*m] (n,), without a tenth at both ends, where the
    hysteresis may still reverse.

    Both branches cover the same deflections; otherwise their difference would look like curvature. Only the offset is
    removed: a drift is too similar to loading followed by unloading.
    """
    deflection = theta_s - theta_s[0]
    onset, peak, release = loaded_rows(deflection)
    share = np.abs(deflection / deflection[peak])
    rows = np.arange(onset, release)
    rows = rows[(share[rows] > 0.1) & (share[rows] < 0.9)]
    x, side = deflection[rows], np.where(rows <= peak, 1.0, -1.0) * np.sign(deflection[peak])
    return fold_of(torque[rows], {"K_s": x, "K_s2": x * np.abs(x), "T_h": side}, drifts=False)


def left_of(fold: Fold, fitted: Sequence[Fold], terms: tuple[str, ...]) -> Array:
    """What a fit of these columns to some folds leaves of another one's torque [N*m]; NaN where there is none to fit.

    Raises as `linear_fit`.
    """
    if not fitted:
        return np.full_like(fold.torque, np.nan)
    y = np.concatenate([f.torque for f in fitted])
    columns = {name: np.concatenate([f.columns[name] for f in fitted]) for name in terms}
    estimates = linear_fit(y, columns).estimates
    return np.asarray(fold.torque - np.array([fold.columns[name] for name in terms]).T @ estimates)


def linear_rivals(folds: Sequence[Fold], tested: Sequence[Fold], models: Terms) -> list[Candidate]:
    """Each model on some of the folds: fitted to these for the BIC, and for the VAF on data held out each predicted by
    a fit to all the others. With a single fold this VAF is NaN."""
    rivals = []
    for name, terms in models.items():
        residual = np.concatenate([left_of(fold, tested, terms) for fold in tested])
        rest = [left_of(fold, [other for other in folds if other is not fold], terms) for fold in tested]
        rivals.append(Candidate(name, " + ".join(terms), len(terms), residual, np.concatenate(rest)))
    return rivals


@dataclass(frozen=True)
class DrivetrainTrial:
    """One trial for the drivetrain model."""

    record: Record
    amplitude_rows: Sequence[NDArray[np.intp]]  # rows of each amplitude
    gains: Gains  # control gains that the leg was given
    p: DrivetrainParameters
    sign_width: float  # velocity [rad/s] over which the sign of the velocity is smoothed

    @property
    def unit_damping(self) -> float:
        """The actuator's own scale of damping, (K_1 J_m)^1/2 [N*m*s/rad]."""
        return float(np.sqrt(self.gains.K_1 * self.p.J_m))

    def predicted(self, x: Array) -> Array:
        """Filtered resisting torque [N*m], shape (n,), for the three numbers x of `GIVEN`.

        Raises InputError if the model grows without bounds with these gains.
        """
        K_1, B_1 = x[0] * self.gains.K_1, self.gains.B_1 + (x[1] - 1) * self.unit_damping
        law = Controller(Gains(float(K_1), float(B_1), self.gains.cancels_friction), self.p, self.sign_width)
        return predicted_torque(self.record, law, self.p, float(x[2]))

    def residuals(self, x: Array) -> Array:
        """What the model with the three numbers x leaves of the torque of all amplitudes, one after the other. Each has
        its own offset and drift."""
        left = self.record.filtered_torque - self.predicted(x)
        return np.concatenate([without_offset(left[rows]) for rows in self.amplitude_rows])


def drivetrain_rivals(trial: DrivetrainTrial) -> list[Candidate]:
    """Eq. 9, linear (M2), with the friction of the parameter file (M3), and with three numbers fitted (M4): K_1, B_1
    and the size of the friction. Of M2 and M3 nothing is fitted, so that all data are held out.

    At least 1 % of the damping B_m + B_1 is left, and a tenth of K_1. M4 is fitted to all amplitudes, and to all but
    one by one Gauss-Newton step from there, on the rows of the others. A second fit in full takes three times as long
    and changes the VAF on data held out by a hundredth of a percent.
    """
    linear = replace(trial, gains=replace(trial.gains, cancels_friction=False)).residuals(np.array([1.0, 1.0, 0.0]))
    given = trial.residuals(GIVEN)
    lowest = np.array([0.1, 1 - 0.99 * (trial.p.B_m + trial.gains.B_1) / trial.unit_damping, 0.0])
    # because friction stops and starts, the torque is rough at steps below a hundredth
    best = scipy.optimize.least_squares(
        trial.residuals, GIVEN, bounds=(lowest, np.inf), diff_step=[1e-2] * 3, xtol=1e-3, ftol=1e-4, max_nfev=10
    )
    x, jacobian, residual = (np.asarray(u, dtype=float) for u in (best.x, best.jac, best.fun))
    start, held_out = 0, []
    for rows in trial.amplitude_rows:
        own = slice(start, start + len(rows))
        step, *_ = np.linalg.lstsq(np.delete(jacobian, own, axis=0), -np.delete(residual, own), rcond=None)
        held_out.append(trial.residuals(np.maximum(x + step, lowest))[own])
        start += len(rows)
    fitted = "Eq. 9 + friction; K_1 and B_1 and friction fitted"
    return [
        Candidate("M2", "Eq. 9", 0, linear, linear),
        Candidate("M3", "Eq. 9 + friction", 0, given, given),
        Candidate("M4", fitted, len(GIVEN), residual, np.concatenate(held_out)),
    ]


def belt_scores(trials: Iterable[Record]) -> pl.DataFrame:
    """Rows of `model_comparison.csv`: the belt models on each trial, predicted by fits to all the others."""
    folds = {trial.name: belt_fold(trial.motion.theta, trial.filtered_torque) for trial in trials}
    return scores_by_trial("belt", folds, BELT_MODELS)


def transmission_scores(trials: Iterable[Record], sign_width: float) -> pl.DataFrame:
    """Rows of `model_comparison.csv`: the transmission models on each trial, predicted by fits to all the others. They
    smooth the sign of the velocity over `sign_width` [rad/s]; it passes the filter of the torque."""
    folds = {}
    for trial in trials:
        direction = trial.low_pass(np.tanh(trial.motion.omega / sign_width), trial.rate_hz)
        rows = np.concatenate(thinned_amplitudes(trial))
        columns = {"B_j": trial.motion.omega[rows], "J_j": trial.motion.alpha[rows], "T_C": direction[rows]}
        folds[trial.name] = fold_of(trial.filtered_torque[rows], columns)
        del trial  # one in memory at a time
    return scores_by_trial("transmission", folds, TRANSMISSION_MODELS)


def scores_by_trial(experiment: str, folds: Mapping[str, Fold], models: Terms) -> pl.DataFrame:
    """A row per trial and model, from the folds by trial."""
    rivals = {name: linear_rivals(list(folds.values()), [fold], models) for name, fold in folds.items()}
    return pl.concat([score_table(experiment, name, folds[name].torque, of) for name, of in rivals.items()])


def impedance_scores(trial: DrivetrainTrial, controller: str | None) -> pl.DataFrame:
    """Rows of `model_comparison.csv` for one trial against the controller: Eq. 15 and the drivetrain of Eq. 9 with the
    gains that the leg was given. Each amplitude is predicted by fits to the others."""
    folds, motion = [], trial.record.motion
    for rows in trial.amplitude_rows:
        columns = {"K": motion.theta[rows], "B": motion.omega[rows], "I": motion.alpha[rows]}
        folds.append(fold_of(trial.record.filtered_torque[rows], columns))
    rivals = [*linear_rivals(folds, folds, {"M1": ("K", "B", "I")}), *drivetrain_rivals(trial)]
    return score_table("impedance", trial.record.name, np.concatenate([f.torque for f in folds]), rivals, controller)


def thinned_amplitudes(trial: Record) -> list[NDArray[np.intp]]:
    """Usable rows of each amplitude, without rests and other amplitudes, thinned to six in a period of the cut-off:
    more of them cost time and add no information. A record of another motion has consecutive parts in their place."""
    step = max(int(trial.rate_hz / (6 * trial.low_pass.cutoff_hz)), 1)
    if not trial.is_stepped_sine:
        return [part[::step] for part in np.array_split(trial.rows(), 3)]
    moving = [trial.moving(label) for label in trial.groups.labels]
    thinned = [np.concatenate([np.arange(s.start, s.stop, step) for s in one]) for one in moving]
    return [rows[trial.usable[rows]] for rows in thinned]


def score_table(
    experiment: str, trial: str, torque: Array, rivals: Sequence[Candidate], controller: str | None = None
) -> pl.DataFrame:
    """A row per model of one trial."""
    place = {"experiment": experiment, "trial": trial, "controller": controller}
    named = [pl.lit(value, pl.String).alias(name) for name, value in place.items()]
    return score_models(torque, rivals).select(*named, pl.all())


def comparison_summary(scores: pl.DataFrame) -> pl.DataFrame:
    """A row per experiment, joint, side, controller and model: means over the trials of `model_comparison.csv`.

    `VAF_held_out` [percent]; `VAF_gain` over the experiment's first model, that of the draft; `unexplained_ratio`, the
    geometric mean of the unexplained variance divided by that of the first model; `VAF_behind` the model with the
    highest mean; `BIC_change` from the first model and `BIC_behind` the lowest mean. Differences are paired by trial.
    Each has the 95 % interval over trials. `by_VAF` and `by_BIC` are the words of `rank_words`.
    """
    keys, rows = [key for key in ("experiment", *PLACE, "controller") if key in scores.columns], []
    for group in scores.partition_by(keys, maintain_order=True):
        # elsewhere each amplitude is predicted from the others, and not each trial from the other trials
        shared = group["experiment"][0] in ("belt", "transmission")
        own = [*keys, *(key for key in ("model", "terms", "parameters") if key in scores.columns)]
        vaf, bic = (
            values[np.isfinite(values).all(axis=1)]  # (trials, models), of the trials that have it for every model
            for column in ("VAF_held_out", "BIC")
            for values in [group.pivot("model", index="trial", values=column).drop("trial").to_numpy().astype(float)]
        )
        log_left = np.log(np.maximum(100 - vaf, 1e-9))  # percent, below which what is left is rounding error
        vaf_words, bic_words = rank_words(-vaf, shared), rank_words(bic)
        vaf_behind, bic_behind = loss_behind_best(-vaf), loss_behind_best(bic)
        models = group.unique("model", keep="first", maintain_order=True).select(own).to_dicts()
        for i, model in enumerate(models):
            ratio = mean_with_bounds("unexplained_ratio", log_left[:, i] - log_left[:, 0], shared)
            row = {
                **model,
                "trials": len(bic),
                **mean_with_bounds("VAF_held_out", vaf[:, i], shared),
                **mean_with_bounds("VAF_gain", vaf[:, i] - vaf[:, 0], shared),
                **{name: None if value is None else float(np.exp(value)) for name, value in ratio.items()},
                **mean_with_bounds("VAF_behind", vaf_behind[:, i], shared),
                "by_VAF": vaf_words[i],
                **mean_with_bounds("BIC_change", bic[:, i] - bic[:, 0]),
                **mean_with_bounds("BIC_behind", bic_behind[:, i]),
                "by_BIC": bic_words[i],
            }
            rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def mean_with_bounds(name: str, values: Array, shared: bool = False) -> dict[str, float | None]:
    """`name`, `name_low`, `name_high`: mean over trials (n,) and its 95 % interval; else null."""
    mean = mean_over_trials(values, shared)
    numbers = {name: mean.mean, f"{name}_low": mean.low, f"{name}_high": mean.high}
    return {key: float(value) if np.isfinite(value) else None for key, value in numbers.items()}


COMPARED: Mapping[str, tuple[str, pl.Expr]] = {
    "torque_error": ("N*m", pl.col("torque_error")),
    "K_error": ("%", 100 * (pl.col("K") / pl.col("K_d") - 1).abs()),
    "B_error": ("N*m*s/rad", (pl.col("B") - pl.col("B_d")).abs()),
    "VAF": ("%", pl.col("VAF")),
}
"""Unit and value of what is compared; of all but the VAF less is better."""
ASKED = (*PLACE, "K_d", "B_d")


def compensation_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """`compensation.csv` from the rows of `impedance.csv`. Repeats of a condition count as their mean. The interval of
    a difference is Student's over pairs of trials: amplitudes of one trial are no independent pairs. Amplitudes are
    those that were commanded; where none is stated, the measured ones, which are alike."""
    size = "commanded_deg" if impedance["commanded_deg"].is_not_null().any() else "amplitude_deg"
    known = impedance.with_columns(alike_sizes(impedance[size].cast(pl.Float64)))
    known = known.drop_nulls(["K_d", "B_d"]).filter(pl.col("K_d") != 0)
    values = {name: value.mean() for name, (_, value) in COMPARED.items()}
    means = known.group_by(*ASKED, size, "controller").agg(**values)
    sides = [means.filter(pl.col("controller") == name).drop("controller") for name in CONTROLLERS]
    both = sides[0].join(sides[1], on=[*ASKED, size], nulls_equal=True).sort(*ASKED, size)
    whole, single = (both.filter(pl.col(size).is_null() == of_whole) for of_whole in (True, False))
    sets = [("trials", None, whole), ("amplitudes", None, single)]
    for by, rows in (("K_d", whole), ("B_d", whole), (size, single)):
        sets += [(by, at, rows.filter(pl.col(by) == at)) for at in rows[by].unique().sort()]
    found = []
    for by, at, rows in sets:
        for of_place in rows.partition_by(PLACE, maintain_order=True):
            place = of_place.select(PLACE).row(0, named=True)
            found += [{**place, **paired(of_place, name), "by": by, "at": at} for name in COMPARED]
    types: dict[str, Any] = dict.fromkeys((*PLACE, "quantity", "unit", "by"), pl.String) | {"at": pl.Float64}
    types |= {"pairs": pl.Int64, "better": pl.Int64} | dict.fromkeys(("compensated", "uncompensated"), pl.Float64)
    types |= dict.fromkeys(("difference", "difference_low", "difference_high"), pl.Float64)
    return pl.DataFrame(found, schema=types)


def paired(pairs: pl.DataFrame, name: str) -> dict[str, Any]:
    """One quantity in some pairs."""
    difference = pairs[name] - pairs[f"{name}_right"]
    by_trial = pairs.select("K_d", "B_d", difference=difference).group_by("K_d", "B_d").agg(pl.col("difference").mean())
    better = int((difference > 0 if name == "VAF" else difference < 0).sum())
    row = {"quantity": name, "unit": COMPARED[name][0], "pairs": len(pairs), "better": better}
    row |= {"compensated": pairs[name].mean(), "uncompensated": pairs[f"{name}_right"].mean()}
    return row | mean_with_bounds("difference", np.sort(by_trial["difference"].to_numpy()))
