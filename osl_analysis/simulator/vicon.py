"""The simulated Vicon recording: markers with noise and gaps, force plate, sync and trigger, as a C3D file of Nexus.

The plate's axes are those of C3D force plates: x along laboratory +y, y along laboratory +x, z down, all turning with
the platform. Channels of types 1 to 4 are as the C3D manual has them, with Kistler's formulas solved.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.errors import optional_module
from osl_analysis.files import atomic_path
from osl_analysis.simulator.settings import stream
from osl_analysis.simulator.step import (
    GRAVITY,
    GaitTrial,
    PlatformMotion,
    Point,
    Pose,
    TrueWrench,
    interpolated_at,
    support,
)
from osl_analysis.simulator.walking_settings import FOOT, PLATE_CHANNELS, PLATFORM, SHANK, WalkingSettings
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


def sync_level(trial: GaitTrial, time: Array) -> Array:
    """Level, 0 or 1, of the synchronisation line at times [s]: an irregular pulse train over the duration of a
    recording, whose pattern does not repeat. It is low before the first pulse."""
    shortest, longest, duration = 0.06, 0.25, trial.walking.gait.recording_s  # intervals [s] between two changes
    edges = np.cumsum(trial.random("sync").uniform(shortest, longest, int(duration / shortest) + 1))
    return np.asarray(np.searchsorted(edges[edges < duration], time, side="right") % 2, dtype=float)


def leg_markers(foot: Pose, shank: Pose, trial: GaitTrial) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of the markers that foot and shank always carry. Their places scatter from
    session to session of each person about those of the campaign's first one."""
    condition, paths = trial.condition, dict[str, Array]()
    session = f"{condition.person} {condition.session}"
    scatter = 1e-3 * trial.walking.effects.marker_placement.value if condition.attached_anew else 0.0
    for body, nominal in ((foot, FOOT), (shank, SHANK)):
        draws = {n: stream(trial.seed, session, f"marker_placement_{n}").standard_normal(3) for n in nominal}
        paths |= on_body(body, {label: place + scatter * draws[label] for label, place in nominal.items()})
    return paths


def on_body(body: Pose, places: Mapping[str, Point]) -> dict[str, Array]:
    """Exact paths [m], shape (n, 3) each, of points given by their places [m] on a body."""
    return {label: body.point(place) for label, place in places.items()}


def plate_channels(force: Array, moment: Array, walking: WalkingSettings) -> tuple[Array, Array, Array | None]:
    """The channels of the plate's type from force [N] and moment [N*m] about the sensor origin, shape (n, 3) each;
    ORIGIN [m]; and the calibration matrix of type 4, whose channels are voltages with crosstalk. Type 1 computes its
    centre of pressure (0 below 20 N). Type 3 has sensors in the corners (+a, +b), (-a, +b), (-a, -b), (+a, -b); of what
    statics leave open, the horizontal pairs share Mz evenly, and the vertical forces have no torsion. ORIGIN of types 2
    and 4 has the sign of Vicon Nexus, z > 0 below the surface; that of the C3D manual is the opposite."""
    plate, capture = walking.plate, walking.capture
    origin = np.asarray(PLATE_AXES.T @ np.array([*plate.sensor_offset_m, -plate.sensor_depth_m]))
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


def plate_analogs(trial: GaitTrial, time: Array, platform: Pose, load: TrueWrench) -> tuple[Array, Array, Array | None]:
    """The plate's channels at times [s], (n, channels), inside the rails of its amplifiers, with lag, offset and noise,
    and the dead channels; its ORIGIN and its calibration, as `plate_channels` gives them.

    Signs are as Vicon Nexus stores them: a standing person reads Fz < 0 along z down. The sensors carry the foot and
    the plate's own mass above them: force F + m (a - g), moment M + dH/dt + r x m (a - g). The zero was set at rest.
    """
    walking, plate, kind = trial.walking, trial.walking.plate, trial.walking.capture.plate_type
    effects, rate, turned = walking.effects, walking.rates.motion_hz, platform.rotation @ PLATE_AXES
    sensor = np.array(plate.centre_m) + np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])
    mass, centre = effects.plate_inertia.value, np.add(plate.centre_m, plate.centre_of_mass_m)
    own, origin = support(platform, rate, mass, centre, plate.gyration_m), platform.point(sensor)
    force, resting = np.einsum("nji,nj->ni", turned, load.force + own.force), -mass * GRAVITY
    moment = np.einsum("nji,nj->ni", turned, load.moment_about(origin) + own.moment_about(origin))
    zeroed = force - resting @ PLATE_AXES, moment - np.cross(centre - sensor, resting) @ PLATE_AXES
    disturbed = []
    for quantity, values in zip(("force", "moment"), zeroed, strict=True):
        noise = trial.random(f"{quantity}_noise").standard_normal((len(time), 3))
        offset = trial.random(f"{quantity}_offset").standard_normal(3)
        late = interpolated_at(values, rate, time - 1e-3 * effects.plate_lag.value)
        late = late + getattr(effects, f"{quantity}_noise").value * noise
        disturbed.append(late + getattr(effects, f"{quantity}_offset").value * offset)
    channels, origin, calibration = plate_channels(disturbed[0], disturbed[1], walking)
    force_rail = effects.sensor_clip if kind == 3 else effects.force_clip
    rails = {"N": force_rail.value, "Nmm": MM * effects.moment_clip.value}
    limits = np.array([rails.get(unit, 0.0) or np.inf for unit in PLATE_CHANNELS[kind].values()])
    channels = np.clip(channels, -limits, limits)
    for label, value in walking.capture.dead_channels.items():
        channels[:, list(PLATE_CHANNELS[kind]).index(label)] = value
    return channels, origin, calibration


def write_capture(
    folder: Path, trial: GaitTrial, leg: Mapping[str, Array], platform: PlatformMotion, load: TrueWrench
) -> None:
    """Write the capture `vicon/<trial>.c3d`: the exact paths of the leg's markers [m] and those of the platform, with
    noise and gaps; the plate under its load, synchronisation, and the trigger, high for 20 ms. Without markers on
    a leg there is no person."""
    walking, plate, capture = trial.walking, trial.walking.plate, trial.walking.capture
    rates, kind = walking.rates, capture.plate_type
    on_platform = {label: np.add(plate.centre_m, place) for label, place in PLATFORM.items()}
    markers = {**leg, **on_body(platform.pose, on_platform)}
    exact = np.stack(list(markers.values()), axis=1)[:: rates.motion_hz // rates.points_hz]
    time = np.arange(len(exact) * (rates.analogs_hz // rates.points_hz)) / rates.analogs_hz
    channels, origin, calibration = plate_analogs(trial, time, platform.pose, load)
    command = np.inf if platform.command is None else platform.command
    trigger = np.asarray((time >= command) & (time < command + 0.02), dtype=float)
    analogs = np.column_stack([channels, 5.0 * sync_level(trial, time), 5.0 * trigger])
    labels = list(markers)
    if capture.swapped_in is None or trial.name in capture.swapped_in:
        other = {a: b for pair in capture.swapped_labels for a, b in (pair, pair[::-1])}
        labels = [other.get(label, label) for label in labels]
    quadrants = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=float) @ PLATE_AXES.T
    corners = np.array(plate.centre_m) + quadrants * (0.5 * np.array([*plate.size_m, 0.0]))  # in C3D's order
    units = [capture.moment_label or unit if unit == "Nmm" else unit for unit in PLATE_CHANNELS[kind].values()]
    points, names = seen_markers(trial, exact), [*PLATE_CHANNELS[kind], "Sync", "Trigger"]
    if capture.up_axis == "y":  # and z points to the right
        points, corners = (np.stack([p[..., 0], p[..., 2], -p[..., 1]], axis=-1) for p in (points, corners))
    screen = {"X_SCREEN": ["+X"], "Y_SCREEN": [f"+{capture.up_axis.upper()}"]}
    person, mass = trial.condition.person if leg else None, np.array([trial.body_mass])
    groups: dict[str, dict[str, Any]] = {
        "POINT": {
            "LABELS": labels,
            "DESCRIPTIONS": [""] * len(labels),
            "UNITS": ["mm"],
            "RATE": np.array([float(rates.points_hz)]),
            **(screen if capture.states_axes else {}),
            "FORCE_UNITS": ["N"],
            "MOMENT_UNITS": ["Nmm"],
        },
        "ANALOG": {
            "LABELS": names,
            "DESCRIPTIONS": [""] * len(names),
            "UNITS": [*units, "V", "V"],
            "RATE": np.array([float(rates.analogs_hz)]),
            "FORMAT": ["SIGNED"],
        },
        "FORCE_PLATFORM": {
            "USED": np.array([1]),
            "TYPE": np.array([kind]),
            "ZERO": np.array([1, 0]),
            "CORNERS": corners.T[:, :, None] * MM,
            "ORIGIN": origin[:, None] * MM,
            "CHANNEL": np.arange(1, channels.shape[1] + 1)[:, None],
            "CAL_MATRIX": np.zeros(0) if calibration is None else calibration[:, :, None],
        },
        "TRIAL": {"CAMERA_RATE": np.array([float(rates.points_hz)])},
        "PROCESSING": {"BODYMASS": mass} if capture.states_body_mass and leg else {},
        "SUBJECTS": {} if person is None else {"NAMES": [person]},
        "MANUFACTURER": {"COMPANY": ["osl-analysis"], "SOFTWARE": ["simulator"]},
    }
    write_c3d(folder / "vicon" / f"{trial.name}.c3d", points, analogs, groups)


def seen_markers(trial: GaitTrial, exact: Array) -> Array:
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
