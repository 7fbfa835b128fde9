"""Jobs of the walkway: calibration, plate, crossings and their files, and the tables of Fig. 9."""

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
from osl_analysis.judge.finding import Limits
from osl_analysis.judge.judging import EXCLUDED, judged, marked
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
    check_not_refused(path)
    step = f"run the step '{WRITTEN_BY[kind]}'"
    if not path.is_file():
        raise InputError(f"{path}: no such file; {step} first")
    try:
        found: Kind = ADAPTERS[kind].validate_json(path.read_bytes())
        return found
    except ValueError as error:
        why = " ".join(str(error).split())
        raise InputError(
            f"{path}: not what this step writes ({why}); delete it and {step}"
        ) from error


def write_crossing(crossing: Crossing, path: Path) -> None:
    """Write a crossing as a trial: arrays (..., n) as columns beside the phase of stance, the rest
    as provenance."""
    content = ADAPTERS[Crossing].dump_python(crossing)
    columns = {
        name: content.pop(name).T
        for name, value in list(content.items())
        if isinstance(value, np.ndarray)
    }
    columns = {
        "time": columns.pop("time"),
        "phase": crossing.stance.phase(crossing.time),
        **columns,
    }
    write_trial(Trial(crossing.name, pl.DataFrame(columns), content), path)


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
    signals = {
        name: trial.samples[name].to_numpy().T for name in trial.samples.columns if name != "phase"
    }
    crossing: Crossing = ADAPTERS[Crossing].validate_python(signals | dict(trial.provenance))
    return crossing


def read_unperturbed_gaits(path: Path) -> dict[str, UnperturbedGait]:
    """Read what `average_unperturbed` wrote: gaits with fewer crossings than the least are not
    among them."""
    check_not_refused(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; run the step 'average-unperturbed' first")
    gaits = {}
    for frame in pl.read_parquet(path).partition_by("gait", maintain_order=True):
        names = frame["trial"].unique(maintain_order=True).to_list()
        theta, torque, stance = (
            frame[c].to_numpy().reshape(len(names), -1) for c in ("theta", "torque", "stance_s")
        )
        errors = (
            frame[name].to_numpy().T.reshape(-1, *theta.shape)
            for name in ("plate_errors", "lab_errors")
        )
        gaits[str(frame["gait"][0])] = UnperturbedGait(
            tuple(names), theta, torque, stance[:, 0], *errors
        )
    return gaits


def calibrate(trial: Path, settings: choices.CalibrationSettings, output: Path) -> None:
    """Marker clusters, ankle centre and axis of the static trial, to a JSON file."""
    write_model(static_calibration(read_trial(trial), settings), output)


def calibrated_trials(
    trials: Paths, calibrations: Paths, statics: Statics
) -> list[tuple[Trial, StaticCalibration]]:
    read = {path.stem: read_model(path, StaticCalibration) for path in calibrations}
    own = {trial: read[static] for trial, static in statics.items() if static in read}
    return [(read_trial(path), own[path.stem]) for path in trials if path.stem in own]


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
    """Angle and torque of one crossing, with its events, to a Parquet file, or there, with a
    warning, why there are none. `perturbed`, `direction`, `body_mass_kg` and `windows`, from-to
    [s], are the sheet's; `platform` is what crossings share. Without a `calibration` and a `plate`
    the log is analysed."""
    walked, shared = (
        read_trial(trial),
        NO_SHARED_MOTION if platform is None else read_model(platform, PlatformModel),
    )
    static = None if calibration is None else read_model(calibration, StaticCalibration)
    model = None if plate is None else read_model(plate, PlateModel)
    if windows:
        first, last = (walked.samples["time"][0] + float(end) for end in windows.split("-"))
        walked = replace(
            walked, samples=walked.samples.filter(pl.col("time").is_between(first, last))
        )
    try:
        if static is None or model is None:
            check_own_torque(walked)
            crossing = crossing_of_log(walked, perturbed, settings)
        else:
            crossing = analyse_crossing(walked, static, model, perturbed, settings, shared)
        if crossing.turn and direction is not None and settings.by_command:
            crossing = replace(crossing, turn=abs(crossing.turn) * (1 if direction == UP else -1))
        if direction is not None and crossing.direction not in (None, direction):
            what = (
                "shift turned the ankle" if settings.perturbed_by == "belt" else "platform turned"
            )
            raise InputError(
                f"trial {walked.name}: the {what} by {np.rad2deg(crossing.turn or 0.0):.1f} deg"
                f" (positive: toes up), but the sheet says direction '{direction}', expected"
                f" '{crossing.direction}'; correct the sheet, or exclude the trial"
            )
        crossing = replace(crossing, body_mass=body_mass(walked, body_mass_kg))
    except OslAnalysisError as error:
        reason = (
            str(error) if f"trial {walked.name}" in str(error) else f"trial {walked.name}: {error}"
        )
        warnings.warn(f"excluded: {reason}", stacklevel=2)
        write_refusal(RefusedCrossing(walked.name, perturbed, reason), output)
    else:
        write_crossing(crossing, output)


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
        if len(fits) < 2:
            raise InputError(f"{len(fits)} {TOO_FEW} walking_excluded.csv, or record more")
        crossings = [read_crossing(files[trial]) for trial in fits["trial"]]
        headline = group_headline(crossings, gait, settings)
    except OslAnalysisError as error:
        warnings.warn(f"no result of {group}: {error}", stacklevel=2)
        reason = str(error)
        summary: list[dict[str, Any]] = [
            {
                "group": group,
                "quantity": quantity,
                "estimator": result_tables.ENSEMBLE,
                "n": len(fits),
                "mean": None,
                "reason": reason,
            }
            for quantity in result_tables.GROUP_QUANTITIES
        ]
        return GroupResult(GroupOutcome(conditions, reason=reason), summary)

    by_log = crossings[0].platform is None
    sensitivity = result_tables.sensitivity_table(group, headline, settings.uncertainty, by_log)
    stated_share = sensitivity["stated"] / sensitivity["size"]
    stated_se = {
        name: float(np.linalg.norm((stated_share * sensitivity[name]).to_numpy()))
        for name in ESTIMATED
    }
    rows = result_tables.headline_rows(headline, fits, doubtful_row(fits), stated_se)
    commanded = {name: conditions.cells.get(f"{name}_d") for name in ("K", "B")}
    summary = [
        {"group": group, **row, "commanded": commanded.get(str(row["quantity"])), "reason": None}
        for row in rows
    ]
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


def select_crossings(
    crossings: Paths,
    settings: choices.SelectionSettings,
    output: Path,
    sheet: SheetCells,
    places: Places | None = None,
    data: str = "",
) -> None:
    """One row per crossing, in the order of the files: quality, group and, if it is excluded, the
    reason. A warning names the conditions of the `sheet` that split results although nobody asked
    for it."""
    read = [read_crossing_file(path) for path in crossings]
    refused = [c for c in read if isinstance(c, RefusedCrossing)]
    rows = selection_rows([c for c in read if isinstance(c, Crossing)], refused, settings, sheet)
    table = pl.DataFrame([rows[path.stem] for path in crossings], infer_schema_length=None)
    said = [
        f"crossings differ in {key} ({cell_listing({cells.get(key) for cells in sheet.values()})}):"
        f" each value has a result of its own; write {key} under walking.group_by to keep that, or"
        " under walking.pool for one result"
        for key in split_keys(sheet, settings)
        if key not in settings.group_by
    ]
    timed = [
        name
        for name in table["group"].drop_nulls().unique(maintain_order=True)
        if "timing " in name
    ]
    if timed and "timing" not in settings.group_by:
        said.append(
            f"perturbations begin at {len(timed)} different phases of stance"
            f" ({'; '.join(sorted(timed))}): each has a result of its own; write timing under"
            " walking.group_by to keep that, or under walking.pool for one result"
        )
    for sentence in said:
        warnings.warn(sentence, stacklevel=2)
    write_table(with_places(table, places or {}), output, data)


def average_unperturbed(crossings: Paths, selection: Path, fewest: int, output: Path) -> None:
    """The unperturbed crossings that the table `selection` does not exclude, on a common grid of
    stance phase, by gait, to a Parquet file. A gait with fewer than the `fewest` is left out with a
    warning."""
    unperturbed = [
        crossing for crossing in selected_crossings(crossings, selection) if crossing.onset is None
    ]
    rows = read_table(selection, ["trial", "gait", "reason"])
    rows = rows.filter(pl.col("trial").is_in([path.stem for path in crossings]))
    served = dict(zip(rows["trial"], rows["gait"].fill_null("").str.split(SEPARATOR), strict=True))
    reasons = dict(rows.drop_nulls("reason").select("trial", "reason").iter_rows())
    names = dict.fromkeys(name for gaits in served.values() for name in gaits if name) or {
        ALL: None
    }
    gaits, problems = {}, []
    for name in names:
        of_gait = [crossing for crossing in unperturbed if name in served[crossing.name]]
        lost = {trial: why for trial, why in reasons.items() if name in (*served[trial], ALL)}
        try:
            gaits[name] = unperturbed_gait(of_gait, fewest, lost)
        except InputError as error:
            problems.append(f"{error}" if name == ALL else f"{name}: {error}")
    if not gaits:
        raise InputError("; ".join(problems))
    for problem in problems:
        warnings.warn(problem, stacklevel=2)
    frames = []
    for name, gait in gaits.items():  # a row per crossing and phase of stance
        trials = np.repeat(gait.names, len(PHASES)).tolist()
        curves: dict[str, Array] = {"theta": gait.theta.ravel(), "torque": gait.torque.ravel()}
        curves |= {
            each: getattr(gait, each).reshape(-1, len(trials)).T
            for each in ("plate_errors", "lab_errors")
        }
        curves |= {"stance_s": np.repeat(gait.stance, len(trials) // len(gait.names))}
        curves |= {"phase": np.tile(PHASES, len(gait.names))}
        frames.append(pl.DataFrame({"gait": [name] * len(trials), "trial": trials, **curves}))
    with atomic_path(output) as temporary:
        pl.concat(frames).write_parquet(temporary)


def fit_perturbation(
    crossing: Path,
    selection: Path,
    unperturbed: Path,
    settings: choices.ResponseSettings,
    output: Path,
    data: str = "",
) -> None:
    """The row of `walking.csv` of one perturbed crossing: Eq. 15, or the reason why it is excluded
    or has no fit."""
    gaits, columns = read_unperturbed_gaits(unperturbed), ("reason", "gait", "group", "direction")
    rows = read_table(selection, ["trial", *columns]).filter(pl.col("trial") == crossing.stem)
    place = dict.fromkeys(columns) if rows.is_empty() else rows.select(columns).row(0, named=True)
    gait = gaits.get(place["gait"] or ALL)
    reason = place["reason"] or (NO_GAIT if gait is None else None)
    # a campaign in which no perturbation can be used keeps its other results
    row: dict[str, object] = dict.fromkeys(result_tables.GROUP_QUANTITIES)
    if reason is None and gait is not None:
        try:
            row = result_tables.perturbation_row(read_crossing(crossing), gait, settings)
        except OslAnalysisError as error:
            reason = str(error)
            warnings.warn(f"excluded: {reason}", stacklevel=2)
    known = {"trial": crossing.stem, "group": place["group"], "direction": place["direction"]}
    write_table(pl.DataFrame([known | row | {EXCLUDED: reason}]), output, data)


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
    """Per group the mean over perturbations and the ensemble fit to `output`, its conditions to
    `groups`, responses in their window to `responses`, what errors of the laboratory would change
    to `sensitivity`, and the crossings that are not used, with the reason, to `excluded`. `table`
    is `walking.csv`, `crossings` are the perturbed ones. A group beyond one of the `limits` is
    doubtful."""
    places = places or {}
    fits, chosen = (
        read_table(table, ["trial"]),
        read_table(selection, ["trial", "reason", "gait", "group"]),
    )
    # the crossings without a fit, in the order of the selection, with the reason, are in no group
    chosen = chosen.join(
        fits.select("trial", EXCLUDED), on="trial", how="left", maintain_order="left"
    )
    chosen = chosen.with_columns(reason=pl.coalesce("reason", EXCLUDED))
    chosen = chosen.with_columns(group=pl.when(pl.col("reason").is_null()).then("group"))
    left = chosen.select("trial", "perturbed", "reason").drop_nulls("reason")
    write_table(with_places(left, places), excluded, data)
    fitted = fits.filter(pl.col(EXCLUDED).is_null())
    if len(fitted) < 2:
        why = next(iter(fits[EXCLUDED].drop_nulls()), "")
        raise InputError(
            f"{table}: {len(fitted)} of {len(fits)} {TOO_FEW} its column {EXCLUDED}, or record more"
            f" ({why})"
        )
    gaits, files = read_unperturbed_gaits(unperturbed), {path.stem: path for path in crossings}
    sides, results = {}, []
    for conditions in group_conditions(chosen, sheet, gaits, settings.window_s):
        of_group = chosen.filter(pl.col("perturbed"), pl.col("group") == conditions.group)
        trials = of_group["trial"].to_list()
        sides_of_trials = {places.get(trial, {}).get("side") for trial in trials}
        side = sides_of_trials.pop() if len(sides_of_trials) == 1 else None
        sides[conditions.group] = {"joint": JOINT, "side": side}
        group_fits = fitted.filter(pl.col("trial").is_in(trials))
        gait = gaits.get(conditions.gait)
        results.append(group_result(conditions, group_fits, files, gait, settings))

    response_tables = [r.responses for r in results if r.responses is not None]
    sensitivity_tables = [r.sensitivity for r in results if r.sensitivity is not None]
    if not response_tables:
        reasons = "; ".join(
            f"{result.outcome.reason}"
            if result.outcome.conditions.group == ALL
            else f"{result.outcome.conditions.group}: {result.outcome.reason}"
            for result in results
        )
        raise InputError(
            f"{table}: no result from {len(fits)} perturbations: {reasons}; see {excluded.name}"
        )
    group_table = pl.DataFrame(
        group_rows([result.outcome for result in results]), infer_schema_length=None
    )
    verdicts = judged(group_table, limits or Limits(), "walking_groups")
    group_table = marked(group_table, verdicts, "walking_groups")
    doubts = dict(zip(group_table["group"], group_table[DOUBTFUL], strict=True))
    rows = [
        {
            **row,
            "doubt": doubts[row["group"]] if row["estimator"] == result_tables.ENSEMBLE else None,
        }
        for result in results
        for row in result.summary
    ]
    write_table(
        with_places(pl.DataFrame(rows, infer_schema_length=None), sides, "group"), output, data
    )
    write_table(with_places(group_table.drop("side"), sides, "group"), groups, data)
    write_table(with_places(pl.concat(response_tables), sides, "group"), responses, data)
    write_table(with_places(pl.concat(sensitivity_tables), sides, "group"), sensitivity, data)


def selected_crossings(crossings: Paths, selection: Path) -> list[Crossing]:
    """The crossings that the table `selection` does not exclude."""
    excluded = read_table(selection, ["trial", "reason"]).drop_nulls("reason")["trial"].to_list()
    return [read_crossing(path) for path in crossings if path.stem not in excluded]


def pilot_turn(folder: Path) -> tuple[float, float, float]:
    """Medians of the turns of the platform [rad], of their durations [s], by a minimum-jerk ramp
    from 10 to 90 % of the turn, and of their onsets as shares of stance, in the perturbed crossings
    that a campaign uses, else usual ones."""
    table = read_table(folder / "tables/walking_crossings.csv", ["trial", "reason"])
    found = []
    for name in table.filter(pl.col("perturbed"), pl.col("reason").is_null())["trial"]:
        crossing = read_crossing(folder / f"crossings/{name}.parquet")
        if crossing.onset is None or crossing.platform is None or crossing.turn is None:
            continue
        after = (crossing.time >= crossing.onset - 0.02) & (crossing.time <= crossing.onset + 1.0)
        time, angle = (
            crossing.time[after],
            np.abs(crossing.platform[after] - crossing.platform[after][0]),
        )
        reached = [float(time[np.argmax(angle >= share * angle.max())]) for share in (0.1, 0.9)]
        ramp_s = (reached[1] - reached[0]) / 0.506
        if ramp_s > 0:
            found.append(
                (abs(crossing.turn), ramp_s, float(crossing.stance.phase(np.array(crossing.onset))))
            )
    turn, ramp_s, phase = np.median(found or [(np.deg2rad(5.0), 0.08, 0.4)], axis=0).tolist()
    return turn, ramp_s, phase


def planned_crossings(
    folder: Path,
    counts: Sequence[int],
    planned: PlannedTurn,
    both: bool,
    settings: choices.WalkingAnalysis,
) -> pl.DataFrame:
    """Expected halves of the 95 % intervals of K, B and I for these numbers of perturbed crossings,
    from those unperturbed ones that the campaign in `folder` uses, by gait: as many unperturbed
    ones as it has."""
    selection = folder / "tables/walking_crossings.csv"
    table = read_table(selection, ["trial", "gait", "reason"])
    used = table.filter(~pl.col("perturbed"), pl.col("reason").is_null())
    frames = []
    for gait in dict.fromkeys(
        name for gaits in used["gait"] for name in (gaits or ALL).split(SEPARATOR)
    ):
        names = [
            row["trial"]
            for row in used.iter_rows(named=True)
            if gait in (row["gait"] or ALL).split(SEPARATOR)
        ]
        walked = [read_crossing(folder / f"crossings/{name}.parquet") for name in names]
        scatter = scatter_of_one(walked, planned, settings)
        table = half_widths(scatter, counts, len(walked), both)
        frames.append(table.select(pl.lit(gait).alias("gait"), pl.all()))
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
        where = (
            f"trial {trial.name}: the {row['side']} stance at {row['heel_strike_s']:.2f} s on plate"
            f" {row['plate']}"
        )
        warnings.warn(f"{where} is excluded: {row['excluded']}", stacklevel=2)
    used = table.filter(pl.col("excluded").is_null()).with_columns(
        pl.col(CURVES).cast(pl.List(pl.Float64))
    )
    curves = (
        used.select("trial", "side", "plate", "heel_strike_s", *CURVES)
        .explode(CURVES)
        .fill_nan(None)
    )
    return {"ankle_moment": table.drop(CURVES), "ankle_moment_curves": curves}


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
    needed = ("group", "quantity", "estimator", "n", "mean", "se", "low", "high", "commanded")
    table = result_tables.impedance_over_stance(
        read_table(summary, needed), read_table(groups, result_tables.OVER_STANCE_COLUMNS)
    )
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
