"""The simulated Vicon recording: markers with noise and gaps, force plate, sync and trigger, as a C3D file of Nexus.

The plate's axes are those of C3D force plates: x along laboratory +y, y along laboratory +x, z down, all turning with
the platform. Corners 1-4 lie in the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y) of these axes. The plate is of
type 2, whose channels are force and moment about the sensor origin.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from osl_analysis.files import atomic_path
from osl_analysis.simulator.rigid_body import FREE_FALL, Pose, RigidBody, TrueWrench, interpolated_at
from osl_analysis.simulator.settings import stream
from osl_analysis.simulator.walking_settings import MovingPlate, WalkingSettings
from osl_analysis.trial import Array

MM = 1e3
RESIDUAL_SEEN, RESIDUAL_HIDDEN = 0.0, -1.0
"""Residuals of seen and hidden markers. 0, because readers disagree about the byte that holds a positive residual."""


@dataclass(frozen=True)
class C3dRecording:
    """Markers [m], shape (frames, labels, 3), NaN where hidden, and analogs, shape (samples, channels), in `units`. The
    rate of the analogs [Hz] is a whole multiple of the markers'. The first six channels are the force plate's."""

    labels: tuple[str, ...]
    points: Array
    point_rate_hz: int
    channels: tuple[str, ...]
    units: tuple[str, ...]
    analogs: Array
    analog_rate_hz: int
    corners: Array  # of the plate [m], shape (4, 3), in laboratory axes and C3D's order
    origin: Array  # FORCE_PLATFORM:ORIGIN [m] in the plate's axes, shape (3,)


def write_c3d(path: Path, recording: C3dRecording) -> None:
    """Write a recording; the file, whose name must end in .c3d, appears whole or not at all. A hidden marker is stored
    as Nexus does it: coordinates 0 and residual -1."""
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
        X_SCREEN=["+X"],
        Y_SCREEN=["+Z"],
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
        TYPE=np.array([2]),
        ZERO=np.array([1, 0]),
        CORNERS=recording.corners.T[:, :, None] * MM,
        ORIGIN=recording.origin[:, None] * MM,
        CHANNEL=np.arange(1, 7)[:, None],
        CAL_MATRIX=np.zeros(0),
    )
    set_parameters(file, "TRIAL", CAMERA_RATE=np.array([float(recording.point_rate_hz)]))
    set_parameters(file, "MANUFACTURER", COMPANY=["osl-analysis"], SOFTWARE=["simulator"])


def set_parameters(file: Any, group: str, **values: list[str] | np.ndarray[Any, Any]) -> None:
    """Set parameters of one group, typed by their values: strings, whole numbers or floats. ezc3d's own `add_parameter`
    makes floats of whole numbers, which other readers refuse in CHANNEL and TYPE."""
    parameters = file["parameters"]
    parameters.create_group_if_needed(group)
    for name, value in values.items():
        # C3D's types are bytes per element, -1 for characters
        kind = -1 if isinstance(value, list) else 2 if value.dtype.kind == "i" else 4
        known = parameters[group].get(name, {"description": "", "is_locked": False})
        parameters[group][name] = {**known, "type": kind, "value": value}


MarkerPlace = tuple[float, float, float]
# from the ankle's centre, in the axes of foot and shank when standing [m]; the right leg's outer side is -y
FOOT = {
    "FOOT1": (-0.075, 0.012, -0.030),
    "FOOT2": (0.160, 0.020, -0.050),
    "FOOT3": (0.105, -0.050, -0.045),
    "FOOT4": (0.060, 0.008, 0.035),
}
SHANK = {
    "SHANK1": (0.055, -0.020, 0.100),
    "SHANK2": (0.010, -0.065, 0.190),
    "SHANK3": (-0.035, 0.050, 0.255),
    "SHANK4": (0.060, 0.025, 0.330),
}
# from the centre of the plate's surface [m]; one is on a post, so that the four do not lie in a plane
PLATFORM = {
    "PLAT1": (0.285, 0.235, 0.004),
    "PLAT2": (-0.285, 0.230, 0.004),
    "PLAT3": (-0.280, -0.235, 0.060),
    "PLAT4": (0.285, -0.230, 0.004),
}
ANKLE_AXIS = {"ANKLE_MED": (0.0, 0.042, 0.0), "ANKLE_LAT": (0.0, -0.042, 0.0)}
HIGH_V = 5.0
TRIGGER_S = 0.02


def sync_level(trial: str, seed: int, duration: float, time: Array) -> Array:
    """Level, 0 or 1, of the synchronisation line at times [s]: an irregular pulse train over the duration [s] of a
    recording, whose pattern does not repeat. It is low before the first pulse."""
    shortest, longest = 0.06, 0.25  # intervals [s] between two changes
    edges = np.cumsum(stream(seed, trial, "sync").uniform(shortest, longest, int(duration / shortest) + 1))
    return np.asarray(np.searchsorted(edges[edges < duration], time, side="right") % 2, dtype=float)


@dataclass(frozen=True)
class Scene:
    """The exact quantities that Vicon records, at the motion's rate."""

    markers: dict[str, Array]  # Path [m] of each marker, shape (n, 3)
    platform: Pose  # Pose of the platform
    reaction: TrueWrench  # Ground reaction on the plate
    command: float | None  # Time [s] at which the trigger fires. None if it does not


def platform_markers(platform: Pose, walking: WalkingSettings) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers on the platform."""
    centre = np.array(walking.plate.centre_m)
    return {label: platform.point(centre + np.array(place)) for label, place in PLATFORM.items()}


def leg_markers(foot: Pose, shank: Pose) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers that foot and shank always carry."""
    return on_body(foot, FOOT) | on_body(shank, SHANK)


def on_body(body: Pose, places: Mapping[str, MarkerPlace]) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of points given by their places [m] on a body."""
    return {label: body.point(np.array(place)) for label, place in places.items()}


PLATE_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def plate_corners(plate: MovingPlate) -> Array:
    """The four corners [m] of the resting plate in laboratory axes, shape (4, 3), in C3D's order."""
    quadrants = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=float) @ PLATE_AXES.T
    half = 0.5 * np.array([*plate.size_m, 0.0])
    return np.asarray(np.array(plate.centre_m) + quadrants * half)


def sensor_from_centre(plate: MovingPlate) -> Array:
    """The sensor origin [m] from the surface's centre, laboratory axes of the resting plate, shape (3,)."""
    return np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])


def sensor_reading(
    reaction: TrueWrench, platform: Pose, plate: MovingPlate, mass: float, rate_hz: float
) -> tuple[Array, Array]:
    """Force [N] and moment about the sensor origin [N*m] that the plate reads, shape (n, 3) each, in its moving axes.

    Signs are as Vicon Nexus stores them: the reaction on the foot, so that a standing person reads Fz < 0 along z down.
    The sensors carry the foot and the plate's own `mass` [kg] above them: force F + m (a - g), moment
    M + dH/dt + r x m (a - g). The zero was set on the unloaded plate at rest, in the sensors' axes. The plate's weight
    therefore appears only when it tilts.
    """
    sensor = np.array(plate.centre_m) + sensor_from_centre(plate)
    turned = platform.rotation @ PLATE_AXES
    body = RigidBody(mass, np.add(plate.centre_m, plate.centre_of_mass_m), np.array(plate.gyration_m))
    own = body.support(platform, rate_hz)
    origin = platform.point(sensor)
    resting = -mass * FREE_FALL
    zero_moment = np.cross(body.centre_of_mass - sensor, resting)
    return (
        in_axes(turned, reaction.force + own.force) - resting @ PLATE_AXES,
        in_axes(turned, reaction.moment_about(origin) + own.moment_about(origin)) - zero_moment @ PLATE_AXES,
    )


def in_axes(rotation: Array, vectors: Array) -> Array:
    """Laboratory vectors, shape (n, 3), in the axes that are the columns of rotation (n, 3, 3)."""
    return np.asarray(np.einsum("nji,nj->ni", rotation, vectors))


def vicon_recording(trial: str, seed: int, scene: Scene, walking: WalkingSettings) -> C3dRecording:
    """The Vicon recording of a scene. ORIGIN of the plate has the sign of Vicon Nexus: z > 0 for a sensor below the
    surface. The C3D manual defines the opposite vector, and readers reverse it by the sign of z."""
    rates, plate = walking.rates, walking.plate
    exact = np.stack(list(scene.markers.values()), axis=1)[:: rates.motion_hz // rates.points_hz]
    time = np.arange(len(exact) * (rates.analogs_hz // rates.points_hz)) / rates.analogs_hz
    true = sensor_reading(scene.reaction, scene.platform, plate, walking.effects.plate_inertia.value, rates.motion_hz)
    channels = disturbed_reading(trial, seed, true, time, walking)
    levels = [sync_level(trial, seed, walking.gait.recording_s, time), trigger(time, scene.command)]
    return C3dRecording(
        labels=tuple(scene.markers),
        points=seen_markers(trial, seed, exact, walking),
        point_rate_hz=rates.points_hz,
        channels=("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1", "Sync", "Trigger"),
        units=("N", "N", "N", "Nmm", "Nmm", "Nmm", "V", "V"),
        analogs=np.column_stack([channels, *(HIGH_V * level for level in levels)]),
        analog_rate_hz=rates.analogs_hz,
        corners=plate_corners(plate),
        origin=np.asarray(PLATE_AXES.T @ sensor_from_centre(plate)),
    )


def trigger(time: Array, command: float | None) -> Array:
    """1 while the trigger is high, else 0. Without a command the trigger stays 0."""
    if command is None:
        return np.zeros_like(time)
    return np.asarray((time >= command) & (time < command + TRIGGER_S), dtype=float)


def disturbed_reading(
    trial: str, seed: int, reading: tuple[Array, Array], time: Array, walking: WalkingSettings
) -> Array:
    """The plate's channels [N, N*mm], shape (n, 6), at times [s], with its lag, offset and noise."""
    effects, rate = walking.effects, walking.rates.motion_hz
    late = time - 1e-3 * effects.plate_lag.value
    channels = []
    for (quantity, unit), values in zip({"force": 1.0, "moment": 1e3}.items(), reading, strict=True):
        noise = stream(seed, trial, f"{quantity}_noise").standard_normal((len(time), 3))
        offset = stream(seed, trial, f"{quantity}_offset").standard_normal(3)
        disturbed = interpolated_at(values, rate, late) + getattr(effects, f"{quantity}_noise").value * noise
        channels.append(unit * (disturbed + getattr(effects, f"{quantity}_offset").value * offset))
    return np.hstack(channels)


def seen_markers(trial: str, seed: int, exact: Array, walking: WalkingSettings) -> Array:
    """Marker positions [m] with noise, shape (frames, labels, 3), NaN where hidden."""
    effects = walking.effects
    noise = stream(seed, trial, "marker_noise").standard_normal(exact.shape)
    seen = exact + 1e-3 * effects.marker_noise.value * noise
    random = stream(seed, trial, "marker_gaps")
    for _ in range(random.poisson(effects.marker_gaps.value)):
        shortest, longest = (0.05, 0.2) if random.random() < 0.25 else (0.007, 0.04)  # a quarter of them are long
        length = int(np.ceil(random.uniform(shortest, longest) * walking.rates.points_hz))
        first, label = random.integers(len(exact)), random.integers(exact.shape[1])
        seen[first : first + length, label] = np.nan
    return seen
