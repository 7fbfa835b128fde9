"""The simulated Vicon recording: markers with noise and gaps, force plate, sync and trigger, as a C3D file of Nexus.

The plate's axes are those of C3D force plates: x along laboratory +y, y along laboratory +x, z down, all turning with
the platform. Channels of types 1 to 4 are as the C3D manual has them, with Kistler's formulas solved.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from osl_analysis.files import atomic_path
from osl_analysis.simulator.plan import Condition
from osl_analysis.simulator.rigid_body import GRAVITY, Pose, RigidBody, TrueWrench, interpolated_at
from osl_analysis.simulator.settings import stream
from osl_analysis.simulator.walking_settings import CaptureSettings, MovingPlate, WalkingSettings
from osl_analysis.trial import Array

MM = 1e3


@dataclass(frozen=True)
class C3dRecording:
    """Markers [m], shape (frames, labels, 3), NaN where hidden, and analogs, shape (samples, channels), in `units`. The
    rate of the analogs [Hz] is a whole multiple of the markers'. The first six channels, or eight of type 3, are the
    force plate's."""

    labels: tuple[str, ...]
    points: Array
    point_rate_hz: int
    channels: tuple[str, ...]
    units: tuple[str, ...]
    analogs: Array
    analog_rate_hz: int
    corners: Array  # of the plate [m], shape (4, 3), in laboratory axes and C3D's order
    origin: Array  # FORCE_PLATFORM:ORIGIN [m] in the plate's axes, shape (3,)
    plate_type: int = 2
    calibration: Array | None = None  # (6, 6) of type 4, which turns its channels into [N] and [N*mm]
    screen: tuple[str, str] | None = ("+X", "+Z")
    """Axes of the file to the right and upward on a screen (POINT:X_SCREEN, Y_SCREEN). None: they are not stated."""
    body_mass_kg: float | None = None  # Body mass [kg] that the file states. None: it states none
    subject: str | None = None  # Name of the person that the file states. None: it states none


def write_c3d(path: Path, recording: C3dRecording) -> None:
    """Write a recording; the file, whose name must end in .c3d, appears whole or not at all. A hidden marker is stored
    as Nexus does it: coordinates 0 and residual -1. That of a seen one is 0, because readers disagree about the byte
    that holds a positive residual."""
    file: Any = ezc3d.c3d()
    seen = np.isfinite(recording.points).all(axis=2).T
    points = np.ones((4, *seen.shape))
    points[:3] = np.where(seen, recording.points.transpose(2, 1, 0) * MM, 0.0)
    file["data"]["points"] = points
    file["data"]["meta_points"] = {
        "residuals": np.where(seen, 0.0, -1.0)[None],
        "camera_masks": np.zeros((7, *seen.shape), dtype=bool),
    }
    file["data"]["analogs"] = recording.analogs.T[None]
    rate, screen, calibration = np.array([float(recording.point_rate_hz)]), recording.screen, recording.calibration
    groups: dict[str, dict[str, Any]] = {
        "POINT": {
            "LABELS": list(recording.labels),
            "DESCRIPTIONS": [""] * len(recording.labels),
            "UNITS": ["mm"],
            "RATE": rate,
            **({"X_SCREEN": [screen[0]], "Y_SCREEN": [screen[1]]} if screen else {}),
            "FORCE_UNITS": ["N"],
            "MOMENT_UNITS": ["Nmm"],
        },
        "ANALOG": {
            "LABELS": list(recording.channels),
            "DESCRIPTIONS": [""] * len(recording.channels),
            "UNITS": list(recording.units),
            "RATE": np.array([float(recording.analog_rate_hz)]),
            "FORMAT": ["SIGNED"],
        },
        "FORCE_PLATFORM": {
            "USED": np.array([1]),
            "TYPE": np.array([recording.plate_type]),
            "ZERO": np.array([1, 0]),
            "CORNERS": recording.corners.T[:, :, None] * MM,
            "ORIGIN": recording.origin[:, None] * MM,
            "CHANNEL": np.arange(1, 9 if recording.plate_type == 3 else 7)[:, None],
            "CAL_MATRIX": np.zeros(0) if calibration is None else calibration[:, :, None],
        },
        "TRIAL": {"CAMERA_RATE": rate},
        "PROCESSING": {} if recording.body_mass_kg is None else {"BODYMASS": np.array([recording.body_mass_kg])},
        "SUBJECTS": {} if recording.subject is None else {"NAMES": [recording.subject]},
        "MANUFACTURER": {"COMPANY": ["osl-analysis"], "SOFTWARE": ["simulator"]},
    }
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
    body_mass: float | None = None  # Body mass [kg] of the person. None if nobody is there
    subject: str | None = None  # Name of the person. None if it has none


def platform_markers(platform: Pose, walking: WalkingSettings) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers on the platform."""
    return on_body(platform, {label: np.add(walking.plate.centre_m, place) for label, place in PLATFORM.items()})


def leg_markers(foot: Pose, shank: Pose, condition: Condition, walking: WalkingSettings, seed: int) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers that foot and shank always carry. Their places scatter from
    session to session of each person about those of the campaign's first one."""
    session, paths = f"{condition.person} {condition.session}", dict[str, Array]()
    scatter = 1e-3 * walking.effects.marker_placement.value if condition.attached_anew else 0.0
    for body, nominal in ((foot, FOOT), (shank, SHANK)):
        draws = {label: stream(seed, session, f"marker_placement_{label}").standard_normal(3) for label in nominal}
        paths |= on_body(body, {label: place + scatter * draws[label] for label, place in nominal.items()})
    return paths


def on_body(body: Pose, places: Mapping[str, MarkerPlace | Array]) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of points given by their places [m] on a body."""
    return {label: body.point(np.array(place)) for label, place in places.items()}


PLATE_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def sensor_from_centre(plate: MovingPlate) -> Array:
    """The sensor origin [m] from the surface's centre, laboratory axes of the resting plate, shape (3,)."""
    return np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])


def sensor_reading(
    reaction: TrueWrench, platform: Pose, plate: MovingPlate, mass: float, rate_hz: float
) -> tuple[Array, Array]:
    """Force [N] and moment about the sensor origin [N*m] that the plate reads, shape (n, 3) each, in its moving axes.

    Signs are as Vicon Nexus stores them: a standing person reads Fz < 0 along z down. The sensors carry the foot and
    the plate's own `mass` [kg] above them: force F + m (a - g), moment M + dH/dt + r x m (a - g). The zero was set at
    rest, in the sensors' axes, so that the plate's weight appears only when it tilts.
    """
    sensor = np.array(plate.centre_m) + sensor_from_centre(plate)
    turned = platform.rotation @ PLATE_AXES
    body = RigidBody(mass, np.add(plate.centre_m, plate.centre_of_mass_m), np.array(plate.gyration_m))
    own = body.support(platform, rate_hz)
    origin, resting = platform.point(sensor), -mass * GRAVITY
    force = np.einsum("nji,nj->ni", turned, reaction.force + own.force)
    moment = np.einsum("nji,nj->ni", turned, reaction.moment_about(origin) + own.moment_about(origin))
    zero_moment = np.cross(body.centre_of_mass - sensor, resting)
    return force - resting @ PLATE_AXES, moment - zero_moment @ PLATE_AXES


CHANNELS_OF_TYPE = {
    1: ("Fx1", "Fy1", "Fz1", "Px1", "Py1", "Tz1"),
    2: ("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1"),
    3: ("fx12", "fx34", "fy14", "fy23", "fz1", "fz2", "fz3", "fz4"),
    4: ("C1", "C2", "C3", "C4", "C5", "C6"),
}
UNITS_OF_TYPE = {
    1: ("N", "N", "N", "mm", "mm", "Nmm"),
    2: ("N", "N", "N", "Nmm", "Nmm", "Nmm"),
    3: ("N",) * 8,
    4: ("V",) * 6,
}


def plate_channels(force: Array, moment: Array, walking: WalkingSettings) -> tuple[Array, Array, Array | None]:
    """The channels of the plate's type from force [N] and moment [N*m] about the sensor origin, shape (n, 3) each;
    ORIGIN [m]; and the calibration matrix of type 4, whose channels are voltages with crosstalk.

    Type 1 computes its centre of pressure (0 below 20 N) as a plate that knows no motion. Type 3 has sensors in the
    corners (+a, +b), (-a, +b), (-a, -b), (+a, -b); statics leave how the horizontal pairs share Mz, and a torsion of
    the vertical forces: half each, and none. ORIGIN of types 2 and 4 has the sign of Vicon Nexus, z > 0 for a sensor
    below the surface; that of the C3D manual is the opposite, and readers reverse it by the sign of z.
    """
    plate, capture = walking.plate, walking.capture
    origin = np.asarray(PLATE_AXES.T @ sensor_from_centre(plate))
    if capture.plate_type == 1:
        moment = moment + np.cross(origin, force)
        loaded = np.abs(force[:, 2]) > 20.0
        upward = np.where(loaded, force[:, 2], 1.0)
        x, y = np.where(loaded, [-moment[:, 1] / upward, moment[:, 0] / upward], 0.0)
        free = np.where(loaded, moment[:, 2] - x * force[:, 1] + y * force[:, 0], 0.0)
        return np.column_stack([force, MM * x, MM * y, MM * free]), np.zeros(3), None
    if capture.plate_type == 3:
        (a, b), depth = capture.sensor_span_m, plate.sensor_depth_m
        moment = moment + np.cross(PLATE_AXES.T @ np.array([*plate.sensor_offset_m, 0.0]), force)
        (x, y, z), (m_x, m_y, m_z) = force.T, moment.T
        corners = [x / 2 - m_z / (4 * b), x / 2 + m_z / (4 * b), y / 2 + m_z / (4 * a), y / 2 - m_z / (4 * a)]
        for right, front in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
            corners.append(z / 4 + front * m_x / (4 * b) - right * m_y / (4 * a))
        return np.column_stack(corners), np.array([a, b, -depth]), None
    wrench = np.hstack([force, MM * moment])
    if capture.plate_type == 2:
        return wrench, origin, None
    volts, crosstalk = np.array([2e-3, 2e-3, 1e-3, 1e-5, 1e-5, 2e-5]), 0.01  # of each channel in the next one
    scale = np.array([1, 1, 1, MM, MM, MM])
    sensitivity = (np.eye(6) + crosstalk * np.eye(6, k=1)) * volts[:, None] * 10 / scale
    return wrench @ sensitivity.T, origin, np.linalg.inv(sensitivity)


def in_file_axes(places: Array, capture: CaptureSettings) -> Array:
    """Laboratory coordinates, shape (..., 3), in the axes of the file. With y up, z points to the right."""
    x, y, z = np.moveaxis(places, -1, 0)
    return places if capture.up_axis == "z" else np.stack([x, z, -y], axis=-1)


def vicon_recording(trial: str, seed: int, scene: Scene, walking: WalkingSettings) -> C3dRecording:
    """The Vicon recording of a scene: markers with noise and gaps; the plate inside the rails of its amplifiers, with
    lag, offset and noise, and the dead channels; synchronisation, and the trigger, which is high for 20 ms."""
    rates, plate, capture, effects = walking.rates, walking.plate, walking.capture, walking.effects
    exact = np.stack(list(scene.markers.values()), axis=1)[:: rates.motion_hz // rates.points_hz]
    time, kind = np.arange(len(exact) * (rates.analogs_hz // rates.points_hz)) / rates.analogs_hz, capture.plate_type
    true = sensor_reading(scene.reaction, scene.platform, plate, effects.plate_inertia.value, rates.motion_hz)
    disturbed = []
    for quantity, values in zip(("force", "moment"), true, strict=True):
        noise = stream(seed, trial, f"{quantity}_noise").standard_normal((len(time), 3))
        offset = stream(seed, trial, f"{quantity}_offset").standard_normal(3)
        late = interpolated_at(values, rates.motion_hz, time - 1e-3 * effects.plate_lag.value)
        late = late + getattr(effects, f"{quantity}_noise").value * noise
        disturbed.append(late + getattr(effects, f"{quantity}_offset").value * offset)
    channels, origin, calibration = plate_channels(disturbed[0], disturbed[1], walking)
    force_rail = effects.sensor_clip if kind == 3 else effects.force_clip
    rails = {"N": force_rail.value, "Nmm": MM * effects.moment_clip.value}
    limits = np.array([rails.get(unit, 0.0) or np.inf for unit in UNITS_OF_TYPE[kind]])
    channels = np.clip(channels, -limits, limits)
    for label, value in capture.dead_channels.items():
        channels[:, CHANNELS_OF_TYPE[kind].index(label)] = value
    command = np.inf if scene.command is None else scene.command
    trigger = np.asarray((time >= command) & (time < command + 0.02), dtype=float)
    levels = [sync_level(trial, seed, walking.gait.recording_s, time), trigger]
    labels = tuple(scene.markers)
    if capture.swapped_in is None or trial in capture.swapped_in:
        other = {a: b for pair in capture.swapped_labels for a, b in (pair, pair[::-1])}
        labels = tuple(other.get(label, label) for label in labels)
    quadrants = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=float) @ PLATE_AXES.T
    corners = np.array(plate.centre_m) + quadrants * (0.5 * np.array([*plate.size_m, 0.0]))  # in C3D's order
    return C3dRecording(
        labels=labels,
        points=in_file_axes(seen_markers(trial, seed, exact, walking), capture),
        point_rate_hz=rates.points_hz,
        channels=(*CHANNELS_OF_TYPE[kind], "Sync", "Trigger"),
        units=(*((capture.moment_label or unit) if unit == "Nmm" else unit for unit in UNITS_OF_TYPE[kind]), "V", "V"),
        analogs=np.column_stack([channels, *(5.0 * level for level in levels)]),
        analog_rate_hz=rates.analogs_hz,
        corners=in_file_axes(corners, capture),
        origin=origin,
        plate_type=kind,
        calibration=calibration,
        screen=("+X", f"+{capture.up_axis.upper()}") if capture.states_axes else None,
        body_mass_kg=scene.body_mass if capture.states_body_mass else None,
        subject=scene.subject,
    )


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
