# SPDX-License-Identifier: Apache-2.0
"""Find the remedy of a refused fit: a sign, unit or channel that makes the trial fit.

The error names the changes of the source file that may mend it (`errors.Change`). Each is tried on
the recording. Those with which the trial can be fitted become the remedy. A fit that is not refused
passes through here unchanged.

Example: `@tries_changes` before `def fit_belt_trial(trial, ...)`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from itertools import groupby
from typing import Any, Concatenate, ParamSpec

import polars as pl

from osl_analysis.base.errors import Change, InputError, OslAnalysisError
from osl_analysis.base.trial import Trial
from osl_analysis.commands.fit_results import FitTables, estimated, printed_units
from osl_analysis.dictionary.described import table_of
from osl_analysis.ingest.guard import in_other_units, swapped_channels
from osl_analysis.stats.budget import LIKELY
from osl_analysis.stats.rounding import estimate_text

FITS_WORSE = 2.0  # times the unexplained torque of the best change: beyond, a change is no remedy
VAF_ROUNDING = 1e-6  # percent of the torque's variance; less is rounding
USUAL_OF_K_D = (0.5, 1.5)  # K over the stated K_d, beyond which a change is no remedy

Stated = ParamSpec("Stated")
"""The arguments of a fit beside its trial."""
TrialFit = Callable[Concatenate[Trial, Stated], FitTables]


def tries_changes(fit: TrialFit[Stated]) -> TrialFit[Stated]:
    """Give a fit's refusal the changes that make the trial fit as its remedy.

    The fit also refuses impossible estimates, with InputError, if angle and torque explain each
    other better in exchanged channels.
    """

    @wraps(fit)
    def fit_or_advise(trial: Trial, /, *args: Stated.args, **kwargs: Stated.kwargs) -> FitTables:
        def refit(changed_trial: Trial) -> FitTables:
            return fit(changed_trial, *args, **kwargs)

        try:
            tables = fit(trial, *args, **kwargs)
            if not is_physical(tables.row):
                check_not_swapped(refit, trial, tables)
        except OslAnalysisError as error:
            helpful = diagnose(refit, trial, error.changes)
            if not helpful:
                raise
            remedy = "; or ".join(outcome.text for outcome in helpful)
            raise type(error)(error.reason, remedy) from error
        return tables

    return fit_or_advise


@dataclass(frozen=True)
class Outcome:
    """A change, and the row that the fit to all data then has."""

    change: Change
    row: Mapping[str, Any]
    fault_probability: float = 0.0  # that the changed recording has a fault

    @property
    def unexplained(self) -> float:
        """The unexplained share of the torque's variance [percent]."""
        return max(100.0 - float(self.row["VAF"]), VAF_ROUNDING)

    @property
    def text(self) -> str:
        """What to do, and the first estimate after it."""
        name = estimated(self.row)[0]
        return (
            f"{self.change.words}: {name} {estimate_text(self.row, name)} {printed_units()[name]}"
        )


def check_not_swapped(refit: Callable[[Trial], FitTables], trial: Trial, tables: FitTables) -> None:
    """Refuse impossible estimates, with InputError, if exchanged channels fit much better.

    Exchanged channels with a fault do not count: a late torque makes B negative, too, and is late
    in exchanged channels as well.
    """
    row = tables.row
    if not {"theta", "torque"} <= set(trial.columns):
        return
    changes = swapped_channels(trial, "theta", "torque")
    least = math.inf
    for outcome in diagnose(refit, trial, changes):
        if outcome.fault_probability < LIKELY:
            least = min(least, outcome.unexplained)
    if FITS_WORSE * least < Outcome(changes[0], row).unexplained:
        name = "B" if (row.get("B_high") or 0.0) < 0 else estimated(row)[0]
        raise InputError(
            f"trial {trial.name}: {name} = {row[name]:.3g} {printed_units()[name]}, which no"
            " joint has, and angle and torque explain each other better if they are exchanged",
            "swap their channels in the source file",
            changes=changes,
        )


def diagnose(
    refit: Callable[[Trial], FitTables], trial: Trial, changes: Sequence[Change]
) -> list[Outcome]:
    """Try sign, unit and swapped channels of a refused trial.

    Changes are returned with which the fit gives possible estimates and fits about as well as with
    the best change. All are of the lowest rank that has any.
    """
    expanded = []
    for change in changes:
        column = change.other_unit_of
        expanded += in_other_units(trial, [column]) if column else [change]
    expanded.sort(key=lambda change: change.rank)
    for _, changes_of_rank in groupby(expanded, key=lambda change: change.rank):
        outcomes = [outcome_of(refit, trial, change) for change in changes_of_rank]
        possible = [outcome for outcome in outcomes if outcome and is_physical(outcome.row)]
        if possible:
            most = FITS_WORSE * min(outcome.unexplained for outcome in possible)
            return [outcome for outcome in possible if outcome.unexplained <= most]
    return []


def outcome_of(refit: Callable[[Trial], FitTables], trial: Trial, change: Change) -> Outcome | None:
    """The outcome of the fit with a change; None where it is refused."""
    try:
        tables = refit(changed(trial, change))
    except OslAnalysisError:
        return None
    budget = tables.estimates.get("budget", table_of([], "budget"))
    faults = budget.filter(estimate="K", part="fault").drop_nulls("standard")
    weighed = faults.filter(basis="weighed")["probability"]
    # where no fault was weighed, none is ruled out
    return Outcome(change, tables.row, float(weighed.sum()) if len(faults) else 1.0)


def changed(trial: Trial, change: Change) -> Trial:
    """The recording with columns that are renamed, or multiplied by a factor."""
    samples = trial.samples.rename(dict(change.renamed))
    samples = samples.with_columns(pl.col(name) * by for name, by in change.factors.items())
    return replace(trial, samples=samples, clocks={})


def is_physical(row: Mapping[str, Any]) -> bool:
    """Whether a joint can have these estimates: a stiffness above 0 and near a stated K_d, and no
    negative damping."""
    first = estimated(row)[0]
    low = row.get(f"{first}_low")
    if first in ("K", "K_s") and low is not None and low <= 0:
        return False
    if (row.get("B_high") or 0.0) < 0:
        return False
    share_of_K_d = row.get("K_over_K_d")
    return share_of_K_d is None or USUAL_OF_K_D[0] <= share_of_K_d <= USUAL_OF_K_D[1]
