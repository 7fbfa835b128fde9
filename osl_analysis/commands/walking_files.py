"""The files of the walkway between its jobs: calibrations, models, crossings and mean gaits."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from pydantic import TypeAdapter

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path, write_text
from osl_analysis.schema import SCHEMA
from osl_analysis.table import check_analysed, read_table
from osl_analysis.trial import (
    NAME_KEY,
    PROVENANCE_KEY,
    SCHEMA_KEY,
    Array,
    Trial,
    metadata_of,
    read_trial,
    write_trial,
)
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.poses import StaticCalibration
from osl_analysis.walking.unperturbed_gait import UnperturbedGait

Gaits = dict[str, UnperturbedGait]
Onsets = dict[str, float]  # [s], by trial
ADAPTERS: dict[Any, TypeAdapter[Any]] = {
    kind: TypeAdapter(kind) for kind in (StaticCalibration, PlateModel, Gaits, Onsets, Crossing)
}
"""What reads and writes each kind of result: to make one takes as long as to use it."""
NO_GAIT = (
    "no mean unperturbed gait under the same conditions: fewer unperturbed crossings than"
    " fewest_unperturbed are used; record more, or leave the condition empty in the sheet where"
    " unperturbed crossings serve every value"
)


def write_model(model: Any, path: Path) -> None:
    """Write a calibration, the plate's model, or gaits by name as JSON; arrays are lists, NaN is
    null."""
    kind = Gaits if isinstance(model, dict) else type(model)
    write_text(path, ADAPTERS[kind].dump_json(model, indent=1).decode() + "\n")


def read_model(path: Path, kind: Any) -> Any:
    """Read a model, or the onsets [s] of crossings by trial. Raises InputError where the file is
    missing or is of another kind."""
    check_analysed(path)
    try:
        return ADAPTERS[kind].validate_json(path.read_bytes())
    except (OSError, ValueError) as error:
        why = " ".join(str(error).split())
        raise InputError(
            f"{path}: not what a run writes ({why}); delete it and run again"
        ) from error


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
    empty = pl.DataFrame(schema=dict.fromkeys(("time", "phase", "theta", "torque"), pl.Float64))
    reason = json.dumps({"refused": refused.reason, "perturbed": refused.perturbed})
    metadata = {NAME_KEY: refused.name, PROVENANCE_KEY: reason, SCHEMA_KEY: str(SCHEMA)}
    with atomic_path(path) as temporary:
        empty.write_parquet(temporary, metadata=metadata)


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
        raise InputError(f"{path}: a trial without events; name its crossing, which a run writes")
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


def read_unperturbed_gaits(path: Path) -> dict[str, UnperturbedGait]:
    """Read what `average_unperturbed` wrote: gaits with fewer crossings than the least are not
    among them."""
    gaits: Gaits = read_model(path, Gaits)
    for name, gait in gaits.items():
        # without errors the list is empty and has no shape
        errors = gait.plate_errors.reshape(-1, *gait.theta.shape)
        gaits[name] = replace(gait, plate_errors=errors)
    return gaits
