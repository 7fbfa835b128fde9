"""Rival models of belt, transmission and rendered impedance, from trials to `model_comparison.csv` and its summary."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.bench.drivetrain_rival import DrivetrainTrial, candidates
from osl_analysis.bench.model_comparison import (
    BELT,
    SECOND_ORDER,
    TRANSMISSION,
    Fold,
    Score,
    Terms,
    belt_fold,
    compare,
    held_out_parts,
    held_out_repeats,
    impedance_fold,
    transmission_fold,
)
from osl_analysis.commands.belt import read_belt_trial
from osl_analysis.commands.stepped_sine import SteppedSineTrial, read_stepped_sine
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.compensator import select_gains
from osl_analysis.parameters import read_parameters
from osl_analysis.stats.standings import behind_best, over_trials, verdicts
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Array

REPEATS_HELD_OUT = ("belt", "transmission")
"""Experiments whose trials are predicted from each other; in the others each trial is held out from itself."""
SMALLEST_LOSS = 1e-9
"""Percent of the variance below which what a model leaves is rounding."""
SAMPLES_PER_PERIOD = 6
"""Samples kept per period of the filter's cut-off: what lies between them is interpolation, and costs time."""


def compare_repeats(
    experiment: str,
    trials: Sequence[Path],
    parameters: Path,
    settings: DynamometerAnalysis,
    sign_width: float,
    output: Path,
) -> None:
    """Models of `belt` or `transmission` on each trial, predicted by fits to all the others."""
    if experiment == "belt":
        belts = [read_belt_trial(trial, parameters, settings) for trial in trials]
        table = repeats_table(experiment, {b.name: belt_fold(b.theta_s, b.torque) for b in belts}, BELT)
    else:
        records = [read_stepped_sine(trial, settings) for trial in trials]
        folds = {record.name: transmission_record(record, settings, sign_width) for record in records}
        table = repeats_table(experiment, folds, TRANSMISSION)
    write_table(table, output)


def transmission_record(record: SteppedSineTrial, settings: DynamometerAnalysis, sign_width: float) -> Fold:
    """All amplitudes of a trial as one fold; the sign passes the filter of the torque."""
    direction = settings.low_pass(np.tanh(record.motion.omega / sign_width), record.rate_hz)
    rows = np.concatenate([np.r_[part] for part in thinned(record, settings)])
    return transmission_fold(record.motion[rows], direction[rows], record.filtered_torque[rows])


def compare_impedance(
    trial: Path,
    controller: str,
    K_d: float,
    B_d: float,
    parameters: Path,
    settings: DynamometerAnalysis,
    weight: Weight,
    sign_width: float,
    output: Path,
) -> None:
    """Eq. 15 against the drivetrain of Eq. 9 on one trial, each amplitude predicted from the others."""
    p, record = read_parameters(parameters), read_stepped_sine(trial, settings)
    parts = thinned(record, settings)
    folds = [impedance_fold(record.motion[part], record.filtered_torque[part]) for part in parts]
    drivetrain = DrivetrainTrial(
        record.theta,
        record.motion,
        record.filtered_torque,
        parts,
        record.rate_hz,
        settings.low_pass,
        select_gains(controller, K_d, B_d, p, weight),
        p,
        sign_width,
    )
    rivals = [*(held_out_parts(folds, *model) for model in SECOND_ORDER.items()), *candidates(drivetrain)]
    scores = compare(np.concatenate([fold.torque for fold in folds]), rivals)
    write_table(score_rows("impedance", record.name, scores, controller), output)


def thinned(record: SteppedSineTrial, settings: DynamometerAnalysis) -> list[slice]:
    """Rows of each amplitude, no more of them than the filter leaves worth keeping."""
    step = max(int(record.rate_hz / (SAMPLES_PER_PERIOD * settings.cutoff_hz)), 1)
    return [slice(block.rows.start, block.rows.stop, step) for block in record.blocks]


def repeats_table(experiment: str, folds: Mapping[str, Fold], models: Terms) -> pl.DataFrame:
    """A row per trial and model; the folds by trial."""
    scored = {name: held_out_repeats(list(folds.values()), models, k) for k, name in enumerate(folds)}
    return pl.concat([score_rows(experiment, name, scores) for name, scores in scored.items()])


def score_rows(experiment: str, trial: str, scores: Iterable[Score], controller: str | None = None) -> pl.DataFrame:
    """Rows of one trial; VAF in percent, `rank` by BIC, from 1 on."""
    return pl.DataFrame(
        [
            {
                "experiment": experiment,
                "trial": trial,
                "controller": controller,
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


def summarise(table: Path, output: Path) -> None:
    """Means over trials, differences to the first model and to the best, paired by trial, and who is preferred.

    Per experiment, controller and model: `VAF_held_out` [percent]; `VAF_gain` over the experiment's first model, the
    draft's; `unexplained_ratio`, the geometric mean of what is left of the variance over what the first model leaves;
    `VAF_behind` the model of the highest mean; `BIC_change` from the first model and `BIC_behind` the lowest. Each with
    the 95 % interval over trials; `by_VAF` and `by_BIC` are `verdicts`.
    """
    scores = read_table(table, required=("experiment", "controller", "trial", "model", "VAF_held_out", "BIC"))
    groups = scores.partition_by("experiment", "controller", maintain_order=True)
    write_table(pl.DataFrame([row for group in groups for row in standings(group)], infer_schema_length=None), output)


def standings(scores: pl.DataFrame) -> list[dict[str, object]]:
    """Rows of the summary for the trials of one experiment and controller, its models in the order of the table."""
    shared = scores["experiment"][0] in REPEATS_HELD_OUT
    models = scores.unique("model", keep="first", maintain_order=True)
    vaf, bic = (by_trial(scores, column) for column in ("VAF_held_out", "BIC"))
    left = np.log(np.maximum(100 - vaf, SMALLEST_LOSS))
    words, losses = (verdicts(-vaf, shared), verdicts(bic)), (behind_best(-vaf), behind_best(bic))
    return [
        {
            **model,
            "trials": len(bic),
            **bounds("VAF_held_out", vaf[:, i], shared),
            **bounds("VAF_gain", vaf[:, i] - vaf[:, 0], shared),
            **bounds("unexplained_ratio", left[:, i] - left[:, 0], shared, np.exp),
            **bounds("VAF_behind", losses[0][:, i], shared),
            "by_VAF": words[0][i],
            **bounds("BIC_change", bic[:, i] - bic[:, 0]),
            **bounds("BIC_behind", losses[1][:, i]),
            "by_BIC": words[1][i],
        }
        for i, model in enumerate(models.select("experiment", "controller", "model", "terms", "parameters").to_dicts())
    ]


def by_trial(scores: pl.DataFrame, column: str) -> Array:
    """One score, (trials, models), of the trials that have it for every model."""
    values = scores.pivot("model", index="trial", values=column).drop("trial").to_numpy()
    return np.asarray(values[np.isfinite(values).all(axis=1)], dtype=float)


def bounds(
    name: str, values: Array, shared: bool = False, scale: Callable[[float], float] = float
) -> dict[str, float | None]:
    """`name`, `name_low`, `name_high`: mean over trials (n,) and 95 % interval, on a scale; null if there is none."""
    found = over_trials(values, shared)
    numbers = {name: found.mean, f"{name}_low": found.low, f"{name}_high": found.high}
    return {key: float(scale(value)) if np.isfinite(value) else None for key, value in numbers.items()}
