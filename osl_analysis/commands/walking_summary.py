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
from osl_analysis.walking.ensemble import GroupHeadline, group_headline
from osl_analysis.walking.groups import ALL, SEPARATOR
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
    """The result of a group of crossings; without one, its outcome says why."""

    outcome: GroupOutcome
    fits: pl.DataFrame  # its rows of `walking.csv` that have a fit
    headline: GroupHeadline | None = None


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
    fits = read_table(table, ["trial"])
    fitted = fits.filter(pl.col(EXCLUDED).is_null())
    if len(fitted) < FEWEST_FITS:
        first = "".join(fits[EXCLUDED].drop_nulls().head(1))
        raise InputError(
            f"{table}: {len(fitted)} of {len(fits)} {TOO_FEW} its column {EXCLUDED}, or record more"
            f" ({first})"
        )
    selected = with_reasons(read_table(selection, ["trial", "reason", "group"]), fits)
    perturbed = selected.filter("perturbed")
    gaits = read_unperturbed_gaits(unperturbed)
    model = read_model(plate, PlateModel)
    commanded = commanded_over_stance(trajectory, data)
    files = {path.stem: path for path in crossings}

    results: list[GroupResult] = []
    rows: list[dict[str, Any]] = []
    places_of: dict[str, dict[str, str | None]] = {}
    for group in dict.fromkeys(SEPARATOR.join(perturbed["group"].drop_nulls()).split(SEPARATOR)):
        trials = perturbed.filter(pl.col("reason").is_null(), group=group)["trial"].to_list()
        gait = gaits.get(group)
        conditions = conditions_of(group, selected, gait, model)
        result = group_result(
            conditions, fitted.filter(pl.col("trial").is_in(trials)), gait, files, settings
        )
        results.append(result)
        places_of[group] = common_place(trials, places or {})
        cells = next((sheet[trial] for trial in trials), {})
        phase = result.outcome.fitted_phase
        for row in summary_rows(result):
            desired = cells.get(f"{row['quantity']}_d")  # K_d, B_d; no I is commanded
            if desired is None and commanded is not None and phase is not None:
                desired = commanded(row["quantity"], phase)
            rows.append({"group": group, **row, "commanded": desired})
    responses_of = [
        result_tables.response_table(result.outcome.conditions.group, result.headline)
        for result in results
        if result.headline is not None
    ]
    if not responses_of:
        reasons = "; ".join(reason_text(result.outcome) for result in results)
        raise InputError(f"{table}: no result of any group: {reasons}")

    group_table = judged_groups(results, limits or Limits())
    tables = {
        output: with_doubts_of_groups(rows, group_table),
        groups: group_table,
        responses: pl.concat(responses_of),
    }
    for path, of_groups in tables.items():
        write_table(with_places(of_groups, places_of, "group"), path, data)


def with_reasons(selection: pl.DataFrame, fits: pl.DataFrame) -> pl.DataFrame:
    """The selection of crossings, with the reason of those without a fit, too."""
    reasons = fits.select("trial", EXCLUDED)
    selection = selection.join(reasons, on="trial", how="left", maintain_order="left")
    return selection.with_columns(reason=pl.coalesce("reason", EXCLUDED))


def group_result(
    conditions: GroupConditions,
    fits: pl.DataFrame,
    gait: UnperturbedGait | None,
    files: Mapping[str, Path],
    settings: choices.EnsembleSettings,
) -> GroupResult:
    """Compute the result of a group from its rows of `walking.csv`. Without one there is a
    warning."""
    try:
        headline = headline_of(fits, gait, files, settings)
    except OslAnalysisError as error:
        warnings.warn(f"no result of {conditions.group}: {error}", stacklevel=2)
        return GroupResult(GroupOutcome(conditions, reason=str(error)), fits)
    phase = None
    if conditions.onset_phase is not None and conditions.stance_s is not None:
        phase = conditions.onset_phase + fitted_time(headline) / conditions.stance_s
    outcome = GroupOutcome(conditions, fitted_phase=phase, checks=check_fit(headline))
    return GroupResult(outcome, fits, headline)


def headline_of(
    fits: pl.DataFrame,
    gait: UnperturbedGait | None,
    files: Mapping[str, Path],
    settings: choices.EnsembleSettings,
) -> GroupHeadline:
    """The ensemble fit to the crossings of a group that have a fit of their own."""
    if gait is None:
        raise InputError(NO_GAIT)
    if len(fits) < FEWEST_FITS:
        raise InputError(f"{len(fits)} {TOO_FEW} walking_crossings.csv, or record more")
    crossings = [read_crossing(files[trial]) for trial in fits["trial"]]
    return group_headline(crossings, gait, settings)


def summary_rows(result: GroupResult) -> list[dict[str, Any]]:
    """The rows of `walking_summary.csv` of a group; without a result they have the reason."""
    fits = result.fits
    reason = result.outcome.reason
    if result.headline is None:
        row = {"estimator": result_tables.ENSEMBLE, "n": len(fits), "mean": None, "reason": reason}
        return [{"quantity": quantity, **row} for quantity in result_tables.GROUP_QUANTITIES]
    rows = result_tables.headline_rows(result.headline, fits, doubtful_row(fits))
    return [{**row, "reason": reason} for row in rows]


def judged_groups(results: Sequence[GroupResult], limits: Limits) -> pl.DataFrame:
    """The rows of `walking_groups.csv`, with the doubts beyond these limits."""
    rows = [result.outcome.row() for result in results]
    table = pl.DataFrame(rows, infer_schema_length=None)
    return marked(table, judged(table, limits, "walking_groups"), "walking_groups")


def with_doubts_of_groups(
    rows: Sequence[Mapping[str, Any]], group_table: pl.DataFrame
) -> pl.DataFrame:
    """The rows of `walking_summary.csv`, with the doubts about a group: they are about its ensemble
    fit."""
    doubts = group_table.select("group", doubt=DOUBTFUL)
    summary = pl.DataFrame(rows, infer_schema_length=None)
    summary = summary.join(doubts, on="group", how="left", maintain_order="left")
    of_ensemble = pl.when(estimator=result_tables.ENSEMBLE).then("doubt")
    return summary.with_columns(doubt=of_ensemble)


def common_place(trials: Sequence[str], places: Places) -> dict[str, str | None]:
    """Joint of the walkway, and the side of these crossings if they have the same."""
    sides = {places.get(trial, {}).get("side") for trial in trials}
    return {"joint": JOINT, "side": sides.pop() if len(sides) == 1 else None}


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
