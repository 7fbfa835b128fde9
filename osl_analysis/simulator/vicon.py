"""The simulated Vicon recording: markers with noise and gaps, force plate, sync and trigger, as a C3D file of Nexus.

The plate's axes are those of C3D force plates: x along laboratory +y, y along laboratory +x, z down, all turning with
the platform.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from osl_analysis.files import atomic_path
from osl_analysis.simulator.rigid_body import GRAVITY, Point, Pose, TrueWrench, interpolated_at, support
from osl_analysis.simulator.settings import stream
from osl_analysis.simulator.step import GaitTrial, PlatformMotion
from osl_analysis.trial import Array

MM = 1e3
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


PLATE_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def write_c3d(path: Path, points: Array, analogs: Array, groups: Mapping[str, Mapping[str, Any]]) -> None:
    """Write markers [m], (frames, labels, 3), NaN where hidden, and analogs, (samples, channels), with groups of
    parameters; the file appears whole or not at all. A hidden marker is stored as Nexus does it: coordinates 0 and
    residual -1. That of a seen one is 0, because readers disagree about the byte of a positive residual."""
    file: Any = ezc3d.c3d()
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


def plate_analogs(trial: GaitTrial, time: Array, platform: Pose, load: TrueWrench) -> Array:
    """Force [N] and moment [N*mm] that the plate reads at times [s], (n, 6), with lag, offset and noise. Signs are as
    Vicon Nexus stores them: a standing person reads Fz < 0 along z down. The sensors carry the foot and the plate's own
    mass above them: force F + m (a - g), moment M + dH/dt + r x m (a - g). The zero was set at rest."""
    plate, effects = trial.walking.plate, trial.walking.effects
    rate, turned = trial.walking.rates.motion_hz, platform.rotation @ PLATE_AXES
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
    return np.hstack([disturbed[0], MM * disturbed[1]])


def write_capture(
    folder: Path,
    trial: GaitTrial,
    leg: Mapping[str, Array],
    platform: PlatformMotion,
    load: TrueWrench,
) -> None:
    """Write the capture `vicon/<trial>.c3d`: the exact paths of the leg's markers [m] and those of the platform, with
    noise and gaps; the plate, of type 2, under its load, synchronisation, and the trigger, high for 20 ms."""
    rates, plate = trial.walking.rates, trial.walking.plate
    on_platform = {label: np.add(plate.centre_m, place) for label, place in PLATFORM.items()}
    markers = {**leg, **on_body(platform.pose, on_platform)}
    exact = np.stack(list(markers.values()), axis=1)[:: rates.motion_hz // rates.points_hz]
    time = np.arange(len(exact) * (rates.analogs_hz // rates.points_hz)) / rates.analogs_hz
    command = np.inf if platform.command is None else platform.command
    trigger = np.asarray((time >= command) & (time < command + 0.02), dtype=float)
    channels = plate_analogs(trial, time, platform.pose, load)
    analogs = np.column_stack([channels, 5.0 * sync_level(trial, time), 5.0 * trigger])
    quadrants = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=float) @ PLATE_AXES.T
    corners = np.array(plate.centre_m) + quadrants * (0.5 * np.array([*plate.size_m, 0.0]))  # in C3D's order
    # z > 0 below the surface, as Vicon Nexus has it; the C3D manual has the opposite sign
    origin = PLATE_AXES.T @ np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])
    person = trial.condition.person if leg else None
    groups: dict[str, dict[str, Any]] = {
        "POINT": {
            "LABELS": list(markers),
            "DESCRIPTIONS": [""] * len(markers),
            "UNITS": ["mm"],
            "RATE": np.array([float(rates.points_hz)]),
            "X_SCREEN": ["+X"],
            "Y_SCREEN": ["+Z"],
            "FORCE_UNITS": ["N"],
            "MOMENT_UNITS": ["Nmm"],
        },
        "ANALOG": {
            "LABELS": ["Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1", "Sync", "Trigger"],
            "DESCRIPTIONS": [""] * 8,
            "UNITS": [*["N"] * 3, *["Nmm"] * 3, "V", "V"],
            "RATE": np.array([float(rates.analogs_hz)]),
            "FORMAT": ["SIGNED"],
        },
        "FORCE_PLATFORM": {
            "USED": np.array([1]),
            "TYPE": np.array([2]),
            "ZERO": np.array([1, 0]),
            "CORNERS": corners.T[:, :, None] * MM,
            "ORIGIN": origin[:, None] * MM,
            "CHANNEL": np.arange(1, 7)[:, None],
            "CAL_MATRIX": np.zeros(0),
        },
        "TRIAL": {"CAMERA_RATE": np.array([float(rates.points_hz)])},
        "SUBJECTS": {} if person is None else {"NAMES": [person]},
        "MANUFACTURER": {"COMPANY": ["osl-analysis"], "SOFTWARE": ["simulator"]},
    }
    write_c3d(folder / "vicon" / f"{trial.name}.c3d", seen_markers(trial, exact), analogs, groups)


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
