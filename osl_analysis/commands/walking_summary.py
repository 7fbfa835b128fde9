"""K, B and I of groups of perturbed crossings (Fig. 9)."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.commands.walking_files import (
    NO_GAIT,
    Paths,
    SheetCells,
    read_crossing,
    read_model,
    read_unperturbed_gaits,
)
from osl_analysis.config.impedance_trajectory import (
    STANCE_SHARE,
    SYNTHETIC,
    read_impedance_trajectory,
)
from osl_analysis.config.sheet import JOINT
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.judge.judging import EXCLUDED, judged, marked
from osl_analysis.judge.limits import Limits
from osl_analysis.stats.repeats import DOUBTFUL, doubtful_row
from osl_analysis.table import MEASURED, Places, read_table, with_places, write_table
from osl_analysis.walking import tables as result_tables
from osl_analysis.walking import walking_settings as choices
from osl_analysis.walking.ensemble import group_headline
from osl_analysis.walking.groups import ALL, groups_of_selection
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.tables import (
    GroupConditions,
    GroupOutcome,
    check_fit,
    conditions_of,
    fitted_time,
)
from osl_analysis.walking.unperturbed_gait import UnperturbedGait

Commanded = Callable[[str, float], float | None]
"""Impedance that a leg was commanded, by quantity (K, B) and phase of stance."""

FEWEST_FITS = 2  # of perturbations, for a scatter
TOO_FEW = "perturbations can be used, expected 2 or more for a scatter; see the reasons in"


@dataclass(frozen=True)
class GroupResult:
    """What a group adds to each table; without a result it has a reason, and no curves."""

    outcome: GroupOutcome
    summary: list[dict[str, Any]]  # rows of `walking_summary.csv`
    responses: pl.DataFrame | None = None  # rows of `walking_responses.csv`

    @property
    def group(self) -> str:
        """Name of the group."""
        return self.outcome.conditions.group


@dataclass(frozen=True)
class Perturbations:
    """The perturbed crossings of a campaign, as the jobs before have left them."""

    fits: pl.DataFrame  # `walking.csv`
    selection: pl.DataFrame  # `walking_crossings.csv`, with the reason of those without a fit
    gaits: Mapping[str, UnperturbedGait]
    files: Mapping[str, Path]  # of the crossings, by trial

    @property
    def fitted(self) -> pl.DataFrame:
        """The fits that are not excluded."""
        return self.fits.filter(pl.col(EXCLUDED).is_null())

    def trials_of(self, group: str) -> list[str]:
        """The perturbed crossings of a group that are used."""
        is_used = pl.col("perturbed") & pl.col("reason").is_null()
        return self.selection.filter(is_used, pl.col("group") == group)["trial"].to_list()


def read_perturbations(
    table: Path, crossings: Paths, selection: Path, unperturbed: Path
) -> Perturbations:
    """Read what `fit_perturbation`, `select_crossings` and `average_unperturbed` wrote."""
    fits = read_table(table, ["trial"])
    selected = read_table(selection, ["trial", "reason", "group"])
    return Perturbations(
        fits=fits,
        selection=with_reasons(selected, fits),
        gaits=read_unperturbed_gaits(unperturbed),
        files={path.stem: path for path in crossings},
    )


def summarise_perturbations(
    *,
    table: Path,
    crossings: Paths,
    selection: Path,
    unperturbed: Path,
    settings: choices.EnsembleSettings,
    output: Path,
    responses: Path,
    groups: Path,
    sheet: SheetCells,
    plate: Path,
    trajectory: Paths = (),
    limits: Limits | None = None,
    places: Places | None = None,
    data: str = "",
) -> None:
    """Summarise the perturbations of each group.

    Parameters
    ----------
    table : Path
        `walking.csv`, with the fits to single perturbations.
    crossings : Sequence of Path
        The perturbed ones.
    selection, unperturbed : Path
        What `select_crossings` and `average_unperturbed` wrote.
    settings : EnsembleSettings
    output : Path
        The mean over perturbations, and the ensemble fit.
    responses : Path
        Responses in their window.
    groups : Path
        The conditions of each group.
    sheet : Mapping
        Cells of the sample sheet of each crossing.
    plate : Path
        The plate's model.
    trajectory : Sequence of Path
        What a leg was commanded over the gait cycle, if a file says so.
    limits : Limits or None
        Beyond which a group is doubtful.
    places : Places or None
        Joint and side of each crossing.
    data : str
        Whether the recordings are simulated or measured.

    Raises
    ------
    InputError
        Fewer than two perturbations can be used, or no group has a result.
    """
    places = places or {}
    perturbations = read_perturbations(table, crossings, selection, unperturbed)
    check_enough_fits(perturbations, table)
    results = group_results(
        perturbations,
        sheet,
        settings,
        read_model(plate, PlateModel),
        commanded_over_stance(trajectory, data),
    )
    check_any_result(results, table)

    group_table = judged_groups(results, limits or Limits())
    places_of_groups = {
        result.group: common_place(perturbations.trials_of(result.group), places)
        for result in results
    }
    tables = {
        output: summary_with_doubts(results, group_table),
        groups: group_table,
        responses: pl.concat(r.responses for r in results if r.responses is not None),
    }
    for path, of_groups in tables.items():
        write_table(with_places(of_groups, places_of_groups, "group"), path, data)


def check_enough_fits(perturbations: Perturbations, table: Path) -> None:
    """Refuse fewer perturbations than a scatter needs; `table` has their fits."""
    fits = perturbations.fits
    n_fitted = len(perturbations.fitted)
    if n_fitted < FEWEST_FITS:
        exclusions = fits[EXCLUDED].drop_nulls()
        first = exclusions[0] if len(exclusions) else ""
        raise InputError(
            f"{table}: {n_fitted} of {len(fits)} {TOO_FEW} its column {EXCLUDED}, or record more"
            f" ({first})"
        )


def group_results(
    perturbations: Perturbations,
    sheet: SheetCells,
    settings: choices.EnsembleSettings,
    plate: PlateModel,
    commanded: Commanded | None,
) -> list[GroupResult]:
    """The result of each group of perturbations."""
    results = []
    perturbed = perturbations.selection.filter("perturbed")
    for group in groups_of_selection(perturbed["group"].to_list(), sheet):
        gait = perturbations.gaits.get(group)
        conditions = conditions_of(group, perturbations.selection, gait, plate)
        result = group_result(conditions, perturbations, settings)
        phase = result.outcome.fitted_phase
        cells = next((sheet[trial] for trial in perturbations.trials_of(group)), {})
        for row in result.summary:
            desired = cells.get(f"{row['quantity']}_d")  # K_d, B_d; no I is commanded
            if desired is None and commanded is not None and phase is not None:
                desired = commanded(row["quantity"], phase)
            row["commanded"] = desired
        results.append(result)
    return results


def check_any_result(results: Sequence[GroupResult], table: Path) -> None:
    """Refuse a campaign none of whose groups has a result."""
    if all(result.responses is None for result in results):
        reasons = "; ".join(reason_text(result.outcome) for result in results)
        raise InputError(f"{table}: no result of any group: {reasons}")


def judged_groups(results: Sequence[GroupResult], limits: Limits) -> pl.DataFrame:
    """The rows of `walking_groups.csv`, with the doubts beyond these limits."""
    outcomes = [result.outcome.row() for result in results]
    table = pl.DataFrame(outcomes, infer_schema_length=None)
    return marked(table, judged(table, limits, "walking_groups"), "walking_groups")


def common_place(trials: Sequence[str], places: Places) -> dict[str, str | None]:
    """Joint of the walkway, and the side of these crossings if they have the same."""
    sides = {places.get(trial, {}).get("side") for trial in trials}
    return {"joint": JOINT, "side": sides.pop() if len(sides) == 1 else None}


def with_reasons(selection: pl.DataFrame, fits: pl.DataFrame) -> pl.DataFrame:
    """The selection of crossings, with the reason of those without a fit."""
    of_fits = fits.select("trial", EXCLUDED)
    chosen = selection.join(of_fits, on="trial", how="left", maintain_order="left")
    return chosen.with_columns(reason=pl.coalesce("reason", EXCLUDED))


def group_result(
    conditions: GroupConditions, perturbations: Perturbations, settings: choices.EnsembleSettings
) -> GroupResult:
    """Compute the result of a group. Without a result there is a warning."""
    group = conditions.group
    gait = perturbations.gaits.get(group)
    trials = perturbations.trials_of(group)
    fits = perturbations.fitted.filter(pl.col("trial").is_in(trials))
    try:
        if gait is None:
            raise InputError(NO_GAIT)
        if len(fits) < FEWEST_FITS:
            raise InputError(f"{len(fits)} {TOO_FEW} walking_crossings.csv, or record more")
        crossings = [read_crossing(perturbations.files[trial]) for trial in fits["trial"]]
        headline = group_headline(crossings, gait, settings)
    except OslAnalysisError as error:
        warnings.warn(f"no result of {group}: {error}", stacklevel=2)
        return result_without(conditions, len(fits), str(error))

    summary = [
        {"group": group, **row, "reason": None}
        for row in result_tables.headline_rows(headline, fits, doubtful_row(fits))
    ]
    fitted_phase = None
    if conditions.onset_phase is not None and conditions.stance_s is not None:
        fitted_phase = conditions.onset_phase + fitted_time(headline) / conditions.stance_s
    outcome = GroupOutcome(conditions, fitted_phase=fitted_phase, checks=check_fit(headline))
    return GroupResult(outcome, summary, result_tables.response_table(group, headline))


def result_without(conditions: GroupConditions, n: int, reason: str) -> GroupResult:
    """What a group without a result, of n fits, adds to the tables: rows with the reason."""
    summary: list[dict[str, Any]] = [
        {
            "group": conditions.group,
            "quantity": quantity,
            "estimator": result_tables.ENSEMBLE,
            "n": n,
            "mean": None,
            "reason": reason,
        }
        for quantity in result_tables.GROUP_QUANTITIES
    ]
    return GroupResult(GroupOutcome(conditions, reason=reason), summary)


def summary_with_doubts(results: Sequence[GroupResult], group_table: pl.DataFrame) -> pl.DataFrame:
    """The rows of `walking_summary.csv`; the doubts about a group are about its ensemble fit."""
    doubts = dict(zip(group_table["group"], group_table[DOUBTFUL], strict=True))
    rows: list[dict[str, Any]] = []
    for result in results:
        for row in result.summary:
            is_judged = row["estimator"] == result_tables.ENSEMBLE
            rows.append({**row, "doubt": doubts[row["group"]] if is_judged else None})
    return pl.DataFrame(rows, infer_schema_length=None)


def reason_text(outcome: GroupOutcome) -> str:
    """Why a group has no result, with its name if there are several."""
    group = outcome.conditions.group
    return str(outcome.reason) if group == ALL else f"{group}: {outcome.reason}"


def commanded_over_stance(trajectory: Paths, data: str) -> Commanded | None:
    """What the `trajectory` commands at a phase of stance; None without one, and for a measured leg
    (`data`), which was not commanded a synthetic one."""
    if not trajectory:
        return None
    desired = read_impedance_trajectory(trajectory[0])
    if data == MEASURED and desired.kind == SYNTHETIC:
        return None
    values_of = {"K": desired.K_d, "B": desired.B_d}

    def commanded(quantity: str, phase: float) -> float | None:
        if quantity not in values_of:
            return None
        return float(desired.at(values_of[quantity], np.array(phase * STANCE_SHARE)))

    return commanded
