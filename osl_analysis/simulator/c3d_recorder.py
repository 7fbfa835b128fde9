"""A C3D recorder that stores data as Vicon Nexus does: floats, millimetres, one force plate."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from osl_analysis.files import atomic_path
from osl_analysis.trial import Array

MM = 1e3
RESIDUAL_SEEN, RESIDUAL_HIDDEN = 0.0, -1.0
"""Residuals of seen and hidden markers. 0, because readers disagree about the byte that holds a positive residual."""
TEXT, WHOLE_NUMBER, FLOAT = -1, 2, 4
"""C3D's parameter types: bytes per element, -1 for characters."""
CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
"""Channels of a force plate, by its type."""


@dataclass(frozen=True)
class RecordedPlate:
    """Corners [m], shape (4, 3), in laboratory axes and C3D's order, and ORIGIN [m] in the plate's axes, shape (3,).

    Its channels are the recording's first ones: six, or eight of type 3. Type 4 has a calibration matrix, (6, 6).
    """

    corners: Array
    origin: Array
    type: int = 2
    calibration: Array | None = None


@dataclass(frozen=True)
class C3dRecording:
    """Markers [m], shape (frames, labels, 3), NaN where hidden, and analogs, shape (samples, channels).

    Analogs are in `units` already; their rate [Hz] is a whole multiple of the markers'.
    """

    labels: tuple[str, ...]
    points: Array
    point_rate_hz: int
    channels: tuple[str, ...]
    units: tuple[str, ...]
    analogs: Array
    analog_rate_hz: int
    plate: RecordedPlate
    screen: tuple[str, str] | None = ("+X", "+Z")
    """Axes of the file to the right and upward on a screen (POINT:X_SCREEN, Y_SCREEN). None: they are not stated."""
    body_mass_kg: float | None = None
    """Body mass [kg] that the file states. None: it states none."""
    subject: str | None = None
    """Name of the person that the file states. None: it states none."""


def write_c3d(path: Path, recording: C3dRecording) -> None:
    """Write a recording; the file, whose name must end in .c3d, appears whole or not at all.

    A hidden marker is stored as Nexus does it: coordinates 0 and residual -1.
    """
    file = ezc3d.c3d()
    seen = np.isfinite(recording.points).all(axis=2).T
    points = np.ones((4, *seen.shape))
    points[:3] = np.where(seen, recording.points.transpose(2, 1, 0) * MM, 0.0)
    file["data"]["points"] = points
    file["data"]["meta_points"] = {
        "residuals": np.where(seen, RESIDUAL_SEEN, RESIDUAL_HIDDEN)[None],
        "camera_masks": np.zeros((7, *seen.shape), dtype=bool),
    }
    file["data"]["analogs"] = recording.analogs.T[None]
    describe(file, recording)
    with atomic_path(path) as temporary:
        file.write(str(temporary))


def describe(file: Any, recording: C3dRecording) -> None:
    """Fill the parameter groups of an open file."""
    set_parameters(
        file,
        "POINT",
        LABELS=list(recording.labels),
        DESCRIPTIONS=[""] * len(recording.labels),
        UNITS=["mm"],
        RATE=np.array([float(recording.point_rate_hz)]),
        **({"X_SCREEN": [recording.screen[0]], "Y_SCREEN": [recording.screen[1]]} if recording.screen else {}),
        FORCE_UNITS=["N"],
        MOMENT_UNITS=["Nmm"],
    )
    set_parameters(
        file,
        "ANALOG",
        LABELS=list(recording.channels),
        DESCRIPTIONS=[""] * len(recording.channels),
        UNITS=list(recording.units),
        RATE=np.array([float(recording.analog_rate_hz)]),
        FORMAT=["SIGNED"],
    )
    set_parameters(
        file,
        "FORCE_PLATFORM",
        USED=np.array([1]),
        TYPE=np.array([recording.plate.type]),
        ZERO=np.array([1, 0]),
        CORNERS=recording.plate.corners.T[:, :, None] * MM,
        ORIGIN=recording.plate.origin[:, None] * MM,
        CHANNEL=np.arange(1, CHANNELS[recording.plate.type] + 1)[:, None],
        CAL_MATRIX=np.zeros(0) if recording.plate.calibration is None else recording.plate.calibration[:, :, None],
    )
    set_parameters(file, "TRIAL", CAMERA_RATE=np.array([float(recording.point_rate_hz)]))
    if recording.body_mass_kg is not None:
        set_parameters(file, "PROCESSING", BODYMASS=np.array([recording.body_mass_kg]))
    if recording.subject is not None:
        set_parameters(file, "SUBJECTS", NAMES=[recording.subject])
    set_parameters(file, "MANUFACTURER", COMPANY=["osl-analysis"], SOFTWARE=["simulator"])


def set_parameters(file: Any, group: str, **values: list[str] | np.ndarray[Any, Any]) -> None:
    """Set parameters of one group, typed by their values: strings, whole numbers or floats.

    ezc3d's own `add_parameter` makes floats of whole numbers, which other readers refuse in CHANNEL and TYPE.
    """
    parameters = file["parameters"]
    parameters.create_group_if_needed(group)
    for name, value in values.items():
        kind = TEXT if isinstance(value, list) else WHOLE_NUMBER if value.dtype.kind == "i" else FLOAT
        known = parameters[group].get(name, {"description": "", "is_locked": False})
        parameters[group][name] = {**known, "type": kind, "value": value}
