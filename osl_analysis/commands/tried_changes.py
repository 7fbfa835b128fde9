# SPDX-License-Identifier: Apache-2.0
"""What may mend a recording whose fit is refused by a wrong sign, unit or channel.

The error names the changes of the source file that may mend it (`errors.Change`). They are tried on
the recording, and those with which the trial can be fitted become its remedy. A fit that is not
refused passes through here unchanged.

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

FITS_WORSE = 2.0  # times what the best change leaves of the torque, from which one is no remedy
VAF_ROUNDING = 1e-6  # percent of the torque's variance; less is rounding
USUAL_OF_K_D = (0.5, 1.5)  # K over the stated K_d, beyond which a change is no remedy

Stated = ParamSpec("Stated")
"""What a fit takes beside its trial."""
TrialFit = Callable[Concatenate[Trial, Stated], FitTables]


def tries_changes(fit: TrialFit[Stated]) -> TrialFit[Stated]:
    """Make a fit whose refusal has what makes the trial fit as its remedy, where a change does.

    It also refuses, with InputError, estimates that no joint has where angle and torque explain
    each other better in exchanged channels.
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
    fault_probability: float = 0.0  # of the recording

    @property
    def unexplained(self) -> float:
        """What the fit leaves of the torque's variance [percent]."""
        return max(100.0 - float(self.row["VAF"]), VAF_ROUNDING)

    @property
    def text(self) -> str:
        """What to do, and the first estimate that it gives."""
        name = estimated(self.row)[0]
        return (
            f"{self.change.words}: {name} {estimate_text(self.row, name)} {printed_units()[name]}"
        )


def check_not_swapped(refit: Callable[[Trial], FitTables], trial: Trial, tables: FitTables) -> None:
    """Refuse estimates that no joint has, with InputError, if angle and torque explain each other
    much better in exchanged channels, and without a fault. A late torque makes B negative, too, and
    is late in exchanged channels as well."""
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

    The changes of the lowest rank are returned with which it can be fitted to possible estimates,
    and about as well as with the best of them."""
    expanded = []
    for change in changes:
        column = change.other_unit_of
        expanded += in_other_units(trial, [column]) if column else [change]
    expanded.sort(key=lambda change: change.rank)
    for _, of_rank in groupby(expanded, key=lambda change: change.rank):
        outcomes = [outcome_of(refit, trial, change) for change in of_rank]
        possible = [outcome for outcome in outcomes if outcome and is_physical(outcome.row)]
        if possible:
            most = FITS_WORSE * min(outcome.unexplained for outcome in possible)
            return [outcome for outcome in possible if outcome.unexplained <= most]
    return []


def outcome_of(refit: Callable[[Trial], FitTables], trial: Trial, change: Change) -> Outcome | None:
    """What the fit gives with a change; None where it is refused."""
    try:
        tables = refit(changed(trial, change))
    except OslAnalysisError:
        return None
    budget = tables.estimates.get("budget", table_of([], "budget"))
    faults = budget.filter(estimate="K", part="fault").drop_nulls("standard")
    weighed = faults.filter(basis="weighed")["probability"]
    # where none was weighed, a fault is not ruled out
    return Outcome(change, tables.row, float(weighed.sum()) if len(faults) else 1.0)


def changed(trial: Trial, change: Change) -> Trial:
    """The recording with columns that are renamed, or multiplied by a factor."""
    samples = trial.samples.rename(dict(change.renamed))
    samples = samples.with_columns(pl.col(name) * by for name, by in change.factors.items())
    return replace(trial, samples=samples, clocks={})


def is_physical(row: Mapping[str, Any]) -> bool:
    """Whether a fit gives what a joint can have: a stiffness that is told from 0 and near a stated
    K_d, and no negative damping."""
    first = estimated(row)[0]
    low = row.get(f"{first}_low")
    if first in ("K", "K_s") and low is not None and low <= 0:
        return False
    if (row.get("B_high") or 0.0) < 0:
        return False
    of_K_d = row.get("K_over_K_d")
    return of_K_d is None or USUAL_OF_K_D[0] <= of_K_d <= USUAL_OF_K_D[1]
