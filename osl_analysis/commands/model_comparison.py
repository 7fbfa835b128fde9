"""Rival models of belt, transmission and rendered impedance, from trials to rows of `model_comparison.csv`."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.belt import read_belt_trial
from osl_analysis.commands.stepped_sine import SteppedSineTrial, read_stepped_sine
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.fits.drivetrain import DrivetrainTrial, candidates
from osl_analysis.fits.model_comparison import (
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
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.compensator import select_gains
from osl_analysis.parameters import read_parameters
from osl_analysis.signals import LowPass
from osl_analysis.table_file import write_table

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
    low_pass = LowPass(settings.cutoff_hz, settings.order)
    direction = low_pass(np.tanh(record.motion.omega / sign_width), record.rate_hz)
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
        LowPass(settings.cutoff_hz, settings.order),
        select_gains(controller, K_d, B_d, p, weight),
        p,
        sign_width,
    )
    rivals = [*(held_out_parts(folds, *model) for model in SECOND_ORDER.items()), *candidates(drivetrain)]
    scores = compare(np.concatenate([fold.torque for fold in folds]), rivals)
    write_table(score_rows("impedance", record.name, scores), output)


def thinned(record: SteppedSineTrial, settings: DynamometerAnalysis) -> list[slice]:
    """Rows of each amplitude, no more of them than the filter leaves worth keeping."""
    step = max(int(record.rate_hz / (SAMPLES_PER_PERIOD * settings.cutoff_hz)), 1)
    return [slice(block.rows.start, block.rows.stop, step) for block in record.blocks]


def repeats_table(experiment: str, folds: Mapping[str, Fold], models: Terms) -> pl.DataFrame:
    """A row per trial and model; the folds by trial."""
    scored = {name: held_out_repeats(list(folds.values()), models, k) for k, name in enumerate(folds)}
    return pl.concat([score_rows(experiment, name, scores) for name, scores in scored.items()])


def score_rows(experiment: str, trial: str, scores: Iterable[Score]) -> pl.DataFrame:
    """Rows of one trial; VAF in percent, ranks from 1, `rank` by BIC."""
    return pl.DataFrame(
        [
            {
                "experiment": experiment,
                "trial": trial,
                "model": score.model,
                "terms": score.terms,
                "parameters": score.parameters,
                "VAF": score.vaf,
                "VAF_held_out": score.vaf_held_out,
                "BIC": score.bic,
                "effective_samples": score.effective_samples,
                "rank_held_out": score.rank_held_out,
                "rank": score.rank,
            }
            for score in scores
        ]
    )
