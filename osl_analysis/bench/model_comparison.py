"""Rival models of belt, transmission and rendered impedance: scores per trial, and a comparison over trials."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.belt import BeltTrial
from osl_analysis.bench.drivetrain_rival import DrivetrainTrial, drivetrain_candidates
from osl_analysis.bench.linear_rivals import (
    BELT_MODELS,
    SECOND_ORDER_MODELS,
    TRANSMISSION_MODELS,
    Fold,
    Terms,
    belt_fold,
    held_out_by_amplitude,
    impedance_fold,
    scores_against_others,
    transmission_fold,
)
from osl_analysis.bench.moving_record import MovingRecord, consecutive_parts
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.model.compensator import Gains
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.stats.comparison import Score, loss_behind_best, mean_over_trials, rank_words, score_models
from osl_analysis.trial import Array

HELD_OUT_BY_TRIAL = ("belt", "transmission")
"""Experiments in which each trial is predicted from the other trials; elsewhere each amplitude from the others."""
SCORE_COLUMNS = ("experiment", "controller", "trial", "model", "VAF_held_out", "BIC")
"""Columns of `model_comparison.csv` that its summary uses."""
PLACE = ("joint", "side")
"""Columns by which its summary is split too, where the table has them."""
OF_MODEL = ("experiment", *PLACE, "controller", "model", "terms", "parameters")
SMALLEST_LOSS = 1e-9
"""Percent of the variance below which what a model leaves is rounding error."""
SAMPLES_PER_PERIOD = 6
"""Samples kept per period of the filter's cut-off. More of them cost time and add no information."""


def belt_scores(trials: Iterable[BeltTrial]) -> pl.DataFrame:
    """Rows of `model_comparison.csv`: the belt models on each trial, predicted by fits to all the others."""
    return scores_by_trial("belt", {belt.name: belt_fold(belt.theta_s, belt.torque) for belt in trials}, BELT_MODELS)


def transmission_scores(trials: Iterable[SteppedSineTrial], sign_width: float) -> pl.DataFrame:
    """Rows of `model_comparison.csv`: the transmission models on each trial, predicted by fits to all the others.

    They smooth the sign of the velocity over `sign_width` [rad/s].
    """
    folds = {trial.name: whole_transmission_fold(trial, sign_width) for trial in trials}
    return scores_by_trial("transmission", folds, TRANSMISSION_MODELS)


def whole_transmission_fold(trial: SteppedSineTrial, sign_width: float) -> Fold:
    """All amplitudes of a trial as one fold; the sign of the velocity passes the filter of the torque."""
    direction = trial.low_pass(np.tanh(trial.motion.omega / sign_width), trial.rate_hz)
    rows = np.concatenate(thinned_amplitudes(trial))
    return transmission_fold(trial.motion[rows], direction[rows], trial.filtered_torque[rows])


def drivetrain_of(
    trial: SteppedSineTrial | MovingRecord, gains: Gains, p: DrivetrainParameters, sign_width: float
) -> DrivetrainTrial:
    """One trial against the controller, thinned, for the drivetrain model with the gains that the leg was given."""
    return DrivetrainTrial(
        name=trial.name,
        theta=trial.theta,
        motion=trial.motion,
        torque=trial.filtered_torque,
        amplitude_rows=thinned_amplitudes(trial),
        rate_hz=trial.rate_hz,
        low_pass=trial.low_pass,
        gains=gains,
        p=p,
        sign_width=sign_width,
    )


def impedance_scores(trial: DrivetrainTrial, controller: str | None) -> pl.DataFrame:
    """Rows of `model_comparison.csv` for one trial against the controller: Eq. 15 and the drivetrain of Eq. 9.

    Each amplitude is predicted by fits to the others.
    """
    folds = [impedance_fold(trial.motion[rows], trial.torque[rows]) for rows in trial.amplitude_rows]
    linear = [held_out_by_amplitude(folds, model, terms) for model, terms in SECOND_ORDER_MODELS.items()]
    scores = score_models(np.concatenate([f.torque for f in folds]), [*linear, *drivetrain_candidates(trial)])
    return score_table("impedance", trial.name, scores, controller)


def thinned_amplitudes(trial: SteppedSineTrial | MovingRecord) -> list[NDArray[np.intp]]:
    """Usable rows of each amplitude, without rests and other amplitudes, thinned to `SAMPLES_PER_PERIOD`.

    A record of another motion has consecutive parts in their place.
    """
    step = max(int(trial.rate_hz / (SAMPLES_PER_PERIOD * trial.low_pass.cutoff_hz)), 1)
    if isinstance(trial, MovingRecord):
        rows = trial.rows
        return [rows[part][::step] for part in consecutive_parts(trial.samples)]
    thinned = [np.concatenate([np.arange(s.start, s.stop, step) for s in block.stretches]) for block in trial.blocks]
    return [rows if trial.usable is None else rows[trial.usable[rows]] for rows in thinned]


def scores_by_trial(experiment: str, folds: Mapping[str, Fold], models: Terms) -> pl.DataFrame:
    """A row per trial and model, from the folds by trial."""
    scored = zip(folds, scores_against_others(list(folds.values()), models), strict=True)
    return pl.concat([score_table(experiment, name, scores) for name, scores in scored])


def score_table(experiment: str, trial: str, scores: Sequence[Score], controller: str | None = None) -> pl.DataFrame:
    """A row per model of one trial; VAF in percent, `rank` by BIC, from 1 on."""
    place = {"experiment": experiment, "trial": trial, "controller": controller}
    return pl.DataFrame(
        [
            {
                **place,
                "model": score.model,
                "terms": score.terms,
                "parameters": score.parameters,
                "VAF": score.vaf,
                "VAF_held_out": score.vaf_held_out,
                "BIC": score.bic,
                "effective_samples": score.effective_samples,
                "rank": score.rank,
            }
            for score in scores
        ]
    )


def comparison_summary(scores: pl.DataFrame) -> pl.DataFrame:
    """A row per experiment, joint, side, controller and model: means over the trials of `model_comparison.csv`.

    `VAF_held_out` [percent]; `VAF_gain` over the experiment's first model, that of the draft; `unexplained_ratio`, the
    geometric mean of the unexplained variance divided by that of the first model; `VAF_behind` the model with the
    highest mean; `BIC_change` from the first model and `BIC_behind` the lowest mean. Differences are paired by trial.
    Each has the 95 % interval over trials. `by_VAF` and `by_BIC` are the words of `rank_words`.
    """
    keys = [key for key in ("experiment", *PLACE, "controller") if key in scores.columns]
    groups = scores.partition_by(keys, maintain_order=True)
    return pl.DataFrame([row for group in groups for row in standing_rows(group)], infer_schema_length=None)


def standing_rows(scores: pl.DataFrame) -> list[dict[str, object]]:
    """Rows of the summary for the trials of one experiment and controller, its models in the order of the table."""
    shared, own = scores["experiment"][0] in HELD_OUT_BY_TRIAL, [key for key in OF_MODEL if key in scores.columns]
    models = scores.unique("model", keep="first", maintain_order=True).select(own)
    vaf, bic = (scores_of_models(scores, column) for column in ("VAF_held_out", "BIC"))
    log_left = np.log(np.maximum(100 - vaf, SMALLEST_LOSS))
    vaf_words, bic_words = rank_words(-vaf, shared), rank_words(bic)
    vaf_behind, bic_behind = loss_behind_best(-vaf), loss_behind_best(bic)
    return [
        {
            **model,
            "trials": len(bic),
            **mean_with_bounds("VAF_held_out", vaf[:, i], shared),
            **mean_with_bounds("VAF_gain", vaf[:, i] - vaf[:, 0], shared),
            **mean_with_bounds("unexplained_ratio", log_left[:, i] - log_left[:, 0], shared, np.exp),
            **mean_with_bounds("VAF_behind", vaf_behind[:, i], shared),
            "by_VAF": vaf_words[i],
            **mean_with_bounds("BIC_change", bic[:, i] - bic[:, 0]),
            **mean_with_bounds("BIC_behind", bic_behind[:, i]),
            "by_BIC": bic_words[i],
        }
        for i, model in enumerate(models.to_dicts())
    ]


def scores_of_models(scores: pl.DataFrame, column: str) -> Array:
    """One score, shape (trials, models), of the trials that have it for every model."""
    values = scores.pivot("model", index="trial", values=column).drop("trial").to_numpy()
    return np.asarray(values[np.isfinite(values).all(axis=1)], dtype=float)


def mean_with_bounds(
    name: str, values: Array, shared: bool = False, scale: Callable[[float], float] = float
) -> dict[str, float | None]:
    """`name`, `name_low`, `name_high`: mean over trials (n,) and its 95 % interval, on a scale; else null."""
    mean = mean_over_trials(values, shared)
    numbers = {name: mean.mean, f"{name}_low": mean.low, f"{name}_high": mean.high}
    return {key: float(scale(value)) if np.isfinite(value) else None for key, value in numbers.items()}
