"""Headline numbers of the rendered impedance, by controller and desired impedance."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import polars as pl

from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.report.headline import (
    LABELS,
    Example,
    Headline,
    HeadlineLabel,
    HeadlineValue,
    of_group,
    with_controller,
    with_end,
)
from osl_analysis.report.headline_statistics import (
    FOR_MOTION,
    KIND_OF_FIT,
    over_fits,
)
from osl_analysis.stats.repeats import counted, doubtful_count, doubts_of_trials, own_condition
from osl_analysis.table import with_viscous_damping

# largest number of conditions, or of trials without a stated one, that the summary lists one by one
MOST_UNSTATED = 8
ESTIMATES_OF_CONDITION = ("K", "B", "I", "B_viscous", "f_C")


def impedance_headlines(impedance: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The numbers of the rendered impedance by controller (None: without one), those of the draft
    first. For each condition they are means over its trials; the condition of Fig. 4 comes
    first."""
    present = set(impedance["controller"])
    further = sorted(present - {*CONTROLLERS, None})
    for controller in (*CONTROLLERS, *further, None):
        if controller not in present:
            continue
        is_controller = pl.col("controller").eq_missing(pl.lit(controller, pl.String))
        fits = impedance.filter(is_controller)
        is_only = len(present) == 1
        yield from errors_of_controller(fits, example, controller, is_only)
        yield from numbers_of_conditions(fits, example, controller, is_only)


def errors_of_controller(
    fits: pl.DataFrame, example: Example, controller: str | None, is_only: bool
) -> Iterator[Headline]:
    """How well one controller renders what it was asked for, over its trials, and the VAF of fits
    to single amplitudes, or to all of a trial with one amplitude."""
    labels = {}
    for quantity, label in LABELS["impedance"].items():
        labels[quantity] = with_controller(label, controller, example, is_only)
    is_of_whole = pl.col("amplitude_deg").is_null()
    trials = fits.filter(is_of_whole)
    has_one_fit = pl.lit(False)
    if "trial" in fits.columns:
        has_one_fit = pl.len().over("trial") == 1
    is_single = ~is_of_whole | has_one_fit
    single = doubts_of_trials(fits).filter(is_single)
    used = counted(trials)
    used_single = counted(fits).filter(is_single)
    VAF = used_single["VAF"]
    yield from over_fits(labels["VAF_median"], VAF, np.median, single, used_single)
    yield from over_fits(labels["VAF_mean"], VAF, np.mean, single, used_single)
    K_bias_percent = 100 * (used["K"] / used["K_d"] - 1)
    yield from over_fits(labels["K_bias"], K_bias_percent, np.mean, trials, used)
    label_of_B = labels["B_error"]
    if used["B_viscous"].count():
        label_of_B = with_end(label_of_B, "viscous where friction is certain")
    B_error = (with_viscous_damping(used)["B"] - used["B_d"]).abs()
    yield from over_fits(label_of_B, B_error, np.mean, trials, used)
    if "torque_error" in used.columns:
        yield from over_fits(labels["torque_error"], used["torque_error"], np.mean, trials, used)


def numbers_of_conditions(
    fits: pl.DataFrame, example: Example, controller: str | None, is_only: bool
) -> Iterator[Headline]:
    """The estimates of each desired impedance of one controller, the `example` first. Its macros
    also have the names of a condition like the others."""
    trials = fits.filter(pl.col("amplitude_deg").is_null())
    yield from numbers_of_condition(trials, example, controller, is_only, is_other=False)
    desired = trials.drop_nulls("K_d").select("K_d", "B_d").unique().sort("K_d", "B_d")
    are_many = len(desired) > MOST_UNSTATED
    for K_d, B_d in desired.rows():
        is_example = (K_d, B_d) == (example.K_d, example.B_d)
        condition = Example(K_d, B_d)
        numbers = numbers_of_condition(trials, condition, controller, is_only, is_other=True)
        for number in numbers:
            yield replace(number, is_macro_only=are_many or is_example)


def numbers_of_condition(
    trials: pl.DataFrame, example: Example, controller: str | None, is_only: bool, is_other: bool
) -> Iterator[Headline]:
    """K, B, I and friction of the trials of one desired impedance. It is named if it `is_other`
    than that of Fig. 4. Without a desired impedance, trials are listed one by one."""
    has_K_d = pl.col("K_d").eq_missing(pl.lit(example.K_d, pl.Float64))
    has_B_d = pl.col("B_d").eq_missing(pl.lit(example.B_d, pl.Float64))
    of_condition = trials.filter(has_K_d, has_B_d)
    # trials that nobody stated to be alike have no common mean
    is_unstated = example.K_d is None and len(of_condition) > 1
    of_condition = of_condition.with_columns(own_condition=own_condition(of_condition))
    parts = of_condition.partition_by("own_condition", maintain_order=True)
    if len(parts) > MOST_UNSTATED:
        return
    counted_parts = [counted(part) for part in parts]
    pairs = zip(parts, counted_parts, strict=True)
    for (part, counted_part), symbol in product(pairs, ESTIMATES_OF_CONDITION):
        candidates = part.drop_nulls(symbol)
        used = counted_part.drop_nulls(symbol)
        label = LABELS["impedance"][f"{symbol}_example"]
        label = with_controller(label, controller, example, is_only)
        if is_other:
            stated = [f"{name} {value:g}" for name, value in example.stated().items()]
            label = replace(of_group(label, ", ".join(stated)), meaning=label.meaning)
        if is_unstated:
            label = of_group(label, part["trial"][0])
        if len(candidates) == 1:
            yield number_of_trial(label, candidates, symbol)
        else:
            yield from over_fits(label, used[symbol], np.mean, candidates, used)


def number_of_trial(label: HeadlineLabel, trial: pl.DataFrame, symbol: str) -> Headline:
    """An estimate of the only trial of a condition, with its own interval."""
    row = trial.row(0, named=True)
    estimate = HeadlineValue(
        value=row[symbol],
        n=1,
        n_doubtful=doubtful_count(trial)[0],
        amplitudes_low=row.get(f"{symbol}_amplitudes_low"),
        amplitudes_high=row.get(f"{symbol}_amplitudes_high"),
    )
    kind = KIND_OF_FIT.get(row["interval_method"], FOR_MOTION)
    estimate = estimate.with_interval(row[f"{symbol}_low"], row[f"{symbol}_high"], kind)
    return Headline(label, estimate)
