"""The simulated Vicon recording: markers with noise and gaps, force plate, sync and trigger, as a C3D file of Nexus.

The plate's axes are those of C3D force plates: x along laboratory +y, y along +x, z down, turning with the platform."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.errors import optional_module
from osl_analysis.files import atomic_path
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.settings import FOOT, PLATE_CHANNELS, PLATFORM, SHANK
from osl_analysis.trial import Array

MM = 1e3
PLATE_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def write_c3d(path: Path, points: Array, analogs: Array, groups: Mapping[str, Mapping[str, Any]]) -> None:
    """Write markers [m], (frames, labels, 3), NaN where hidden, and analogs, (samples, channels), with groups of
    parameters; the file appears whole or not at all. A hidden marker is stored as Nexus does it: coordinates 0 and
    residual -1. That of a seen one is 0, because readers disagree about the byte of a positive residual."""
    file: Any = optional_module("ezc3d", "the simulator of walking").c3d()
    seen = np.isfinite(points).all(axis=2).T
    homogeneous = np.ones((4, *seen.shape))
    homogeneous[:3] = np.where(seen, points.transpose(2, 1, 0) * MM, 0.0)
    masks = np.zeros((7, *seen.shape), dtype=bool)
    file["data"]["points"], file["data"]["analogs"] = homogeneous, analogs.T[None]
    file["data"]["meta_points"] = {"residuals": np.where(seen, 0.0, -1.0)[None], "camera_masks": masks}
    parameters = file["parameters"]
    for group, values in groups.items():
        if values:
            parameters.create_group_if_needed(group)
        for name, value in values.items():
            # C3D's types are bytes per element, -1 for characters. ezc3d's own `add_parameter` makes floats of whole
            # numbers, which other readers refuse in CHANNEL and TYPE
            kind = -1 if isinstance(value, list) else 2 if value.dtype.kind == "i" else 4
            known = parameters[group].get(name, {"description": "", "is_locked": False})
            parameters[group][name] = {**known, "type": kind, "value": value}
    with atomic_path(path) as temporary:
        file.write(str(temporary))


def sync_level(trial: gait.GaitTrial, time: Array) -> Array:
    """Level, 0 or 1, of the synchronisation line at times [s]: an irregular pulse train over the duration of a
    recording, whose pattern does not repeat. It is low before the first pulse."""
    shortest, longest, duration = 0.06, 0.25, trial.walking.gait.recording_s  # intervals [s] between two changes
    edges = np.cumsum(trial.random("sync").uniform(shortest, longest, int(duration / shortest) + 1))
    return np.asarray(np.searchsorted(edges[edges < duration], time, side="right") % 2, dtype=float)


def leg_markers(foot: gait.Pose, shank: gait.Pose) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers that foot and shank always carry."""
    return on_body(foot, FOOT) | on_body(shank, SHANK)


def on_body(body: gait.Pose, places: Mapping[str, gait.Point]) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of points given by their places [m] on a body."""
    return {label: body.point(place) for label, place in places.items()}


def write_capture(
    folder: Path, trial: gait.GaitTrial, leg: Mapping[str, Array], platform: gait.PlatformMotion, load: gait.TrueWrench
) -> None:
    """Write the capture `vicon/<trial>.c3d`: the exact paths of the leg's markers [m] and those of the platform, with
    noise and gaps; the plate under its load, synchronisation, and the trigger, high for 20 ms. Without markers on
    a leg there is no person.

    The plate's signs are as Vicon Nexus stores them: a standing person reads Fz < 0 along z down. Its sensors carry the
    foot and the plate's own mass above them: force F + m (a - g), moment M + dH/dt + r x m (a - g). Zeroed at rest."""
    plate, rates, effects = trial.walking.plate, trial.walking.rates, trial.walking.effects
    on_platform = {label: np.add(plate.centre_m, place) for label, place in PLATFORM.items()}
    markers = {**leg, **on_body(platform.pose, on_platform)}
    exact = np.stack(list(markers.values()), axis=1)[:: rates.motion_hz // rates.points_hz]
    time = np.arange(len(exact) * (rates.analogs_hz // rates.points_hz)) / rates.analogs_hz
    turned, rate = platform.pose.rotation @ PLATE_AXES, rates.motion_hz
    sensor = np.array(plate.centre_m) + np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])
    mass, centre = effects.plate_inertia.value, np.add(plate.centre_m, plate.centre_of_mass_m)
    own, about = gait.support(platform.pose, rate, mass, centre, plate.gyration_m), platform.pose.point(sensor)
    force, resting = np.einsum("nji,nj->ni", turned, load.force + own.force), -mass * gait.GRAVITY
    moment = np.einsum("nji,nj->ni", turned, load.moment_about(about) + own.moment_about(about))
    zeroed = force - resting @ PLATE_AXES, moment - np.cross(centre - sensor, resting) @ PLATE_AXES
    channels = []  # force [N], and moment [N*mm] about the sensor's origin, with lag, offset and noise
    for quantity, unit, values in zip(("force", "moment"), (1.0, MM), zeroed, strict=True):
        noise = trial.random(f"{quantity}_noise").standard_normal((len(time), 3))
        offset = trial.random(f"{quantity}_offset").standard_normal(3)
        late = gait.interpolated_at(values, rate, time - 1e-3 * effects.plate_lag.value)
        late = late + getattr(effects, f"{quantity}_noise").value * noise
        channels.append(unit * (late + getattr(effects, f"{quantity}_offset").value * offset))
    command = np.inf if platform.command is None else platform.command
    trigger = np.asarray((time >= command) & (time < command + 0.02), dtype=float)
    analogs = np.column_stack([*channels, 5.0 * sync_level(trial, time), 5.0 * trigger])
    labels, names = list(markers), [*PLATE_CHANNELS, "Sync", "Trigger"]
    quadrants = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=float) @ PLATE_AXES.T
    corners = np.array(plate.centre_m) + quadrants * (0.5 * np.array([*plate.size_m, 0.0]))  # in C3D's order
    # of the sensor below the surface, z > 0: the sign of Vicon Nexus; that of the C3D manual is the opposite
    origin = np.asarray(PLATE_AXES.T @ np.array([*plate.sensor_offset_m, -plate.sensor_depth_m]))
    person = trial.condition.person if leg else None
    groups: dict[str, dict[str, Any]] = {
        "POINT": {
            "LABELS": labels,
            "DESCRIPTIONS": [""] * len(labels),
            "UNITS": ["mm"],
            "RATE": np.array([float(rates.points_hz)]),
            "X_SCREEN": ["+X"],
            "Y_SCREEN": ["+Z"],
            "FORCE_UNITS": ["N"],
            "MOMENT_UNITS": ["Nmm"],
        },
        "ANALOG": {
            "LABELS": names,
            "DESCRIPTIONS": [""] * len(names),
            "UNITS": [*PLATE_CHANNELS.values(), "V", "V"],
            "RATE": np.array([float(rates.analogs_hz)]),
            "FORMAT": ["SIGNED"],
        },
        "FORCE_PLATFORM": {
            "USED": np.array([1]),
            "TYPE": np.array([2]),
            "ZERO": np.array([1, 0]),
            "CORNERS": corners.T[:, :, None] * MM,
            "ORIGIN": origin[:, None] * MM,
            "CHANNEL": np.arange(1, len(PLATE_CHANNELS) + 1)[:, None],
            "CAL_MATRIX": np.zeros(0),
        },
        "TRIAL": {"CAMERA_RATE": np.array([float(rates.points_hz)])},
        "SUBJECTS": {} if person is None else {"NAMES": [person]},
        "MANUFACTURER": {"COMPANY": ["osl-analysis"], "SOFTWARE": ["simulator"]},
    }
    write_c3d(folder / "vicon" / f"{trial.name}.c3d", seen_markers(trial, exact), analogs, groups)


def seen_markers(trial: gait.GaitTrial, exact: Array) -> Array:
    """Marker positions [m] with noise, shape (frames, labels, 3), NaN where hidden."""
    effects = trial.walking.effects
    noise = trial.random("marker_noise").standard_normal(exact.shape)
    seen, random = exact + 1e-3 * effects.marker_noise.value * noise, trial.random("marker_gaps")
    for _ in range(random.poisson(effects.marker_gaps.value)):
        shortest, longest = (0.05, 0.2) if random.random() < 0.25 else (0.007, 0.04)  # a quarter of them are long
        length = int(np.ceil(random.uniform(shortest, longest) * trial.walking.rates.points_hz))
        first, label = random.integers(len(exact)), random.integers(exact.shape[1])
        seen[first : first + length, label] = np.nan
    return seen
