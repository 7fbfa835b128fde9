"""The simulated Vicon recording: markers with noise and gaps, force plate, sync and trigger channels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.simulator.c3d_recorder import C3dRecording, RecordedPlate
from osl_analysis.simulator.capture_settings import CaptureSettings
from osl_analysis.simulator.force_platform import SensorReading, plate_corners, sensor_reading
from osl_analysis.simulator.plate_channels import plate_channels
from osl_analysis.simulator.rigid_body import Pose, TrueWrench, interpolated_at
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

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

    scatter: float = 0.0
    """Standard deviation [m] of each marker's place, each axis."""
    seed: int = 0
    name: str = ""
    """Name of person and session; empty: the first session of the first person."""

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

    markers: dict[str, Array]
    """Path [m] of each marker, shape (n, 3)."""
    platform: Pose
    """Pose of the platform."""
    reaction: TrueWrench
    """Ground reaction on the plate."""
    command: float | None
    """Time [s] at which the trigger fires. None if it does not."""
    body_mass: float | None = None
    """Body mass [kg] of the person. None if nobody is there."""
    subject: str | None = None
    """Name of the person. None if it has none."""


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
