# SPDX-License-Identifier: Apache-2.0
"""Jobs of the walkway, and the files between them.

Their order: `calibrate`, `identify_plate`, `find_timing`, `analyse`, `select_crossings`,
`average_unperturbed`, `fit_perturbation`. `commands/walking_summary.py` sums them up by group.

Example: `read_crossing(Path("crossings/walk_1.parquet")).theta`.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from pydantic import TypeAdapter

from osl_analysis.base.errors import InputError, OslAnalysisError, advise, naming, on_one_line
from osl_analysis.base.files import write_text
from osl_analysis.base.table import (
    ANALYSED,
    SCHEMA,
    Places,
    check_analysed,
    read_table,
    with_places,
    write_table,
)
from osl_analysis.base.trial import (
    NAME_KEY,
    PROVENANCE_KEY,
    SCHEMA_KEY,
    Trial,
    metadata_of,
    read_trial,
    write_empty,
    write_trial,
)
from osl_analysis.dictionary.described import columns_of_trial
from osl_analysis.judge.joining import WHY_NO_FIT
from osl_analysis.walking import tables as result_tables
from osl_analysis.walking import walking_settings as choices
from osl_analysis.walking.crossing import Crossing, analyse_crossing
from osl_analysis.walking.groups import ALL, SEPARATOR, selection_rows
from osl_analysis.walking.isolated_response import UnperturbedGait, unperturbed_gait
from osl_analysis.walking.plate import check_weight
from osl_analysis.walking.plate_inertia import (
    NO_CORRECTION,
    NOT_REMOVED,
    PlateModel,
    identify_plate_model,
)
from osl_analysis.walking.plate_lag import PlateTiming, timing_of
from osl_analysis.walking.poses import StaticCalibration, static_calibration
from osl_analysis.walking.set_up import body_mass

Gaits = dict[str, UnperturbedGait]
"""Mean gaits by group; a group with too few crossings has none."""
ADAPTERS: dict[Any, TypeAdapter[Any]] = {
    kind: TypeAdapter(kind)
    for kind in (StaticCalibration, PlateModel, Gaits, PlateTiming, Crossing)
}
"""Readers and writers by kind of result, made once: making one takes as long as using it."""
NO_GAIT = (
    "no mean unperturbed gait under the same conditions: fewer unperturbed crossings than"
    " fewest_unperturbed are used; record more, or leave the condition empty in the sheet where"
    " unperturbed crossings serve every value"
)


def write_model(model: Any, path: Path) -> None:
    """Write a calibration, the plate's model, or gaits by name as JSON.

    Arrays are lists, NaN is null.
    """
    kind = Gaits if isinstance(model, dict) else type(model)
    write_text(path, ADAPTERS[kind].dump_json(model, indent=1).decode() + "\n")


def read_model(path: Path, kind: Any) -> Any:
    """Read a model. Raises InputError where the file is missing or is of another kind."""
    check_analysed(path)
    try:
        return ADAPTERS[kind].validate_json(path.read_bytes())
    except (OSError, ValueError) as error:
        why = on_one_line(error)
        raise InputError(
            f"{path}: not what a run writes ({why})", "delete it and run again"
        ) from error


def write_crossing(crossing: Crossing, path: Path) -> None:
    """Write a crossing as a trial: arrays (..., n) and the phase of stance as columns, other fields
    as provenance."""
    columns = {
        "time": crossing.time,
        "phase": crossing.stance.phase(crossing.time),
    }
    provenance = {}
    for name, value in ADAPTERS[Crossing].dump_python(crossing).items():
        if isinstance(value, np.ndarray):
            columns[name] = value.T
        else:
            provenance[name] = value
    write_trial(Trial(crossing.name, pl.DataFrame(columns), provenance), path)


def write_refusal(name: str, reason: str, path: Path) -> None:
    """Write a crossing's file without rows and with the reason in its provenance.

    So other crossings are still analysed.
    """
    provenance = json.dumps({"refused": reason})
    metadata = {NAME_KEY: name, PROVENANCE_KEY: provenance, SCHEMA_KEY: str(SCHEMA)}
    write_empty(("time", "phase", "theta", "torque"), path, metadata)


def read_crossing(path: Path) -> Crossing:
    """Read a crossing. Raises InputError where it was refused."""
    crossing = read_crossing_file(path)
    if isinstance(crossing, str):
        raise InputError(f"{path}: the crossing was refused: {crossing}")
    return crossing


def read_crossing_file(path: Path) -> Crossing | str:
    """Read what `write_crossing` wrote, or the reason that `write_refusal` wrote."""
    _, facts = metadata_of(path)
    if "refused" in facts:
        return str(facts["refused"])
    trial = read_trial(path)
    if "stance" not in trial.provenance:
        raise InputError(f"{path}: a trial without events", "name its crossing, which a run writes")
    fields: dict[str, Any] = dict(trial.provenance)
    for column in trial.samples.columns:
        if column != "phase":
            fields[column] = trial.samples[column].to_numpy().T
    crossing: Crossing = ADAPTERS[Crossing].validate_python(fields)
    return crossing


def selected_crossings(crossings: Sequence[Path], selection: Path) -> list[Crossing]:
    """The crossings that the table `selection` does not exclude."""
    excluded = read_table(selection, ["trial", "reason"]).drop_nulls("reason")["trial"].to_list()
    return [read_crossing(path) for path in crossings if path.stem not in excluded]


def calibrate(
    trial: Path,
    settings: choices.CalibrationSettings,
    output: Path,
    body_mass_kg: float | None = None,
) -> None:
    """Write marker clusters, ankle centre and axis of the static trial to a JSON file.

    `body_mass_kg` is that of a person who stands on the plates.
    """
    recorded = read_trial(trial)
    with naming(f"trial {recorded.name}"):
        check_weight(recorded, body_mass_kg)
        calibration = static_calibration(recorded, settings)
    write_model(calibration, output)


def calibrated_trials(
    trials: Sequence[Path], calibrations: Sequence[Path], statics: Mapping[str, str]
) -> list[tuple[Trial, StaticCalibration]]:
    """The trials with the calibration of their static trial, which `statics` names. A trial without
    one is left out."""
    calibration_of = {path.stem: read_model(path, StaticCalibration) for path in calibrations}
    calibrated = []
    for path in trials:
        static = statics.get(path.stem)
        if static in calibration_of:
            calibrated.append((read_trial(path), calibration_of[static]))
    return calibrated


def identify_plate(
    trials: Sequence[Path],
    calibrations: Sequence[Path],
    statics: Mapping[str, str],
    settings: choices.PlateModelSettings,
    output: Path,
) -> None:
    """Write the plate's inertia and lag, from trials of the unloaded plate, to a JSON file.

    A warning is given where the settings remove nothing.
    """
    if settings.plate_inertia == "none":
        advise(f"the plate's own inertia and lag stay in the torque: {NOT_REMOVED}")
        model = NO_CORRECTION
    else:
        model = identify_plate_model(calibrated_trials(trials, calibrations, statics), settings)
    write_model(model, output)


def find_timing(
    trials: Sequence[Path],
    calibrations: Sequence[Path],
    statics: Mapping[str, str],
    plate: Path,
    settings: choices.CrossingSettings,
    output: Path,
) -> None:
    """Write the onsets [s] of all perturbed crossings, by the mean ramp of the platform, and the
    plate's lag in each, to a JSON file."""
    crossings = calibrated_trials(trials, calibrations, statics)
    write_model(timing_of(crossings, read_model(plate, PlateModel), settings), output)


@dataclass(frozen=True)
class StatedOfCrossing:
    """The cells of the sheet on a crossing."""

    perturbed: bool
    direction: str | None = None  # of the platform's turn: `up` or `down`
    body_mass_kg: float | None = None


def analyse(
    trial: Path,
    calibration: Path,
    plate: Path,
    timing: Path,
    sheet_cells: StatedOfCrossing,
    settings: choices.CrossingSettings,
    output: Path,
) -> None:
    """Write angle, torque and events of one crossing, or the reason of its refusal with a warning.

    Parameters
    ----------
    trial : Path
        The recording.
    calibration, plate, timing : Path
        The results for its static trial, for the plate and for all perturbed crossings.
    sheet_cells : StatedOfCrossing
    settings : CrossingSettings
    output : Path
        A Parquet file.
    """
    walked = read_trial(trial)
    static = read_model(calibration, StaticCalibration)
    model = read_model(plate, PlateModel)
    timings = read_model(timing, PlateTiming)
    onset = timings.onsets.get(walked.name)
    lag = timings.lags.get(walked.name, timings.lag) or 0.0
    try:
        with naming(f"trial {walked.name}"):
            crossing = analyse_crossing(
                walked, static, model, sheet_cells.perturbed, settings, onset, lag
            )
            expected = sheet_cells.direction
            if expected is not None and crossing.direction not in (None, expected):
                raise InputError(
                    f"the platform turned by {np.rad2deg(crossing.turn or 0.0):.1f} deg"
                    f" (positive: toes up), but the sheet says direction '{expected}'",
                    "correct the sheet, or exclude the trial",
                )
        crossing = replace(crossing, body_mass=body_mass(walked, sheet_cells.body_mass_kg))
    except OslAnalysisError as error:
        reason = str(error)
        advise(f"excluded: {reason}")
        write_refusal(walked.name, reason, output)
    else:
        write_crossing(crossing, output)


def select_crossings(
    crossings: Sequence[Path],
    settings: choices.SelectionSettings,
    output: Path,
    sheet: Mapping[str, Mapping[str, Any]],
    places: Places | None = None,
    data: str = "",
) -> None:
    """Write one row per crossing of the sheet: quality, group, and the reason if it is not used."""
    results = {path.stem: read_crossing_file(path) for path in crossings}
    analysed = [crossing for crossing in results.values() if isinstance(crossing, Crossing)]
    refused = {name: reason for name, reason in results.items() if isinstance(reason, str)}
    rows = selection_rows(analysed, refused, settings, sheet)
    table = pl.DataFrame([*rows.values()], infer_schema_length=None)
    write_table(with_places(table, places), output, data)


def average_unperturbed(
    crossings: Sequence[Path], selection: Path, fewest: int, output: Path
) -> None:
    """Write the mean unperturbed gait of each group, on a common grid of stance phase.

    Crossings that the table `selection` excludes do not count. A group with fewer than the `fewest`
    is left out with a warning.
    """
    rows = read_table(selection, ["trial", "group", "reason"])
    rows = rows.filter(pl.col("trial").is_in([path.stem for path in crossings]))
    rows = rows.drop_nulls("group")
    selected = selected_crossings(crossings, selection)
    gaits = {}
    problems = []
    for name in dict.fromkeys(SEPARATOR.join(rows["group"]).split(SEPARATOR)):
        group_rows = rows.filter(pl.col("group").str.split(SEPARATOR).list.contains(name))
        trials = group_rows["trial"].to_list()
        unperturbed = [c for c in selected if c.onset is None and c.name in trials]
        unused = group_rows.drop_nulls("reason").select("trial", "reason")
        try:
            gaits[name] = unperturbed_gait(unperturbed, fewest, dict(unused.iter_rows()))
        except InputError as error:
            problems.append(str(error) if name == ALL else f"{name}: {error}")
    if not gaits:
        raise InputError("; ".join(problems))
    for problem in problems:
        advise(problem)
    write_model(gaits, output)


def fit_perturbation(
    crossing: Path,
    selection: Path,
    unperturbed: Path,
    settings: choices.TimingSettings,
    output: Path,
    data: str = "",
) -> None:
    """Write the row of `walking.csv` of one perturbed crossing: the fit of Eq. 15, or the reason
    for which there is none."""
    gaits: Gaits = read_model(unperturbed, Gaits)
    rows = read_table(selection, ["trial", "reason", "group"])
    reason, group = rows.filter(trial=crossing.stem).select("reason", "group").row(0)
    gait = gaits.get(group)
    # a campaign in which no perturbation can be used keeps its other results
    row: dict[str, object] = {}
    if gait is None:
        reason = reason or NO_GAIT
    elif reason is None:
        try:
            row = result_tables.perturbation_row(read_crossing(crossing), gait, settings)
        except OslAnalysisError as error:
            reason = str(error)
            advise(f"excluded: {reason}")
    place = {"trial": crossing.stem, "group": group}
    status = ANALYSED if reason is None else "excluded"
    columns = dict.fromkeys(columns_of_trial("walking"))
    ending = {"status": status, WHY_NO_FIT: reason}
    write_table(pl.DataFrame([{**columns, **place, **row, **ending}]), output, data)
