"""The result of one group of perturbed crossings: its headline, and what its tables say of it."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.commands.walking_files import read_crossing
from osl_analysis.doubtful import doubtful_row
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.walking.group_table import Group, commanded, fitted_time, group_row
from osl_analysis.walking.headline import Headline, group_headline
from osl_analysis.walking.headline_doubts import group_facts
from osl_analysis.walking.settings import EnsembleSettings
from osl_analysis.walking.tables import headline_rows, reason_rows, response_table
from osl_analysis.walking.unperturbed import UnperturbedGait

FEWEST_PERTURBED = 2
"""Fewest perturbations of a result."""
NO_GAIT = (
    "no mean unperturbed gait under the same conditions: fewer unperturbed crossings than fewest_unperturbed are used; "
    "record more, or leave the condition empty in the sheet where unperturbed crossings serve every value"
)


@dataclass(frozen=True)
class GroupResult:
    """What a group gives to each table."""

    rows: Sequence[Mapping[str, Any]]
    """Its rows of `walking_summary.csv`."""
    fact: Mapping[str, Any]
    """Its row of `walking_groups.csv`."""
    curve: pl.DataFrame | None
    """Its responses in their window; None without a result."""


def group_result(
    group: Group,
    own: pl.DataFrame,
    files: Mapping[str, Path],
    gait: UnperturbedGait | None,
    settings: EnsembleSettings,
) -> GroupResult:
    """The result of a group; without one, rows with the reason, and a warning.

    `own` are the rows of its crossings in `walking.csv`, `files` are the crossings by trial.
    """
    known = {"group": group.name}
    fact: dict[str, Any] = group_row(group, gait, settings.window_s) | {"fitted_phase": None, "reason": None}
    try:
        headline = headline_of(own, files, gait, settings)
    except OslAnalysisError as error:
        warnings.warn(f"no result of {group.name}: {error}", stacklevel=2)
        rows = [known | row for row in reason_rows(str(error), len(own))]
        return GroupResult(rows, fact | {"reason": str(error)}, None)
    fact |= {"fitted_phase": phase_after(fact, fitted_time(headline.ensemble, settings.timing))}
    rows = [
        known | row | {"commanded": commanded(group.cells, str(row["quantity"])), "reason": None}
        for row in headline_rows(headline, own, doubtful_row(own))
    ]
    curve = response_table(group.name, headline.responses, headline.ensemble)
    return GroupResult(rows, fact | group_facts(headline), curve)


def headline_of(
    fits: pl.DataFrame, files: Mapping[str, Path], gait: UnperturbedGait | None, settings: EnsembleSettings
) -> Headline:
    """Result of the crossings of one group that have rows in `fits`; `files` are the crossings' by trial."""
    if gait is None:
        raise InputError(NO_GAIT)
    if len(fits) < FEWEST_PERTURBED:
        raise InputError(
            f"{len(fits)} perturbations can be used, expected {FEWEST_PERTURBED} or more for a scatter; see the "
            "reasons in walking_excluded.csv, or record more"
        )
    return group_headline([read_crossing(files[trial]) for trial in fits["trial"]], gait, settings)


def phase_after(fact: Mapping[str, Any], time: float) -> float:
    """Phase of stance a time [s] after the onset of a group, whose row of `walking_groups.csv` is given."""
    return float(fact["onset_phase"] + time / fact["stance_s"])
