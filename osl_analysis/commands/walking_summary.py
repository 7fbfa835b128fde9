# SPDX-License-Identifier: Apache-2.0
"""K, B and I of groups of perturbed crossings (Fig. 9)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.errors import InputError, OslAnalysisError, advise
from osl_analysis.base.table import MEASURED, Places, read_table, with_places, write_table
from osl_analysis.commands.walking import (
    NO_GAIT,
    Gaits,
    read_crossing,
    read_model,
)
from osl_analysis.config.impedance_trajectory import (
    STANCE_SHARE,
    SYNTHETIC,
    ImpedanceTrajectory,
    read_impedance_trajectory,
)
from osl_analysis.config.sheet import JOINT
from osl_analysis.judge.judging import WHY_NO_FIT, judged, judged_estimates, marked
from osl_analysis.judge.limits import Limits
from osl_analysis.stats.budget import CLEAR, WIDE
from osl_analysis.stats.repeats import DOUBTFUL, concerns
from osl_analysis.walking import tables as result_tables
from osl_analysis.walking import walking_settings as choices
from osl_analysis.walking.groups import SEPARATOR
from osl_analysis.walking.impedance_fit import ENSEMBLE
from osl_analysis.walking.isolated_response import UnperturbedGait
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.tables import (
    PREDICTED,
    GroupHeadline,
    conditions_of,
    group_headline,
    result_columns,
)

FEWEST_FITS = 2  # of perturbations, for a scatter


def summarise_perturbations(
    *,
    table: Path,
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    settings: choices.TimingSettings,
    output: Path,
    responses: Path,
    groups: Path,
    budget: Path,
    sheet: Mapping[str, Mapping[str, Any]],
    plate: Path,
    timing: Path,
    limits: Limits,
    places: Places,
    has_drivetrain: bool = True,
    trajectory: Sequence[Path] = (),
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
    settings : TimingSettings
    output : Path
        The mean over perturbations, and the ensemble fit.
    responses : Path
        Responses in their window.
    groups : Path
        The conditions of each group.
    budget : Path
        What contributes to the uncertainty of each estimate.
    sheet : Mapping
        Cells of the sample sheet of each crossing.
    plate, timing : Path
        The plate's model, and its lags in the crossings.
    limits : Limits
        Beyond which a group is doubtful.
    places : Places
        Joint and side of each crossing.
    has_drivetrain : bool
        Whether a parameter file describes one: Eq. 15 may then read a negative inertia.
    trajectory : Sequence of Path
        What a leg was commanded over the gait cycle, if a file says so.
    data : str
        Whether the recordings are simulated or measured.

    Raises
    ------
    InputError
        No group has a result, as with fewer than two perturbations.
    """
    fits = read_table(table, ["trial"])
    fitted = fits.filter(pl.col(WHY_NO_FIT).is_null())
    selected = crossings_in_groups(selection, fits)
    perturbed = selected.filter("perturbed")
    gaits: Gaits = read_model(unperturbed, Gaits)
    model = read_model(plate, PlateModel)
    lags = read_model(timing, PlateTiming)
    commanded = commanded_trajectory(trajectory, data)
    files = {path.stem: path for path in crossings}

    of_groups: list[dict[str, Any]] = []
    rows = []
    of_responses = []
    of_budgets = []
    own_verdicts = {}  # by group, of the fit minus predicted gait
    places_of = {}
    for group in dict.fromkeys(SEPARATOR.join(perturbed["group"].drop_nulls()).split(SEPARATOR)):
        trials = perturbed.filter(pl.col("reason").is_null(), group=group)["trial"].to_list()
        gait = gaits.get(group)
        conditions = conditions_of(group, selected, gait, model, lags)
        of_group = fitted.filter(pl.col("trial").is_in(trials))
        try:
            headline = headline_of(of_group, gait, files, settings, model, lags, has_drivetrain)
        except OslAnalysisError as error:
            advise(f"no result of {group}: {error}")
            row = {**conditions, "reason": str(error)}
            without = {"estimator": ENSEMBLE, "n": len(of_group), "mean": None}
            summary = [{"quantity": name, **without} for name in ("K", "B", "I", "VAF")]
        else:
            row = {**conditions, **result_columns(conditions, headline), "reason": None}
            summary = result_tables.headline_rows(headline, of_group)
            of_responses.append(result_tables.response_table(group, headline))
            of_budgets.append(result_tables.budget_table(group, headline))
            predicted = judged_estimates("walking_groups", headline.predicted.budgets, limits)
            own_verdicts[group] = {each.symbol: each.verdict.name for each in predicted}
        of_groups.append(row)
        sides = {places[trial]["side"] for trial in trials}
        side = sides.pop() if len(sides) == 1 else None
        places_of[group] = {"joint": JOINT, "side": side}
        cells = sheet[trials[0]] if trials else {}
        for each in summary:
            name = f"{each['quantity']}_d"  # K_d, B_d; no I is commanded
            desired = cells.get(name)
            if desired is None:
                desired = commanded_value(commanded, name, row.get("fitted_phase"))
            rows.append({"group": group, **each, "commanded": desired})
    if not of_responses:
        why = "; ".join(f"{row['group']}: {row['reason']}" for row in of_groups)
        raise InputError(f"{table}: no result of any group: {why}")

    group_table = pl.DataFrame(of_groups, infer_schema_length=None)
    contributions = pl.concat(of_budgets)
    doubts = judged(group_table, limits, "walking_groups", budget=contributions)
    group_table = marked(group_table, doubts, "walking_groups")
    tables = {
        output: with_verdicts(rows, group_table, own_verdicts),
        groups: group_table,
        responses: pl.concat(of_responses),
        budget: contributions,
    }
    for path, frame in tables.items():
        write_table(with_places(frame, places_of, "group"), path, data)


def with_verdicts(
    rows: Sequence[dict[str, Any]],
    groups: pl.DataFrame,
    own_verdicts: Mapping[str, Mapping[str, str]],
) -> pl.DataFrame:
    """The rows of a summary with the verdict on each estimate of its group, and why it is doubtful;
    one about VAF concerns all. A doubt of the group is one of each estimator, but the fit minus
    predicted gait has a width, and `own_verdicts` by group and quantity; the mean has none."""
    group_of = {row["group"]: row for row in groups.to_dicts()}
    for row in rows:
        of_group = group_of[row["group"]]
        quantity = row["quantity"]
        verdict = of_group.get(f"{quantity}_verdict")
        if verdict in (CLEAR, WIDE) and row["estimator"] != ENSEMBLE:
            own = own_verdicts[row["group"]] if row["estimator"] == PREDICTED else {}
            verdict = own.get(quantity)
        row["verdict"] = verdict
        doubts = of_group[DOUBTFUL]
        row["group_doubtful"] = doubts if concerns(doubts, [quantity]) else None
    return pl.DataFrame(rows, infer_schema_length=None)


def crossings_in_groups(selection: Path, fits: pl.DataFrame) -> pl.DataFrame:
    """The crossings in their groups; the `reason` of one without a fit is that of the fit."""
    in_groups = read_table(selection, ["trial", "reason", "group"])
    reasons = fits.select("trial", of_fit=WHY_NO_FIT)
    in_groups = in_groups.join(reasons, on="trial", how="left", maintain_order="left")
    return in_groups.with_columns(reason=pl.coalesce("reason", "of_fit"))


def headline_of(
    fits: pl.DataFrame,
    gait: UnperturbedGait | None,
    files: Mapping[str, Path],
    settings: choices.TimingSettings,
    plate: PlateModel,
    timing: PlateTiming,
    has_drivetrain: bool,
) -> GroupHeadline:
    """The ensemble fit to the crossings of a group that have a fit of their own."""
    if gait is None:
        raise InputError(NO_GAIT)
    if len(fits) < FEWEST_FITS:
        raise InputError(
            f"{len(fits)} perturbations can be used, expected {FEWEST_FITS} or more for a scatter",
            "see the reasons in walking_crossings.csv and walking.csv, or record more",
        )
    crossings = [read_crossing(files[trial]) for trial in fits["trial"]]
    return group_headline(crossings, gait, settings, plate, timing, has_drivetrain)


def commanded_trajectory(trajectory: Sequence[Path], data: str) -> ImpedanceTrajectory | None:
    """What a leg was commanded; None without a file, and for a measured leg (`data`), which was not
    commanded a synthetic trajectory."""
    if not trajectory:
        return None
    desired = read_impedance_trajectory(trajectory[0])
    return None if data == MEASURED and desired.kind == SYNTHETIC else desired


def commanded_value(
    trajectory: ImpedanceTrajectory | None, name: str, phase: float | None
) -> float | None:
    """K_d or B_d by `name` at a phase of stance; None where it is not known."""
    values = getattr(trajectory, name, None)
    if trajectory is None or values is None or phase is None:
        return None
    return float(trajectory.at(values, np.array(phase * STANCE_SHARE)))
