"""Jobs of the walkway: calibration, plate, crossings and their files, and the tables of Fig. 9."""

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import polars as pl
from pydantic import TypeAdapter

from osl_analysis.config.impedance_trajectory import SYNTHETIC, read_impedance_trajectory
from osl_analysis.config.sheet import JOINT
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.files import atomic_path, write_text
from osl_analysis.ingest.examine import check_own_torque
from osl_analysis.judge.judging import EXCLUDED, judged, marked
from osl_analysis.judge.limits import Limits
from osl_analysis.refusal import check_not_refused
from osl_analysis.stats.repeats import DOUBTFUL, doubtful_row
from osl_analysis.table import MEASURED, Places, read_table, with_places, write_table
from osl_analysis.trial import (
    NAME_KEY,
    PROVENANCE_KEY,
    Array,
    Trial,
    metadata_of,
    read_trial,
    write_trial,
)
from osl_analysis.walking import result_tables
from osl_analysis.walking import walking_settings as choices
from osl_analysis.walking.crossing import (
    UP,
    Crossing,
    RefusedCrossing,
    analyse_crossing,
    crossing_of_log,
)
from osl_analysis.walking.ensemble import ESTIMATED, group_headline
from osl_analysis.walking.group_checks import check_group, check_witnesses
from osl_analysis.walking.group_table import (
    GroupConditions,
    GroupOutcome,
    fitted_time,
    group_conditions,
    group_rows,
)
from osl_analysis.walking.groups import ALL, SEPARATOR, cell_listing, split_keys
from osl_analysis.walking.overground import CURVES, overground_contacts
from osl_analysis.walking.planned_turn import PlannedTurn, half_widths, scatter_of_one
from osl_analysis.walking.plate_model import (
    NO_CORRECTION,
    NOT_REMOVED,
    PlateModel,
    identify_plate_model,
    plate_table,
)
from osl_analysis.walking.poses import StaticCalibration, static_calibration
from osl_analysis.walking.selection import selection_rows
from osl_analysis.walking.setup_checks import body_mass
from osl_analysis.walking.shared_motion import (
    NO_SHARED_MOTION,
    PlatformModel,
    identify_platform,
    platform_table,
)
from osl_analysis.walking.unperturbed_gait import PHASES, UnperturbedGait, unperturbed_gait

# The step that writes each model
WRITTEN_BY = {
    StaticCalibration: "calibrate",
    PlateModel: "identify-plate",
    PlatformModel: "measure-platform",
}
ADAPTERS: dict[Any, TypeAdapter[Any]] = {
    kind: TypeAdapter(kind) for kind in (*WRITTEN_BY, Crossing)
}
"""What reads and writes each kind of result: to make one takes as long as to use it."""
FEWEST_FITS = 2  # of perturbations, for a scatter
TOO_FEW = "perturbations can be used, expected 2 or more for a scatter; see the reasons in"
NO_GAIT = (
    "no mean unperturbed gait under the same conditions: fewer unperturbed crossings than"
    " fewest_unperturbed are used; record more, or leave the condition empty in the sheet where"
    " unperturbed crossings serve every value"
)
Kind = TypeVar("Kind")
Paths = Sequence[Path]
# The static trial of each trial, which names the file of its calibration
Statics = Mapping[str, str]
SheetCells = Mapping[str, Mapping[str, Any]]  # Cells of the sheet of each crossing


def write_model(model: Any, path: Path) -> None:
    """Write a calibration, the plate's model or the platform's as JSON; arrays are lists, NaN is
    null."""
    write_text(path, ADAPTERS[type(model)].dump_json(model, indent=1).decode() + "\n")


def read_model(path: Path, kind: type[Kind]) -> Kind:
    """Read what `write_model` wrote. Raises InputError where it is missing or is of another
    kind."""
    check_not_refused(path)
    step = f"run the step '{WRITTEN_BY[kind]}'"
    if not path.is_file():
        raise InputError(f"{path}: no such file; {step} first")
    try:
        model: Kind = ADAPTERS[kind].validate_json(path.read_bytes())
    except ValueError as error:
        why = " ".join(str(error).split())
        raise InputError(
            f"{path}: not what this step writes ({why}); delete it and {step}"
        ) from error
    return model


def write_crossing(crossing: Crossing, path: Path) -> None:
    """Write a crossing as a trial: arrays (..., n) as columns beside the phase of stance, the rest
    as provenance."""
    columns: dict[str, Array] = {
        "time": crossing.time,
        "phase": crossing.stance.phase(crossing.time),
    }
    provenance: dict[str, Any] = {}
    for name, value in ADAPTERS[Crossing].dump_python(crossing).items():
        if isinstance(value, np.ndarray):
            columns[name] = value.T
        else:
            provenance[name] = value
    write_trial(Trial(crossing.name, pl.DataFrame(columns), provenance), path)


def write_refusal(refused: RefusedCrossing, path: Path) -> None:
    """Write a crossing's file without rows, with the reason in its provenance, so that other
    crossings are analysed."""
    reason = json.dumps({"refused": refused.reason, "perturbed": refused.perturbed})
    empty = pl.DataFrame(schema=dict.fromkeys(("time", "phase", "theta", "torque"), pl.Float64))
    with atomic_path(path) as temporary:
        empty.write_parquet(temporary, metadata={NAME_KEY: refused.name, PROVENANCE_KEY: reason})


def read_crossing(path: Path) -> Crossing:
    """A crossing that was not refused."""
    crossing = read_crossing_file(path)
    if isinstance(crossing, RefusedCrossing):
        raise InputError(f"{path}: the crossing was refused: {crossing.reason}")
    return crossing


def read_crossing_file(path: Path) -> Crossing | RefusedCrossing:
    """Read what `write_crossing` or `write_refusal` wrote."""
    name, facts = metadata_of(path)
    if "refused" in facts:
        return RefusedCrossing(name, facts["perturbed"], facts["refused"])
    trial = read_trial(path)
    if "stance" not in trial.provenance:
        raise InputError(
            f"{path}: a trial without events; run the step 'analyse' and use its crossing"
        )
    fields: dict[str, Any] = dict(trial.provenance)
    for column in trial.samples.columns:
        if column != "phase":
            fields[column] = trial.samples[column].to_numpy().T
    crossing: Crossing = ADAPTERS[Crossing].validate_python(fields)
    return crossing


def read_unperturbed_gaits(path: Path) -> dict[str, UnperturbedGait]:
    """Read what `average_unperturbed` wrote: gaits with fewer crossings than the least are not
    among them."""
    check_not_refused(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; run the step 'average-unperturbed' first")
    gaits: dict[str, UnperturbedGait] = {}
    for frame in pl.read_parquet(path).partition_by("gait", maintain_order=True):
        names = frame["trial"].unique(maintain_order=True).to_list()
        shape = (len(names), len(frame) // len(names))  # crossings, phases of stance
        gaits[str(frame["gait"][0])] = UnperturbedGait(
            names=tuple(names),
            theta=frame["theta"].to_numpy().reshape(shape),
            torque=frame["torque"].to_numpy().reshape(shape),
            stance=frame["stance_s"].to_numpy().reshape(shape)[:, 0],
            plate_errors=frame["plate_errors"].to_numpy().T.reshape(-1, *shape),
            lab_errors=frame["lab_errors"].to_numpy().T.reshape(-1, *shape),
        )
    return gaits


def calibrate(trial: Path, settings: choices.CalibrationSettings, output: Path) -> None:
    """Marker clusters, ankle centre and axis of the static trial, to a JSON file."""
    write_model(static_calibration(read_trial(trial), settings), output)


def calibrated_trials(
    trials: Paths, calibrations: Paths, statics: Statics
) -> list[tuple[Trial, StaticCalibration]]:
    """The trials with the calibration of their static trial, as far as it was calibrated."""
    of_static = {path.stem: read_model(path, StaticCalibration) for path in calibrations}
    calibrated = []
    for path in trials:
        static = statics.get(path.stem)
        if static in of_static:
            calibrated.append((read_trial(path), of_static[static]))
    return calibrated


def identify_plate(
    trials: Paths,
    calibrations: Paths,
    statics: Statics,
    settings: choices.PlateModelSettings,
    output: Path,
    comparison: Path,
    data: str = "",
) -> None:
    """The plate's inertia and lag from trials of the unloaded plate, to a JSON file. The table
    `comparison` shows the unloaded plate's wrench before and after both are removed. A warning says
    so where the settings remove nothing."""
    if settings.plate_inertia == "none":
        warnings.warn(
            f"the plate's own inertia and lag stay in the torque: {NOT_REMOVED}", stacklevel=2
        )
        model = NO_CORRECTION
    else:
        model = identify_plate_model(calibrated_trials(trials, calibrations, statics), settings)
    write_model(model, output)
    table = plate_table(model).fill_nan(None)
    write_table(table.with_columns(plate_inertia=pl.lit(settings.plate_inertia)), comparison, data)


def measure_platform(
    trials: Paths,
    calibrations: Paths,
    statics: Statics,
    settings: choices.CrossingSettings,
    output: Path,
    comparison: Path,
    places: Places | None = None,
    data: str = "",
) -> None:
    """The motion that the platform's perturbations share, to a JSON file. The table `comparison`
    shows when each crossing's perturbation starts, and whether it follows the shared motion;
    `places` has joint and side of each."""
    model = identify_platform(calibrated_trials(trials, calibrations, statics), settings)
    write_model(model, output)
    write_table(with_places(platform_table(model), places or {}), comparison, data)


def analyse(
    trial: Path,
    calibration: Path | None,
    plate: Path | None,
    perturbed: bool,
    settings: choices.CrossingSettings,
    output: Path,
    direction: str | None = None,
    body_mass_kg: float | None = None,
    platform: Path | None = None,
    windows: str | None = None,
) -> None:
    """Write angle and torque of one crossing, with its events, or, with a warning, why there are
    none.

    Parameters
    ----------
    trial : Path
        The recording.
    calibration, plate : Path or None
        Those of its static trial and of the plate; without both the log is analysed.
    perturbed, direction, body_mass_kg, windows
        What the sheet states; windows as from-to [s].
    settings : CrossingSettings
    output : Path
        A Parquet file.
    platform : Path or None
        The motion that perturbed crossings share.
    """
    walked = read_trial(trial)
    shared = NO_SHARED_MOTION if platform is None else read_model(platform, PlatformModel)
    static = None if calibration is None else read_model(calibration, StaticCalibration)
    model = None if plate is None else read_model(plate, PlateModel)
    if windows:
        walked = walked.within(windows)
    try:
        if static is None or model is None:
            check_own_torque(walked)
            crossing = crossing_of_log(walked, perturbed, settings)
        else:
            crossing = analyse_crossing(walked, static, model, perturbed, settings, shared)
        if direction is not None:
            crossing = in_stated_direction(crossing, direction, settings)
        crossing = replace(crossing, body_mass=body_mass(walked, body_mass_kg))
    except OslAnalysisError as error:
        reason = str(error)
        if f"trial {walked.name}" not in reason:
            reason = f"trial {walked.name}: {reason}"
        warnings.warn(f"excluded: {reason}", stacklevel=2)
        write_refusal(RefusedCrossing(walked.name, perturbed, reason), output)
    else:
        write_crossing(crossing, output)


def in_stated_direction(
    crossing: Crossing, direction: str, settings: choices.CrossingSettings
) -> Crossing:
    """The crossing with the sign of its turn by the sheet where that is a command, not measured.
    Raises InputError where the measured direction is another one."""
    if crossing.turn and settings.by_command:
        size = abs(crossing.turn)
        crossing = replace(crossing, turn=size if direction == UP else -size)
    if crossing.direction in (None, direction):
        return crossing
    is_belt = settings.perturbed_by == "belt"
    what = "shift turned the ankle" if is_belt else "platform turned"
    raise InputError(
        f"trial {crossing.name}: the {what} by {np.rad2deg(crossing.turn or 0.0):.1f} deg"
        f" (positive: toes up), but the sheet says direction '{direction}', expected"
        f" '{crossing.direction}'; correct the sheet, or exclude the trial"
    )


@dataclass(frozen=True)
class GroupResult:
    """What a group adds to each table; without a result it has a reason, and no curves."""

    outcome: GroupOutcome
    summary: list[dict[str, Any]]  # rows of `walking_summary.csv`
    responses: pl.DataFrame | None = None  # rows of `walking_responses.csv`
    sensitivity: pl.DataFrame | None = None  # rows of `walking_sensitivity.csv`


def group_result(
    conditions: GroupConditions,
    fits: pl.DataFrame,
    files: Mapping[str, Path],
    gait: UnperturbedGait | None,
    settings: choices.EnsembleSettings,
) -> GroupResult:
    """Compute the result of a group from its rows `fits` of `walking.csv`.

    Without a result there is a warning.
    """
    group = conditions.group
    try:
        if gait is None:
            raise InputError(NO_GAIT)
        if len(fits) < FEWEST_FITS:
            raise InputError(f"{len(fits)} {TOO_FEW} walking_excluded.csv, or record more")
        crossings = [read_crossing(files[trial]) for trial in fits["trial"]]
        headline = group_headline(crossings, gait, settings)
    except OslAnalysisError as error:
        warnings.warn(f"no result of {group}: {error}", stacklevel=2)
        return result_without(conditions, len(fits), str(error))

    by_log = crossings[0].platform is None
    sensitivity = result_tables.sensitivity_table(group, headline, settings.uncertainty, by_log)
    stated_share = sensitivity["stated"] / sensitivity["size"]
    stated_se: dict[str, float] = {}  # by what the errors of the laboratory are stated to be
    for name in ESTIMATED:
        stated_se[name] = float(np.linalg.norm((stated_share * sensitivity[name]).to_numpy()))
    summary = []
    for row in result_tables.headline_rows(headline, fits, doubtful_row(fits), stated_se):
        commanded = conditions.cells.get(f"{row['quantity']}_d")  # K_d, B_d; no I is commanded
        summary.append({"group": group, **row, "commanded": commanded, "reason": None})
    timing = conditions.timing
    fitted_phase = None
    if timing.onset_phase is not None and timing.stance_s is not None:
        fitted_phase = float(timing.onset_phase + fitted_time(headline) / timing.stance_s)
    outcome = GroupOutcome(
        conditions,
        fitted_phase=fitted_phase,
        checks=check_group(headline),
        witnesses=check_witnesses(crossings, headline.ensemble.fit["K"], sensitivity),
    )
    responses = result_tables.response_table(group, headline)
    return GroupResult(outcome, summary, responses, sensitivity)


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


def select_crossings(
    crossings: Paths,
    settings: choices.SelectionSettings,
    output: Path,
    sheet: SheetCells,
    places: Places | None = None,
    data: str = "",
) -> None:
    """Write one row per crossing, in the order of the files: quality, group and, if it is excluded,
    the reason. A warning names the conditions of the `sheet` that split results although nobody
    asked for it."""
    analysed: list[Crossing] = []
    refused: list[RefusedCrossing] = []
    for path in crossings:
        crossing = read_crossing_file(path)
        if isinstance(crossing, RefusedCrossing):
            refused.append(crossing)
        else:
            analysed.append(crossing)
    rows = selection_rows(analysed, refused, settings, sheet)
    table = pl.DataFrame([rows[path.stem] for path in crossings], infer_schema_length=None)
    groups = table["group"].drop_nulls().unique(maintain_order=True)
    for remark in unasked_splits(groups.to_list(), sheet, settings):
        warnings.warn(remark, stacklevel=2)
    write_table(with_places(table, places or {}), output, data)


def unasked_splits(
    groups: Sequence[str], sheet: SheetCells, settings: choices.SelectionSettings
) -> Iterator[str]:
    """By what the crossings are split into groups although the configuration does not ask for
    it."""
    for key in split_keys(sheet, settings):
        if key in settings.group_by:
            continue
        values = cell_listing({cells.get(key) for cells in sheet.values()})
        yield (
            f"crossings differ in {key} ({values}): each value has a result of its own; write {key}"
            " under walking.group_by to keep that, or under walking.pool for one result"
        )
    timings = [group for group in groups if "timing " in group]
    if timings and "timing" not in settings.group_by:
        yield (
            f"perturbations begin at {len(timings)} different phases of stance"
            f" ({'; '.join(sorted(timings))}): each has a result of its own; write timing under"
            " walking.group_by to keep that, or under walking.pool for one result"
        )


def average_unperturbed(crossings: Paths, selection: Path, fewest: int, output: Path) -> None:
    """Write the unperturbed crossings that the table `selection` does not exclude, on a common grid
    of stance phase, by gait, to a Parquet file. A gait with fewer than the `fewest` is left out
    with a warning."""
    selected = selected_crossings(crossings, selection)
    unperturbed = [crossing for crossing in selected if crossing.onset is None]
    rows = read_table(selection, ["trial", "gait", "reason"])
    rows = rows.filter(pl.col("trial").is_in([path.stem for path in crossings]))
    gaits_of_trial: dict[str, list[str]] = {}
    for trial, cell in rows.select("trial", "gait").iter_rows():
        gaits_of_trial[trial] = (cell or "").split(SEPARATOR)
    reasons = dict(rows.drop_nulls("reason").select("trial", "reason").iter_rows())
    names = [name for name in dict.fromkeys(chain.from_iterable(gaits_of_trial.values())) if name]
    gaits: dict[str, UnperturbedGait] = {}
    problems: list[str] = []
    for name in names or [ALL]:
        of_gait = [crossing for crossing in unperturbed if name in gaits_of_trial[crossing.name]]
        unused: dict[str, str] = {}
        for trial, reason in reasons.items():
            if name == ALL or name in gaits_of_trial[trial]:
                unused[trial] = reason
        try:
            gaits[name] = unperturbed_gait(of_gait, fewest, unused)
        except InputError as error:
            problems.append(str(error) if name == ALL else f"{name}: {error}")
    if not gaits:
        raise InputError("; ".join(problems))
    for problem in problems:
        warnings.warn(problem, stacklevel=2)
    with atomic_path(output) as temporary:
        frames = [gait_frame(name, gait) for name, gait in gaits.items()]
        pl.concat(frames).write_parquet(temporary)


def gait_frame(name: str, gait: UnperturbedGait) -> pl.DataFrame:
    """A gait as a table with a row per crossing and phase of stance."""
    crossings, phases = len(gait.names), len(PHASES)
    rows = crossings * phases
    return pl.DataFrame({
        "gait": [name] * rows,
        "trial": np.repeat(gait.names, phases).tolist(),
        "theta": gait.theta.ravel(),
        "torque": gait.torque.ravel(),
        # (errors, crossings, phases) as (rows, errors)
        "plate_errors": gait.plate_errors.reshape(-1, rows).T,
        "lab_errors": gait.lab_errors.reshape(-1, rows).T,
        "stance_s": np.repeat(gait.stance, phases),
        "phase": np.tile(PHASES, crossings),
    })  # fmt: skip


def fit_perturbation(
    crossing: Path,
    selection: Path,
    unperturbed: Path,
    settings: choices.ResponseSettings,
    output: Path,
    data: str = "",
) -> None:
    """Write the row of `walking.csv` of one perturbed crossing: Eq. 15, or the reason why it is
    excluded or has no fit."""
    gaits = read_unperturbed_gaits(unperturbed)
    columns = ("reason", "gait", "group", "direction")
    rows = read_table(selection, ["trial", *columns]).filter(pl.col("trial") == crossing.stem)
    selected: dict[str, Any] = dict.fromkeys(columns)
    if len(rows):
        selected = rows.select(columns).row(0, named=True)
    gait = gaits.get(selected["gait"] or ALL)
    reason = selected["reason"] or (NO_GAIT if gait is None else None)
    # a campaign in which no perturbation can be used keeps its other results
    row: dict[str, object] = dict.fromkeys(result_tables.GROUP_QUANTITIES)
    if reason is None and gait is not None:
        try:
            row = result_tables.perturbation_row(read_crossing(crossing), gait, settings)
        except OslAnalysisError as error:
            reason = str(error)
            warnings.warn(f"excluded: {reason}", stacklevel=2)
    place = {"trial": crossing.stem, "group": selected["group"], "direction": selected["direction"]}
    write_table(pl.DataFrame([{**place, **row, EXCLUDED: reason}]), output, data)


def summarise_perturbations(
    *,
    table: Path,
    crossings: Paths,
    selection: Path,
    unperturbed: Path,
    settings: choices.EnsembleSettings,
    output: Path,
    responses: Path,
    excluded: Path,
    groups: Path,
    sensitivity: Path,
    sheet: SheetCells,
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
    excluded : Path
        The crossings that are not used, with the reason.
    groups : Path
        The conditions of each group.
    sensitivity : Path
        What errors of the laboratory would change.
    sheet : Mapping
        Cells of the sample sheet of each crossing.
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
    fits = read_table(table, ["trial"])
    chosen = with_reasons(read_table(selection, ["trial", "reason", "gait", "group"]), fits)
    not_used = chosen.select("trial", "perturbed", "reason").drop_nulls("reason")
    write_table(with_places(not_used, places), excluded, data)
    fitted = fits.filter(pl.col(EXCLUDED).is_null())
    if len(fitted) < FEWEST_FITS:
        exclusions = fits[EXCLUDED].drop_nulls()
        first = exclusions[0] if len(exclusions) else ""
        raise InputError(
            f"{table}: {len(fitted)} of {len(fits)} {TOO_FEW} its column {EXCLUDED}, or record more"
            f" ({first})"
        )
    gaits = read_unperturbed_gaits(unperturbed)
    files = {path.stem: path for path in crossings}
    places_of_groups: dict[str, dict[str, str | None]] = {}
    results: list[GroupResult] = []
    for conditions in group_conditions(chosen, sheet, gaits, settings.window_s):
        of_group = chosen.filter(pl.col("perturbed"), pl.col("group") == conditions.group)
        trials = of_group["trial"].to_list()
        sides = {places.get(trial, {}).get("side") for trial in trials}
        common_side = sides.pop() if len(sides) == 1 else None
        places_of_groups[conditions.group] = {"joint": JOINT, "side": common_side}
        group_fits = fitted.filter(pl.col("trial").is_in(trials))
        gait = gaits.get(conditions.gait)
        results.append(group_result(conditions, group_fits, files, gait, settings))

    response_tables = [r.responses for r in results if r.responses is not None]
    sensitivity_tables = [r.sensitivity for r in results if r.sensitivity is not None]
    if not response_tables:
        reasons = "; ".join(reason_text(result.outcome) for result in results)
        raise InputError(
            f"{table}: no result from {len(fits)} perturbations: {reasons}; see {excluded.name}"
        )
    outcomes = group_rows([result.outcome for result in results])
    group_table = pl.DataFrame(outcomes, infer_schema_length=None)
    findings = judged(group_table, limits or Limits(), "walking_groups")
    group_table = marked(group_table, findings, "walking_groups")
    tables = {
        output: summary_with_doubts(results, group_table),
        groups: group_table.drop("side"),
        responses: pl.concat(response_tables),
        sensitivity: pl.concat(sensitivity_tables),
    }
    for path, of_groups in tables.items():
        write_table(with_places(of_groups, places_of_groups, "group"), path, data)


def summary_with_doubts(results: Sequence[GroupResult], group_table: pl.DataFrame) -> pl.DataFrame:
    """The rows of `walking_summary.csv`; the doubts about a group are about its ensemble fit."""
    doubts = dict(zip(group_table["group"], group_table[DOUBTFUL], strict=True))
    rows: list[dict[str, Any]] = []
    for result in results:
        for row in result.summary:
            is_judged = row["estimator"] == result_tables.ENSEMBLE
            rows.append({**row, "doubt": doubts[row["group"]] if is_judged else None})
    return pl.DataFrame(rows, infer_schema_length=None)


def with_reasons(selection: pl.DataFrame, fits: pl.DataFrame) -> pl.DataFrame:
    """The selection of crossings, with the reason of those without a fit, which are in no group."""
    of_fits = fits.select("trial", EXCLUDED)
    chosen = selection.join(of_fits, on="trial", how="left", maintain_order="left")
    chosen = chosen.with_columns(reason=pl.coalesce("reason", EXCLUDED))
    return chosen.with_columns(group=pl.when(pl.col("reason").is_null()).then("group"))


def reason_text(outcome: GroupOutcome) -> str:
    """Why a group has no result, with its name if there are several."""
    group = outcome.conditions.group
    return str(outcome.reason) if group == ALL else f"{group}: {outcome.reason}"


def selected_crossings(crossings: Paths, selection: Path) -> list[Crossing]:
    """The crossings that the table `selection` does not exclude."""
    excluded = read_table(selection, ["trial", "reason"]).drop_nulls("reason")["trial"].to_list()
    return [read_crossing(path) for path in crossings if path.stem not in excluded]


def pilot_turn(folder: Path) -> tuple[float, float, float]:
    """Tell how the platform turned in the perturbed crossings that a campaign uses.

    Parameters
    ----------
    folder : Path
        Results of the campaign.

    Returns
    -------
    turn, duration, phase : float
        Medians of the turns [rad], of their durations [s] as a minimum-jerk ramp, and of their
        onsets as shares of stance; without any turn `USUAL_TURN`.
    """
    table = read_table(folder / "tables/walking_crossings.csv", ["trial", "reason"])
    turns: list[tuple[float, float, float]] = []
    for name in table.filter(pl.col("perturbed"), pl.col("reason").is_null())["trial"]:
        crossing = read_crossing(folder / f"crossings/{name}.parquet")
        if crossing.onset is None or crossing.platform is None or crossing.turn is None:
            continue
        ramp_s = ramp_duration(crossing.time, crossing.platform, crossing.onset)
        if ramp_s > 0:
            phase = float(crossing.stance.phase(np.array(crossing.onset)))
            turns.append((abs(crossing.turn), ramp_s, phase))
    turn, duration, phase = np.median(turns or [USUAL_TURN], axis=0).tolist()
    return turn, duration, phase


# turn of a platform in studies of walking [rad], its duration [s], and its phase of stance
USUAL_TURN = (float(np.deg2rad(5.0)), 0.08, 0.4)
BEFORE_ONSET_S = 0.02  # where the platform still rests
AFTER_ONSET_S = 1.0  # by when it has turned
RISE_SHARE = 0.506  # of a minimum-jerk ramp's duration, that it needs from 10 to 90 % of its turn


def ramp_duration(time: Array, platform: Array, onset: float) -> float:
    """Duration of a turn [s] from its rise time, for samples (n,) of its angle [rad]."""
    is_turning = (time >= onset - BEFORE_ONSET_S) & (time <= onset + AFTER_ONSET_S)
    time = time[is_turning]
    angle = np.abs(platform[is_turning] - platform[is_turning][0])
    begins_s = float(time[np.argmax(angle >= 0.1 * angle.max())])
    ends_s = float(time[np.argmax(angle >= 0.9 * angle.max())])
    return (ends_s - begins_s) / RISE_SHARE


def planned_crossings(
    folder: Path,
    counts: Sequence[int],
    planned: PlannedTurn,
    both: bool,
    settings: choices.WalkingAnalysis,
) -> pl.DataFrame:
    """Plan the number of perturbed crossings.

    Parameters
    ----------
    folder : Path
        Results of a campaign, whose unperturbed crossings tell the scatter.
    counts : Sequence of int
        Numbers of perturbed crossings.
    planned : PlannedTurn
    both : bool
        Whether the platform turns in both directions.
    settings : WalkingAnalysis

    Returns
    -------
    polars.DataFrame
        Expected halves of the 95 % intervals of K, B and I, by gait and count, for as many
        unperturbed crossings as the campaign has.

    Raises
    ------
    InputError
        The campaign uses no unperturbed crossing.
    """
    selection = folder / "tables/walking_crossings.csv"
    table = read_table(selection, ["trial", "gait", "reason"])
    used = table.filter(~pl.col("perturbed"), pl.col("reason").is_null())
    names_by_gait: dict[str, list[str]] = {}
    for name, cell in used.select("trial", "gait").iter_rows():
        for gait in (cell or ALL).split(SEPARATOR):
            names_by_gait.setdefault(gait, []).append(name)
    frames = []
    for gait, names in names_by_gait.items():
        walked = [read_crossing(folder / f"crossings/{name}.parquet") for name in names]
        scatter = scatter_of_one(walked, planned, settings)
        expected = half_widths(scatter, counts, len(walked), both)
        frames.append(expected.select(pl.lit(gait).alias("gait"), pl.all()))
    if not frames:
        raise InputError(
            f"{selection}: no unperturbed crossing is used; record some, or see its column reason"
        )
    return pl.concat(frames)


def compare_ankle_moment(
    trial: Trial,
    settings: choices.OvergroundAnalysis,
    condition: Mapping[str, float | None] | None = None,
) -> Mapping[str, pl.DataFrame]:
    """Our ankle moment, and the laboratory's, of each stance, and over it; `condition` may state
    `body_mass_kg`."""
    contacts = overground_contacts(trial, settings, (condition or {}).get("body_mass_kg"))
    table = pl.DataFrame([contact.row() for contact in contacts], infer_schema_length=None)
    for row in table.drop_nulls("excluded").iter_rows(named=True):
        warnings.warn(
            f"trial {trial.name}: the {row['side']} stance at {row['heel_strike_s']:.2f} s on plate"
            f" {row['plate']} is excluded: {row['excluded']}",
            stacklevel=2,
        )
    used = table.filter(pl.col("excluded").is_null())
    used = used.with_columns(pl.col(CURVES).cast(pl.List(pl.Float64)))
    curves = used.select("trial", "side", "plate", "heel_strike_s", *CURVES).explode(CURVES)
    return {"ankle_moment": table.drop(CURVES), "ankle_moment_curves": curves.fill_nan(None)}


def tabulate_over_stance(
    summary: Path,
    groups: Path,
    output: Path,
    stance_share: float,
    trajectory: Paths = (),
    data: str = "",
) -> None:
    """K, B and I of every group at the phase of stance that its fit reads, with interval and
    commanded value, from the file of a `trajectory` over the gait cycle, if there is one; stance is
    the first `stance_share` of it."""
    columns = ("group", "quantity", "estimator", "n", "mean", "se", "low", "high", "commanded")
    estimates = read_table(summary, columns)
    conditions = read_table(groups, result_tables.OVER_STANCE_COLUMNS)
    table = result_tables.impedance_over_stance(estimates, conditions)
    for curves in commanded_over_stance(trajectory, data, stance_share):
        table = result_tables.with_trajectory(table, *curves)
    write_table(table, output, data)


def commanded_over_stance(
    trajectory: Paths, data: str, stance_share: float
) -> Iterator[tuple[Array, Array, Array]]:
    """Phases of stance (n,), K_d [N*m/rad] and B_d [N*m*s/rad] of each trajectory that the leg was
    commanded: no measured leg (`data`) was commanded a synthetic one."""
    phases = np.linspace(0, 1, 101)
    for path in trajectory:
        desired = read_impedance_trajectory(path)
        if data != MEASURED or desired.kind != SYNTHETIC:
            cycle = phases * stance_share
            yield phases, desired.at(desired.K_d, cycle), desired.at(desired.B_d, cycle)
