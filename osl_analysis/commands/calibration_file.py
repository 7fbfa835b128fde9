"""Files of the static calibration and of the plate's model: JSON, written whole or not at all."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.plate_inertia import PARAMETERS, PlateInertia, PlateModel

COMPONENTS = ("F_x", "F_y", "F_z", "M_x", "M_y", "M_z")
CLUSTERS = ("foot", "shank", "platform")


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write a JSON file whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_json(path: Path, step: str, *required: str) -> dict[str, Any]:
    """Read a JSON file that `step` wrote.

    Raises
    ------
    InputError
        The file is missing or damaged, or lacks a required field.
    """
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


def write_calibration(calibration: StaticCalibration, trial: str, path: Path) -> None:
    """Write a static calibration [m, laboratory axes of the static trial]."""
    clusters = {
        name: {marker: position.tolist() for marker, position in getattr(calibration, name).items()}
        for name in CLUSTERS
    }
    ankle = {
        "ankle_centre": calibration.ankle_centre.tolist(),
        "ankle_axis": calibration.ankle_axis.tolist(),
    }
    write_json({"trial": trial, **clusters, **ankle}, path)


def read_calibration(path: Path) -> StaticCalibration:
    """Read what `write_calibration` wrote."""
    content = read_json(path, "calibrate", *CLUSTERS, "ankle_centre", "ankle_axis")
    foot, shank, platform = (
        {marker: np.array(position) for marker, position in content[name].items()} for name in CLUSTERS
    )
    return StaticCalibration(foot, shank, platform, np.array(content["ankle_centre"]), np.array(content["ankle_axis"]))


def write_plate(plate: PlateModel, path: Path) -> None:
    """Write the plate's model, and the models without each trial in turn under `left_out`."""
    write_json({**plate_content(plate), "left_out": [plate_content(model) for model in plate.left_out]}, path)


def plate_content(plate: PlateModel) -> dict[str, Any]:
    """The plate's inertial parameters [SI] with standard errors, lag [s], wrench before and after [N, N*m]."""
    inertia = plate.inertia
    table = {
        name: {"value": float(value), "se": float(se)}
        for name, value, se in zip(PARAMETERS, inertia.parameters, inertia.standard_errors, strict=True)
    }
    before, after = (dict(zip(COMPONENTS, v.tolist(), strict=True)) for v in (inertia.rms_before, inertia.rms_after))
    lag = {"lag_s": plate.lag, "lag_se_s": plate.lag_se, "lags_s": plate.lags.tolist()}
    return {"parameters": table, **lag, "rms_before": before, "rms_after": after}


def read_plate(path: Path) -> PlateModel:
    """Read what `write_plate` wrote."""
    fields = ("parameters", "lag_s", "lag_se_s", "lags_s", "rms_before", "rms_after", "left_out")
    content = read_json(path, "identify-plate", *fields)
    return replace(plate_of(content), left_out=tuple(plate_of(model) for model in content["left_out"]))


def plate_of(content: Mapping[str, Any]) -> PlateModel:
    """The model in what `plate_content` made."""
    values, errors = (np.array([content["parameters"][p][field] for p in PARAMETERS]) for field in ("value", "se"))
    before, after = (np.array([content[f][c] for c in COMPONENTS]) for f in ("rms_before", "rms_after"))
    inertia = PlateInertia(values, errors, before, after)
    return PlateModel(inertia, content["lag_s"], content["lag_se_s"], np.array(content["lags_s"], dtype=float))
