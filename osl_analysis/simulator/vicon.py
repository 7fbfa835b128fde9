"""The simulated Vicon recording: markers with noise and gaps, force plate, sync and trigger, as a C3D file of Nexus."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from osl_analysis.files import atomic_path
from osl_analysis.simulator.plate import SensorReading, plate_channels, plate_corners, sensor_reading
from osl_analysis.simulator.rigid_body import Pose, TrueWrench, interpolated_at
from osl_analysis.simulator.settings import stream
from osl_analysis.simulator.walking_settings import CaptureSettings, WalkingSettings
from osl_analysis.trial import Array

MM = 1e3
RESIDUAL_SEEN, RESIDUAL_HIDDEN = 0.0, -1.0
"""Residuals of seen and hidden markers. 0, because readers disagree about the byte that holds a positive residual."""
TEXT, WHOLE_NUMBER, FLOAT = -1, 2, 4
"""C3D's parameter types: bytes per element, -1 for characters."""
CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}  # Channels of a force plate, by its type


@dataclass(frozen=True)
class RecordedPlate:
    """Corners [m], shape (4, 3), in laboratory axes and C3D's order, and ORIGIN [m] in the plate's axes, shape (3,).
    Its channels are the recording's first ones: six, or eight of type 3. Type 4 has a calibration matrix, (6, 6)."""

    corners: Array
    origin: Array
    type: int = 2
    calibration: Array | None = None


@dataclass(frozen=True)
class C3dRecording:
    """Markers [m], shape (frames, labels, 3), NaN where hidden, and analogs, shape (samples, channels). Analogs are in
    `units` already; their rate [Hz] is a whole multiple of the markers'."""

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
    body_mass_kg: float | None = None  # Body mass [kg] that the file states. None: it states none
    subject: str | None = None  # Name of the person that the file states. None: it states none


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
    """Set parameters of one group, typed by their values: strings, whole numbers or floats. ezc3d's own `add_parameter`
    makes floats of whole numbers, which other readers refuse in CHANNEL and TYPE."""
    parameters = file["parameters"]
    parameters.create_group_if_needed(group)
    for name, value in values.items():
        kind = TEXT if isinstance(value, list) else WHOLE_NUMBER if value.dtype.kind == "i" else FLOAT
        known = parameters[group].get(name, {"description": "", "is_locked": False})
        parameters[group][name] = {**known, "type": kind, "value": value}


Place = tuple[float, float, float]
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
SYNC_INTERVAL_S = (0.06, 0.25)
LONG_GAP_SHARE = 0.25
SHORT_GAP_S, LONG_GAP_S = (0.007, 0.04), (0.05, 0.2)


@dataclass(frozen=True)
class Session:
    """Where the markers of the leg are in one session of one person, from where they are in the first one."""

    scatter: float = 0.0  # Standard deviation [m] of each marker's place, each axis
    seed: int = 0
    name: str = ""  # Name of person and session; empty: the first session of the first person

    def places(self, nominal: Mapping[str, Place]) -> dict[str, Place]:
        """The places [m] of markers on their body."""
        if not (self.name and self.scatter):
            return dict(nominal)
        found = {}
        for label, place in nominal.items():
            moved = stream(self.seed, self.name, f"marker_placement_{label}").standard_normal(3)
            x, y, z = np.add(place, self.scatter * moved)
            found[label] = (float(x), float(y), float(z))
        return found


@dataclass(frozen=True)
class SyncLine:
    """Times [s] at which the synchronisation line changes its level. The line is low before the first."""

    edges: Array

    def level(self, time: Array) -> Array:
        """0 or 1 at times [s]."""
        return np.asarray(np.searchsorted(self.edges, time, side="right") % 2, dtype=float)


def draw_sync(trial: str, seed: int, duration: float) -> SyncLine:
    """An irregular pulse train over the duration [s] of a recording. Its pattern does not repeat."""
    intervals = stream(seed, trial, "sync").uniform(*SYNC_INTERVAL_S, int(duration / SYNC_INTERVAL_S[0]) + 1)
    edges = np.cumsum(intervals)
    return SyncLine(edges[edges < duration])


@dataclass(frozen=True)
class Scene:
    """The exact quantities that Vicon records, at the motion's rate."""

    markers: dict[str, Array]  # Path [m] of each marker, shape (n, 3)
    platform: Pose  # Pose of the platform
    reaction: TrueWrench  # Ground reaction on the plate
    command: float | None  # Time [s] at which the trigger fires. None if it does not
    body_mass: float | None = None  # Body mass [kg] of the person. None if nobody is there
    subject: str | None = None  # Name of the person. None if it has none


def platform_markers(platform: Pose, walking: WalkingSettings) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers on the platform."""
    centre = np.array(walking.plate.centre_m)
    return {label: platform.point(centre + np.array(place)) for label, place in PLATFORM.items()}


def leg_markers(foot: Pose, shank: Pose, session: Session | None = None) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers that foot and shank always carry."""
    places = (session or Session()).places
    return on_body(foot, places(FOOT)) | on_body(shank, places(SHANK))


def on_body(body: Pose, places: Mapping[str, Place]) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of points given by their places [m] on a body."""
    return {label: body.point(np.array(place)) for label, place in places.items()}


def vicon_recording(trial: str, seed: int, scene: Scene, walking: WalkingSettings) -> C3dRecording:
    """The Vicon recording of a scene, with the sync line of the trial (`draw_sync`)."""
    rates, effects, capture = walking.rates, walking.effects, walking.capture
    exact = np.stack(list(scene.markers.values()), axis=1)[:: rates.motion_hz // rates.points_hz]
    time = np.arange(len(exact) * (rates.analogs_hz // rates.points_hz)) / rates.analogs_hz
    reading = sensor_reading(
        scene.reaction, scene.platform, walking.plate, effects.plate_inertia.value, rates.motion_hz
    )
    sync = draw_sync(trial, seed, walking.gait.recording_s)
    plate = plate_channels(disturbed_reading(trial, seed, reading, time, walking), walking)
    channels = [plate.values, HIGH_V * sync.level(time)[:, None], HIGH_V * trigger(time, scene.command)[:, None]]
    corners = in_file_axes(plate_corners(walking.plate), capture)
    screen = ("+X", f"+{capture.up_axis.upper()}")
    return C3dRecording(
        labels=labels_in(trial, tuple(scene.markers), capture),
        points=in_file_axes(seen_markers(trial, seed, exact, walking), capture),
        point_rate_hz=rates.points_hz,
        channels=(*plate.labels, "Sync", "Trigger"),
        units=(*plate.units, "V", "V"),
        analogs=np.hstack(channels),
        analog_rate_hz=rates.analogs_hz,
        plate=RecordedPlate(corners, plate.origin, capture.plate_type, plate.calibration),
        screen=screen if capture.states_axes else None,
        body_mass_kg=scene.body_mass if capture.states_body_mass else None,
        subject=scene.subject,
    )


def in_file_axes(places: Array, capture: CaptureSettings) -> Array:
    """Laboratory coordinates, shape (..., 3), in the axes of the file. With y up, z points to the right."""
    x, y, z = np.moveaxis(places, -1, 0)
    return places if capture.up_axis == "z" else np.stack([x, z, -y], axis=-1)


def labels_in(trial: str, labels: tuple[str, ...], capture: CaptureSettings) -> tuple[str, ...]:
    """The labels that a trial's markers have in the file."""
    if capture.swapped_in is not None and trial not in capture.swapped_in:
        return labels
    other = {a: b for pair in capture.swapped_labels for a, b in (pair, pair[::-1])}
    return tuple(other.get(label, label) for label in labels)


def trigger(time: Array, command: float | None) -> Array:
    """1 while the trigger is high, else 0. Without a command the trigger stays 0."""
    if command is None:
        return np.zeros_like(time)
    return np.asarray((time >= command) & (time < command + TRIGGER_S), dtype=float)


def disturbed_reading(
    trial: str, seed: int, reading: SensorReading, time: Array, walking: WalkingSettings
) -> SensorReading:
    """The plate's reading at times [s], with its lag, offset and noise."""
    effects, rate = walking.effects, walking.rates.motion_hz
    late = time - 1e-3 * effects.plate_lag.value
    columns = []
    for quantity, values in (("force", reading.force), ("moment", reading.moment)):
        noise = stream(seed, trial, f"{quantity}_noise").standard_normal((len(time), 3))
        offset = stream(seed, trial, f"{quantity}_offset").standard_normal(3)
        disturbed = interpolated_at(values, rate, late) + getattr(effects, f"{quantity}_noise").value * noise
        columns.append(disturbed + getattr(effects, f"{quantity}_offset").value * offset)
    return SensorReading(*columns)


def seen_markers(trial: str, seed: int, exact: Array, walking: WalkingSettings) -> Array:
    """Marker positions [m] with noise, shape (frames, labels, 3), NaN where hidden."""
    effects = walking.effects
    noise = stream(seed, trial, "marker_noise").standard_normal(exact.shape)
    seen = exact + 1e-3 * effects.marker_noise.value * noise
    random = stream(seed, trial, "marker_gaps")
    for _ in range(random.poisson(effects.marker_gaps.value)):
        shortest, longest = LONG_GAP_S if random.random() < LONG_GAP_SHARE else SHORT_GAP_S
        length = int(np.ceil(random.uniform(shortest, longest) * walking.rates.points_hz))
        first, label = random.integers(len(exact)), random.integers(exact.shape[1])
        seen[first : first + length, label] = np.nan
    return seen
