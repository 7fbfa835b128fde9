"""Remedies that are tried on the recording before they are printed.

An error names changes that may mend its recording (`errors.Change`). Each is made in memory, and
the trial is fitted again. Those that help are the remedy, with what they give. This costs time only
where a fit is refused."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from inspect import signature
from itertools import groupby, pairwise
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
import polars as pl

from osl_analysis.bench.fit_tables import FitTables
from osl_analysis.commands.estimates import estimated, interval_text, printed_units
from osl_analysis.commands.fit import fit_settings, function_of, job_of
from osl_analysis.errors import Change, OslAnalysisError
from osl_analysis.files import default_config
from osl_analysis.ingest.examine import in_other_units
from osl_analysis.ingest.guard import leaps_of_trial
from osl_analysis.signals.grid import with_stamp_evidence
from osl_analysis.trial import Trial

MOST_LEAPS = 4  # of a sensor that failed once or twice
BESIDE_LEAP_S = 0.2  # left out at each side of a leap, which the filter spreads
FITS_WORSE = 2.0  # times what the best change leaves unexplained, from which one is no remedy
LEAST_UNEXPLAINED = 1e-6  # percent; less is rounding
MOST_TOLD = 5  # estimates that a remedy names
NOT_TOLD = ("offset", "drift", "K_secant", "K_unloading", "energy_stored", "energy_returned")
"""Estimates that do not show whether a change helps."""


@dataclass(frozen=True)
class Outcome:
    """A change that helps, and the estimates that it gives."""

    change: Change
    row: Mapping[str, Any]

    @property
    def unexplained(self) -> float:
        """What the fit leaves of the torque's variance [percent]; the same for all without a
        VAF."""
        return max(100.0 - float(self.row.get("VAF") or 0.0), LEAST_UNEXPLAINED)

    @property
    def text(self) -> str:
        """The estimates: the first with its interval and unit."""
        first, *others = [name for name in estimated(self.row) if name not in NOT_TOLD][:MOST_TOLD]
        value, high = self.row[first], self.row.get(f"{first}_high")
        interval = interval_text(value, self.row.get(f"{first}_low"), high)
        unit = printed_units().get(first)
        texts = [" ".join(filter(None, [f"{first} {value:.3g}", interval, unit]))]
        texts += [f"{name} {self.row[name]:.2g}" for name in others]
        return ", ".join(texts)


P = ParamSpec("P")  # the arguments of a fit
T = TypeVar("T")  # its tables


def remedies_tried(fit: Callable[P, T]) -> Callable[P, T]:
    """Decorate the fit of a trial: what is refused gets the changes that help as its
    remedy: those that the error names, or else to leave out where a sensor failed."""

    @wraps(fit)
    def fitted(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return fit(*args, **kwargs)
        except OslAnalysisError as error:
            given = signature(fit).bind(*args, **kwargs).arguments
            helpful = tried(fit, given, error.changes)
            if not helpful:
                helpful = tried(fit, given, changes_by_leaps(given["trial"]))
            if not helpful:
                raise
            raise type(error)(f"{error.reason}; {remedy_of(helpful)}") from error

    return fitted


def tried(
    fit: Callable[..., Any], given: Mapping[str, Any], changes: Sequence[Change]
) -> list[Outcome]:
    """Try changes on a recording.

    Parameters
    ----------
    fit : callable
        The fit that was refused, without remedies.
    given : Mapping
        Its arguments by name: `trial` and `settings` are changed.
    changes : sequence of Change

    Returns
    -------
    list of Outcome
        Of the changes with which the trial can be fitted, and fits about as well as with the best.
    """
    helpful: list[Outcome] = []
    expanded: list[Change] = []
    for change in changes:
        column = change.other_unit_of
        expanded += in_other_units(given["trial"], [column]) if column else [change]
    for change in expanded:
        arguments = {**given, "trial": changed(given["trial"], change)}
        if change.windows and "windows" in signature(fit).parameters:
            arguments["windows"] = change.windows
        elif change.windows:
            arguments["trial"] = arguments["trial"].within(change.windows)
        if change.settings:
            arguments["settings"] = given["settings"].model_copy(update=change.settings)
        fit_it = fit
        if change.experiment:
            fit_it, settings = fit_of(change.experiment)
            arguments = {"trial": arguments["trial"], **settings}
        try:
            tables = fit_it(**arguments)
        except OslAnalysisError:
            continue
        helpful.append(Outcome(change, last_row(tables)))
    least = min((outcome.unexplained for outcome in helpful), default=0.0)
    return [outcome for outcome in helpful if outcome.unexplained <= FITS_WORSE * least]


def changes_by_leaps(trial: Trial) -> list[Change]:
    """The longest part of a recording without samples of angle or torque that leap off their
    curve; none where none or many do."""
    found = [leaps for leaps in leaps_of_trial(trial) if leaps.count]
    if not 0 < sum(leaps.count for leaps in found) <= MOST_LEAPS:
        return []
    time = trial.samples["time"].to_numpy()
    at = sorted(t - float(time[0]) for leaps in found for t in leaps.times)
    parts = pairwise([-BESIDE_LEAP_S, *at, float(np.ptp(time)) + BESIDE_LEAP_S])
    first, last = max(parts, key=lambda part: part[1] - part[0])
    windows = f"{first + BESIDE_LEAP_S:.1f}-{last - BESIDE_LEAP_S:.1f}"
    worst = found[0]
    words = f"{worst.column} leaps in row {worst.row}: write windows `{windows}` in the sheet"
    return [Change(words, windows=windows)]


def changed(trial: Trial, change: Change) -> Trial:
    """The recording with a change of its columns."""
    if change.delays:
        origins = dict(trial.provenance.get("columns", {}))
        for name, delay_s in change.delays.items():
            origins[name] = {**origins.get(name, {}), "delay": delay_s}
        trial = replace(trial, provenance={**trial.provenance, "columns": origins}, clocks={})
    if not change.factors:
        return trial
    columns = [pl.col(name) * factor for name, factor in change.factors.items()]
    recording = replace(trial, samples=trial.samples.with_columns(columns), clocks={})
    return with_stamp_evidence(recording) if "time" in change.factors else recording


def fit_of(experiment: str) -> tuple[Callable[..., Any], dict[str, Any]]:
    """The fit of another experiment, without remedies, and its settings by argument: the default
    ones, since a job has those of its own experiment alone."""
    job = job_of(experiment)
    settings, _ = fit_settings(experiment, default_config())
    if job.parameters:
        settings["parameters"] = None
    if job.sheet:
        settings["condition"] = None
    fit: Any = function_of(job)
    return cast(Callable[..., Any], fit.__wrapped__), settings


def last_row(tables: FitTables | Mapping[str, pl.DataFrame]) -> Mapping[str, Any]:
    """The estimates of all of a trial, in its first table."""
    by_name = tables.estimates if isinstance(tables, FitTables) else tables
    return next(iter(by_name.values())).row(-1, named=True)


def remedy_of(helpful: Sequence[Outcome]) -> str:
    """What helps and what it gives; changes that give the same stand together."""
    alike = groupby(helpful, key=lambda outcome: outcome.text)
    texts = [f"{' or '.join(one.change.words for one in same)}: {text}" for text, same in alike]
    return "; or ".join(texts)
