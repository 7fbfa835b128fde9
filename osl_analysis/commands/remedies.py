"""Remedies that are tried on the recording before they are printed.

A refused fit is made again, in memory, with a sign, a unit or a channel that its source file may
state wrongly. What makes it pass is the remedy, with what it gives. This costs time only where a
fit is refused.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import polars as pl

from osl_analysis.bench.fit_tables import FitTables
from osl_analysis.commands.estimates import estimated, interval_text, printed_units
from osl_analysis.errors import OslAnalysisError, Suspect
from osl_analysis.signals.grid import origin, with_stamp_evidence
from osl_analysis.trial import Trial, unit_of
from osl_analysis.units import si_factor

CONFUSED_UNITS = {"rad": ("rad", "deg", "mrad"), "N*m": ("N*m", "N*mm", "N*cm")}
"""By SI unit, the most usual ones first."""
POSSIBLE = (0.5, 1.5)  # K over the stated or predicted one, of a recording that is read rightly

T = TypeVar("T")  # the tables of a fit


@dataclass(frozen=True)
class Change:
    """A change of the source file, as the user writes it and as it changes the recording."""

    words: str
    factors: Mapping[str, float]  # of columns
    renamed: Mapping[str, str] = field(default_factory=dict)  # new names of columns


OTHER_TIMES = (
    Change("take a 1000 times larger `unit` of `time` (s for ms)", {"time": 1e3}),
    Change("take a 1000 times smaller `unit` of `time` (ms for s)", {"time": 1e-3}),
    Change("take a million times smaller `unit` of `time` (us for s)", {"time": 1e-6}),
)


def fit_or_advise(fit: Callable[..., T], arguments: Mapping[str, Any]) -> T:
    """Run the fit of a trial, and look for a remedy where it is refused.

    Parameters
    ----------
    fit : callable
        The fit of an experiment, as in `commands/bench.py`.
    arguments : Mapping
        What it takes, by name, with the `trial`.

    Returns
    -------
    FitTables or Mapping
        What the fit gives.

    Raises
    ------
    OslAnalysisError
        The fit is refused. Changes of the source file that make it pass are the error's remedy.
    """
    try:
        return fit(**arguments)
    except OslAnalysisError as error:
        remedies = []
        for suspect in error.suspects:
            remedies += remedy_for(suspect, fit, arguments)
        if not remedies:
            raise
        raise type(error)(f"{error.reason}; {'; or '.join(remedies)}") from error


def remedy_for(
    suspect: Suspect, fit: Callable[..., Any], arguments: Mapping[str, Any]
) -> list[str]:
    """The first change of a suspect with which a fit passes, and what it gives; none where none
    helps."""
    trial = arguments["trial"]
    for change in changes_of(trial, suspect):
        try:
            tables = fit(**{**arguments, "trial": changed(trial, change)})
        except OslAnalysisError:
            continue
        by_name = tables.estimates if isinstance(tables, FitTables) else tables
        whole = next(iter(by_name.values())).row(-1, named=True)
        if is_possible(whole):
            return [f"{change.words} in the source file: {first_estimate(whole)}"]
    return []


def changes_of(trial: Trial, suspect: Suspect) -> Sequence[Change]:
    """What else the source file may mean, the most usual first."""
    columns = suspect.columns
    if suspect.what == "sign":
        turned = "the torque, or of all angles," if columns == ("torque",) else columns[0]
        return [Change(f"turn the `sign` of {turned}", dict.fromkeys(columns, -1.0))]
    if suspect.what == "channels":
        angle, torque = columns
        swapped = {angle: torque, torque: angle}
        words = f"swap the channels of {angle} and {torque}"
        in_deg = f"state `unit: deg` of {angle}, and {words}"
        return [Change(words, {}, swapped), Change(in_deg, {angle: math.radians(1)}, swapped)]
    return OTHER_TIMES if columns == ("time",) else other_units(trial, columns)


def other_units(trial: Trial, columns: Sequence[str]) -> list[Change]:
    """Take the numbers of columns to be of another unit than they are declared in."""
    si_unit = unit_of(columns[0])
    declared = float(origin(trial, columns[0]).get("factor", 1))
    changes: list[Change] = []
    for unit in CONFUSED_UNITS[si_unit]:
        factor = si_factor(unit, si_unit) / declared
        if not math.isclose(factor, 1):
            words = f"state `unit: {unit}` of {' and '.join(columns)}"
            changes.append(Change(words, dict.fromkeys(columns, factor)))
    return changes


def changed(trial: Trial, change: Change) -> Trial:
    """The recording as it is with a change of its source file."""
    columns = [pl.col(name) * factor for name, factor in change.factors.items()]
    samples = trial.samples.rename(dict(change.renamed)).with_columns(columns)
    trial = replace(trial, samples=samples, clocks={})
    return with_stamp_evidence(trial) if "time" in change.factors else trial


def is_possible(row: Mapping[str, Any]) -> bool:
    """Whether a fit gives what a joint can have: a stiffness that is told from 0, no negative
    damping, and a K near the stated or predicted one."""
    first = estimated(row)[0]
    low, high = row.get(f"{first}_low"), row.get(f"{first}_high")
    if first in ("K", "K_s") and low is not None and high is not None and low <= 0 <= high:
        return False
    ratio = row.get("K_over_K_d") or row.get("K_ratio") or 1.0
    least, most = POSSIBLE
    return (row.get("B_high") or 0.0) >= 0 and least <= ratio <= most


def first_estimate(row: Mapping[str, Any]) -> str:
    """The first estimate of a fit with its interval and unit."""
    name = estimated(row)[0]
    interval = interval_text(row[name], row.get(f"{name}_low"), row.get(f"{name}_high"))
    words = (name, f"{row[name]:.3g}", interval, printed_units().get(name, ""))
    return " ".join(filter(None, words))
