"""Files that the walking jobs share: static calibration, plate's model, analysed crossings, unperturbed gait.

Calibration and plate's model are JSON. A crossing is a trial in Parquet whose provenance holds its events, or the
reason why it was refused.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.refusal import check_not_refused
from osl_analysis.sheet import JOINT
from osl_analysis.table import Places, finite_or_null, with_places
from osl_analysis.trial import NAME_KEY, PROVENANCE_KEY, Trial, read_trial, write_trial
from osl_analysis.walking.bodies import SEGMENTS, StaticCalibration
from osl_analysis.walking.crossing import Crossing, CrossingQuality, RefusedCrossing
from osl_analysis.walking.gait import PHASES, UnperturbedGait
from osl_analysis.walking.plate import COMPONENTS, PARAMETERS, Load, PlateInertia, PlateModel, Stance
from osl_analysis.walking.platform import Alignment, PlatformModel, PlatformTemplate, TriggerLatency
from osl_analysis.walking.setup import EncoderCheck

SIGNALS = ("time", "phase", "theta", "torque", "platform")
LOAD, LOAD_LEFT = "load", "pressure_left"
"""Columns with the vertical force [N] on the foot, and the centre of pressure to the left of the ankle [m]."""
PLATE_ERROR = "plate_error_"  # Prefix of the columns with the plate's errors
REFUSED = "refused"


def write_calibration(calibration: StaticCalibration, trial: str, path: Path) -> None:
    """Write the static calibration from a trial [m, laboratory axes of the static trial]."""
    write_json({"trial": trial, **asdict(calibration)}, path)


def read_calibration(path: Path) -> StaticCalibration:
    """Read what `write_calibration` wrote."""
    content = read_json(path, "calibrate", *SEGMENTS, "ankle_centre", "ankle_axis")
    foot, shank, platform = ({marker: np.array(p) for marker, p in content[name].items()} for name in SEGMENTS)
    return StaticCalibration(foot, shank, platform, np.array(content["ankle_centre"]), np.array(content["ankle_axis"]))


def write_plate(plate: PlateModel, path: Path) -> None:
    """Write the plate's model, and the models without each trial in turn under `leave_one_out`."""
    others = [plate_content(model) for model in plate.leave_one_out]
    write_json({**plate_content(plate), "leave_one_out": others}, path)


def plate_content(plate: PlateModel) -> dict[str, Any]:
    """The plate's inertial parameters [SI] with standard errors, lag [s], wrench before and after [N, N*m]."""
    inertia = plate.inertia
    parameters = {
        name: {"value": float(value), "se": float(se)}
        for name, value, se in zip(PARAMETERS, inertia.parameters, inertia.standard_errors, strict=True)
    }
    before, after = (
        finite_or_null(dict(zip(COMPONENTS, rms.tolist(), strict=True)))
        for rms in (inertia.rms_before, inertia.rms_after)
    )
    lag = {"lag_s": plate.lag, "lag_unknown": plate.lag_reason, "lag_se_s": plate.lag_se, "lags_s": plate.lags.tolist()}
    return {"parameters": parameters, **lag, "rms_before": before, "rms_after": after}


def read_plate(path: Path) -> PlateModel:
    """Read what `write_plate` wrote."""
    required = ("parameters", "lag_s", "lag_unknown", "lag_se_s", "lags_s", "rms_before", "rms_after", "leave_one_out")
    content = read_json(path, "identify-plate", *required)
    others = tuple(plate_from_content(model) for model in content["leave_one_out"])
    return replace(plate_from_content(content), leave_one_out=others)


def plate_from_content(content: Mapping[str, Any]) -> PlateModel:
    """The model that `plate_content` described."""
    values, errors = (np.array([content["parameters"][p][field] for p in PARAMETERS]) for field in ("value", "se"))
    before, after = (np.array([content[f][c] for c in COMPONENTS], dtype=float) for f in ("rms_before", "rms_after"))
    inertia = PlateInertia(values, errors, before, after)
    lags = np.array(content["lags_s"], dtype=float)
    return PlateModel(inertia, content["lag_s"], content["lag_se_s"], lags, lag_reason=content["lag_unknown"])


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write a JSON file, complete or not at all; arrays are lists, dataclasses objects."""

    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else asdict(value)

    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, default=plain) + "\n", encoding="utf-8")


def read_json(path: Path, step: str, *required: str) -> dict[str, Any]:
    """Read a JSON file that `step` wrote."""
    check_not_refused(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; run the step '{step}' first")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not JSON ({error}); delete it and run the step '{step}'") from error
    absent = [name for name in required if not isinstance(content, dict) or name not in content]
    if absent:
        raise InputError(f"{path}: no field '{absent[0]}'; delete it and run the step '{step}'")
    return dict(content)


def write_crossing(crossing: Crossing, path: Path) -> None:
    """Write a crossing as a trial: its signals and `plate_error_0`, ...; the events in the provenance."""
    phase = (crossing.time - crossing.stance.heel_strike) / crossing.stance.duration
    signals = (crossing.time, phase, crossing.theta, crossing.torque, crossing.platform)
    errors = {f"{PLATE_ERROR}{i}": error for i, error in enumerate(crossing.plate_errors)}
    load = {} if crossing.load is None else {LOAD: crossing.load.force, LOAD_LEFT: crossing.load.left}
    samples = pl.DataFrame(dict(zip(SIGNALS, signals, strict=True)) | load | errors)
    events = {
        "heel_strike_s": crossing.stance.heel_strike,
        "toe_off_s": crossing.stance.toe_off,
        "onset_s": crossing.onset,
        "bridged": crossing.bridged,
        "turn_rad": crossing.turn,
        "body_mass_kg": crossing.body_mass,
        "quality": asdict(crossing.quality),
    }
    write_trial(Trial(crossing.name, samples, events), path)


def write_refusal(refused: RefusedCrossing, path: Path) -> None:
    """Write a crossing's file without rows, with the reason in its provenance, so that other crossings are analysed."""
    reason = {REFUSED: refused.reason, "perturbed": refused.perturbed}
    metadata = {NAME_KEY: refused.name, PROVENANCE_KEY: json.dumps(reason)}
    with atomic_path(path) as temporary:
        pl.DataFrame(schema=dict.fromkeys(SIGNALS, pl.Float64)).write_parquet(temporary, metadata=metadata)


def read_crossing(path: Path) -> Crossing:
    """Read a crossing."""
    crossing = read_crossing_file(path)
    if isinstance(crossing, RefusedCrossing):
        raise InputError(f"{path}: the crossing was refused: {crossing.reason}")
    return crossing


def read_crossing_file(path: Path) -> Crossing | RefusedCrossing:
    """Read what `write_crossing` or `write_refusal` wrote."""
    if path.is_file():
        try:
            metadata = pl.read_parquet_metadata(path)
        except (pl.exceptions.PolarsError, OSError):
            metadata = {}
        facts = json.loads(metadata.get(PROVENANCE_KEY, "{}"))
        if REFUSED in facts:
            return RefusedCrossing(metadata[NAME_KEY], facts["perturbed"], facts[REFUSED])
    trial = read_trial(path)
    events = trial.provenance
    if "heel_strike_s" not in events:
        raise InputError(f"{path}: a trial without events; run the step 'analyse' and use its crossing")
    quality, (time, theta, torque, platform) = events["quality"], trial.signals("theta", "torque", "platform")
    encoder, (forward, left) = quality["encoder"] and EncoderCheck(**quality["encoder"]), quality["placement"]
    return Crossing(
        trial.name,
        time,
        theta,
        torque,
        platform,
        stance=Stance(events["heel_strike_s"], events["toe_off_s"]),
        onset=events["onset_s"],
        bridged=events["bridged"],
        quality=CrossingQuality(quality["residuals"], quality["zero"], (forward, left), encoder, quality["outside"]),
        plate_errors=plate_error_columns(trial.samples).reshape(-1, len(time)),
        load=Load(*trial.signals(LOAD, LOAD_LEFT)[1:]) if LOAD in trial.samples.columns else None,
        turn=events.get("turn_rad"),
        body_mass=events.get("body_mass_kg"),
    )


def plate_error_columns(frame: pl.DataFrame) -> np.ndarray:
    """The plate's errors (m, rows) [N*m] in a file's columns `plate_error_0`, ..."""
    return frame.select(pl.col(f"^{PLATE_ERROR}.*$")).to_numpy().T


def on_the_walkway(table: pl.DataFrame, places: Places | None, by: str = "trial") -> pl.DataFrame:
    """A table of crossings or groups with the columns `joint`, which the walkway decides, and `side`."""
    known = {name: {"joint": JOINT, "side": (places or {}).get(name, {}).get("side")} for name in table[by].unique()}
    return with_places(table, known, by)


def write_platform(model: PlatformModel, path: Path) -> None:
    """Write the shape, how each crossing follows it, and the trigger's latency [SI]."""
    write_json({**vars(model), "alignments": list(model.alignments.values())}, path)


def read_platform(path: Path) -> PlatformModel:
    """Read what `write_platform` wrote."""

    def shape(content: Mapping[str, Any]) -> PlatformTemplate:
        arrays = {name: np.array(content[name], dtype=float) for name in ("axes", "time", "shape")}
        return PlatformTemplate(**{**content, **arrays})

    content = read_json(path, "measure-platform", *(field.name for field in fields(PlatformModel)))
    alignments = [Alignment(**{**a, "offset": np.array(a["offset"], dtype=float)}) for a in content["alignments"]]
    return PlatformModel(
        content["template"] and shape(content["template"]),
        content["reason"],
        {a.name: a for a in alignments},
        content["triggers"],
        content["latency"] and TriggerLatency(**content["latency"]),
        tuple(map(shape, content["leave_out"])),
    )


def write_unperturbed_gaits(gaits: Mapping[str, UnperturbedGait], path: Path) -> None:
    """Write the unperturbed crossings of each gait, by its name: a row per crossing and phase."""
    n, frames = len(PHASES), []
    for name, gait in gaits.items():
        crossings = np.repeat(gait.names, n).tolist()
        known = {"gait": [name] * len(crossings), "trial": crossings, "stance_s": np.repeat(gait.stance, n)}
        curves = {"theta": gait.theta.ravel(), "torque": gait.torque.ravel()}
        curves |= {f"{PLATE_ERROR}{i}": error.ravel() for i, error in enumerate(gait.plate_errors)}
        frames.append(pl.DataFrame({**known, "phase": np.tile(PHASES, len(gait.names)), **curves}))
    with atomic_path(path) as temporary:
        pl.concat(frames).write_parquet(temporary)


def read_unperturbed_gaits(path: Path) -> dict[str, UnperturbedGait]:
    """Read what `write_unperturbed_gaits` wrote: gaits with fewer crossings than the least are not among them."""
    check_not_refused(path)
    step, gaits = "'average-unperturbed'", {}
    if not path.is_file():
        raise InputError(f"{path}: no such file; run the step {step} first")
    try:
        for frame in pl.read_parquet(path).partition_by("gait", maintain_order=True):
            names = frame["trial"].unique(maintain_order=True).to_list()
            theta, torque, stance = (
                frame[c].to_numpy().reshape(len(names), -1) for c in ("theta", "torque", "stance_s")
            )
            errors = plate_error_columns(frame).reshape(-1, *theta.shape)
            gaits[str(frame["gait"][0])] = UnperturbedGait(tuple(names), theta, torque, stance[:, 0], errors)
    except (pl.exceptions.PolarsError, OSError) as error:
        said = str(error).splitlines()[0]
        raise InputError(f"{path}: not unperturbed gait ({said}); delete it and run the step {step}") from error
    return gaits
