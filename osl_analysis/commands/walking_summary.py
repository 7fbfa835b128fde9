# SPDX-License-Identifier: Apache-2.0
"""K, B and I of groups of perturbed crossings (Fig. 9)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.findings import read_findings
from osl_analysis.judge.joining import GROUP_DOUBTS, WHY_NO_FIT, WIDE_ESTIMATES, joined
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.judge.wording import doubts_text
from osl_analysis.stats.budget import CLEAR, QUANTITIES, WIDE
from osl_analysis.stats.doubts import Doubt, doubts_about, is_doubtful
from osl_analysis.walking import tables as result_tables
from osl_analysis.walking import walking_settings as choices
from osl_analysis.walking.groups import SEPARATOR
from osl_analysis.walking.impedance_fit import ENSEMBLE
from osl_analysis.walking.isolated_response import UnperturbedGait
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.tables import (
    MEAN_OF_PERTURBATIONS,
    GroupHeadline,
    budget_name,
    conditions_of,
    group_headline,
    result_columns,
)

FEWEST_FITS = 2  # of perturbations, for a scatter


@dataclass(frozen=True)
class SummaryFiles:
    """The results of earlier jobs, and the file of the commanded trajectory."""

    table: Path  # `walking.csv`, with the fits to single perturbations
    crossings: Sequence[Path]  # the perturbed ones
    selection: Path  # of `select_crossings`
    unperturbed: Path  # of `average_unperturbed`
    plate: Path  # the plate's model
    timing: Path  # its lags in the crossings
    trajectory: Sequence[Path] = ()  # what a leg was commanded over the gait cycle, if known


@dataclass(frozen=True)
class SummaryOutputs:
    """Where the summary is written."""

    summary: Path  # the mean over perturbations, and the ensemble fit
    responses: Path  # in their window
    groups: Path  # conditions and estimates of each group
    budget: Path  # what contributes to the uncertainty of each estimate
    data: str = ""  # whether the recordings are simulated or measured


@dataclass(frozen=True)
class Walked:
    """The crossings of a campaign, and what was computed of them before."""

    selected: pl.DataFrame  # crossings in their groups; `reason` of one that is not used
    fitted: pl.DataFrame  # rows of `walking.csv` that have a fit
    crossings: Mapping[str, Path]  # files by trial
    gaits: Gaits
    plate: PlateModel
    timing: PlateTiming

    @property
    def groups(self) -> list[str]:
        """Those of perturbed crossings."""
        names = self.selected.filter("perturbed")["group"].drop_nulls()
        return list(dict.fromkeys(SEPARATOR.join(names).split(SEPARATOR)))

    def perturbed(self, group: str) -> list[str]:
        """The perturbed crossings of a group that are used."""
        is_used = pl.col("reason").is_null()
        return self.selected.filter("perturbed", is_used, group=group)["trial"].to_list()


@dataclass(frozen=True)
class GroupResult:
    """What the perturbations of one group give."""

    row: Mapping[str, Any]  # of `walking_groups.csv`, with the `reason` of one without a result
    summary: Sequence[Mapping[str, Any]]  # rows of `walking_summary.csv`
    headline: GroupHeadline | None  # None without a result


def summarise_perturbations(
    files: SummaryFiles,
    settings: choices.TimingSettings,
    sheet: Mapping[str, Mapping[str, Any]],
    places: Places,
    has_drivetrain: bool,
    outputs: SummaryOutputs,
) -> None:
    """Summarise the perturbations of each group. What is found on the groups is joined to these
    tables later (`tabulate_groups`).

    Parameters
    ----------
    files : SummaryFiles
    settings : TimingSettings
    sheet : Mapping
        Cells of the sample sheet of each crossing.
    places : Places
        Joint and side of each crossing.
    has_drivetrain : bool
        Whether a parameter file describes one: Eq. 15 may then read a negative inertia.
    outputs : SummaryOutputs

    Raises
    ------
    InputError
        No group has a result, as with fewer than two perturbations.
    """
    walked = read_walked(files)
    results = {
        group: group_result(group, walked, settings, has_drivetrain) for group in walked.groups
    }
    headlines = {
        group: result.headline for group, result in results.items() if result.headline is not None
    }
    if not headlines:
        reasons = [f"{group}: {result.row['reason']}" for group, result in results.items()]
        raise InputError(f"{files.table}: no result of any group: {'; '.join(reasons)}")

    budget = pl.concat(
        result_tables.budget_table(group, headline) for group, headline in headlines.items()
    )
    responses = pl.concat(
        result_tables.response_table(group, headline) for group, headline in headlines.items()
    )
    group_rows = [dict(result.row) for result in results.values()]

    trajectory = commanded_trajectory(files.trajectory, outputs.data)
    summary_rows = []
    places_by_group = {}
    for group, result in results.items():
        trials = walked.perturbed(group)
        cells = sheet[trials[0]] if trials else {}
        summary_rows += with_commanded(result, cells, trajectory)
        places_by_group[group] = {"joint": JOINT, "side": common_side(trials, places)}
    tables = {
        outputs.summary: pl.DataFrame(summary_rows, infer_schema_length=None),
        outputs.groups: pl.DataFrame(group_rows, infer_schema_length=None),
        outputs.responses: responses,
        outputs.budget: budget,
    }
    for path, table in tables.items():
        write_table(with_places(table, places_by_group, "group"), path, outputs.data)


def read_walked(files: SummaryFiles) -> Walked:
    """Read the results of earlier jobs. Raises InputError where a file is of another kind."""
    fits = read_table(files.table, ["trial"])
    return Walked(
        selected=crossings_in_groups(files.selection, fits),
        fitted=fits.filter(pl.col(WHY_NO_FIT).is_null()),
        crossings={path.stem: path for path in files.crossings},
        gaits=read_model(files.unperturbed, Gaits),
        plate=read_model(files.plate, PlateModel),
        timing=read_model(files.timing, PlateTiming),
    )


def group_result(
    group: str, walked: Walked, settings: choices.TimingSettings, has_drivetrain: bool
) -> GroupResult:
    """The result of one group, or the reason for which there is none, with a warning."""
    gait = walked.gaits.get(group)
    conditions = conditions_of(group, walked.selected, gait, walked.plate, walked.timing)
    fits = walked.fitted.filter(pl.col("trial").is_in(walked.perturbed(group)))
    try:
        headline = headline_of(fits, gait, walked, settings, has_drivetrain)
    except OslAnalysisError as error:
        advise(f"no result of {group}: {error}")
        without = {"group": group, "estimator": ENSEMBLE, "n": len(fits), "mean": None}
        summary = [{"quantity": name, **without} for name in ("K", "B", "I", "VAF")]
        return GroupResult({**conditions, "reason": str(error)}, summary, None)
    row = {**conditions, **result_columns(conditions, headline), "reason": None}
    summary = [{"group": group, **cells} for cells in result_tables.headline_rows(headline, fits)]
    return GroupResult(row, summary, headline)


def with_commanded(
    result: GroupResult, cells: Mapping[str, Any], trajectory: ImpedanceTrajectory | None
) -> list[dict[str, Any]]:
    """The rows of a group's summary with the commanded value.

    It is that of the sheet (`cells` of the first crossing), else that of the trajectory at the
    fitted phase.
    """
    rows = []
    for row in result.summary:
        name = f"{row['quantity']}_d"  # K_d, B_d; no I is commanded
        desired = cells.get(name)
        if desired is None:
            desired = commanded_value(trajectory, name, result.row.get("fitted_phase"))
        rows.append({**row, "commanded": desired})
    return rows


def common_side(trials: Sequence[str], places: Places) -> str | None:
    """The side of these crossings; None where they have several."""
    sides = {places[trial]["side"] for trial in trials}
    return sides.pop() if len(sides) == 1 else None


def tabulate_groups(summary: Path, fits: Path, findings: Sequence[Path]) -> pl.DataFrame:
    """`walking_summary.csv`: the estimates of each group, with its findings and the number of
    doubtful fits to single perturbations.

    Parameters
    ----------
    summary : Path
        The file that `summarise_perturbations` wrote.
    fits : Path
        `walking.csv`.
    findings : Sequence of Path
        The findings on groups and on single perturbations.
    """
    read = read_findings(findings)
    group_estimates = joined(read_table(summary), "walking_summary", read)
    single = joined(read_table(fits), "walking", read).filter(pl.col(WHY_NO_FIT).is_null())
    marked = single.with_columns(n_doubtful=is_doubtful(single))
    counts = marked.group_by("group").agg(pl.col("n_doubtful").sum().cast(pl.Int64))
    rows = group_estimates.join(counts, on="group", how="left", maintain_order="left").to_dicts()
    for row in rows:
        if row["estimator"] != MEAN_OF_PERTURBATIONS:
            row["n_doubtful"] = None
        doubts = doubts_about(row[GROUP_DOUBTS], [row["quantity"]])
        row["group_doubtful"] = doubts_text(doubts) or None
        row["verdict"] = estimate_verdict(row, doubts)
    table = pl.DataFrame(rows, infer_schema_length=None)
    described = described_tables_by_name()["walking_summary"].columns
    return table.select(name for name in described if name in table.columns)


def estimate_verdict(row: Mapping[str, Any], doubts: Sequence[Doubt]) -> str | None:
    """The verdict on an estimate of a group in words; None without a result.

    A VAF has none, nor has a mean over perturbations, which has no interval, unless it is doubtful.
    """
    if row["quantity"] not in QUANTITIES or row["mean"] is None:
        return None
    if doubts:
        return known_finding(doubts[0]["source"]).title
    if row["estimator"] == MEAN_OF_PERTURBATIONS:
        return None
    is_wide = budget_name(row["quantity"], row["estimator"]) in row[WIDE_ESTIMATES]
    return WIDE if is_wide else CLEAR


def crossings_in_groups(selection: Path, fits: pl.DataFrame) -> pl.DataFrame:
    """The crossings with their groups. A crossing without a fit has the reason of the fit."""
    in_groups = read_table(selection, ["trial", "reason", "group"])
    reasons = fits.select("trial", reason_of_fit=WHY_NO_FIT)
    in_groups = in_groups.join(reasons, on="trial", how="left", maintain_order="left")
    return in_groups.with_columns(reason=pl.coalesce("reason", "reason_of_fit"))


def headline_of(
    fits: pl.DataFrame,
    gait: UnperturbedGait | None,
    walked: Walked,
    settings: choices.TimingSettings,
    has_drivetrain: bool,
) -> GroupHeadline:
    """The ensemble fit to the crossings of a group that have a fit of their own. Raises InputError
    without a mean gait, or with too few of them."""
    if gait is None:
        raise InputError(NO_GAIT)
    if len(fits) < FEWEST_FITS:
        raise InputError(
            f"{len(fits)} perturbations can be used, expected {FEWEST_FITS} or more for a scatter",
            "see the reasons in walking_crossings.csv and walking.csv, or record more",
        )
    crossings = [read_crossing(walked.crossings[trial]) for trial in fits["trial"]]
    return group_headline(crossings, gait, settings, walked.plate, walked.timing, has_drivetrain)


def commanded_trajectory(trajectory: Sequence[Path], data: str) -> ImpedanceTrajectory | None:
    """The commanded trajectory; None without a file.

    A measured leg (`data`) was not commanded a synthetic trajectory, and has none.
    """
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
